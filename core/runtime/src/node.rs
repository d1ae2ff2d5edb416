//! A process with its ports: captures inputs, runs one cycle, publishes its output. Both executors use it.

use crate::children::{ChildLinks, ChildLinksState, Link};
use crate::cycle::{Cycle, InputView, Staged};
use crate::pool::Pool;
use crate::process::{Body, SavedState};
use crate::register::{CommandOutcome, CommandSources, Phase, Register};
use crate::stack::{ChildPlan, Plan, ProcessPlan};
use crate::status::{StatusCell, StatusRecord};
use crate::work::Work;
use prost_reflect::DynamicMessage;
use rand_chacha::ChaCha8Rng;
use rand_core::SeedableRng;
use rcs_bus::{Buffer, Draft, FaultKind, Reader, Sample, Writer, WriterId};
use rcs_msg::{AnyMessage, Stamp, params, rcs};
use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// The writer of the first process of a plan; the others follow in the order of the plan.
pub(crate) const FIRST_PROCESS: WriterId = WriterId(WriterId::RUNTIME.0 + 1);

/// A process with its ports.
pub(crate) struct Node {
    pub(crate) period_ns: u64,
    pub(crate) latency_ns: u64,
    body: Box<dyn Body>,
    kind: crate::ProcessType,
    inputs: Vec<Option<Input>>,
    /// Which of them the stack connects.
    wired: Vec<bool>,
    views: Vec<InputView>,
    commands: Reader,
    params: Reader,
    /// Parameters that were captured and are decoded in the next cycle.
    new_params: Vec<AnyMessage>,
    new_messages: NewMessages,
    outputs: Vec<Writer>,
    status_out: Writer,
    status: StatusCell,
    sources: CommandSources,
    register: Register,
    child_links: ChildLinks,
    panicked: bool,
    rng: ChaCha8Rng,
    /// Seed of the random numbers, at the start of the run and after each `INIT`.
    seed: [u8; 32],
    staged: Vec<Staged>,
    scratch: Vec<Sample>,
    work: Work,
    /// Output ports; after them in `outputs` are the commands to children.
    own_outputs: usize,
    /// A number that changes whenever the saved state may have changed, and never repeats.
    changes: u64,
}

/// Whether there may be an unread command or parameters. Both are rare, and checking their buffers costs two locks per
/// cycle. Taps set it, in both executors under the lock (or in the thread) that orders writes and captures; it is an
/// atomic only because it is shared.
#[derive(Clone, Default)]
struct NewMessages(Arc<AtomicBool>);

impl NewMessages {
    fn watch(&self, buffer: &Buffer) {
        let new_messages = self.clone();
        buffer.tap(Box::new(move |_| new_messages.set()));
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

/// State of a node between cycles: part of a snapshot.
#[derive(Clone)]
pub(crate) struct NodeState {
    pub(crate) body: SavedBody,
    pub(crate) views: Vec<InputView>,
    pub(crate) status: StatusCell,
    pub(crate) register: Register,
    pub(crate) child_links: ChildLinksState,
    pub(crate) panicked: bool,
    pub(crate) rng: ChaCha8Rng,
}

/// State of a process: in memory, or as read from disk.
#[derive(Clone)]
pub(crate) enum SavedBody {
    Live(Arc<dyn SavedState>),
    Encoded(Vec<u8>),
}

/// Output of one cycle that is not visible yet.
#[derive(Clone)]
pub(crate) struct Output {
    pub(crate) staged: Vec<Staged>,
    /// `None` if it was published before: these messages are late.
    pub(crate) status: Option<StatusRecord>,
}

/// The faults on demand of a process that concern its cycle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct CycleFaults {
    /// Its cycles do not run.
    pub(crate) stopped: bool,
    /// Each takes that much longer.
    pub(crate) slowed_ns: u64,
}

impl Node {
    /// The process with this index in the plan, which writes as `id`; `names` are those of all writers. `None` if its
    /// parameters have another type.
    pub(crate) fn new(
        plan: &Plan,
        index: usize,
        buffers: &[Arc<Buffer>],
        id: WriterId,
        names: &Arc<[Arc<str>]>,
        seed: u64,
    ) -> Option<Self> {
        let process = &plan.processes[index];
        let input = |index: usize| Input {
            reader: buffers[index].reader(),
            depth: buffers[index].spec().mode.most_unread(),
        };
        let new_messages = NewMessages::default();
        new_messages.watch(&buffers[process.command_buffer]);
        new_messages.watch(&buffers[process.params_buffer]);
        let hash = blake3::hash(format!("{seed}/{}", process.name).as_bytes());
        let children = || process.children.iter().map(|child| &plan.processes[child.process]);
        let statuses = children().map(|child| Some(input(child.status_buffer)));
        let inputs: Vec<_> = process.inputs.iter().map(|index| index.map(input)).chain(statuses).collect();
        let commands = children().map(|child| child.command_buffer);
        let outputs = process.outputs.iter().copied().chain(commands);
        let writer = |index: usize| WriterId(FIRST_PROCESS.0 + index as u16);
        Some(Self {
            period_ns: process.period_ns,
            latency_ns: process.latency_ns,
            body: process.kind.make(&process.params, &plan.files)?,
            kind: process.kind,
            views: vec![InputView::default(); inputs.len()],
            wired: inputs.iter().map(Option::is_some).collect(),
            inputs,
            commands: buffers[process.command_buffer].reader(),
            params: buffers[process.params_buffer].reader(),
            new_params: Vec::new(),
            new_messages,
            outputs: outputs.map(|index| buffers[index].writer(id)).collect(),
            status_out: buffers[process.status_buffer].writer(id),
            status: StatusCell::new(Arc::clone(&process.name)),
            sources: CommandSources {
                supervisor: process.supervisor.map(writer),
                lease_ns: plan.authority_ns,
                names: Arc::clone(names),
            },
            register: Register::default(),
            child_links: links_of(plan, process),
            panicked: false,
            rng: ChaCha8Rng::from_seed(*hash.as_bytes()),
            seed: *hash.as_bytes(),
            staged: Vec::new(),
            scratch: Vec::new(),
            work: Work::new(process.inputs.len()),
            own_outputs: process.outputs.len(),
            changes: 0,
        })
    }

    /// A number that differs whenever the result of [`Node::save`] may differ.
    pub(crate) fn changes(&self) -> u64 {
        self.changes
    }

    pub(crate) fn status(&self) -> &StatusCell {
        &self.status
    }

    /// Whether it panicked, and waits for `INIT`.
    pub(crate) fn has_panicked(&self) -> bool {
        self.panicked
    }

    /// What it made of its inputs since it was made.
    pub(crate) fn work(&self) -> &Work {
        &self.work
    }

    /// Captures everything that is visible now: parameters, a command, and all unread inputs. A live run calls it under
    /// its lock, so parameters are only captured here and decoded in [`Node::run`].
    pub(crate) fn capture(&mut self) {
        self.changes += 1;
        if self.new_messages.take() {
            while let Some(sample) = self.params.read() {
                self.new_params.push(sample.message);
            }
            while let Some(sample) = self.commands.read() {
                self.take_command(&sample);
            }
        }
        for (index, (input, view)) in self.inputs.iter_mut().zip(&mut self.views).enumerate() {
            let Some(input) = input else { continue };
            view.missed = input.reader.drain_into(&mut self.scratch);
            if let Some(newest) = self.scratch.last() {
                view.latest = Some(newest.clone());
                self.work.arrived(index);
            }
            view.fresh.extend(self.scratch.drain(..));
            while view.fresh.len() > input.depth {
                // Messages that the process did not read must not accumulate.
                view.fresh.pop_front();
                view.missed += 1;
            }
        }
    }

    /// Sequence of the newest captured message of each input port; 0 if there was none.
    pub(crate) fn captured(&self) -> Vec<u64> {
        self.views
            .iter()
            .map(|view| view.latest.as_ref().map_or(0, |sample| sample.header.sequence))
            .collect()
    }

    fn take_params(&mut self, message: &AnyMessage) {
        if let Err(error) = check_params(message).and_then(|()| self.body.set_params(message)) {
            self.status.fault(format!("parameters refused: {error}").into());
        }
    }

    fn take_command(&mut self, sample: &Sample) {
        let own = (self.kind.decoder(), self.kind.commands());
        let outcome = self.register.take(sample, &self.sources, own, self.panicked, &mut self.status);
        if outcome == CommandOutcome::Reset {
            // The new state is created from the newest parameters.
            for message in std::mem::take(&mut self.new_params) {
                self.take_params(&message);
            }
            self.panicked = false;
            // A process that starts again behaves as at the start of the run.
            self.rng = ChaCha8Rng::from_seed(self.seed);
            let body = &mut self.body;
            if let Err(panic) = catch_unwind(AssertUnwindSafe(|| body.reset())) {
                self.panicked(&*panic);
            }
        }
    }

    /// Runs one cycle on the captured inputs. The output stays in the node until [`Node::take_output`] or
    /// [`Node::publish`].
    pub(crate) fn run(&mut self, now: Stamp, pool: &Pool) {
        self.changes += 1;
        for message in std::mem::take(&mut self.new_params) {
            self.take_params(&message);
        }
        self.status.cycle += 1;
        self.register.lapse(now, &self.sources, &mut self.status);
        let phase = self.register.phase();
        if phase == Phase::Uninitialized || self.panicked {
            return;
        }
        self.child_links.begin_cycle(now);
        let faults = self.status.faults();
        let mut cycle = Cycle {
            now,
            period_ns: self.period_ns,
            inputs: &mut self.views,
            wired: &self.wired,
            staged: &mut self.staged,
            status: &mut self.status,
            register: &mut self.register,
            child_links: &mut self.child_links,
            rng: &mut self.rng,
            pool,
        };
        let body = &mut self.body;
        if let Err(panic) = catch_unwind(AssertUnwindSafe(|| body.cycle(phase, &mut cycle))) {
            self.staged.clear();
            self.panicked(&*panic);
        }
        self.register.end_cycle();
        let own = self.staged.iter().filter(|item| item.output < self.own_outputs);
        self.work.end_cycle(self.status.faults() > faults, own.count());
    }

    /// The state may be half changed, so the process does not run until `INIT` creates it again, and nothing that it
    /// wrote in this cycle is published.
    fn panicked(&mut self, panic: &(dyn std::any::Any + Send)) {
        self.panicked = true;
        let text = format!("panicked: {}", panic_text(panic));
        self.status.set(rcs::ProcessState::Error, text.into());
    }

    /// Takes the output of the last cycle, to publish it later.
    pub(crate) fn take_output(&mut self, now: Stamp) -> Output {
        Output { staged: std::mem::take(&mut self.staged), status: Some(self.status.record(now)) }
    }

    /// The faults in force that concern its cycles.
    pub(crate) fn cycle_faults(&self, now: Stamp) -> CycleFaults {
        let mut faults = CycleFaults::default();
        for fault in self.status_out.buffer().faults(now) {
            match fault.kind {
                FaultKind::Stopped => faults.stopped = true,
                FaultKind::Slowed { delay_ns } => faults.slowed_ns += delay_ns,
                _ => {}
            }
        }
        faults
    }

    /// Takes the messages that a fault delays out of the output of the last cycle, with their delays.
    pub(crate) fn take_late(&mut self, now: Stamp) -> Vec<(u64, Vec<Staged>)> {
        let mut staged = std::mem::take(&mut self.staged);
        let late = self.split_late(&mut staged, now);
        self.staged = staged;
        late
    }

    /// Takes the messages that a fault delays out of a list, with their delays.
    pub(crate) fn split_late(&self, staged: &mut Vec<Staged>, now: Stamp) -> Vec<(u64, Vec<Staged>)> {
        let mut late: BTreeMap<u64, Vec<Staged>> = BTreeMap::new();
        for item in std::mem::take(staged) {
            let faults = self.outputs[item.output].buffer().faults(now).into_iter();
            let delay_ns = faults.map(|fault| match fault.kind {
                FaultKind::Late { delay_ns } => delay_ns,
                _ => 0,
            });
            match delay_ns.sum() {
                0 => staged.push(item),
                delay_ns => late.entry(delay_ns).or_default().push(item),
            }
        }
        late.into_iter().collect()
    }

    /// Publishes the output of the last cycle, and its status.
    pub(crate) fn publish(&mut self, started: Stamp, visible: Stamp) {
        let mut staged = std::mem::take(&mut self.staged);
        for item in staged.drain(..) {
            self.write(item, visible);
        }
        // Keeps the allocation for the next cycle.
        self.staged = staged;
        let status = self.status.record(started);
        self.write_status(status, started, visible);
    }

    /// Publishes the output of an earlier cycle.
    pub(crate) fn publish_output(&mut self, output: Output, started: Stamp, visible: Stamp) {
        for item in output.staged {
            self.write(item, visible);
        }
        if let Some(status) = output.status {
            self.write_status(status, started, visible);
        }
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
            register: self.register.clone(),
            child_links: self.child_links.state.clone(),
            panicked: self.panicked,
            rng: self.rng.clone(),
        }
    }

    /// Restores the node; an error if the state belongs to another kind of process.
    pub(crate) fn restore(&mut self, state: &NodeState) -> Result<(), String> {
        self.changes += 1;
        match &state.body {
            SavedBody::Live(saved) => {
                if !self.body.restore(&**saved) {
                    return Err(format!("the snapshot holds another process than {}", self.status.process()));
                }
            }
            SavedBody::Encoded(bytes) => self.body.restore_encoded(bytes).map_err(|error| {
                format!("the state of {} does not decode: {error}", self.status.process())
            })?,
        }
        self.views.clone_from(&state.views);
        self.status = state.status.clone();
        self.register = state.register.clone();
        self.register
            .decode(self.kind.decoder())
            .map_err(|error| format!("the commands of {} do not decode: {error}", self.status.process()))?;
        self.child_links.state = state.child_links.clone();
        self.panicked = state.panicked;
        self.rng = state.rng.clone();
        self.staged.clear();
        // The buffers may contain messages that were unread at that time.
        self.new_messages.set();
        Ok(())
    }
}

/// Links to the children of a process of the plan. The statuses of the children follow its own inputs, commands to them
/// its own outputs.
fn links_of(plan: &Plan, process: &ProcessPlan) -> ChildLinks {
    let link = |(index, child): (usize, &ChildPlan)| {
        let of = &plan.processes[child.process];
        let (input, output) = (process.inputs.len() + index, process.outputs.len() + index);
        let times_ns = [of.period_ns, of.latency_ns];
        Link::new(child.slot, Arc::clone(&of.name), [input, output], times_ns, of.kind.commands())
    };
    ChildLinks::new(Arc::clone(&process.name), process.children.iter().enumerate().map(link).collect())
}

/// Refuses parameters that are NaN or out of range; the error contains the range.
pub(crate) fn check_params(message: &AnyMessage) -> Result<(), String> {
    let schema = message.schema();
    let Some(descriptor) = schema.descriptor() else { return Ok(()) };
    let message =
        DynamicMessage::decode(descriptor.clone(), message.bytes()).map_err(|error| error.to_string())?;
    params::check(&message).map_err(|error| error.to_string())
}

/// The text of a panic.
pub(crate) fn panic_text(panic: &(dyn std::any::Any + Send)) -> String {
    let text = panic.downcast_ref::<&str>().map(|text| (*text).to_owned());
    text.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_default()
}
