//! Mean rates of a recording that begins in the middle of a run.
//!
//! Such a recording opens with what held at that moment, as messages with times from all of the run before. The rates of
//! its topics are those after that moment ([`LogInfo::complete_from`]).

use crate::info::LogInfo;
use crate::parts::Parts;
use crate::segment::{Segment, decode};
use crate::source::Source;
use std::collections::BTreeMap;

/// Greatest number of segments that are read to count the messages with which a recording opens.
const MOST_READ: usize = 64;

/// The description of a log with the rates of the time after [`LogInfo::complete_from`], without gaps; unchanged where the
/// log begins then, or says no such time.
pub(crate) fn of_complete_part(
    mut info: LogInfo,
    source: &Source,
    segments: &[Segment],
    parts: &Parts,
) -> LogInfo {
    let Some(from) = info.complete_from.filter(|from| *from > info.start) else { return info };
    let after = info.gaps.iter().filter(|gap| gap.to > from);
    let silent_s: f64 = after.map(|gap| gap.to.seconds_since(gap.from.max(from))).sum();
    let recorded_s = info.end.seconds_since(from) - silent_s;
    let mut opening: BTreeMap<u16, u64> = BTreeMap::new();
    for segment in segments.iter().filter(|segment| segment.first <= from.0).take(MOST_READ) {
        // What cannot be read is reported when it is read for its messages.
        let Ok(mut decoded) = decode(source, segment) else { continue };
        parts.map_channels(segment, &mut decoded.messages);
        for message in decoded.messages.iter().filter(|message| message.time <= from.0) {
            *opening.entry(message.channel).or_insert(0) += 1;
        }
    }
    for topic in &mut info.topics {
        let opened_with = opening.get(&topic.id.0).copied().unwrap_or(0);
        let messages = topic.messages.saturating_sub(opened_with);
        topic.hz = if recorded_s > 0.0 && messages > 1 { messages as f64 / recorded_s } else { 0.0 };
    }
    info
}
