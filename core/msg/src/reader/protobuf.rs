//! Protobuf messages to and from a [`Value`], by their descriptor.

use super::EncodeError;
use crate::packed::{Number, Packed};
use crate::path::FieldPath;
use crate::value::Value;
use bytes::Bytes;
use prost::Message;
use prost_reflect::{
    DynamicMessage, FieldDescriptor, Kind, MapKey, MessageDescriptor, ReflectMessage, Value as Reflected,
};
use std::collections::HashMap;

/// Reads a message; `bytes` fields share `bytes`.
pub(super) fn decode(descriptor: &MessageDescriptor, bytes: &Bytes) -> Result<Value, String> {
    // Decoding from a slice would copy every `bytes` field.
    let message =
        DynamicMessage::decode(descriptor.clone(), bytes.clone()).map_err(|error| error.to_string())?;
    Ok(message_value(&message))
}

/// Writes a message.
pub(crate) fn encode(descriptor: &MessageDescriptor, value: &Value) -> Result<Bytes, EncodeError> {
    Ok(dynamic(descriptor, value, &FieldPath::root())?.encode_to_vec().into())
}

/// The tree of a dynamic message.
pub(crate) fn message_value(message: &DynamicMessage) -> Value {
    let descriptor = message.descriptor();
    let fields = descriptor.fields().map(|field| {
        let value = if field.supports_presence() && !message.has_field(&field) {
            Value::Null
        } else {
            field_value(&field, &message.get_field(&field))
        };
        (field.name().to_owned(), value)
    });
    Value::Message(fields.collect())
}

fn field_value(field: &FieldDescriptor, value: &Reflected) -> Value {
    match value {
        Reflected::List(list) => list_value(&field.kind(), list),
        Reflected::Map(map) => {
            let Kind::Message(entry) = field.kind() else { return Value::Null };
            let kind = entry.map_entry_value_field().kind();
            // Maps are unordered; they are sorted by key.
            let mut entries: Vec<_> = map.iter().collect();
            entries.sort_by(|a, b| a.0.cmp(b.0));
            Value::Message(entries.into_iter().map(|(key, v)| (key_text(key), scalar(&kind, v))).collect())
        }
        value => scalar(&field.kind(), value),
    }
}

/// Lists of floating-point numbers are packed, so that a large list takes no more memory than its numbers.
fn list_value(kind: &Kind, list: &[Reflected]) -> Value {
    let packed = |number, data: Vec<u8>| Value::Packed(Packed::new(number, false, data.into()));
    match kind {
        Kind::Double => packed(
            Number::F64,
            list.iter().filter_map(Reflected::as_f64).flat_map(f64::to_le_bytes).collect(),
        ),
        Kind::Float => packed(
            Number::F32,
            list.iter().filter_map(Reflected::as_f32).flat_map(f32::to_le_bytes).collect(),
        ),
        kind => Value::List(list.iter().map(|item| scalar(kind, item)).collect()),
    }
}

fn scalar(kind: &Kind, value: &Reflected) -> Value {
    match value {
        Reflected::Bool(v) => Value::Bool(*v),
        Reflected::I32(v) => Value::Int((*v).into()),
        Reflected::I64(v) => Value::Int(*v),
        Reflected::U32(v) => Value::Uint((*v).into()),
        Reflected::U64(v) => Value::Uint(*v),
        Reflected::F32(v) => Value::Float((*v).into()),
        Reflected::F64(v) => Value::Float(*v),
        Reflected::String(v) => Value::Text(v.clone()),
        Reflected::Bytes(v) => Value::Bytes(v.clone()),
        Reflected::EnumNumber(number) => {
            let name = kind.as_enum().and_then(|kind| kind.get_value(*number));
            Value::Enum { number: *number, name: name.map(|name| name.name().to_owned()).unwrap_or_default() }
        }
        Reflected::Message(message) => message_value(message),
        // Not reached: the caller handles these kinds, and neither can occur within a list or a map.
        Reflected::List(_) | Reflected::Map(_) => Value::Null,
    }
}

fn key_text(key: &MapKey) -> String {
    match key {
        MapKey::Bool(v) => v.to_string(),
        MapKey::I32(v) => v.to_string(),
        MapKey::I64(v) => v.to_string(),
        MapKey::U32(v) => v.to_string(),
        MapKey::U64(v) => v.to_string(),
        MapKey::String(v) => v.clone(),
    }
}

/// A dynamic message that holds `value`.
pub(crate) fn dynamic(
    descriptor: &MessageDescriptor,
    value: &Value,
    path: &FieldPath,
) -> Result<DynamicMessage, EncodeError> {
    let mut message = DynamicMessage::new(descriptor.clone());
    let Value::Message(fields) = value else { return Err(mismatch(value, "a message", path)) };
    for (name, value) in fields {
        let path = path.field(name);
        let Some(field) = descriptor.get_field_by_name(name) else {
            let names: Vec<_> = descriptor.fields().map(|field| field.name().to_owned()).collect();
            let expected = format!("a field of {}: {}", descriptor.full_name(), names.join(", "));
            return Err(EncodeError::Field { got: format!("{name:?}"), expected, path });
        };
        if *value != Value::Null {
            message.set_field(&field, reflect_field(&field, value, &path)?);
        }
    }
    Ok(message)
}

fn mismatch(value: &Value, expected: &str, path: &FieldPath) -> EncodeError {
    EncodeError::Field { got: value.kind().to_owned(), expected: expected.to_owned(), path: path.clone() }
}

/// Converts the value of a field, including lists and maps, to the type of the field.
pub(crate) fn reflect_field(
    field: &FieldDescriptor,
    value: &Value,
    path: &FieldPath,
) -> Result<Reflected, EncodeError> {
    if field.is_map() {
        let (Kind::Message(entry), Value::Message(entries)) = (field.kind(), value) else {
            return Err(mismatch(value, "a message with a field for each key", path));
        };
        let (key_kind, kind) = (entry.map_entry_key_field().kind(), entry.map_entry_value_field().kind());
        let mut map = HashMap::new();
        for (key, value) in entries {
            let path = path.field(key);
            let key = text_key(&key_kind, key).ok_or_else(|| EncodeError::Field {
                got: format!("{key:?}"),
                expected: format!("a key of type {key_kind:?}"),
                path: path.clone(),
            })?;
            map.insert(key, reflect(&kind, value, &path)?);
        }
        return Ok(Reflected::Map(map));
    }
    if !field.is_list() {
        return reflect(&field.kind(), value, path);
    }
    let items: Result<Vec<_>, _> = match value {
        Value::List(list) => {
            list.iter().enumerate().map(|(i, item)| reflect(&field.kind(), item, &path.index(i))).collect()
        }
        Value::Packed(packed) => {
            let items = packed.iter().map(Value::from).enumerate();
            items.map(|(i, item)| reflect(&field.kind(), &item, &path.index(i))).collect()
        }
        _ => return Err(mismatch(value, "a list", path)),
    };
    items.map(Reflected::List)
}

fn text_key(kind: &Kind, text: &str) -> Option<MapKey> {
    Some(match kind {
        Kind::Bool => MapKey::Bool(text.parse().ok()?),
        Kind::Int32 | Kind::Sint32 | Kind::Sfixed32 => MapKey::I32(text.parse().ok()?),
        Kind::Int64 | Kind::Sint64 | Kind::Sfixed64 => MapKey::I64(text.parse().ok()?),
        Kind::Uint32 | Kind::Fixed32 => MapKey::U32(text.parse().ok()?),
        Kind::Uint64 | Kind::Fixed64 => MapKey::U64(text.parse().ok()?),
        _ => MapKey::String(text.to_owned()),
    })
}

/// Converts one value to the type of a field.
pub(crate) fn reflect(kind: &Kind, value: &Value, path: &FieldPath) -> Result<Reflected, EncodeError> {
    let integer = value.as_i64();
    let (reflected, expected) = match kind {
        Kind::Bool => (
            match value {
                Value::Bool(v) => Some(Reflected::Bool(*v)),
                _ => None,
            },
            "a boolean",
        ),
        Kind::Double => (number(value).map(Reflected::F64), "a number"),
        Kind::Float => (number(value).map(|v| Reflected::F32(v as f32)), "a number"),
        Kind::Int32 | Kind::Sint32 | Kind::Sfixed32 => {
            (integer.and_then(|v| v.try_into().ok()).map(Reflected::I32), "an integer of 32 bits")
        }
        Kind::Int64 | Kind::Sint64 | Kind::Sfixed64 => (integer.map(Reflected::I64), "an integer of 64 bits"),
        Kind::Uint32 | Kind::Fixed32 => {
            (integer.and_then(|v| v.try_into().ok()).map(Reflected::U32), "an integer from 0, of 32 bits")
        }
        Kind::Uint64 | Kind::Fixed64 => {
            let large = match value {
                Value::Uint(v) => Some(*v),
                _ => integer.and_then(|v| v.try_into().ok()),
            };
            (large.map(Reflected::U64), "an integer from 0, of 64 bits")
        }
        Kind::String => (
            match value {
                Value::Text(text) => Some(Reflected::String(text.clone())),
                _ => None,
            },
            "a text",
        ),
        Kind::Bytes => (
            match value {
                Value::Bytes(bytes) => Some(Reflected::Bytes(bytes.clone())),
                _ => None,
            },
            "bytes",
        ),
        Kind::Enum(choices) => {
            let number = match value {
                Value::Text(name) => choices.get_value_by_name(name).map(|choice| choice.number()),
                value => {
                    integer.and_then(|v| i32::try_from(v).ok()).filter(|_| !matches!(value, Value::Float(_)))
                }
            };
            let Some(number) = number else {
                let names: Vec<_> = choices.values().map(|choice| choice.name().to_owned()).collect();
                let got = value.as_text().map_or_else(|| value.kind().to_owned(), |text| format!("{text:?}"));
                return Err(EncodeError::Field {
                    got,
                    expected: format!("one of {}", names.join(", ")),
                    path: path.clone(),
                });
            };
            (Some(Reflected::EnumNumber(number)), "a choice")
        }
        Kind::Message(descriptor) => {
            return dynamic(descriptor, value, path).map(Reflected::Message);
        }
    };
    reflected.ok_or_else(|| mismatch(value, expected, path))
}

/// The value as a number, unless it is a boolean or an enum value.
fn number(value: &Value) -> Option<f64> {
    matches!(value, Value::Int(_) | Value::Uint(_) | Value::Float(_)).then(|| value.as_f64()).flatten()
}
