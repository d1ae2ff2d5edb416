//! What a log holds: topics, messages, and what was lost.

use crate::gaps::Gap;
use bytes::Bytes;
use rcs_msg::{Schema, Stamp};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;

/// A topic of one log: the channel's number in its file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct TopicId(pub u16);

/// What could not be read.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Lost {
    /// Bytes that held something and yielded nothing: bytes of the file that were passed over, and in a damaged or
    /// cut chunk the bytes of its uncompressed contents that were not salvaged.
    pub bytes: u64,
    /// Messages known to be lost: those that the statistics, or the message index behind a damaged chunk, count and
    /// that were not found. A cut chunk has no count, so its messages show in `bytes` alone.
    pub messages: u64,
}

impl std::ops::AddAssign for Lost {
    fn add_assign(&mut self, other: Self) {
        self.bytes = self.bytes.saturating_add(other.bytes);
        self.messages = self.messages.saturating_add(other.messages);
    }
}

/// One channel of a log. Several may carry the same name: publishers that differ in schema or metadata.
#[derive(Clone, Debug)]
pub struct LogTopic {
    /// The channel's number.
    pub id: TopicId,
    /// Name: `/wm1/map`.
    pub name: String,
    /// What its messages are; with an empty name where the log gives no schema.
    pub schema: Arc<Schema>,
    /// Channel metadata: `rcs.role`, `offered_qos_profiles`, ….
    pub metadata: BTreeMap<String, String>,
    /// How many messages can be read.
    pub messages: u64,
    /// Messages per second of the log's duration; 0 for fewer than two messages, and for a log without duration.
    pub hz: f64,
    /// Whether there is a reader for the schema.
    pub decodable: bool,
    /// Why not, where there is none.
    pub undecodable_because: Option<String>,
}

/// What a log holds, known from opening it.
#[derive(Clone, Debug)]
pub struct LogInfo {
    /// The file; empty for a log in memory.
    pub path: PathBuf,
    /// Size of the file in bytes.
    pub bytes: u64,
    /// Log time of the first message; 0 without messages.
    pub start: Stamp,
    /// Log time of the last message; 0 without messages.
    pub end: Stamp,
    /// How many messages can be read.
    pub messages: u64,
    /// Chunks, and runs of messages outside chunks.
    pub segments: u64,
    /// Whether the log was read without a usable summary, by a scan of its records.
    pub recovered: bool,
    /// What could not be read, as far as opening shows; [`Log::lost`](crate::Log::lost) goes on counting.
    pub lost: Lost,
    /// By number.
    pub topics: Vec<LogTopic>,
    /// What is wrong with the log, a sentence each; empty for a sound one.
    pub problems: Vec<String>,
    /// How many of the segments opening has read and checked; the rest is believed until it is read.
    pub verified: u64,
    /// Where there is no message for a long time, ascending.
    pub gaps: Vec<Gap>,
    /// The header's profile: `ocu`, `ros2`, ….
    pub profile: String,
    /// The header's library: who wrote the log.
    pub library: String,
}

impl LogInfo {
    /// The topic of that number.
    pub fn topic(&self, id: TopicId) -> Option<&LogTopic> {
        self.topics.binary_search_by_key(&id, |topic| topic.id).ok().map(|index| &self.topics[index])
    }

    /// All topics of that name.
    pub fn topics_named<'a>(&'a self, name: &'a str) -> impl Iterator<Item = &'a LogTopic> {
        self.topics.iter().filter(move |topic| topic.name == name)
    }

    /// From the first message to the last, in seconds.
    pub fn duration_s(&self) -> f64 {
        self.end.seconds_since(self.start)
    }
}

/// A place in the total order of a log's messages: log time, then position in the file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct MessagePosition {
    /// The message's log time (within its chunk's stated times).
    pub time: Stamp,
    /// Number of the segment, in file order.
    pub(crate) segment: u32,
    /// One more than the message's offset in its segment, so that 0 lies before every message.
    pub(crate) offset: u32,
}

impl MessagePosition {
    /// Before every message of that time.
    pub const fn before(time: Stamp) -> Self {
        Self { time, segment: 0, offset: 0 }
    }

    /// After every message of that time.
    pub const fn after(time: Stamp) -> Self {
        Self { time, segment: u32::MAX, offset: u32::MAX }
    }
}

/// One message of a log.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LogMessage {
    /// Its topic.
    pub topic: TopicId,
    /// The writer's number, 0 where it gives none.
    pub sequence: u32,
    /// When it was logged: what orders a log.
    pub log_time: Stamp,
    /// When it was published.
    pub publish_time: Stamp,
    /// The message, in its schema's encoding.
    pub data: Bytes,
    /// Where it stands in the log: for stepping on and back.
    pub place: MessagePosition,
}

/// An attachment as the log lists it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AttachmentInfo {
    /// Name: `stack.toml`.
    pub name: String,
    /// Media type: `text/plain`.
    pub media_type: String,
    /// When it was logged.
    pub log_time: Stamp,
    /// When it was made.
    pub create_time: Stamp,
    /// Size in bytes.
    pub size: u64,
    /// Where its record begins in the file.
    pub(crate) offset: u64,
    /// Length of the record's body.
    pub(crate) body: u64,
}

/// An attachment with its contents.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Attachment {
    /// What the log lists.
    pub info: AttachmentInfo,
    /// The contents.
    pub data: Bytes,
}

/// A named set of keys and values.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Metadata {
    /// Name: `ocu`, `rosbag2`.
    pub name: String,
    /// What it says.
    pub entries: BTreeMap<String, String>,
}
