//! Commands that processes obey.
//!
//! A process declares its own commands as one enum with [`commands!`](crate::commands). The runtime adds five that
//! every process obeys:
//!
//! | command | what it does |
//! | --- | --- |
//! | `INIT` | creates the state again from the parameters (also after a panic), then calls
//! [`Process::init`](crate::Process::init) every cycle |
//! | `RUN` | calls [`Process::cycle`](crate::Process::cycle) every cycle |
//! | `HALT` | calls [`Process::halt`](crate::Process::halt) every cycle |
//! | `TAKE` | takes or keeps the authority over the process; its work does not change |
//! | `RELEASE` | returns the authority: the operator's goes to the supervisor |
//!
//! `register.rs` decides who may command a process, and what happens to commands that cannot be obeyed.

use rcs_msg::{Payload, Schema, Stamp, params, rcs, schema_of};
use std::any::Any;
use std::sync::Arc;

/// The commands of a kind of process in addition to those of the runtime. Implemented by
/// [`commands!`](crate::commands).
pub trait CommandSet: Clone + Send + Sync + 'static {
    /// The commands, in the order in which they are shown.
    const COMMANDS: &'static [CommandDef];
    /// Decodes a command; the error says what is wrong with its name or its parameters.
    fn decode(command: &rcs::Command) -> Result<Self, String>;
    /// Name and parameters, in the form that [`CommandSet::decode`] reads.
    fn encode(&self) -> Encoded;
}

/// A type with commands of its own: every [`Process`](crate::Process).
pub trait Obeys {
    /// Its own commands.
    type Own: CommandSet;
}

/// A command that a process obeys.
#[derive(Clone, Copy, Debug)]
pub struct CommandDef {
    /// Its name: `CLEAR`.
    pub name: &'static str,
    /// One sentence.
    pub help: &'static str,
    /// Schema of its parameters, a message whose fields have unit, range, default and help like those of a process's
    /// parameters; `None` for a command without parameters.
    pub parameters: Option<fn() -> &'static Arc<Schema>>,
    /// Whether its work is done at once: what the process was told before stays in force.
    pub is_one_shot: bool,
}

impl CommandDef {
    /// Full name of its parameter message; empty for a command without parameters.
    pub fn parameters_schema(&self) -> &'static str {
        self.parameters.map_or("", |schema| schema().name())
    }
}

/// An encoded command.
#[derive(Clone, Debug)]
pub struct Encoded {
    /// Its name.
    pub name: &'static str,
    /// Schema and bytes of its parameters; both empty for a command without parameters.
    pub parameters: (String, Vec<u8>),
}

/// The empty set: a process that obeys only the commands of the runtime.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NoCommands {}

impl CommandSet for NoCommands {
    const COMMANDS: &'static [CommandDef] = &[];

    fn decode(command: &rcs::Command) -> Result<Self, String> {
        Err(unknown::<Self>(&command.name))
    }

    fn encode(&self) -> Encoded {
        match *self {}
    }
}

/// A command for a child whose own commands are `C`.
#[derive(Clone, Debug, PartialEq)]
pub enum Order<C> {
    /// `INIT`: start again.
    Init,
    /// `RUN`: work.
    Run,
    /// `HALT`: stop working.
    Halt,
    /// A command of the child's own.
    Own(C),
}

impl<C> From<C> for Order<C> {
    fn from(command: C) -> Self {
        Order::Own(command)
    }
}

impl<C: CommandSet> Order<C> {
    pub(crate) fn message(&self, serial: u64, now: Stamp) -> rcs::Command {
        let plain = |name| Encoded { name, parameters: (String::new(), Vec::new()) };
        let encoded = match self {
            Order::Init => plain(INIT),
            Order::Run => plain(RUN),
            Order::Halt => plain(HALT),
            Order::Own(command) => command.encode(),
        };
        let (parameters_schema, parameters) = encoded.parameters;
        let name = encoded.name.to_owned();
        rcs::Command {
            timestamp: Some(now.to_proto()),
            serial,
            name,
            parameters_schema,
            parameters: parameters.into(),
        }
    }
}

/// Declares a process's own commands: an enum whose variants have a name, a sentence of help and optionally a parameter
/// message. `once` marks a one-shot, after which what the process was told before is still in force.
///
/// ```
/// rcs_runtime::commands! {
///     /// The commands of a path planner.
///     pub enum PlannerCommand {
///         Stop = "STOP": "Plan no path.",
///         Limit(rcs_msg::rcs::SpeedLimit) = "LIMIT": "Plan no faster than this.",
///         Clear = "CLEAR" once: "Forget the map.",
///     }
/// }
/// ```
#[macro_export]
macro_rules! commands {
    (@schema) => { None };
    (@schema $parameters:ty) => { Some($crate::commands::schema_of::<$parameters>) };
    (@is_one_shot) => { false };
    (@is_one_shot once) => { true };
    (@decode $command:ident $name:ident $variant:ident) => {
        $crate::commands::no_parameters($command).map(|()| $name::$variant)
    };
    (@decode $command:ident $name:ident $variant:ident $parameters:ty) => {
        $crate::commands::parameters::<$parameters>($command).map($name::$variant)
    };
    (@bind $value:ident $parameters:ty) => { $value };
    (@encode) => { (String::new(), Vec::new()) };
    (@encode $value:ident $parameters:ty) => { $crate::commands::encode($value) };
    (
        $(#[$meta:meta])*
        $visibility:vis enum $name:ident {
            $($variant:ident $(($parameters:ty))? = $text:literal $($once:ident)? : $help:literal),+ $(,)?
        }
    ) => {
        $(#[$meta])*
        #[derive(Clone, Debug, PartialEq)]
        $visibility enum $name {
            $(#[doc = $help] $variant $(($parameters))?),+
        }

        impl $crate::CommandSet for $name {
            const COMMANDS: &'static [$crate::CommandDef] = &[$($crate::CommandDef {
                name: $text,
                help: $help,
                parameters: $crate::commands!(@schema $($parameters)?),
                is_one_shot: $crate::commands!(@is_one_shot $($once)?),
            }),+];

            fn decode(command: &$crate::commands::Command) -> Result<Self, String> {
                match command.name.as_str() {
                    $($text => $crate::commands!(@decode command $name $variant $($parameters)?),)+
                    name => Err($crate::commands::unknown::<Self>(name)),
                }
            }

            fn encode(&self) -> $crate::commands::Encoded {
                match self {
                    $(Self::$variant $({ 0: $crate::commands!(@bind value $parameters) })? => {
                        $crate::commands::Encoded {
                            name: $text,
                            parameters: $crate::commands!(@encode $(value $parameters)?),
                        }
                    })+
                }
            }
        }
    };
}

/// Functions that code from [`commands!`](crate::commands) calls.
#[doc(hidden)]
pub mod support {
    pub use super::{Encoded, encode, no_parameters, parameters, unknown};
    pub use rcs_msg::{rcs::Command, schema_of};
}

/// The error for a name that is not in the set, with the names that are.
pub fn unknown<C: CommandSet>(name: &str) -> String {
    let known = C::COMMANDS.iter().map(|known| known.name);
    let known: Vec<_> = BUILT_IN.iter().map(|known| known.name).chain(known).collect();
    format!("unknown command {name}; expected {}", known.join(", "))
}

/// Refuses parameters for a command that has none.
pub fn no_parameters(command: &rcs::Command) -> Result<(), String> {
    if command.parameters_schema.is_empty() && command.parameters.is_empty() {
        return Ok(());
    }
    Err(format!("{} has no parameters; got {}", command.name, named(&command.parameters_schema)))
}

/// Decodes the parameters of a command and checks their type and ranges.
pub fn parameters<T: Payload>(command: &rcs::Command) -> Result<T, String> {
    let (name, expected) = (&command.name, T::full_name());
    if command.parameters_schema != expected {
        return Err(format!(
            "{name} needs parameters of type {expected}; got {}",
            named(&command.parameters_schema)
        ));
    }
    let value = T::decode(command.parameters.as_ref())
        .map_err(|error| format!("the parameters of {name} do not decode as {expected}: {error}"))?;
    params::check_typed(&value).map_err(|error| format!("{name}: {error}"))?;
    Ok(value)
}

/// Schema and bytes of parameters.
pub fn encode<T: Payload>(value: &T) -> (String, Vec<u8>) {
    (schema_of::<T>().name().to_owned(), value.encode_to_vec())
}

fn named(schema: &str) -> &str {
    if schema.is_empty() { "none" } else { schema }
}

pub(crate) const INIT: &str = "INIT";
pub(crate) const RUN: &str = "RUN";
pub(crate) const HALT: &str = "HALT";
pub(crate) const TAKE: &str = "TAKE";
pub(crate) const RELEASE: &str = "RELEASE";

/// The runtime's commands, which every process obeys.
pub const BUILT_IN: &[CommandDef] = &[
    built_in(INIT, "Make the state anew, after a panic, too."),
    built_in(RUN, "Work from now on."),
    built_in(HALT, "Stop working; the state is kept."),
    built_in(TAKE, "Take the authority over the process, or keep it."),
    built_in(RELEASE, "Give the authority back."),
];

const fn built_in(name: &'static str, help: &'static str) -> CommandDef {
    CommandDef { name, help, parameters: None, is_one_shot: false }
}

/// Decodes a command into the process's own enum.
pub(crate) type Typed = Arc<dyn Any + Send + Sync>;

/// Decodes a message to a command of one type of process; an error says what is wrong with the message.
pub(crate) type Decode = fn(&rcs::Command) -> Result<Typed, String>;
