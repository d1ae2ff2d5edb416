//! Opens a log by index: the summary at the end of the file, if it exists, is sound and covers every message.

use crate::catalog::{ATTACHMENT_PROBE, BODY_LIMIT, Catalog, Problems};
use crate::error::LogError;
use crate::parse;
use crate::record::{Fields, HEAD, Head, MAGIC, PROBE, Section, indexed_messages, op};
use crate::segment::Segment;
use crate::source::{Source, Window};
use bytes::Bytes;
use mcap::records::{ChunkIndex, Statistics};
use std::collections::BTreeMap;
use std::sync::OnceLock;

/// Size of footer record and closing magic.
const TAIL: u64 = HEAD as u64 + 20 + 8;
/// A larger summary is not read.
const SUMMARY_LIMIT: u64 = 64 << 20;

const NO_FOOTER: &str = "the log ends without a footer: it was cut, or never finished";

/// A summary with a valid checksum.
#[derive(Debug, Default)]
pub(crate) struct Summary {
    pub(crate) catalog: Catalog,
    pub(crate) chunks: Vec<ChunkIndex>,
    /// Offset of its start, which is the end of the data.
    start: u64,
}

/// A log as described by its index or a scan.
#[derive(Debug, Default)]
pub(crate) struct Contents {
    pub(crate) catalog: Catalog,
    /// In file order.
    pub(crate) segments: Vec<Segment>,
    /// Messages by channel.
    pub(crate) counts: BTreeMap<u16, u64>,
    pub(crate) problems: Problems,
}

/// The summary; `Ok(Err(…))` says why there is no usable one.
pub(crate) fn read(source: &Source) -> Result<Result<Summary, String>, LogError> {
    let length = source.length();
    if length < TAIL + 8 {
        return Ok(Err(NO_FOOTER.to_owned()));
    }
    let tail = source.read(length - TAIL, TAIL as usize)?;
    let footer_body = &tail[HEAD..HEAD + 20];
    if &tail[HEAD + 20..] != MAGIC || Head::read(&tail) != Some(Head { op: op::FOOTER, body: 20 }) {
        return Ok(Err(NO_FOOTER.to_owned()));
    }
    let Some(footer) = parse::footer(footer_body) else {
        return Ok(Err("the footer does not parse".to_owned()));
    };
    let end = length - TAIL;
    let start = footer.summary_start;
    if start == 0 {
        return Ok(Err("the log has no summary".to_owned()));
    }
    if !(8..=end).contains(&start) || end - start > SUMMARY_LIMIT {
        return Ok(Err(format!(
            "the footer puts the summary at byte {start}, expected one between 8 and {end}"
        )));
    }
    let bytes = source.read(start, (end - start) as usize)?;
    if footer.summary_crc != 0 {
        // The checksum covers the summary, and the footer up to the checksum.
        let mut hasher = crc32fast::Hasher::new();
        hasher.update(&bytes);
        hasher.update(&tail[..HEAD + 16]);
        let got = hasher.finalize();
        if got != footer.summary_crc {
            return Ok(Err(format!(
                "the summary's checksum is {got:08x}, expected {:08x}",
                footer.summary_crc
            )));
        }
    }
    Ok(parse(&bytes, start))
}

fn parse(bytes: &Bytes, start: u64) -> Result<Summary, String> {
    let mut summary = Summary { start, ..Summary::default() };
    let mut at = 0;
    while at < bytes.len() {
        let offset = start + at as u64;
        let cut = || format!("the summary's record at byte {offset} does not parse");
        let head = Head::read(&bytes[at..]).ok_or_else(cut)?;
        let end = usize::try_from(head.length()).ok().and_then(|length| at.checked_add(length));
        let end = end.filter(|&end| end <= bytes.len()).ok_or_else(cut)?;
        let body = bytes.slice(at + HEAD..end);
        if head.op == op::CHUNK_INDEX {
            summary.chunks.push(parse::chunk_index(&body).ok_or_else(cut)?);
        } else {
            summary.catalog.take(head, offset, &body)?;
        }
        at = end;
    }
    summary.chunks.sort_by_key(|index| index.chunk_start_offset);
    Ok(summary)
}

/// The log that `summary` describes; `Ok(Err(…))` says why the summary does not cover all messages.
pub(crate) fn contents(source: &Source, summary: &Summary) -> Result<Result<Contents, String>, LogError> {
    let mut contents = Contents { catalog: summary.catalog.clone(), ..Contents::default() };
    let mut window = Window::new(source, 4096);
    let mut at = 8;
    for index in &summary.chunks {
        let start = index.chunk_start_offset;
        let end =
            start.checked_add(index.chunk_length).and_then(|end| end.checked_add(index.message_index_length));
        let Some(end) =
            end.filter(|&end| start >= at && end <= summary.start && index.chunk_length > HEAD as u64)
        else {
            return Ok(Err(format!("the index puts a chunk at byte {start} where none can be")));
        };
        if index.message_start_time > index.message_end_time {
            return Ok(Err(format!("the index of the chunk at byte {start} has its times reversed")));
        }
        if let Err(why) = between(&mut window, at, start, &mut contents)? {
            return Ok(Err(why));
        }
        let channels: Box<[u16]> = index.message_index_offsets.keys().copied().collect();
        contents.segments.push(Segment {
            start,
            length: index.chunk_length,
            chunk: true,
            first: index.message_start_time,
            last: index.message_end_time,
            channels: (index.message_index_length > 0 || index.uncompressed_size == 0).then_some(channels),
            found: OnceLock::new(),
            contents: index.uncompressed_size,
        });
        at = end;
    }
    if let Err(why) = between(&mut window, at, summary.start, &mut contents)? {
        return Ok(Err(why));
    }
    if let Some(statistics) = &contents.catalog.statistics {
        if u64::from(statistics.chunk_count) != contents.segments.len() as u64 {
            let (chunks, indexes) = (statistics.chunk_count, contents.segments.len());
            return Ok(Err(format!("the statistics count {chunks} chunks, the index {indexes}")));
        }
        if u64::from(statistics.channel_count) > contents.catalog.channels.len() as u64 {
            return Ok(Err("the summary does not repeat every channel".to_owned()));
        }
    }
    if let Err(why) = settle_counts(&mut window, summary, &mut contents)? {
        return Ok(Err(why));
    }
    let unknown = contents.segments.iter().flat_map(|segment| segment.channels.iter().flatten());
    let unknown =
        unknown.chain(contents.counts.keys()).find(|id| !contents.catalog.channels.contains_key(id));
    if let Some(id) = unknown {
        return Ok(Err(format!("the summary does not repeat channel {id}")));
    }
    let Catalog { schemas, channels, .. } = &contents.catalog;
    if let Some(channel) =
        channels.values().find(|it| it.schema_id != 0 && !schemas.contains_key(&it.schema_id))
    {
        return Ok(Err(format!("the summary does not repeat schema {}", channel.schema_id)));
    }
    Ok(Ok(contents))
}

/// Messages by channel, if the statistics have them and their sum is correct.
pub(crate) fn counts_of(statistics: &Statistics) -> Option<BTreeMap<u16, u64>> {
    let counts = &statistics.channel_message_counts;
    let sum = counts.values().try_fold(0u64, |sum, &count| sum.checked_add(count))?;
    let counts = counts.iter().filter(|(_, count)| **count > 0).map(|(&id, &count)| (id, count));
    (sum == statistics.message_count).then(|| counts.collect())
}

/// Counts messages by channel: from the message indexes, which are compared with the statistics, or from the statistics
/// alone if there are no indexes.
fn settle_counts(
    window: &mut Window<'_>,
    summary: &Summary,
    contents: &mut Contents,
) -> Result<Result<(), String>, LogError> {
    let statistics = contents.catalog.statistics.clone();
    let stated = statistics.as_ref().and_then(counts_of);
    let has_indexes = |index: &ChunkIndex| index.message_index_length > 0 || index.uncompressed_size == 0;
    if !summary.chunks.iter().all(has_indexes)
        && let Some(stated) = stated
    {
        contents.counts = stated;
        return Ok(Ok(()));
    }
    if let Err(why) = count(window, summary, contents)? {
        return Ok(Err(why));
    }
    if let Some(statistics) = statistics
        && stated.as_ref() != Some(&contents.counts)
    {
        let (told, indexed) = (statistics.message_count, contents.counts.values().sum::<u64>());
        // Statistics may have no counts by channel.
        if told != indexed || !statistics.channel_message_counts.is_empty() {
            contents.problems.add(format!(
                "the statistics count {told} messages, the message indexes {indexed}: the indexes are believed"
            ));
        }
    }
    Ok(Ok(()))
}

/// Processes the records from `at` to `end`, which are not in the chunk index.
fn between(
    window: &mut Window<'_>,
    mut at: u64,
    end: u64,
    contents: &mut Contents,
) -> Result<Result<(), String>, LogError> {
    while at < end {
        let front = window.get(at, PROBE)?;
        let head = Head::read(front).filter(|head| head.length() <= end - at);
        let Some(head) = head.filter(|head| head.plausible(&front[HEAD.min(front.len())..])) else {
            return Ok(Err(format!("there is no record at byte {at}, where one should follow")));
        };
        if matches!(head.op, op::MESSAGE | op::CHUNK) {
            return Ok(Err(format!("the index leaves out messages at byte {at}")));
        }
        if Section::of(head.op) == Section::Summary {
            return Ok(Err(format!(
                "there is a record of opcode {:#04x} among the data at byte {at}",
                head.op
            )));
        }
        let body = body_of(window.source(), head, at)?;
        if let Err(problem) = contents.catalog.take(head, at, &body) {
            contents.problems.add(problem);
        }
        at += head.length();
    }
    Ok(Ok(()))
}

/// The part of a record's body that [`Catalog::take`] needs.
pub(crate) fn body_of(source: &Source, head: Head, offset: u64) -> Result<Bytes, LogError> {
    let length = match head.op {
        op::ATTACHMENT => head.body.min(ATTACHMENT_PROBE as u64),
        op::HEADER | op::SCHEMA | op::CHANNEL | op::METADATA | op::STATISTICS if head.body <= BODY_LIMIT => {
            head.body
        }
        _ => 0,
    };
    source.read(offset + HEAD as u64, length as usize)
}

/// Counts messages from the message indexes after the chunks, for a summary without statistics.
fn count(
    window: &mut Window<'_>,
    summary: &Summary,
    contents: &mut Contents,
) -> Result<Result<(), String>, LogError> {
    for index in &summary.chunks {
        let mut at = index.chunk_start_offset + index.chunk_length;
        let end = at + index.message_index_length;
        if at == end && index.uncompressed_size > 0 {
            return Ok(Err("the summary has no statistics, and the log no message indexes".to_owned()));
        }
        while at < end {
            let front = window.get(at, HEAD + 6)?;
            let head =
                Head::read(front).filter(|head| head.op == op::MESSAGE_INDEX && head.length() <= end - at);
            let indexed = indexed_messages(&front[HEAD.min(front.len())..]);
            let (Some(head), Some((channel, count))) = (head, indexed) else {
                return Ok(Err(format!("there is no message index at byte {at}, where one should follow")));
            };
            if count > 0 {
                *contents.counts.entry(channel).or_insert(0) += count;
            }
            at += head.length();
        }
    }
    Ok(Ok(()))
}

/// Checks the checksum of the data section, if it has one; returns the problem. Reads the complete log.
pub(crate) fn check_data(source: &Source, summary: &Summary) -> Result<Option<String>, LogError> {
    const DATA_END: u64 = HEAD as u64 + 4;
    let Some(at) = summary.start.checked_sub(DATA_END).filter(|&at| at >= 8) else { return Ok(None) };
    let record = source.read(at, DATA_END as usize)?;
    if Head::read(&record) != Some(Head { op: op::DATA_END, body: 4 }) {
        return Ok(None);
    }
    let expected = Fields(&record[HEAD..]).u32().unwrap_or(0);
    if expected == 0 {
        return Ok(None);
    }
    let mut hasher = crc32fast::Hasher::new();
    let mut from = 0;
    while from < at {
        let length = (at - from).min(1 << 20);
        hasher.update(&source.read(from, length as usize)?);
        from += length;
    }
    let got = hasher.finalize();
    Ok((got != expected).then(|| format!("the checksum of the data is {got:08x}, expected {expected:08x}")))
}
