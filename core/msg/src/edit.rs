//! Changes of a value in place.

use crate::packed::Scalar;
use crate::path::{FieldPath, Segment};
use crate::value::{PathError, Value, no_field, out_of_range, upto};

impl Value {
    /// Replaces the value at the path by `new`. A number is converted to the kind of the number that it replaces if it
    /// fits exactly (floats may round). Absent messages along the path are created with only the field that the path
    /// names.
    pub fn set(&mut self, path: &FieldPath, new: Value) -> Result<(), PathError> {
        let mut value = self;
        let segments = path.segments();
        for (at, segment) in segments.iter().enumerate() {
            let last = at + 1 == segments.len();
            match segment {
                Segment::Field(name) => {
                    if matches!(value, Value::Null) {
                        *value = nested(path, at, new)?;
                        return Ok(());
                    }
                    let got = value.kind();
                    let Value::Message(fields) = value else {
                        return Err(PathError::Kind { got, expected: "a message", path: upto(path, at) });
                    };
                    let Some(index) = fields.iter().rposition(|(field, _)| field == name) else {
                        return Err(no_field(fields, name, path, at));
                    };
                    value = &mut fields[index].1;
                }
                Segment::Index(index) => {
                    let (got, length) = (value.kind(), value.len().unwrap_or_default());
                    match value {
                        Value::List(list) => {
                            value =
                                list.get_mut(*index).ok_or_else(|| out_of_range(length, *index, path, at))?;
                        }
                        Value::Bytes(_) | Value::Packed(_) if *index >= length => {
                            return Err(out_of_range(length, *index, path, at));
                        }
                        Value::Bytes(_) | Value::Packed(_) if last => {
                            return set_number(value, *index, &new).map_err(|expected| PathError::Kind {
                                got: new.kind(),
                                expected,
                                path: path.clone(),
                            });
                        }
                        _ => {
                            return Err(PathError::Kind {
                                got,
                                expected: "a list or bytes",
                                path: upto(path, at),
                            });
                        }
                    }
                }
                Segment::Length => {
                    return Err(PathError::Kind {
                        got: "a length",
                        expected: "something to set",
                        path: path.clone(),
                    });
                }
            }
        }
        *value = fit(value, new).map_err(|(got, expected)| PathError::Kind {
            got,
            expected,
            path: path.clone(),
        })?;
        Ok(())
    }
}

/// Messages with one field each, for the rest of a path below an absent value.
fn nested(path: &FieldPath, at: usize, new: Value) -> Result<Value, PathError> {
    path.segments()[at..].iter().rev().try_fold(new, |inner, segment| match segment {
        Segment::Field(name) => Ok(Value::Message(vec![(name.clone(), inner)])),
        _ => Err(PathError::Kind { got: "nothing", expected: "a list or bytes", path: path.clone() }),
    })
}

/// Changes one number within bytes or packed numbers; the caller has checked the index.
fn set_number(value: &mut Value, index: usize, new: &Value) -> Result<(), &'static str> {
    match value {
        Value::Bytes(bytes) => {
            let byte = new.as_i64().and_then(|v| u8::try_from(v).ok()).ok_or("an integer from 0 to 255")?;
            let mut copy = bytes.to_vec();
            copy[index] = byte;
            *bytes = copy.into();
            Ok(())
        }
        Value::Packed(packed) => {
            let fits = scalar(new).is_some_and(|number| packed.set(index, number));
            if fits { Ok(()) } else { Err("a number that fits the array's type") }
        }
        _ => Ok(()),
    }
}

/// The value as an element of packed numbers.
fn scalar(value: &Value) -> Option<Scalar> {
    Some(match *value {
        Value::Bool(v) => Scalar::Bool(v),
        Value::Int(v) => Scalar::Int(v),
        Value::Uint(v) => Scalar::Uint(v),
        Value::Float(v) => Scalar::Float(v),
        // Arrays of floating-point numbers accept it as a number; all others refuse it.
        Value::Enum { number, .. } => Scalar::Float(number.into()),
        _ => return None,
    })
}

/// Converts `new` to the kind of `old`; if it does not fit, the kinds found and expected.
fn fit(old: &Value, new: Value) -> Result<Value, (&'static str, &'static str)> {
    let got = new.kind();
    let fitted = match (old, new) {
        // An absent value takes any kind. A text may replace an enum value; the encoder looks up its name.
        (Value::Null, new)
        | (_, new @ Value::Null)
        | (Value::Enum { .. }, new @ (Value::Enum { .. } | Value::Text(_)))
        | (Value::List(_) | Value::Packed(_), new @ (Value::List(_) | Value::Packed(_))) => Some(new),
        (Value::Float(_), new @ (Value::Int(_) | Value::Uint(_))) => new.as_f64().map(Value::Float),
        (Value::Int(_), new @ (Value::Uint(_) | Value::Float(_))) => new.as_i64().map(Value::Int),
        (Value::Uint(_), new @ (Value::Int(_) | Value::Float(_))) => {
            new.as_i64().and_then(|v| u64::try_from(v).ok()).map(Value::Uint)
        }
        (Value::Enum { .. }, new @ (Value::Int(_) | Value::Uint(_))) => new
            .as_i64()
            .and_then(|v| i32::try_from(v).ok())
            .map(|number| Value::Enum { number, name: String::new() }),
        (old, new) => (std::mem::discriminant(old) == std::mem::discriminant(&new)).then_some(new),
    };
    let expected = match old {
        Value::Int(_) => "an integer",
        Value::Uint(_) => "an integer of at least 0",
        old => old.kind(),
    };
    fitted.ok_or((got, expected))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::value::tests::sample;

    #[test]
    fn what_is_set_is_what_is_got() {
        let cases = [
            (".pose.x", Value::Int(4), Value::Float(4.0)),
            (".cells[0].cost", Value::Float(8.0), Value::Uint(8)),
            (".data[1]", Value::Int(200), Value::Uint(200)),
            (".level", Value::Uint(3), Value::Enum { number: 3, name: String::new() }),
            (".absent.x.y", Value::Float(1.0), Value::Float(1.0)),
            (".pose.label", Value::Text("b".into()), Value::Text("b".into())),
        ];
        for (path, new, expect) in cases {
            let path: FieldPath = path.parse().expect("a path");
            let mut value = sample();
            value.set(&path, new).expect("it can be set");
            assert_eq!(*value.get(&path).expect("it is there"), expect);
        }
    }

    #[test]
    fn a_value_of_another_kind_is_refused_and_changes_nothing() {
        let cases = [
            (".pose.x", Value::Text("a".into())),
            (".cells[0].cost", Value::Float(0.5)),
            (".cells[0].cost", Value::Int(-1)),
            (".data[0]", Value::Int(256)),
            (".cells.@length", Value::Uint(1)),
            (".pose.nothing", Value::Uint(1)),
            (".cells[5]", Value::Uint(1)),
            (".absent.x[0]", Value::Uint(1)),
        ];
        for (path, new) in cases {
            let mut value = sample();
            value.set(&path.parse().expect("a path"), new).expect_err(path);
            assert_eq!(value, sample(), "{path}");
        }
    }
}
