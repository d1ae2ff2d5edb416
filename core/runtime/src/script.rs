//! What a recorded run did, in a form that the stepped executor can repeat.
//!
//! For a stepped run this is its journal, each event with the number of events before it: [`Repeated`]. For a live run
//! it is its cycles and its journal, each with its own time: [`Script`]. These times are unique, so the time of the
//! last event determines the position of the run. A snapshot holds the next cycle and the next event in its queue, and
//! nothing of what follows them.

use crate::error::RunError;
use crate::journal::{ExternalEvent, Journal};
use rcs_msg::Stamp;

/// One cycle of a recorded schedule.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ScheduledCycle {
    /// Index of the process in the plan.
    pub(crate) node: usize,
    /// When it captured its inputs.
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

    /// When the output of the cycle that started at that time becomes visible.
    pub(crate) fn end_of(&self, start: Stamp) -> Stamp {
        let at = self.cycles.partition_point(|cycle| cycle.start < start);
        self.cycles.get(at).map_or(start, |cycle| cycle.end)
    }

    /// The first cycle that starts later than that time.
    pub(crate) fn cycle_after(&self, time: Stamp) -> Option<ScheduledCycle> {
        self.cycles.get(self.cycles.partition_point(|cycle| cycle.start <= time)).copied()
    }

    /// The event that was accepted at that time.
    pub(crate) fn event_at(&self, time: Stamp) -> Option<&ExternalEvent> {
        let events = self.journal.events();
        events.get(events.partition_point(|event| event.place.time < time))
    }

    /// When the first event after that time was accepted.
    pub(crate) fn event_after(&self, time: Stamp) -> Option<Stamp> {
        let events = self.journal.events();
        events.get(events.partition_point(|event| event.place.time <= time)).map(|event| event.place.time)
    }
}

/// The journal of a stepped run, for repeating it.
#[derive(Default)]
pub(crate) struct Repeated {
    journal: Journal,
    /// How many journalled events have been accepted when this many events of the run have been executed. It differs
    /// after a run has gone back, or forward by a snapshot.
    taken: (usize, u64),
}

/// An event that was accepted in the recorded run and is refused now.
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

    /// Called when the run has been moved, perhaps to a point with the same number of events.
    pub(crate) fn rewind(&mut self) {
        self.taken = (0, u64::MAX);
    }

    /// The next journalled event for the point at which this many events of the run have been executed.
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
