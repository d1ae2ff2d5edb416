//! Snapshots: the complete state of a stepped run at one moment, in memory or as bytes.
//!
//! In memory a snapshot shares messages and large parts of states with the run: its cost is proportional to the changes
//! since the last one. From bytes a run can continue after reading them from disk, or in another process with the same
//! stack and log.

pub(crate) mod disk;

use crate::error::RunError;
use crate::node::NodeState;
use crate::stack::Plan;
use crate::stepped::{Event, Stepped};
use crate::summary::CycleTimes;
use crate::tally::{Tallies, Tally};
use crate::workers::Slot;
use rcs_bus::{BufferState, Sample};
use rcs_log::Position;
use rcs_msg::Stamp;
use std::collections::HashMap;
use std::sync::Arc;

/// The complete state of a stepped run at one moment.
#[derive(Clone)]
pub struct Snapshot {
    pub(crate) now: Stamp,
    pub(crate) events: u64,
    order: u64,
    timing_due: Stamp,
    /// Sorted, so that its order does not depend on the way to this moment.
    queue: Vec<Event>,
    buffers: Vec<BufferState>,
    /// Each with its change count: see [`Stepped::snapshot_sharing`].
    nodes: Vec<(u64, Arc<NodeState>)>,
    /// The measured times of the nodes since the start of the run. Nothing that a process computes depends on them; they
    /// alone make the bytes of two runs differ.
    times: Vec<CycleTimes>,
    position: Option<Position>,
    tallies: Option<Vec<Tally>>,
    stack_hash: String,
}

impl Snapshot {
    /// Simulated time of the moment.
    pub fn now(&self) -> Stamp {
        self.now
    }

    /// Number of events executed.
    pub fn events(&self) -> u64 {
        self.events
    }

    /// Sequence of the newest message of every buffer, in the order of the plan.
    pub(crate) fn newest(&self) -> Vec<u64> {
        self.buffers.iter().map(|buffer| buffer.newest).collect()
    }

    /// The newest message of every buffer, in the order of the plan.
    pub(crate) fn latest(&self) -> impl Iterator<Item = Option<&Sample>> {
        self.buffers.iter().map(|buffer| buffer.ring.last())
    }

    /// Buffer and sequence of every message that has them, by [`AnyMessage::address`].
    pub(crate) fn places(&self, plan: &Plan) -> HashMap<usize, (usize, u64)> {
        let rings = self.buffers.iter().enumerate();
        let rings = rings.flat_map(|(index, buffer)| buffer.ring.iter().map(move |sample| (index, sample)));
        let views = self.nodes.iter().zip(&plan.processes).flat_map(|((_, node), process)| {
            node.views.iter().zip(&process.inputs).flat_map(|(view, &index)| {
                let samples = view.fresh.iter().chain(&view.latest);
                samples.filter_map(move |sample| Some((index?, sample)))
            })
        });
        rings
            .chain(views)
            .map(|(index, sample)| (sample.message.address(), (index, sample.header.sequence)))
            .collect()
    }
}

impl Stepped {
    /// A snapshot of the run.
    pub fn snapshot(&self) -> Snapshot {
        self.snapshot_sharing(None)
    }

    /// A snapshot of the run. It shares the states of processes that have not changed since `last`.
    pub(crate) fn snapshot_sharing(&self, last: Option<&Snapshot>) -> Snapshot {
        let machine = self.machine();
        let mut queue: Vec<Event> = self.queue.iter().cloned().collect();
        queue.sort_by(|a, b| b.cmp(a));
        let node = |index: usize, node: &crate::node::Node| {
            let same = last.and_then(|last| last.nodes.get(index)).filter(|(at, _)| *at == node.changes());
            same.cloned().unwrap_or_else(|| (node.changes(), Arc::new(node.save())))
        };
        Snapshot {
            now: self.now,
            events: self.events,
            order: self.order,
            timing_due: self.timing_due,
            queue,
            buffers: machine.buffers.iter().map(|buffer| buffer.save()).collect(),
            nodes: machine
                .nodes
                .iter()
                .enumerate()
                .map(|(index, slot)| slot.look(|at, _| node(index, at)))
                .collect(),
            times: machine.nodes.iter().map(Slot::times).collect(),
            position: self.feed.as_ref().map(crate::feed::Feed::position),
            tallies: self.tallies.as_ref().and_then(Tallies::get),
            stack_hash: machine.plan.hash.clone(),
        }
    }

    /// Restores the state of the snapshot. Taps are not called.
    pub fn restore(&mut self, snapshot: &Snapshot) -> Result<(), RunError> {
        let machine = self.machine_mut();
        let fits = snapshot.stack_hash == machine.plan.hash
            && snapshot.buffers.len() == machine.buffers.len()
            && snapshot.nodes.len() == machine.nodes.len()
            && snapshot.times.len() == machine.nodes.len();
        if !fits {
            return Err(RunError::Snapshot(format!(
                "it is of the stack with hash {}; expected {}",
                snapshot.stack_hash, machine.plan.hash
            )));
        }
        for (buffer, state) in machine.buffers.iter().zip(&snapshot.buffers) {
            buffer.restore(state);
        }
        for (slot, (_, state)) in machine.nodes.iter_mut().zip(&snapshot.nodes) {
            slot.get().restore(state).map_err(RunError::Snapshot)?;
        }
        for (slot, times) in machine.nodes.iter_mut().zip(&snapshot.times) {
            slot.set_times(*times);
        }
        self.now = snapshot.now;
        self.events = snapshot.events;
        self.order = snapshot.order;
        self.timing_due = snapshot.timing_due;
        self.has_begun = snapshot.latest().any(|newest| newest.is_some());
        self.rewind();
        self.queue = snapshot.queue.iter().cloned().collect();
        if let (Some(feed), Some(position)) = (&mut self.feed, &snapshot.position) {
            feed.restore(position.clone());
        }
        if let (Some(tallies), Some(saved)) = (&self.tallies, &snapshot.tallies) {
            tallies.set(saved);
        }
        Ok(())
    }
}
