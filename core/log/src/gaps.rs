//! Gaps: long periods without a message. A clock that is set after the start can cause gaps of decades.

use crate::error::LogError;
use crate::segment::{Segment, decode};
use crate::source::Source;
use rcs_msg::Stamp;

/// Least length of a gap.
const GAP_NS: u64 = 600_000_000_000;
/// Greatest number of gaps reported.
const MOST: usize = 64;
/// Greatest number of segments that are read to find gaps within them.
const MOST_READ: usize = 64;

/// A period without messages.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Gap {
    /// Log time of the last message before.
    pub from: Stamp,
    /// Log time of the first message after.
    pub to: Stamp,
}

impl Gap {
    /// Its length in seconds.
    pub fn duration_s(&self) -> f64 {
        self.to.seconds_since(self.from)
    }
}

/// The gaps of a log, ascending; if there are very many, the longest ones.
pub(crate) fn gaps(source: &Source, segments: &[Segment]) -> Result<Vec<Gap>, LogError> {
    let mut spans = Vec::with_capacity(segments.len());
    let mut read = 0;
    for segment in segments.iter().filter(|it| it.channels.as_ref().is_none_or(|held| !held.is_empty())) {
        if segment.last - segment.first <= GAP_NS || read == MOST_READ {
            spans.push((segment.first, segment.last));
            continue;
        }
        read += 1;
        let mut times: Vec<u64> =
            decode(source, segment)?.messages.iter().map(|message| message.time).collect();
        times.sort_unstable();
        // First and last times of a segment without a message at that time come from a message elsewhere in the order.
        spans.extend(
            times.iter().map(|&time| time.clamp(segment.first, segment.last)).map(|time| (time, time)),
        );
    }
    spans.sort_unstable();
    let mut gaps = Vec::new();
    let mut covered = spans.first().map_or(0, |span| span.0);
    for (first, last) in spans {
        if first > covered && first - covered > GAP_NS {
            gaps.push(Gap { from: Stamp(covered), to: Stamp(first) });
        }
        covered = covered.max(last);
    }
    if gaps.len() > MOST {
        gaps.sort_by_key(|gap| std::cmp::Reverse(gap.to.0 - gap.from.0));
        gaps.truncate(MOST);
        gaps.sort_by_key(|gap| gap.from);
    }
    Ok(gaps)
}
