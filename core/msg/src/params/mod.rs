//! Parameters as messages: the options of each field, defaults, and setters that refuse bad values.
//!
//! A field of a parameter message is a number, a switch, a text, a choice, a message of parameters (a group), or a list
//! of any of these. Each field has unit, help and default; numbers also have an accepted range. A parameter within a
//! group or a list is named by its path: `mount.x_m`, `sources[0].weight`. A group or a list may have a default of its
//! own: `default_text` holds it as JSON, which overlays the defaults of its fields. A group is mandatory: a message
//! without one of its groups is refused. See `proto/rcs/options.proto`.

mod spec;

pub use spec::{ParamKind, ParamSpec, specs};

use crate::any::{AnyMessage, Payload, schema_of};
use crate::path::{FieldPath, Segment};
use crate::reader::protobuf::{message_value, reflect, reflect_field};
use crate::value::Value;
use prost_reflect::{
    DynamicMessage, FieldDescriptor, Kind, MessageDescriptor, ReflectMessage, Value as Reflected,
};
use spec::{fields, from_json, spec};
use std::sync::Arc;

/// Why a parameter is refused.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ParamError {
    /// No parameter has this name.
    #[error("no parameter {name:?} in {message}, expected one of {expected}")]
    Unknown {
        /// The name asked for.
        name: String,
        /// The parameter message.
        message: String,
        /// The names of all parameters.
        expected: String,
    },
    /// A number out of range, or a value of another kind.
    #[error("parameter {name}: got {got}, expected {expected}")]
    Refused {
        /// The parameter, as a path.
        name: String,
        /// The value, or its kind.
        got: String,
        /// The accepted range with its unit, or the expected kind.
        expected: String,
    },
}

/// The message with every parameter at its default.
pub fn defaults(descriptor: &MessageDescriptor) -> DynamicMessage {
    let mut message = DynamicMessage::new(descriptor.clone());
    for field in fields(descriptor) {
        let Some(spec) = spec(&field) else { continue };
        if let Ok(value) = reflect_field(&field, &spec.default, &FieldPath::root()) {
            message.set_field(&field, value);
        }
    }
    message
}

/// The typed message with every parameter at its default.
pub fn default<T: Payload>() -> T {
    // The descriptor of a generated type is known, and what it encodes decodes.
    let message = schema_of::<T>().descriptor().map(defaults);
    message.and_then(|message| message.transcode_to().ok()).unwrap_or_default()
}

/// The specification of the parameter that a path names: `speed_mps`, `mount.x_m`, `sources[2].weight`.
pub fn find(descriptor: &MessageDescriptor, path: &str) -> Result<ParamSpec, ParamError> {
    let path = parse(descriptor, path)?;
    let (mut known, mut message) = (specs(descriptor), descriptor.full_name().to_owned());
    let mut descriptor = Some(descriptor.clone());
    let mut found: Option<ParamSpec> = None;
    for segment in path.segments() {
        found = Some(match (segment, found) {
            (Segment::Field(name), within)
                if within.as_ref().is_none_or(|spec| spec.kind == ParamKind::Group) =>
            {
                let spec = known.iter().find(|spec| spec.name == *name).cloned();
                let spec = spec.ok_or_else(|| unknown(name, &message, &known))?;
                let field = descriptor.as_ref().and_then(|message| message.get_field_by_name(name));
                descriptor = field.and_then(|field| field.kind().as_message().cloned());
                if let Some(nested) = &descriptor {
                    nested.full_name().clone_into(&mut message);
                }
                spec
            }
            (Segment::Index(_), Some(list)) if list.kind == ParamKind::List => list.element(),
            (segment, within) => {
                let name = FieldPath::root().join(segment.clone()).to_string();
                let within = within.map(|spec| spec.fields).unwrap_or_default();
                return Err(unknown(name.trim_start_matches('.'), &message, &within));
            }
        });
        known = found.as_ref().map(|spec| spec.fields.clone()).unwrap_or_default();
    }
    found.ok_or_else(|| unknown("", &message, &known))
}

/// Sets one parameter, named by its path. In a group, only the fields that the value names change. A list is replaced,
/// and fields that its elements do not name take their defaults. NaN, a number out of range and a value of another kind
/// are refused and change nothing.
pub fn set_param(message: &mut DynamicMessage, path: &str, value: &Value) -> Result<(), ParamError> {
    let parsed = parse(&message.descriptor(), path)?;
    let mut changed = message.clone();
    set_in(&mut changed, parsed.segments(), &FieldPath::root(), value)?;
    *message = changed;
    Ok(())
}

/// Sets one parameter from text: a number, `true` or `false`, a text, the name of a choice, or JSON for a group or a
/// list.
pub fn set_param_text(message: &mut DynamicMessage, path: &str, text: &str) -> Result<(), ParamError> {
    let spec = find(&message.descriptor(), path)?;
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
        ParamKind::Group | ParamKind::List => from_json(trimmed),
    };
    let value = value.ok_or_else(|| ParamError::Refused {
        name: path.to_owned(),
        got: format!("{text:?}"),
        expected: spec.expected(),
    })?;
    set_param(message, path, &value)
}

/// A copy of a parameter message with some parameters changed, each given as text ([`set_param_text`]).
pub fn with_params<'a>(
    message: &AnyMessage,
    changes: impl IntoIterator<Item = (&'a str, &'a str)>,
) -> Result<AnyMessage, ParamError> {
    let schema = message.schema();
    let unreadable = |got: String| ParamError::Refused {
        name: schema.name().to_owned(),
        got,
        expected: "a parameter message".to_owned(),
    };
    let descriptor = schema.descriptor().ok_or_else(|| unreadable("a type without descriptor".to_owned()))?;
    let mut values = DynamicMessage::decode(descriptor.clone(), message.bytes())
        .map_err(|error| unreadable(error.to_string()))?;
    for (name, text) in changes {
        set_param_text(&mut values, name, text)?;
    }
    Ok(AnyMessage::encoded(Arc::clone(&schema), prost::Message::encode_to_vec(&values).into()))
}

/// Whether a parameter of the message, at any depth, is a file.
pub fn has_files(descriptor: &MessageDescriptor) -> bool {
    have_files(&specs(descriptor))
}

fn have_files(specs: &[ParamSpec]) -> bool {
    specs.iter().any(|spec| spec.file.is_some() || have_files(&spec.fields))
}

/// Calls `visit` with the path and the text of each parameter that is a file, at any depth; `visit` may replace the
/// text. Stops at the first error.
pub fn visit_file_texts<E>(
    message: &mut DynamicMessage,
    visit: &mut impl FnMut(&str, &mut String) -> Result<(), E>,
) -> Result<(), E> {
    let specs = specs(&message.descriptor());
    visit_files(message, &specs, &FieldPath::root(), visit)
}

fn visit_files<E>(
    message: &mut DynamicMessage,
    specs: &[ParamSpec],
    at: &FieldPath,
    visit: &mut impl FnMut(&str, &mut String) -> Result<(), E>,
) -> Result<(), E> {
    for spec in specs.iter().filter(|spec| spec.file.is_some() || have_files(&spec.fields)) {
        if !message.has_field_by_name(&spec.name) {
            continue;
        }
        let path = at.field(spec.name.as_str());
        let Some(value) = message.get_field_by_name_mut(&spec.name) else { continue };
        match value {
            Reflected::List(items) => {
                for (index, item) in items.iter_mut().enumerate() {
                    visit_file(item, spec, &path.index(index), visit)?;
                }
            }
            one => visit_file(one, spec, &path, visit)?,
        }
    }
    Ok(())
}

fn visit_file<E>(
    value: &mut Reflected,
    spec: &ParamSpec,
    at: &FieldPath,
    visit: &mut impl FnMut(&str, &mut String) -> Result<(), E>,
) -> Result<(), E> {
    match value {
        Reflected::String(text) if spec.file.is_some() => visit(at.to_string().trim_start_matches('.'), text),
        Reflected::Message(group) => visit_files(group, &spec.fields, at, visit),
        _ => Ok(()),
    }
}

/// Whether every parameter of a message is accepted: for messages that arrive complete.
pub fn check(message: &DynamicMessage) -> Result<(), ParamError> {
    check_at(message, &FieldPath::root())
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

fn check_at(message: &DynamicMessage, at: &FieldPath) -> Result<(), ParamError> {
    for field in fields(&message.descriptor()) {
        let Some(spec) = spec(&field) else { continue };
        let path = at.field(field.name());
        let value = message.get_field(&field);
        if spec.kind == ParamKind::Group && !message.has_field(&field) {
            return Err(refused(&path, "nothing".to_owned(), &spec));
        }
        let Reflected::List(items) = value.as_ref() else {
            check_value(&field, &spec, &value, &path)?;
            continue;
        };
        if !spec.accepts_count(items.len()) {
            return Err(refused(&path, format!("{} elements", items.len()), &spec));
        }
        let element = spec.element();
        for (index, item) in items.iter().enumerate() {
            check_value(&field, &element, item, &path.index(index))?;
        }
    }
    Ok(())
}

fn check_value(
    field: &FieldDescriptor,
    spec: &ParamSpec,
    value: &Reflected,
    path: &FieldPath,
) -> Result<(), ParamError> {
    match value {
        Reflected::Message(nested) => check_at(nested, path),
        value if spec.accepts(field, value) => Ok(()),
        value => {
            let name = field.name();
            let mut shown = DynamicMessage::new(field.parent_message().clone());
            let whole = if field.is_list() { Reflected::List(vec![value.clone()]) } else { value.clone() };
            shown.set_field(field, whole);
            let shown = message_value(&shown);
            let got = match shown.field(name) {
                Some(Value::List(items)) => items.first().map(show),
                Some(Value::Packed(packed)) => packed.iter().next().map(|number| show(&number.into())),
                got => got.map(show),
            };
            Err(refused(path, got.unwrap_or_default(), spec))
        }
    }
}

/// Sets the value at the rest of a path.
fn set_in(
    message: &mut DynamicMessage,
    segments: &[Segment],
    at: &FieldPath,
    value: &Value,
) -> Result<(), ParamError> {
    let descriptor = message.descriptor();
    let no_such = |name: &str| unknown(name, descriptor.full_name(), &specs(&descriptor));
    let Some((Segment::Field(name), rest)) = segments.split_first() else { return Err(no_such("")) };
    let field = descriptor.get_field_by_name(name);
    let found = field.and_then(|field| spec(&field).map(|spec| (field, spec)));
    let (field, spec) = found.ok_or_else(|| no_such(name))?;
    let path = at.field(name);
    let new = match (rest, spec.kind) {
        ([], ParamKind::List) => list(&field, &spec, value, &path)?,
        ([Segment::Index(index), rest @ ..], ParamKind::List) => {
            let mut items = match message.get_field(&field).into_owned() {
                Reflected::List(items) => items,
                _ => Vec::new(),
            };
            let (path, count) = (path.index(*index), items.len());
            let got = format!("element {index} of {count}");
            let slot = items.get_mut(*index).ok_or_else(|| refused(&path, got, &spec))?;
            match (rest, slot) {
                ([], slot) => *slot = plain_or_group(&field, &spec.element(), Some(&*slot), value, &path)?,
                (rest, Reflected::Message(nested)) => set_in(nested, rest, &path, value)?,
                _ => return Err(refused(&path, "a field of a plain value".to_owned(), &spec)),
            }
            Reflected::List(items)
        }
        ([], _) => {
            let old = message.has_field(&field).then(|| message.get_field(&field).into_owned());
            plain_or_group(&field, &spec, old.as_ref(), value, &path)?
        }
        (rest, ParamKind::Group) => {
            let mut nested =
                group(&field, message.has_field(&field).then(|| message.get_field(&field)).as_deref());
            set_in(&mut nested, rest, &path, value)?;
            Reflected::Message(nested)
        }
        _ => return Err(refused(&path, "a field of a plain value".to_owned(), &spec)),
    };
    message.set_field(&field, new);
    Ok(())
}

/// The nested message, or its defaults if it is absent.
fn group(field: &FieldDescriptor, old: Option<&Reflected>) -> DynamicMessage {
    match (old, field.kind()) {
        (Some(Reflected::Message(nested)), _) => nested.clone(),
        (_, Kind::Message(descriptor)) => defaults(&descriptor),
        // Not reached: callers pass groups only.
        _ => DynamicMessage::new(field.parent_message().clone()),
    }
}

/// Converts a value for a parameter, or for one element of a list.
fn plain_or_group(
    field: &FieldDescriptor,
    spec: &ParamSpec,
    old: Option<&Reflected>,
    value: &Value,
    path: &FieldPath,
) -> Result<Reflected, ParamError> {
    if spec.kind != ParamKind::Group {
        let new = reflect(&field.kind(), value, path).ok().filter(|new| spec.accepts(field, new));
        return new.ok_or_else(|| refused(path, show(value), spec));
    }
    let Value::Message(named) = value else { return Err(refused(path, show(value), spec)) };
    let mut nested = group(field, old);
    for (name, value) in named {
        set_in(&mut nested, &[Segment::Field(name.clone())], path, value)?;
    }
    Ok(Reflected::Message(nested))
}

/// Converts a list.
fn list(
    field: &FieldDescriptor,
    spec: &ParamSpec,
    value: &Value,
    path: &FieldPath,
) -> Result<Reflected, ParamError> {
    let items = match value {
        Value::List(items) => items.clone(),
        Value::Packed(packed) => packed.iter().map(Value::from).collect(),
        other => return Err(refused(path, show(other), spec)),
    };
    if !spec.accepts_count(items.len()) {
        return Err(refused(path, format!("{} elements", items.len()), spec));
    }
    let element = spec.element();
    let items = items.iter().enumerate();
    let new = items.map(|(index, item)| plain_or_group(field, &element, None, item, &path.index(index)));
    new.collect::<Result<_, _>>().map(Reflected::List)
}

fn parse(descriptor: &MessageDescriptor, path: &str) -> Result<FieldPath, ParamError> {
    path.parse().map_err(|_| unknown(path, descriptor.full_name(), &specs(descriptor)))
}

fn unknown(name: &str, message: &str, known: &[ParamSpec]) -> ParamError {
    let names: Vec<_> = known.iter().map(|spec| spec.name.as_str()).collect();
    let expected = if names.is_empty() { "none: there are none".to_owned() } else { names.join(", ") };
    ParamError::Unknown { name: name.to_owned(), message: message.to_owned(), expected }
}

fn refused(path: &FieldPath, got: String, spec: &ParamSpec) -> ParamError {
    let name = path.to_string().trim_start_matches('.').to_owned();
    ParamError::Refused { name, got, expected: spec.expected() }
}

/// A value in the form of an error text.
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
