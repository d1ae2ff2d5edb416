//! The runs of a session: each branches from another one, and none is ever deleted.

use super::samples::Point;
use super::stretch::Stretch;
use crate::journal::Journal;
use crate::snapshot::Snapshot;
use rcs_msg::Stamp;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// A run of a session, in the order in which they began; the first is 0.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct RunId(pub u32);

impl std::fmt::Display for RunId {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "run {}", self.0)
    }
}

/// A moment: a run, the number of events executed in it, and the number of external writes after the last of them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Moment {
    /// The run.
    pub run: RunId,
    /// Number of events executed.
    pub event: u64,
    /// Number of writes since the last event.
    pub write: u32,
}

/// Description of a run for the operator.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RunSummary {
    /// The run.
    pub id: RunId,
    /// The run that it branched from, and when; `None` for the first.
    pub branched_from: Option<(Moment, Stamp)>,
    /// Time of its end.
    pub end: Stamp,
    /// Number of events, including those that it shares with the run that it branched from.
    pub events: u64,
    /// Number of external writes.
    pub writes: usize,
}

/// One run.
pub(super) struct Run {
    pub(super) branched_from: Option<(usize, Point, Stamp)>,
    /// Its stretches, ascending; those before the branch point are shared with the run that it branched from.
    pub(super) line: Vec<usize>,
    /// Its journal.
    pub(super) journal: Journal,
    /// Time of its end.
    pub(super) end: Point,
    pub(super) end_time: Stamp,
    /// The state of the run at its end, while the machine is elsewhere.
    pub(super) head: Option<Arc<Snapshot>>,
}

impl Run {
    /// Number of writes between that event and the next one.
    pub(super) fn writes_at(&self, event: u64) -> u32 {
        (self.journal.up_to(event) - self.journal.before(event)) as u32
    }

    /// The point after an event and every write that follows it.
    pub(super) fn settled(&self, event: u64) -> Point {
        Point { event, write: self.writes_at(event) }
    }

    /// Number of writes up to a point.
    pub(super) fn writes_done(&self, at: Point) -> usize {
        self.journal.before(at.event) + at.write as usize
    }

    /// Index in `line` of the stretch that contains a point.
    pub(super) fn place_of(&self, stretches: &[Stretch], event: u64) -> usize {
        self.line.partition_point(|&stretch| stretches[stretch].from <= event).saturating_sub(1)
    }
}
