//! Looks up the log times of messages before a moment, for several sets of topics at once.
//!
//! The index is walked once for all of them, and a segment that several need is read once.

use crate::error::LogError;
use crate::find::is_indexed_for;
use crate::indexed::indexed;
use crate::info::TopicId;
use crate::log::Log;
use crate::segment::{MessageRef, Segment};
use rcs_msg::Stamp;
use std::collections::BTreeMap;

/// Greatest number of segments that [`Log::times_before`] looks up for one [`TimesOf`], and of bytes of the contents of
/// those without an index, which must be read; the first one is read whatever its size.
const LOOK_BACK: (usize, u64) = (64, 16 << 20);

/// The messages of some topics from `since` until before `before`, whose log times are looked up.
#[derive(Clone, Copy, Debug)]
pub struct TimesOf<'a> {
    /// The topics, each once.
    pub topics: &'a [TopicId],
    /// No message before this log time.
    pub since: Stamp,
    /// Only messages before this log time.
    pub before: Stamp,
}

/// What is read for a [`TimesOf`].
struct LookBack<'a> {
    wanted: TimesOf<'a>,
    /// The segments, from the latest backwards, and the size of the contents of those without an index.
    segments: Vec<u32>,
    bytes: u64,
    /// Time from which on they hold all of the messages.
    since: Stamp,
}

impl<'a> LookBack<'a> {
    fn new(wanted: TimesOf<'a>) -> Self {
        Self { wanted, segments: Vec::new(), bytes: 0, since: wanted.since }
    }

    /// Adds the next segment of those that begin before [`TimesOf::before`], from the latest backwards; `false` if no more
    /// are read.
    fn add(&mut self, index: u32, segment: &Segment, is_indexed: bool) -> bool {
        let (most, most_bytes) = LOOK_BACK;
        if segment.last < self.wanted.since.0 {
            return false;
        }
        if !is_indexed_for(segment, self.wanted.topics) {
            return true;
        }
        self.bytes = self.bytes.saturating_add(if is_indexed { 0 } else { segment.contents });
        if self.segments.len() == most || (self.bytes > most_bytes && !self.segments.is_empty()) {
            self.since = Stamp(segment.last).after_ns(1);
            return false;
        }
        self.segments.push(index);
        true
    }
}

impl Log {
    /// Log times of the messages of each of `wanted`, the newest first. If they are in many segments, only the newest of
    /// them: from [`Log::times_known_since`] on.
    pub fn times_before(&self, wanted: &[TimesOf<'_>]) -> Result<Vec<Vec<Stamp>>, LogError> {
        let found = self.look_back(wanted);
        // By segment and channel: for which of them its messages are looked up. The last segments are looked up last, so
        // that the cache has those that had to be read for whoever reads on.
        let mut readers: BTreeMap<u32, BTreeMap<u16, Vec<usize>>> = BTreeMap::new();
        for (number, of) in found.iter().enumerate() {
            for &segment in &of.segments {
                let of_segment = readers.entry(segment).or_default();
                for topic in of.wanted.topics {
                    of_segment.entry(topic.0).or_default().push(number);
                }
            }
        }
        let mut times = vec![Vec::new(); wanted.len()];
        for (segment, readers) in readers {
            for message in self.messages_in(segment, |channel| readers.contains_key(&channel))? {
                for &number in readers.get(&message.channel).into_iter().flatten() {
                    let LookBack { wanted, since, .. } = &found[number];
                    if (since.0..wanted.before.0).contains(&message.time) {
                        times[number].push(Stamp(message.time));
                    }
                }
            }
        }
        for times in &mut times {
            times.sort_unstable_by(|a, b| b.cmp(a));
        }
        Ok(times)
    }

    /// Times from which on [`Log::times_before`] gives the times of all messages of each of `wanted`: [`TimesOf::since`],
    /// or later. They follow from the index alone, and are not earlier for a later [`TimesOf::before`].
    pub fn times_known_since(&self, wanted: &[TimesOf<'_>]) -> Vec<Stamp> {
        self.look_back(wanted).iter().map(|found| found.since).collect()
    }

    /// The messages of a segment in the channels for which `wants` holds: by the index behind it, else by reading it. An
    /// index comes first, so that the result does not depend on what the cache has.
    fn messages_in(&self, index: u32, wants: impl Fn(u16) -> bool) -> Result<Vec<MessageRef>, LogError> {
        let inner = &*self.0;
        let segment = &inner.segments[index as usize];
        let found = indexed(&inner.source, &inner.parts, segment, &wants);
        if let Some(found) = found.inspect_err(|error| self.report_unreadable(index, error))? {
            return Ok(found);
        }
        let loaded = self.load(index)?;
        Ok(loaded.messages.iter().copied().filter(|message| wants(message.channel)).collect())
    }

    /// What [`Log::times_before`] reads for each of `wanted`.
    fn look_back<'a>(&self, wanted: &[TimesOf<'a>]) -> Vec<LookBack<'a>> {
        let mut found: Vec<LookBack<'a>> = wanted.iter().map(|wanted| LookBack::new(*wanted)).collect();
        // Those for which more segments are read, by `before`.
        let mut open: Vec<usize> = (0..wanted.len()).collect();
        open.sort_by_key(|&number| wanted[number].before);
        let Some(&latest) = open.last() else { return found };
        // The segments behind begin after all of them.
        let latest = wanted[latest].before.0;
        let count = self.0.first_behind.partition_point(|&first| first < latest);
        for &index in self.0.by_last[..count].iter().rev() {
            let segment = &self.0.segments[index as usize];
            // The index of a log that was scanned may lack what stands behind its chunks.
            let is_indexed = segment.chunk && segment.channels.is_some() && !self.info().recovered;
            let mut next = open.partition_point(|&number| wanted[number].before.0 <= segment.first);
            while let Some(&number) = open.get(next) {
                if found[number].add(index, segment, is_indexed) {
                    next += 1;
                } else {
                    open.remove(next);
                }
            }
            if open.is_empty() {
                break;
            }
        }
        found
    }
}
