//! Keys of topics and fields: the name of a topic and the run that is meant, as stored in layouts.

use rcs_msg::FieldPath;
use rcs_runtime::RunId;
use rcs_runtime::source::{Frame, RunTag, Topic};
use serde::{Deserialize, Serialize};

/// Which run is meant, where several contain a topic of the same name.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RunChoice {
    /// The run being shown.
    #[default]
    Shown,
    /// The recording.
    Recorded,
    /// The run with this number.
    Run(u32),
}

impl RunChoice {
    /// The run, if it is not the one being shown.
    pub fn id(self) -> Option<RunId> {
        match self {
            Self::Run(run) => Some(RunId(run)),
            Self::Shown | Self::Recorded => None,
        }
    }

    /// What topics and series of the run are marked with in a frame.
    pub(crate) fn tag(self, frame: &Frame) -> RunTag {
        match self {
            Self::Shown => RunTag::Run(frame.runs.current()),
            Self::Recorded => RunTag::Recorded,
            Self::Run(run) => RunTag::Run(RunId(run)),
        }
    }

    /// Name in lists.
    pub fn name(self) -> String {
        match self {
            Self::Shown => "the viewed run".to_owned(),
            Self::Recorded => "the recording".to_owned(),
            Self::Run(run) => RunId(run).to_string(),
        }
    }
}

/// Identifies a topic in layouts, in selections and while dragging.
#[derive(Clone, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(from = "StoredKey")]
pub struct TopicKey {
    /// Name of the buffer: `/wm1/map`.
    pub name: String,
    /// The run.
    pub run: RunChoice,
}

/// A key as stored in layouts: older versions have `recorded` instead of `run`.
#[derive(Deserialize)]
struct StoredKey {
    name: String,
    #[serde(default)]
    run: Option<RunChoice>,
    #[serde(default)]
    recorded: bool,
}

impl From<StoredKey> for TopicKey {
    fn from(stored: StoredKey) -> Self {
        let old = if stored.recorded { RunChoice::Recorded } else { RunChoice::Shown };
        Self { name: stored.name, run: stored.run.unwrap_or(old) }
    }
}

impl TopicKey {
    /// The key of a topic; for a computed topic, in whichever run is shown.
    pub fn of(topic: &Topic) -> Self {
        let run = if topic.run.is_recorded() { RunChoice::Recorded } else { RunChoice::Shown };
        Self { name: topic.name.to_string(), run }
    }

    /// The topic with this name in the run being shown.
    pub fn shown(name: impl Into<String>) -> Self {
        Self { name: name.into(), run: RunChoice::Shown }
    }

    /// Finds the topic in a frame; in another run where it does not exist in the one that is meant.
    pub fn find<'a>(&self, frame: &'a Frame) -> Option<&'a Topic> {
        frame.topic_of(&self.name, self.run.tag(frame)).or_else(|| frame.topic(&self.name))
    }

    /// Whether the key identifies exactly this topic.
    pub fn is(&self, topic: &Topic) -> bool {
        let same_run = match (self.run, topic.run) {
            (RunChoice::Recorded, run) => run.is_recorded(),
            (RunChoice::Shown, run) => !run.is_recorded(),
            (RunChoice::Run(number), run) => run == RunTag::Run(RunId(number)),
        };
        *self.name == *topic.name && same_run
    }
}

/// Identifies a field of a topic while dragging.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FieldKey {
    /// The topic.
    pub topic: TopicKey,
    /// Path of the field.
    pub path: FieldPath,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_of_older_layouts_open_and_newer_ones_keep_their_run() {
        let read = |text: &str| serde_json::from_str::<TopicKey>(text).unwrap();
        assert_eq!(read(r#"{"name":"/a"}"#), TopicKey::shown("/a"));
        assert_eq!(read(r#"{"name":"/a","recorded":false}"#), TopicKey::shown("/a"));
        assert_eq!(read(r#"{"name":"/a","recorded":true}"#).run, RunChoice::Recorded);
        for run in [RunChoice::Shown, RunChoice::Recorded, RunChoice::Run(3)] {
            let key = TopicKey { name: "/a".into(), run };
            assert_eq!(read(&serde_json::to_string(&key).unwrap()), key);
        }
    }
}
