//! Series: records in ascending order of time, which are only appended, with summaries of every 8, 64, 512, … records (or
//! of every 32, 256, …, where summaries are large).
//!
//! The source's thread appends, and views read ranges at the same time: a [`Series`] is a shared reference together with
//! a length, so that it does not change while a view uses it, and a frame with a longer one costs nothing. The
//! summaries limit the work of a view to what it shows: [`Series::walk`] descends only where the view needs more detail.

use rcs_msg::Stamp;
use std::fmt;
use std::ops::{ControlFlow, Range};
use std::sync::{Arc, PoisonError, RwLock, RwLockReadGuard};

/// Number of summaries in one of the next level.
const FAN: usize = 8;
/// Records in a chunk, which branches share.
const CHUNK: usize = 4096;

/// A record of a series.
pub trait Record: Copy + Send + Sync + 'static {
    /// Summary of consecutive records.
    type Summary: Copy + Send + Sync + 'static;

    /// Number of records in a summary of the first level: more of them need less memory for summaries.
    const FIRST: usize = FAN;

    /// When it was made.
    fn stamp(&self) -> Stamp;

    /// Summary of this record alone.
    fn summary(&self) -> Self::Summary;

    /// Summary of two consecutive parts.
    fn join(a: Self::Summary, b: Self::Summary) -> Self::Summary;
}

struct Store<T: Record> {
    /// Complete chunks.
    chunks: Vec<Arc<[T]>>,
    /// The records after them.
    tail: Vec<T>,
    /// Summaries of [`Record::FIRST`], eight times as many, … records, of complete ones alone: an append costs little
    /// more than one summary.
    levels: Vec<Vec<T::Summary>>,
}

impl<T: Record> Default for Store<T> {
    fn default() -> Self {
        Self { chunks: Vec::new(), tail: Vec::new(), levels: Vec::new() }
    }
}

impl<T: Record> Store<T> {
    fn len(&self) -> usize {
        self.chunks.len() * CHUNK + self.tail.len()
    }

    fn get(&self, index: usize) -> &T {
        match self.chunks.get(index / CHUNK) {
            Some(chunk) => &chunk[index % CHUNK],
            None => &self.tail[index % CHUNK],
        }
    }

    fn push(&mut self, record: T) {
        self.tail.push(record);
        self.summarise(self.len());
        if self.tail.len() == CHUNK {
            self.chunks.push(self.tail.as_slice().into());
            self.tail.clear();
        }
    }

    /// Number of records in a node of a level; a node of level 0 is a record.
    fn size(level: usize) -> usize {
        level.checked_sub(1).map_or(1, |above| T::FIRST * FAN.pow(above as u32))
    }

    /// Number of nodes of the level below in a node of this one.
    fn fan(level: usize) -> usize {
        if level == 1 { T::FIRST } else { FAN }
    }

    /// Adds the summaries that are complete with the first `count` records.
    fn summarise(&mut self, count: usize) {
        let mut level = 1;
        while count.is_multiple_of(Self::size(level)) {
            let summary = self.joined(level, count / Self::size(level) - 1, count);
            if self.levels.len() < level {
                self.levels.push(Vec::new());
            }
            self.levels[level - 1].extend(summary);
            level += 1;
        }
    }

    /// The summary of the parts of a node that are among the first `count` records; `None` if there are none.
    fn joined(&self, level: usize, node: usize, count: usize) -> Option<T::Summary> {
        let (size, fan) = (Self::size(level - 1), Self::fan(level));
        let parts = (node * fan..(node + 1) * fan).take_while(|part| part * size < count);
        parts.map(|part| self.node(level - 1, part, count)).reduce(|a, b| Some(T::join(a?, b?))).flatten()
    }

    /// The summary of a node of which some of the first `count` records are part; a node of level 0 is a record.
    fn node(&self, level: usize, node: usize, count: usize) -> Option<T::Summary> {
        let Some(below) = level.checked_sub(1) else { return Some(self.get(node).summary()) };
        let complete = self.levels.get(below).and_then(|level| level.get(node)).copied();
        complete.or_else(|| self.joined(level, node, count))
    }

    /// The first `len` records; complete chunks are shared.
    fn first(&self, len: usize) -> Self {
        let mut first = Self { chunks: self.chunks[..len / CHUNK].to_vec(), ..Self::default() };
        first.tail = (first.chunks.len() * CHUNK..len).map(|index| *self.get(index)).collect();
        for count in 1..=len {
            first.summarise(count);
        }
        first
    }
}

/// The writing end of a series.
pub struct SeriesWriter<T: Record>(Arc<RwLock<Store<T>>>);

impl<T: Record> Default for SeriesWriter<T> {
    fn default() -> Self {
        Self(Arc::default())
    }
}

impl<T: Record> SeriesWriter<T> {
    /// Appends a record. One that is not later than the last one is left out, because a part of a run that is executed
    /// again adds nothing.
    pub fn push(&self, record: T) {
        let mut store = self.0.write().unwrap_or_else(PoisonError::into_inner);
        let len = store.len();
        if len == 0 || record.stamp() > store.get(len - 1).stamp() {
            store.push(record);
        }
    }

    /// Appends a record whose time may be that of the last one; one that is earlier is left out. For what sees every
    /// message once.
    pub fn append(&self, record: T) {
        let mut store = self.0.write().unwrap_or_else(PoisonError::into_inner);
        let len = store.len();
        if len == 0 || record.stamp() >= store.get(len - 1).stamp() {
            store.push(record);
        }
    }

    /// Appends records in the manner of [`SeriesWriter::append`].
    pub fn append_all(&self, records: impl IntoIterator<Item = T>) {
        let mut store = self.0.write().unwrap_or_else(PoisonError::into_inner);
        let mut last = store.len().checked_sub(1).map(|index| store.get(index).stamp());
        for record in records {
            if last.is_none_or(|last| record.stamp() >= last) {
                last = Some(record.stamp());
                store.push(record);
            }
        }
    }

    /// What has been written up to now.
    pub fn read(&self) -> Series<T> {
        let len = self.0.read().unwrap_or_else(PoisonError::into_inner).len();
        Series { store: Arc::clone(&self.0), len }
    }

    /// A series of its own that begins with the records of this one up to and including `time`.
    #[must_use]
    pub fn fork(&self, time: Stamp) -> Self {
        self.fork_first(self.read().count_until(time))
    }

    /// A series of its own that begins with the first `len` records of this one.
    #[must_use]
    pub fn fork_first(&self, len: usize) -> Self {
        let len = len.min(self.read().len());
        let store = self.0.read().unwrap_or_else(PoisonError::into_inner).first(len);
        Self(Arc::new(RwLock::new(store)))
    }
}

/// A series up to a certain record, which does not change while others are appended.
pub struct Series<T: Record> {
    store: Arc<RwLock<Store<T>>>,
    len: usize,
}

impl<T: Record> Default for Series<T> {
    fn default() -> Self {
        SeriesWriter::default().read()
    }
}

impl<T: Record> Clone for Series<T> {
    fn clone(&self) -> Self {
        Self { store: Arc::clone(&self.store), len: self.len }
    }
}

impl<T: Record> fmt::Debug for Series<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Series of {} records", self.len)
    }
}

impl<T: Record> FromIterator<T> for Series<T> {
    fn from_iter<I: IntoIterator<Item = T>>(records: I) -> Self {
        let writer = SeriesWriter::default();
        writer.append_all(records);
        writer.read()
    }
}

/// Consecutive records with the same key.
#[derive(Clone, Copy, Debug)]
pub struct Stretch<T, K, A> {
    /// Their key.
    pub key: K,
    /// The first record.
    pub first: T,
    /// The last record.
    pub last: T,
    /// Number of records.
    pub count: usize,
    /// What was gathered of them.
    pub sum: A,
}

/// A part of a series that [`Series::pieces`] gives.
#[derive(Clone, Copy, Debug)]
pub enum Piece<'a, T: Record> {
    /// A record.
    Record(&'a T),
    /// The summary of so many records.
    Summary(&'a T::Summary, usize),
}

/// A part of a series.
#[derive(Clone, Copy, Debug)]
pub struct Part<T: Record> {
    /// Its summary. That of the last part of a series may include records that were appended later.
    pub summary: T::Summary,
    /// Its first record.
    pub first: T,
    /// Its last record.
    pub last: T,
    /// The indices of its records.
    pub from: usize,
    /// One after the last index.
    pub to: usize,
}

impl<T: Record> Part<T> {
    /// Whether it is a single record.
    pub fn is_record(&self) -> bool {
        self.to - self.from == 1
    }
}

impl<T: Record> Series<T> {
    /// Number of records.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether there is no record.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Whether both have the same records, apart from what was appended to one of them.
    pub fn same(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.store, &other.store)
    }

    fn store(&self) -> RwLockReadGuard<'_, Store<T>> {
        self.store.read().unwrap_or_else(PoisonError::into_inner)
    }

    /// A record.
    pub fn get(&self, index: usize) -> Option<T> {
        (index < self.len).then(|| *self.store().get(index))
    }

    /// The last record.
    pub fn last(&self) -> Option<T> {
        self.get(self.len.checked_sub(1)?)
    }

    /// Number of records up to and including a time: the index of the first later one.
    pub fn count_until(&self, time: Stamp) -> usize {
        let store = self.store();
        let (mut low, mut high) = (0, self.len);
        while low < high {
            let middle = usize::midpoint(low, high);
            if store.get(middle).stamp() <= time { low = middle + 1 } else { high = middle }
        }
        low
    }

    /// Number of records before a time: the index of the first one that is not earlier.
    pub fn count_before(&self, time: Stamp) -> usize {
        time.0.checked_sub(1).map_or(0, |before| self.count_until(Stamp(before)))
    }

    /// Calls `take` for the records of a range in order. Other threads cannot append meanwhile, so the range should be
    /// short.
    pub fn each(&self, range: Range<usize>, take: impl FnMut(&T)) {
        let store = self.store();
        (range.start..range.end.min(self.len)).map(|index| store.get(index)).for_each(take);
    }

    /// At most `most` records, at equal distances.
    pub fn sample(&self, most: usize) -> Vec<T> {
        let store = self.store();
        let count = self.len.min(most);
        (0..count).map(|i| *store.get(i * self.len / count)).collect()
    }

    /// Divides a range into parts, in order: into as few as possible of which `is_fine` accepts every one that has more
    /// than one record, until `take` breaks. The work is proportional to the number of parts.
    pub fn walk(
        &self,
        range: Range<usize>,
        mut is_fine: impl FnMut(&Part<T>) -> bool,
        mut take: impl FnMut(Part<T>) -> ControlFlow<()>,
    ) {
        let store = self.store();
        let mut open = top(&store, &(range.start..range.end.min(self.len)));
        while let Some((level, part)) = open.pop() {
            if part.is_record() || is_fine(&part) {
                if take(part).is_break() {
                    return;
                }
            } else {
                open.extend(children(&store, level, part).rev());
            }
        }
    }

    /// Divides a range where the key changes, which must not decrease, and gathers every stretch exactly: from the
    /// summaries that lie within it and from the records at its ends. The work is proportional to the number of
    /// stretches, and less than that of [`Series::walk`] with as many parts: an end is searched beside the one that a
    /// stretch as long as the last one would have.
    pub fn stretches<K: PartialEq, A: Default>(
        &self,
        range: Range<usize>,
        key: impl Fn(&T) -> K,
        mut record: impl FnMut(&mut A, &T),
        mut summary: impl FnMut(&mut A, &T::Summary),
        mut take: impl FnMut(Stretch<T, K, A>),
    ) {
        let store = self.store();
        let (mut from, end, mut count) = (range.start, range.end.min(self.len), 1);
        while from < end {
            let first = *store.get(from);
            let of = key(&first);
            let to = end_of(from, end, count, |index| key(store.get(index)) == of);
            let mut sum = A::default();
            let mut at = from;
            while at < to {
                // The greatest node that begins here and ends within the stretch.
                let fits = |&level: &usize| {
                    let size = Store::<T>::size(level);
                    at.is_multiple_of(size) && at + size <= to
                };
                if let Some(level) = (1..=store.levels.len()).take_while(fits).last() {
                    let size = Store::<T>::size(level);
                    summary(&mut sum, &store.levels[level - 1][at / size]);
                    at += size;
                } else {
                    record(&mut sum, store.get(at));
                    at += 1;
                }
            }
            count = to - from;
            take(Stretch { key: of, first, last: *store.get(to - 1), count, sum });
            from = to;
        }
    }

    /// Divides a range into records and summaries, in order: into the greatest summaries that `is_fine` accepts, beginning
    /// at each place with those of the size of the last one. It reads nothing but what it gives, so it is faster than
    /// [`Series::walk`].
    pub fn pieces(
        &self,
        range: Range<usize>,
        is_fine: impl Fn(&T::Summary) -> bool,
        mut take: impl FnMut(Piece<'_, T>),
    ) {
        let store = self.store();
        let (mut at, end, mut level) = (range.start, range.end.min(self.len), 0);
        let node = |level: usize, at: usize| {
            let size = Store::<T>::size(level);
            let fits = at.is_multiple_of(size) && at + size <= end;
            let summary = store.levels.get(level - 1).filter(|_| fits)?.get(at / size)?;
            is_fine(summary).then_some((summary, size))
        };
        while at < end {
            let mut found = None;
            while let Some(greater) = node(level + 1, at) {
                (found, level) = (Some(greater), level + 1);
            }
            while found.is_none() && level > 0 {
                found = node(level, at);
                level -= usize::from(found.is_none());
            }
            if let Some((summary, size)) = found {
                take(Piece::Summary(summary, size));
                at += size;
            } else {
                take(Piece::Record(store.get(at)));
                at += 1;
            }
        }
    }

    /// Divides a range into parts, as [`Series::walk`] does, but into at most `most` (and at least one in eight of
    /// them, if finer ones are wanted): the finest level at which all of them fit is used everywhere.
    pub fn parts(
        &self,
        range: Range<usize>,
        most: usize,
        mut is_fine: impl FnMut(&Part<T>) -> bool,
    ) -> Vec<Part<T>> {
        let store = self.store();
        let mut parts = top(&store, &(range.start..range.end.min(self.len)));
        parts.reverse();
        for level in (0..=store.levels.len()).rev() {
            let is_open = |(at, part): &(usize, Part<T>), is_fine: &mut dyn FnMut(&Part<T>) -> bool| {
                *at == level && !part.is_record() && !is_fine(part)
            };
            let open: Vec<bool> = parts.iter().map(|part| is_open(part, &mut is_fine)).collect();
            if level == 0 {
                break;
            }
            let more = open.iter().filter(|&&open| open).count() * (Store::<T>::fan(level) - 1);
            if parts.len() + more > most.max(FAN) {
                break;
            }
            if more == 0 {
                continue;
            }
            let mut finer = Vec::with_capacity(parts.len() + more);
            for ((at, part), open) in parts.into_iter().zip(open) {
                if open { finer.extend(children(&store, at, part)) } else { finer.push((at, part)) }
            }
            parts = finer;
        }
        parts.into_iter().map(|(_, part)| part).collect()
    }
}

/// The end of the stretch of records that begins at `from`, at most `end`: near `from + guess`, if the guess is good.
fn end_of(from: usize, end: usize, guess: usize, belongs: impl Fn(usize) -> bool) -> usize {
    // Below `low` every record belongs to it; the one at `high` does not, or is the end.
    let (mut low, mut high) = (from + 1, end);
    let mut step = 1;
    let mut probe = (from + guess).clamp(low, end);
    while probe < high && probe >= low {
        if belongs(probe) {
            low = probe + 1;
            probe = low + step;
        } else {
            high = probe;
            probe = high.saturating_sub(step);
        }
        step *= 2;
    }
    while low < high {
        let middle = usize::midpoint(low, high);
        if belongs(middle) { low = middle + 1 } else { high = middle }
    }
    low
}

/// The parts of the highest level in a range, last first, with their level: level `n` has parts of `FAN^n` records.
fn top<T: Record>(store: &Store<T>, range: &Range<usize>) -> Vec<(usize, Part<T>)> {
    if range.is_empty() {
        return Vec::new();
    }
    let level = store.levels.len();
    let size = Store::<T>::size(level);
    let nodes = range.start / size..=(range.end - 1) / size;
    let parts = nodes.map(|node| {
        let (from, to) = ((node * size).max(range.start), ((node + 1) * size).min(range.end));
        (level, part(store, level, from, to))
    });
    let mut parts: Vec<_> = parts.collect();
    parts.reverse();
    parts
}

/// The parts of the next lower level.
fn children<T: Record>(
    store: &Store<T>,
    level: usize,
    whole: Part<T>,
) -> impl DoubleEndedIterator<Item = (usize, Part<T>)> + '_ {
    let level = level - 1;
    let size = Store::<T>::size(level);
    (whole.from / size..=(whole.to - 1) / size).map(move |node| {
        let (from, to) = ((node * size).max(whole.from), ((node + 1) * size).min(whole.to));
        (level, part(store, level, from, to))
    })
}

fn part<T: Record>(store: &Store<T>, level: usize, from: usize, to: usize) -> Part<T> {
    let (first, last) = (*store.get(from), *store.get(to - 1));
    let summary = match level {
        // A part that the range cuts down to one record is judged by that record, not by its whole node.
        _ if to == from + 1 => first.summary(),
        0 => first.summary(),
        level => {
            let node = store.node(level, from / Store::<T>::size(level), store.len());
            node.unwrap_or_else(|| first.summary())
        }
    };
    Part { summary, first, last, from, to }
}

#[cfg(test)]
#[path = "series_tests.rs"]
mod tests;
