//! What the author of a plugin writes: a [`Process`], its [`ProcessDef`] and its ports.
//!
//! The runtime owns everything else: buffers, time, threads, recording. A process is a value: its state is `Clone`, so
//! that a snapshot is a clone. It reads and writes only through the [`Cycle`] that it gets.

use crate::children::ChildDef;
use crate::command::{CommandDef, CommandSet, Decode, Obeys, Typed};
use crate::cycle::Cycle;
use crate::files::FileTable;
use crate::ports::{PortBuilder, PortDef};
use crate::register::Phase;
use rcs_msg::{AnyMessage, DeltaCodec, Payload, Schema, schema_of};
use serde::{Serialize, de::DeserializeOwned};
use std::any::Any;
use std::sync::Arc;

/// A 4D/RCS module: cyclic, with declared inputs, outputs, parameters and commands.
///
/// The value itself is the state. Put large parts behind `Arc` with copy on write, so that a clone is cheap.
pub trait Process: Clone + Serialize + DeserializeOwned + Send + Sync + 'static {
    /// Parameters: a message in the plugin's own `proto/` whose fields have unit, range, default and help;
    /// `rcs.NoParams` for a process without parameters.
    type Params: Payload;
    /// Handles of the ports and children, which [`Process::ports`] creates.
    type Ports: Send + Sync + 'static;
    /// Its own commands, declared with [`commands!`](crate::commands); [`NoCommands`](crate::NoCommands) if it obeys
    /// only those of the runtime.
    type Command: CommandSet;
    /// Name, summary, period and latency.
    const DEF: ProcessDef;

    /// Declares the ports. Called once; the order of the calls is the order of the port table.
    fn ports(builder: &mut PortBuilder) -> Self::Ports;
    /// Refuses values that only the process can check, such as the text of a file, before anything runs. An error in a
    /// file has the form `<field>: …`, or `<field>: line <number>, …` where the line is known.
    fn check(_params: &Self::Params) -> Result<(), String> {
        Ok(())
    }
    /// The state before the first cycle.
    fn new(params: &Self::Params) -> Self;
    /// The state after `INIT`. What an operator has stated once, such as an emergency stop, may be taken over; after a
    /// panic the state may be half changed.
    #[must_use]
    fn renew(&self, params: &Self::Params) -> Self {
        Self::new(params)
    }
    /// One cycle: read, compute, write, set the status.
    fn cycle(&mut self, ports: &Self::Ports, params: &Self::Params, cx: &mut Cycle<'_>);
    /// One cycle after `INIT`, which has created the state again. It is called until `RUN` or `HALT` arrives; call
    /// [`Cycle::done`] when ready. A supervisor passes the command on to its children.
    fn init(&mut self, _ports: &Self::Ports, _params: &Self::Params, cx: &mut Cycle<'_>) {
        cx.done("initialized");
    }
    /// One cycle after `HALT`. It is called until another command arrives; call [`Cycle::done`] when everything stands
    /// still. A process that moves the vehicle brakes; a supervisor passes the command on to its children.
    fn halt(&mut self, _ports: &Self::Ports, _params: &Self::Params, cx: &mut Cycle<'_>) {
        cx.done("halted");
    }
}

impl<P: Process> Obeys for P {
    type Own = P::Command;
}

/// Constant properties of a kind of process.
#[derive(Clone, Copy, Debug)]
pub struct ProcessDef {
    /// Name of the plugin in stack files.
    pub plugin: &'static str,
    /// One sentence.
    pub summary: &'static str,
    /// Default period, in milliseconds.
    pub period_ms: f64,
    /// Default latency of stepped runs: time from the start of a cycle until its output is visible, in milliseconds. It
    /// should be near the time that a cycle takes on a computer with two cores; 0 for cycles of less than half a
    /// millisecond, and for processes that simulate the world.
    pub latency_ms: f64,
    /// Whether it may read the ground truth of a simulation: true for processes of the simulator, and for those that
    /// replace a part of the robot that is not under test.
    pub reads_ground_truth: bool,
}

/// An entry of the list of plugins: everything that the runtime needs to create a [`Process`].
#[derive(Clone, Copy)]
pub struct ProcessType {
    def: &'static ProcessDef,
    ports: fn() -> PortBuilder,
    params: fn() -> &'static Arc<Schema>,
    commands: &'static [CommandDef],
    decode: Decode,
    check: fn(&AnyMessage) -> Result<(), String>,
    make: fn(&AnyMessage, &FileTable) -> Option<Box<dyn Body>>,
}

impl ProcessType {
    /// The entry for `P`.
    pub const fn of<P: Process>() -> Self {
        Self {
            def: &P::DEF,
            ports: || {
                let mut builder = PortBuilder::default();
                P::ports(&mut builder);
                builder
            },
            params: schema_of::<P::Params>,
            commands: P::Command::COMMANDS,
            decode: |command| P::Command::decode(command).map(|command| Arc::new(command) as Typed),
            check: |message| {
                let params: P::Params =
                    message.to().ok_or_else(|| format!("expected a {}", schema_of::<P::Params>().name()))?;
                P::check(&params)
            },
            make: |message, files| {
                let params = Params::read(message, files).ok()?;
                let ports = Arc::new(P::ports(&mut PortBuilder::default()));
                let state = P::new(&params.typed);
                Some(Box::new(Runner::<P> { state, params, ports, files: files.clone() }))
            },
        }
    }

    /// Its constant properties.
    pub fn def(&self) -> &'static ProcessDef {
        self.def
    }

    /// Input ports, in order.
    pub fn inputs(&self) -> Vec<PortDef> {
        (self.ports)().inputs
    }

    /// Output ports, in order.
    pub fn outputs(&self) -> Vec<PortDef> {
        (self.ports)().outputs
    }

    /// Adds the messages of its ports and parameters to the registry, so that stacks and recordings can name them.
    pub fn register(&self) {
        self.params_schema();
        (self.ports)();
    }

    /// The children that it can have, in order.
    pub fn children(&self) -> Vec<ChildDef> {
        (self.ports)().children
    }

    /// Its own commands, in order.
    pub fn commands(&self) -> &'static [CommandDef] {
        self.commands
    }

    /// Decodes a message to one of its own commands.
    pub(crate) fn decoder(&self) -> Decode {
        self.decode
    }

    /// Schema of its parameters.
    pub fn params_schema(&self) -> &'static Arc<Schema> {
        (self.params)()
    }

    /// Refuses parameters that the process itself refuses, such as the text of a file.
    pub fn check(&self, params: &AnyMessage, files: &FileTable) -> Result<(), String> {
        (self.check)(&files.resolve(params)?)
    }

    /// A new process; `None` if the message does not have the type of its parameters or names a file that is missing.
    pub(crate) fn make(&self, params: &AnyMessage, files: &FileTable) -> Option<Box<dyn Body>> {
        (self.make)(params, files)
    }
}

/// The codecs of the outputs of these plugins, which readers of their logs need.
pub fn codecs(plugins: &[ProcessType]) -> Vec<&'static dyn DeltaCodec> {
    let mut codecs: Vec<&'static dyn DeltaCodec> = Vec::new();
    for codec in plugins.iter().flat_map(ProcessType::outputs).filter_map(|def| def.codec) {
        if !codecs.iter().any(|known| known.delta_schema().name() == codec.delta_schema().name()) {
            codecs.push(codec);
        }
    }
    codecs
}

impl std::fmt::Debug for ProcessType {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "ProcessType({})", self.def.plugin)
    }
}

/// A process behind dynamic dispatch.
pub(crate) trait Body: Send + Sync {
    /// One cycle of the function that belongs to the phase.
    fn cycle(&mut self, phase: Phase, cx: &mut Cycle<'_>);
    /// Creates the state again: see [`Process::renew`].
    fn reset(&mut self);
    /// Sets new parameters; an error if they have another type or name a file that is missing.
    fn set_params(&mut self, params: &AnyMessage) -> Result<(), String>;
    fn save(&self) -> Arc<dyn SavedState>;
    /// Restores a state of [`Body::save`]; `false` if it belongs to another kind of process.
    fn restore(&mut self, saved: &dyn SavedState) -> bool;
    /// Restores a state of [`SavedState::encode`].
    fn restore_encoded(&mut self, bytes: &[u8]) -> Result<(), postcard::Error>;
}

/// State and parameters of a process at one moment.
pub(crate) trait SavedState: Send + Sync {
    fn encode(&self) -> Result<Vec<u8>, postcard::Error>;
    fn as_any(&self) -> &dyn Any;
}

/// Parameters as they were received, and as the process reads them.
struct Params<T> {
    message: AnyMessage,
    typed: Arc<T>,
}

impl<T: Payload> Params<T> {
    fn read(message: &AnyMessage, files: &FileTable) -> Result<Self, String> {
        let typed = files.resolve(message)?.to::<T>().ok_or("parameters of another process")?;
        Ok(Self { message: message.clone(), typed: Arc::new(typed) })
    }
}

impl<T> Clone for Params<T> {
    fn clone(&self) -> Self {
        Self { message: self.message.clone(), typed: Arc::clone(&self.typed) }
    }
}

struct Runner<P: Process> {
    state: P,
    params: Params<P::Params>,
    ports: Arc<P::Ports>,
    files: FileTable,
}

struct Saved<P: Process> {
    state: P,
    params: Params<P::Params>,
}

impl<P: Process> Body for Runner<P> {
    fn cycle(&mut self, phase: Phase, cx: &mut Cycle<'_>) {
        let Self { state, params, ports, .. } = self;
        let params = &*params.typed;
        match phase {
            Phase::Uninitialized => {}
            Phase::Init => state.init(ports, params, cx),
            Phase::Run => state.cycle(ports, params, cx),
            Phase::Halt => state.halt(ports, params, cx),
        }
    }

    fn reset(&mut self) {
        self.state = self.state.renew(&self.params.typed);
    }

    fn set_params(&mut self, params: &AnyMessage) -> Result<(), String> {
        self.params = Params::read(params, &self.files)?;
        Ok(())
    }

    fn save(&self) -> Arc<dyn SavedState> {
        Arc::new(Saved { state: self.state.clone(), params: self.params.clone() })
    }

    fn restore(&mut self, saved: &dyn SavedState) -> bool {
        match saved.as_any().downcast_ref::<Saved<P>>() {
            Some(saved) => {
                self.state = saved.state.clone();
                self.params = saved.params.clone();
                true
            }
            None => false,
        }
    }

    fn restore_encoded(&mut self, bytes: &[u8]) -> Result<(), postcard::Error> {
        let (state, params): (P, Vec<u8>) = postcard::from_bytes(bytes)?;
        let message = AnyMessage::encoded(Arc::clone(schema_of::<P::Params>()), params.into());
        let params = Params::read(&message, &self.files);
        self.params = params.map_err(|_| postcard::Error::DeserializeBadEncoding)?;
        self.state = state;
        Ok(())
    }
}

impl<P: Process> SavedState for Saved<P> {
    fn encode(&self) -> Result<Vec<u8>, postcard::Error> {
        postcard::to_stdvec(&(&self.state, self.params.message.bytes().to_vec()))
    }

    fn as_any(&self) -> &dyn Any {
        self
    }
}
