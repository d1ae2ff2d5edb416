//! Small processes for the tests of the runtime.
#![allow(dead_code, unreachable_pub, clippy::unwrap_used, reason = "shared by several test binaries")]

use rand_core::RngCore;
use rcs_log::{LogWriter, WriteHeader, WriterOptions};
use rcs_msg::{AnyMessage, Payload, Stamp, foxglove, rcs, schema_of};
use rcs_runtime::source::{Frame, Topic};
use rcs_runtime::{
    Cycle, In, NoCommands, Out, PastOptions, Plan, PortBuilder, Process, ProcessDef, ProcessType, Role,
    RunOptions, StackError, StackFile, Stepped,
};
use rcs_testkit::proto::CounterParams;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

rcs_runtime::commands! {
    /// The commands of a counter.
    pub enum CounterCommand {
        Clear = "CLEAR": "Starts again.",
        Add(CounterParams) = "ADD": "Adds `publish_hz` to the count.",
    }
}

/// Writes (count, a random number, its parameter `publish_hz`); `CLEAR` restarts the count.
#[derive(Clone, Serialize, Deserialize)]
pub struct Counter {
    count: u64,
}

impl Process for Counter {
    type Params = rcs_testkit::proto::CounterParams;
    type Ports = Out<foxglove::Vector3>;
    type Command = CounterCommand;
    const DEF: ProcessDef = ProcessDef {
        plugin: "counter",
        summary: "Counts.",
        period_ms: 10.0,
        latency_ms: 0.0,
        reads_ground_truth: false,
    };

    fn ports(b: &mut PortBuilder) -> Self::Ports {
        b.output("count", "Count, random number, parameter.").role(Role::Pose).build()
    }

    fn new(_params: &Self::Params) -> Self {
        Self { count: 0 }
    }

    fn cycle(&mut self, out: &Self::Ports, params: &Self::Params, cx: &mut Cycle<'_>) {
        while let Some(command) = cx.next_command::<Self>() {
            match command {
                CounterCommand::Clear => self.count = 0,
                CounterCommand::Add(params) => self.count += params.publish_hz as u64,
            }
        }
        self.count += 1;
        let y = f64::from(cx.rng().next_u32());
        cx.exec("counting");
        cx.write(out, cx.now(), foxglove::Vector3 { x: self.count as f64, y, z: params.publish_hz });
    }
}

/// Sums its inputs on the pool, and stores all of them.
#[derive(Clone, Serialize, Deserialize)]
pub struct Adder {
    all: Arc<Vec<f64>>,
}

pub struct AdderPorts {
    input: In<foxglove::Vector3>,
    sum: Out<foxglove::Vector3>,
}

impl Process for Adder {
    type Params = rcs::NoParams;
    type Ports = AdderPorts;
    type Command = NoCommands;
    const DEF: ProcessDef = ProcessDef {
        plugin: "adder",
        summary: "Adds.",
        period_ms: 20.0,
        latency_ms: 0.0,
        reads_ground_truth: false,
    };

    fn ports(b: &mut PortBuilder) -> Self::Ports {
        AdderPorts {
            input: b.input("input", "What is added."),
            sum: b.output("sum", "Sum, how many, age of the input in s.").build(),
        }
    }

    fn new(_params: &Self::Params) -> Self {
        Self { all: Arc::default() }
    }

    fn cycle(&mut self, ports: &Self::Ports, _params: &Self::Params, cx: &mut Cycle<'_>) {
        let mut newest = None;
        while let Some(message) = cx.read(&ports.input) {
            Arc::make_mut(&mut self.all).push(message.x + message.y);
            newest = Some(message.acq_time());
        }
        let Some(acq_time) = newest else {
            cx.exec("nothing new");
            return;
        };
        let chunks = self.all.chunks(7).collect::<Vec<_>>();
        let sums = cx.pool().map(chunks.len(), |index| chunks[index].iter().map(|x| x * 0.1).sum::<f64>());
        let sum = sums.iter().sum();
        let z = cx.now().seconds_since(acq_time);
        cx.exec(format!("{} numbers", self.all.len()));
        cx.write(&ports.sum, acq_time, foxglove::Vector3 { x: sum, y: self.all.len() as f64, z });
    }
}

/// Panics in its third cycle, after writing.
#[derive(Clone, Serialize, Deserialize)]
pub struct Fragile {
    cycles: u32,
}

impl Process for Fragile {
    type Params = rcs::NoParams;
    type Ports = Out<foxglove::Vector3>;
    type Command = NoCommands;
    const DEF: ProcessDef = ProcessDef {
        plugin: "fragile",
        summary: "Panics.",
        period_ms: 10.0,
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
        cx.write(out, cx.now(), foxglove::Vector3 { x: f64::from(self.cycles), ..Default::default() });
        assert!(self.cycles < 3, "worn out");
    }
}

pub const PLUGINS: &[ProcessType] =
    &[ProcessType::of::<Counter>(), ProcessType::of::<Adder>(), ProcessType::of::<Fragile>()];

/// A counter and an adder behind a queue, with a latency.
pub const PAIR: &str = r#"
format = 1
name = "pair"

[[process]]
name = "counter"
plugin = "counter"
supervisor = "viewer"
latency_ms = 3

[[process]]
name = "adder"
plugin = "adder"
supervisor = "viewer"
period_ms = 25
inputs = { input = "/counter/count" }

[buffers."/counter/count"]
queue = 16
"#;

/// Adds what a log has on `/a`.
pub const ON_LOG: &str = r#"
format = 1
name = "on_log"
[[input]]
buffer = "/in"
topic = "/a"
[[process]]
name = "adder"
plugin = "adder"
supervisor = "viewer"
inputs = { input = "/in" }
[buffers."/in"]
queue = 8
"#;

pub fn plan(text: &str) -> Result<Arc<Plan>, StackError> {
    Plan::new(StackFile::parse("test.toml", text)?, PLUGINS, &[]).map(Arc::new)
}

pub fn stepped(text: &str, options: RunOptions) -> Stepped {
    Stepped::new(plan(text).unwrap(), None, options).unwrap()
}

pub fn seconds(s: f64) -> Stamp {
    Stamp((s * 1e9).round() as u64)
}

/// The newest message of a buffer.
pub fn newest<T: Payload>(run: &Stepped, buffer: &str) -> T {
    run.bus().get(buffer).unwrap().latest().unwrap().message.to().unwrap()
}

/// So little memory for a past that nearly everything goes to disk.
pub const TIGHT_BYTES: u64 = 1 << 20;

pub fn tight(folder: &Path, disk_bytes: u64) -> PastOptions {
    PastOptions { memory_bytes: TIGHT_BYTES, disk_bytes, folder: folder.to_owned() }
}

/// The newest message of every topic, encoded, and the number of messages.
pub fn content(frame: &Frame) -> Vec<(String, u64, Option<Vec<u8>>)> {
    let of = |topic: &Topic| {
        assert!(!topic.pending, "{} is still to come", topic.name);
        let bytes = topic.latest.as_ref().map(|sample| sample.message.bytes().to_vec());
        (topic.name.to_string(), topic.messages, bytes)
    };
    // Measured times differ from run to run.
    frame.topics.iter().filter(|topic| !topic.name.contains("timing")).map(of).collect()
}

/// A log of vectors: `(seconds, topic, x)`, in the given order.
pub fn write_log(path: &Path, messages: &[(f64, &str, f64)]) {
    let published: Vec<_> = messages.iter().map(|&(time_s, topic, x)| (time_s, time_s, topic, x)).collect();
    write_published(path, &published);
}

/// The same with the times of publication: `(seconds, seconds of publication, topic, x)`.
pub fn write_published(path: &Path, messages: &[(f64, f64, &str, f64)]) {
    let mut writer = LogWriter::create(path, WriterOptions::default()).unwrap();
    let mut channels = BTreeMap::new();
    for (index, &(time_s, published_s, topic, x)) in messages.iter().enumerate() {
        let channel = *channels.entry(topic).or_insert_with(|| {
            writer.add_channel(topic, schema_of::<foxglove::Vector3>(), &BTreeMap::new()).unwrap()
        });
        let (log_time, publish_time) = (seconds(time_s), seconds(published_s));
        let header = WriteHeader { sequence: index as u32 + 1, log_time, publish_time };
        let message = AnyMessage::new(foxglove::Vector3 { x, y: 0.0, z: 0.0 });
        writer.write(channel, header, &message.bytes()).unwrap();
    }
    writer.finish().unwrap();
}
