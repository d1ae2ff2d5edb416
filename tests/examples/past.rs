//! Measures the memory of a run's past and the time to show it: simulates minutes with four cameras, then steps back by
//! cycle several times, at several minutes. Prints JSON.
//!
//! `cargo run --release -p ocu-tests --example past [-- MINUTES [cost]]`; `cost` measures instead what a session costs
//! compared with the same run without one.

#![allow(clippy::print_stdout, clippy::unwrap_used, reason = "its output is what it is for")]
#![allow(unreachable_pub, dead_code, reason = "shared with the tests")]

#[path = "../src/bundled.rs"]
mod bundled;

use rcs_msg::rcs::DriveCommand;
use rcs_msg::{AnyMessage, Stamp, foxglove};
use rcs_runtime::source::{Source, StackSource, Step, Task};
use rcs_runtime::{
    Cycle, In, Out, Plan, PortBuilder, Process, ProcessDef, ProcessType, RunOptions, Session, StackFile,
    Stepped,
};
use rcs_testkit::proto::CounterParams;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::sync::Arc;
use std::time::Instant;

/// Number of steps back at each minute.
const STEPS: usize = 50;

fn seconds(s: f64) -> Stamp {
    Stamp((s * 1e9).round() as u64)
}

fn main() {
    let mut arguments = std::env::args().skip(1);
    let minutes: f64 = arguments.next().map_or(10.0, |text| text.parse().unwrap());
    let result = if arguments.next().as_deref() == Some("cost") {
        json!({ "simulation": cost(&simulation(), minutes * 60.0), "forty_at_50_hz": cost(&forty(), minutes * 600.0) })
    } else {
        past(minutes)
    };
    println!("{}", serde_json::to_string_pretty(&result).unwrap());
}

fn simulation() -> Arc<Plan> {
    bundled::plan("simulation", "meadow", &[])
}

/// Drives in curves, like an operator, until that time.
fn drive(source: &mut StackSource, until_s: f64) {
    let task = Task::default();
    let mut now_s = 0.0;
    while now_s < until_s {
        now_s += 0.2;
        let command = DriveCommand {
            timestamp: Some(source.now().to_proto()),
            speed_mps: 0.8,
            yaw_rate_radps: Some(0.4 * (now_s * 0.2).sin()),
            ..DriveCommand::default()
        };
        source.write("/operator/teleop", AnyMessage::new(command)).unwrap();
        source.seek(seconds(now_s), &task).unwrap();
    }
}

fn past(minutes: f64) -> Value {
    let plan = simulation();
    let recorded: Vec<String> =
        plan.buffers.iter().filter(|buffer| buffer.record).map(|buffer| buffer.spec.name.clone()).collect();
    let mut source = StackSource::new(plan, None, RunOptions::default()).unwrap();
    let clock = Instant::now();
    drive(&mut source, minutes * 60.0);
    let run_s = clock.elapsed().as_secs_f64();
    let (rss_mb, peak_mb) = resident_mb();
    let usage = source.session().past_use();
    let mut back = Vec::new();
    for minute in [0.1, 0.5, 0.9].map(|part| (part * minutes * 10.0).round() / 10.0) {
        let clock = Instant::now();
        source.seek(seconds(minute * 60.0), &Task::default()).unwrap();
        while source.frame().topics.iter().any(|topic| topic.pending) {
            source.idle();
        }
        let arrived_ms = clock.elapsed().as_secs_f64() * 1e3;
        while source.idle() {}
        let steps: Vec<(f64, f64)> = (0..STEPS).map(|_| step_back(&mut source, &recorded)).collect();
        let recorded_worst_ms = steps.iter().map(|step| step.0).fold(0.0, f64::max);
        let mut all: Vec<f64> = steps.iter().map(|step| step.1).collect();
        all.sort_by(f64::total_cmp);
        let all_p99_ms = all[(all.len() * 99).div_ceil(100) - 1];
        back.push(json!({
            "minute": minute,
            "recorded_worst_ms": recorded_worst_ms,
            "all_p99_ms": all_p99_ms,
            "arrived_ms": arrived_ms,
        }));
    }
    json!({
        "simulated_s": minutes * 60.0,
        "run_s": run_s,
        "rss_mb": rss_mb,
        "peak_rss_mb": peak_mb,
        "rss_after_mb": resident_mb().0,
        "memory_mb": usage.memory_bytes as f64 / 1e6,
        "disk_mb": usage.disk_bytes as f64 / 1e6,
        "stretches": usage.stretches,
        "with_messages": usage.with_messages,
        "with_snapshot": usage.with_snapshot,
        "problems": source.info().problems,
        "back": back,
    })
}

/// One step back: the time until the recorded topics were shown, and until all topics were, in milliseconds.
fn step_back(source: &mut StackSource, recorded: &[String]) -> (f64, f64) {
    let clock = Instant::now();
    let step = Step::Cycle { process: None, back: true };
    assert!(source.step(&step, &Task::default()).unwrap(), "there is a cycle before");
    let mut recorded_ms = None;
    loop {
        let frame = source.frame();
        let pending = |name: &String| frame.topic(name).is_some_and(|topic| topic.pending);
        let now_ms = clock.elapsed().as_secs_f64() * 1e3;
        if recorded_ms.is_none() && !recorded.iter().any(pending) {
            recorded_ms = Some(now_ms);
        }
        if let Some(recorded_ms) = recorded_ms
            && !frame.topics.iter().any(|topic| topic.pending)
        {
            return (recorded_ms, now_ms);
        }
        source.idle();
    }
}

/// Current and peak resident memory, from the system.
fn resident_mb() -> (f64, f64) {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let of = |name: &str| {
        let line = status.lines().find(|line| line.starts_with(name));
        let kb = line.and_then(|line| line.split_whitespace().nth(1)).and_then(|text| text.parse().ok());
        kb.map_or(f64::NAN, |kb: f64| kb * 1024.0 / 1e6)
    };
    (of("VmRSS:"), of("VmHWM:"))
}

/// Cost of a session compared with the same run without one: alternating runs, the shortest of three.
fn cost(plan: &Arc<Plan>, simulated_s: f64) -> Value {
    let new = || Stepped::new(Arc::clone(plan), None, RunOptions::default()).unwrap();
    let (mut without_s, mut with_s) = (f64::MAX, f64::MAX);
    for _ in 0..3 {
        let mut run = new();
        run.begin().unwrap();
        let clock = Instant::now();
        run.run_until(seconds(simulated_s)).unwrap();
        without_s = without_s.min(clock.elapsed().as_secs_f64());
        drop(run);
        let mut session = Session::new(new()).unwrap();
        let clock = Instant::now();
        session.forward_until(seconds(simulated_s), &Task::default()).unwrap();
        with_s = with_s.min(clock.elapsed().as_secs_f64());
    }
    json!({ "simulated_s": simulated_s, "without_s": without_s, "with_s": with_s, "ratio": with_s / without_s })
}

/// A small controller: filters its input by a second-order filter with a small time step.
#[derive(Clone, Serialize, Deserialize)]
struct Follower {
    state: [f64; 2],
}

struct FollowerPorts {
    input: In<foxglove::Vector3>,
    output: Out<foxglove::Vector3>,
}

impl Process for Follower {
    type Params = CounterParams;
    type Ports = FollowerPorts;
    type Command = rcs_runtime::NoCommands;
    const DEF: ProcessDef = ProcessDef {
        plugin: "follower",
        summary: "Follows its input.",
        period_ms: 20.0,
        latency_ms: 0.0,
        reads_ground_truth: false,
    };

    fn ports(b: &mut PortBuilder) -> Self::Ports {
        FollowerPorts {
            input: b.optional_input("input", "What is followed."),
            output: b.output("output", "Position, speed, input.").build(),
        }
    }

    fn new(_params: &Self::Params) -> Self {
        Self { state: [0.0; 2] }
    }

    fn cycle(&mut self, ports: &Self::Ports, _params: &Self::Params, cx: &mut Cycle<'_>) {
        let input = cx.read_newest(&ports.input).map_or(1.0, |message| message.x);
        for _ in 0..200 {
            self.state[1] += (25.0 * (input - self.state[0]) - 8.0 * self.state[1]) * 1e-4;
            self.state[0] += self.state[1] * 1e-4;
        }
        cx.exec("following");
        let [x, y] = self.state;
        cx.write(&ports.output, cx.now(), foxglove::Vector3 { x, y, z: input });
    }
}

/// 40 processes at 50 Hz, each reading the output of the previous one.
fn forty() -> Arc<Plan> {
    let mut text = "format = 1\nname = \"forty\"\n".to_owned();
    for i in 0..40 {
        let _ =
            writeln!(text, "[[process]]\nname = \"p{i}\"\nplugin = \"follower\"\nsupervisor = \"viewer\"");
        if i > 0 {
            let _ = writeln!(text, "inputs = {{ input = \"/p{}/output\" }}", i - 1);
        }
    }
    let file = StackFile::parse("forty.toml", &text).unwrap();
    Arc::new(Plan::new(file, &[ProcessType::of::<Follower>()], &[]).unwrap())
}
