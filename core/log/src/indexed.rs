//! The message indexes behind a segment.

use crate::error::LogError;
use crate::parts::Parts;
use crate::record::{HEAD, Head, PROBE, index_entries, indexed_messages, is_filled_by_index, op};
use crate::segment::{INDEX_LIMIT, MessageRef, Segment};
use crate::source::Source;

/// The messages of a segment in the channels for which `wants` holds, in order, by the index behind it: the segment itself
/// is not read. `None` if it has no index, or one that is damaged or too large.
pub(crate) fn indexed(
    source: &Source,
    parts: &Parts,
    segment: &Segment,
    wants: impl Fn(u16) -> bool,
) -> Result<Option<Vec<MessageRef>>, LogError> {
    if !segment.chunk {
        return Ok(None);
    }
    let channels = parts.channels(segment);
    let mut found = Vec::new();
    let (mut at, mut is_indexed) = (segment.end(), false);
    loop {
        let left = source.length().saturating_sub(at);
        if left == 0 {
            break;
        }
        let front = source.read(at, left.min(PROBE as u64) as usize)?;
        let body = front.get(HEAD..).unwrap_or_default();
        let head = Head::read(&front).filter(|head| head.plausible(body) && head.length() <= left);
        let Some(head) = head else { return Ok(None) };
        if head.op != op::MESSAGE_INDEX {
            // The indexes end here, unless this is one whose opcode is damaged.
            if is_filled_by_index(body, head.body) {
                return Ok(None);
            }
            break;
        }
        if head.body > INDEX_LIMIT {
            return Ok(None);
        }
        is_indexed = true;
        let channel = indexed_messages(body).map_or(0, |(channel, _)| channel);
        let channel = channels.map_or(Some(channel), |channels| channels.get(&channel).copied());
        if let Some(channel) = channel.filter(|channel| wants(*channel)) {
            let body = source.read(at + HEAD as u64, head.body as usize)?;
            for (time, offset) in index_entries(&body) {
                let time = time.clamp(segment.first, segment.last);
                let offset = u32::try_from(offset).unwrap_or(u32::MAX);
                found.push(MessageRef { time, offset, channel });
            }
        }
        at += head.length();
    }
    found.sort_unstable();
    Ok(is_indexed.then_some(found))
}
