//! Our side: processes behind dynamic dispatch, in simulated time, wired by a stack file.

use std::path::Path;
use std::sync::Arc;

use rcs_msg::foxglove;
use rcs_runtime::{
    Cycle, In, NoCommands, Out, Plan, PortBuilder, Process, ProcessDef, ProcessType, RecordOptions,
    Recording, RunOptions, StackFile, Stepped,
};
use serde::{Deserialize, Serialize};

/// Reads a pose, writes a pose (seven numbers, 67 bytes encoded), posts its status.
#[derive(Clone, Serialize, Deserialize)]
struct Relay;

struct RelayPorts {
    input: In<foxglove::Pose>,
    output: Out<foxglove::Pose>,
}

impl Process for Relay {
    // Parameters are read once, so their type does not matter here.
    type Params = rcs_msg::rcs::NoParams;
    type Ports = RelayPorts;
    type Command = NoCommands;
    const DEF: ProcessDef = ProcessDef {
        plugin: "relay",
        summary: "Relays.",
        period_ms: 1.0,
        latency_ms: 0.0,
        reads_ground_truth: false,
    };

    fn ports(builder: &mut PortBuilder) -> RelayPorts {
        RelayPorts {
            input: builder.optional_input("input", "Pose."),
            output: builder.output("output", "Pose, a metre ahead.").build(),
        }
    }

    fn new(_params: &Self::Params) -> Self {
        Self
    }

    fn cycle(&mut self, ports: &RelayPorts, _params: &Self::Params, cx: &mut Cycle<'_>) {
        let mut pose = cx.read_newest(&ports.input).map(|pose| *pose).unwrap_or_default();
        pose.position.get_or_insert_default().x += 1.0;
        pose.orientation.get_or_insert_default().w = 1.0;
        cx.exec("relaying");
        cx.write(&ports.output, cx.now(), pose);
    }
}

/// Reads a pose.
#[derive(Clone, Serialize, Deserialize)]
struct Sink;

impl Process for Sink {
    type Params = rcs_msg::rcs::NoParams;
    type Ports = In<foxglove::Pose>;
    type Command = NoCommands;
    const DEF: ProcessDef = ProcessDef {
        plugin: "sink",
        summary: "Reads.",
        period_ms: 1.0,
        latency_ms: 0.0,
        reads_ground_truth: false,
    };

    fn ports(builder: &mut PortBuilder) -> In<foxglove::Pose> {
        builder.input("input", "Pose.")
    }

    fn new(_params: &Self::Params) -> Self {
        Self
    }

    fn cycle(&mut self, input: &In<foxglove::Pose>, _params: &Self::Params, cx: &mut Cycle<'_>) {
        std::hint::black_box(cx.read_newest(input));
        cx.exec("reading");
    }
}

/// One process that reads what it wrote in the previous cycle.
pub(crate) const ONE: &str = r#"
format = 1
name = "one"

[[process]]
name = "relay"
plugin = "relay"
supervisor = "viewer"
inputs = { input = "/relay/output" }
"#;

/// The graph that the peer runs: a sensor, a planner and a vehicle.
pub(crate) const THREE: &str = r#"
format = 1
name = "three"

[[process]]
name = "sensor"
plugin = "relay"
supervisor = "viewer"

[[process]]
name = "planner"
plugin = "relay"
supervisor = "viewer"
inputs = { input = "/sensor/output" }

[[process]]
name = "vehicle"
plugin = "sink"
supervisor = "viewer"
inputs = { input = "/planner/output" }
"#;

/// Starts a stack, recorded if a path is given; each call of the returned function runs `cycles` cycles.
pub(crate) fn start(stack: &str, log: Option<&Path>, cycles: usize) -> impl FnMut() + use<> {
    let plugins = [ProcessType::of::<Relay>(), ProcessType::of::<Sink>()];
    let file = StackFile::parse("bench.toml", stack).expect("the stack is well formed");
    let plan = Arc::new(Plan::new(file, &plugins, &[]).expect("the stack fits its plugins"));
    let mut stepped = Stepped::new(Arc::clone(&plan), None, RunOptions::default()).expect("the stack runs");
    let options = RecordOptions { lossless: true, build: "bench".to_owned(), ..RecordOptions::default() };
    let recording = log.map(|log| {
        Recording::start(log, &plan, stepped.buffers(), &options).expect("a recording that starts")
    });
    stepped.begin().expect("a run that begins");
    move || {
        // Kept until the run ends, which is when the closure is dropped.
        let _ = &recording;
        for _ in 0..cycles {
            stepped.advance().expect("a cycle");
        }
    }
}
