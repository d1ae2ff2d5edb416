//! Edited fields of one buffer: the changes that were not written, and what was written and can be taken back.

use rcs_msg::AnyMessage;
use std::collections::BTreeMap;

/// Number of writes to a buffer that can be taken back. Each keeps two messages, and there are as many as a person has
/// made by hand.
const MOST_UNDO: usize = 50;

/// Something that was sent, and how it is taken back.
#[derive(Clone, Debug)]
pub(super) enum Sent {
    /// The message that was written, and the one that it replaced.
    Message { buffer: String, written: AnyMessage, before: AnyMessage },
    /// The fields that are overridden.
    Held { buffer: String, paths: Vec<String> },
}

/// The edited fields of a buffer.
#[derive(Clone, Debug, Default)]
pub(crate) struct Draft {
    /// The changes that were not written: path and text of each field.
    pub(super) fields: BTreeMap<String, String>,
    /// What can be taken back, oldest first.
    pub(super) sent: Vec<Sent>,
    /// Why the last request was refused.
    pub(super) refused: Option<String>,
}

impl Draft {
    /// Whether there is nothing to show and nothing to keep.
    pub(crate) fn is_empty(&self) -> bool {
        self.fields.is_empty() && self.sent.is_empty() && self.refused.is_none()
    }

    /// Whether a field is being edited.
    pub(crate) fn has(&self, path: &str) -> bool {
        self.fields.contains_key(path)
    }

    /// The changes were sent.
    pub(super) fn sent(&mut self, sent: Sent) {
        self.sent.push(sent);
        let surplus = self.sent.len().saturating_sub(MOST_UNDO);
        self.sent.drain(..surplus);
        self.fields.clear();
        self.refused = None;
    }

    /// Forgets what was sent: the run to which it was sent has ended. Changes that were not written stay.
    pub(crate) fn forget_sent(&mut self) {
        self.sent.clear();
        self.refused = None;
    }
}
