//! Description of a log: topics, number of messages, losses.

use crate::gaps::Gap;
use bytes::Bytes;
use rcs_msg::{Schema, Stamp};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;

/// Key of the metadata record `ocu` of a recording that does not begin with its run, or of a part of a recording: the time
/// from which it is complete, ns.
pub const COMPLETE_FROM: &str = "from_ns";

/// A topic of one log: the number of its channel in the file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct TopicId(pub u16);

/// What could not be read.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Lost {
    /// Bytes whose content was not recovered: skipped bytes of the file, and in damaged or truncated chunks the
    /// unrecovered bytes of their uncompressed contents.
    pub bytes: u64,
    /// Messages that are known to be lost: those that the statistics, or the message index after a damaged chunk, count
    /// and that were not found. A truncated chunk has no count, so its messages appear in `bytes` only.
    pub messages: u64,
}

impl std::ops::AddAssign for Lost {
    fn add_assign(&mut self, other: Self) {
        self.bytes = self.bytes.saturating_add(other.bytes);
        self.messages = self.messages.saturating_add(other.messages);
    }
}

/// One channel of a log. Several channels can have the same name if publishers differ in schema or metadata.
#[derive(Clone, Debug)]
pub struct LogTopic {
    /// The channel's number.
    pub id: TopicId,
    /// Name: `/wm1/map`.
    pub name: String,
    /// Type of its messages; a schema with an empty name if the log has none.
    pub schema: Arc<Schema>,
    /// Channel metadata: `rcs.role`, `offered_qos_profiles`, ….
    pub metadata: BTreeMap<String, String>,
    /// Number of readable messages.
    pub messages: u64,
    /// Mean rate ([`LogInfo::mean_hz`]); 0 where there is none.
    pub hz: f64,
    /// Whether a reader exists for the schema.
    pub decodable: bool,
    /// Why not, if there is none.
    pub undecodable_because: Option<String>,
    /// The messages that count for its rate.
    pub(crate) counted: Counted,
}

/// The messages of topics that count for a rate.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Counted {
    pub(crate) messages: u64,
    /// Times of the first and of the last one; reversed if there is none.
    pub(crate) first: Stamp,
    pub(crate) last: Stamp,
}

impl Counted {
    pub(crate) const NONE: Self = Self { messages: 0, first: Stamp::MAX, last: Stamp(0) };

    fn join(self, other: Self) -> Self {
        Self {
            messages: self.messages.saturating_add(other.messages),
            first: self.first.min(other.first),
            last: self.last.max(other.last),
        }
    }
}

/// Description of a log, known after opening it.
#[derive(Clone, Debug)]
pub struct LogInfo {
    /// Path of the file, or of the first of several; empty for a log in memory.
    pub path: PathBuf,
    /// Paths of all files.
    pub files: Vec<PathBuf>,
    /// Size of the file in bytes.
    pub bytes: u64,
    /// Log time of the first message; 0 if there are no messages.
    pub start: Stamp,
    /// Log time of the last message; 0 if there are no messages.
    pub end: Stamp,
    /// Number of readable messages.
    pub messages: u64,
    /// Number of segments: chunks, and runs of messages outside of chunks.
    pub segments: u64,
    /// Whether the log has no usable summary and was opened by a scan of its records.
    pub recovered: bool,
    /// Losses known after opening; [`Log::lost`](crate::Log::lost) includes those found later.
    pub lost: Lost,
    /// Sorted by number.
    pub topics: Vec<LogTopic>,
    /// Problems of the log, one sentence each; empty for a sound log.
    pub problems: Vec<String>,
    /// Number of segments that were read and checked at opening; the others are checked when they are read.
    pub verified: u64,
    /// Long periods without a message, ascending.
    pub gaps: Vec<Gap>,
    /// The header's profile: `ocu`, `ros2`, ….
    pub profile: String,
    /// The header's library: the program that wrote the log.
    pub library: String,
    /// The time from which a recording is complete, as its metadata says ([`COMPLETE_FROM`]); before it are only the
    /// messages that held then. The rates of its topics are those after that time. `None` for a log that says nothing.
    pub complete_from: Option<Stamp>,
    /// Duration without gaps, from [`LogInfo::complete_from`] on, s.
    pub(crate) recorded_s: f64,
}

impl LogInfo {
    /// The topic with this number.
    pub fn topic(&self, id: TopicId) -> Option<&LogTopic> {
        self.topics.binary_search_by_key(&id, |topic| topic.id).ok().map(|index| &self.topics[index])
    }

    /// All topics with this name.
    pub fn topics_named<'a>(&'a self, name: &'a str) -> impl Iterator<Item = &'a LogTopic> {
        self.topics.iter().filter(move |topic| topic.name == name)
    }

    /// Mean rate of the messages of these topics together: the number of intervals between them by the time from the
    /// first to the last one, without gaps. `None` for fewer than two messages, or if all have one time.
    pub fn mean_hz(&self, topics: &[TopicId]) -> Option<f64> {
        let Counted { messages, first, last } = self.counted(topics);
        if messages < 2 {
            return None;
        }
        let inside = self.gaps.iter().filter(|gap| gap.from >= first && gap.to <= last);
        let silent_ns = inside.fold(0u64, |sum, gap| sum.saturating_add(gap.to.0 - gap.from.0));
        let span_ns = last.0.saturating_sub(first.0).saturating_sub(silent_ns);
        (span_ns > 0).then(|| (messages - 1) as f64 / (span_ns as f64 * 1e-9))
    }

    /// Messages of these topics per second of the log without its gaps, which is low for what is sent only at times.
    /// `None` for fewer than two messages or no duration.
    pub fn density_hz(&self, topics: &[TopicId]) -> Option<f64> {
        let messages = self.counted(topics).messages;
        (messages > 1 && self.recorded_s > 0.0).then(|| messages as f64 / self.recorded_s)
    }

    fn counted(&self, topics: &[TopicId]) -> Counted {
        let topics = topics.iter().filter_map(|id| self.topic(*id));
        topics.fold(Counted::NONE, |all, topic| all.join(topic.counted))
    }

    /// Time from the first message to the last, in seconds.
    pub fn duration_s(&self) -> f64 {
        self.end.seconds_since(self.start)
    }
}

/// A position in the total order of a log's messages: log time, then position in the file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct MessagePosition {
    /// The message's log time (within its chunk's stated times).
    pub time: Stamp,
    /// Number of the segment, in file order.
    pub(crate) segment: u32,
    /// One more than the message's offset in its segment, so that 0 is before every message.
    pub(crate) offset: u32,
}

impl MessagePosition {
    /// Before every message with this time.
    pub const fn before(time: Stamp) -> Self {
        Self { time, segment: 0, offset: 0 }
    }

    /// After every message with this time.
    pub const fn after(time: Stamp) -> Self {
        Self { time, segment: u32::MAX, offset: u32::MAX }
    }
}

/// One message of a log.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LogMessage {
    /// Its topic.
    pub topic: TopicId,
    /// The sequence number that the writer gave it, 0 if none.
    pub sequence: u32,
    /// Log time, by which the log is ordered.
    pub log_time: Stamp,
    /// When it was published.
    pub publish_time: Stamp,
    /// The message, in its schema's encoding.
    pub data: Bytes,
    /// Its position in the log, for stepping forward and back.
    pub place: MessagePosition,
}

/// An attachment without its contents.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AttachmentInfo {
    /// Name: `stack.toml`.
    pub name: String,
    /// Media type: `text/plain`.
    pub media_type: String,
    /// When it was logged.
    pub log_time: Stamp,
    /// When it was created.
    pub create_time: Stamp,
    /// Size in bytes.
    pub size: u64,
    /// Offset of its record in the file.
    pub(crate) offset: u64,
    /// Length of the body of the record.
    pub(crate) body: u64,
}

/// An attachment with its contents.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Attachment {
    /// The attachment's entry.
    pub info: AttachmentInfo,
    /// The contents.
    pub data: Bytes,
}

/// A named set of keys and values.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Metadata {
    /// Name: `ocu`, `rosbag2`.
    pub name: String,
    /// The entries.
    pub entries: BTreeMap<String, String>,
}
