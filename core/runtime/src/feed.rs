//! Feeds the messages of a log into a stack: converted to canonical types, in the order of the log.

use crate::conversion::{COMPRESSED, RAW, acquisition_time, canonical};
use crate::error::RunError;
use crate::history::LogRef;
use crate::machine::Machine;
use rcs_bus::{Draft, Header, Writer, WriterId};
use rcs_log::{Cursor, CursorOptions, Gap, Log, LogMessage, Position, Reassembly, TopicId};
use rcs_msg::foxglove::{CompressedImage, FrameTransforms};
use rcs_msg::{AnyMessage, Stamp};
use std::collections::{BTreeMap, BTreeSet};

/// Reads the topics of a stack's inputs and writes their messages into its buffers.
pub(crate) struct Feed {
    log: Log,
    cursor: Cursor,
    pending: Option<LogMessage>,
    /// Position of the cursor before `pending`.
    position: Position,
    /// Writers for each topic, and whether they need decoded images.
    writers: BTreeMap<TopicId, Vec<(Writer, bool)>>,
    /// Reassembles messages that were stored as key frames and deltas.
    reassembly: Reassembly,
    /// Whether the reassembly must be moved to the position of the cursor.
    is_behind: bool,
    /// Start and end of the log.
    pub(crate) range: (Stamp, Stamp),
    /// Long periods without messages.
    gaps: Vec<Gap>,
    fixed: Vec<LogMessage>,
    /// The last message that was fed.
    given: Option<LogRef>,
}

/// A message may be farther ahead of the log's clock than the one before it by this much, s.
const MOST_AHEAD_S: f64 = 1.0;

/// A message that could not be fed into the stack.
pub(crate) struct FeedFault {
    pub(crate) time: Stamp,
    pub(crate) text: String,
}

impl Feed {
    pub(crate) fn new(log: &Log, machine: &Machine) -> Result<Self, RunError> {
        let info = log.info();
        let missing = machine.plan.check_log(info);
        if !missing.is_empty() {
            return Err(RunError::Inputs(missing));
        }
        let mut writers: BTreeMap<TopicId, Vec<(Writer, bool)>> = BTreeMap::new();
        let mut fixed_topics = Vec::new();
        let mut moving_topics = Vec::new();
        let reassembly = Reassembly::new(log);
        for input in &machine.plan.inputs {
            for topic in info.topics_named(&input.topic) {
                let buffer = &machine.buffers[input.buffer];
                let decoded = buffer.spec().schema.name() == RAW
                    && rcs_msg::canonical_name(&topic.schema) == Some(COMPRESSED);
                writers.entry(topic.id).or_default().push((buffer.writer(WriterId::RUNTIME), decoded));
                let topics = if input.is_static { &mut fixed_topics } else { &mut moving_topics };
                topics.push(topic.id);
                topics.extend(reassembly.deltas_of(topic.id));
            }
        }
        let mut fixed = Vec::new();
        if !fixed_topics.is_empty() {
            let options = CursorOptions { topics: Some(fixed_topics), ..CursorOptions::default() };
            for message in log.cursor(options) {
                fixed.push(message?);
            }
        }
        let options = CursorOptions { topics: Some(moving_topics), ..CursorOptions::default() };
        let cursor = log.cursor(options).reading_ahead();
        let position = cursor.position();
        let (range, gaps) = ((info.start, info.end), info.gaps.clone());
        let (log, pending, is_behind, given) = (log.clone(), None, false, None);
        Ok(Self { log, cursor, pending, position, writers, reassembly, is_behind, range, gaps, fixed, given })
    }

    /// Time at which a cycle that is due at `time` runs. If `time` is within a gap of the log, more than `slack_ns`
    /// after the last message, the cycle is moved to the process's next due time after the gap: cycles in a gap would
    /// do nothing, and a gap may last decades.
    pub(crate) fn after_gap(&self, time: Stamp, period_ns: u64, slack_ns: u64) -> Stamp {
        let is_in = |gap: &&Gap| time > gap.from.after_ns(slack_ns) && time < gap.to;
        let Some(gap) = self.gaps.iter().find(is_in) else { return time };
        let period_ns = period_ns.max(1);
        time.after_ns((gap.to.0 - time.0).div_ceil(period_ns).saturating_mul(period_ns))
    }

    /// Feeds the messages that are valid for the whole log. Static transforms are added to those that were fed before, so
    /// that the newest message of a buffer has all of them.
    pub(crate) fn give_fixed(&mut self, at: Stamp) -> Vec<FeedFault> {
        let fixed = std::mem::take(&mut self.fixed);
        fixed.iter().filter_map(|message| self.give(message, at, true).err()).collect()
    }

    /// Log time of the next message.
    pub(crate) fn next_time(&mut self) -> Result<Option<Stamp>, RunError> {
        if self.pending.is_none() {
            self.position = self.cursor.position();
            self.pending = self.cursor.next().transpose()?;
        }
        Ok(self.pending.as_ref().map(|message| message.log_time))
    }

    /// Feeds the next message into the stack.
    pub(crate) fn give_next(&mut self) -> Result<(), FeedFault> {
        let Some(message) = self.pending.take() else { return Ok(()) };
        // A message that was reassembled from several cannot be read again as one.
        let alone = !self.reassembly.takes(message.topic);
        self.given = alone.then_some(LogRef { topic: message.topic, place: message.place });
        if std::mem::take(&mut self.is_behind)
            && let Err(error) = self.reassembly.seek(self.position.place())
        {
            return Err(FeedFault { time: message.log_time, text: error.to_string() });
        }
        self.give(&message, message.log_time, false)
    }

    fn give(&mut self, message: &LogMessage, at: Stamp, is_fixed: bool) -> Result<(), FeedFault> {
        let fault = |text: String| FeedFault { time: at, text };
        let Some(topic) = self.log.info().topic(message.topic) else { return Ok(()) };
        let mut id = message.topic;
        let raw = if self.reassembly.takes(id) {
            // The log has reported messages that cannot be reassembled.
            let Some(whole) = self.reassembly.take(message) else { return Ok(()) };
            id = whole.topic;
            whole.message
        } else {
            AnyMessage::encoded(topic.schema.clone(), message.data.clone())
        };
        let Some(message_out) = canonical(&raw) else {
            return Err(fault(format!(
                "{}: message at {} does not decode as {}; skipped",
                topic.name,
                message.log_time,
                topic.schema.name()
            )));
        };
        // A stamp of exactly 0 counts as none; `acquisition_time` says why.
        let acq_time = acquisition_time(&message_out, message.publish_time, message.log_time);
        for (writer, decoded) in self.writers.get(&id).into_iter().flatten() {
            let newest = writer.buffer().latest();
            let fixed = newest.as_ref().filter(|_| is_fixed);
            let all = fixed.and_then(|fixed| joined(&fixed.message, &message_out));
            let before = newest.filter(|_| !is_fixed);
            check_time(before.map(|sample| sample.header), acq_time, at)
                .map_err(|why| fault(format!("{}: {why}; skipped", topic.name)))?;
            let message = match message_out.get::<CompressedImage>().filter(|_| *decoded) {
                Some(image) => AnyMessage::new(
                    rcs_msg::image::decompress(image)
                        .map_err(|error| fault(format!("{}: {error}; skipped", topic.name)))?,
                ),
                None => all.unwrap_or_else(|| message_out.clone()),
            };
            let draft = Draft { log_time: at, acq_time, message };
            writer.write(draft).map_err(|error| fault(error.to_string()))?;
        }
        Ok(())
    }

    /// The log that is read.
    pub(crate) fn log(&self) -> &Log {
        &self.log
    }

    /// The last message that was fed.
    pub(crate) fn given(&self) -> Option<LogRef> {
        self.given
    }

    /// Position of the feed.
    pub(crate) fn position(&self) -> Position {
        if self.pending.is_some() { self.position.clone() } else { self.cursor.position() }
    }

    /// Returns to an earlier position of the feed.
    pub(crate) fn restore(&mut self, position: Position) {
        self.cursor = self.log.cursor_at(position.clone()).reading_ahead();
        self.position = position;
        self.pending = None;
        self.is_behind = true;
    }
}

/// The transforms of a message with those of the one before it for the frames that it does not place; `None` if it places
/// all of them.
fn joined(before: &AnyMessage, message: &AnyMessage) -> Option<AnyMessage> {
    let (before, new) = (before.get::<FrameTransforms>()?, message.get::<FrameTransforms>()?);
    let placed: BTreeSet<&str> = new.transforms.iter().map(|new| new.child_frame_id.as_str()).collect();
    let others = before.transforms.iter().filter(|other| !placed.contains(other.child_frame_id.as_str()));
    let mut transforms: Vec<_> = others.cloned().collect();
    if transforms.is_empty() {
        return None;
    }
    transforms.extend_from_slice(&new.transforms);
    Some(AnyMessage::new(FrameTransforms { transforms }))
}

/// Refuses a message whose time lies farther ahead of the log's clock than that of the one before it. Taken for the
/// newest, it would look fresh, and all after it old, until the clock is there. A sensor whose clock is ahead of the log's
/// from the first message on is no fault.
fn check_time(before: Option<Header>, acq_time: Stamp, at: Stamp) -> Result<(), String> {
    let Some(before) = before else { return Ok(()) };
    let usual_s = before.acq_time.seconds_since(before.log_time).max(0.0);
    let ahead_s = acq_time.seconds_since(at);
    if ahead_s <= usual_s + MOST_AHEAD_S {
        return Ok(());
    }
    Err(format!(
        "message at {at} has a time {ahead_s:.3} s ahead of that, expected at most {:.3} s",
        usual_s + MOST_AHEAD_S
    ))
}
