//! Opens a log without an index: scans the records, keeps what is sound and reports what is lost.
//!
//! The first pass, in this file, goes from record to record by their lengths, and searches for the next record after a
//! damaged one. The second pass, in [`crate::check`], decompresses and checks every chunk.

use crate::check::{DoubtfulIndex, Indexes, check_chunks, settle_undefined};
use crate::error::LogError;
use crate::info::Lost;
use crate::record::{ChunkHead, HEAD, Head, MAGIC, MessageHead, PROBE, Section, indexed_messages, op};
use crate::segment::Segment;
use crate::source::{Source, Window};
use crate::summary::{Contents, Summary, body_of, counts_of};
use std::collections::BTreeMap;
use std::sync::OnceLock;

/// A run of records outside of chunks is closed at this size, so that it can be read like a chunk.
const RUN_BYTES: u64 = 1 << 20;
/// Number of bytes read at once when searching for the next record.
const SEARCH_BYTES: usize = 1 << 20;

/// Result of a scan: the log, and its losses.
pub(crate) struct Scanned {
    pub(crate) contents: Contents,
    pub(crate) lost: Lost,
}

/// Scans the complete log. A `summary` with a valid checksum provides definitions, counts, and the offsets of chunks.
pub(crate) fn scan(source: &Source, summary: Option<&Summary>) -> Result<Scanned, LogError> {
    let mut hops = Hops::new(source, summary);
    hops.run()?;
    let Hops { mut contents, mut lost, indexes, .. } = hops;
    // Statistics are used only if their checksum is valid.
    contents.catalog.statistics = summary.and_then(|summary| summary.catalog.statistics.clone());
    let sound = check_chunks(source, &mut contents, &indexes, &mut lost);
    settle_undefined(&mut contents, &mut lost, &sound);
    let found: u64 = contents.counts.values().sum();
    if let Some(statistics) = &contents.catalog.statistics {
        let stated = statistics.message_count;
        // If nothing is missing that could have held messages, the count is wrong.
        let believed = counts_of(statistics).is_some() && (lost != Lost::default() || stated <= found);
        if believed {
            lost.messages = stated.saturating_sub(found);
        }
        if stated != found + lost.messages {
            contents.problems.add(format!("the statistics count {stated} messages, the log holds {found}"));
        }
    }
    Ok(Scanned { contents, lost })
}

/// The first pass.
struct Hops<'a> {
    source: &'a Source,
    window: Window<'a>,
    /// Offsets of chunks according to a sound summary, ascending.
    hints: Vec<u64>,
    contents: Contents,
    lost: Lost,
    run: Option<Run>,
    /// The last chunk, to which the next message indexes belong unless there is damage between them.
    last_chunk: Option<LastChunk>,
    /// The message indexes after a chunk, by segment.
    indexes: BTreeMap<usize, Indexes>,
    /// Whether there are compressed chunks, and messages outside of chunks.
    compressed: bool,
    loose: bool,
    /// Whether the end of the data has been passed.
    data_ended: bool,
    /// Number of records where the format has none of their kind; opcode and offset of the first one.
    misplaced: Option<(u64, u8, u64)>,
}

/// A chunk behind which message indexes may follow.
#[derive(Clone, Copy)]
struct LastChunk {
    segment: usize,
    has_damage_behind: bool,
}

/// Which records a search may stop at.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Sought {
    /// Any record.
    Any,
    /// Records that cannot be inside of a chunk: bytes within a chunk may look like schemas, channels and messages, or
    /// be some.
    OutsideChunks,
}

/// Consecutive records outside of chunks.
struct Run {
    start: u64,
    end: u64,
    first: u64,
    last: u64,
    counts: BTreeMap<u16, u64>,
}

impl<'a> Hops<'a> {
    fn new(source: &'a Source, summary: Option<&Summary>) -> Self {
        let mut contents = Contents::default();
        let mut hints = Vec::new();
        if let Some(summary) = summary {
            contents.catalog.take_definitions(&summary.catalog);
            hints = summary.chunks.iter().map(|index| index.chunk_start_offset).collect();
        }
        Self {
            source,
            window: Window::new(source, 8192),
            hints,
            contents,
            lost: Lost::default(),
            run: None,
            last_chunk: None,
            indexes: BTreeMap::new(),
            compressed: false,
            loose: false,
            data_ended: false,
            misplaced: None,
        }
    }

    fn run(&mut self) -> Result<(), LogError> {
        let length = self.source.length();
        let mut at = MAGIC.len() as u64;
        while at < length {
            if self.is_closing_magic(at)? {
                at = length;
                continue;
            }
            let front = self.window.get(at, PROBE)?;
            let body = &front[HEAD.min(front.len())..];
            let head = Head::read(front).map(|head| as_chunk(head, body));
            let plausible = head.filter(|head| head.plausible(body) && head.length() <= length - at);
            at = match plausible {
                Some(head) => self.hop(head, at)?,
                None => self.pass_over(head, at)?,
            };
        }
        self.close_run();
        if let Some((count, op, first)) = self.misplaced {
            self.contents.problems.add(format!(
                "{count} records are where no record of their kind can be, the first at byte {first}, of opcode {op:#04x}"
            ));
        }
        Ok(())
    }

    /// Counts a record that is in the wrong section: a damaged opcode turns a message into a statement of the summary,
    /// for example.
    fn note_section(&mut self, op: u8, at: u64) {
        let fits = match Section::of(op) {
            Section::Start => at == MAGIC.len() as u64,
            Section::Data => !self.data_ended,
            Section::Both => true,
            Section::Summary => self.data_ended,
        };
        self.data_ended |= op == op::DATA_END;
        if !fits {
            self.misplaced.get_or_insert((0, op, at)).0 += 1;
        }
    }

    /// Processes the record at `at`, unless its length turns out to be wrong. Returns where to continue.
    fn hop(&mut self, head: Head, at: u64) -> Result<u64, LogError> {
        let end = at + head.length();
        if !self.record_follows(end)? {
            let is_chunk = head.op == op::CHUNK;
            let next =
                self.resync(at + HEAD as u64, if is_chunk { Sought::OutsideChunks } else { self.sought() })?;
            if next < end && is_chunk {
                // Some of its bytes are missing, so the next record is closer than its length says.
                self.chunk(at, next)?;
                return Ok(next);
            }
            if next < end {
                self.lose(at, next, "a record whose length is wrong");
                return Ok(next);
            }
        }
        self.note_section(head.op, at);
        match head.op {
            op::MESSAGE => self.message(at, end)?,
            op::CHUNK => self.chunk(at, end)?,
            op::MESSAGE_INDEX => {
                let count =
                    indexed_messages(&self.window.get(at, PROBE)?[HEAD..]).map_or(0, |(_, count)| count);
                if let Some(LastChunk { segment, has_damage_behind }) = self.last_chunk {
                    let indexes = self.indexes.entry(segment).or_default();
                    if has_damage_behind {
                        let start = at + HEAD as u64;
                        indexes.doubtful.push(DoubtfulIndex { start, body: head.body, count });
                    } else {
                        indexes.count += count;
                    }
                } else {
                    // The chunk before it was skipped.
                    self.lost.messages += count;
                }
            }
            // A second header is damage, which has been reported.
            op::HEADER if at != MAGIC.len() as u64 => {}
            _ => {
                if matches!(head.op, op::ATTACHMENT | op::DATA_END) {
                    self.close_run();
                }
                let body = body_of(self.source, head, at)?;
                if let Err(problem) = self.contents.catalog.take(head, at, &body) {
                    self.contents.problems.add(problem);
                }
            }
        }
        Ok(end)
    }

    fn message(&mut self, at: u64, end: u64) -> Result<(), LogError> {
        let Some(message) = MessageHead::read(&self.window.get(at, PROBE)?[HEAD..]) else { return Ok(()) };
        let time = message.log_time;
        self.loose = true;
        if self.run.as_ref().is_some_and(|run| end - run.start > RUN_BYTES) {
            self.close_run();
        }
        let run =
            self.run.get_or_insert(Run { start: at, end, first: time, last: time, counts: BTreeMap::new() });
        run.end = end;
        run.first = run.first.min(time);
        run.last = run.last.max(time);
        *run.counts.entry(message.channel).or_insert(0) += 1;
        Ok(())
    }

    fn close_run(&mut self) {
        let Some(run) = self.run.take() else { return };
        for (&channel, &count) in &run.counts {
            *self.contents.counts.entry(channel).or_insert(0) += count;
        }
        self.contents.segments.push(Segment {
            start: run.start,
            length: run.end - run.start,
            chunk: false,
            first: run.first,
            last: run.last,
            channels: Some(run.counts.into_keys().collect()),
            found: OnceLock::new(),
            contents: run.end - run.start,
        });
    }

    fn chunk(&mut self, at: u64, end: u64) -> Result<(), LogError> {
        self.close_run();
        let chunk = ChunkHead::read(&self.window.get(at, PROBE)?[HEAD..]);
        self.compressed |= chunk.as_ref().is_some_and(|chunk| !chunk.compression.is_empty());
        let contents = chunk.map_or(0, |chunk| chunk.uncompressed);
        let segment = self.contents.segments.len();
        self.last_chunk = Some(LastChunk { segment, has_damage_behind: false });
        // The second pass computes times and channels.
        self.contents.segments.push(Segment {
            start: at,
            length: end - at,
            chunk: true,
            first: 0,
            last: 0,
            channels: None,
            found: OnceLock::new(),
            contents,
        });
        Ok(())
    }

    /// Handles bytes at `at` that are not a complete record. Returns where to continue.
    fn pass_over(&mut self, head: Option<Head>, at: u64) -> Result<u64, LogError> {
        let length = self.source.length();
        let chunk = match head {
            Some(head) if head.op == op::CHUNK => ChunkHead::read(&self.window.get(at, PROBE)?[HEAD..]),
            _ => None,
        };
        let (Some(head), Some(chunk)) = (head, chunk) else {
            let next = self.resync(at + 1, self.sought())?;
            let what = if next == length { "the log is cut off, or damaged to its end," } else { "damage" };
            self.lose(at, next, what);
            return Ok(next);
        };
        // Both the record and the chunk in it have a length; the one at whose end a record begins is correct. If
        // neither is, the chunk ends where the next record is found, or at the end of a file that was truncated or
        // never closed.
        let by_chunk = (at + (HEAD + chunk.front) as u64).saturating_add(chunk.compressed);
        let by_record = at.saturating_add(head.length());
        let mut end = None;
        for candidate in [by_chunk, by_record] {
            if end.is_none() && candidate <= length && self.record_follows(candidate)? {
                end = Some(candidate);
                self.contents.problems.add(format!("the chunk at byte {at} states a length that cannot be"));
            }
        }
        let end = match end {
            Some(end) => end,
            None => self.resync(at + HEAD as u64, Sought::OutsideChunks)?,
        };
        self.chunk(at, end)?;
        Ok(end)
    }

    /// What a search after damage may stop at. In a log with compressed chunks and no messages outside of them, bytes
    /// that look like a message are part of compressed data.
    fn sought(&self) -> Sought {
        if self.compressed && !self.loose { Sought::OutsideChunks } else { Sought::Any }
    }

    fn lose(&mut self, from: u64, to: u64, what: &str) {
        self.close_run();
        if let Some(chunk) = &mut self.last_chunk {
            chunk.has_damage_behind = true;
        }
        self.lost.bytes += to - from;
        self.contents.problems.add(format!("{what} from byte {from} to {to}"));
    }

    fn is_closing_magic(&mut self, at: u64) -> Result<bool, LogError> {
        let rest = self.window.get(at, MAGIC.len())?;
        Ok(rest == MAGIC && at + MAGIC.len() as u64 == self.source.length())
    }

    /// Whether a record, or the end of the log, is at `at`.
    fn record_follows(&mut self, at: u64) -> Result<bool, LogError> {
        let length = self.source.length();
        if at == length || self.is_closing_magic(at)? {
            return Ok(true);
        }
        if at > length {
            return Ok(false);
        }
        let front = self.window.get(at, PROBE)?;
        let Some(head) = Head::read(front) else { return Ok(false) };
        let body = &front[HEAD.min(front.len())..];
        // A chunk that the end of the file cuts off is recognised by its header.
        let whole = head.length() <= length - at || head.op == op::CHUNK;
        Ok(whole && head.plausible(body))
    }

    /// The next position from `from` on where a record begins and another one follows it; the end if there is none.
    fn resync(&mut self, from: u64, sought: Sought) -> Result<u64, LogError> {
        let length = self.source.length();
        let hint = self.hints.partition_point(|&hint| hint < from);
        let limit = self.hints.get(hint).copied().unwrap_or(length).min(length);
        let mut at = from;
        while at < limit {
            let span = usize::try_from(limit - at).unwrap_or(usize::MAX).min(SEARCH_BYTES);
            // The opcode and the upper half of the length are enough to decide in nearly all cases.
            let block = self.source.read(at, span.saturating_add(HEAD).min((length - at) as usize))?;
            for offset in 0..span {
                let Some(&[op, _, _, _, _, _, a, b, c]) = block.get(offset..offset + HEAD) else { break };
                let inner = matches!(op, op::SCHEMA | op::CHANNEL | op::MESSAGE);
                let is_sought = !inner || sought == Sought::Any;
                if is_sought && (op::FOOTER..=op::DATA_END).contains(&op) && [a, b, c] == [0; 3] {
                    let candidate = at + offset as u64;
                    if self.begins(candidate)? {
                        return Ok(candidate);
                    }
                }
            }
            at += span as u64;
        }
        Ok(limit)
    }

    fn begins(&mut self, at: u64) -> Result<bool, LogError> {
        let length = self.source.length();
        let front = self.window.get(at, PROBE)?;
        let Some(head) = Head::read(front) else { return Ok(false) };
        let body = &front[HEAD.min(front.len())..];
        if !head.plausible(body) {
            return Ok(false);
        }
        if head.op == op::CHUNK && ChunkHead::read(body).is_some_and(|chunk| chunk.is_known()) {
            return Ok(true);
        }
        Ok(head.length() <= length - at && self.record_follows(at + head.length())?)
    }
}

/// The head of the record with this body; that of a chunk if the body is one. Reading the chunk reports its opcode.
fn as_chunk(head: Head, body: &[u8]) -> Head {
    let is_chunk = head.op != op::CHUNK && ChunkHead::read(body).is_some_and(|chunk| chunk.fills(head.body));
    if is_chunk { Head { op: op::CHUNK, ..head } } else { head }
}
