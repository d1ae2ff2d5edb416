//! Messages of any encoding as a tree.

use crate::packed::{Packed, Scalar};
use crate::path::{FieldPath, Segment};
use crate::time::Stamp;
use bytes::Bytes;
use std::borrow::Cow;

/// A message, or a part of one, of any encoding.
#[derive(Clone, Debug, PartialEq)]
pub enum Value {
    /// No value: an absent submessage, an optional field that is not set, JSON's null.
    Null,
    /// A boolean.
    Bool(bool),
    /// A signed integer of any width.
    Int(i64),
    /// An unsigned integer of any width.
    Uint(u64),
    /// A floating-point number of any width.
    Float(f64),
    /// A text.
    Text(String),
    /// Bytes, shared with the message that contains them.
    Bytes(Bytes),
    /// An enum value.
    Enum {
        /// The number.
        number: i32,
        /// Its name; empty if the schema has no name for the number.
        name: String,
    },
    /// Elements of one kind.
    List(Vec<Value>),
    /// Numbers of one type, in the layout of the message.
    Packed(Packed),
    /// Named fields, in the order of the schema; of several with the same name the last counts.
    Message(Vec<(String, Value)>),
}

impl From<Scalar> for Value {
    fn from(number: Scalar) -> Self {
        match number {
            Scalar::Bool(v) => Self::Bool(v),
            Scalar::Int(v) => Self::Int(v),
            Scalar::Uint(v) => Self::Uint(v),
            Scalar::Float(v) => Self::Float(v),
        }
    }
}

/// Why a path does not lead to a value.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PathError {
    /// No field has this name.
    #[error("no field {name:?} here, expected one of {expected}: {path}")]
    NoField {
        /// The requested name.
        name: String,
        /// The names of all fields.
        expected: String,
        /// The path up to and including the name.
        path: FieldPath,
    },
    /// The index is out of range.
    #[error("index {index} is out of range, got {length} elements: {path}")]
    OutOfRange {
        /// The requested index.
        index: usize,
        /// The number of elements.
        length: usize,
        /// The path up to and including the index.
        path: FieldPath,
    },
    /// The value has another kind than the path or the new value requires.
    #[error("got {got}, expected {expected}: {path}")]
    Kind {
        /// The kind found.
        got: &'static str,
        /// The kind expected.
        expected: &'static str,
        /// The path of the value.
        path: FieldPath,
    },
}

impl Value {
    /// The value at a path. The parts of an absent value are absent, too ([`Value::Null`]).
    pub fn get(&self, path: &FieldPath) -> Result<Cow<'_, Value>, PathError> {
        let mut value = self;
        let segments = path.segments();
        for (at, segment) in segments.iter().enumerate() {
            if matches!(value, Value::Null) {
                return Ok(Cow::Owned(Value::Null));
            }
            let last = at + 1 == segments.len();
            let fail = |expected| PathError::Kind { got: value.kind(), expected, path: upto(path, at) };
            match (segment, value) {
                (Segment::Field(name), Value::Message(fields)) => {
                    value = field(fields, name).ok_or_else(|| no_field(fields, name, path, at))?;
                }
                (Segment::Index(index), Value::List(list)) => {
                    value = list.get(*index).ok_or_else(|| out_of_range(list.len(), *index, path, at))?;
                }
                (Segment::Index(index), Value::Bytes(_) | Value::Packed(_)) => {
                    let length = value.len().unwrap_or_default();
                    let item = value.item(*index).ok_or_else(|| out_of_range(length, *index, path, at))?;
                    if !last {
                        let path = upto(path, at + 1);
                        return Err(PathError::Kind {
                            got: item.kind(),
                            expected: "a message or a list",
                            path,
                        });
                    }
                    return Ok(Cow::Owned(item.into_owned()));
                }
                (Segment::Length, _) => {
                    let length = value.len().ok_or_else(|| fail("a list, bytes or a text"))?;
                    if !last {
                        let path = upto(path, at + 1);
                        return Err(PathError::Kind {
                            got: "a length",
                            expected: "the end of the path",
                            path,
                        });
                    }
                    return Ok(Cow::Owned(Value::Uint(length as u64)));
                }
                (Segment::Field(_), _) => return Err(fail("a message")),
                (Segment::Index(_), _) => return Err(fail("a list or bytes")),
            }
        }
        Ok(Cow::Borrowed(value))
    }

    /// Every leaf with its path, depth first. Bytes and packed numbers are one leaf each.
    pub fn leaves(&self) -> impl Iterator<Item = (FieldPath, &Value)> {
        let mut stack = vec![(FieldPath::root(), self)];
        std::iter::from_fn(move || {
            loop {
                let (path, value) = stack.pop()?;
                match value {
                    Value::Message(fields) => {
                        stack.extend(fields.iter().rev().map(|(name, value)| (path.field(name), value)));
                    }
                    Value::List(list) => {
                        stack.extend(list.iter().enumerate().rev().map(|(i, value)| (path.index(i), value)));
                    }
                    leaf => return Some((path, leaf)),
                }
            }
        })
    }

    /// The kind in words, for messages to a user.
    pub fn kind(&self) -> &'static str {
        match self {
            Value::Null => "nothing",
            Value::Bool(_) => "a boolean",
            Value::Int(_) | Value::Uint(_) => "an integer",
            Value::Float(_) => "a number",
            Value::Text(_) => "a text",
            Value::Bytes(_) => "bytes",
            Value::Enum { .. } => "a choice",
            Value::List(_) => "a list",
            Value::Packed(_) => "a list of numbers",
            Value::Message(_) => "a message",
        }
    }

    /// The value as a number: booleans are 0 or 1, enum values their number.
    pub fn as_f64(&self) -> Option<f64> {
        match self {
            Value::Bool(v) => Some(f64::from(u8::from(*v))),
            Value::Int(v) => Some(*v as f64),
            Value::Uint(v) => Some(*v as f64),
            Value::Float(v) => Some(*v),
            Value::Enum { number, .. } => Some(f64::from(*number)),
            _ => None,
        }
    }

    /// The value as a text.
    pub fn as_text(&self) -> Option<&str> {
        match self {
            Value::Text(text) => Some(text),
            Value::Enum { name, .. } => Some(name),
            _ => None,
        }
    }

    /// The value as an integer; `None` for a number with a fraction or out of range.
    pub fn as_i64(&self) -> Option<i64> {
        match self {
            Value::Int(v) => Some(*v),
            Value::Uint(v) => i64::try_from(*v).ok(),
            Value::Enum { number, .. } => Some(i64::from(*number)),
            Value::Float(v) => whole(*v),
            _ => None,
        }
    }

    /// The field of that name.
    pub fn field(&self, name: &str) -> Option<&Value> {
        match self {
            Value::Message(fields) => field(fields, name),
            _ => None,
        }
    }

    /// The fields of a message.
    pub fn fields(&self) -> &[(String, Value)] {
        match self {
            Value::Message(fields) => fields,
            _ => &[],
        }
    }

    /// The number of elements of a list, or of bytes of a bytes value or a text; `None` for other kinds.
    #[expect(clippy::len_without_is_empty, reason = "most values have no length")]
    pub fn len(&self) -> Option<usize> {
        match self {
            Value::List(list) => Some(list.len()),
            Value::Bytes(bytes) => Some(bytes.len()),
            Value::Packed(packed) => Some(packed.len()),
            Value::Text(text) => Some(text.len()),
            _ => None,
        }
    }

    /// The element of a list, of packed numbers, or of bytes.
    pub fn item(&self, index: usize) -> Option<Cow<'_, Value>> {
        match self {
            Value::List(list) => list.get(index).map(Cow::Borrowed),
            Value::Packed(packed) => packed.get(index).map(|number| Cow::Owned(number.into())),
            Value::Bytes(bytes) => bytes.get(index).map(|byte| Cow::Owned(Value::Uint(u64::from(*byte)))),
            _ => None,
        }
    }

    /// The time that a message of seconds and nanoseconds holds (protobuf's, that of ROS, or Foxglove's in JSON).
    pub fn as_stamp(&self) -> Option<Stamp> {
        let part = |names: &[&str]| names.iter().find_map(|name| self.field(name))?.as_i64();
        let timestamp = prost_types::Timestamp {
            seconds: part(&["seconds", "sec", "secs"])?,
            nanos: i32::try_from(part(&["nanos", "nanosec", "nsec", "nsecs"])?).ok()?,
        };
        Stamp::from_proto(&timestamp)
    }
}

fn field<'a>(fields: &'a [(String, Value)], name: &str) -> Option<&'a Value> {
    fields.iter().rev().find(|(field, _)| field == name).map(|(_, value)| value)
}

/// The first `count` steps of a path.
pub(crate) fn upto(path: &FieldPath, count: usize) -> FieldPath {
    path.segments()[..count].to_vec().into()
}

pub(crate) fn no_field(fields: &[(String, Value)], name: &str, path: &FieldPath, at: usize) -> PathError {
    // A JSON object can have any number of fields; the error text lists only some.
    let mut expected = fields.iter().take(40).map(|(name, _)| name.as_str()).collect::<Vec<_>>().join(", ");
    if fields.len() > 40 {
        expected.push_str(", …");
    }
    PathError::NoField { name: name.to_owned(), expected, path: upto(path, at + 1) }
}

pub(crate) fn out_of_range(length: usize, index: usize, path: &FieldPath, at: usize) -> PathError {
    PathError::OutOfRange { index, length, path: upto(path, at + 1) }
}

fn whole(number: f64) -> Option<i64> {
    let fits = number.fract() == 0.0 && (-9.2e18..9.2e18).contains(&number);
    fits.then_some(number as i64)
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    pub(crate) fn sample() -> Value {
        let message = |fields: &[(&str, Value)]| {
            Value::Message(fields.iter().map(|(name, value)| ((*name).to_owned(), value.clone())).collect())
        };
        let cell = |cost| message(&[("cost", Value::Uint(cost))]);
        message(&[
            ("pose", message(&[("x", Value::Float(1.5)), ("label", Value::Text("a".into()))])),
            ("cells", Value::List(vec![cell(7), cell(9)])),
            ("data", Value::Bytes(Bytes::from_static(&[1, 2, 3]))),
            ("level", Value::Enum { number: 2, name: "INFO".into() }),
            ("absent", Value::Null),
        ])
    }

    fn check(path: &str, expect: Result<Value, &str>) {
        let value = sample();
        let got = value.get(&path.parse().expect(path));
        match expect {
            Ok(expect) => assert_eq!(*got.expect(path), expect, "{path}"),
            Err(expect) => assert_eq!(got.expect_err(path).to_string(), expect, "{path}"),
        }
    }

    #[test]
    fn a_path_names_a_field_an_element_or_a_length() {
        check(".pose.x", Ok(Value::Float(1.5)));
        check(".cells[1].cost", Ok(Value::Uint(9)));
        check(".cells.@length", Ok(Value::Uint(2)));
        check(".data[2]", Ok(Value::Uint(3)));
        check(".data.@length", Ok(Value::Uint(3)));
        check(".absent.anything[3]", Ok(Value::Null));
        check("", Ok(sample()));
    }

    #[test]
    fn a_path_that_leads_nowhere_says_what_is_there() {
        check(".pose.y", Err("no field \"y\" here, expected one of x, label: .pose.y"));
        check(".cells[2].cost", Err("index 2 is out of range, got 2 elements: .cells[2]"));
        check(".data[3]", Err("index 3 is out of range, got 3 elements: .data[3]"));
        check(".pose[0]", Err("got a message, expected a list or bytes: .pose"));
        check(".pose.x.y", Err("got a number, expected a message: .pose.x"));
        check(".pose.x.@length", Err("got a number, expected a list, bytes or a text: .pose.x"));
        check(".data[0].x", Err("got an integer, expected a message or a list: .data[0]"));
    }

    #[test]
    fn each_leaf_is_what_its_path_names() {
        let value = sample();
        let leaves: Vec<_> = value.leaves().collect();
        let paths: Vec<_> = leaves.iter().map(|(path, _)| path.to_string()).collect();
        assert_eq!(
            paths,
            [".pose.x", ".pose.label", ".cells[0].cost", ".cells[1].cost", ".data", ".level", ".absent"]
        );
        for (path, leaf) in leaves {
            assert_eq!(*value.get(&path).expect("a leaf is there"), *leaf);
        }
    }
}
