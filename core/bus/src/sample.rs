//! What a buffer holds: a message and its header.

use rcs_msg::{AnyMessage, Stamp};
use serde::{Deserialize, Serialize};

/// A writer of a run, by the order in which writers joined its [`crate::Bus`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct WriterId(pub u16);

impl WriterId {
    /// The operator: commands, edited fields, parameters.
    pub const OPERATOR: WriterId = WriterId(0);
    /// The runtime itself, and what it reads from a log.
    pub const RUNTIME: WriterId = WriterId(1);
}

/// What is known of a message beside its value.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Header {
    /// Counts the messages of the buffer from 1.
    pub sequence: u64,
    /// When it became visible. Orders messages.
    pub log_time: Stamp,
    /// When what it tells of was sensed. Fuses messages.
    pub acq_time: Stamp,
    /// Who wrote it.
    pub writer: WriterId,
}

/// A message in a buffer, shared without a copy.
#[derive(Clone, Debug)]
pub struct Sample {
    /// Sequence, times and writer.
    pub header: Header,
    /// The message.
    pub message: AnyMessage,
}

/// A message on its way into a buffer, which gives it its sequence.
#[derive(Clone, Debug)]
pub struct Draft {
    /// When it becomes visible.
    pub log_time: Stamp,
    /// When what it tells of was sensed.
    pub acq_time: Stamp,
    /// The message.
    pub message: AnyMessage,
}
