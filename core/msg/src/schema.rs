//! Schemas: what a message's bytes mean.

use crate::reader::{DecodeError, Reader};
use bytes::Bytes;
use prost_reflect::{DescriptorPool, MessageDescriptor};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, LazyLock, OnceLock};

/// How the bytes of a message are laid out.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum MessageEncoding {
    /// Protocol buffers.
    Protobuf,
    /// ROS 2's common data representation.
    Cdr,
    /// JSON text.
    Json,
    /// Anything else, by the name that its log gives: listed and shown as undecodable.
    Other(String),
}

impl MessageEncoding {
    /// The name that MCAP's registry gives this encoding.
    pub fn name(&self) -> &str {
        match self {
            Self::Protobuf => "protobuf",
            Self::Cdr => "cdr",
            Self::Json => "json",
            Self::Other(name) => name,
        }
    }

    /// The encoding of that name.
    pub fn from_name(name: &str) -> Self {
        match name {
            "protobuf" => Self::Protobuf,
            "cdr" => Self::Cdr,
            "json" => Self::Json,
            other => Self::Other(other.to_owned()),
        }
    }
}

/// The type of a message: its name, how its bytes are laid out, and the text or descriptor that says so.
#[derive(Debug)]
pub struct Schema {
    name: String,
    message_encoding: MessageEncoding,
    encoding_of_data: String,
    data: Bytes,
    /// Made of the data at the first message.
    reader: OnceLock<Result<Reader, DecodeError>>,
}

impl Schema {
    /// A schema as a log or a link names it. `schema_encoding` is MCAP's: `protobuf`, `ros2msg`, `jsonschema`, ….
    pub fn new(
        name: impl Into<String>,
        message_encoding: MessageEncoding,
        schema_encoding: impl Into<String>,
        data: Bytes,
    ) -> Self {
        Self {
            name: name.into(),
            message_encoding,
            encoding_of_data: schema_encoding.into(),
            data,
            reader: OnceLock::new(),
        }
    }

    /// What reads messages of this schema.
    pub(crate) fn reader(&self) -> Result<&Reader, DecodeError> {
        self.reader.get_or_init(|| Reader::new(self)).as_ref().map_err(Clone::clone)
    }

    /// Full name: `foxglove.Grid`, `sensor_msgs/msg/Image`.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Layout of the messages' bytes.
    pub fn message_encoding(&self) -> &MessageEncoding {
        &self.message_encoding
    }

    /// Layout of [`Schema::data`].
    pub fn schema_encoding(&self) -> &str {
        &self.encoding_of_data
    }

    /// The schema itself: a file descriptor set, a ROS message definition, a JSON schema.
    pub fn data(&self) -> &Bytes {
        &self.data
    }
}

/// Every message type of ours and of Foxglove's.
pub struct Registry {
    pool: DescriptorPool,
    schemas: BTreeMap<String, Arc<Schema>>,
}

/// The one registry, decoded at first use.
pub fn registry() -> &'static Registry {
    static REGISTRY: LazyLock<Registry> = LazyLock::new(Registry::new);
    &REGISTRY
}

impl Registry {
    #[expect(clippy::expect_used, reason = "the build script has compiled this very set")]
    fn new() -> Self {
        let set = include_bytes!(concat!(env!("OUT_DIR"), "/descriptors.bin"));
        let pool = DescriptorPool::decode(set.as_slice()).expect("the embedded descriptor set decodes");
        let schemas = pool
            .all_messages()
            .filter(|message| message.package_name() != "google.protobuf")
            .map(|message| {
                let schema = Schema::new(
                    message.full_name(),
                    MessageEncoding::Protobuf,
                    "protobuf",
                    file_descriptor_set(&message),
                );
                (message.full_name().to_owned(), Arc::new(schema))
            })
            .collect();
        Self { pool, schemas }
    }

    /// The schema of that full name.
    pub fn schema(&self, name: &str) -> Option<&Arc<Schema>> {
        self.schemas.get(name)
    }

    /// All schemas, by name.
    pub fn schemas(&self) -> impl Iterator<Item = &Arc<Schema>> {
        self.schemas.values()
    }

    /// The descriptor of that full name, with our field options.
    pub fn descriptor(&self, name: &str) -> Option<MessageDescriptor> {
        self.pool.get_message_by_name(name)
    }

    /// All descriptors.
    pub fn pool(&self) -> &DescriptorPool {
        &self.pool
    }
}

/// The file of `message` and all that it imports, imports first: what MCAP wants for protobuf.
fn file_descriptor_set(message: &MessageDescriptor) -> Bytes {
    fn visit(file: &prost_reflect::FileDescriptor, seen: &mut BTreeSet<String>, out: &mut Vec<u8>) {
        if !seen.insert(file.name().to_owned()) {
            return;
        }
        for dependency in file.dependencies() {
            visit(&dependency, seen, out);
        }
        let encoded = file.encode_to_vec();
        // `FileDescriptorSet.file`: field 1, length-delimited.
        out.push(0x0a);
        prost::encoding::encode_varint(encoded.len() as u64, out);
        out.extend_from_slice(&encoded);
    }
    let mut out = Vec::new();
    visit(&message.parent_file(), &mut BTreeSet::new(), &mut out);
    out.into()
}
