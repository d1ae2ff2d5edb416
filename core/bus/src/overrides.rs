//! Overrides: values of an operator that replace what processes publish, and faults on demand.
//!
//! Unless a fault drops it, a message passes: an override that does not fit it is dropped, and
//! [`crate::Buffer::update_overrides`] reports which one and why.

use crate::faults::Fault;
use crate::sample::WriterId;
use crate::tree::{BoxError, from_tree};
use rcs_msg::{AnyMessage, FieldPath, Stamp, Value};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// How long an override lasts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum OverrideMode {
    /// Until it is released, or expires.
    Hold,
    /// For the next message only.
    Once,
}

/// The value of one field.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Scalar {
    /// A boolean.
    Bool(bool),
    /// An integer.
    Int(i64),
    /// An integer above the range of the other variant.
    Uint(u64),
    /// A number.
    Float(f64),
    /// A text, or the name of a choice.
    Text(String),
}

impl From<Scalar> for Value {
    fn from(scalar: Scalar) -> Self {
        match scalar {
            Scalar::Bool(on) => Value::Bool(on),
            Scalar::Int(number) => Value::Int(number),
            Scalar::Uint(number) => Value::Uint(number),
            Scalar::Float(number) => Value::Float(number),
            Scalar::Text(text) => Value::Text(text),
        }
    }
}

/// What replaces the output of a process.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(try_from = "ValueOnDisk", into = "ValueOnDisk")]
pub enum OverrideValue {
    /// One field.
    Field(FieldPath, Scalar),
    /// The complete message.
    Message(AnyMessage),
    /// Nothing: something goes wrong on purpose.
    Fault(Fault),
}

#[derive(Serialize, Deserialize)]
enum ValueOnDisk {
    Field(String, Scalar),
    Message(String, Vec<u8>),
    Fault(Fault),
}

impl From<OverrideValue> for ValueOnDisk {
    fn from(value: OverrideValue) -> Self {
        match value {
            OverrideValue::Field(path, value) => Self::Field(path.to_string(), value),
            OverrideValue::Message(message) => {
                Self::Message(message.schema().name().to_owned(), message.bytes().to_vec())
            }
            OverrideValue::Fault(fault) => Self::Fault(fault),
        }
    }
}

impl TryFrom<ValueOnDisk> for OverrideValue {
    type Error = String;

    fn try_from(value: ValueOnDisk) -> Result<Self, String> {
        Ok(match value {
            ValueOnDisk::Field(path, value) => {
                Self::Field(path.parse().map_err(|error| format!("{error}"))?, value)
            }
            ValueOnDisk::Message(schema, bytes) => {
                let known = rcs_msg::registry().schema(&schema);
                let message = known.and_then(|known| rcs_msg::canonical(known, &bytes.into()));
                Self::Message(message.and_then(Result::ok).ok_or_else(|| format!("no {schema}"))?)
            }
            ValueOnDisk::Fault(fault) => Self::Fault(fault),
        })
    }
}

/// The cycle of a process that an override waits for.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Due {
    /// The process.
    pub process: String,
    /// The cycle, counted as in its statuses.
    pub cycle: u64,
}

/// An override of one field of a buffer, or of its complete messages.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Override {
    /// Number by which it can be released, unique within a run.
    pub id: u64,
    /// Who set it.
    pub owner: Arc<str>,
    /// How long it lasts.
    pub mode: OverrideMode,
    /// The new value.
    pub value: OverrideValue,
    /// Time when it was set.
    pub since: Stamp,
    /// Time when it expires.
    pub until: Option<Stamp>,
    /// The cycle that it waits for; `None` if it is in force.
    pub due: Option<Due>,
}

impl Override {
    /// The field that is replaced; the root for the complete message.
    pub fn path(&self) -> FieldPath {
        match &self.value {
            OverrideValue::Field(path, _) => path.clone(),
            OverrideValue::Message(_) | OverrideValue::Fault(_) => FieldPath::root(),
        }
    }

    /// The fault; `None` if it replaces a value.
    pub fn fault(&self) -> Option<&Fault> {
        match &self.value {
            OverrideValue::Fault(fault) => Some(fault),
            _ => None,
        }
    }

    /// Whether it is of the same field, or the same fault.
    fn is_like(&self, other: &Self) -> bool {
        match (self.fault(), other.fault()) {
            (Some(a), Some(b)) => a.is_like(b),
            (None, None) => self.path() == other.path(),
            _ => false,
        }
    }

    pub(crate) fn applies(&self, now: Stamp) -> bool {
        self.due.is_none() && !self.is_over(now)
    }

    fn is_over(&self, now: Stamp) -> bool {
        self.until.is_some_and(|until| now >= until)
    }
}

/// Which overrides of a buffer to release.
#[derive(Clone, Debug, PartialEq)]
pub enum Release {
    /// The one with this number.
    Id(u64),
    /// Those of this field; the root for those of the complete message.
    Path(FieldPath),
    /// Faults of this kind for this target.
    Fault(Fault),
    /// All.
    All,
}

impl Release {
    /// Whether it releases that override.
    pub fn is_of(&self, active: &Override) -> bool {
        match self {
            Release::Id(id) => active.id == *id,
            Release::Path(path) => active.fault().is_none() && active.path() == *path,
            Release::Fault(fault) => active.fault().is_some_and(|known| known.is_like(fault)),
            Release::All => true,
        }
    }
}

/// Changes to the overrides of a buffer since the last update.
#[derive(Clone, Debug, Default)]
pub struct OverrideChanges {
    /// Those in force and those that wait, in the order in which they were set.
    pub active: Vec<Override>,
    /// Whether this list has changed since the last call.
    pub changed: bool,
    /// Those that did not fit a message and were dropped, and why.
    pub failed: Vec<(Override, String)>,
}

/// The overrides of one buffer, in the order in which they were set.
#[derive(Default)]
pub(crate) struct Active {
    list: Vec<Override>,
    changed: bool,
    failed: Vec<(Override, String)>,
}

impl Active {
    pub(crate) fn from_list(list: Vec<Override>) -> Self {
        Self { list, changed: false, failed: Vec::new() }
    }

    pub(crate) fn list(&self) -> &[Override] {
        &self.list
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.list.is_empty()
    }

    /// Sets an override. Unless it waits for a cycle, it replaces one of the same field that is in force.
    pub(crate) fn set(&mut self, new: Override) {
        if new.due.is_none() {
            self.list.retain(|active| active.due.is_some() || !active.is_like(&new));
        }
        self.list.push(new);
        self.changed = true;
    }

    /// Releases overrides and returns their number.
    pub(crate) fn release(&mut self, which: &Release) -> usize {
        let before = self.list.len();
        self.list.retain(|active| !which.is_of(active));
        let released = before - self.list.len();
        self.changed |= released > 0;
        released
    }

    /// Applies every override to a message, which comes after `newest`; `None` if a fault drops it. Faults do not apply
    /// to a message of the operator. Afterwards overrides that last for one message are gone, and those that do not fit
    /// are dropped.
    pub(crate) fn apply(
        &mut self,
        now: Stamp,
        writer: WriterId,
        message: AnyMessage,
        newest: Option<&AnyMessage>,
    ) -> Option<AnyMessage> {
        let mut kept = Vec::with_capacity(self.list.len());
        let mut message = Some(message);
        for mut active in std::mem::take(&mut self.list) {
            let exempt = writer == WriterId::OPERATOR && active.fault().is_some();
            let Some(was) = message.clone().filter(|_| active.applies(now) && !exempt) else {
                kept.push(active);
                continue;
            };
            let changed = match &mut active.value {
                OverrideValue::Message(whole) => Ok(Some(whole.clone())),
                OverrideValue::Field(path, value) => with_field(&was, path, value.clone().into()).map(Some),
                OverrideValue::Fault(fault) => fault.apply(was, newest),
            };
            match changed {
                Ok(changed) => {
                    message = changed;
                    if active.mode == OverrideMode::Hold {
                        kept.push(active);
                    } else {
                        self.changed = true;
                    }
                }
                Err(error) => {
                    self.changed = true;
                    self.failed.push((active, error.to_string()));
                }
            }
        }
        self.list = kept;
        message
    }

    /// Drops expired overrides, puts those in force whose cycle has come, and reports the changes since the last call.
    pub(crate) fn update(&mut self, now: Stamp, is_due: impl Fn(&Due) -> bool) -> OverrideChanges {
        let before = self.list.len();
        self.list.retain(|active| !active.is_over(now));
        self.changed |= self.list.len() != before;
        while let Some(at) = self.list.iter().position(|active| active.due.as_ref().is_some_and(&is_due)) {
            let due = self.list.remove(at);
            self.set(Override { due: None, ..due });
        }
        OverrideChanges {
            active: self.list.clone(),
            changed: std::mem::take(&mut self.changed),
            failed: std::mem::take(&mut self.failed),
        }
    }
}

/// The message with one field changed; a typed message stays typed.
fn with_field(message: &AnyMessage, path: &FieldPath, value: Value) -> Result<AnyMessage, BoxError> {
    let mut tree = message.value()?;
    tree.set(path, value)?;
    from_tree(&message.schema(), &tree)
}
