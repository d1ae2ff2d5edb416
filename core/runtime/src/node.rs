//! A process with its ports: captures inputs, runs one cycle, publishes what it wrote. Both executors use it.

use crate::cycle::{Cycle, InputView, Staged};
use crate::machine::check_params;
use crate::pool::Pool;
use crate::process::{Body, SavedState};
use crate::stack::ProcessPlan;
use crate::status::{StatusCell, StatusRecord};
use rand_chacha::ChaCha8Rng;
use rand_core::SeedableRng;
use rcs_bus::{Buffer, Draft, Mode, Reader, Sample, Writer, WriterId};
use rcs_msg::{AnyMessage, Stamp, rcs};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// A process with its ports.
pub(crate) struct Node {
    pub(crate) period_ns: u64,
    pub(crate) latency_ns: u64,
    body: Box<dyn Body>,
    kind: crate::ProcessType,
    inputs: Vec<Option<Input>>,
    views: Vec<InputView>,
    commands: Reader,
    params: Reader,
    mail: Mail,
    outputs: Vec<Writer>,
    status_out: Writer,
    status: StatusCell,
    /// Whether the last command lets it work; `None` before the first.
    running: Option<bool>,
    panicked: bool,
    command: Option<rcs::Command>,
    rng: ChaCha8Rng,
    staged: Vec<Staged>,
    scratch: Vec<Sample>,
    /// How often something of what is saved may have changed; never the same again.
    changes: u64,
}

/// Whether there may be a command or parameters to read: both are rare, and a look at their buffers costs two locks a
/// cycle. Set by taps, in both executors under the lock (or in the thread) that orders writes and captures; the atomic
/// only makes it shareable.
#[derive(Clone, Default)]
struct Mail(Arc<AtomicBool>);

impl Mail {
    fn watch(&self, buffer: &Buffer) {
        let mail = self.clone();
        buffer.tap(Box::new(move |_| mail.set()));
    }

    fn set(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    fn take(&self) -> bool {
        self.0.load(Ordering::Relaxed) && self.0.swap(false, Ordering::Relaxed)
    }
}

struct Input {
    reader: Reader,
    depth: usize,
}

/// All that a node remembers between cycles: part of a snapshot.
#[derive(Clone)]
pub(crate) struct NodeState {
    pub(crate) body: SavedBody,
    pub(crate) views: Vec<InputView>,
    pub(crate) status: StatusCell,
    pub(crate) running: Option<bool>,
    pub(crate) panicked: bool,
    pub(crate) rng: ChaCha8Rng,
}

/// State of a process: in memory, or as it was read from disk.
#[derive(Clone)]
pub(crate) enum SavedBody {
    Live(Arc<dyn SavedState>),
    Encoded(Vec<u8>),
}

/// What one cycle wrote, on its way to becoming visible.
#[derive(Clone)]
pub(crate) struct Output {
    pub(crate) staged: Vec<Staged>,
    pub(crate) status: StatusRecord,
}

impl Node {
    pub(crate) fn new(plan: &ProcessPlan, buffers: &[Arc<Buffer>], id: WriterId, seed: u64) -> Option<Self> {
        let input = |index: usize| Input {
            reader: buffers[index].reader(),
            depth: match buffers[index].spec().mode {
                Mode::Latest => 1,
                Mode::Queue { depth, .. } => depth,
            },
        };
        let mail = Mail::default();
        mail.watch(&buffers[plan.command_buffer]);
        mail.watch(&buffers[plan.params_buffer]);
        let hash = blake3::hash(format!("{seed}/{}", plan.name).as_bytes());
        Some(Self {
            period_ns: plan.period_ns,
            latency_ns: plan.latency_ns,
            body: plan.kind.make(&plan.params)?,
            kind: plan.kind,
            inputs: plan.inputs.iter().map(|index| index.map(input)).collect(),
            views: vec![InputView::default(); plan.inputs.len()],
            commands: buffers[plan.command_buffer].reader(),
            params: buffers[plan.params_buffer].reader(),
            mail,
            outputs: plan.outputs.iter().map(|&index| buffers[index].writer(id)).collect(),
            status_out: buffers[plan.status_buffer].writer(id),
            status: StatusCell::new(Arc::clone(&plan.name)),
            running: None,
            panicked: false,
            command: None,
            rng: ChaCha8Rng::from_seed(*hash.as_bytes()),
            staged: Vec::new(),
            scratch: Vec::new(),
            changes: 0,
        })
    }

    /// A count that is another one whenever what [`Node::save`] gives may be.
    pub(crate) fn changes(&self) -> u64 {
        self.changes
    }

    pub(crate) fn status(&self) -> &StatusCell {
        &self.status
    }

    /// Takes everything that is visible now: parameters, a command, and all unread inputs.
    pub(crate) fn capture(&mut self) {
        self.changes += 1;
        if self.mail.take() {
            while let Some(sample) = self.params.read() {
                self.take_params(&sample.message);
            }
            while let Some(sample) = self.commands.read() {
                self.take_command(&sample.message);
            }
        }
        for (input, view) in self.inputs.iter_mut().zip(&mut self.views) {
            let Some(input) = input else { continue };
            view.missed = input.reader.drain_into(&mut self.scratch);
            if let Some(newest) = self.scratch.last() {
                view.latest = Some(newest.clone());
            }
            view.fresh.extend(self.scratch.drain(..));
            while view.fresh.len() > input.depth {
                // What a process leaves unread does not pile up.
                view.fresh.pop_front();
                view.missed += 1;
            }
        }
    }

    /// Sequence of the newest captured message of each input port; 0 where there was none.
    pub(crate) fn captured(&self) -> Vec<u64> {
        self.views
            .iter()
            .map(|view| view.latest.as_ref().map_or(0, |sample| sample.header.sequence))
            .collect()
    }

    fn take_params(&mut self, message: &AnyMessage) {
        if let Err(error) = check_params(message) {
            self.status.fault(format!("parameters refused: {error}").into());
        } else if !self.body.set_params(message) {
            self.status.fault("parameters of another process refused".into());
        }
    }

    fn take_command(&mut self, message: &AnyMessage) {
        let Some(command) = message.to::<rcs::Command>() else {
            self.status.fault("a command that does not decode".into());
            return;
        };
        self.status.echo_serial = command.serial;
        self.status.command = command.name.as_str().into();
        if self.panicked {
            return;
        }
        match command.name.as_str() {
            "RUN" => {
                self.running = Some(true);
                self.status.set(rcs::ProcessState::Exec, "running".into());
            }
            "HALT" => {
                self.running = Some(false);
                self.status.set(rcs::ProcessState::Done, "halted".into());
            }
            name if self.kind.def().commands.iter().any(|known| known.name == name) => {
                self.command = Some(command);
            }
            name => {
                let known = self.kind.def().commands.iter().map(|known| known.name);
                let known: Vec<_> = ["RUN", "HALT"].into_iter().chain(known).collect();
                let text = format!("unknown command {name}; expected {}", known.join(", "));
                self.status.set(rcs::ProcessState::Error, text.into());
            }
        }
    }

    /// Runs one cycle on what was captured. What it wrote waits in the node until [`Node::take_output`] or
    /// [`Node::publish`].
    pub(crate) fn run(&mut self, now: Stamp, pool: &Pool) {
        self.changes += 1;
        self.status.cycle += 1;
        let works = self.running == Some(true) || (self.running.is_some() && self.command.is_some());
        if !works || self.panicked {
            return;
        }
        let command = self.command.take();
        let mut cycle = Cycle {
            now,
            inputs: &mut self.views,
            staged: &mut self.staged,
            status: &mut self.status,
            command: command.as_ref(),
            rng: &mut self.rng,
            pool,
        };
        let body = &mut self.body;
        if let Err(panic) = catch_unwind(AssertUnwindSafe(|| body.cycle(&mut cycle))) {
            // Its state may be half changed: it never runs again, and nothing that it wrote in this cycle is sent on.
            self.panicked = true;
            self.staged.clear();
            let text = panic
                .downcast_ref::<&str>()
                .map(|text| (*text).to_owned())
                .or_else(|| panic.downcast_ref::<String>().cloned())
                .unwrap_or_default();
            self.status.set(rcs::ProcessState::Error, format!("panicked: {text}").into());
        }
    }

    /// Takes what the last cycle wrote, for publishing it later.
    pub(crate) fn take_output(&mut self, now: Stamp) -> Output {
        Output { staged: std::mem::take(&mut self.staged), status: self.status.record(now) }
    }

    /// Publishes what the last cycle wrote, and its status.
    pub(crate) fn publish(&mut self, started: Stamp, visible: Stamp) {
        let mut staged = std::mem::take(&mut self.staged);
        for item in staged.drain(..) {
            self.write(item, visible);
        }
        // The allocation serves the next cycle.
        self.staged = staged;
        let status = self.status.record(started);
        self.write_status(status, started, visible);
    }

    /// Publishes what an earlier cycle wrote.
    pub(crate) fn publish_output(&mut self, output: Output, started: Stamp, visible: Stamp) {
        for item in output.staged {
            self.write(item, visible);
        }
        self.write_status(output.status, started, visible);
    }

    fn write(&mut self, item: Staged, visible: Stamp) {
        let draft = Draft { log_time: visible, acq_time: item.acq_time, message: item.message };
        if let Err(error) = self.outputs[item.output].write(draft) {
            self.status.fault(error.to_string().into());
        }
    }

    fn write_status(&mut self, status: StatusRecord, started: Stamp, visible: Stamp) {
        self.changes += 1;
        let message = AnyMessage::deferred::<StatusRecord, rcs::Status>(status);
        if let Err(error) = self.status_out.write(Draft { log_time: visible, acq_time: started, message }) {
            self.status.fault(error.to_string().into());
        }
    }

    pub(crate) fn save(&self) -> NodeState {
        NodeState {
            body: SavedBody::Live(self.body.save()),
            views: self.views.clone(),
            status: self.status.clone(),
            running: self.running,
            panicked: self.panicked,
            rng: self.rng.clone(),
        }
    }

    /// Makes the node what it was; an error where the state is not one of its own.
    pub(crate) fn restore(&mut self, state: &NodeState) -> Result<(), String> {
        self.changes += 1;
        match &state.body {
            SavedBody::Live(saved) => {
                if !self.body.restore(&**saved) {
                    return Err(format!("the snapshot holds another process than {}", self.status.process));
                }
            }
            SavedBody::Encoded(bytes) => self
                .body
                .restore_encoded(bytes)
                .map_err(|error| format!("the state of {} does not decode: {error}", self.status.process))?,
        }
        self.views.clone_from(&state.views);
        self.status = state.status.clone();
        self.running = state.running;
        self.panicked = state.panicked;
        self.rng = state.rng.clone();
        self.command = None;
        self.staged.clear();
        // The buffers may hold what had not been read then.
        self.mail.set();
        Ok(())
    }
}
