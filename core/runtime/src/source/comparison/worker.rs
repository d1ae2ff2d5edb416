//! The thread that compares two sides: it reads on whichever is behind, and compares up to where both are known.

use super::side::{Input, Reading, Step};
use super::{SharedTold, lock};
use crate::compare::{Difference, Entry, Matcher, Side};
use crate::diff::{after_opening, compared_from, have_common_time};
use crate::stack::{Plan, names};
use rcs_msg::Stamp;
use std::collections::BTreeSet;
use std::sync::Arc;

/// What a thread needs to begin.
pub(super) struct Work {
    pub(super) inputs: [Input; 2],
    /// The stack, if one runs.
    pub(super) plan: Option<Arc<Plan>>,
    pub(super) start: Stamp,
}

/// Says that the thread has ended, for whatever reason.
struct Ending(SharedTold);

impl Drop for Ending {
    fn drop(&mut self) {
        let mut told = lock(&self.0);
        told.ended = true;
        if std::thread::panicking() {
            told.problem = Some("the comparison has failed: its thread panicked".into());
        }
    }
}

impl Work {
    /// Starts the thread. It ends when both sides have ended, when one has passed the end of the recording with which it
    /// is compared, or when a run is no longer handed to it.
    pub(super) fn spawn(self, told: SharedTold) -> std::io::Result<()> {
        let run = move || {
            let ending = Ending(told);
            if let Err(problem) = self.run(&ending.0) {
                lock(&ending.0).problem = Some(problem.into());
            }
        };
        std::thread::Builder::new().name("compare".to_owned()).spawn(run).map(|_| ())
    }

    fn run(self, told: &SharedTold) -> Result<(), String> {
        let [first, second] = self.inputs;
        let is_other = [&first, &second].map(|input| matches!(input, Input::Files(..)));
        let mut sides = [first.open()?, second.open()?];
        let mut opened = sides.iter().zip(is_other).filter(|(_, is_other)| *is_other);
        lock(told).other = opened.find_map(|(side, _)| side.log().cloned());
        let buffers = [sides[0].names(), sides[1].names()];
        let mut wanted: BTreeSet<String> = buffers[0].intersection(&buffers[1]).cloned().collect();
        let recording_ends = [sides[0].end(), sides[1].end()];
        if let [Some(_), None] | [None, Some(_)] = recording_ends {
            // The run may be of a part of the recorded stack.
            wanted.remove(names::PROCESSES);
        }
        let mut matcher = Matcher::new(self.start);
        for (reading, side) in sides.iter_mut().zip([Side::First, Side::Second]) {
            reading.choose(&wanted);
            let planned = self.plan.iter().flat_map(|plan| &plan.buffers);
            let thinned = planned.filter(|buffer| reading.is_recording() && buffer.record_hz.is_some());
            thinned.for_each(|buffer| matcher.thin(side, &buffer.spec.name));
        }
        let have_common_time = match [sides[0].log(), sides[1].log()] {
            [Some(one), Some(other)] => have_common_time(one, other),
            _ => true,
        };
        let skipped = skipped(&sides, self.start);
        let mut joint = Joint {
            sides,
            wanted,
            matcher,
            gaps: skipped.into_iter().collect(),
            recording_end: recording_ends.into_iter().flatten().min(),
            differences: Vec::new(),
        };
        let left_out = [0, 1].map(|side: usize| buffers[side].difference(&buffers[1 - side]).count());
        let mut now = lock(told);
        (now.left_out, now.gaps) = (left_out, joint.gaps.as_slice().into());
        now.recording_ends = recording_ends;
        drop(now);
        if joint.wanted.is_empty() {
            return Err("the two have no buffer in common".to_owned());
        }
        if !have_common_time {
            return Err("the two have no common time".to_owned());
        }
        joint.run(told);
        Ok(())
    }
}

/// The part at the beginning that is not compared, because a recording begins later than the other side, or is complete
/// only from later on: the rule of `diff`. A run begins at `start`.
fn skipped(sides: &[Reading; 2], start: Stamp) -> Option<(Stamp, Stamp)> {
    let logs = [sides[0].log(), sides[1].log()];
    let from = match logs {
        [Some(one), Some(other)] => compared_from(one, other),
        [Some(log), None] | [None, Some(log)] => after_opening(log),
        [None, None] => return None,
    };
    let first = logs.map(|log| log.map_or(start, |log| log.info().start)).into_iter().min()?;
    (from > first).then(|| (Stamp(0), from.before_ns(1)))
}

/// Both sides.
struct Joint {
    sides: [Reading; 2],
    wanted: BTreeSet<String>,
    matcher: Matcher,
    gaps: Vec<(Stamp, Stamp)>,
    /// Nothing after this time is compared.
    recording_end: Option<Stamp>,
    differences: Vec<Difference>,
}

impl Joint {
    fn run(&mut self, told: &SharedTold) {
        loop {
            // Nobody reads what it says.
            if Arc::strong_count(told) == 1 {
                return;
            }
            let behind = usize::from(self.sides[1].until < self.sides[0].until);
            let mut problem = None;
            match self.sides[behind].read_on(&self.wanted, &mut problem) {
                Step::Read | Step::Ended => {}
                Step::Lost(from, until) => {
                    self.gaps.push((from, until));
                    lock(told).gaps = self.gaps.as_slice().into();
                }
                Step::Nothing => {
                    lock(told).waits_for = Some(behind);
                    continue;
                }
                Step::Dropped => return,
            }
            let known = self.sides[0].until.min(self.sides[1].until);
            let is_new = self.settle(known);
            let mut now = lock(told);
            now.waits_for = None;
            now.until = Some(self.recording_end.map_or(known, |end| known.min(end)));
            if is_new {
                now.differences = self.differences.as_slice().into();
            }
            if let Some(problem) = problem {
                now.problem = Some(problem.into());
            }
            drop(now);
            // Only now, because the source takes what is neither waiting nor being compared for done.
            self.sides[behind].taken();
            if known == Stamp::MAX || self.recording_end.is_some_and(|end| known > end) {
                return;
            }
        }
    }

    /// Compares everything before a time; returns whether a difference was found.
    fn settle(&mut self, until: Stamp) -> bool {
        loop {
            let next = [0, 1].map(|side: usize| {
                let time = self.sides[side].queue.front().map(|(_, entry)| entry.log_time);
                time.filter(|time| *time < until || until == Stamp::MAX)
            });
            let (index, side) = match next {
                [None, None] => break,
                [Some(_), None] => (0, Side::First),
                [Some(a), Some(b)] if a <= b => (0, Side::First),
                _ => (1, Side::Second),
            };
            let Some((buffer, entry)) = self.sides[index].queue.pop_front() else { break };
            if self.is_comparable(&buffer, &entry) {
                self.matcher.put(side, &buffer, entry);
            }
        }
        let found = self.matcher.settle_each();
        let is_new = !found.is_empty();
        self.differences.extend(found);
        is_new
    }

    fn is_comparable(&self, buffer: &str, entry: &Entry) -> bool {
        let is_after = self.recording_end.is_some_and(|end| entry.log_time > end);
        let in_gap = self.gaps.iter().any(|(from, to)| (*from..=*to).contains(&entry.log_time));
        self.wanted.contains(buffer) && !is_after && !in_gap
    }
}
