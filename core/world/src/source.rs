//! Who contributes to the map: names, and how each counts. The set is open: a stack lists its sources.

use std::collections::BTreeSet;
use std::fmt;
use std::str::FromStr;
use std::sync::{Mutex, PoisonError};

use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// Longest name of a source, bytes.
const MAX_NAME: usize = 64;
/// How many names there may be in one program: names come from logs, too, and are kept for good.
const MAX_NAMES: usize = 4096;

/// A contributor to the world model, by name, as in the fields of a map: `cost.stereo`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Source(&'static str);

/// Names that are no constants, each once. They are compared by content, so that their order here shows nowhere.
static NAMES: Mutex<BTreeSet<&'static str>> = Mutex::new(BTreeSet::new());

impl Source {
    /// Obstacles from range images (A 3.1.1).
    pub const STEREO: Source = Source("stereo");
    /// Colour models (A 3.1.2); the papers' "classification".
    pub const COLOR: Source = Source("color");
    /// Terrain learned from range (A 3.2); the papers' "learning".
    pub const TERRAIN: Source = Source("terrain");
    /// Classifier over image windows (A 3.3).
    pub const CLASSIFIER: Source = Source("classifier");
    /// The bumper's switches.
    pub const BUMPER: Source = Source("bumper");
    /// The infrared range sensors.
    pub const INFRARED: Source = Source("infrared");
    /// The sources that come with the program, in the order that settles ties between them.
    pub const BUNDLED: [Source; 6] = [
        Source::STEREO,
        Source::COLOR,
        Source::TERRAIN,
        Source::CLASSIFIER,
        Source::BUMPER,
        Source::INFRARED,
    ];

    /// The source of that name: small letters, digits and underscores.
    pub fn new(name: &str) -> Result<Source, SourceNameError> {
        let valid = |byte: u8| byte.is_ascii_lowercase() || byte.is_ascii_digit() || byte == b'_';
        if name.is_empty() || name.len() > MAX_NAME || !name.bytes().all(valid) {
            return Err(SourceNameError { got: name.chars().take(MAX_NAME).collect() });
        }
        if let Some(known) = Source::BUNDLED.into_iter().find(|source| source.0 == name) {
            return Ok(known);
        }
        let mut names = NAMES.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(known) = names.get(name) {
            return Ok(Source(known));
        }
        if names.len() >= MAX_NAMES {
            return Err(SourceNameError { got: name.to_owned() });
        }
        let name: &'static str = Box::leak(name.into());
        names.insert(name);
        Ok(Source(name))
    }

    /// As in the names of grid fields: `cost.stereo`.
    pub const fn name(self) -> &'static str {
        self.0
    }
}

impl fmt::Display for Source {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.0)
    }
}

/// Not the name of a source.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("\"{got}\" cannot name a source, expected 1 to 64 small letters, digits and underscores")]
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
        serializer.serialize_str(self.0)
    }
}

impl<'de> Deserialize<'de> for Source {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Source, D::Error> {
        let name = String::deserialize(deserializer)?;
        Source::new(&name).map_err(serde::de::Error::custom)
    }
}

/// A list of sources, each once: those that a map holds.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(from = "Vec<Source>")]
pub struct Sources(Vec<Source>);

impl Sources {
    /// The sources that come with the program.
    pub fn bundled() -> Sources {
        Source::BUNDLED.into_iter().collect()
    }

    /// Whether the source is one of them.
    pub fn contains(&self, source: Source) -> bool {
        self.0.contains(&source)
    }

    /// Adds a source behind the others, if it is not there.
    pub fn insert(&mut self, source: Source) {
        if !self.contains(source) {
            self.0.push(source);
        }
    }

    /// How many.
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// In their order.
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
            assert!(error.contains("expected 1 to 64 small letters"), "{error}");
        }
        assert!("x".repeat(65).parse::<Source>().is_err());
    }

    #[test]
    fn a_list_holds_each_source_once_in_the_order_in_which_they_came() {
        let list: Sources = [Source::INFRARED, Source::STEREO, Source::INFRARED].into_iter().collect();
        assert_eq!(list.iter().collect::<Vec<_>>(), [Source::INFRARED, Source::STEREO]);
        assert_eq!(list.len(), 2);
        assert!(Sources::default().is_empty());
    }
}
