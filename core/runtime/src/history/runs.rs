//! The runs of a session: each goes on from a point of another, and none is ever destroyed.

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

/// A moment: a run, how many of its events had been done, and how many writes from outside behind the last of them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Moment {
    /// The run.
    pub run: RunId,
    /// Events that had been done.
    pub event: u64,
    /// Writes that had been done since the last of them.
    pub write: u32,
}

/// What a person may know of a run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RunSummary {
    /// The run.
    pub id: RunId,
    /// Where it left another run, and when; `None` for the first.
    pub branched_from: Option<(Moment, Stamp)>,
    /// How far it has got.
    pub end: Stamp,
    /// Events that were done in it, those that it shares with the run that it left among them.
    pub events: u64,
    /// How many writes from outside it has.
    pub writes: usize,
}

/// One run.
pub(super) struct Run {
    pub(super) branched_from: Option<(usize, Point, Stamp)>,
    /// Its stretches, ascending; those before the point where it left another run are that run's.
    pub(super) line: Vec<usize>,
    /// What came from outside.
    pub(super) journal: Journal,
    /// How far it has got.
    pub(super) end: Point,
    pub(super) end_time: Stamp,
    /// The run as it is at its end, while the machine is elsewhere.
    pub(super) head: Option<Arc<Snapshot>>,
}

impl Run {
    /// How many writes follow that event and no later one.
    pub(super) fn writes_at(&self, event: u64) -> u32 {
        (self.journal.up_to(event) - self.journal.before(event)) as u32
    }

    /// The point after an event and every write that follows it.
    pub(super) fn settled(&self, event: u64) -> Point {
        Point { event, write: self.writes_at(event) }
    }

    /// How many writes have been done at a point.
    pub(super) fn writes_done(&self, at: Point) -> usize {
        self.journal.before(at.event) + at.write as usize
    }

    /// Place in `line` of the stretch in which a point lies.
    pub(super) fn place_of(&self, stretches: &[Stretch], event: u64) -> usize {
        self.line.partition_point(|&stretch| stretches[stretch].from <= event).saturating_sub(1)
    }
}
