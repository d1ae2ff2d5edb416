//! The thread of one live process: sleep until the next cycle is due, capture, compute, publish.

use super::class;
use super::measure::CycleTimes;
use super::shared::{Shared, WorkerState, report};
use crate::node::{CycleFaults, Node};
use crate::pool::Pool;
use crate::stack::Class;
use rcs_msg::{AnyMessage, rcs};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// A process before its thread starts.
pub(super) struct Worker {
    pub(super) shared: Arc<Shared>,
    pub(super) state: Arc<WorkerState>,
    pub(super) node: Node,
    pub(super) pool: Arc<Pool>,
    pub(super) class: Class,
    /// When the first cycle is due.
    pub(super) origin: Instant,
}

impl Worker {
    /// Runs until the run stops. A panic outside of a cycle ends the process, and is its last status; the node handles
    /// panics inside of cycles.
    pub(super) fn run(mut self) {
        class::apply(self.class, &self.state.name);
        if let Err(panic) = catch_unwind(AssertUnwindSafe(|| self.cycles())) {
            self.state.end_cycle();
            let text = crate::node::panic_text(&*panic);
            self.state.write_error(&self.shared, &format!("panicked outside of its cycle: {text}"));
        }
    }

    fn cycles(&mut self) {
        let Self { shared, state, node, pool, .. } = self;
        let mut due = self.origin;
        while !shared.sleep_until(due) {
            let woke = Instant::now();
            state.begin_cycle(shared);
            let ((started, input_sequence, faults), capture_wait) = shared.commit_measured(|now| {
                let is_overridden = shared.machine.overrides.is_any();
                let faults = if is_overridden { node.cycle_faults(now) } else { CycleFaults::default() };
                if !faults.stopped {
                    node.capture();
                }
                shared.machine.overrides.update(now);
                (now, node.captured(), faults)
            });
            if faults.stopped {
                state.end_cycle();
                due += state.period;
                continue;
            }
            let captured = Instant::now();
            node.run(started, pool);
            if faults.slowed_ns > 0 {
                // Ends early if the run stops.
                shared.sleep_until(Instant::now() + Duration::from_nanos(faults.slowed_ns));
            }
            let computed = Instant::now();
            let ((), publish_wait) = shared.commit_measured(|now| {
                node.publish(started, now);
                shared.machine.overrides.update(now);
                let record = rcs::CycleRecord {
                    process: state.name.to_string(),
                    cycle: node.status().cycle,
                    start_ns: started.0,
                    end_ns: now.0,
                    input_sequence,
                };
                report(&shared.schedule, now, AnyMessage::new(record));
            });
            let done = Instant::now();
            if state.end_cycle() {
                tracing::warn!("{} came back after {:.1} s", state.name, (done - woke).as_secs_f64());
            }
            let times = CycleTimes {
                wake_late: woke.saturating_duration_since(due),
                capture_wait,
                compute: computed - captured,
                publish_wait,
                whole: done.saturating_duration_since(due),
            };
            let periods = state.measured(|measured| measured.add(&times, state.period));
            due += state.period * periods;
        }
        state.ended(node.work());
    }
}
