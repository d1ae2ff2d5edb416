//! The scanner for protobuf's wire format.
//!
//! A message is scanned in one pass over its tags. Fields beside the path are skipped by their wire type. Fields on the
//! path follow protobuf's rules: the last of several scalars counts, several occurrences of a submessage are merged,
//! repeated fields continue over several occurrences (packed or not), and a later member of a oneof replaces an earlier
//! one.

use super::wire::{DELIMITED, END_GROUP, START_GROUP, Scalar, Wire, WireError};
use super::{Fail, ScanError};
use crate::path::{FieldPath, Segment};
use prost_reflect::{FieldDescriptor, Kind, MessageDescriptor, Value as Reflected};

/// Longer paths are evaluated on the tree.
const MAX_STEPS: usize = 16;

#[derive(Clone, Debug)]
pub(super) struct Plan {
    steps: Vec<Step>,
}

/// Selects one field of a message.
#[derive(Clone, Debug)]
struct Step {
    number: u32,
    /// Other members of the field's oneof; an occurrence of one of them unsets this field.
    rivals: Vec<u32>,
    /// The element of a repeated field.
    index: Option<usize>,
    kind: StepKind,
}

#[derive(Clone, Debug)]
enum StepKind {
    /// A submessage, in which the next step continues.
    Message,
    /// A number, and its value if it is absent.
    Number(Scalar, Option<f64>),
    /// An element of bytes.
    Byte(usize),
    /// The length of bytes or of a text, and its value if they are absent.
    Length(Option<f64>),
    /// The length of a repeated field; the wire type of packed elements, `None` if they cannot be packed.
    Count(Option<Scalar>),
}

/// State of a scan.
struct State {
    /// For each step, the number of elements of its repeated field so far, or 1 for a submessage that is present.
    seen: [usize; MAX_STEPS],
    found: Found,
}

/// Result at the last step.
#[derive(Clone, Copy)]
enum Found {
    /// The field has not occurred.
    Nothing,
    /// The number of its last occurrence; `None` if the index is out of range there.
    Last(Option<f64>),
}

impl Found {
    fn or(self, absent: Option<f64>) -> Option<f64> {
        match self {
            Self::Nothing => absent,
            Self::Last(number) => number,
        }
    }
}

impl Plan {
    /// `None` if the path must be evaluated on the tree.
    pub(super) fn new(descriptor: &MessageDescriptor, path: &FieldPath) -> Result<Option<Self>, ScanError> {
        let fail = Fail(path);
        let mut message = descriptor.clone();
        let mut steps = Vec::new();
        let mut rest = path.segments();
        loop {
            let Some((Segment::Field(name), after)) = rest.split_first() else {
                return Err(fail.kind("a message", "the name of a field"));
            };
            let Some(field) = message.get_field_by_name(name) else {
                let names: Vec<String> = message.fields().map(|field| field.name().to_owned()).collect();
                return Err(fail.field(name, message.full_name(), names.iter().map(String::as_str)));
            };
            rest = after;
            if field.is_map() || steps.len() == MAX_STEPS {
                return Ok(None);
            }
            let scalar = Scalar::of(&field.kind());
            let mut step =
                Step { number: field.number(), rivals: rivals(&field), index: None, kind: StepKind::Message };
            if field.is_list() {
                match rest.split_first() {
                    Some((Segment::Length, after)) => {
                        fail.ends(after, "a length")?;
                        step.kind = StepKind::Count(scalar);
                        steps.push(step);
                        return Ok(Some(Self { steps }));
                    }
                    Some((Segment::Index(index), after)) => {
                        step.index = Some(*index);
                        rest = after;
                    }
                    _ => return Err(fail.kind("a list", "an index or `@length`")),
                }
            }
            let absent = if field.supports_presence() { None } else { Some(field.default_value()) };
            let length = absent.as_ref().map(|value| match value {
                Reflected::Bytes(bytes) => bytes.len() as f64,
                Reflected::String(text) => text.len() as f64,
                _ => 0.0,
            });
            step.kind = match (field.kind(), rest) {
                (Kind::Message(inner), [_, ..]) => {
                    message = inner;
                    steps.push(step);
                    continue;
                }
                (Kind::Message(_), []) => return Err(fail.kind("a message", "a number")),
                (Kind::Bytes | Kind::String, [Segment::Length]) => StepKind::Length(length),
                (Kind::Bytes, [Segment::Index(index)]) => StepKind::Byte(*index),
                (Kind::Bytes, [Segment::Index(_), _, ..]) => {
                    return Err(fail.kind("a byte", "the end of the path"));
                }
                (Kind::Bytes, _) => return Err(fail.kind("bytes", "an index or `@length`")),
                (Kind::String, _) => return Err(fail.kind("a text", "a number")),
                (_, rest) => {
                    fail.ends(rest, "a number")?;
                    let Some(scalar) = scalar else { return Ok(None) };
                    StepKind::Number(scalar, absent.as_ref().and_then(number))
                }
            };
            steps.push(step);
            return Ok(Some(Self { steps }));
        }
    }

    pub(super) fn scan(&self, message: &[u8]) -> Result<Option<f64>, WireError> {
        let mut state = State { seen: [0; MAX_STEPS], found: Found::Nothing };
        let mut wire = Wire { bytes: message };
        self.message(0, &mut wire, None, &mut state)?;
        for (at, step) in self.steps.iter().enumerate() {
            let count = state.seen[at];
            match step.kind {
                StepKind::Message if count <= step.index.unwrap_or(0) => return Ok(None),
                StepKind::Message => {}
                StepKind::Count(_) => return Ok(Some(count as f64)),
                StepKind::Number(_, absent) | StepKind::Length(absent) if step.index.is_none() => {
                    return Ok(state.found.or(absent));
                }
                _ => return Ok(state.found.or(None)),
            }
        }
        Ok(None)
    }

    /// Scans one message, or a group up to its end tag.
    fn message(
        &self,
        at: usize,
        wire: &mut Wire<'_>,
        group: Option<u32>,
        state: &mut State,
    ) -> Result<(), WireError> {
        let step = &self.steps[at];
        while !wire.bytes.is_empty() {
            let (field, wire_type) = wire.tag()?;
            if wire_type == END_GROUP {
                return if group == Some(field) { Ok(()) } else { Err(WireError::Group) };
            }
            if field == step.number {
                self.field(at, wire, wire_type, state)?;
                continue;
            }
            if !step.rivals.is_empty() && step.rivals.contains(&field) {
                state.seen[at..].fill(0);
                state.found = Found::Nothing;
            }
            wire.skip(field, wire_type)?;
        }
        if group.is_some() { Err(WireError::Truncated) } else { Ok(()) }
    }

    /// Handles one occurrence of the field of a step.
    fn field(
        &self,
        at: usize,
        wire: &mut Wire<'_>,
        wire_type: u8,
        state: &mut State,
    ) -> Result<(), WireError> {
        let step = &self.steps[at];
        let wrong = WireError::WireType { field: step.number, wire_type };
        let ordinal = state.seen[at];
        match step.kind {
            StepKind::Message => {
                let wanted = step.index.is_none_or(|index| index == ordinal);
                state.seen[at] = if step.index.is_some() { ordinal + 1 } else { 1 };
                match wire_type {
                    _ if !wanted => wire.skip(step.number, wire_type),
                    DELIMITED => self.message(at + 1, &mut Wire { bytes: wire.delimited()? }, None, state),
                    START_GROUP => self.message(at + 1, wire, Some(step.number), state),
                    _ => Err(wrong),
                }
            }
            StepKind::Number(scalar, _) if wire_type == DELIMITED => {
                let index = step.index.ok_or(wrong)?;
                let packed = wire.delimited()?;
                let count = scalar.count(packed)?;
                if let Some(inner) = index.checked_sub(ordinal).filter(|inner| *inner < count) {
                    state.found = Found::Last(Some(scalar.nth(packed, inner)?));
                }
                state.seen[at] = ordinal + count;
                Ok(())
            }
            StepKind::Number(scalar, _) => {
                if wire_type != scalar.wire_type() {
                    return Err(wrong);
                }
                let number = scalar.read(wire)?;
                if step.index.is_none_or(|index| index == ordinal) {
                    state.found = Found::Last(Some(number));
                }
                state.seen[at] = ordinal + 1;
                Ok(())
            }
            StepKind::Byte(_) | StepKind::Length(_) => {
                if wire_type != DELIMITED {
                    return Err(wrong);
                }
                let bytes = wire.delimited()?;
                if step.index.is_none_or(|index| index == ordinal) {
                    state.found = Found::Last(match step.kind {
                        StepKind::Byte(index) => bytes.get(index).copied().map(f64::from),
                        _ => Some(bytes.len() as f64),
                    });
                }
                state.seen[at] = ordinal + 1;
                Ok(())
            }
            StepKind::Count(scalar) => {
                state.seen[at] = ordinal
                    + match scalar {
                        Some(scalar) if wire_type == DELIMITED => scalar.count(wire.delimited()?)?,
                        _ => {
                            wire.skip(step.number, wire_type)?;
                            1
                        }
                    };
                Ok(())
            }
        }
    }
}

fn rivals(field: &FieldDescriptor) -> Vec<u32> {
    let Some(oneof) = field.containing_oneof() else { return Vec::new() };
    oneof.fields().map(|rival| rival.number()).filter(|number| *number != field.number()).collect()
}

fn number(value: &Reflected) -> Option<f64> {
    Some(match *value {
        Reflected::Bool(v) => f64::from(u8::from(v)),
        Reflected::I32(v) | Reflected::EnumNumber(v) => f64::from(v),
        Reflected::U32(v) => f64::from(v),
        Reflected::I64(v) => v as f64,
        Reflected::U64(v) => v as f64,
        Reflected::F32(v) => f64::from(v),
        Reflected::F64(v) => v,
        _ => return None,
    })
}
