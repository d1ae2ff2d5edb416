//! Who contributes to the map.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

/// A contributor to the world model. The order is that of arrays by source, and settles ties.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Source {
    /// Obstacles from range images (A 3.1.1).
    Stereo,
    /// Colour models (A 3.1.2); the papers' "classification".
    Color,
    /// Terrain learned from range (A 3.2); the papers' "learning".
    Terrain,
    /// Classifier over image windows (A 3.3).
    Classifier,
    /// The bumper's switches.
    Bumper,
    /// The infrared range sensors.
    Infrared,
}

impl Source {
    /// How many there are.
    pub const COUNT: usize = 6;
    /// All, in order.
    pub const ALL: [Source; Source::COUNT] = [
        Source::Stereo,
        Source::Color,
        Source::Terrain,
        Source::Classifier,
        Source::Bumper,
        Source::Infrared,
    ];

    /// As in the names of grid fields: `cost.stereo`.
    pub const fn name(self) -> &'static str {
        match self {
            Source::Stereo => "stereo",
            Source::Color => "color",
            Source::Terrain => "terrain",
            Source::Classifier => "classifier",
            Source::Bumper => "bumper",
            Source::Infrared => "infrared",
        }
    }

    /// Place in arrays by source.
    pub const fn index(self) -> usize {
        self as usize
    }
}

impl fmt::Display for Source {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// Not the name of a source.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("source \"{got}\" is unknown, expected stereo, color, terrain, classifier, bumper or infrared")]
pub struct UnknownSource {
    got: String,
}

impl FromStr for Source {
    type Err = UnknownSource;

    fn from_str(name: &str) -> Result<Source, UnknownSource> {
        let found = Source::ALL.into_iter().find(|source| source.name() == name);
        found.ok_or_else(|| UnknownSource { got: name.to_owned() })
    }
}

/// A set of sources: those that a stack has.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(from = "Vec<Source>", into = "Vec<Source>")]
pub struct Sources(u8);

impl Sources {
    /// Every source there is.
    pub const ALL: Sources = Sources((1 << Source::COUNT) - 1);

    /// Whether the source is one of them.
    pub const fn contains(self, source: Source) -> bool {
        self.0 >> source.index() & 1 == 1
    }

    /// Adds a source.
    pub const fn insert(&mut self, source: Source) {
        self.0 |= 1 << source.index();
    }

    /// How many.
    pub const fn len(self) -> usize {
        self.0.count_ones() as usize
    }

    /// Whether there are none.
    pub const fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// In the order of [`Source::ALL`].
    pub fn iter(self) -> impl Iterator<Item = Source> {
        Source::ALL.into_iter().filter(move |&source| self.contains(source))
    }
}

impl FromIterator<Source> for Sources {
    fn from_iter<I: IntoIterator<Item = Source>>(sources: I) -> Sources {
        let mut set = Sources::default();
        sources.into_iter().for_each(|source| set.insert(source));
        set
    }
}

impl From<Vec<Source>> for Sources {
    fn from(sources: Vec<Source>) -> Sources {
        sources.into_iter().collect()
    }
}

impl From<Sources> for Vec<Source> {
    fn from(sources: Sources) -> Vec<Source> {
        sources.iter().collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_lead_back_to_their_sources_and_indices_count_up() {
        for (i, source) in Source::ALL.into_iter().enumerate() {
            assert_eq!(source.name().parse(), Ok(source));
            assert_eq!(source.index(), i);
        }
        assert_eq!(
            "radar".parse::<Source>().unwrap_err().to_string(),
            "source \"radar\" is unknown, expected stereo, color, terrain, classifier, bumper or infrared"
        );
    }

    #[test]
    fn a_set_holds_what_was_put_in_in_order() {
        let set: Sources = [Source::Infrared, Source::Stereo, Source::Stereo].into_iter().collect();
        assert_eq!(Vec::from(set), [Source::Stereo, Source::Infrared]);
        assert_eq!(set.len(), 2);
        assert_eq!(Sources::ALL.len(), Source::COUNT);
        assert!(Sources::default().is_empty());
    }
}
