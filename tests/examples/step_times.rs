//! Measures the time of steps on a recording with a stack, forward and back, compared with that of its processes.
//!
//! `cargo run -p ocu-tests --example step_times -- assets/stacks/range_camera.toml drive.mcap`

#![allow(clippy::print_stdout, reason = "its output is what it is for")]

use rcs_log::Log;
use rcs_runtime::source::{Source, StackSource, Step, Task};
use rcs_runtime::{Plan, RunOptions, StackFile};
use std::sync::Arc;
use std::time::Instant;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let (Some(stack), Some(log)) = (arguments.next(), arguments.next()) else {
        return Err("expected a stack file and a log".into());
    };
    let log = Log::open(log)?;
    let plan =
        Plan::new(StackFile::parse(&stack, &std::fs::read_to_string(&stack)?)?, rcs_plugins::all(), &[])?;
    let mut source = StackSource::new(Arc::new(plan), Some(&log), RunOptions::default())?;
    let cycle = |back| Step::Cycle { process: None, back };
    let busy_us = |source: &StackSource| -> f64 {
        source.session().run().summary().processes.iter().map(|p| p.mean_us * p.cycles as f64).sum()
    };
    for (name, back) in [("forward", false), ("back", true)] {
        let (mut steps_ms, mut own_ms) = (Vec::new(), Vec::new());
        for _ in 0..60 {
            let busy = busy_us(&source);
            let clock = Instant::now();
            if !source.step(&cycle(back), &Task::default())? {
                break;
            }
            let _ = source.frame();
            steps_ms.push(clock.elapsed().as_secs_f64() * 1e3);
            own_ms.push((busy_us(&source) - busy) * 1e-3);
        }
        // A step back restores the counters of an earlier time, so the difference can only be taken forward.
        let without: Vec<f64> = steps_ms.iter().zip(&own_ms).map(|(step, own)| step - own).collect();
        let lists = [("step", steps_ms), ("step less its processes' time", without)];
        for (what, mut list) in lists.into_iter().take(if back { 1 } else { 2 }) {
            list.sort_by(f64::total_cmp);
            let median = list.get(list.len() / 2).copied().unwrap_or(f64::NAN);
            let worst = list.last().copied().unwrap_or(f64::NAN);
            println!("{name:8} {what:30} {median:8.2} ms median {worst:8.2} ms worst of {}", list.len());
        }
    }
    Ok(())
}
