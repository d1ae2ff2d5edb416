//! Definitions of message types, as stored in logs.

use bytes::Bytes;

/// Encoding of the bytes of a message.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum MessageEncoding {
    /// Protocol buffers.
    Protobuf,
    /// ROS 2's Common Data Representation.
    Cdr,
    /// ROS 1's serialization.
    Ros1,
    /// JSON text.
    Json,
    /// Any other encoding, by its name in the log: its messages are listed and shown as undecodable.
    Other(String),
}

impl MessageEncoding {
    /// Name of this encoding in MCAP's registry.
    pub fn name(&self) -> &str {
        match self {
            Self::Protobuf => "protobuf",
            Self::Cdr => "cdr",
            Self::Ros1 => "ros1",
            Self::Json => "json",
            Self::Other(name) => name,
        }
    }

    /// The encoding with this name.
    pub fn from_name(name: &str) -> Self {
        match name {
            "protobuf" => Self::Protobuf,
            "cdr" => Self::Cdr,
            "ros1" => Self::Ros1,
            "json" => Self::Json,
            other => Self::Other(other.to_owned()),
        }
    }
}

/// The definition of a message type: the content of a [`Schema`](crate::Schema), from which a reader is made.
#[derive(Debug)]
pub(crate) struct Definition {
    /// Full name: `foxglove.Grid`, `sensor_msgs/msg/Image`.
    pub(crate) name: String,
    pub(crate) message_encoding: MessageEncoding,
    /// Encoding of `data`.
    pub(crate) schema_encoding: String,
    /// A file descriptor set, a ROS message definition, a JSON schema.
    pub(crate) data: Bytes,
}
