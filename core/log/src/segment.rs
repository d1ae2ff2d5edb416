//! Segments: reads the messages of a chunk, or of a run of records outside of chunks.
//!
//! A log is a list of segments in file order. From a damaged segment, the parts that still parse are read and the
//! losses are reported; every reading gives the same result.

use crate::error::LogError;
use crate::record::{ChunkHead, HEAD, Head, MESSAGE_HEAD, MessageHead, PROBE, index_entries, op};
use crate::source::{Source, Stream};
use bytes::Bytes;
use std::io::Read;
use std::sync::OnceLock;

/// Greatest size of contents that are read, so that memory stays bounded.
pub(crate) const SEGMENT_LIMIT: u64 = 192 << 20;
/// Larger compressed data are decompressed in pieces, without holding them in memory.
const PIECEWISE_FROM: u64 = 16 << 20;
/// Contents that are larger than their chunk states are read up to this size, because the stated size may be damaged.
const WRONG_SIZE_LIMIT: usize = 64 << 20;
/// Greatest size of message indexes that are read as a whole.
pub(crate) const INDEX_LIMIT: u64 = 1 << 20;

/// Position and content of a segment.
#[derive(Clone, Debug)]
pub(crate) struct Segment {
    /// First byte of the chunk's record, or of the run.
    pub(crate) start: u64,
    /// Size in the file, bytes.
    pub(crate) length: u64,
    /// Whether it is a chunk.
    pub(crate) chunk: bool,
    /// Earliest and latest log time of its messages.
    pub(crate) first: u64,
    pub(crate) last: u64,
    /// Channels of its messages, ascending; `None` if the log does not say.
    pub(crate) channels: Option<Box<[u16]>>,
    /// Channels of its messages, ascending, where the log does not say: known once it has been read.
    pub(crate) found: OnceLock<Box<[u16]>>,
    /// Size of the contents according to the log.
    pub(crate) contents: u64,
}

impl Segment {
    pub(crate) fn end(&self) -> u64 {
        self.start + self.length
    }

    /// Whether it may have a message of that channel.
    pub(crate) fn may_hold(&self, channel: u16) -> bool {
        let channels = self.channels.as_ref().or_else(|| self.found.get());
        channels.is_none_or(|channels| channels.binary_search(&channel).is_ok())
    }

    /// Greatest amount of memory that reading it may take.
    pub(crate) fn weight(&self) -> usize {
        self.contents.min(SEGMENT_LIMIT) as usize
    }
}

/// A message within its segment's contents.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct MessageRef {
    pub(crate) time: u64,
    /// Offset of the record in the contents.
    pub(crate) offset: u32,
    pub(crate) channel: u16,
}

/// A segment's contents with the records found in them.
#[derive(Debug, Default)]
pub(crate) struct Decoded {
    pub(crate) contents: Bytes,
    /// In file order.
    pub(crate) messages: Vec<MessageRef>,
    /// Offsets of schema and channel records.
    pub(crate) definitions: Vec<u32>,
    pub(crate) damage: Option<Damage>,
}

/// Problems of a segment.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Damage {
    /// Bytes of the contents that were not recovered.
    pub(crate) lost_bytes: u64,
    /// Messages that were found but are not reliable.
    pub(crate) lost_messages: u64,
    pub(crate) what: String,
}

impl Damage {
    pub(crate) fn new(lost_bytes: u64, what: impl Into<String>) -> Self {
        Self { lost_bytes, lost_messages: 0, what: what.into() }
    }
}

impl Decoded {
    /// The body of the record at `offset`, which was found before.
    pub(crate) fn record(&self, offset: u32) -> Option<(Head, Bytes)> {
        let from = offset as usize;
        let head = Head::read(self.contents.get(from..)?)?;
        let to = usize::try_from(head.length()).ok()?.checked_add(from)?;
        (to <= self.contents.len()).then(|| (head, self.contents.slice(from + HEAD..to)))
    }
}

/// Reads a segment. Damage is part of the result; only a failed read of the source is an error.
pub(crate) fn decode(source: &Source, segment: &Segment) -> Result<Decoded, LogError> {
    if segment.chunk { decode_chunk(source, segment) } else { decode_run(source, segment) }
}

fn decode_run(source: &Source, segment: &Segment) -> Result<Decoded, LogError> {
    if segment.length > SEGMENT_LIMIT {
        return Ok(too_large(segment.length));
    }
    let contents = source.read(segment.start, segment.length as usize)?;
    let walk = walk(&contents, None);
    let damage = (walk.lost_bytes > 0)
        .then(|| Damage::new(walk.lost_bytes, "records outside chunks that do not parse"));
    Ok(Decoded { contents, messages: walk.messages, definitions: walk.definitions, damage })
}

fn too_large(size: u64) -> Decoded {
    let what = format!("contents of {size} bytes are more than the limit of {SEGMENT_LIMIT}");
    lost(size, what)
}

fn lost(lost_bytes: u64, what: String) -> Decoded {
    Decoded { damage: Some(Damage::new(lost_bytes, what)), ..Decoded::default() }
}

fn decode_chunk(source: &Source, segment: &Segment) -> Result<Decoded, LogError> {
    let front = source.read(segment.start, segment.length.min(PROBE as u64) as usize)?;
    let body = front.get(HEAD..).unwrap_or_default();
    let (Some(outer), Some(chunk)) = (Head::read(&front), ChunkHead::read(body)) else {
        return Ok(lost(segment.length, "a chunk whose header does not parse".to_owned()));
    };
    if outer.op != op::CHUNK && !chunk.fills(outer.body) {
        return Ok(lost(
            segment.length,
            format!("expected a chunk, got a record of opcode {:#04x}", outer.op),
        ));
    }
    let data_start = segment.start + (HEAD + chunk.front) as u64;
    let data_end = data_start.saturating_add(chunk.compressed).min(segment.end()).max(data_start);
    let whole = data_end - data_start == chunk.compressed;
    // A chunk that was never closed states sizes of all ones; its bytes are read up to the limit.
    let unclosed = chunk.uncompressed == u64::MAX || chunk.compressed == u64::MAX;
    if chunk.uncompressed > SEGMENT_LIMIT && !unclosed && whole {
        return Ok(too_large(chunk.uncompressed));
    }
    let expected = chunk.uncompressed.min(SEGMENT_LIMIT);
    let unpacked = unpack(source, &chunk, data_start, data_end, expected as usize)?;

    let mut reasons = Vec::new();
    if outer.op != op::CHUNK {
        reasons.push(format!("expected opcode {:#04x}, got {:#04x}", op::CHUNK, outer.op));
    }
    if !whole {
        reasons.push(
            if unclosed { "a chunk that was never closed" } else { "a chunk that is cut off" }.to_owned(),
        );
    }
    if let Some(problem) = unpacked.problem {
        reasons.push(problem);
    } else if whole && !unclosed && unpacked.contents.len() as u64 != chunk.uncompressed {
        reasons.push(format!(
            "expected {} bytes of contents, got {}",
            chunk.uncompressed,
            unpacked.contents.len()
        ));
    }
    let contents = unpacked.contents;
    // Whether the contents are known to be as written.
    let mut proved = false;
    if chunk.crc != 0 && whole {
        let got = crc32fast::hash(&contents);
        proved = got == chunk.crc;
        if reasons.is_empty() && !proved {
            reasons.push(format!("expected checksum {:08x}, got {got:08x}", chunk.crc));
        }
    }
    let mut found = if reasons.is_empty() || proved { walk(&contents, None) } else { Walk::default() };
    if reasons.is_empty() && found.lost_bytes > 0 {
        reasons.push("records that do not parse".to_owned());
        proved = false;
    }
    if reasons.is_empty() || proved {
        // If anything is damaged, it is the chunk's header.
        let mut damage = (!reasons.is_empty()).then(|| Damage::new(0, reasons.join("; ")));
        if !proved {
            damage = leave_out_misplaced(source, segment, &chunk, &contents, &mut found.messages)?;
        }
        let Walk { messages, definitions, .. } = found;
        return Ok(Decoded { contents, messages, definitions, damage });
    }
    found = walk(&contents, Some(chunk.times().unwrap_or((0, u64::MAX))));
    let missing = if unclosed { 0 } else { expected.saturating_sub(contents.len() as u64) };
    let damage = Damage::new(found.lost_bytes + missing, reasons.join("; "));
    Ok(Decoded { contents, messages: found.messages, definitions: found.definitions, damage: Some(damage) })
}

/// Removes the messages whose time is outside of the times that their chunk states, and reports the damage.
///
/// To be called if no checksum confirms the contents. Then one of the two is wrong: the chunk's times, if most messages
/// contradict them and no message index confirms them; else the messages. Some writers treat a time of 0 as absent when
/// they state a chunk's times: such a message is not damaged.
fn leave_out_misplaced(
    source: &Source,
    segment: &Segment,
    chunk: &ChunkHead,
    contents: &Bytes,
    messages: &mut Vec<MessageRef>,
) -> Result<Option<Damage>, LogError> {
    let Some((first, last)) = chunk.times() else { return Ok(None) };
    let is_misplaced = |message: &MessageRef| message.time != 0 && !(first..=last).contains(&message.time);
    let misplaced = messages.iter().filter(|message| is_misplaced(message)).count();
    if misplaced == 0 {
        return Ok(None);
    }
    let confirmed = misplaced * 2 < messages.len()
        || indexed_times(source, segment.end())?.is_some_and(|(a, b)| first <= a && b <= last);
    if !confirmed {
        let what = format!("the chunk states times that {misplaced} of its messages contradict");
        return Ok(Some(Damage::new(0, what)));
    }
    let size =
        |message: &MessageRef| Head::read(&contents[message.offset as usize..]).map_or(0, Head::length);
    let lost_bytes = messages.iter().filter(|message| is_misplaced(message)).map(size).sum();
    messages.retain(|message| !is_misplaced(message));
    let what = format!("{misplaced} messages with log times that are not within those of the chunk");
    Ok(Some(Damage { lost_bytes, lost_messages: misplaced as u64, what }))
}

/// The earliest and latest time in the message indexes from `at` on.
fn indexed_times(source: &Source, mut at: u64) -> Result<Option<(u64, u64)>, LogError> {
    let mut found: Option<(u64, u64)> = None;
    loop {
        let left = source.length().saturating_sub(at);
        let front = source.read(at, left.min(PROBE as u64) as usize)?;
        let Some(head) = Head::read(&front).filter(|head| head.op == op::MESSAGE_INDEX) else {
            return Ok(found);
        };
        if !head.plausible(&front[HEAD..]) || head.length() > left || head.body > INDEX_LIMIT {
            return Ok(found);
        }
        let body = source.read(at + HEAD as u64, head.body as usize)?;
        for (time, _) in index_entries(&body) {
            let (first, last) = found.unwrap_or((time, time));
            found = Some((first.min(time), last.max(time)));
        }
        at += head.length();
    }
}

/// The contents of a chunk, as far as they could be decompressed.
struct Unpacked {
    contents: Bytes,
    problem: Option<String>,
}

fn unpack(
    source: &Source,
    chunk: &ChunkHead,
    from: u64,
    to: u64,
    expected: usize,
) -> Result<Unpacked, LogError> {
    let available = to - from;
    if chunk.compression.is_empty() {
        // Uncompressed contents have the size of the data, whatever is stated.
        let length = available.min(SEGMENT_LIMIT) as usize;
        return Ok(Unpacked { contents: source.read(from, length)?, problem: None });
    }
    // A size that is implausible for the data must not decide the size of an allocation.
    let room = expected.min(usize::try_from(available.saturating_mul(64)).unwrap_or(usize::MAX).max(1 << 20));
    if chunk.compression == "zstd" && available <= PIECEWISE_FROM && room == expected {
        let compressed = source.read(from, available as usize)?;
        let mut contents = Vec::with_capacity(expected);
        if zstd::bulk::decompress_to_buffer(compressed.as_ref(), &mut contents).is_ok() {
            return Ok(Unpacked { contents: contents.into(), problem: None });
        }
    }
    let mut stream = Stream::new(source, from, to);
    let (contents, problem) = match chunk.compression.as_str() {
        "zstd" => match zstd::stream::read::Decoder::new(&mut stream) {
            Ok(decoder) => drain(decoder, room, expected),
            Err(error) => (Vec::new(), Some(error.to_string())),
        },
        "lz4" => match lz4::Decoder::new(&mut stream) {
            Ok(decoder) => drain(decoder, room, expected),
            Err(error) => (Vec::new(), Some(error.to_string())),
        },
        other => (Vec::new(), Some(format!("expected the compression zstd, lz4 or none, got `{other}`"))),
    };
    match stream.failure() {
        Some(error) => Err(error),
        None => Ok(Unpacked { contents: contents.into(), problem }),
    }
}

/// Reads until the end, the first error, or the limit; keeps what came before an error. Contents may be larger than
/// expected, because the expected size may be wrong.
fn drain(mut decoder: impl Read, room: usize, expected: usize) -> (Vec<u8>, Option<String>) {
    let limit = expected.max(WRONG_SIZE_LIMIT);
    let mut contents: Vec<u8> = Vec::with_capacity(room);
    let mut piece = vec![0; 1 << 16];
    loop {
        match decoder.read(&mut piece) {
            Ok(0) => return (contents, None),
            Ok(count) => {
                let left = limit - contents.len();
                if contents.capacity() - contents.len() < count {
                    // Growing by half of the size, not by all of it, limits the memory for the old and the new buffer
                    // together.
                    contents.reserve_exact((contents.len() / 2).max(1 << 16).min(left));
                }
                contents.extend_from_slice(&piece[..count.min(left)]);
                if count > left {
                    return (contents, Some(format!("expected {expected} bytes of contents, got more")));
                }
            }
            Err(error) if error.kind() == std::io::ErrorKind::Interrupted => {}
            Err(error) => return (contents, Some(format!("the compressed data are damaged: {error}"))),
        }
    }
}

/// The records found in contents.
#[derive(Default)]
struct Walk {
    messages: Vec<MessageRef>,
    definitions: Vec<u32>,
    lost_bytes: u64,
}

/// Finds the records of `contents`. With `times`, the contents are known to be damaged: then a record counts only if
/// its kind belongs there, a message's time lies within `times`, and a possible record follows.
fn walk(contents: &[u8], times: Option<(u64, u64)>) -> Walk {
    let mut found = Walk::default();
    let mut at = 0;
    while at < contents.len() {
        let Some(end) = record_end(contents, at, times) else {
            let next = resync(contents, at + 1, times);
            found.lost_bytes += (next - at) as u64;
            at = next;
            continue;
        };
        if times.is_some() && end < contents.len() && record_end(contents, end, times).is_none() {
            // Either this record's length is wrong or the next record is damaged. If a record begins before the end of
            // this one, the length was wrong.
            let next = resync(contents, at + HEAD, times);
            if next < end {
                found.lost_bytes += (next - at) as u64;
                at = next;
                continue;
            }
        }
        match contents[at] {
            op::MESSAGE => {
                if let Some(head) = MessageHead::read(&contents[at + HEAD..end]) {
                    let message =
                        MessageRef { time: head.log_time, offset: at as u32, channel: head.channel };
                    found.messages.push(message);
                }
            }
            op::SCHEMA | op::CHANNEL => found.definitions.push(at as u32),
            _ => {}
        }
        at = end;
    }
    found
}

/// The end of the record at `at`, if there is one.
fn record_end(contents: &[u8], at: usize, times: Option<(u64, u64)>) -> Option<usize> {
    let rest = &contents[at..];
    let head = Head::read(rest)?;
    let end = usize::try_from(head.length()).ok().filter(|&length| length <= rest.len())?;
    let body = &rest[HEAD..end];
    if !head.plausible(body) {
        return None;
    }
    if let Some((first, last)) = times {
        let belongs = match head.op {
            op::MESSAGE => MessageHead::read(body).is_some_and(|m| (first..=last).contains(&m.log_time)),
            op::SCHEMA | op::CHANNEL => true,
            other => other >= op::PRIVATE,
        };
        if !belongs {
            return None;
        }
    }
    Some(at + end)
}

/// The next position from `from` on where a schema, channel or message begins that another record or the end follows;
/// the end of the contents if there is none.
fn resync(contents: &[u8], from: usize, times: Option<(u64, u64)>) -> usize {
    let begins = |&at: &usize| {
        if !matches!(contents[at], op::SCHEMA | op::CHANNEL | op::MESSAGE) {
            return false;
        }
        record_end(contents, at, times)
            .is_some_and(|end| end == contents.len() || record_end(contents, end, times).is_some())
    };
    (from..contents.len()).find(begins).unwrap_or(contents.len())
}

/// Times, channels and counts of the messages of a decoded segment.
#[derive(Clone, Debug, Default)]
pub(crate) struct Tally {
    pub(crate) first: u64,
    pub(crate) last: u64,
    /// Channels and counts, ascending.
    pub(crate) counts: Vec<(u16, u64)>,
}

impl Tally {
    pub(crate) fn of(messages: &[MessageRef]) -> Self {
        let mut counts = std::collections::BTreeMap::new();
        let mut times: Option<(u64, u64)> = None;
        for message in messages {
            *counts.entry(message.channel).or_insert(0) += 1;
            let (first, last) = times.unwrap_or((message.time, message.time));
            times = Some((first.min(message.time), last.max(message.time)));
        }
        let (first, last) = times.unwrap_or_default();
        Self { first, last, counts: counts.into_iter().collect() }
    }
}

/// The data of a message within the body of its record.
pub(crate) fn message_data(body: &Bytes) -> Bytes {
    body.slice(MESSAGE_HEAD.min(body.len())..)
}
