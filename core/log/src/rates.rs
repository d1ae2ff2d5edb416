//! Mean rates of the topics of a log.
//!
//! The rate of a topic is the number of intervals between its messages by the time from the first to the last one. These
//! times are in the message indexes of the first and the last segments that have the topic.
//!
//! A recording that begins in the middle of a run opens with what held at that moment, as messages with times from all of
//! the run before. The rates of its topics are those after that moment ([`LogInfo::complete_from`]).

use crate::indexed::indexed;
use crate::info::{Counted, LogInfo};
use crate::parts::Parts;
use crate::segment::{MessageRef, Segment, decode};
use crate::source::Source;
use rcs_msg::Stamp;
use std::collections::{BTreeMap, BTreeSet};

/// Greatest number of segments that are read: to count the messages with which a recording opens, and for times where
/// there is no index.
const MOST_READ: usize = 64;
/// Greatest number of segments whose times are looked up.
const MOST_LOOKED_UP: usize = 1024;

/// The description of a log with the rates of its topics. `order` is the order of the segments by their first and by their
/// last times.
pub(crate) fn with_rates(
    mut info: LogInfo,
    source: &Source,
    segments: &[Segment],
    order: [&[u32]; 2],
    parts: &Parts,
) -> LogInfo {
    let from = info.complete_from.filter(|from| *from > info.start);
    let mut reader = Reader { source, segments, parts, since: 0, left_to_look_up: 0, left_to_read: 0 };
    let opening = from.map(|from| reader.opening(from)).unwrap_or_default();
    let begin = from.unwrap_or(info.start);
    let after = info.gaps.iter().filter(|gap| gap.to > begin);
    let silent_ns =
        after.fold(0u64, |sum, gap| sum.saturating_add(gap.to.0.saturating_sub(gap.from.max(begin).0)));
    info.recorded_s = info.end.0.saturating_sub(begin.0).saturating_sub(silent_ns) as f64 * 1e-9;
    for topic in &mut info.topics {
        let opened_with = opening.get(&topic.id.0).copied().unwrap_or(0);
        topic.counted.messages = topic.messages.saturating_sub(opened_with);
    }
    let counted = info.topics.iter().filter(|topic| topic.counted.messages > 0);
    let counted: BTreeSet<u16> = counted.map(|topic| topic.id.0).collect();
    reader.since = from.map_or(0, |from| from.after_ns(1).0);
    let [by_first, by_last] = order;
    let first = reader.ends(by_first.iter(), counted.clone(), |segment| segment.first, u64::min);
    let last = reader.ends(by_last.iter().rev(), counted, |segment| segment.last, u64::max);
    for topic in info.topics.iter_mut().filter(|topic| topic.counted.messages > 0) {
        // Where the times are not known, the messages are taken to be spread over the log.
        let first = first.get(&topic.id.0).map_or(begin, |time| Stamp(*time));
        let last = last.get(&topic.id.0).map_or(info.end, |time| Stamp(*time));
        topic.counted = Counted { first, last, ..topic.counted };
    }
    let rates: Vec<f64> = info.topics.iter().map(|topic| info.mean_hz(&[topic.id]).unwrap_or(0.0)).collect();
    for (topic, hz) in info.topics.iter_mut().zip(rates) {
        topic.hz = hz;
    }
    info
}

/// Looks up times in segments, within limits.
struct Reader<'a> {
    source: &'a Source,
    segments: &'a [Segment],
    parts: &'a Parts,
    /// Messages before this time do not count.
    since: u64,
    left_to_look_up: usize,
    left_to_read: usize,
}

impl Reader<'_> {
    /// Numbers of the messages up to `from`, by channel.
    fn opening(&self, from: Stamp) -> BTreeMap<u16, u64> {
        let mut opening: BTreeMap<u16, u64> = BTreeMap::new();
        for segment in self.segments.iter().filter(|segment| segment.first <= from.0).take(MOST_READ) {
            for message in self.read(segment).iter().filter(|message| message.time <= from.0) {
                *opening.entry(message.channel).or_insert(0) += 1;
            }
        }
        opening
    }

    /// The earliest or latest time of each of `open`, whichever `pick` chooses, from the segments in `order`: the further
    /// ones have no earlier or later times than `reach` says.
    fn ends<'b>(
        &mut self,
        order: impl Iterator<Item = &'b u32>,
        mut open: BTreeSet<u16>,
        reach: fn(&Segment) -> u64,
        pick: fn(u64, u64) -> u64,
    ) -> BTreeMap<u16, u64> {
        (self.left_to_look_up, self.left_to_read) = (MOST_LOOKED_UP, MOST_READ);
        let mut ends: BTreeMap<u16, u64> = BTreeMap::new();
        let segments = self.segments;
        for &index in order {
            let segment = &segments[index as usize];
            open.retain(|channel| ends.get(channel).is_none_or(|&end| pick(end, reach(segment)) != end));
            if open.is_empty() {
                break;
            }
            if segment.last < self.since || !open.iter().any(|&channel| segment.may_hold(channel)) {
                continue;
            }
            for message in self.look_up(segment, &open) {
                if message.time >= self.since && open.contains(&message.channel) {
                    let end = ends.entry(message.channel).or_insert(message.time);
                    *end = pick(*end, message.time);
                }
            }
        }
        ends
    }

    /// The messages of a segment in these channels, and maybe in others; none where too much has been read.
    fn look_up(&mut self, segment: &Segment, channels: &BTreeSet<u16>) -> Vec<MessageRef> {
        if self.left_to_look_up == 0 {
            return Vec::new();
        }
        self.left_to_look_up -= 1;
        let wants = |channel| channels.contains(&channel);
        if let Ok(Some(found)) = indexed(self.source, self.parts, segment, wants) {
            return found;
        }
        if self.left_to_read == 0 {
            return Vec::new();
        }
        self.left_to_read -= 1;
        self.read(segment)
    }

    /// The messages of a segment. What cannot be read is reported when it is read for its messages.
    fn read(&self, segment: &Segment) -> Vec<MessageRef> {
        let Ok(mut decoded) = decode(self.source, segment) else { return Vec::new() };
        self.parts.map_channels(segment, &mut decoded.messages);
        for message in &mut decoded.messages {
            message.time = message.time.clamp(segment.first, segment.last);
        }
        decoded.messages
    }
}
