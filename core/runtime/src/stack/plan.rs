//! Plans: a stack file that has been checked against the plugins, so that its wiring has no errors.

use super::assets::NoAssets;
use super::builder::Builder;
use super::compose::Origin;
use super::error::{StackError, one_of};
use super::file::{Class, StackFile, VIEWER};
use super::params::{ParamReader, PlanOptions};
use crate::command::{BUILT_IN, CommandDef};
use crate::feed::Feed;
use crate::process::{PortDef, ProcessType};
use rcs_bus::BufferSpec;
use rcs_msg::{AnyMessage, DeltaCodec, rcs};
use std::sync::Arc;

/// What a stack runs. Indices refer to [`Plan::buffers`] and [`Plan::processes`].
#[derive(Clone, Debug)]
pub struct Plan {
    /// The stack file.
    pub file: StackFile,
    /// Hash of the text of the file and of all parameters, including the texts of files, 16 hexadecimal digits.
    pub hash: String,
    /// Topics of the log that it reads.
    pub inputs: Vec<InputPlan>,
    /// Processes in the order of the file, which is their rank.
    pub processes: Vec<ProcessPlan>,
    /// All buffers, including those of the runtime.
    pub buffers: Vec<BufferPlan>,
    /// How long the operator keeps the authority over a process without sending a command.
    pub authority_ns: u64,
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
    /// Parameters, including defaults.
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
    /// Checks a stack file against the list of plugins, with overrides of parameters: `(process.field, value)`.
    pub fn new(
        file: StackFile,
        plugins: &[ProcessType],
        overrides: &[(String, String)],
    ) -> Result<Self, StackError> {
        Self::with(file, plugins, &PlanOptions { overrides, course: None, assets: &NoAssets })
    }

    /// Checks a stack file against the list of plugins, with all options.
    pub fn with(
        file: StackFile,
        plugins: &[ProcessType],
        options: &PlanOptions<'_>,
    ) -> Result<Self, StackError> {
        let mut params = ParamReader::new(&file, *options)?;
        plugins.iter().for_each(ProcessType::register);
        let authority_ns = authority_ns(&file)?;
        let (inputs, processes, buffers) = Builder::new(&file).build(plugins, &mut params)?;
        let hash = hash_of(&file, &processes);
        Ok(Self { file, hash, inputs, processes, buffers, authority_ns })
    }

    /// The stack of a recorded run, from the text and the parameters in its identity. Files are read only for overrides
    /// of parameters; a course is one of the parameters.
    pub fn of_run(
        run: &rcs::RunInfo,
        plugins: &[ProcessType],
        options: &PlanOptions<'_>,
    ) -> Result<Self, StackError> {
        let file = StackFile::parse(&format!("{} (recorded)", run.stack), &run.stack_text)?;
        let mut params = ParamReader::given(&file, &run.params, *options);
        plugins.iter().for_each(ProcessType::register);
        let authority_ns = authority_ns(&file)?;
        let (inputs, processes, buffers) = Builder::new(&file).build(plugins, &mut params)?;
        let hash = hash_of(&file, &processes);
        Ok(Self { file, hash, inputs, processes, buffers, authority_ns })
    }

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

    /// Checks that a log has every topic that the stack reads, in a type that converts to that of its readers.
    pub fn check_log(&self, log: &rcs_log::LogInfo) -> Result<(), StackError> {
        for input in &self.inputs {
            let error = |message: String| StackError {
                file: input.origin.file.clone(),
                line: input.origin.line,
                message,
            };
            let Some(topic) = log.topics.iter().find(|topic| topic.name == input.topic) else {
                return Err(error(format!(
                    "the log has no topic {}; expected {}",
                    input.topic,
                    one_of(log.topics.iter().map(|topic| topic.name.as_str()))
                )));
            };
            let wanted = self.buffers[input.buffer].spec.schema.name();
            let got = rcs_msg::canonical_name(&topic.schema);
            if !got.is_some_and(|got| Feed::converts(got, wanted)) {
                return Err(error(format!(
                    "topic {} holds {} ({}), which is not read as {wanted}",
                    input.topic,
                    topic.schema.name(),
                    topic.schema.message_encoding().name(),
                )));
            }
        }
        Ok(())
    }
}

/// Hash of the text and of every parameter, whatever its origin.
fn hash_of(file: &StackFile, processes: &[ProcessPlan]) -> String {
    let mut hasher = blake3::Hasher::new();
    let mut part = |bytes: &[u8]| {
        hasher.update(&(bytes.len() as u64).to_le_bytes());
        hasher.update(bytes);
    };
    part(file.text.as_bytes());
    for process in processes {
        part(process.name.as_bytes());
        part(&process.params.bytes());
    }
    hasher.finalize().to_hex()[..16].to_owned()
}

/// The stack's `authority_s`; default 10 s.
fn authority_ns(file: &StackFile) -> Result<u64, StackError> {
    let Some(seconds) = &file.content.authority_s else { return Ok(10_000_000_000) };
    if !(0.1..=3600.0).contains(seconds.get_ref()) {
        let message = format!("{} s is out of range; expected 0.1 to 3600", seconds.get_ref());
        return Err(file.error(&seconds.span(), message));
    }
    Ok((seconds.get_ref() * 1e9).round() as u64)
}
