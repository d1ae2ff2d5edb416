//! Parameters as messages: what our field options say of each field, defaults, and a door that refuses bad values.
//!
//! A parameter message is flat: each field is a number, a switch, a text or a choice, and carries unit, help and
//! default; numbers carry the range in which they are accepted, too. See `proto/rcs/options.proto`.

use crate::any::{Payload, schema_of};
use crate::path::FieldPath;
use crate::reader::protobuf::{message_value, reflect};
use crate::value::Value;
use prost_reflect::{
    DynamicMessage, FieldDescriptor, Kind, MessageDescriptor, ReflectMessage, Value as Reflected,
};

/// What a parameter holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ParamKind {
    /// On or off.
    Switch,
    /// A whole number.
    Integer,
    /// A number.
    Number,
    /// A text.
    Text,
    /// One of [`ParamSpec::choices`].
    Choice,
}

/// All that a window, a stack file and a command line must know of one parameter.
#[derive(Clone, Debug, PartialEq)]
pub struct ParamSpec {
    /// Name of the field.
    pub name: String,
    /// What it holds.
    pub kind: ParamKind,
    /// Unit as shown; `1` for a pure number, empty for texts, choices and switches.
    pub unit: String,
    /// Least value that is accepted.
    pub min: Option<f64>,
    /// Largest value that is accepted.
    pub max: Option<f64>,
    /// The value where no one says another.
    pub default: Value,
    /// One sentence that says what it does; empty where the options say nothing.
    pub help: String,
    /// The fusion source that it weighs.
    pub fusion_source: Option<String>,
    /// Kind of the file whose text it is: `world`, `vehicle`, `course`, `models`. A stack gives the file's name.
    pub file: Option<String>,
    /// Numbers and names to choose from.
    pub choices: Vec<(i32, String)>,
}

/// Why a parameter is refused.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ParamError {
    /// No such parameter.
    #[error("no parameter {name:?} in {message}, expected one of {expected}")]
    Unknown {
        /// The name asked for.
        name: String,
        /// The parameter message.
        message: String,
        /// The parameters that there are.
        expected: String,
    },
    /// A number that is not accepted, or something that is no such value at all.
    #[error("parameter {name}: got {got}, expected {expected}")]
    Refused {
        /// The parameter.
        name: String,
        /// The value, or its kind.
        got: String,
        /// The range with its unit, or the kind.
        expected: String,
    },
}

/// The parameters of a message, in the order of its declaration. Fields that are no parameters (lists, messages) are
/// left out.
pub fn specs(descriptor: &MessageDescriptor) -> Vec<ParamSpec> {
    fields(descriptor).iter().filter_map(spec).collect()
}

/// The message with every parameter at its default.
pub fn defaults(descriptor: &MessageDescriptor) -> DynamicMessage {
    let mut message = DynamicMessage::new(descriptor.clone());
    for field in fields(descriptor) {
        let Some(spec) = spec(&field) else { continue };
        if let Ok(value) = reflect(&field.kind(), &spec.default, &FieldPath::root()) {
            message.set_field(&field, value);
        }
    }
    message
}

/// The typed message with every parameter at its default.
pub fn default<T: Payload>() -> T {
    // Of a type that is ours, the descriptor is known and what it encodes decodes.
    let message = schema_of::<T>().descriptor().map(defaults);
    message.and_then(|message| message.transcode_to().ok()).unwrap_or_default()
}

/// Sets one parameter. NaN, a number out of range and a value of another kind are refused and change nothing.
pub fn set_param(message: &mut DynamicMessage, name: &str, value: &Value) -> Result<(), ParamError> {
    let (field, spec) = find(&message.descriptor(), name)?;
    let refused = |got| ParamError::Refused { name: name.to_owned(), got, expected: spec.expected() };
    let reflected = reflect(&field.kind(), value, &FieldPath::root()).map_err(|_| refused(show(value)))?;
    if !spec.accepts(&field, &reflected) {
        return Err(refused(show(value)));
    }
    message.set_field(&field, reflected);
    Ok(())
}

/// Sets one parameter from what a person wrote: a number, `true` or `false`, a text, the name of a choice.
pub fn set_param_text(message: &mut DynamicMessage, name: &str, text: &str) -> Result<(), ParamError> {
    let (_, spec) = find(&message.descriptor(), name)?;
    let trimmed = text.trim();
    let value = match spec.kind {
        ParamKind::Switch => trimmed.parse().ok().map(Value::Bool),
        ParamKind::Integer => {
            let signed = trimmed.parse().ok().map(Value::Int);
            signed.or_else(|| trimmed.parse().ok().map(Value::Uint))
        }
        ParamKind::Number => trimmed.parse().ok().map(Value::Float),
        ParamKind::Text => Some(Value::Text(text.to_owned())),
        ParamKind::Choice => {
            Some(trimmed.parse().map_or_else(|_| Value::Text(trimmed.to_owned()), Value::Int))
        }
    };
    let value = value.ok_or_else(|| ParamError::Refused {
        name: name.to_owned(),
        got: format!("{text:?}"),
        expected: spec.expected(),
    })?;
    set_param(message, name, &value)
}

/// Whether every parameter of a message is accepted: for messages that came whole.
pub fn check(message: &DynamicMessage) -> Result<(), ParamError> {
    for field in fields(&message.descriptor()) {
        let Some(spec) = spec(&field) else { continue };
        let value = message.get_field(&field);
        if !spec.accepts(&field, &value) {
            let got = message_value(message).field(field.name()).map_or_else(String::new, show);
            let expected = spec.expected();
            return Err(ParamError::Refused { name: spec.name, got, expected });
        }
    }
    Ok(())
}

/// [`check`] for a typed message.
pub fn check_typed<T: Payload>(message: &T) -> Result<(), ParamError> {
    let Some(descriptor) = schema_of::<T>().descriptor() else { return Ok(()) };
    let mut dynamic = DynamicMessage::new(descriptor.clone());
    match dynamic.transcode_from(message) {
        Ok(()) => check(&dynamic),
        Err(error) => Err(ParamError::Refused {
            name: descriptor.full_name().to_owned(),
            got: error.to_string(),
            expected: "a message of its own type".to_owned(),
        }),
    }
}

/// Fields in the order of the declaration, which is the order in which a person meets them.
fn fields(descriptor: &MessageDescriptor) -> Vec<FieldDescriptor> {
    let declared = descriptor.descriptor_proto().field.iter();
    declared.filter_map(|field| descriptor.get_field_by_name(field.name())).collect()
}

fn find(descriptor: &MessageDescriptor, name: &str) -> Result<(FieldDescriptor, ParamSpec), ParamError> {
    let field = descriptor.get_field_by_name(name);
    field.and_then(|field| spec(&field).map(|spec| (field, spec))).ok_or_else(|| ParamError::Unknown {
        name: name.to_owned(),
        message: descriptor.full_name().to_owned(),
        expected: specs(descriptor).into_iter().map(|spec| spec.name).collect::<Vec<_>>().join(", "),
    })
}

/// What the options of a field say; `None` where it is no parameter.
fn spec(field: &FieldDescriptor) -> Option<ParamSpec> {
    if field.is_list() {
        return None;
    }
    let kind = match field.kind() {
        Kind::Bool => ParamKind::Switch,
        Kind::Double | Kind::Float => ParamKind::Number,
        Kind::String => ParamKind::Text,
        Kind::Enum(_) => ParamKind::Choice,
        Kind::Bytes | Kind::Message(_) => return None,
        _ => ParamKind::Integer,
    };
    let options = field.options();
    let option = |name: &str| {
        let extension = field.parent_pool().get_extension_by_name(&format!("rcs.{name}"))?;
        options.has_extension(&extension).then(|| options.get_extension(&extension).into_owned())
    };
    let number = |name| option(name).as_ref().and_then(Reflected::as_f64);
    let text = |name| option(name).as_ref().and_then(|value| value.as_str().map(str::to_owned));
    let choices: Vec<(i32, String)> = match field.kind() {
        Kind::Enum(choices) => {
            choices.values().map(|choice| (choice.number(), choice.name().to_owned())).collect()
        }
        _ => Vec::new(),
    };
    let default = number("default").unwrap_or(0.0);
    let default = match kind {
        ParamKind::Switch => Value::Bool(default != 0.0),
        ParamKind::Number => Value::Float(default),
        ParamKind::Integer => Value::Int(default as i64),
        ParamKind::Text => Value::Text(text("default_text").unwrap_or_default()),
        ParamKind::Choice => {
            let number = default as i32;
            let name = choices.iter().find(|(choice, _)| *choice == number);
            Value::Enum { number, name: name.map(|(_, name)| name.clone()).unwrap_or_default() }
        }
    };
    Some(ParamSpec {
        name: field.name().to_owned(),
        kind,
        unit: text("unit").unwrap_or_default(),
        min: number("min"),
        max: number("max"),
        default,
        help: text("help").unwrap_or_default(),
        fusion_source: text("fusion_source"),
        file: text("file"),
        choices,
    })
}

impl ParamSpec {
    /// What is accepted, in words.
    fn expected(&self) -> String {
        let number = match self.kind {
            ParamKind::Switch => return "true or false".to_owned(),
            ParamKind::Text => return "a text".to_owned(),
            ParamKind::Choice => {
                let names: Vec<_> = self.choices.iter().map(|(_, name)| name.as_str()).collect();
                return format!("one of {}", names.join(", "));
            }
            ParamKind::Integer => "a whole number",
            ParamKind::Number => "a number",
        };
        let range = match (self.min, self.max) {
            (Some(min), Some(max)) => format!("{number} from {min} to {max}"),
            (Some(min), None) => format!("{number} of at least {min}"),
            (None, Some(max)) => format!("{number} of at most {max}"),
            (None, None) => number.to_owned(),
        };
        if self.unit.is_empty() || self.unit == "1" { range } else { format!("{range} {}", self.unit) }
    }

    /// Whether a value of the field's own type is accepted.
    fn accepts(&self, field: &FieldDescriptor, value: &Reflected) -> bool {
        // A range is compared in the width of the field, in which 0.1 is not quite 0.1.
        let narrow = |bound: f64| if field.kind() == Kind::Float { f64::from(bound as f32) } else { bound };
        let number = match value {
            Reflected::F64(v) => *v,
            Reflected::F32(v) => f64::from(*v),
            Reflected::I32(v) => f64::from(*v),
            Reflected::U32(v) => f64::from(*v),
            Reflected::I64(v) => *v as f64,
            Reflected::U64(v) => *v as f64,
            Reflected::EnumNumber(v) => return self.choices.iter().any(|(choice, _)| choice == v),
            _ => return true,
        };
        number.is_finite()
            && self.min.is_none_or(|min| number >= narrow(min))
            && self.max.is_none_or(|max| number <= narrow(max))
    }
}

/// A value as an error shows it.
fn show(value: &Value) -> String {
    match value {
        Value::Bool(v) => v.to_string(),
        Value::Int(v) => v.to_string(),
        Value::Uint(v) => v.to_string(),
        Value::Float(v) => v.to_string(),
        Value::Text(v) => format!("{v:?}"),
        Value::Enum { number, name } if name.is_empty() => number.to_string(),
        Value::Enum { name, .. } => name.clone(),
        other => other.kind().to_owned(),
    }
}
