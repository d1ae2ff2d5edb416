//! The second pass of a scan: decompresses and checks every chunk, and counts its messages.

use crate::catalog::Problems;
use crate::info::Lost;
use crate::record::{Head, first_index_entries, indexed_messages, op};
use crate::segment::{Damage, Decoded, INDEX_LIMIT, MessageRef, Tally, decode};
use crate::source::Source;
use crate::summary::Contents;
use bytes::Bytes;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

/// Chunks with larger contents are decompressed one at a time, so that memory stays bounded.
const LARGE_CHUNK: usize = 16 << 20;

/// The message indexes after a chunk.
#[derive(Default)]
pub(crate) struct Indexes {
    /// Number of messages that those directly after it count.
    pub(crate) count: u64,
    /// Those after damage. They may belong to a chunk that the damage has taken.
    pub(crate) doubtful: Vec<DoubtfulIndex>,
}

/// A message index of which it is not known to what chunk it belongs.
pub(crate) struct DoubtfulIndex {
    /// Offset and length of the body of its record.
    pub(crate) start: u64,
    pub(crate) body: u64,
    /// Number of messages that it counts.
    pub(crate) count: u64,
}

/// What the second pass keeps of a chunk.
struct Checked {
    tally: Tally,
    contents: u64,
    damage: Option<Damage>,
    /// Number of messages that its own indexes count, and that the indexes of a skipped chunk count.
    indexed: u64,
    skipped: u64,
}

/// A schema or channel in a chunk: whether that chunk is damaged, its number, and the body of its record.
type Definition = (bool, usize, Bytes);

/// Checks all chunks on all processors. `indexes` are the message indexes after a segment. Returns the channels that have
/// messages in sound segments.
pub(crate) fn check_chunks(
    source: &Source,
    contents: &mut Contents,
    indexes: &BTreeMap<usize, Indexes>,
    lost: &mut Lost,
) -> BTreeSet<u16> {
    let mut sound: BTreeSet<u16> = contents.counts.keys().copied().collect();
    let chunks: Vec<usize> =
        (0..contents.segments.len()).filter(|&index| contents.segments[index].chunk).collect();
    let next = AtomicUsize::new(0);
    let checked: Mutex<BTreeMap<usize, Checked>> = Mutex::default();
    let definitions: Mutex<BTreeMap<(u8, u16), Definition>> = Mutex::default();
    let large = Mutex::new(());
    let segments = &contents.segments;
    let work = || {
        while let Some(&index) = chunks.get(next.fetch_add(1, Ordering::Relaxed)) {
            let segment = &segments[index];
            let _one_at_a_time = (segment.weight() > LARGE_CHUNK)
                .then(|| large.lock().unwrap_or_else(PoisonError::into_inner));
            let decoded = decode(source, segment).unwrap_or_else(|error| Decoded {
                damage: Some(Damage::new(segment.length, error.to_string())),
                ..Decoded::default()
            });
            note_definitions(
                &decoded,
                index,
                &mut definitions.lock().unwrap_or_else(PoisonError::into_inner),
            );
            let tally = Tally::of(&decoded.messages);
            let size = decoded.contents.len() as u64;
            let (indexed, skipped) = indexed(source, indexes.get(&index), &decoded.messages);
            let result = Checked { tally, contents: size, damage: decoded.damage, indexed, skipped };
            checked.lock().unwrap_or_else(PoisonError::into_inner).insert(index, result);
        }
    };
    let threads = std::thread::available_parallelism().map_or(1, usize::from).min(8).min(chunks.len().max(1));
    std::thread::scope(|scope| {
        for _ in 1..threads {
            scope.spawn(work);
        }
        work();
    });

    take_definitions(definitions.into_inner().unwrap_or_else(PoisonError::into_inner), contents);
    for (index, checked) in checked.into_inner().unwrap_or_else(PoisonError::into_inner) {
        let segment = &mut contents.segments[index];
        let found: u64 = checked.tally.counts.iter().map(|&(_, count)| count).sum();
        (segment.first, segment.last) = (checked.tally.first, checked.tally.last);
        segment.channels = Some(checked.tally.counts.iter().map(|&(channel, _)| channel).collect());
        segment.contents = checked.contents;
        if checked.damage.is_none() {
            sound.extend(segment.channels.iter().flatten());
        }
        for (channel, count) in checked.tally.counts {
            *contents.counts.entry(channel).or_insert(0) += count;
        }
        lost.messages += checked.skipped;
        let mut missing = checked.indexed.saturating_sub(found);
        if let Some(damage) = checked.damage {
            missing = missing.max(damage.lost_messages);
            *lost += Lost { bytes: damage.lost_bytes, messages: missing };
            let (start, bytes) = (segment.start, damage.lost_bytes);
            contents.problems.add(format!(
                "chunk at byte {start}: {}; {found} messages salvaged, {missing} known to be lost, {bytes} bytes lost",
                damage.what
            ));
        } else if missing > 0 {
            let start = segment.start;
            contents
                .problems
                .add(format!("the index of the chunk at byte {start} counts {missing} messages too many"));
        }
    }
    sound
}

/// Number of messages that the indexes of a chunk count, and that the indexes after it of a skipped chunk count.
fn indexed(source: &Source, indexes: Option<&Indexes>, messages: &[MessageRef]) -> (u64, u64) {
    let Some(indexes) = indexes else { return (0, 0) };
    let (mut own, mut skipped) = (indexes.count, 0);
    for index in &indexes.doubtful {
        let front = source.read(index.start, index.body.min(INDEX_LIMIT) as usize);
        if front.is_ok_and(|front| is_index_of(&front, messages)) {
            own += index.count;
        } else {
            skipped += index.count;
        }
    }
    (own, skipped)
}

/// Whether a message index lists one of the messages, which are in file order, in this front of its body.
fn is_index_of(front: &[u8], messages: &[MessageRef]) -> bool {
    let Some((channel, _)) = indexed_messages(front) else { return false };
    first_index_entries(front).any(|(time, offset)| {
        let at = messages.binary_search_by_key(&offset, |message| u64::from(message.offset));
        at.is_ok_and(|at| messages[at].time == time && messages[at].channel == channel)
    })
}

/// Keeps each schema and channel once: the first one in a sound chunk, else the first in a damaged one.
fn note_definitions(decoded: &Decoded, index: usize, definitions: &mut BTreeMap<(u8, u16), Definition>) {
    let damaged = decoded.damage.is_some();
    for &offset in &decoded.definitions {
        let Some((head, body)) = decoded.record(offset) else { continue };
        let Some(&[low, high]) = body.get(..2) else { continue };
        let key = (head.op, u16::from_le_bytes([low, high]));
        let better =
            definitions.get(&key).is_none_or(|&(was_damaged, was, _)| (damaged, index) < (was_damaged, was));
        if better {
            // Copied, so that a few bytes do not keep the memory of a chunk.
            definitions.insert(key, (damaged, index, Bytes::copy_from_slice(&body)));
        }
    }
}

fn take_definitions(definitions: BTreeMap<(u8, u16), Definition>, contents: &mut Contents) {
    let mut problems = Problems::default();
    for ((op, id), (damaged, index, body)) in definitions {
        let known = match op {
            op::SCHEMA => contents.catalog.schemas.contains_key(&id),
            _ => contents.catalog.channels.contains_key(&id),
        };
        // A definition in a damaged chunk is not compared with the known one of its number.
        if known && damaged {
            continue;
        }
        let head = Head { op, body: body.len() as u64 };
        if let Err(problem) = contents.catalog.take(head, contents.segments[index].start, &body) {
            problems.add(problem);
        }
    }
    contents.problems.append(problems);
}

/// Messages of an undefined channel become a topic that cannot be decoded, if a sound segment has some. In damaged
/// segments such a channel number may be a flipped bit, and the messages are lost.
pub(crate) fn settle_undefined(contents: &mut Contents, lost: &mut Lost, sound: &BTreeSet<u16>) {
    let Contents { catalog, counts, problems, .. } = contents;
    counts.retain(|&id, &mut count| {
        if catalog.channels.contains_key(&id) {
            return true;
        }
        problems.add(format!("{count} messages are of channel {id}, which the log does not define"));
        if sound.contains(&id) {
            catalog.define(id);
            return true;
        }
        lost.messages += count;
        false
    });
}
