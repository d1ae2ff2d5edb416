//! What a recorded run did, for the stepped executor to do it again.
//!
//! Of a stepped run that is its journal, each event after so many events of the run: [`Repeated`]. Of a live run it is its
//! cycles and its journal, each at its own time: [`Script`]. No two of these have one time, so that the time of the last event says where the run stands: a snapshot holds the next
//! cycle and the next event in its queue, and nothing of what comes after them.

use crate::error::RunError;
use crate::journal::{ExternalEvent, Journal};
use rcs_msg::Stamp;

/// One cycle of a recorded schedule.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ScheduledCycle {
    /// Place of the process in the plan.
    pub(crate) node: usize,
    /// When it took its inputs.
    pub(crate) start: Stamp,
    /// When its output became visible.
    pub(crate) end: Stamp,
}

/// The cycles and the journal of a live run.
pub(crate) struct Script {
    cycles: Vec<ScheduledCycle>,
    journal: Journal,
}

impl Script {
    pub(crate) fn new(mut cycles: Vec<ScheduledCycle>, journal: Journal) -> Self {
        cycles.sort_by_key(|cycle| cycle.start);
        Self { cycles, journal }
    }

    /// When the output of the cycle becomes visible that started at that time.
    pub(crate) fn end_of(&self, start: Stamp) -> Stamp {
        let at = self.cycles.partition_point(|cycle| cycle.start < start);
        self.cycles.get(at).map_or(start, |cycle| cycle.end)
    }

    /// The first cycle that starts later than that time.
    pub(crate) fn cycle_after(&self, time: Stamp) -> Option<ScheduledCycle> {
        self.cycles.get(self.cycles.partition_point(|cycle| cycle.start <= time)).copied()
    }

    /// The event that was taken at that time.
    pub(crate) fn event_at(&self, time: Stamp) -> Option<&ExternalEvent> {
        let events = self.journal.events();
        events.get(events.partition_point(|event| event.place.time < time))
    }

    /// When the first event after that time was taken.
    pub(crate) fn event_after(&self, time: Stamp) -> Option<Stamp> {
        let events = self.journal.events();
        events.get(events.partition_point(|event| event.place.time <= time)).map(|event| event.place.time)
    }
}

/// The journal of a stepped run, taken again.
#[derive(Default)]
pub(crate) struct Repeated {
    journal: Journal,
    /// How many events have been taken when so many events of the run had been done. A run that has gone back, or
    /// forward by a snapshot, stands elsewhere.
    taken: (usize, u64),
}

/// An event that was taken when it was recorded, and is refused now.
#[derive(Debug, thiserror::Error)]
#[error("the recorded event for {buffer} is refused: {error}")]
pub(crate) struct Refused {
    pub(crate) buffer: String,
    pub(crate) time: Stamp,
    pub(crate) error: RunError,
}

impl Repeated {
    pub(crate) fn new(journal: Journal) -> Self {
        Self { journal, taken: (0, 0) }
    }

    /// The run stands elsewhere, perhaps where so many events have been done as before.
    pub(crate) fn rewind(&mut self) {
        self.taken = (0, u64::MAX);
    }

    /// The next event that was taken when so many events of the run had been done.
    pub(crate) fn next_at(&mut self, events: u64) -> Option<ExternalEvent> {
        if self.journal.is_empty() {
            return None;
        }
        if self.taken.1 != events {
            self.taken = (self.journal.before(events), events);
        }
        let event = self.journal.events().get(self.taken.0)?;
        if event.place.events > events {
            return None;
        }
        self.taken.0 += 1;
        Some(event.clone())
    }
}
