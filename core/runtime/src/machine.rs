//! The buffers and nodes of a plan, and writes from outside.

use crate::error::RunError;
use crate::journal::ExternalEvent;
use crate::node::{Node, check_params};
use crate::options::RunOptions;
use crate::overrides::{Change, OverrideTable};
use crate::stack::{Plan, ProcessPlan, names};
use crate::workers::Slot;
use rcs_bus::{Buffer, Draft, FaultKind, OverrideValue, WriterId};
use rcs_msg::{AnyMessage, Stamp, rcs};
use std::sync::Arc;

/// An external event that has been checked and can take effect at once.
pub(crate) struct CheckedEvent {
    pub(crate) event: ExternalEvent,
    /// Its change of an override, if it is one.
    change: Option<Change>,
}

impl CheckedEvent {
    /// An event of the runtime itself, which needs no check.
    pub(crate) fn own(event: ExternalEvent) -> Self {
        Self { event, change: None }
    }

    /// Whether it makes messages late.
    pub(crate) fn is_late(&self) -> bool {
        let Some(Change::Set { new, .. }) = &self.change else { return false };
        new.fault().is_some_and(|fault| matches!(fault.kind, FaultKind::Late { .. }))
    }
}

/// The buffers and nodes of a plan, and the writers that are not processes.
pub(crate) struct Machine {
    pub(crate) plan: Arc<Plan>,
    pub(crate) bus: rcs_bus::Bus,
    pub(crate) buffers: Vec<Arc<Buffer>>,
    pub(crate) nodes: Vec<Slot>,
    /// The overrides; threads of a live run share them.
    pub(crate) overrides: Arc<OverrideTable>,
}

impl Machine {
    pub(crate) fn new(plan: Arc<Plan>, seed: u64) -> Result<Self, RunError> {
        let mut bus = rcs_bus::Bus::default();
        let mut buffers = Vec::new();
        for buffer in &plan.buffers {
            buffers.push(bus.add(buffer.spec.clone())?);
        }
        let mut ids = Vec::new();
        for process in &plan.processes {
            ids.push(bus.add_writer(&process.name)?);
        }
        let last = ids.last().map_or(WriterId::RUNTIME.0, |id| id.0);
        let names: Arc<[Arc<str>]> = (0..=last).map(|id| bus.writer_name(WriterId(id))).collect();
        let mut nodes = Vec::new();
        for (index, (process, &id)) in plan.processes.iter().zip(&ids).enumerate() {
            let node = Node::new(&plan, index, &buffers, id, &names, seed);
            nodes.push(Slot::new(node.ok_or_else(|| {
                RunError::Refused(format!("the parameters of {} are of another type", process.name))
            })?));
        }
        let overrides = OverrideTable::new(&plan, &bus, &buffers);
        let overrides =
            overrides.ok_or_else(|| RunError::Refused("the plan lacks the runtime's buffers".to_owned()))?;
        Ok(Self { plan, bus, buffers, nodes, overrides: Arc::new(overrides) })
    }

    /// The buffer with this name, for a write.
    pub(crate) fn buffer(&self, name: &str) -> Result<&Arc<Buffer>, RunError> {
        self.bus.get(name).ok_or_else(|| RunError::Refused(format!("there is no buffer {name} to write to")))
    }

    /// Accepts an external event at its position. A refused event changes nothing.
    pub(crate) fn take(&self, event: ExternalEvent) -> Result<(), RunError> {
        self.apply(self.check(event)?)
    }

    /// Refuses events for buffers that do not exist or belong to the runtime, parameters that their process refuses,
    /// and overrides that do not fit. It changes nothing and may take long, so a live run calls it without its lock.
    pub(crate) fn check(&self, event: ExternalEvent) -> Result<CheckedEvent, RunError> {
        self.buffer(&event.buffer)?;
        // A branch announcement of the runtime is part of the branch's journal.
        let is_branch = &*event.buffer == names::RUN && event.writer == WriterId::RUNTIME;
        if event.buffer.starts_with(names::OWN) && &*event.buffer != names::OVERRIDE && !is_branch {
            return Err(RunError::Refused(format!(
                "{} is written by the runtime alone; expected a buffer of the stack's, or {}",
                event.buffer,
                names::OVERRIDE
            )));
        }
        let is_params =
            |process: &ProcessPlan| self.plan.buffers[process.params_buffer].spec.name == *event.buffer;
        if let Some(process) = self.plan.processes.iter().find(|process| is_params(process)) {
            check_params(&event.message)
                .and_then(|()| process.kind.check(&event.message, &self.plan.files))
                .map_err(|error| RunError::Refused(format!("{}: {error}", event.buffer)))?;
        }
        let is_override = &*event.buffer == names::OVERRIDE;
        let change = is_override.then(|| self.overrides.check(&event.message)).transpose()?;
        change.as_ref().map_or(Ok(()), |change| self.check_whole(change))?;
        Ok(CheckedEvent { event, change })
    }

    /// Applies an event that has been checked: sets the override, publishes the message, and journals the event. It
    /// only passes references on.
    pub(crate) fn apply(&self, CheckedEvent { event, change }: CheckedEvent) -> Result<(), RunError> {
        let buffer = self.buffer(&event.buffer)?;
        let now = event.place.time;
        if let Some(change) = change {
            // The sequence of the message in its buffer is the number of the override.
            self.overrides.apply(change, buffer.newest() + 1, now);
        }
        let draft = Draft { log_time: now, acq_time: event.acq_time(), message: event.message.clone() };
        buffer.writer(event.writer).write(draft)?;
        let message = AnyMessage::deferred::<ExternalEvent, rcs::JournalEvent>(event);
        self.buffer(names::JOURNAL)?.writer(WriterId::RUNTIME).write(Draft {
            log_time: now,
            acq_time: now,
            message,
        })?;
        self.overrides.update(now);
        Ok(())
    }

    /// Refuses complete parameter messages that their process refuses.
    fn check_whole(&self, change: &Change) -> Result<(), RunError> {
        let Change::Set { indices, new, .. } = change else { return Ok(()) };
        let (&[index], OverrideValue::Message(message)) = (indices.as_slice(), &new.value) else {
            return Ok(());
        };
        let process = self.plan.processes.iter().find(|process| process.params_buffer == index);
        let checked = process.map_or(Ok(()), |process| {
            check_params(message).and_then(|()| process.kind.check(message, &self.plan.files))
        });
        let name = &self.plan.buffers[index].spec.name;
        checked.map_err(|error| RunError::Refused(format!("the override of {name}: {error}")))
    }

    /// Writes the first messages of every run: its identity, its processes, their parameters, and the viewer's `RUN`.
    pub(crate) fn begin(&self, start: Stamp, options: &RunOptions, live: bool) -> Result<(), RunError> {
        let run = rcs::RunInfo {
            stack: self.plan.file.name().to_owned(),
            stack_text: self.plan.file.text.clone(),
            stack_hash: self.plan.hash.clone(),
            seed: options.seed,
            build: options.build.clone(),
            log: options.log_identity.clone(),
            params: self.plan.initial_params(),
            files: self.plan.files.to_proto(),
            live,
            ..rcs::RunInfo::default()
        };
        let write = |buffer: &Arc<Buffer>, writer: WriterId, message: AnyMessage| {
            buffer.writer(writer).write(Draft { log_time: start, acq_time: start, message })
        };
        write(self.buffer(names::RUN)?, WriterId::RUNTIME, AnyMessage::new(run))?;
        for info in self.plan.process_infos() {
            write(self.buffer(names::PROCESSES)?, WriterId::RUNTIME, AnyMessage::new(info))?;
        }
        for process in &self.plan.processes {
            write(&self.buffers[process.params_buffer], WriterId::RUNTIME, process.params.clone())?;
            if process.supervisor.is_none() {
                let command = rcs::Command {
                    timestamp: Some(start.to_proto()),
                    serial: 1,
                    name: "RUN".to_owned(),
                    ..rcs::Command::default()
                };
                write(&self.buffers[process.command_buffer], WriterId::OPERATOR, AnyMessage::new(command))?;
            }
        }
        Ok(())
    }
}
