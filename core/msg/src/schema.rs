//! Schemas: descriptions of the bytes of a message.

use crate::definition::{Definition, MessageEncoding};
use crate::path::{FieldPath, Segment};
use crate::reader::protobuf::encode;
use crate::reader::{DecodeError, EncodeError, Reader};
use crate::value::Value;
use bytes::Bytes;
use prost_reflect::{Kind, MessageDescriptor};
use std::sync::OnceLock;

/// The type of a message: its name, its encoding, and the text or descriptor that defines it.
#[derive(Debug)]
pub struct Schema {
    definition: Definition,
    /// Made from the data at the first message.
    reader: OnceLock<Result<Reader, DecodeError>>,
}

impl Schema {
    /// A schema from a log or a link. `schema_encoding` is MCAP's: `protobuf`, `ros2msg`, `jsonschema`, ….
    pub fn new(
        name: impl Into<String>,
        message_encoding: MessageEncoding,
        schema_encoding: impl Into<String>,
        data: Bytes,
    ) -> Self {
        let (name, schema_encoding) = (name.into(), schema_encoding.into());
        let definition = Definition { name, message_encoding, schema_encoding, data };
        Self { definition, reader: OnceLock::new() }
    }

    /// The schema of protobuf messages with this descriptor; `data` is the file descriptor set that defines it.
    pub(crate) fn of_descriptor(descriptor: MessageDescriptor, data: Bytes) -> Self {
        let schema = Self::new(descriptor.full_name(), MessageEncoding::Protobuf, "protobuf", data);
        Self { reader: OnceLock::from(Ok(Reader::Protobuf(descriptor))), ..schema }
    }

    /// The reader for messages of this schema.
    pub(crate) fn reader(&self) -> Result<&Reader, DecodeError> {
        self.reader.get_or_init(|| Reader::new(&self.definition)).as_ref().map_err(Clone::clone)
    }

    /// Full name: `foxglove.Grid`, `sensor_msgs/msg/Image`.
    pub fn name(&self) -> &str {
        &self.definition.name
    }

    /// Encoding of the messages.
    pub fn message_encoding(&self) -> &MessageEncoding {
        &self.definition.message_encoding
    }

    /// Encoding of [`Schema::data`].
    pub fn schema_encoding(&self) -> &str {
        &self.definition.schema_encoding
    }

    /// The schema itself: a file descriptor set, a ROS message definition, a JSON schema.
    pub fn data(&self) -> &Bytes {
        &self.definition.data
    }

    /// Whether messages of both are read in the same way: they have the same name and encoding, and, where the definition
    /// decides where a field lies, the same layout. Protobuf's fields are found by their numbers and those of JSON by
    /// their names, so other fields beside them do not matter.
    pub fn reads_like(&self, other: &Self) -> bool {
        let (a, b) = (&self.definition, &other.definition);
        if (&a.name, &a.message_encoding) != (&b.name, &b.message_encoding) {
            return false;
        }
        a.data == b.data
            || match (self.reader(), other.reader()) {
                (Ok(Reader::Ros(a)), Ok(Reader::Ros(b))) => a == b,
                (Ok(Reader::Protobuf(_)), Ok(Reader::Protobuf(_))) | (Ok(Reader::Json), Ok(Reader::Json)) => {
                    true
                }
                _ => false,
            }
    }

    /// Whether messages of this schema can be read; the error says why not.
    pub fn decodable(&self) -> Result<(), DecodeError> {
        self.reader().map(|_| ())
    }

    /// The message as a tree. Large arrays share `bytes`.
    pub fn value(&self, bytes: &Bytes) -> Result<Value, DecodeError> {
        self.reader()?.read(bytes).map_err(|reason| self.malformed(reason))
    }

    /// Encodes a tree. Fields that are absent or not named keep their defaults. Protobuf only.
    pub fn encode(&self, value: &Value) -> Result<Bytes, EncodeError> {
        match self.reader() {
            Ok(Reader::Protobuf(descriptor)) => encode(descriptor, value),
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

    /// The names of all values of the enum at a path; `None` if there is no enum, or the messages are not protobuf.
    pub fn state_names(&self, path: &FieldPath) -> Option<Vec<String>> {
        let mut message = self.descriptor()?.clone();
        let mut found = None;
        for segment in path.segments() {
            match segment {
                Segment::Field(name) => {
                    let kind = message.get_field_by_name(name)?.kind();
                    if let Kind::Message(inner) = &kind {
                        message = inner.clone();
                    }
                    found = Some(kind);
                }
                Segment::Index(_) => {}
                Segment::Length => return None,
            }
        }
        let Some(Kind::Enum(states)) = found else { return None };
        Some(states.values().map(|state| state.name().to_owned()).collect())
    }

    pub(crate) fn malformed(&self, reason: impl Into<String>) -> DecodeError {
        DecodeError::Malformed { schema: self.name().to_owned(), reason: reason.into() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{rcs, schema_of};

    #[test]
    fn the_states_of_an_enum_are_found_in_nested_messages_and_in_lists() {
        fn names(schema: &Schema, path: &str) -> Option<Vec<String>> {
            schema.state_names(&path.parse().unwrap())
        }
        let (change, diagnostics) = (schema_of::<rcs::Override>(), schema_of::<rcs::Diagnostics>());
        let kinds = ["NONE", "STOPPED", "SLOWED", "FROZEN", "NAN", "DROPPED", "LATE"];
        assert_eq!(names(change, "fault.kind").unwrap(), kinds);
        assert_eq!(names(diagnostics, "parts[2].level").unwrap(), ["OK", "WARN", "ERROR", "STALE"]);
        for path in ["", "fault", "fault.delay_ms", "fault.absent", "buffer.@length"] {
            assert_eq!(names(change, path), None, "{path}");
        }
    }

    #[test]
    fn a_definition_is_like_another_one_with_other_comments_and_not_like_one_with_other_fields() {
        let schema = |name: &str, text: &str| {
            let data = Bytes::copy_from_slice(text.as_bytes());
            Schema::new(name, MessageEncoding::Cdr, "ros2msg", data)
        };
        let number = schema("std_msgs/msg/Float64", "float64 data\n");
        assert!(number.reads_like(&number));
        assert!(
            number.reads_like(&schema("std_msgs/msg/Float64", "# A number.\nfloat64 data  # of any kind\n"))
        );
        assert!(!number.reads_like(&schema("std_msgs/msg/Float64", "float32 data\n")));
        assert!(!number.reads_like(&schema("example/msg/Float64", "float64 data\n")));
        let json = |text: &'static str| {
            Schema::new("Any", MessageEncoding::Json, "jsonschema", Bytes::from_static(text.as_bytes()))
        };
        assert!(json("{}").reads_like(&json("{\"type\": \"object\"}")));
    }
}
