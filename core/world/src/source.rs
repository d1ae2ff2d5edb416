//! Sources of costs, by name. The set is open: a stack lists the sources of its world model.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// Greatest length of a source's name, bytes.
const MAX_NAME: usize = 32;

/// A source of costs of the world model, by its name in the fields of a map: `cost.stereo`.
///
/// It contains its name, so that it can be copied like a number, and any name in a log or a stack is valid.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Source([u8; MAX_NAME]);

impl Source {
    /// Obstacles from range images (Albus 2006a, 3.1.1).
    pub const STEREO: Source = Source::padded(b"stereo");
    /// Colour models (Albus 2006a, 3.1.2); "classification" in the papers.
    pub const COLOR: Source = Source::padded(b"color");
    /// Terrain learned from range (Albus 2006a, 3.2); "learning" in the papers.
    pub const TERRAIN: Source = Source::padded(b"terrain");
    /// Classifier over image windows (Albus 2006a, 3.3).
    pub const CLASSIFIER: Source = Source::padded(b"classifier");
    /// The bumper's switches.
    pub const BUMPER: Source = Source::padded(b"bumper");
    /// The infrared range sensors.
    pub const INFRARED: Source = Source::padded(b"infrared");
    /// Ground on which the wheels slipped.
    pub const SLIP: Source = Source::padded(b"slip");
    /// The map of an earlier run.
    pub const MEMORY: Source = Source::padded(b"memory");
    /// The bundled sources, in the order that decides ties.
    pub const BUNDLED: [Source; 6] = [
        Source::STEREO,
        Source::COLOR,
        Source::TERRAIN,
        Source::CLASSIFIER,
        Source::BUMPER,
        Source::INFRARED,
    ];

    /// The source with this name: lower-case letters, digits and underscores.
    pub fn new(name: &str) -> Result<Source, SourceNameError> {
        let valid = |byte: u8| byte.is_ascii_lowercase() || byte.is_ascii_digit() || byte == b'_';
        if name.is_empty() || name.len() > MAX_NAME || !name.bytes().all(valid) {
            return Err(SourceNameError { got: name.chars().take(MAX_NAME).collect() });
        }
        Ok(Source::padded(name.as_bytes()))
    }

    /// The name padded with zeros, which no name contains, so that it sorts like the text.
    const fn padded(name: &[u8]) -> Source {
        let mut bytes = [0; MAX_NAME];
        let mut at = 0;
        while at < name.len() {
            bytes[at] = name[at];
            at += 1;
        }
        Source(bytes)
    }

    /// The name in grid fields: `cost.stereo`.
    pub fn name(&self) -> &str {
        let length = self.0.iter().position(|&byte| byte == 0).unwrap_or(MAX_NAME);
        str::from_utf8(&self.0[..length]).unwrap_or_default()
    }
}

impl fmt::Debug for Source {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Source({})", self.name())
    }
}

impl fmt::Display for Source {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// Why a text is not a source's name.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("\"{got}\" cannot name a source, expected 1 to 32 small letters, digits and underscores")]
pub struct SourceNameError {
    got: String,
}

impl FromStr for Source {
    type Err = SourceNameError;

    fn from_str(name: &str) -> Result<Source, SourceNameError> {
        Source::new(name)
    }
}

impl Serialize for Source {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.name())
    }
}

impl<'de> Deserialize<'de> for Source {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Source, D::Error> {
        let name = String::deserialize(deserializer)?;
        Source::new(&name).map_err(serde::de::Error::custom)
    }
}

/// A list of distinct sources: those of a map.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(from = "Vec<Source>")]
pub struct Sources(Vec<Source>);

impl Sources {
    /// The sources that come with the program.
    pub fn bundled() -> Sources {
        Source::BUNDLED.into_iter().collect()
    }

    /// Whether the list contains the source.
    pub fn contains(&self, source: Source) -> bool {
        self.0.contains(&source)
    }

    /// Appends the source if it is not in the list.
    pub fn insert(&mut self, source: Source) {
        if !self.contains(source) {
            self.0.push(source);
        }
    }

    /// Number of sources.
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// Whether the list is empty.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// The sources, in order.
    pub fn iter(&self) -> impl Iterator<Item = Source> + use<'_> {
        self.0.iter().copied()
    }
}

impl FromIterator<Source> for Sources {
    fn from_iter<I: IntoIterator<Item = Source>>(sources: I) -> Sources {
        let mut list = Sources::default();
        sources.into_iter().for_each(|source| list.insert(source));
        list
    }
}

impl From<Vec<Source>> for Sources {
    fn from(sources: Vec<Source>) -> Sources {
        sources.into_iter().collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_lead_back_to_their_sources_and_any_name_is_one() {
        for source in Source::BUNDLED {
            assert_eq!(source.name().parse(), Ok(source));
        }
        let radar: Source = "radar_2".parse().unwrap();
        assert_eq!((radar.name(), "radar_2".parse()), ("radar_2", Ok(radar)));
        for bad in ["", "Radar", "a b", "a.b", "ä"] {
            let error = bad.parse::<Source>().unwrap_err().to_string();
            assert!(error.contains("expected 1 to 32 small letters"), "{error}");
        }
        assert_eq!("x".repeat(32).parse::<Source>().unwrap().name(), "x".repeat(32));
        assert!("x".repeat(33).parse::<Source>().is_err());
    }

    #[test]
    fn a_list_holds_each_source_once_in_the_order_in_which_they_came() {
        let list: Sources = [Source::INFRARED, Source::STEREO, Source::INFRARED].into_iter().collect();
        assert_eq!(list.iter().collect::<Vec<_>>(), [Source::INFRARED, Source::STEREO]);
        assert_eq!(list.len(), 2);
        assert!(Sources::default().is_empty());
    }
}
