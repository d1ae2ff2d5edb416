//! A supervisor with children that obey, brake and fail.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

mod authority;

use rcs_msg::{AnyMessage, Payload, Stamp, rcs};
use rcs_runtime::source::Task;
use rcs_runtime::{
    Cycle, ExternalEvent, In, NoCommands, Plan, PortBuilder, Process, ProcessDef, ProcessType, RunOptions,
    Session, StackFile, Stepped,
};
use rcs_supervisor::Supervisor;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

rcs_runtime::commands! {
    /// Commands of [`Wheels`].
    enum WheelsCommand {
        Creep = "CREEP": "Drive slowly until RUN.",
    }
}

/// Brakes for half a second when halted.
#[derive(Clone, Serialize, Deserialize)]
struct Wheels {
    braking: u32,
}

impl Process for Wheels {
    type Params = rcs::NoParams;
    type Ports = ();
    type Command = WheelsCommand;
    const DEF: ProcessDef = ProcessDef {
        plugin: "wheels",
        summary: "Drives.",
        period_ms: 20.0,
        latency_ms: 0.0,
        reads_ground_truth: false,
    };

    fn ports(_: &mut PortBuilder) {}

    fn new(_params: &Self::Params) -> Self {
        Self { braking: 0 }
    }

    fn cycle(&mut self, (): &(), _params: &Self::Params, cx: &mut Cycle<'_>) {
        self.braking = 0;
        cx.exec(if cx.command::<Self>().is_some() { "creeps" } else { "drives" });
    }

    fn halt(&mut self, (): &(), _params: &Self::Params, cx: &mut Cycle<'_>) {
        self.braking += 1;
        if self.braking > 25 { cx.done("stands") } else { cx.exec("brakes") }
    }
}

/// Is in `ERROR` while a status that it reads says so, and panics when that asks for a panic.
#[derive(Clone, Serialize, Deserialize)]
struct Part;

impl Process for Part {
    type Params = rcs::NoParams;
    type Ports = In<rcs::Status>;
    type Command = NoCommands;
    const DEF: ProcessDef = ProcessDef {
        plugin: "part",
        summary: "Works.",
        period_ms: 20.0,
        latency_ms: 0.0,
        reads_ground_truth: false,
    };

    fn ports(b: &mut PortBuilder) -> Self::Ports {
        b.optional_input("fate", "What befalls it.")
    }

    fn new(_params: &Self::Params) -> Self {
        Self
    }

    fn cycle(&mut self, fate: &Self::Ports, _params: &Self::Params, cx: &mut Cycle<'_>) {
        match cx.latest(fate).map(|fate| (fate.state(), fate.state_text.clone())) {
            Some((rcs::ProcessState::Error, why)) if why == "panic" => panic!("worn out"),
            Some((rcs::ProcessState::Error, why)) => cx.error(why),
            _ => cx.exec("works"),
        }
    }
}

rcs_runtime::commands! {
    /// Commands of [`Notes`].
    enum NotesCommand {
        Save = "SAVE" once: "Count it.",
        Clear = "CLEAR" once: "Count it.",
        Keep = "KEEP": "Keep notes of another kind until RUN.",
    }
}

/// Keeps notes: its status counts its commands.
#[derive(Clone, Serialize, Deserialize)]
struct Notes {
    saved: u32,
    cleared: u32,
}

impl Process for Notes {
    type Params = rcs::NoParams;
    type Ports = ();
    type Command = NotesCommand;
    const DEF: ProcessDef = ProcessDef {
        plugin: "notes",
        summary: "Keeps notes.",
        period_ms: 500.0,
        latency_ms: 0.0,
        reads_ground_truth: false,
    };

    fn ports(_: &mut PortBuilder) {}

    fn new(_params: &Self::Params) -> Self {
        Self { saved: 0, cleared: 0 }
    }

    fn cycle(&mut self, (): &(), _params: &Self::Params, cx: &mut Cycle<'_>) {
        while let Some(command) = cx.next_command::<Self>() {
            match command {
                NotesCommand::Save => self.saved += 1,
                NotesCommand::Clear => self.cleared += 1,
                NotesCommand::Keep => {}
            }
        }
        cx.exec(format!("saved {}, cleared {}", self.saved, self.cleared));
    }
}

const STACK: &str = r#"
format = 1
name = "robot"
authority_s = 1.0

[[process]]
name = "robot"
plugin = "supervisor"
supervisor = "viewer"

[[process]]
name = "perception"
plugin = "supervisor"
supervisor = "robot"

[[process]]
name = "wheels"
plugin = "wheels"
supervisor = "robot"
as = "vehicle_interface"

[[process]]
name = "camera"
plugin = "part"
supervisor = "perception"
inputs = { fate = "/operator/camera" }

[[process]]
name = "lamp"
plugin = "part"
supervisor = "robot"
as = "auxiliary"
inputs = { fate = "/operator/lamp" }

[[process]]
name = "map"
plugin = "notes"
supervisor = "robot"
as = "maps"

[[process]]
name = "memory"
plugin = "notes"
supervisor = "robot"
as = "memory"
"#;

struct Bench {
    session: Session,
    now_ms: u64,
    serial: u64,
}

impl Bench {
    fn new() -> Self {
        let plugins = &[
            ProcessType::of::<Supervisor>(),
            ProcessType::of::<Wheels>(),
            ProcessType::of::<Part>(),
            ProcessType::of::<Notes>(),
        ];
        let plan = Plan::new(StackFile::parse("robot.toml", STACK).unwrap(), plugins, &[]).unwrap();
        let run = Stepped::new(Arc::new(plan), None, RunOptions::default()).unwrap();
        let mut bench = Self { session: Session::new(run).unwrap(), now_ms: 0, serial: 1 };
        bench.forward(200);
        bench
    }

    fn forward(&mut self, by_ms: u64) {
        self.now_ms += by_ms;
        self.session.forward_until(Stamp(self.now_ms * 1_000_000), &Task::default()).unwrap();
    }

    fn write<T: Payload>(&mut self, buffer: String, message: T) {
        self.session.write(ExternalEvent::operator(buffer, AnyMessage::new(message))).unwrap();
    }

    fn say(&mut self, process: &str, name: &str) {
        self.serial += 1;
        let command = rcs::Command { serial: self.serial, name: name.to_owned(), ..Default::default() };
        self.write(format!("/{process}/command"), command);
    }

    /// The operator keeps a process, whose authority lasts one second, for a multiple of half a second.
    fn hold(&mut self, process: &str, by_ms: u64) {
        for _ in 0..by_ms / 500 {
            self.say(process, "TAKE");
            self.forward(500);
        }
    }

    /// What happens to a part from now on: nothing, an error, or a panic.
    fn fate(&mut self, part: &str, why: &str) {
        let state = if why.is_empty() { rcs::ProcessState::Exec } else { rcs::ProcessState::Error };
        let status = rcs::Status { state: state.into(), state_text: why.to_owned(), ..Default::default() };
        self.write(format!("/operator/{part}"), status);
    }

    fn status(&self, process: &str) -> rcs::Status {
        let buffer = self.session.run().bus().get(&format!("/{process}/status")).unwrap();
        buffer.latest().unwrap().message.to().unwrap()
    }

    #[track_caller]
    fn expect(&self, process: &str, state: rcs::ProcessState, text: &str) {
        let status = self.status(process);
        assert_eq!((status.state(), status.state_text.as_str()), (state, text), "{process}");
    }
}

use rcs::ProcessState::{Done, Error, Exec};

#[test]
fn run_goes_down_every_level_in_the_instant_in_which_it_comes() {
    let bench = Bench::new();
    for process in ["robot", "perception"] {
        bench.expect(process, Exec, "all children run");
    }
    for process in ["camera", "lamp"] {
        bench.expect(process, Exec, "works");
        assert_eq!(bench.status(process).cycle, 11, "from the first cycle on");
    }
    bench.expect("wheels", Exec, "drives");
    assert_eq!(bench.status("camera").commander, "perception");
    assert_eq!(bench.status("perception").commander, "robot");
}

#[test]
fn halt_stands_the_vehicle_before_anything_else_is_halted() {
    let mut bench = Bench::new();
    bench.say("robot", "HALT");
    bench.forward(200);
    bench.expect("wheels", Exec, "brakes");
    bench.expect("robot", Exec, "waits for the vehicle to stand");
    bench.expect("camera", Exec, "works");
    bench.forward(800);
    bench.expect("wheels", Done, "stands");
    bench.expect("camera", Done, "halted");
    bench.expect("lamp", Done, "halted");
    bench.expect("perception", Done, "all children are halted");
    bench.expect("robot", Done, "all children are halted");
    bench.say("robot", "RUN");
    bench.forward(200);
    bench.expect("robot", Exec, "all children run");
    bench.expect("wheels", Exec, "drives");
    bench.expect("camera", Exec, "works");
}

#[test]
fn init_goes_down_and_is_done_when_all_are() {
    let mut bench = Bench::new();
    bench.say("robot", "INIT");
    bench.forward(400);
    bench.expect("robot", Done, "all children are initialized");
    bench.expect("camera", Done, "initialized");
    bench.say("robot", "RUN");
    bench.forward(200);
    bench.expect("robot", Exec, "all children run");
}

#[test]
fn an_essential_child_that_fails_two_levels_down_stops_the_vehicle_until_run() {
    let mut bench = Bench::new();
    bench.fate("camera", "blind");
    bench.forward(200);
    bench.expect("perception", Error, "camera is in ERROR: blind");
    let why = "has stopped the vehicle: perception is in ERROR: camera is in ERROR: blind";
    bench.expect("robot", Error, why);
    bench.expect("wheels", Exec, "brakes");
    bench.fate("camera", "");
    bench.forward(800);
    bench.expect("perception", Exec, "all children run");
    bench.expect("robot", Error, why);
    bench.expect("wheels", Done, "stands");
    bench.say("robot", "RUN");
    bench.forward(200);
    bench.expect("robot", Exec, "all children run");
    bench.expect("wheels", Exec, "drives");
}

#[test]
fn an_auxiliary_child_that_fails_is_reported_and_the_vehicle_drives_on() {
    let mut bench = Bench::new();
    bench.fate("lamp", "dark");
    bench.forward(200);
    bench.expect("robot", Exec, "runs; lamp is in ERROR: dark");
    bench.expect("wheels", Exec, "drives");
}

#[test]
fn a_child_that_panicked_stops_the_vehicle_and_comes_back_with_init_of_its_group() {
    let mut bench = Bench::new();
    bench.fate("camera", "panic");
    bench.forward(800);
    bench.expect("perception", Error, "camera is in ERROR: panicked: worn out");
    bench.expect("wheels", Done, "stands");
    bench.fate("camera", "");
    bench.say("robot", "RUN");
    bench.forward(200);
    let why = "RUN needs a process that works; this one panicked: worn out; expected INIT";
    bench.expect("perception", Error, &format!("camera is in ERROR: refused RUN: {why}"));
    bench.say("robot", "INIT");
    bench.forward(400);
    bench.expect("robot", Done, "all children are initialized");
    bench.say("robot", "RUN");
    bench.forward(200);
    bench.expect("camera", Exec, "works");
    bench.expect("robot", Exec, "all children run");
}

#[test]
fn init_and_run_within_a_period_both_go_down() {
    let mut bench = Bench::new();
    bench.fate("camera", "panic");
    bench.forward(800);
    bench.fate("camera", "");
    bench.say("robot", "INIT");
    bench.say("robot", "RUN");
    bench.forward(400);
    bench.expect("camera", Exec, "works");
    bench.expect("robot", Exec, "all children run");
    bench.expect("wheels", Exec, "drives");
}

#[test]
fn the_vehicle_is_not_called_stopped_before_its_interface_has_accepted_halt() {
    let mut bench = Bench::new();
    bench.fate("camera", "blind");
    let mut texts: Vec<String> = Vec::new();
    for _ in 0..20 {
        bench.forward(10);
        let (robot, wheels) = (bench.status("robot").state_text, bench.status("wheels").command);
        if robot.starts_with("has stopped") {
            assert_eq!(wheels, "HALT");
        }
        if texts.last() != Some(&robot) {
            texts.push(robot);
        }
    }
    let why = "perception is in ERROR: camera is in ERROR: blind";
    let stop = [format!("stops the vehicle: {why}"), format!("has stopped the vehicle: {why}")];
    assert_eq!(texts, ["all children run".to_owned()].into_iter().chain(stop).collect::<Vec<_>>());
}

#[test]
fn save_and_clear_reach_the_maps_and_change_nothing_else() {
    let mut bench = Bench::new();
    bench.say("robot", "RUN");
    bench.forward(1000);
    bench.say("robot", "SAVE");
    bench.forward(1000);
    bench.expect("memory", Exec, "saved 1, cleared 0");
    bench.expect("map", Exec, "saved 0, cleared 0");
    bench.say("robot", "CLEAR");
    bench.forward(3000);
    bench.expect("memory", Exec, "saved 1, cleared 1");
    bench.expect("map", Exec, "saved 0, cleared 1");
    bench.expect("robot", Exec, "all children run");

    // Both in one cycle: it runs and saves.
    bench.say("robot", "INIT");
    bench.forward(1000);
    bench.say("robot", "RUN");
    bench.say("robot", "SAVE");
    bench.forward(1000);
    bench.expect("robot", Exec, "all children run");
    bench.expect("wheels", Exec, "drives");
    bench.expect("memory", Exec, "saved 1, cleared 0");

    // A vehicle that the supervisor has stopped stays so.
    bench.fate("camera", "is blind");
    bench.forward(1000);
    bench.fate("camera", "");
    bench.say("robot", "SAVE");
    bench.forward(1000);
    bench.expect("wheels", Done, "stands");
    assert_eq!(bench.status("robot").state(), Error);

    // It drives again after RUN, also where another command comes in the same cycle.
    for other in ["SAVE", "CLEAR"] {
        for orders in [["RUN", other], [other, "RUN"]] {
            bench.fate("camera", "is blind");
            bench.forward(1000);
            bench.expect("wheels", Done, "stands");
            bench.fate("camera", "");
            bench.forward(300);
            for order in orders {
                bench.say("robot", order);
            }
            bench.forward(1000);
            bench.expect("robot", Exec, "all children run");
            bench.expect("wheels", Exec, "drives");
        }
    }

    // A group without maps says so.
    bench.say("perception", "SAVE");
    bench.forward(100);
    let status = bench.status("perception");
    assert!(status.last_fault.contains("SAVE: no child has a map"), "{status:?}");
}
