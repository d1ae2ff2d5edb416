//! Converts the entries of a stack file to a plan: finds every mistake, and reports it with its line.

use super::error::{StackError, one_of};
use super::family;
use super::file::{BufferEntry, Class, OverflowEntry, ProcessEntry, StackFile, VIEWER};
use super::params::ParamReader;
use super::plan::{BufferPlan, InputPlan, ProcessPlan, TRUTH, names};
use crate::ports::PortDef;
use crate::process::ProcessType;
use crate::role::{ROLE, Role};
use rcs_bus::{BufferSpec, Mode, Overflow};
use rcs_msg::{Payload, Schema, foxglove, rcs, schema_of};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use toml::Spanned;

/// Length of a process's command queue.
const COMMANDS: usize = 32;
/// The local computer, which is the only host so far.
const LOCAL: &str = "local";
/// Number of orders that a buffer keeps after they were read, for viewing.
const ORDERS: usize = 8;
/// Prefix of the buffers that the operator writes.
const OPERATOR: &str = "/operator/";

/// Intermediate state of the conversion.
pub(super) struct Builder<'a> {
    file: &'a StackFile,
    buffers: Vec<BufferPlan>,
    by_name: BTreeMap<String, usize>,
}

type Parts = (Vec<InputPlan>, Vec<ProcessPlan>, Vec<BufferPlan>);

impl<'a> Builder<'a> {
    pub(super) fn new(file: &'a StackFile) -> Self {
        Self { file, buffers: Vec::new(), by_name: BTreeMap::new() }
    }

    pub(super) fn build(
        mut self,
        plugins: &[ProcessType],
        params: &mut ParamReader<'_>,
    ) -> Result<Parts, StackError> {
        let mut processes = self.processes(plugins, params)?;
        family::join(self.file, &mut processes)?;
        let inputs = self.inputs()?;
        self.check_wiring(&inputs, &processes)?;
        super::sharing::check(self.file, &self.buffers, &inputs, &processes)?;
        self.buffer_entries()?;
        self.runtime_buffers(processes.len());
        Ok((inputs, processes, self.buffers))
    }

    fn processes(
        &mut self,
        plugins: &[ProcessType],
        params: &mut ParamReader<'_>,
    ) -> Result<Vec<ProcessPlan>, StackError> {
        let file = self.file;
        let entries = &file.content.processes;
        let mut taken = BTreeSet::new();
        for entry in entries {
            let name = &entry.get_ref().name;
            if !is_name(name.get_ref()) {
                return Err(file.error(
                    &name.span(),
                    format!(
                        "{:?} cannot name a process; expected letters, digits and underscores",
                        name.get_ref()
                    ),
                ));
            }
            if !taken.insert(name.get_ref()) {
                return Err(
                    file.error(&name.span(), format!("there are two processes named {}", name.get_ref()))
                );
            }
            if name.get_ref() == VIEWER || name.get_ref() == "runtime" {
                return Err(file.error(&name.span(), format!("the name {} is taken", name.get_ref())));
            }
        }
        for (path, _) in params.options.overrides {
            let process = path.split_once('.').map(|(process, _)| process);
            if !entries.iter().any(|entry| Some(entry.get_ref().name.get_ref().as_str()) == process) {
                let names = entries.iter().map(|entry| entry.get_ref().name.get_ref().as_str());
                return Err(StackError {
                    file: "--param".to_owned(),
                    line: 0,
                    message: format!(
                        "{path} names no parameter; expected <process>.<field>=<value>, with process {}",
                        one_of(names)
                    ),
                });
            }
        }
        // The buffers of processes come first, so that an error about a conflicting type names the wire and not the
        // process.
        for spanned in entries {
            let name = spanned.get_ref().name.get_ref();
            let command = format!("/{name}/command");
            let index = self.buffer(&command, &spanned.span(), schema_of::<rcs::Command>())?;
            // A command is never replaced before it is read; if the queue is full, its sender gets an error.
            self.buffers[index].spec.mode = Mode::Queue { depth: COMMANDS, overflow: Overflow::Refuse };
            self.buffer(&format!("/{name}/status"), &spanned.span(), schema_of::<rcs::Status>())?;
        }
        entries.iter().map(|entry| self.process(entry, plugins, params)).collect()
    }

    fn process(
        &mut self,
        spanned: &Spanned<ProcessEntry>,
        plugins: &[ProcessType],
        params: &mut ParamReader<'_>,
    ) -> Result<ProcessPlan, StackError> {
        let file = self.file;
        let entry = spanned.get_ref();
        let name = entry.name.get_ref().as_str();
        let plugin = &entry.plugin;
        let Some(kind) = plugins.iter().find(|kind| kind.def().plugin == plugin.get_ref()) else {
            let names = one_of(plugins.iter().map(|kind| kind.def().plugin));
            let message = format!("there is no plugin {:?}; expected {names}", plugin.get_ref());
            return Err(file.error(&plugin.span(), message));
        };
        let supervisor = self.supervisor(spanned)?;
        let host = self.host(entry)?;
        let millis = |value: &Option<Spanned<f64>>, default: f64, least: f64| match value {
            Some(ms) if ms.get_ref().is_finite() && (least..=1e7).contains(ms.get_ref()) => Ok(*ms.get_ref()),
            Some(ms) => Err(file.error(
                &ms.span(),
                format!("{} ms is out of range; expected {least} to 10000000", ms.get_ref()),
            )),
            None => Ok(default),
        };
        let period_ms = millis(&entry.period_ms, kind.def().period_ms, 0.1)?;
        let latency_ms = millis(&entry.latency_ms, kind.def().latency_ms, 0.0)?;

        let input_defs = kind.inputs();
        let output_defs = kind.outputs();
        check_ports(file, "input", &entry.inputs, &input_defs)?;
        check_ports(file, "output", &entry.outputs, &output_defs)?;
        let mut inputs = Vec::new();
        for def in &input_defs {
            inputs.push(match wired(&entry.inputs, def.name) {
                Some(buffer) => Some(self.buffer(buffer.get_ref(), &buffer.span(), &def.schema)?),
                None if def.required => {
                    let message = format!(
                        "process {name} has no buffer for its input {}; expected inputs.{} = \"/…\" ({})",
                        def.name, def.name, def.help
                    );
                    return Err(file.error(&spanned.span(), message));
                }
                None => None,
            });
        }
        let mut outputs = Vec::new();
        for def in &output_defs {
            let default = Spanned::new(spanned.span(), format!("/{name}/{}", def.name));
            let buffer = wired(&entry.outputs, def.name).unwrap_or(&default);
            let index = self.buffer(buffer.get_ref(), &buffer.span(), &def.schema)?;
            self.check_role(file, name, def, index, &buffer.span())?;
            let mut metadata = def.metadata.clone();
            if let Some(port) = metadata.get("rcs.overlay_of") {
                // The port names another port; views need the name of its buffer.
                let base = wired(&entry.inputs, port).or_else(|| wired(&entry.outputs, port));
                let own =
                    || output_defs.iter().any(|def| def.name == port).then(|| format!("/{name}/{port}"));
                match base.map(|buffer| buffer.get_ref().clone()).or_else(own) {
                    Some(buffer) => metadata.insert("rcs.overlay_of".to_owned(), buffer),
                    None => metadata.remove("rcs.overlay_of"),
                };
            }
            self.buffers[index].spec.metadata.extend(metadata);
            self.buffers[index].codec = self.buffers[index].codec.or(def.codec);
            outputs.push(index);
        }
        let params = params.read(name, entry, kind)?;
        let span = spanned.span();
        let mut own = |suffix: &str, schema| self.buffer(&format!("/{name}/{suffix}"), &span, schema);
        Ok(ProcessPlan {
            name: name.into(),
            kind: *kind,
            supervisor,
            children: Vec::new(),
            host,
            class: entry.class.as_ref().map_or(Class::default(), |class| *class.get_ref()),
            pool: entry.pool.as_ref().map(|pool| pool.get_ref().clone()),
            period_ns: (period_ms * 1e6).round() as u64,
            latency_ns: (latency_ms * 1e6).round() as u64,
            inputs,
            outputs,
            params,
            command_buffer: own("command", schema_of::<rcs::Command>())?,
            status_buffer: own("status", schema_of::<rcs::Status>())?,
            params_buffer: own("params", kind.params_schema())?,
        })
    }

    fn host(&self, entry: &ProcessEntry) -> Result<String, StackError> {
        match &entry.host {
            Some(host) if host.get_ref() != LOCAL => {
                let message =
                    format!("{:?} is no host that a process can run on; expected {LOCAL:?}", host.get_ref());
                Err(self.file.error(&host.span(), message))
            }
            _ => Ok(LOCAL.to_owned()),
        }
    }

    /// Refuses a role that does not suit the messages' type, and two roles for one buffer.
    fn check_role(
        &self,
        file: &StackFile,
        process: &str,
        def: &PortDef,
        index: usize,
        span: &std::ops::Range<usize>,
    ) -> Result<(), StackError> {
        let Some(named) = def.metadata.get(ROLE) else { return Ok(()) };
        let role: Role = named
            .parse()
            .map_err(|error| file.error(span, format!("output {process}.{}: {error}", def.name)))?;
        if !role.fits(def.schema.name()) {
            let message = format!(
                "output {process}.{} has the role {role} and the type {}; expected {}",
                def.name,
                def.schema.name(),
                role.types().join(" or ")
            );
            return Err(file.error(span, message));
        }
        match self.buffers[index].spec.metadata.get(ROLE) {
            Some(other) if other != named => {
                let buffer = &self.buffers[index].spec.name;
                let message = format!(
                    "output {process}.{} gives {buffer} the role {role}, another output {other}",
                    def.name
                );
                Err(file.error(span, message))
            }
            _ => Ok(()),
        }
    }

    fn supervisor(&self, process: &Spanned<ProcessEntry>) -> Result<Option<usize>, StackError> {
        let file = self.file;
        let entries = &file.content.processes;
        let name = process.get_ref().name.get_ref();
        let others = || {
            one_of(
                [VIEWER]
                    .into_iter()
                    .chain(entries.iter().map(|e| e.get_ref().name.get_ref().as_str()).filter(|n| n != name)),
            )
        };
        let Some(supervisor) = &process.get_ref().supervisor else {
            let message = format!("process {name} has no supervisor; expected supervisor = {}", others());
            return Err(file.error(&process.span(), message));
        };
        if supervisor.get_ref() == VIEWER {
            return Ok(None);
        }
        let parent_of = |name: &str| entries.iter().position(|entry| entry.get_ref().name.get_ref() == name);
        let Some(parent) = parent_of(supervisor.get_ref()) else {
            let message = format!(
                "there is no process {:?} to supervise {name}; expected {}",
                supervisor.get_ref(),
                others()
            );
            return Err(file.error(&supervisor.span(), message));
        };
        // The chain of supervisors must end at the viewer.
        let mut above = parent;
        for _ in 0..entries.len() {
            match entries[above].get_ref().supervisor.as_ref().map(Spanned::get_ref) {
                Some(next) if next != VIEWER => match parent_of(next) {
                    Some(next) => above = next,
                    None => return Ok(Some(parent)),
                },
                _ => return Ok(Some(parent)),
            }
        }
        let message = format!("process {name} supervises itself; expected a chain that ends at {VIEWER}");
        Err(file.error(&supervisor.span(), message))
    }

    fn inputs(&mut self) -> Result<Vec<InputPlan>, StackError> {
        let file = self.file;
        let mut inputs = Vec::new();
        for spanned in &file.content.inputs {
            let entry = spanned.get_ref();
            let known = self.by_name.get(entry.buffer.get_ref()).copied();
            let buffer = match (&entry.type_name, known) {
                (None, Some(buffer)) => buffer,
                (None, None) => {
                    let message = format!(
                        "no process reads {}; expected a buffer that one reads, or a type, like type = \"foxglove.Odometry\"",
                        entry.buffer.get_ref()
                    );
                    return Err(file.error(&entry.buffer.span(), message));
                }
                (Some(type_name), _) => {
                    let Some(schema) = rcs_msg::registry().schema(type_name.get_ref()) else {
                        let message = format!(
                            "there is no type {:?}; expected one of foxglove's or rcs's, like foxglove.Odometry",
                            type_name.get_ref()
                        );
                        return Err(file.error(&type_name.span(), message));
                    };
                    self.buffer(entry.buffer.get_ref(), &entry.buffer.span(), schema)?
                }
            };
            inputs.push(InputPlan {
                topic: entry.topic.get_ref().clone(),
                buffer,
                is_static: entry.is_static || entry.topic.get_ref().ends_with("/tf_static"),
                origin: file.origin(&entry.topic.span()),
            });
        }
        Ok(inputs)
    }

    /// Checks that every buffer that a process reads has a writer, and that only processes that may do so read the
    /// ground truth.
    fn check_wiring(&self, inputs: &[InputPlan], processes: &[ProcessPlan]) -> Result<(), StackError> {
        for (process, entry) in processes.iter().zip(&self.file.content.processes) {
            for (def, buffer) in process.kind.inputs().iter().zip(&process.inputs) {
                let Some(buffer) = *buffer else { continue };
                let spec = &self.buffers[buffer].spec;
                if spec.metadata.contains_key(TRUTH) && !process.kind.def().reads_ground_truth {
                    let message = format!(
                        "{} holds the ground truth of the simulation, which {} must not read; expected a buffer that a \
                         sensor or a process of the robot writes",
                        spec.name,
                        process.kind.def().plugin
                    );
                    let wire = wired(&entry.get_ref().inputs, def.name);
                    return Err(self.file.error(&wire.map_or(entry.span(), Spanned::span), message));
                }
                // The operator's buffers need no writer in the stack.
                if spec.name.starts_with(OPERATOR) {
                    continue;
                }
                let written = inputs.iter().any(|input| input.buffer == buffer)
                    || processes.iter().any(|other| {
                        other.outputs.contains(&buffer)
                            || [other.status_buffer, other.command_buffer, other.params_buffer]
                                .contains(&buffer)
                    });
                if !written {
                    let name = &self.buffers[buffer].spec.name;
                    let wire = wired(&entry.get_ref().inputs, def.name);
                    let span = wire.map_or(entry.span(), Spanned::span);
                    let mut writable: Vec<&str> = inputs
                        .iter()
                        .map(|input| input.buffer)
                        .chain(processes.iter().flat_map(|other| other.outputs.iter().copied()))
                        .filter(|&index| self.buffers[index].spec.schema.name() == def.schema.name())
                        .map(|index| self.buffers[index].spec.name.as_str())
                        .collect();
                    writable.sort_unstable();
                    writable.dedup();
                    let message = format!(
                        "nothing writes {name}, which process {} reads as {}; expected an [[input]] or an output of that \
                         type: {}",
                        process.name,
                        def.schema.name(),
                        one_of(writable)
                    );
                    return Err(self.file.error(&span, message));
                }
            }
        }
        Ok(())
    }

    fn buffer_entries(&mut self) -> Result<(), StackError> {
        let file = self.file;
        for (name, spanned) in &file.content.buffers {
            let Some(&index) = self.by_name.get(name.get_ref()) else {
                let names = one_of(self.by_name.keys().map(String::as_str));
                let message = format!("there is no buffer {}; expected {names}", name.get_ref());
                return Err(file.error(&name.span(), message));
            };
            // The writers were checked with the wiring.
            let BufferEntry { queue, overflow, record, record_hz, writers: _ } = spanned.get_ref();
            let plan = &mut self.buffers[index];
            let depth = queue.as_ref().map(Spanned::span).or(overflow.as_ref().map(Spanned::span));
            if let Some(span) = depth.filter(|_| is_command(file, name.get_ref())) {
                let message = format!("{} holds commands: always a queue of {COMMANDS}", name.get_ref());
                return Err(file.error(&span, message));
            }
            if let (Some(depth), Mode::Queue { overflow: Overflow::Grow, .. }) = (queue, plan.spec.mode) {
                let message = format!(
                    "{} holds {}, of which no message is ever dropped; expected no queue",
                    name.get_ref(),
                    plan.spec.schema.name()
                );
                return Err(file.error(&depth.span(), message));
            }
            match (queue, overflow) {
                (Some(depth), overflow) => {
                    if !(1..=100_000).contains(depth.get_ref()) {
                        let message =
                            format!("a queue of {} is not possible; expected 1 to 100000", depth.get_ref());
                        return Err(file.error(&depth.span(), message));
                    }
                    let overflow = match overflow.as_ref().map(|overflow| *overflow.get_ref()) {
                        Some(OverflowEntry::Refuse) => Overflow::Refuse,
                        Some(OverflowEntry::DropOldest) | None => Overflow::DropOldest,
                    };
                    plan.spec.mode = Mode::Queue { depth: *depth.get_ref(), overflow };
                }
                (None, Some(overflow)) => {
                    let message = "overflow is for a queue; expected queue = <depth> beside it";
                    return Err(file.error(&overflow.span(), message));
                }
                (None, None) => {}
            }
            plan.record = record.unwrap_or(true);
            if let Some(hz) = record_hz {
                if !(hz.get_ref().is_finite() && *hz.get_ref() > 0.0) {
                    let message = format!("{} is no rate; expected a number above 0", hz.get_ref());
                    return Err(file.error(&hz.span(), message));
                }
                plan.record_hz = Some(*hz.get_ref());
            }
        }
        Ok(())
    }

    fn runtime_buffers(&mut self, processes: usize) {
        fn spec<T: Payload>(name: &str, mode: Mode) -> BufferSpec {
            let schema = Arc::clone(schema_of::<T>());
            BufferSpec { name: name.to_owned(), schema, mode, metadata: BTreeMap::new() }
        }
        let queue = |depth: usize| Mode::Queue { depth: depth.max(1), overflow: Overflow::DropOldest };
        for spec in [
            spec::<rcs::RunInfo>(names::RUN, Mode::Latest),
            spec::<rcs::ProcessInfo>(names::PROCESSES, queue(processes)),
            spec::<rcs::Timing>(names::TIMING, Mode::Latest),
            spec::<foxglove::Log>(names::LOG, queue(64)),
            spec::<rcs::CycleRecord>(names::SCHEDULE, queue(64)),
            spec::<rcs::Override>(names::OVERRIDE, queue(16)),
            spec::<rcs::OverrideList>(names::OVERRIDES, Mode::Latest),
            spec::<rcs::JournalEvent>(names::JOURNAL, Mode::Latest),
        ] {
            self.by_name.insert(spec.name.clone(), self.buffers.len());
            self.buffers.push(BufferPlan { spec, record: true, record_hz: None, codec: None });
        }
    }

    /// The buffer with this name, created if it is new; an error if it has another type.
    fn buffer(
        &mut self,
        name: &str,
        span: &std::ops::Range<usize>,
        schema: &Arc<Schema>,
    ) -> Result<usize, StackError> {
        if !name.starts_with('/')
            || name.len() < 2
            || name.ends_with('/')
            || name.chars().any(char::is_whitespace)
        {
            let message = format!("{name:?} cannot name a buffer; expected a name like /wm1/map");
            return Err(self.file.error(span, message));
        }
        if name.starts_with(names::OWN) {
            let message = format!("{name} is the runtime's own; expected another name");
            return Err(self.file.error(span, message));
        }
        if let Some(&index) = self.by_name.get(name) {
            let holds = self.buffers[index].spec.schema.name();
            if holds != schema.name() {
                let message = format!(
                    "{name} holds {holds} elsewhere in this stack; expected it to hold {}",
                    schema.name()
                );
                return Err(self.file.error(span, message));
            }
            return Ok(index);
        }
        let spec = BufferSpec {
            name: name.to_owned(),
            schema: Arc::clone(schema),
            mode: mode_of(schema),
            metadata: BTreeMap::new(),
        };
        self.by_name.insert(name.to_owned(), self.buffers.len());
        self.buffers.push(BufferPlan { spec, record: true, record_hz: None, codec: None });
        Ok(self.buffers.len() - 1)
    }
}

/// Default mode of a buffer. An order of an operator or a supervisor must not be replaced before it is read; a mission with
/// zones alone does not replace the goals of the one before. This follows from the message type, whatever the stack says.
fn mode_of(schema: &Schema) -> Mode {
    let orders =
        [schema_of::<rcs::EmergencyStop>(), schema_of::<rcs::Command>(), schema_of::<rcs::Mission>()];
    let is_order = orders.iter().any(|order| order.name() == schema.name());
    if is_order { Mode::Queue { depth: ORDERS, overflow: Overflow::Grow } } else { Mode::Latest }
}

type Wires = BTreeMap<Spanned<String>, Spanned<String>>;

fn wired<'a>(wires: &'a Wires, port: &str) -> Option<&'a Spanned<String>> {
    wires.iter().find(|(name, _)| name.get_ref() == port).map(|(_, buffer)| buffer)
}

fn check_ports(file: &StackFile, what: &str, wires: &Wires, defs: &[PortDef]) -> Result<(), StackError> {
    match wires.keys().find(|name| !defs.iter().any(|def| def.name == name.get_ref())) {
        Some(name) => {
            let names = one_of(defs.iter().map(|def| def.name));
            let message = format!("there is no {what} {:?}; expected {names}", name.get_ref());
            Err(file.error(&name.span(), message))
        }
        None => Ok(()),
    }
}

/// Whether a buffer contains the commands for a process.
fn is_command(file: &StackFile, buffer: &str) -> bool {
    let process = buffer.strip_prefix('/').and_then(|rest| rest.strip_suffix("/command"));
    file.content.processes.iter().any(|entry| Some(entry.get_ref().name.get_ref().as_str()) == process)
}

fn is_name(name: &str) -> bool {
    !name.is_empty() && name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_')
}
