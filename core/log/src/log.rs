//! An open log.

use crate::cache::{Cache, Loaded};
use crate::catalog::{Catalog, Problems};
use crate::error::LogError;
use crate::gaps::{Gap, gaps};
use crate::info::{
    Attachment, AttachmentInfo, LogInfo, LogMessage, Lost, MessagePosition, Metadata, TopicId,
};
use crate::parts::Parts;
use crate::rates;
use crate::record::{ChunkHead, Fields, HEAD, Head, MAGIC, MessageHead, PROBE, indexed_messages, op};
use crate::scan::{Scanned, scan};
use crate::segment::{Damage, MessageRef, Segment, Tally, decode, message_data};
use crate::source::{Source, Window};
use crate::summary::{self, Contents, Summary};
use bytes::Bytes;
use rcs_msg::{DeltaCodec, Stamp};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

/// Size of the cache of decompressed data of an open log.
const CACHE_BYTES: usize = 64 << 20;
/// A log up to this size, compressed and uncompressed, is checked completely when it is opened; a larger one as it is
/// read.
pub(crate) const CHECKED_WHOLE: u64 = 32 << 20;

/// Greatest number of problems that concern single messages.
const REPORTED_AT_LIMIT: usize = 1000;

/// An open log: cheap to clone, shared between threads, with one cache of decompressed chunks.
///
/// Memory is bounded for any size of the log: the index, and [64 MiB](Log) of decompressed chunks.
#[derive(Clone, Debug)]
pub struct Log(pub(crate) Arc<Inner>, Codecs);

/// Codecs of messages that are stored as key frames and deltas.
type Codecs = Arc<[&'static dyn DeltaCodec]>;

#[derive(Debug)]
pub(crate) struct Inner {
    pub(crate) source: Source,
    info: LogInfo,
    /// In file order.
    pub(crate) segments: Vec<Segment>,
    /// Segments by first time, and by last time; ties in file order.
    pub(crate) by_first: Vec<u32>,
    pub(crate) by_last: Vec<u32>,
    /// For each place in `by_last`, the earliest first time of the segments from there on; ascending.
    pub(crate) first_behind: Vec<u64>,
    /// The files of a log that is split.
    pub(crate) parts: Parts,
    catalog: Catalog,
    cache: Cache,
    found: Mutex<Found>,
}

/// Damage found since the log was opened.
#[derive(Debug, Default)]
struct Found {
    lost: Lost,
    problems: Problems,
    reported: BTreeSet<u32>,
    /// Messages whose problems have been reported.
    reported_at: BTreeSet<MessagePosition>,
    /// A file that has changed since it was opened has been reported.
    changed: bool,
}

/// The state after opening.
#[derive(Default)]
pub(crate) struct Opened {
    pub(crate) contents: Contents,
    pub(crate) lost: Lost,
    pub(crate) recovered: bool,
    /// Segments whose damage a scan has found and counted.
    pub(crate) scanned: BTreeSet<u32>,
    /// Number of segments that have been read and checked.
    pub(crate) verified: u64,
}

/// What a file is that begins with these bytes.
fn what_begins(front: &[u8]) -> String {
    const CONVERT: &str = "which `mcap convert` (Foxglove's command-line tool) converts to one";
    match front {
        [] => "nothing".to_owned(),
        b"#ROSBAG " => format!("a bag of ROS 1, {CONVERT}"),
        b"SQLite f" => format!("an SQLite database, such as a bag of ROS 2 (.db3), {CONVERT}"),
        [b'U', b'L', b'o', b'g', ..] => "a ULog of PX4".to_owned(),
        [0x28, 0xb5, 0x2f, 0xfd, ..] => "a file compressed as a whole, which `zstd -d` unpacks".to_owned(),
        [0x89, b'P', b'N', b'G', ..] => "a PNG image".to_owned(),
        [0xff, 0xd8, 0xff, ..] => "a JPEG image".to_owned(),
        _ if front.iter().all(|byte| byte.is_ascii_graphic() || byte.is_ascii_whitespace()) => {
            format!("a text that begins with {:?}", String::from_utf8_lossy(front))
        }
        _ => {
            let bytes: Vec<String> = front.iter().map(|byte| format!("{byte:02x}")).collect();
            format!("a file of an unknown format, which begins with the bytes {}", bytes.join(" "))
        }
    }
}

impl Log {
    /// Opens a log by its index or, if that is missing or damaged, by a scan of its records.
    ///
    /// Damage is not an error: see [`LogInfo::lost`] and [`LogInfo::problems`].
    pub fn open(path: impl AsRef<Path>) -> Result<Self, LogError> {
        Self::from_source(Source::open(path.as_ref())?, true)
    }

    /// Opens a log by a scan, even if it has an index.
    pub fn open_by_scan(path: impl AsRef<Path>) -> Result<Self, LogError> {
        Self::from_source(Source::open(path.as_ref())?, false)
    }

    /// Opens a log in memory, like [`Log::open`].
    pub fn from_bytes(bytes: Bytes) -> Result<Self, LogError> {
        Self::from_source(Source::memory(bytes), true)
    }

    /// Opens a log in memory, like [`Log::open_by_scan`].
    pub fn from_bytes_by_scan(bytes: Bytes) -> Result<Self, LogError> {
        Self::from_source(Source::memory(bytes), false)
    }

    fn from_source(source: Source, by_index: bool) -> Result<Self, LogError> {
        let mut left_to_check = CHECKED_WHOLE;
        let opened = Self::open_source(&source, by_index, &mut left_to_check)?;
        let gaps = gaps(&source, &opened.contents.segments)?;
        Ok(Self::new(source, opened, gaps, Parts::default()))
    }

    /// Opens a file. If its size, compressed and uncompressed, is at most `left_to_check` bytes, it is checked, and
    /// `left_to_check` is reduced by it.
    pub(crate) fn open_source(
        source: &Source,
        by_index: bool,
        left_to_check: &mut u64,
    ) -> Result<Opened, LogError> {
        Self::check_front(source)?;
        if by_index {
            match summary::read(source)? {
                Ok(summary) => open_with(source, &summary, left_to_check),
                Err(why) => open_by_scan(source, None, why),
            }
        } else {
            let summary = summary::read(source)?.ok();
            open_by_scan(source, summary.as_ref(), "read by a scan, as asked for".to_owned())
        }
    }

    /// Refuses a file that does not begin like a log.
    pub(crate) fn check_front(source: &Source) -> Result<(), LogError> {
        let front = source.read(0, source.length().min(MAGIC.len() as u64) as usize)?;
        if front == MAGIC.as_slice() {
            return Ok(());
        }
        Err(LogError::NotALog { got: what_begins(&front), path: source.path().to_owned() })
    }

    pub(crate) fn new(source: Source, opened: Opened, gaps: Vec<Gap>, parts: Parts) -> Self {
        let Opened { contents, lost, recovered, scanned: reported, verified } = opened;
        let Contents { mut catalog, segments, counts, problems } = contents;
        let order = |key: fn(&Segment) -> u64| {
            let mut order: Vec<u32> = (0..segments.len() as u32).collect();
            order.sort_by_key(|&index| (key(&segments[index as usize]), index));
            order
        };
        let (by_first, by_last) = (order(|segment| segment.first), order(|segment| segment.last));
        let mut earliest = u64::MAX;
        let behind = by_last.iter().rev().map(|&index| {
            earliest = earliest.min(segments[index as usize].first);
            earliest
        });
        let mut first_behind: Vec<u64> = behind.collect();
        first_behind.reverse();
        let messages = counts.values().fold(0u64, |sum, count| sum.saturating_add(*count));
        let (start, end) = times(&catalog, &segments, recovered);
        let info = LogInfo {
            path: source.path().to_owned(),
            files: source.files().map(|file| file.path().to_owned()).collect(),
            bytes: source.length(),
            start: Stamp(start),
            end: Stamp(end),
            messages,
            segments: segments.len() as u64,
            recovered,
            lost,
            topics: catalog.topics(&counts),
            problems: problems.list(),
            verified,
            gaps,
            profile: catalog.profile.clone(),
            library: catalog.library.clone(),
            complete_from: catalog.complete_from(),
            recorded_s: 0.0,
        };
        let info = rates::with_rates(info, &source, &segments, [&by_first, &by_last], &parts);
        catalog.schemas.clear();
        let found = Mutex::new(Found { lost, problems, reported, ..Found::default() });
        let cache = Cache::new(CACHE_BYTES);
        let inner =
            Inner { source, info, segments, by_first, by_last, first_behind, parts, catalog, cache, found };
        Self(Arc::new(inner), Arc::new([]))
    }

    /// The same log with codecs for messages that are stored as key frames and deltas: see
    /// [`Reassembly`](crate::Reassembly).
    #[must_use]
    pub fn with_codecs(self, codecs: impl IntoIterator<Item = &'static dyn DeltaCodec>) -> Self {
        Self(self.0, codecs.into_iter().collect())
    }

    /// The codecs of [`Log::with_codecs`].
    pub fn codecs(&self) -> &[&'static dyn DeltaCodec] {
        &self.1
    }

    /// Reports a problem with the message at `place`, once.
    pub(crate) fn report_at(&self, place: MessagePosition, problem: String) {
        let mut found = self.0.found.lock().unwrap_or_else(PoisonError::into_inner);
        if found.reported_at.len() < REPORTED_AT_LIMIT && found.reported_at.insert(place) {
            tracing::warn!("{problem}");
            found.problems.add(problem);
        }
    }

    /// Looks whether the files of the log have changed since they were opened, which is a problem of the log. A log
    /// without an index may grow, because it may still be written.
    pub fn look_for_changes(&self) {
        for file in self.0.source.files() {
            self.change_of(file);
        }
    }

    /// How a file has changed since it was opened. The first one that has is reported, once.
    fn change_of(&self, file: &Source) -> Option<String> {
        let change = file.change(self.0.info.recovered)?;
        let mut found = self.0.found.lock().unwrap_or_else(PoisonError::into_inner);
        if !std::mem::replace(&mut found.changed, true) {
            let problem = format!("{change}: {}", file.path().display());
            tracing::warn!("{problem}");
            found.problems.add(problem);
        }
        Some(change)
    }

    /// Reports a segment that could not be read, once; if its file has changed, that alone.
    pub(crate) fn report_unreadable(&self, index: u32, error: &LogError) {
        let segment = &self.0.segments[index as usize];
        let (_, file) = self.0.source.file_at(segment.start);
        if self.change_of(file).is_none() {
            let place = MessagePosition { time: Stamp(segment.first), segment: index, offset: 0 };
            self.report_at(place, error.to_string());
        }
    }

    /// The description of the log after opening.
    pub fn info(&self) -> &LogInfo {
        &self.0.info
    }

    /// What could not be read, including losses found since the log was opened.
    pub fn lost(&self) -> Lost {
        self.0.found.lock().unwrap_or_else(PoisonError::into_inner).lost
    }

    /// The problems of the log, including those found since it was opened.
    pub fn problems(&self) -> Vec<String> {
        self.0.found.lock().unwrap_or_else(PoisonError::into_inner).problems.list()
    }

    /// The metadata records, in file order.
    pub fn metadata(&self) -> &[Metadata] {
        &self.0.catalog.metadata
    }

    /// The attachments, in file order; their contents are not read.
    pub fn attachments(&self) -> &[AttachmentInfo] {
        &self.0.catalog.attachments
    }

    /// The last attachment with this name, with its contents.
    pub fn attachment(&self, name: &str) -> Result<Option<Attachment>, LogError> {
        let info = self.attachments().iter().rev().find(|info| info.name == name);
        info.map(|info| self.read_attachment(info)).transpose()
    }

    /// The contents of a listed attachment; an error if its checksum is wrong.
    pub fn read_attachment(&self, info: &AttachmentInfo) -> Result<Attachment, LogError> {
        let source = &self.0.source;
        let damaged = |expected: String, got: String| LogError::Damaged {
            what: format!("attachment `{}`", info.name),
            offset: info.offset,
            expected,
            got,
            path: source.path().to_owned(),
        };
        let fits = info.offset.checked_add(HEAD as u64 + info.body).is_some_and(|end| end <= source.length());
        let (true, Ok(length)) = (fits, usize::try_from(info.body)) else {
            return Err(damaged(format!("{} bytes", info.body), "a log that ends before".to_owned()));
        };
        let body = source.read(info.offset + HEAD as u64, length)?;
        let mut fields = Fields(&body);
        let parsed = (|| {
            fields.take(16)?;
            fields.text()?;
            fields.text()?;
            let size = usize::try_from(fields.u64()?).ok()?;
            let from = body.len() - fields.0.len();
            fields.take(size)?;
            Some((from, from + size, fields.u32()?))
        })();
        let Some((from, to, crc)) = parsed else {
            return Err(damaged("a record that parses".to_owned(), "another".to_owned()));
        };
        let got = crc32fast::hash(&body[..to]);
        if crc != 0 && crc != got {
            return Err(damaged(format!("checksum {crc:08x}"), format!("{got:08x}")));
        }
        Ok(Attachment { info: info.clone(), data: body.slice(from..to) })
    }

    /// A segment's messages, from the cache or the file. Damage is counted the first time it is found.
    pub(crate) fn load(&self, index: u32) -> Result<Arc<Loaded>, LogError> {
        let inner = &*self.0;
        if let Some(loaded) = inner.cache.get(index) {
            return Ok(loaded);
        }
        inner.cache.make_room(inner.segments[index as usize].weight());
        let loaded = self.read_segment(index)?;
        inner.cache.insert(index, &loaded);
        Ok(loaded)
    }

    /// Like [`Log::load`], for a segment that is not likely to be needed again: it is not kept.
    pub(crate) fn load_once(&self, index: u32) -> Result<Arc<Loaded>, LogError> {
        self.0.cache.get(index).map_or_else(|| self.read_segment(index), Ok)
    }

    fn read_segment(&self, index: u32) -> Result<Arc<Loaded>, LogError> {
        let inner = &*self.0;
        let segment = &inner.segments[index as usize];
        let read = decode(&inner.source, segment).inspect_err(|error| self.report_unreadable(index, error));
        let mut decoded = read?;
        if let Some(damage) = &decoded.damage {
            self.report(index, damage, decoded.messages.len() as u64)?;
        }
        // The order is total and the same in every reading, even if a message's time is outside of the times that its
        // chunk states.
        let catalog = &inner.catalog;
        inner.parts.map_channels(segment, &mut decoded.messages);
        decoded.messages.retain(|message| catalog.channels.contains_key(&message.channel));
        if segment.channels.is_none() {
            let counts = Tally::of(&decoded.messages).counts;
            segment.found.get_or_init(|| counts.into_iter().map(|(channel, _)| channel).collect());
        }
        for message in &mut decoded.messages {
            message.time = message.time.clamp(segment.first, segment.last);
        }
        decoded.messages.sort_unstable();
        Ok(Arc::new(Loaded { contents: decoded.contents, messages: decoded.messages.into() }))
    }

    /// Reports damage of a segment, once. If its file has changed since it was opened, that is reported instead, and
    /// the segment cannot be read.
    pub(crate) fn report(&self, index: u32, damage: &Damage, salvaged: u64) -> Result<(), LogError> {
        let segment = &self.0.segments[index as usize];
        if self.0.found.lock().unwrap_or_else(PoisonError::into_inner).reported.contains(&index) {
            return Ok(());
        }
        let (file_start, file) = self.0.source.file_at(segment.start);
        if let Some(change) = self.change_of(file) {
            let (offset, length) = (segment.start - file_start, segment.length);
            let source = std::io::Error::other(change);
            return Err(LogError::Read { offset, length, path: file.path().to_owned(), source });
        }
        let missing = indexed_behind(&self.0.source, segment.end())?.saturating_sub(salvaged);
        let missing = missing.max(damage.lost_messages);
        let mut found = self.0.found.lock().unwrap_or_else(PoisonError::into_inner);
        if found.reported.insert(index) {
            found.lost += Lost { bytes: damage.lost_bytes, messages: missing };
            let (start, what, bytes) = (segment.start, &damage.what, damage.lost_bytes);
            tracing::warn!(start, what, bytes, missing, "a chunk of the log is damaged");
            found.problems.add(format!(
                "chunk at byte {start}: {what}; {salvaged} messages salvaged, {missing} known to be lost, \
                 {bytes} bytes lost"
            ));
        }
        Ok(())
    }
}

/// The message with index `message` of a loaded segment.
pub(crate) fn message_at(index: u32, loaded: &Loaded, message: MessageRef) -> Option<LogMessage> {
    let from = message.offset as usize;
    let head = Head::read(loaded.contents.get(from..)?)?;
    let to = usize::try_from(head.length()).ok()?.checked_add(from)?;
    (to <= loaded.contents.len()).then_some(())?;
    let body = loaded.contents.slice(from + HEAD..to);
    let head = MessageHead::read(&body)?;
    let data = message_data(&body);
    // A message is copied out of its chunk, so that keeping it does not keep the chunk in memory; a message that fills
    // most of its chunk shares it.
    let data = if data.len() * 2 < loaded.contents.len() { Bytes::copy_from_slice(&data) } else { data };
    Some(LogMessage {
        topic: TopicId(message.channel),
        sequence: head.sequence,
        log_time: Stamp(head.log_time),
        publish_time: Stamp(head.publish_time),
        data,
        place: place_of(index, message),
    })
}

/// Position of a message of a segment.
pub(crate) fn place_of(segment: u32, message: MessageRef) -> MessagePosition {
    MessagePosition { time: Stamp(message.time), segment, offset: message.offset + 1 }
}

fn open_with(source: &Source, summary: &Summary, left_to_check: &mut u64) -> Result<Opened, LogError> {
    let mut verified = 0;
    let contents = match summary::contents(source, summary)? {
        Ok(contents) => contents,
        Err(why) => return open_by_scan(source, Some(summary), why),
    };
    if source.length() <= *left_to_check {
        // The sizes in the index are checked first, because they decide whether the rest is checked, too.
        for segment in &contents.segments {
            if stated_size(source, segment)? != Some(segment.contents) {
                let why = format!("the index of the chunk at byte {} contradicts the chunk", segment.start);
                return open_by_scan(source, Some(summary), why);
            }
        }
        let size = contents.segments.iter().fold(0u64, |sum, segment| sum.saturating_add(segment.contents));
        if size <= *left_to_check {
            if let Some(why) = check_whole(source, &contents, summary)? {
                return open_by_scan(source, Some(summary), why);
            }
            verified = contents.segments.len() as u64;
            *left_to_check -= size.max(source.length());
        }
    }
    Ok(Opened { contents, verified, ..Opened::default() })
}

/// Size of a chunk's contents according to the chunk itself.
fn stated_size(source: &Source, segment: &Segment) -> Result<Option<u64>, LogError> {
    let front = source.read(segment.start, segment.length.min(PROBE as u64) as usize)?;
    let head = Head::read(&front).filter(|head| head.op == op::CHUNK);
    Ok(head.and_then(|_| ChunkHead::read(&front[HEAD..])).map(|chunk| chunk.uncompressed))
}

/// How the log contradicts its index; `None` if it agrees.
fn check_whole(source: &Source, contents: &Contents, summary: &Summary) -> Result<Option<String>, LogError> {
    let mut counts = BTreeMap::new();
    for segment in &contents.segments {
        let decoded = decode(source, segment)?;
        if let Some(damage) = decoded.damage {
            return Ok(Some(format!("the chunk at byte {} is damaged: {}", segment.start, damage.what)));
        }
        let tally = Tally::of(&decoded.messages);
        for &(channel, count) in &tally.counts {
            *counts.entry(channel).or_insert(0) += count;
        }
        let outside = tally.first < segment.first || tally.last > segment.last;
        if outside && !tally.counts.is_empty() {
            return Ok(Some(format!("the index of the chunk at byte {} has its times wrong", segment.start)));
        }
        if tally.counts.iter().any(|&(channel, _)| !segment.may_hold(channel)) {
            return Ok(Some(format!(
                "the index of the chunk at byte {} leaves out a channel",
                segment.start
            )));
        }
    }
    if counts != contents.counts {
        let (told, got) = (contents.counts.values().sum::<u64>(), counts.values().sum::<u64>());
        return Ok(Some(format!("the index counts {told} messages, the log holds {got}")));
    }
    summary::check_data(source, summary)
}

fn open_by_scan(source: &Source, summary: Option<&Summary>, why: String) -> Result<Opened, LogError> {
    let Scanned { mut contents, lost } = scan(source, summary)?;
    let mut problems = Problems::default();
    problems.add(why);
    problems.append(std::mem::take(&mut contents.problems));
    contents.problems = problems;
    let count = contents.segments.len() as u32;
    Ok(Opened { contents, lost, recovered: true, scanned: (0..count).collect(), verified: count.into() })
}

/// First and last log time. The chunks' times are used, because the statistics of some writers are wrong: they treat a
/// start time of 0 as absent. If chunks do not say whether they have messages, the statistics are used.
fn times(catalog: &Catalog, segments: &[Segment], recovered: bool) -> (u64, u64) {
    let holding =
        || segments.iter().filter(|segment| segment.channels.as_ref().is_none_or(|held| !held.is_empty()));
    let first = holding().map(|segment| segment.first).min().unwrap_or(0);
    let last = holding().map(|segment| segment.last).max().unwrap_or(0);
    if let Some(statistics) = &catalog.statistics
        && statistics.message_count > 0
        && !recovered
        && segments.iter().any(|segment| segment.channels.is_none())
    {
        let start = statistics.message_start_time.clamp(first, last);
        return (start, statistics.message_end_time.clamp(start, last));
    }
    (first, last)
}

/// Number of messages that the message indexes from `at` on count.
fn indexed_behind(source: &Source, mut at: u64) -> Result<u64, LogError> {
    let mut window = Window::new(source, 4096);
    let mut sum = 0u64;
    loop {
        let front = window.get(at, PROBE)?;
        let body = &front[HEAD.min(front.len())..];
        let head = Head::read(front).filter(|head| head.op == op::MESSAGE_INDEX && head.plausible(body));
        let (Some(head), Some((_, count))) = (head, indexed_messages(body)) else { return Ok(sum) };
        sum = sum.saturating_add(count);
        at = at.saturating_add(head.length());
    }
}
