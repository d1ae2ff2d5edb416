//! Latencies: a cycle ends when it has published, and until then it computes in parallel with others.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

mod common;

use common::{PAIR, PLUGINS, newest, plan, seconds, stepped};
use rcs_msg::{foxglove, rcs};
use rcs_runtime::source::{Source, StackSource, Step, Task};
use rcs_runtime::{
    Cycle, In, Out, Plan, PortBuilder, Process, ProcessDef, ProcessType, RunOptions, Snapshot, StackFile,
    Stepped,
};
use serde::{Deserialize, Serialize};
use std::sync::{Arc, Condvar, Mutex};
use std::time::Duration;

/// How many cycles of each of two processes have begun, in one test.
static BEGUN: Mutex<[u32; 2]> = Mutex::new([0; 2]);
static CHANGED: Condvar = Condvar::new();

/// Records that a cycle has begun, and waits for `wanted` with a timeout; returns whether it became true.
fn meet(who: usize, wanted: impl Fn([u32; 2]) -> bool) -> bool {
    let mut begun = BEGUN.lock().unwrap();
    begun[who] += 1;
    CHANGED.notify_all();
    let held = CHANGED.wait_timeout_while(begun, Duration::from_secs(20), |begun| !wanted(*begun));
    !held.unwrap().1.timed_out()
}

macro_rules! meets {
    ($name:ident, $plugin:literal, $who:literal, $wanted:expr) => {
        #[derive(Clone, Serialize, Deserialize)]
        struct $name {
            met: u32,
        }

        impl Process for $name {
            type Params = rcs::NoParams;
            type Ports = (In<foxglove::Vector3>, Out<foxglove::Vector3>);
            type Command = rcs_runtime::NoCommands;
            const DEF: ProcessDef = ProcessDef {
                plugin: $plugin,
                summary: "Goes on where another computes at the same time.",
                period_ms: 10.0,
                latency_ms: 5.0,
                reads_ground_truth: false,
            };

            fn ports(b: &mut PortBuilder) -> Self::Ports {
                (b.optional_input("in", "Nothing."), b.output("met", "How often they met.").build())
            }

            fn new(_params: &Self::Params) -> Self {
                Self { met: 0 }
            }

            fn cycle(&mut self, ports: &Self::Ports, _params: &Self::Params, cx: &mut Cycle<'_>) {
                self.met += u32::from(meet($who, $wanted));
                cx.exec("met");
                cx.write(&ports.1, cx.now(), foxglove::Vector3 { x: f64::from(self.met), y: 0.0, z: 0.0 });
            }
        }
    };
}

// The only cycle of the slow process waits for the third one of the quick process, which begins 20 ms later.
meets!(Slow, "slow", 0, |begun| begun[1] >= 3);
meets!(Quick, "quick", 1, |begun| begun[0] >= 1);

#[test]
fn cycles_of_different_instants_compute_at_the_same_time() {
    let stack = r#"
format = 1
name = "meeting"
[[process]]
name = "quick"
plugin = "quick"
supervisor = "viewer"
[[process]]
name = "slow"
plugin = "slow"
supervisor = "viewer"
period_ms = 100.0
latency_ms = 50.0
"#;
    let plugins = [ProcessType::of::<Slow>(), ProcessType::of::<Quick>()];
    let plan = Plan::new(StackFile::parse("test.toml", stack).unwrap(), &plugins, &[]).unwrap();
    let options = RunOptions { threads: 2, ..RunOptions::default() };
    let mut run = Stepped::new(Arc::new(plan), None, options).unwrap();
    run.begin().unwrap();
    run.run_until(seconds(0.06)).unwrap();
    assert_eq!(newest::<foxglove::Vector3>(&run, "/slow/met").x, 1.0);
    assert_eq!(newest::<foxglove::Vector3>(&run, "/quick/met").x, 6.0);
}

#[test]
fn a_step_by_cycle_ends_where_the_cycle_has_published() {
    let mut source = StackSource::new(plan(PAIR).unwrap(), None, RunOptions::default()).unwrap();
    let task = Task::default();
    source.seek(seconds(0.498), &task).unwrap();
    let mut step = |back, until| {
        let step = Step::Cycle { process: Some("counter".to_owned()), back };
        assert!(source.step(&step, &task).unwrap());
        assert_eq!(source.now(), seconds(until));
        let frame = source.frame();
        let status = frame.topic("/counter/status").unwrap().get::<rcs::Status>().unwrap();
        (status.cycle, frame.topic("/counter/count").unwrap().messages)
    };
    // A cycle starts every 10 ms and publishes 3 ms later.
    assert_eq!(step(false, 0.503), (51, 51));
    assert_eq!(step(false, 0.513), (52, 52));
    assert_eq!(step(true, 0.503), (51, 51));
    assert_eq!(step(true, 0.493), (50, 50));
}

#[test]
fn a_panic_in_a_cycle_beside_the_executor_is_an_error_of_that_process() {
    let fragile =
        "[[process]]\nname = \"fragile\"\nplugin = \"fragile\"\nsupervisor = \"viewer\"\nlatency_ms = 5\n";
    let stack = format!("{PAIR}\n{fragile}");
    let run = |threads| {
        let mut run = stepped(&stack, RunOptions { threads, hash: true, ..RunOptions::default() });
        run.begin().unwrap();
        run.run_until(seconds(1.0)).unwrap();
        let status: rcs::Status = newest(&run, "/fragile/status");
        assert_eq!(status.state(), rcs::ProcessState::Error);
        assert_eq!(status.state_text, "panicked: worn out");
        assert_eq!(run.bus().get("/fragile/out").unwrap().newest(), 2);
        run.summary().hash.unwrap()
    };
    assert_eq!(run(1), run(2));
}

#[test]
fn a_latency_longer_than_the_period_keeps_the_order_and_goes_on_from_a_snapshot() {
    let stack = PAIR.replace("latency_ms = 3", "latency_ms = 27");
    let hash = |threads| {
        let options = RunOptions { threads, hash: true, ..RunOptions::default() };
        let mut run = stepped(&stack, options.clone());
        run.begin().unwrap();
        // Three cycles have computed whose output is not visible yet.
        run.run_until(seconds(0.5)).unwrap();
        let bytes = run.snapshot().to_bytes().unwrap();
        run.run_until(seconds(1.0)).unwrap();
        let through = run.summary().hash.unwrap();
        let mut again = stepped(&stack, options);
        again.restore(&Snapshot::from_bytes(&bytes).unwrap()).unwrap();
        again.run_until(seconds(1.0)).unwrap();
        assert_eq!(again.summary().hash.unwrap(), through);
        through
    };
    assert_eq!(hash(1), hash(2));
}

#[test]
fn a_run_that_is_dropped_amid_its_cycles_ends() {
    let mut run = stepped(PAIR, RunOptions { threads: 2, ..RunOptions::default() });
    run.begin().unwrap();
    run.run_until(seconds(0.501)).unwrap();
    drop(run);
}

#[test]
fn a_stack_says_another_latency_than_the_kind_of_process() {
    let own = ProcessType::of::<Slow>();
    let plugins: Vec<_> = PLUGINS.iter().copied().chain([own]).collect();
    let latency_ns = |line: &str| {
        let stack = format!(
            "format = 1\nname = \"x\"\n[[process]]\nname = \"slow\"\nplugin = \"slow\"\nsupervisor = \"viewer\"\n{line}\n"
        );
        let plan = Plan::new(StackFile::parse("test.toml", &stack).unwrap(), &plugins, &[]).unwrap();
        plan.processes[0].latency_ns
    };
    assert_eq!(
        [latency_ns(""), latency_ns("latency_ms = 0"), latency_ns("latency_ms = 7.5")],
        [5_000_000, 0, 7_500_000]
    );
}
