//! Series: records in ascending order of time, which are only appended, with summaries of every 8, 64, 512, … records.
//!
//! The source's thread appends, and views read ranges at the same time: a [`Series`] is a shared reference together with
//! a length, so that it does not change while a view uses it, and a frame with a longer one costs nothing. The
//! summaries limit the work of a view to what it shows: [`Series::walk`] descends only where the view needs more detail.

use rcs_msg::Stamp;
use std::fmt;
use std::ops::{ControlFlow, Range};
use std::sync::{Arc, PoisonError, RwLock, RwLockReadGuard};

/// Number of records, or of summaries, in one summary.
const FAN: usize = 8;
/// Records in a chunk, which branches share.
const CHUNK: usize = 4096;

/// A record of a series.
pub trait Record: Copy + Send + Sync + 'static {
    /// Summary of consecutive records.
    type Summary: Copy + Send + Sync + 'static;

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
    /// Summaries of 8, 64, … records, of complete ones alone: an append costs little more than one summary.
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
            self.chunks.push(std::mem::take(&mut self.tail).into());
        }
    }

    /// Adds the summaries that are complete with the first `count` records.
    fn summarise(&mut self, count: usize) {
        let (mut level, mut size) = (1, FAN);
        while count.is_multiple_of(size) {
            let summary = self.joined(level, count / size - 1, count);
            if self.levels.len() < level {
                self.levels.push(Vec::new());
            }
            self.levels[level - 1].extend(summary);
            (level, size) = (level + 1, size * FAN);
        }
    }

    /// The summary of the parts of a node that are among the first `count` records; `None` if there are none.
    fn joined(&self, level: usize, node: usize, count: usize) -> Option<T::Summary> {
        let size = FAN.pow(level as u32 - 1);
        let parts = (node * FAN..(node + 1) * FAN).take_while(|part| part * size < count);
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

    /// What has been written up to now.
    pub fn read(&self) -> Series<T> {
        let len = self.0.read().unwrap_or_else(PoisonError::into_inner).len();
        Series { store: Arc::clone(&self.0), len }
    }

    /// A series of its own that begins with the records of this one up to and including `time`.
    #[must_use]
    pub fn fork(&self, time: Stamp) -> Self {
        let len = self.read().count_until(time);
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
        records.into_iter().for_each(|record| writer.append(record));
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
                    let size = FAN.pow(level as u32 + 1);
                    at.is_multiple_of(size) && at + size <= to
                };
                if let Some(level) = (0..store.levels.len()).take_while(fits).last() {
                    let size = FAN.pow(level as u32 + 1);
                    summary(&mut sum, &store.levels[level][at / size]);
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
            let more = open.iter().filter(|&&open| open).count() * (FAN - 1);
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
    let size = FAN.pow(level as u32);
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
    let size = FAN.pow(level as u32);
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
            let node = store.node(level, from / FAN.pow(level as u32), store.len());
            node.unwrap_or_else(|| first.summary())
        }
    };
    Part { summary, first, last, from, to }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a test may fail")]
mod tests {
    use super::*;

    #[derive(Clone, Copy, Debug, PartialEq)]
    struct Number(u64, i64);

    impl Record for Number {
        type Summary = (i64, i64);

        fn stamp(&self) -> Stamp {
            Stamp(self.0)
        }

        fn summary(&self) -> (i64, i64) {
            (self.1, self.1)
        }

        fn join(a: (i64, i64), b: (i64, i64)) -> (i64, i64) {
            (a.0.min(b.0), a.1.max(b.1))
        }
    }

    fn number(i: u64) -> Number {
        Number(i * 10, (i as i64 * 7919) % 1000)
    }

    fn series(count: u64) -> Series<Number> {
        (0..count).map(number).collect()
    }

    #[test]
    fn a_series_gives_back_its_records_by_index_and_by_time() {
        for count in [0, 1, 7, 8, 9, 64, 65, 4095, 4096, 4097, 10_000] {
            let series = series(count);
            assert_eq!(series.len() as u64, count);
            let mut read = Vec::new();
            series.each(0..usize::MAX, |record| read.push(*record));
            assert!(read.iter().copied().eq((0..count).map(number)), "{count}");
            assert_eq!(series.last(), count.checked_sub(1).map(number));
            assert_eq!(series.count_until(Stamp(0)) as u64, count.min(1));
            assert_eq!(series.count_until(Stamp(45)) as u64, count.min(5));
            assert_eq!(series.count_until(Stamp::MAX) as u64, count);
        }
    }

    #[test]
    fn the_parts_of_a_walk_are_the_range_in_order_and_their_summaries_are_right() {
        for (count, range) in
            [(1, 0..1), (9, 0..9), (700, 13..699), (10_000, 0..10_000), (10_000, 4090..9000)]
        {
            let series = series(count);
            // The reference: every record of a part.
            let reference = |part: &Part<Number>| {
                let records = (part.from..part.to).map(|index| series.get(index).unwrap().summary());
                records.reduce(Number::join).unwrap()
            };
            for wide in [0, 50, 900, 2000] {
                let mut next = range.start;
                series.walk(
                    range.clone(),
                    |part| part.summary.1 - part.summary.0 <= wide,
                    |part| {
                        assert_eq!(part.from, next);
                        assert_eq!(part.first, series.get(part.from).unwrap());
                        assert_eq!(part.last, series.get(part.to - 1).unwrap());
                        let (low, high) = reference(&part);
                        assert!(part.summary.0 <= low && part.summary.1 >= high);
                        assert!(part.is_record() || part.summary.1 - part.summary.0 <= wide);
                        let aligned = part.from % FAN == 0 && part.to % FAN == 0;
                        if aligned && part.to - part.from == FAN {
                            assert_eq!(part.summary, (low, high));
                        }
                        next = part.to;
                        ControlFlow::Continue(())
                    },
                );
                assert_eq!(next, range.end, "{count} {range:?} {wide}");
            }
        }
    }

    #[test]
    fn stretches_hold_exactly_their_records_whatever_their_lengths() {
        for (count, range) in
            [(0, 0..0), (1, 0..1), (700, 13..699), (10_000, 0..10_000), (10_000, 4090..9000)]
        {
            let series = series(count);
            for length in [1, 3, 8, 100, 1000, 20_000] {
                // Stretches of very different lengths: a third of them have one record.
                let key = |record: &Number| {
                    record.0 / 10 / length + u64::from(!(record.0 / 10).is_multiple_of(length))
                };
                let mut next = range.start;
                series.stretches(
                    range.clone(),
                    key,
                    |sum: &mut Vec<(i64, i64)>, record| sum.push(record.summary()),
                    |sum, summary| sum.push(*summary),
                    |stretch| {
                        let records: Vec<Number> =
                            (next..next + stretch.count).map(|index| series.get(index).unwrap()).collect();
                        assert!(records.iter().all(|record| key(record) == stretch.key));
                        assert_eq!(records.first(), Some(&stretch.first));
                        assert_eq!(records.last(), Some(&stretch.last));
                        let wanted = records.iter().map(Record::summary).reduce(Number::join);
                        assert_eq!(stretch.sum.iter().copied().reduce(Number::join), wanted);
                        assert!(stretch.sum.len() <= 70, "{} pieces", stretch.sum.len());
                        next += stretch.count;
                        assert!(next >= range.end || key(&series.get(next).unwrap()) != stretch.key);
                    },
                );
                assert_eq!(next, range.end, "{count} {range:?} {length}");
            }
        }
    }

    #[test]
    fn parts_are_no_more_than_wanted_however_long_the_series_is() {
        for count in [10, 1000, 100_000] {
            let series = series(count);
            for most in [8, 100, 5000] {
                let parts = series.parts(0..usize::MAX, most, |_| false);
                assert!(parts.len() <= most, "{} of {count}", parts.len());
                assert!(parts.len() * FAN >= most.min(count as usize), "{} of {count}", parts.len());
                assert!(parts.windows(2).all(|pair| pair[0].to == pair[1].from));
                assert_eq!(parts.last().unwrap().to as u64, count);
            }
        }
    }

    #[test]
    fn a_reader_sees_what_was_there_when_it_began_and_a_fork_what_both_share() {
        let writer = SeriesWriter::default();
        (0..5000).map(number).for_each(|record| writer.push(record));
        let before = writer.read();
        let fork = writer.fork(Stamp(number(4200).0));
        (4201..9000).for_each(|i| fork.push(Number(i * 10, -1_000_000)));
        (5000..6000).map(number).for_each(|record| writer.push(record));
        writer.push(Number(3, 0));
        assert_eq!((before.len(), writer.read().len(), fork.read().len()), (5000, 6000, 9000));
        let fork = fork.read();
        assert_eq!((fork.get(4200), fork.get(4201).unwrap().1), (Some(number(4200)), -1_000_000));
        assert_eq!(writer.read().get(4201), Some(number(4201)), "the other run is whole");
        let mut least = 0;
        writer.read().walk(
            0..usize::MAX,
            |_| true,
            |part| {
                least = least.min(part.summary.0);
                ControlFlow::Continue(())
            },
        );
        assert_eq!(least, 0, "and so are its summaries");
        assert!(before.same(&writer.read()) && !before.same(&fork));
    }
}
