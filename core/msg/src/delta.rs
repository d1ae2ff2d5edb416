//! Messages that are stored or sent as key frames and what changed between them.
//!
//! Most of a map is the same from one message to the next. A [`DeltaCodec`] stores a whole message now and then, on the
//! channel of the messages, in their own type, so that any tool reads it; what lies between goes as deltas on a channel
//! beside it. The codec belongs to the type of the messages; recorder and readers know only these traits.

use crate::any::AnyMessage;
use crate::schema::Schema;
use crate::time::Stamp;
use bytes::Bytes;
use std::sync::Arc;

/// Channel metadata of a channel of deltas: the topic that holds the key frames.
pub const DELTA_OF: &str = "rcs.delta_of";
/// Name of the topic of deltas, after the topic of the key frames.
pub const DELTA_SUFFIX: &str = "/delta";

/// How the messages of one type are stored as key frames and deltas.
pub trait DeltaCodec: std::fmt::Debug + Send + Sync {
    /// Type of the deltas; that of the key frames is the messages' own.
    fn delta_schema(&self) -> Arc<Schema>;
    /// An encoder for one channel, before its first message.
    fn encoder(&self) -> Box<dyn DeltaEncoder>;
    /// A decoder for one channel, before its first message.
    fn decoder(&self) -> Box<dyn DeltaDecoder>;
}

/// In which form a message is stored.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Stored {
    /// As a key frame: the message's own bytes.
    Whole,
    /// As these bytes of the codec's delta schema.
    Delta(Bytes),
}

/// Turns the messages of a channel into what is stored of them.
pub trait DeltaEncoder: Send {
    /// In which form to store the next message of that sequence and log time.
    fn encode(&mut self, sequence: u32, log_time: Stamp, message: &AnyMessage) -> Stored;
    /// What was encoded last is not in the store: the next message must be whole.
    fn lost(&mut self);
}

/// Turns what is stored of a channel back into its messages.
pub trait DeltaDecoder: Send {
    /// Takes a key frame.
    fn take_whole(&mut self, sequence: u32, message: &AnyMessage);
    /// The message that a delta stands for. An error says why there is none: the delta does not follow what was taken
    /// last, or does not decode. After one that does not decode, deltas are refused until the next key frame.
    fn take_delta(&mut self, sequence: u32, delta: &[u8]) -> Result<AnyMessage, String>;
}
