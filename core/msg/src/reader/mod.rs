//! Readers: from the bytes of a message to a [`Value`], by the schema of its channel.

mod editions;
mod json;
pub(crate) mod protobuf;
pub(crate) mod ros;
pub(crate) mod rosmsg;

use crate::definition::{Definition, MessageEncoding};
use crate::descriptors;
use crate::guard::guarded;
use crate::value::Value;
use bytes::Bytes;
use prost_reflect::{DescriptorPool, MessageDescriptor};
use rosmsg::{Layout, Wire};
use std::sync::Arc;

/// Why a message cannot be read.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DecodeError {
    /// No reader exists for this schema: its messages are listed, not shown.
    #[error(
        "no reader for {} ({}): {reason}",
        stated(.schema, "a message without a schema"),
        stated(.encoding, "encoding not stated")
    )]
    NoReader {
        /// Name of the schema.
        schema: String,
        /// Encoding of its messages.
        encoding: String,
        /// Why there is none.
        reason: String,
    },
    /// The bytes are not a message of this schema.
    #[error("{schema} does not decode: {reason}")]
    Malformed {
        /// Name of the schema.
        schema: String,
        /// The error and its position.
        reason: String,
    },
}

/// Why a value cannot be written as a message.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum EncodeError {
    /// Only protobuf can be written.
    #[error("cannot write {encoding}, expected protobuf: {schema}")]
    NoWriter {
        /// Name of the schema.
        schema: String,
        /// Encoding of its messages.
        encoding: String,
    },
    /// A field cannot hold the value.
    #[error("got {got}, expected {expected}: {path}")]
    Field {
        /// The kind of the value.
        got: String,
        /// The kind of the field.
        expected: String,
        /// The path of the field.
        path: crate::path::FieldPath,
    },
}

/// The reader for the messages of one schema.
#[derive(Clone, Debug)]
pub(crate) enum Reader {
    /// Protobuf by its descriptor.
    Protobuf(MessageDescriptor),
    /// ROS 1 and ROS 2 by their definitions.
    Ros(Arc<Layout>),
    /// JSON, which needs no schema.
    Json,
}

impl Reader {
    /// Makes the reader, or says why there is none. It never panics, whatever the schema contains.
    pub(crate) fn new(schema: &Definition) -> Result<Self, DecodeError> {
        let fail = |reason: String| DecodeError::NoReader {
            schema: schema.name.clone(),
            encoding: schema.message_encoding.name().to_owned(),
            reason,
        };
        guarded(|| Self::of(schema, fail)).unwrap_or_else(|reason| Err(fail(reason)))
    }

    fn of(schema: &Definition, fail: impl Fn(String) -> DecodeError) -> Result<Self, DecodeError> {
        match &schema.message_encoding {
            MessageEncoding::Protobuf => descriptor(schema).map(Self::Protobuf).map_err(fail),
            MessageEncoding::Cdr => layout(schema, Wire::Cdr, "ros2msg").map(Self::Ros).map_err(fail),
            MessageEncoding::Ros1 => layout(schema, Wire::Ros1, "ros1msg").map(Self::Ros).map_err(fail),
            MessageEncoding::Json => Ok(Self::Json),
            MessageEncoding::Other(_) => Err(fail("expected protobuf, cdr, ros1 or json".to_owned())),
        }
    }

    /// A message as a tree; an error says why it does not decode. It never panics, whatever the message contains.
    pub(crate) fn read(&self, bytes: &Bytes) -> Result<Value, String> {
        guarded(|| match self {
            Self::Protobuf(descriptor) => protobuf::decode(descriptor, bytes),
            Self::Ros(layout) => ros::decode(layout, bytes).map_err(|error| error.to_string()),
            Self::Json => json::decode(bytes),
        })
        .and_then(|value| value)
    }
}

/// Refuses a definition in another language.
fn expect_language(schema: &Definition, expected: &str) -> Result<(), String> {
    match schema.schema_encoding.as_str() {
        got if got == expected => Ok(()),
        "" if schema.data.is_empty() => Err("its definition was not recorded".to_owned()),
        got => Err(format!("its definition is in {got:?}, expected {expected:?}")),
    }
}

/// The layout in a schema of ROS.
fn layout(schema: &Definition, wire: Wire, expected: &str) -> Result<Arc<Layout>, String> {
    expect_language(schema, expected)?;
    let text = std::str::from_utf8(&schema.data).map_err(|_| "its definition is no text".to_owned())?;
    Layout::parse(&schema.name, text, wire).map(Arc::new).map_err(|error| error.to_string())
}

/// The descriptor in a schema: the registered one if the schema is registered, so that no second pool is built.
fn descriptor(schema: &Definition) -> Result<MessageDescriptor, String> {
    expect_language(schema, "protobuf")?;
    if let Some(descriptor) = descriptors::registered(&schema.name, &schema.data) {
        return Ok(descriptor);
    }
    let rewritten = editions::without_editions(&schema.data)?;
    let data = rewritten.map_or_else(|| schema.data.clone(), Bytes::from);
    let pool = DescriptorPool::decode(data)
        .map_err(|error| format!("its descriptor set does not decode: {error}"))?;
    pool.get_message_by_name(&schema.name).ok_or_else(|| "its descriptor set does not define it".to_owned())
}

/// A text; another one where it is empty.
fn stated<'a>(text: &'a str, otherwise: &'a str) -> &'a str {
    if text.is_empty() { otherwise } else { text }
}
