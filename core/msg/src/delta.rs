//! Messages that are stored as key frames and deltas.
//!
//! Most of a map is the same from one message to the next. A [`DeltaCodec`] stores a complete message from time to
//! time, on the channel of the messages and in their own type, so that any tool can read it. The messages between two
//! key frames are stored as deltas on a second channel. The codec belongs to the message type; the recorder and the
//! readers know only these traits. The hash of a run, too, looks only at what has changed: see [`Digester`].
//!
//! Other programs send changes, too, which are read in the same way: [`grid_decoder`](crate::grid_decoder).

use crate::any::AnyMessage;
use crate::schema::Schema;
use crate::time::Stamp;
use bytes::Bytes;
use std::sync::Arc;

/// Key of the metadata of a delta channel: its value is the topic of the key frames.
pub const DELTA_OF: &str = "rcs.delta_of";
/// Suffix of a delta topic, after the topic of the key frames.
pub const DELTA_SUFFIX: &str = "/delta";

/// Codec of one message type: stores its messages as key frames and deltas.
pub trait DeltaCodec: std::fmt::Debug + Send + Sync {
    /// Schema of the deltas; key frames have the schema of the messages.
    fn delta_schema(&self) -> Arc<Schema>;
    /// A new encoder for one channel.
    fn encoder(&self) -> Box<dyn DeltaEncoder>;
    /// A new decoder for one channel.
    fn decoder(&self) -> Box<dyn DeltaDecoder>;
    /// A new digester for one buffer.
    fn digester(&self) -> Box<dyn Digester>;
}

/// The form in which a message is stored.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Stored {
    /// A key frame: the message's own bytes.
    Whole,
    /// A delta: bytes of the codec's delta schema.
    Delta(Bytes),
}

/// Encodes the messages of one channel.
pub trait DeltaEncoder: Send {
    /// Encodes the next message, given its sequence number and log time.
    fn encode(&mut self, sequence: u32, log_time: Stamp, message: &AnyMessage) -> Stored;
    /// Tells the encoder that its last result was not stored: the next message must be a key frame.
    fn lost(&mut self);
}

/// Decodes the messages of one channel.
pub trait DeltaDecoder: Send {
    /// Accepts a key frame.
    fn take_whole(&mut self, sequence: u32, message: &AnyMessage);
    /// Accepts a delta; [`DeltaDecoder::message`] is then the message that it encodes. It is an error if the delta does
    /// not follow the last accepted message or does not decode. Where each delta needs the one before it, all are
    /// refused after one that does not decode, until the next key frame.
    fn take_delta(&mut self, sequence: u32, delta: &[u8]) -> Result<(), String>;
    /// The last message that was accepted, also where a delta after it was refused; `None` before the first, and after
    /// a key frame that does not decode.
    fn message(&self) -> Option<AnyMessage>;
    /// Returns to the state of a new decoder.
    fn forget(&mut self);
}

/// What identifies the content of a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Digest {
    /// A hash of the content.
    pub hash: u128,
    /// Size of the encoded message.
    pub bytes: usize,
}

/// Hashes the messages of one buffer without encoding them.
pub trait Digester: Send {
    /// The digest of a message. It follows from the content of the message alone; what has not changed since the message
    /// before is not hashed again. A message that comes back encoded, as from a snapshot, has the same digest. `None` for
    /// one that cannot be of the codec's own Rust type: its bytes identify it.
    fn digest(&mut self, message: &AnyMessage) -> Option<Digest>;
}
