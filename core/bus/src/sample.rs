//! Content of a buffer: messages with headers.

use rcs_msg::{AnyMessage, Stamp};
use serde::{Deserialize, Serialize};

/// A writer of a run, numbered in the order in which writers join its [`crate::Bus`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct WriterId(pub u16);

impl WriterId {
    /// The operator: commands, edited fields, parameters.
    pub const OPERATOR: WriterId = WriterId(0);
    /// The runtime, including what it reads from a log.
    pub const RUNTIME: WriterId = WriterId(1);
}

/// The header of a message in a buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Header {
    /// Counts the messages of the buffer from 1.
    pub sequence: u64,
    /// When it became visible. Messages are ordered by this time.
    pub log_time: Stamp,
    /// When the content was acquired. Messages are fused by this time.
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

/// A message to be written; the buffer assigns its sequence.
#[derive(Clone, Debug)]
pub struct Draft {
    /// When it becomes visible.
    pub log_time: Stamp,
    /// When the content was acquired.
    pub acq_time: Stamp,
    /// The message.
    pub message: AnyMessage,
}
