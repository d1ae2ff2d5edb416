//! The ports of a process, and the children that it declares.

use crate::children::{Child, ChildDef, Children};
use crate::command::CommandSet;
use crate::role::{InputRole, ROLE, Role};
use rcs_msg::classes::{CLASSES, LabelClass, classes_to_json};
use rcs_msg::{DeltaCodec, Payload, Schema, schema_of};
use std::collections::BTreeMap;
use std::marker::PhantomData;
use std::sync::Arc;

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

    /// Marks the output as ground truth of a simulation: only processes with
    /// [`ProcessDef::reads_ground_truth`](crate::ProcessDef::reads_ground_truth) may read it.
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
