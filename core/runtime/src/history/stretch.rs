//! One stretch of a run, about a second: its events, its messages, and a snapshot at its start.

use super::pack::{PackedSamples, PackedSnapshot};
use super::samples::{Point, Samples};
use crate::snapshot::Snapshot;
use crate::stepped::Happened;
use rcs_msg::Stamp;
use std::sync::Arc;

/// A value in memory, on disk, both, or neither.
pub(crate) struct Kept<T, P> {
    pub(crate) memory: Option<Arc<T>>,
    pub(crate) disk: Option<Arc<P>>,
    /// Whether it is being written to disk.
    pub(crate) pending: bool,
}

impl<T, P> Kept<T, P> {
    pub(crate) fn none() -> Self {
        Self { memory: None, disk: None, pending: false }
    }

    pub(crate) fn is_kept(&self) -> bool {
        self.memory.is_some() || self.disk.is_some()
    }

    /// The same value, for another stretch.
    fn share(&self) -> Self {
        Self { memory: self.memory.clone(), disk: self.disk.clone(), pending: false }
    }
}

/// Kind and time of one event, in 10 bytes.
#[derive(Default, Clone)]
struct Marks {
    times: Vec<Stamp>,
    what: Vec<u16>,
}

/// One stretch of a run.
pub(crate) struct Stretch {
    /// The run in which it was executed.
    pub(crate) run: usize,
    /// Number of events before it.
    pub(crate) from: u64,
    /// Time of its start.
    pub(crate) start: Stamp,
    marks: Marks,
    /// Sequence of the newest message of each buffer at its start.
    pub(crate) newest: Vec<u64>,
    /// Positions at which each buffer was written: event less `from`, and write. Empty until the stretch has ended.
    index: Vec<Vec<(u32, u32)>>,
    pub(crate) snapshot: Kept<Snapshot, PackedSnapshot>,
    pub(crate) samples: Kept<Samples, PackedSamples>,
    /// Approximate memory of its samples when they are loaded.
    pub(crate) bytes: usize,
}

impl Stretch {
    /// A stretch that begins here.
    pub(crate) fn begin(run: usize, snapshot: Arc<Snapshot>) -> Self {
        Self {
            run,
            from: snapshot.events,
            start: snapshot.now,
            marks: Marks::default(),
            newest: snapshot.newest(),
            index: Vec::new(),
            snapshot: Kept { memory: Some(snapshot), ..Kept::none() },
            samples: Kept::none(),
            bytes: 0,
        }
    }

    /// The same stretch in another run, which differs from `events` events on.
    pub(crate) fn fork(&self, run: usize, events: u64) -> Self {
        let done = (events - self.from) as usize;
        let (times, what) = (&self.marks.times, &self.marks.what);
        let cut = done.min(times.len());
        Self {
            run,
            from: self.from,
            start: self.start,
            marks: Marks { times: times[..cut].to_vec(), what: what[..cut].to_vec() },
            newest: self.newest.clone(),
            index: Vec::new(),
            snapshot: self.snapshot.share(),
            samples: Kept::none(),
            bytes: 0,
        }
    }

    /// Number of events in it.
    pub(crate) fn len(&self) -> u64 {
        self.marks.times.len() as u64
    }

    /// Number of events up to its end.
    pub(crate) fn to(&self) -> u64 {
        self.from + self.len()
    }

    /// Records an event.
    pub(crate) fn mark(&mut self, time: Stamp, what: Happened) {
        let what = match what {
            Happened::Input => 0,
            Happened::Written => 1,
            Happened::Fault => 2,
            Happened::Started(process) => 3 + 2 * process,
            Happened::Cycle(process) => 4 + 2 * process,
        };
        self.marks.times.push(time);
        self.marks.what.push(what as u16);
    }

    /// An event, by the number of events up to and including it.
    fn what(&self, event: u64) -> Happened {
        match self.marks.what[(event - self.from - 1) as usize] {
            0 => Happened::Input,
            1 => Happened::Written,
            2 => Happened::Fault,
            other if other % 2 == 1 => Happened::Started(usize::from(other - 3) / 2),
            other => Happened::Cycle(usize::from(other - 4) / 2),
        }
    }

    /// Time of an event.
    pub(crate) fn time_of(&self, event: u64) -> Stamp {
        let index = event.checked_sub(self.from + 1).map(|index| index as usize);
        index.and_then(|index| self.marks.times.get(index)).copied().unwrap_or(self.start)
    }

    /// Number of events up to that time.
    pub(crate) fn events_at(&self, time: Stamp) -> u64 {
        self.from + self.marks.times.partition_point(|&mark| mark <= time) as u64
    }

    /// The last event before `before` that is wanted.
    pub(crate) fn event_before(
        &self,
        before: u64,
        is_wanted: &mut dyn FnMut(Happened) -> bool,
    ) -> Option<u64> {
        let last = before.saturating_sub(1).min(self.to());
        (self.from + 1..=last).rev().find(|&event| is_wanted(self.what(event)))
    }

    /// The first event after `after` that is wanted.
    pub(crate) fn event_after(&self, after: u64, is_wanted: &mut dyn FnMut(Happened) -> bool) -> Option<u64> {
        (after.max(self.from) + 1..=self.to()).find(|&event| is_wanted(self.what(event)))
    }

    /// Records the positions at which buffers were written: the stretch has ended.
    pub(crate) fn set_index(&mut self, samples: &Samples) {
        let place = |point: Point| ((point.event.saturating_sub(self.from)) as u32, point.write);
        let list = |written: &Vec<super::samples::Entry>| {
            written.iter().map(|entry| place(entry.point)).collect::<Vec<_>>()
        };
        self.index = samples.written.iter().map(list).collect();
        self.bytes = samples.bytes();
    }

    /// Positions at which a buffer was written, ascending.
    fn points(&self, buffer: usize) -> impl DoubleEndedIterator<Item = Point> + ExactSizeIterator + '_ {
        let list = self.index.get(buffer).map_or(&[][..], Vec::as_slice);
        list.iter().map(|&(event, write)| Point { event: self.from + u64::from(event), write })
    }

    /// The last position before `before` at which a buffer was written.
    pub(crate) fn written_before(&self, buffer: usize, before: Point) -> Option<Point> {
        self.points(buffer).rev().find(|&point| point < before)
    }

    /// The first position after `after` at which a buffer was written.
    pub(crate) fn written_after(&self, buffer: usize, after: Point) -> Option<Point> {
        self.points(buffer).find(|&point| point > after)
    }

    /// The position at which the message with this index, from 0, was written to a buffer in the stretch.
    pub(crate) fn written_nth(&self, buffer: usize, index: usize) -> Option<Point> {
        self.points(buffer).nth(index)
    }

    /// Number of messages that had been written to a buffer at a point.
    pub(crate) fn messages(&self, buffer: usize, at: Point) -> u64 {
        let before = self.newest.get(buffer).copied().unwrap_or(0);
        before + self.points(buffer).take_while(|&point| point <= at).count() as u64
    }

    /// Approximate memory without its samples and its snapshot.
    pub(crate) fn fixed_bytes(&self) -> usize {
        let marks = self.marks.times.len() * 10;
        let index: usize = self.index.iter().map(|list| 24 + 8 * list.len()).sum();
        size_of::<Self>() + marks + index + 8 * self.newest.len()
    }
}
