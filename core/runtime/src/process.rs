//! What the author of a plugin writes: a [`Process`], its [`ProcessDef`] and its ports.
//!
//! The runtime owns everything else: buffers, time, threads, recording. A process is a value: its state is `Clone`, so
//! that a snapshot is a clone. It reads and writes only through the [`Cycle`] that it gets.

use crate::children::{Child, ChildDef, Children};
use crate::command::{CommandDef, CommandSet, Typed};
use crate::cycle::Cycle;
use crate::register::Phase;
use crate::role::{InputRole, ROLE, Role};
use rcs_msg::classes::{CLASSES, LabelClass, classes_to_json};
use rcs_msg::{AnyMessage, DeltaCodec, Payload, Schema, rcs, schema_of};
use serde::{Serialize, de::DeserializeOwned};
use std::any::Any;
use std::collections::BTreeMap;
use std::marker::PhantomData;
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
    /// file has the form `<field>: line <number>, …`.
    fn check(_params: &Self::Params) -> Result<(), String> {
        Ok(())
    }
    /// The state before the first cycle.
    fn new(params: &Self::Params) -> Self;
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

/// Definition of a port.
#[derive(Clone, Debug)]
pub struct PortDef {
    /// Name in the stack file.
    pub name: &'static str,
    /// One sentence with units and frames.
    pub help: &'static str,
    /// Type of its messages.
    pub schema: Arc<Schema>,
    /// Whether a stack must wire it (inputs only).
    pub required: bool,
    /// Channel metadata of the buffer that it writes (outputs only). `rcs.overlay_of` names a port, which the runtime
    /// replaces by the name of that port's buffer.
    pub metadata: BTreeMap<String, String>,
    /// Role by which a window finds it (inputs that an operator writes).
    pub role: Option<InputRole>,
    /// Codec that records its messages as key frames and deltas (outputs only).
    pub codec: Option<&'static dyn DeltaCodec>,
}

/// The ports of a process, in the order of declaration.
#[derive(Clone, Debug, Default)]
pub struct PortBuilder {
    pub(crate) inputs: Vec<PortDef>,
    pub(crate) outputs: Vec<PortDef>,
    pub(crate) children: Vec<ChildDef>,
}

/// Handle of an input port.
#[derive(Debug)]
pub struct In<T> {
    pub(crate) index: usize,
    payload: PhantomData<fn() -> T>,
}

/// Handle of an output port.
#[derive(Debug)]
pub struct Out<T> {
    pub(crate) index: usize,
    payload: PhantomData<fn(T)>,
}

/// Builder of an output port.
pub struct OutBuilder<'a, T> {
    index: usize,
    def: &'a mut PortDef,
    payload: PhantomData<fn(T)>,
}

impl PortBuilder {
    /// A mandatory input.
    pub fn input<T: Payload>(&mut self, name: &'static str, help: &'static str) -> In<T> {
        self.add_input(name, help, true)
    }

    /// An optional input.
    pub fn optional_input<T: Payload>(&mut self, name: &'static str, help: &'static str) -> In<T> {
        self.add_input(name, help, false)
    }

    /// An optional input that the operator's window can write; the window finds it by its role.
    pub fn operator_input<T: Payload>(
        &mut self,
        role: InputRole,
        name: &'static str,
        help: &'static str,
    ) -> In<T> {
        let input = self.add_input(name, help, false);
        self.inputs[input.index].role = Some(role);
        input
    }

    fn add_input<T: Payload>(&mut self, name: &'static str, help: &'static str, required: bool) -> In<T> {
        let schema = Arc::clone(schema_of::<T>());
        self.inputs.push(PortDef {
            name,
            help,
            schema,
            required,
            metadata: BTreeMap::new(),
            role: None,
            codec: None,
        });
        In { index: self.inputs.len() - 1, payload: PhantomData }
    }

    /// A mandatory child: a process that names this one as its supervisor and obeys every command of `C`.
    pub fn child<C: CommandSet>(&mut self, name: &'static str, help: &'static str) -> Child<C> {
        self.add_child::<C>(name, help, true, false);
        Child::new(self.children.len() - 1, 0)
    }

    /// An optional child.
    pub fn optional_child<C: CommandSet>(&mut self, name: &'static str, help: &'static str) -> Child<C> {
        self.add_child::<C>(name, help, false, false);
        Child::new(self.children.len() - 1, 0)
    }

    /// Any number of children that obey every command of `C`.
    pub fn children<C: CommandSet>(&mut self, name: &'static str, help: &'static str) -> Children<C> {
        self.add_child::<C>(name, help, false, true);
        Children::new(self.children.len() - 1)
    }

    fn add_child<C: CommandSet>(
        &mut self,
        name: &'static str,
        help: &'static str,
        required: bool,
        many: bool,
    ) {
        self.children.push(ChildDef { name, help, required, many, commands: C::COMMANDS });
    }

    /// An output; by default its buffer is `/<process>/<name>`.
    pub fn output<T: Payload>(&mut self, name: &'static str, help: &'static str) -> OutBuilder<'_, T> {
        let schema = Arc::clone(schema_of::<T>());
        let index = self.outputs.len();
        self.outputs.push(PortDef {
            name,
            help,
            schema,
            required: false,
            metadata: BTreeMap::new(),
            role: None,
            codec: None,
        });
        OutBuilder { index, def: &mut self.outputs[index], payload: PhantomData }
    }
}

impl<T> OutBuilder<'_, T> {
    /// Role of the messages; the plan refuses a role that does not suit their type.
    #[must_use]
    pub fn role(self, role: Role) -> Self {
        self.with(ROLE, role.name())
    }

    /// Classes of the values of a label image.
    #[must_use]
    pub fn classes(self, classes: &[LabelClass]) -> Self {
        self.with(CLASSES, &classes_to_json(classes))
    }

    /// Palette for views.
    #[must_use]
    pub fn palette(self, palette: &str) -> Self {
        self.with("rcs.palette", palette)
    }

    /// The port, an input or another output, whose images it overlays pixel for pixel.
    #[must_use]
    pub fn overlay_of(self, port: &str) -> Self {
        self.with("rcs.overlay_of", port)
    }

    /// Marks the output as ground truth of a simulation: only processes with [`ProcessDef::reads_ground_truth`] may
    /// read it.
    #[must_use]
    pub fn truth(self) -> Self {
        self.with("rcs.ground_truth", "true")
    }

    /// Records its messages as key frames and deltas.
    #[must_use]
    pub fn recorded_by(self, codec: &'static dyn DeltaCodec) -> Self {
        self.def.codec = Some(codec);
        self
    }

    fn with(self, key: &str, value: &str) -> Self {
        self.def.metadata.insert(key.to_owned(), value.to_owned());
        self
    }

    /// Completes the declaration and returns the handle.
    pub fn build(self) -> Out<T> {
        Out { index: self.index, payload: PhantomData }
    }
}

/// An entry of the list of plugins: everything that the runtime needs to create a [`Process`].
#[derive(Clone, Copy)]
pub struct ProcessType {
    def: &'static ProcessDef,
    ports: fn() -> PortBuilder,
    params: fn() -> &'static Arc<Schema>,
    commands: &'static [CommandDef],
    decode: fn(&rcs::Command) -> Result<Typed, String>,
    check: fn(&AnyMessage) -> Result<(), String>,
    make: fn(&AnyMessage) -> Option<Box<dyn Body>>,
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
            make: |message| {
                let params: P::Params = message.to()?;
                let ports = P::ports(&mut PortBuilder::default());
                let state = P::new(&params);
                Some(Box::new(Runner { state, params: Arc::new(params), ports: Arc::new(ports) }))
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

    /// Decodes one of its own commands; the error says what is wrong with it.
    pub(crate) fn decode(&self, command: &rcs::Command) -> Result<Typed, String> {
        (self.decode)(command)
    }

    /// Schema of its parameters.
    pub fn params_schema(&self) -> &'static Arc<Schema> {
        (self.params)()
    }

    /// Whether the process itself accepts these parameters.
    pub(crate) fn check(&self, params: &AnyMessage) -> Result<(), String> {
        (self.check)(params)
    }

    /// A new process; `None` if the message does not have the type of its parameters.
    pub(crate) fn make(&self, params: &AnyMessage) -> Option<Box<dyn Body>> {
        (self.make)(params)
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
    /// Creates the state again from the parameters.
    fn reset(&mut self);
    /// Sets new parameters; `false` if they have another type.
    fn set_params(&mut self, params: &AnyMessage) -> bool;
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

struct Runner<P: Process> {
    state: P,
    params: Arc<P::Params>,
    ports: Arc<P::Ports>,
}

struct Saved<P: Process> {
    state: P,
    params: Arc<P::Params>,
}

impl<P: Process> Body for Runner<P> {
    fn cycle(&mut self, phase: Phase, cx: &mut Cycle<'_>) {
        let Self { state, params, ports } = self;
        match phase {
            Phase::Uninitialized => {}
            Phase::Init => state.init(ports, params, cx),
            Phase::Run => state.cycle(ports, params, cx),
            Phase::Halt => state.halt(ports, params, cx),
        }
    }

    fn reset(&mut self) {
        self.state = P::new(&self.params);
    }

    fn set_params(&mut self, params: &AnyMessage) -> bool {
        match params.to::<P::Params>() {
            Some(params) => {
                self.params = Arc::new(params);
                true
            }
            None => false,
        }
    }

    fn save(&self) -> Arc<dyn SavedState> {
        Arc::new(Saved { state: self.state.clone(), params: Arc::clone(&self.params) })
    }

    fn restore(&mut self, saved: &dyn SavedState) -> bool {
        match saved.as_any().downcast_ref::<Saved<P>>() {
            Some(saved) => {
                self.state = saved.state.clone();
                self.params = Arc::clone(&saved.params);
                true
            }
            None => false,
        }
    }

    fn restore_encoded(&mut self, bytes: &[u8]) -> Result<(), postcard::Error> {
        let (state, params): (P, Vec<u8>) = postcard::from_bytes(bytes)?;
        let params = <P::Params as prost::Message>::decode(params.as_slice())
            .map_err(|_| postcard::Error::DeserializeBadEncoding)?;
        self.state = state;
        self.params = Arc::new(params);
        Ok(())
    }
}

impl<P: Process> SavedState for Saved<P> {
    fn encode(&self) -> Result<Vec<u8>, postcard::Error> {
        postcard::to_stdvec(&(&self.state, prost::Message::encode_to_vec(&*self.params)))
    }

    fn as_any(&self) -> &dyn Any {
        self
    }
}
