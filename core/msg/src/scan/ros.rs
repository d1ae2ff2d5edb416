//! The scanner for messages of ROS: skips what lies before the field, reads it, and stops.

use super::{Fail, ScanError};
use crate::packed::Scalar;
use crate::path::{FieldPath, Segment};
use crate::reader::ros::{Cursor, RosError};
use crate::reader::rosmsg::{Count, Element, Field, Layout};
use std::sync::Arc;

#[derive(Clone, Debug)]
pub(super) struct Plan {
    layout: Arc<Layout>,
    steps: Vec<Step>,
    end: End,
}

/// Selects one field of a message, and one element of that field.
#[derive(Clone, Copy, Debug)]
struct Step {
    field: usize,
    index: usize,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum End {
    /// Reads the number at the last step.
    Number,
    /// Reads the length of the sequence or array at the last step.
    Count,
    /// Reads the length of the text at the last step.
    Text,
}

impl Plan {
    pub(super) fn new(layout: &Arc<Layout>, name: &str, path: &FieldPath) -> Result<Self, ScanError> {
        let fail = Fail(path);
        let mut steps = Vec::new();
        let mut fields = layout.root();
        let mut message = name;
        let mut rest = path.segments();
        loop {
            let Some((Segment::Field(wanted), after)) = rest.split_first() else {
                return Err(fail.kind("a message", "the name of a field"));
            };
            let Some(at) = fields.iter().position(|field| field.name == *wanted) else {
                return Err(fail.field(wanted, message, fields.iter().map(|field| field.name.as_str())));
            };
            let field: &Field = &fields[at];
            rest = after;
            message = &field.name;
            let mut index = 0;
            if field.count != Count::One {
                match rest.split_first() {
                    Some((Segment::Length, after)) => {
                        fail.ends(after, "a length")?;
                        steps.push(Step { field: at, index });
                        return Ok(Self { layout: Arc::clone(layout), steps, end: End::Count });
                    }
                    Some((Segment::Index(wanted), after)) => {
                        index = *wanted;
                        rest = after;
                    }
                    _ => return Err(fail.kind("a list", "an index or `@length`")),
                }
            }
            steps.push(Step { field: at, index });
            let end = match (field.element, rest) {
                (Element::Message(inner), [_, ..]) => {
                    fields = layout.message(inner);
                    continue;
                }
                (Element::Message(_), []) => return Err(fail.kind("a message", "a number")),
                (Element::Number(_), rest) => {
                    fail.ends(rest, "a number")?;
                    End::Number
                }
                (Element::Text, [Segment::Length]) => End::Text,
                (Element::Text | Element::WideText, _) => return Err(fail.kind("a text", "a number")),
            };
            return Ok(Self { layout: Arc::clone(layout), steps, end });
        }
    }

    pub(super) fn scan(&self, message: &[u8]) -> Result<Option<f64>, RosError> {
        let mut cursor = Cursor::new(message, self.layout.wire())?;
        let mut fields = self.layout.root();
        for (at, step) in self.steps.iter().enumerate() {
            for field in &fields[..step.field] {
                cursor.skip(&self.layout, field)?;
            }
            let field = &fields[step.field];
            let count = cursor.count(field)?;
            let last = at + 1 == self.steps.len();
            if last && self.end == End::Count {
                return Ok(Some(count as f64));
            }
            if step.index >= count {
                return Ok(None);
            }
            if let Element::Number(number) = field.element {
                let numbers = cursor.numbers(number, step.index + 1)?;
                let bytes = &numbers[step.index * number.size()..];
                return Ok(number.read(bytes, cursor.big_endian()).map(Scalar::as_f64));
            }
            for _ in 0..step.index {
                cursor.skip_element(&self.layout, field.element)?;
            }
            if let Element::Message(inner) = field.element {
                fields = self.layout.message(inner);
            } else {
                // The tree replaces invalid UTF-8, which may change the length of the text.
                let text = cursor.text()?;
                let length =
                    std::str::from_utf8(text).map_or_else(|_| String::from_utf8_lossy(text).len(), str::len);
                return Ok(Some(length as f64));
            }
        }
        Ok(None)
    }
}
