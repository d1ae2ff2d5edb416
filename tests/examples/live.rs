//! Measures the punctuality of a stack on the wall clock: runs it live, recorded, and prints as JSON for each process
//! how late it woke, how long it waited for the lock and how long it computed.
//!
//! `cargo run --release -p ocu-tests --example live -- [STACK [COURSE [SECONDS [RECORDING]]]]`
//! prints `{stack, wall_s, recorder: {written, dropped}, processes: [{name, class, period_ms, cycles, start_late_p99_ms,
//! wake_late_p99_ms, lock_wait_p99_ms, lock_wait_max_ms, compute_p99_ms, overruns, missed, missed_by_lock}]}`.

#![allow(clippy::print_stdout, clippy::unwrap_used, reason = "its output is what it is for")]
#![allow(unreachable_pub, dead_code, reason = "shared with the tests")]

#[path = "../src/bundled.rs"]
mod bundled;

use rcs_runtime::{Live, LiveOptions, RunOptions};
use std::time::{Duration, Instant};

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let argument =
        |index: usize, default: &str| arguments.get(index).map_or(default, String::as_str).to_owned();
    let stack = argument(0, "simulation");
    let seconds: f64 = argument(2, "60").parse().unwrap();
    let plan = bundled::plan(&stack, &argument(1, "meadow"), &[]);
    let folder = tempfile::tempdir().unwrap();
    let record = arguments.get(3).map_or_else(|| folder.path().join("live.mcap"), Into::into);
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let run = RunOptions { threads, ..RunOptions::default() };
    let options = LiveOptions { run, record: Some(record), ..LiveOptions::default() };
    let live = Live::start(plan.clone(), &options).unwrap();
    let clock = Instant::now();
    std::thread::sleep(Duration::from_secs_f64(seconds));
    let timings = live.timings();
    let stopped = live.stop();
    let processes: Vec<_> = timings
        .iter()
        .zip(&plan.processes)
        .map(|(timing, process)| {
            serde_json::json!({
                "name": timing.process,
                "class": process.class.name(),
                "period_ms": process.period_ns as f64 * 1e-6,
                "cycles": timing.cycles,
                "start_late_p99_ms": timing.start_late_p99_us * 1e-3,
                "wake_late_p99_ms": timing.wake_late_p99_us * 1e-3,
                "lock_wait_p99_ms": timing.lock_wait_p99_us * 1e-3,
                "lock_wait_max_ms": timing.lock_wait_max_us * 1e-3,
                "compute_p99_ms": timing.p99_us * 1e-3,
                "overruns": timing.overruns,
                "missed": timing.missed,
                "missed_by_lock": timing.missed_by_lock,
            })
        })
        .collect();
    let recorder = stopped.recording.unwrap().unwrap();
    let report = serde_json::json!({
        "stack": stack,
        "wall_s": clock.elapsed().as_secs_f64(),
        "recorder": { "written": recorder.written, "dropped": recorder.dropped },
        "hung": stopped.hung,
        "processes": processes,
    });
    println!("{}", serde_json::to_string_pretty(&report).unwrap());
}
