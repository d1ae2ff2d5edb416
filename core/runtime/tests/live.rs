//! Live runs with processes that take long, hang or panic. These tests do not depend on the speed of the computer.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

mod common;

use common::{PAIR, PLUGINS, plan};
use rcs_msg::{AnyMessage, Stamp, foxglove, rcs};
use rcs_runtime::{
    Child, ChildState, Cycle, ExternalEvent, Live, LiveOptions, Order, Out, Plan, PortBuilder, Process,
    ProcessDef, ProcessType, StackFile,
};
use serde::{Deserialize, Serialize};
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

const PATIENCE: Duration = Duration::from_mins(1);

#[track_caller]
fn wait(what: &str, is: impl Fn() -> bool) {
    let deadline = Instant::now() + PATIENCE;
    while !is() {
        assert!(Instant::now() < deadline, "waited in vain for {what}");
        std::thread::yield_now();
    }
}

fn newest(live: &Live, buffer: &str) -> u64 {
    live.bus().get(buffer).unwrap().newest()
}

fn status(live: &Live, process: &str) -> rcs::Status {
    let newest = live.bus().get(&format!("/{process}/status")).unwrap().latest();
    newest.and_then(|sample| sample.message.to()).unwrap_or_default()
}

/// Whether [`Hanging`] may continue.
static RELEASED: AtomicBool = AtomicBool::new(false);

/// Its third cycle lasts until it is released.
#[derive(Clone, Serialize, Deserialize)]
struct Hanging {
    cycles: u32,
}

impl Process for Hanging {
    type Params = rcs_testkit::proto::CounterParams;
    type Ports = Out<foxglove::Vector3>;
    type Command = rcs_runtime::NoCommands;
    const DEF: ProcessDef = ProcessDef {
        plugin: "hanging",
        summary: "Hangs.",
        period_ms: 1.0,
        latency_ms: 0.0,
        reads_ground_truth: false,
    };

    fn ports(b: &mut PortBuilder) -> Self::Ports {
        b.output("out", "Count.").build()
    }

    fn new(_params: &Self::Params) -> Self {
        Self { cycles: 0 }
    }

    fn cycle(&mut self, out: &Self::Ports, _params: &Self::Params, cx: &mut Cycle<'_>) {
        self.cycles += 1;
        cx.exec("at work");
        while self.cycles == 3 && !RELEASED.load(Ordering::Relaxed) {
            std::thread::yield_now();
        }
        cx.write(out, cx.now(), foxglove::Vector3 { x: f64::from(self.cycles), ..Default::default() });
    }
}

/// The number of checks of [`Picky`] that have begun, and whether they may end.
static CHECKS: AtomicU32 = AtomicU32::new(0);
static CHECKED: AtomicBool = AtomicBool::new(true);

/// Its parameters take long to check.
#[derive(Clone, Serialize, Deserialize)]
struct Picky;

impl Process for Picky {
    type Params = rcs_testkit::proto::CounterParams;
    type Ports = Out<foxglove::Vector3>;
    type Command = rcs_runtime::NoCommands;
    const DEF: ProcessDef = ProcessDef {
        plugin: "picky",
        summary: "Checks.",
        period_ms: 10.0,
        latency_ms: 0.0,
        reads_ground_truth: false,
    };

    fn ports(b: &mut PortBuilder) -> Self::Ports {
        b.output("out", "Parameter publish_hz.").build()
    }

    fn check(_params: &Self::Params) -> Result<(), String> {
        CHECKS.fetch_add(1, Ordering::Relaxed);
        while !CHECKED.load(Ordering::Relaxed) {
            std::thread::yield_now();
        }
        Ok(())
    }

    fn new(_params: &Self::Params) -> Self {
        Self
    }

    fn cycle(&mut self, out: &Self::Ports, params: &Self::Params, cx: &mut Cycle<'_>) {
        cx.write(out, cx.now(), foxglove::Vector3 { x: params.publish_hz, ..Default::default() });
    }
}

/// `PAIR` and one more process.
fn with(plugin: &'static str, more: &str) -> Arc<Plan> {
    let text = format!(
        "{PAIR}\n[[process]]\nname = \"{plugin}\"\nplugin = \"{plugin}\"\nsupervisor = \"viewer\"\n{more}\n"
    );
    let plugins = [PLUGINS, &[ProcessType::of::<Hanging>(), ProcessType::of::<Picky>()]].concat();
    Arc::new(Plan::new(StackFile::parse("test.toml", &text).unwrap(), &plugins, &[]).unwrap())
}

#[test]
fn a_process_that_hangs_becomes_error_and_neither_holds_up_the_others_nor_the_end() {
    let options = LiveOptions {
        hang_limit: Duration::from_millis(50),
        stop_limit: Duration::from_secs(1),
        ..LiveOptions::default()
    };
    let live = Live::start(with("hanging", ""), &options).unwrap();
    wait("ERROR", || status(&live, "hanging").state() == rcs::ProcessState::Error);
    let told = status(&live, "hanging");
    assert!(told.state_text.starts_with("hangs: a cycle has lasted"), "{}", told.state_text);
    assert_eq!((told.process.as_str(), told.echo_serial), ("hanging", 1), "the rest of the status stays");
    let sums = newest(&live, "/adder/sum");
    wait("the others", || newest(&live, "/adder/sum") > sums + 3);
    assert_eq!(newest(&live, "/hanging/out"), 2);
    let bus_status = live.bus().get("/hanging/status").unwrap().clone();
    assert_eq!(live.stop().hung, ["hanging"]);
    // Its thread ends by itself when it can.
    RELEASED.store(true, Ordering::Relaxed);
    wait("the end of the cycle", || {
        let newest = bus_status.latest().unwrap().message.to::<rcs::Status>().unwrap();
        newest.state() == rcs::ProcessState::Exec
    });
}

#[test]
fn a_panic_outside_of_a_cycle_is_told_in_the_status_of_its_process() {
    let live = Live::start(plan(PAIR).unwrap(), &LiveOptions::default()).unwrap();
    wait("a sum", || newest(&live, "/adder/sum") > 2);
    live.bus().get("/counter/count").unwrap().tap(Box::new(|_| std::panic::panic_any("a broken tap")));
    wait("ERROR", || status(&live, "counter").state() == rcs::ProcessState::Error);
    assert_eq!(status(&live, "counter").state_text, "panicked outside of its cycle: a broken tap");
    let cycles = status(&live, "adder").cycle;
    wait("the other process", || status(&live, "adder").cycle > cycles + 2);
    assert!(live.stop().hung.is_empty());
}

#[test]
fn a_check_of_parameters_that_takes_long_holds_up_no_process() {
    let live = Live::start(with("picky", ""), &LiveOptions::default()).unwrap();
    wait("a sum", || newest(&live, "/adder/sum") > 2);
    CHECKED.store(false, Ordering::Relaxed);
    let checks = CHECKS.load(Ordering::Relaxed);
    let params = rcs_testkit::proto::CounterParams { publish_hz: 7.0, ..rcs_msg::params::default() };
    let write = ExternalEvent::operator("/picky/params", AnyMessage::new(params));
    std::thread::scope(|scope| {
        let writing = scope.spawn(|| live.take(write));
        wait("the check", || CHECKS.load(Ordering::Relaxed) > checks);
        let (sums, outputs) = (newest(&live, "/adder/sum"), newest(&live, "/picky/out"));
        wait("the others", || newest(&live, "/adder/sum") > sums + 3);
        wait("the process itself", || newest(&live, "/picky/out") > outputs + 3);
        CHECKED.store(true, Ordering::Relaxed);
        writing.join().unwrap().unwrap();
    });
    let x = || {
        let newest = live.bus().get("/picky/out").unwrap().latest().unwrap();
        newest.message.get::<foxglove::Vector3>().unwrap().x
    };
    wait("the new parameter", || x() == 7.0);
    live.stop();
}

#[test]
fn waking_waiting_and_computing_are_told_for_every_process() {
    let classes = with("picky", "class = \"background\"\npool = \"side\"");
    let live = Live::start(classes, &LiveOptions::default()).unwrap();
    wait("cycles", || live.timings().iter().all(|timing| timing.cycles > 5));
    wait("a message of timings", || newest(&live, "/runtime/timing") > 0);
    let timing = live.bus().get("/runtime/timing").unwrap().latest().unwrap();
    let told = timing.message.to::<rcs::Timing>().unwrap().processes;
    let names: Vec<_> = told.iter().map(|timing| timing.process.as_str()).collect();
    assert_eq!(names, ["counter", "adder", "picky"]);
    for timing in live.timings() {
        assert!(timing.mean_us > 0.0 && timing.p99_us <= timing.max_us, "{timing:?}");
        assert!(timing.wake_late_p99_us > 0.0 && timing.start_late_p99_us > 0.0, "{timing:?}");
        assert!(timing.missed_by_lock <= timing.missed, "{timing:?}");
    }
    live.stop();
}

/// Whether [`Stuck`] may continue.
static FREED: AtomicBool = AtomicBool::new(false);

/// Its third cycle lasts until it is released.
#[derive(Clone, Serialize, Deserialize)]
struct Stuck {
    cycles: u32,
}

impl Process for Stuck {
    type Params = rcs::NoParams;
    type Ports = ();
    type Command = rcs_runtime::NoCommands;
    const DEF: ProcessDef = ProcessDef {
        plugin: "stuck",
        summary: "Hangs.",
        period_ms: 20.0,
        latency_ms: 0.0,
        reads_ground_truth: false,
    };

    fn ports(_: &mut PortBuilder) -> Self::Ports {}

    fn new(_params: &Self::Params) -> Self {
        Self { cycles: 0 }
    }

    fn cycle(&mut self, (): &Self::Ports, _params: &Self::Params, cx: &mut Cycle<'_>) {
        self.cycles += 1;
        cx.exec("at work");
        while self.cycles == 3 && !FREED.load(Ordering::Relaxed) {
            std::thread::yield_now();
        }
    }
}

/// Writes whether its child is silent.
#[derive(Clone, Serialize, Deserialize)]
struct Watcher;

struct WatcherPorts {
    child: Child<rcs_runtime::NoCommands>,
    seen: Out<foxglove::Vector3>,
}

impl Process for Watcher {
    type Params = rcs::NoParams;
    type Ports = WatcherPorts;
    type Command = rcs_runtime::NoCommands;
    const DEF: ProcessDef = ProcessDef {
        plugin: "watcher",
        summary: "Watches.",
        period_ms: 10.0,
        latency_ms: 0.0,
        reads_ground_truth: false,
    };

    fn ports(b: &mut PortBuilder) -> Self::Ports {
        WatcherPorts {
            child: b.child("child", "Whom it watches."),
            seen: b.output("seen", "Whether the child is silent.").build(),
        }
    }

    fn new(_params: &Self::Params) -> Self {
        Self
    }

    fn cycle(&mut self, ports: &Self::Ports, _params: &Self::Params, cx: &mut Cycle<'_>) {
        if cx.is_new_command() {
            cx.send(&ports.child, Order::Run);
        }
        let silent = cx.child_state(&ports.child) == Some(ChildState::Silent);
        cx.exec(if silent { "its child is silent" } else { "watches" });
        cx.write(
            &ports.seen,
            cx.now(),
            foxglove::Vector3 { x: f64::from(u8::from(silent)), ..Default::default() },
        );
    }
}

#[test]
fn a_supervisor_sees_a_child_that_posts_no_status_as_silent_after_half_a_second_and_not_before() {
    const STACK: &str = r#"
format = 1
name = "watched"

[[process]]
name = "watcher"
plugin = "watcher"
supervisor = "viewer"

[[process]]
name = "stuck"
plugin = "stuck"
supervisor = "watcher"
as = "child"
"#;
    let plugins = [ProcessType::of::<Watcher>(), ProcessType::of::<Stuck>()];
    let file = StackFile::parse("test.toml", STACK).unwrap();
    let plan = Arc::new(Plan::new(file, &plugins, &[]).unwrap());
    // The watchdog, which would report on behalf of the child, is later.
    let options = LiveOptions { hang_limit: PATIENCE * 2, ..LiveOptions::default() };
    let live = Live::start(plan, &options).unwrap();
    let seen: Arc<Mutex<Vec<(Stamp, bool)>>> = Arc::default();
    let taken = Arc::clone(&seen);
    live.bus().get("/watcher/seen").unwrap().tap(Box::new(move |sample| {
        // The time at which the inputs were captured.
        let silent = sample.message.get::<foxglove::Vector3>().unwrap().x == 1.0;
        taken.lock().unwrap().push((sample.header.acq_time, silent));
    }));
    wait("silence", || seen.lock().unwrap().last().is_some_and(|(_, silent)| *silent));
    let heard = live.bus().get("/stuck/status").unwrap().latest().unwrap().header.log_time;
    // It hangs in the cycle after that in which RUN has come, which on a busy machine may be a later one.
    assert!(status(&live, "stuck").cycle >= 2);
    for (time, silent) in seen.lock().unwrap().iter().filter(|(time, _)| *time > heard) {
        assert_eq!(*silent, time.seconds_since(heard) >= 0.5, "{} s", time.seconds_since(heard));
    }
    FREED.store(true, Ordering::Relaxed);
    wait("the child's return", || seen.lock().unwrap().last().is_some_and(|(_, silent)| !*silent));
    live.stop();
}
