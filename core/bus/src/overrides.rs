//! An operator's hand on a buffer, applied at the moment of publishing.

use rcs_msg::{AnyMessage, FieldPath, Value};

/// How long an override lasts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OverrideMode {
    /// Until it is released.
    Hold,
    /// For the next message.
    Once,
    /// Takes away the override of the same field (or of the whole message).
    Release,
}

/// What is put in place of what a process wrote.
#[derive(Clone, Debug)]
pub enum OverrideValue {
    /// One field.
    Field(FieldPath, Value),
    /// The whole message.
    Message(AnyMessage),
}

/// An operator's hand on one field of a buffer, or on all of it.
#[derive(Clone, Debug)]
pub struct Override {
    /// How long.
    pub mode: OverrideMode,
    /// What.
    pub value: OverrideValue,
}

impl Override {
    fn same_place(&self, other: &Self) -> bool {
        match (&self.value, &other.value) {
            (OverrideValue::Field(a, _), OverrideValue::Field(b, _)) => a == b,
            (OverrideValue::Message(_), OverrideValue::Message(_)) => true,
            _ => false,
        }
    }
}

/// The overrides in force on one buffer, in the order in which they were made.
#[derive(Default)]
pub(crate) struct Active(Vec<Override>);

impl Active {
    pub(crate) fn from_list(list: Vec<Override>) -> Self {
        Self(list)
    }

    pub(crate) fn list(&self) -> &[Override] {
        &self.0
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    pub(crate) fn set(&mut self, change: Override) {
        self.0.retain(|active| !active.same_place(&change));
        if !change.is_release() {
            self.0.push(change);
        }
    }

    /// The message with every override applied; those that last for one message are then gone.
    pub(crate) fn apply(&mut self, mut message: AnyMessage) -> Result<AnyMessage, BoxError> {
        for active in &self.0 {
            message = match &active.value {
                OverrideValue::Message(whole) => whole.clone(),
                OverrideValue::Field(path, value) => with_field(&message, path, value.clone())?,
            };
        }
        self.0.retain(|active| active.mode == OverrideMode::Hold);
        Ok(message)
    }
}

type BoxError = Box<dyn std::error::Error + Send + Sync>;

/// The message with one field changed, typed again where it was typed.
fn with_field(message: &AnyMessage, path: &FieldPath, value: Value) -> Result<AnyMessage, BoxError> {
    let schema = message.schema();
    let mut tree = message.value()?;
    tree.set(path, value)?;
    let bytes = schema.encode(&tree)?;
    Ok(match rcs_msg::canonical(&schema, &bytes) {
        Some(typed) => typed?,
        None => AnyMessage::encoded(schema, bytes),
    })
}
