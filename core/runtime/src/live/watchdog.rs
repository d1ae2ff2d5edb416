//! The watchdog thread: reports hung processes, and publishes measurements.

use super::shared::{Shared, WorkerState, report};
use rcs_msg::{AnyMessage, rcs};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Time between checks.
const LOOK: Duration = Duration::from_millis(50);
/// Time between messages of timings.
const TELL: Duration = Duration::from_secs(1);
/// A process counts as hung if a cycle lasts this many of its periods, and at least the limit in the options.
const PERIODS: u32 = 10;

/// Monitors the processes until the run stops.
pub(super) fn run(shared: &Shared, worker_states: &[Arc<WorkerState>], least_limit: Duration) {
    let mut look = Instant::now();
    let mut tell = look + TELL;
    while !shared.sleep_until(look) {
        for state in worker_states {
            let limit = (state.period * PERIODS).max(least_limit);
            if let Some(lasted) = state.newly_hung(shared, limit) {
                let text = format!(
                    "hangs: a cycle has lasted {:.1} s; expected at most {:.1} s",
                    lasted.as_secs_f64(),
                    limit.as_secs_f64()
                );
                state.write_error(shared, &text);
            }
        }
        let now = Instant::now();
        if now >= tell {
            tell = now + TELL;
            let processes = timings(worker_states);
            shared.commit(|now| {
                let message = rcs::Timing { timestamp: Some(now.to_proto()), processes, lag_s: 0.0 };
                report(&shared.timing, now, AnyMessage::new(message));
            });
        }
        look = now + LOOK;
    }
}

/// Measurements of each process since the start.
pub(super) fn timings(worker_states: &[Arc<WorkerState>]) -> Vec<rcs::ProcessTiming> {
    worker_states.iter().map(|state| state.measured(|measured| measured.report(&state.name))).collect()
}
