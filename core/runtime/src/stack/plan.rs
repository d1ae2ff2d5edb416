//! Plans: a stack file that has been checked against the plugins, so that its wiring has no errors.

use super::compose::Origin;
use super::error::{StackError, one_of};
use super::file::{Class, StackFile, VIEWER};
use crate::command::{BUILT_IN, CommandDef};
use crate::conversion::converts;
use crate::files::FileTable;
use crate::ports::PortDef;
use crate::process::ProcessType;
use rcs_bus::BufferSpec;
use rcs_msg::{AnyMessage, DeltaCodec, rcs};
use std::collections::BTreeSet;
use std::sync::Arc;

/// What a stack runs. Indices refer to [`Plan::buffers`] and [`Plan::processes`].
#[derive(Clone, Debug)]
pub struct Plan {
    /// The stack file.
    pub file: StackFile,
    /// Hash of the text of the file and of all parameters, which name files by their content, 16 hexadecimal digits.
    pub hash: String,
    /// Topics of the log that it reads.
    pub inputs: Vec<InputPlan>,
    /// Processes in the order of the file, which is their rank.
    pub processes: Vec<ProcessPlan>,
    /// All buffers, including those of the runtime.
    pub buffers: Vec<BufferPlan>,
    /// The files that parameters name.
    pub files: FileTable,
    /// How long the operator keeps the authority over a process without sending a command.
    pub authority_ns: u64,
    /// What is valid but probably a mistake, with file and line if it stands in one place.
    pub warnings: Vec<String>,
}

/// A topic of the log and the buffer that it feeds.
#[derive(Clone, Debug)]
pub struct InputPlan {
    /// Topic of the log.
    pub topic: String,
    /// The buffer.
    pub buffer: usize,
    /// Whether all of it is given at the start.
    pub is_static: bool,
    /// Position of the topic in the text.
    pub(crate) origin: Origin,
}

/// A process with its wiring and parameters.
#[derive(Clone, Debug)]
pub struct ProcessPlan {
    /// Name, unique in the stack.
    pub name: Arc<str>,
    /// Its type.
    pub kind: ProcessType,
    /// The process that commands it; `None` for the viewer.
    pub supervisor: Option<usize>,
    /// The processes that it commands, by its declared children, then in the order of the file.
    pub children: Vec<ChildPlan>,
    /// Computer on which it runs.
    pub host: String,
    /// How the operating system schedules it in a live run.
    pub class: Class,
    /// Pool of threads on which it computes in a live run; `None` for that of its class.
    pub pool: Option<String>,
    /// Period of its cycles.
    pub period_ns: u64,
    /// Time from the start of a cycle until its output is visible.
    pub latency_ns: u64,
    /// Buffer of each input port; `None` if an optional one is not wired.
    pub inputs: Vec<Option<usize>>,
    /// Buffer of each output port.
    pub outputs: Vec<usize>,
    /// Parameters, including defaults; files are named ([`FileTable::resolve`]).
    pub params: AnyMessage,
    /// Buffer of commands to it.
    pub command_buffer: usize,
    /// Buffer of its statuses.
    pub status_buffer: usize,
    /// Buffer of its parameters.
    pub params_buffer: usize,
}

/// A child of a process.
#[derive(Clone, Copy, Debug)]
pub struct ChildPlan {
    /// Which of the declared children it is.
    pub slot: usize,
    /// The process.
    pub process: usize,
}

/// A buffer, and how much of it is recorded.
#[derive(Clone, Debug)]
pub struct BufferPlan {
    /// Name, type, depth, metadata.
    pub spec: BufferSpec,
    /// Whether it is recorded.
    pub record: bool,
    /// Greatest number of messages recorded per second.
    pub record_hz: Option<f64>,
    /// The codec by which it is recorded; `None` if every message is recorded as it is.
    pub codec: Option<&'static dyn DeltaCodec>,
}

/// Key of the channel metadata of buffers with the ground truth of a simulation.
pub(crate) const TRUTH: &str = "rcs.ground_truth";

/// Names of the runtime's own buffers.
pub(crate) mod names {
    pub(crate) const RUN: &str = "/runtime/run";
    pub(crate) const PROCESSES: &str = "/runtime/processes";
    pub(crate) const TIMING: &str = "/runtime/timing";
    pub(crate) const LOG: &str = "/runtime/log";
    pub(crate) const SCHEDULE: &str = "/runtime/schedule";
    pub(crate) const OVERRIDE: &str = "/runtime/override";
    /// The overrides in force.
    pub(crate) const OVERRIDES: &str = "/runtime/overrides";
    /// The journal.
    pub(crate) const JOURNAL: &str = "/runtime/journal";
    /// Prefix of all of these.
    pub(crate) const OWN: &str = "/runtime/";
}

impl Plan {
    /// The parameters of every process at the start, in the form of a run's identity.
    pub(crate) fn initial_params(&self) -> Vec<rcs::InitialParams> {
        let of = |process: &ProcessPlan| rcs::InitialParams {
            process: process.name.to_string(),
            schema: process.params.schema().name().to_owned(),
            params: process.params.bytes(),
        };
        self.processes.iter().map(of).collect()
    }

    /// Messages that describe the processes to a window: recorded in every log, sent to every link.
    pub fn process_infos(&self) -> Vec<rcs::ProcessInfo> {
        let buffer = |index: usize| self.buffers[index].spec.name.clone();
        let port = |def: PortDef, index: Option<usize>| rcs::PortInfo {
            name: def.name.to_owned(),
            buffer: index.map(buffer).unwrap_or_default(),
            schema: def.schema.name().to_owned(),
            help: def.help.to_owned(),
            required: def.required,
            role: def.role.map_or_else(String::new, |role| role.name().to_owned()),
        };
        let command = |def: &CommandDef| rcs::CommandInfo {
            name: def.name.to_owned(),
            help: def.help.to_owned(),
            parameters_schema: def.parameters_schema().to_owned(),
        };
        let child_of = |rank: usize| {
            let parent = &self.processes[self.processes[rank].supervisor?];
            let child = parent.children.iter().find(|child| child.process == rank)?;
            parent.kind.children().get(child.slot).map(|def| def.name.to_owned())
        };
        let info = |(rank, process): (usize, &ProcessPlan)| {
            let def = process.kind.def();
            let commands = BUILT_IN.iter().chain(process.kind.commands()).map(command).collect();
            let inputs = process.kind.inputs().into_iter().zip(process.inputs.iter().copied());
            let outputs = process.kind.outputs().into_iter().zip(process.outputs.iter().copied().map(Some));
            rcs::ProcessInfo {
                name: process.name.to_string(),
                plugin: def.plugin.to_owned(),
                summary: def.summary.to_owned(),
                supervisor: process
                    .supervisor
                    .map_or_else(|| VIEWER.to_owned(), |parent| self.processes[parent].name.to_string()),
                host: process.host.clone(),
                period_ns: process.period_ns,
                latency_ns: process.latency_ns,
                rank: rank as u32,
                command_buffer: buffer(process.command_buffer),
                status_buffer: buffer(process.status_buffer),
                params_buffer: buffer(process.params_buffer),
                params_schema: process.kind.params_schema().name().to_owned(),
                inputs: inputs.map(|(def, index)| port(def, index)).collect(),
                outputs: outputs.map(|(def, index)| port(def, index)).collect(),
                commands,
                child: child_of(rank).unwrap_or_default(),
            }
        };
        self.processes.iter().enumerate().map(info).collect()
    }

    /// An error for each topic that the stack reads and that a log does not have, or not in a type that converts to that
    /// of its readers. It names the topics that convert.
    pub fn check_log(&self, log: &rcs_log::LogInfo) -> Vec<StackError> {
        let error = |input: &InputPlan| {
            let wanted = self.buffers[input.buffer].spec.schema.name();
            let fits = |topic: &rcs_log::LogTopic| {
                rcs_msg::canonical_name(&topic.schema).is_some_and(|got| converts(got, wanted))
            };
            let message = match log.topics.iter().find(|topic| topic.name == input.topic) {
                Some(topic) if fits(topic) => return None,
                Some(topic) => format!(
                    "topic {} holds {} ({}), which is not read as {wanted}",
                    input.topic,
                    topic.schema.name(),
                    topic.schema.message_encoding().name(),
                ),
                None => format!("the log has no topic {} of type {wanted}", input.topic),
            };
            let fitting: BTreeSet<&str> =
                log.topics.iter().filter(|topic| fits(topic)).map(|topic| topic.name.as_str()).collect();
            let expected = if fitting.is_empty() {
                "none of its topics is of this type".to_owned()
            } else {
                format!("expected {}", one_of(fitting))
            };
            let (file, line) = (input.origin.file.clone(), input.origin.line);
            Some(StackError { file, line, message: format!("{message}; {expected}") })
        };
        self.inputs.iter().filter_map(error).collect()
    }
}
