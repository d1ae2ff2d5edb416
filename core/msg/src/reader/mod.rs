//! Readers: from the bytes of a message to a [`Value`], by the schema of its channel.

pub(crate) mod cdr;
mod editions;
mod json;
pub(crate) mod protobuf;
pub(crate) mod rosmsg;

use crate::any::AnyMessage;
use crate::guard::guarded;
use crate::schema::{MessageEncoding, Schema, registry};
use crate::value::Value;
use bytes::Bytes;
use prost_reflect::{DescriptorPool, MessageDescriptor};
use rosmsg::Layout;

/// Why a message cannot be read.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DecodeError {
    /// No reader exists for this schema: its messages are listed, not shown.
    #[error("no reader for {schema} ({encoding}): {reason}")]
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
    /// ROS 2 CDR by its definition.
    Cdr(std::sync::Arc<Layout>),
    /// JSON, which needs no schema.
    Json,
}

impl Reader {
    /// Makes the reader, or says why there is none. It never panics, whatever the schema contains.
    pub(crate) fn new(schema: &Schema) -> Result<Self, DecodeError> {
        let fail = |reason: String| DecodeError::NoReader {
            schema: schema.name().to_owned(),
            encoding: schema.message_encoding().name().to_owned(),
            reason,
        };
        guarded(|| Self::of(schema, fail)).unwrap_or_else(|reason| Err(fail(reason)))
    }

    fn of(schema: &Schema, fail: impl Fn(String) -> DecodeError) -> Result<Self, DecodeError> {
        match schema.message_encoding() {
            MessageEncoding::Protobuf => descriptor(schema).map(Self::Protobuf).map_err(fail),
            MessageEncoding::Cdr if schema.schema_encoding() == "ros2msg" => {
                let text = std::str::from_utf8(schema.data())
                    .map_err(|_| fail("its definition is no text".into()))?;
                let layout = Layout::parse(schema.name(), text).map_err(|error| fail(error.to_string()))?;
                Ok(Self::Cdr(layout.into()))
            }
            MessageEncoding::Cdr => {
                let got = schema.schema_encoding();
                Err(fail(format!("its definition is in {got:?}, expected \"ros2msg\"")))
            }
            MessageEncoding::Json => Ok(Self::Json),
            MessageEncoding::Other(_) => Err(fail("expected protobuf, cdr or json".to_owned())),
        }
    }
}

/// The descriptor in a schema: the registered one if the schema is registered, so that no second pool is built.
fn descriptor(schema: &Schema) -> Result<MessageDescriptor, String> {
    if schema.schema_encoding() != "protobuf" {
        return Err(format!("its schema is in {:?}, expected \"protobuf\"", schema.schema_encoding()));
    }
    let ours = registry().schema(schema.name()).is_some_and(|ours| ours.data() == schema.data());
    if let Some(descriptor) = registry().descriptor(schema.name()).filter(|_| ours) {
        return Ok(descriptor);
    }
    let rewritten = editions::without_editions(schema.data())?;
    let data = rewritten.map_or_else(|| schema.data().clone(), Bytes::from);
    let pool = DescriptorPool::decode(data)
        .map_err(|error| format!("its descriptor set does not decode: {error}"))?;
    pool.get_message_by_name(schema.name()).ok_or_else(|| "its descriptor set does not define it".to_owned())
}

impl Schema {
    /// Whether messages of this schema can be read; the error says why not.
    pub fn decodable(&self) -> Result<(), DecodeError> {
        self.reader().map(|_| ())
    }

    /// The message as a tree. Large arrays share `bytes`.
    pub fn value(&self, bytes: &Bytes) -> Result<Value, DecodeError> {
        let reader = self.reader()?;
        let value = guarded(|| match reader {
            Reader::Protobuf(descriptor) => protobuf::decode(descriptor, bytes),
            Reader::Cdr(layout) => cdr::decode(layout, bytes).map_err(|error| error.to_string()),
            Reader::Json => json::decode(bytes),
        });
        value.and_then(|value| value).map_err(|reason| self.malformed(reason))
    }

    /// Encodes a tree. Fields that are absent or not named keep their defaults. Protobuf only.
    pub fn encode(&self, value: &Value) -> Result<Bytes, EncodeError> {
        match self.reader() {
            Ok(Reader::Protobuf(descriptor)) => protobuf::encode(descriptor, value),
            _ => Err(EncodeError::NoWriter {
                schema: self.name().to_owned(),
                encoding: self.message_encoding().name().to_owned(),
            }),
        }
    }

    /// The protobuf descriptor, if the messages are protobuf.
    pub fn descriptor(&self) -> Option<&MessageDescriptor> {
        match self.reader() {
            Ok(Reader::Protobuf(descriptor)) => Some(descriptor),
            _ => None,
        }
    }

    pub(crate) fn malformed(&self, reason: impl Into<String>) -> DecodeError {
        DecodeError::Malformed { schema: self.name().to_owned(), reason: reason.into() }
    }
}

impl AnyMessage {
    /// The message as a tree.
    pub fn value(&self) -> Result<Value, DecodeError> {
        self.schema().value(&self.bytes())
    }
}
