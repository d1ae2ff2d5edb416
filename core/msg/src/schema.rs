//! Schemas: descriptions of the bytes of a message.

use crate::any::AnyMessage;
use crate::reader::{DecodeError, Reader};
use bytes::Bytes;
use prost_reflect::{DescriptorPool, MessageDescriptor};
use prost_types::Timestamp;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, LazyLock, OnceLock, PoisonError, RwLock, RwLockReadGuard};

/// Encoding of the bytes of a message.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum MessageEncoding {
    /// Protocol buffers.
    Protobuf,
    /// ROS 2's Common Data Representation.
    Cdr,
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
            Self::Json => "json",
            Self::Other(name) => name,
        }
    }

    /// The encoding with this name.
    pub fn from_name(name: &str) -> Self {
        match name {
            "protobuf" => Self::Protobuf,
            "cdr" => Self::Cdr,
            "json" => Self::Json,
            other => Self::Other(other.to_owned()),
        }
    }
}

/// The type of a message: its name, its encoding, and the text or descriptor that defines it.
#[derive(Debug)]
pub struct Schema {
    name: String,
    message_encoding: MessageEncoding,
    encoding_of_data: String,
    data: Bytes,
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
        Self {
            name: name.into(),
            message_encoding,
            encoding_of_data: schema_encoding.into(),
            data,
            reader: OnceLock::new(),
        }
    }

    /// The reader for messages of this schema.
    pub(crate) fn reader(&self) -> Result<&Reader, DecodeError> {
        self.reader.get_or_init(|| Reader::new(self)).as_ref().map_err(Clone::clone)
    }

    /// Full name: `foxglove.Grid`, `sensor_msgs/msg/Image`.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Encoding of the messages.
    pub fn message_encoding(&self) -> &MessageEncoding {
        &self.message_encoding
    }

    /// Encoding of [`Schema::data`].
    pub fn schema_encoding(&self) -> &str {
        &self.encoding_of_data
    }

    /// The schema itself: a file descriptor set, a ROS message definition, a JSON schema.
    pub fn data(&self) -> &Bytes {
        &self.data
    }
}

/// One generated message type in the registry. Constructed by code from `rcs-msg-build`.
#[derive(Clone, Copy)]
pub struct Known {
    /// Full name: `foxglove.Grid`.
    pub name: &'static str,
    /// Decodes a message into the typed form.
    pub decode: fn(Bytes) -> Result<AnyMessage, prost::DecodeError>,
    /// Its field `timestamp`, if it has one.
    pub timestamp: fn(&AnyMessage) -> Option<Timestamp>,
    /// Its field `frame_id`, if it has one.
    pub frame_id: fn(&AnyMessage) -> Option<&str>,
}

/// The generated messages of one crate: types and descriptors. Constructed by code from `rcs-msg-build`.
pub struct Bundle {
    descriptors: &'static [u8],
    known: &'static [Known],
    pool: OnceLock<DescriptorPool>,
}

impl Bundle {
    /// Messages with the descriptor set that they were generated from.
    pub const fn new(descriptors: &'static [u8], known: &'static [Known]) -> Self {
        Self { descriptors, known, pool: OnceLock::new() }
    }

    /// Descriptors of the messages and of everything that they import, with our field options.
    #[expect(clippy::expect_used, reason = "the build script has compiled this very set")]
    fn pool(&self) -> &DescriptorPool {
        self.pool.get_or_init(|| {
            DescriptorPool::decode(self.descriptors).expect("the embedded descriptor set decodes")
        })
    }

    /// Schemas of the messages of the bundle, including nested ones.
    fn schemas(&self) -> Vec<(MessageDescriptor, Schema)> {
        let is_own = |message: &MessageDescriptor| {
            let file = message.parent_file();
            self.known.iter().any(|known| file.messages().any(|own| own.full_name() == known.name))
        };
        let own = self.pool().all_messages().filter(is_own);
        own.map(|message| {
            let data = file_descriptor_set(&message);
            let schema = Schema::new(message.full_name(), MessageEncoding::Protobuf, "protobuf", data);
            (message, schema)
        })
        .collect()
    }
}

/// The schema of one generated type, looked up once. Constructed by code from `rcs-msg-build`.
pub struct SchemaCell(OnceLock<&'static Arc<Schema>>);

impl SchemaCell {
    /// A cell whose schema has not been looked up.
    #[expect(clippy::new_without_default, reason = "only generated statics have one")]
    pub const fn new() -> Self {
        Self(OnceLock::new())
    }

    /// The schema with this name in its crate's bundle. The call adds the bundle to the registry.
    ///
    /// # Panics
    /// If the bundle has no such message, or two crates have different messages with one name. Neither can happen in a
    /// program whose `.proto` files have been compiled together.
    #[expect(clippy::panic, clippy::expect_used, reason = "what was generated together belongs together")]
    pub fn get(&'static self, bundle: &'static Bundle, name: &str) -> &'static Arc<Schema> {
        self.0.get_or_init(|| {
            registry().add(bundle).unwrap_or_else(|error| panic!("{error}"));
            registry().schema(name).expect("a generated type is in its bundle")
        })
    }
}

/// Two crates define different messages of one name.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("two different messages are named {name}, expected each name once")]
pub struct DuplicateMessage {
    /// Full name of the message.
    pub name: String,
}

/// The message types that are known by name: ours, Foxglove's, and those of the plugins that are in use.
///
/// The registry only grows: a plan adds the messages of every plugin in its list. The meaning of a name never changes.
#[derive(Default)]
pub struct Registry {
    inner: RwLock<Inner>,
}

#[derive(Default)]
struct Inner {
    /// Addresses of the bundles that have been added.
    bundles: Vec<usize>,
    /// Leaked, because a type has one schema for the life of the program.
    schemas: BTreeMap<String, &'static Arc<Schema>>,
    descriptors: BTreeMap<String, MessageDescriptor>,
    known: BTreeMap<&'static str, &'static Known>,
}

/// The one registry. It holds Foxglove's messages and those of the package `rcs` from the start.
#[expect(clippy::expect_used, reason = "an empty registry has no other message of that name")]
pub fn registry() -> &'static Registry {
    static REGISTRY: LazyLock<Registry> = LazyLock::new(|| {
        let registry = Registry::default();
        registry.add(&crate::messages::BUNDLE).expect("our own messages are the first");
        registry
    });
    &REGISTRY
}

impl Registry {
    /// Adds the messages of a crate; a bundle that is already there changes nothing.
    pub fn add(&self, bundle: &'static Bundle) -> Result<(), DuplicateMessage> {
        let address = std::ptr::from_ref(bundle) as usize;
        if self.read().bundles.contains(&address) {
            return Ok(());
        }
        let schemas = bundle.schemas();
        let mut inner = self.inner.write().unwrap_or_else(PoisonError::into_inner);
        if inner.bundles.contains(&address) {
            return Ok(());
        }
        for (_, schema) in &schemas {
            if inner.schemas.get(schema.name()).is_some_and(|known| known.data() != schema.data()) {
                return Err(DuplicateMessage { name: schema.name().to_owned() });
            }
        }
        for (descriptor, schema) in schemas {
            let name = schema.name().to_owned();
            inner.descriptors.entry(name.clone()).or_insert(descriptor);
            inner.schemas.entry(name).or_insert_with(|| Box::leak(Box::new(Arc::new(schema))));
        }
        for known in bundle.known {
            inner.known.entry(known.name).or_insert(known);
        }
        inner.bundles.push(address);
        Ok(())
    }

    /// The schema with this full name.
    pub fn schema(&self, name: &str) -> Option<&'static Arc<Schema>> {
        self.read().schemas.get(name).copied()
    }

    /// All schemas, sorted by name.
    pub fn schemas(&self) -> Vec<&'static Arc<Schema>> {
        self.read().schemas.values().copied().collect()
    }

    /// The descriptor with this full name, with our field options.
    pub fn descriptor(&self, name: &str) -> Option<MessageDescriptor> {
        self.read().descriptors.get(name).cloned()
    }

    /// All descriptors, sorted by name.
    pub fn descriptors(&self) -> Vec<MessageDescriptor> {
        self.read().descriptors.values().cloned().collect()
    }

    /// The generated type with this full name.
    pub(crate) fn known(&self, name: &str) -> Option<&'static Known> {
        self.read().known.get(name).copied()
    }

    fn read(&self) -> RwLockReadGuard<'_, Inner> {
        self.inner.read().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The file of `message` and everything that it imports, imports first: the form that MCAP requires for protobuf.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_message_of_the_registry_is_typed_by_its_name() {
        for schema in registry().schemas() {
            let nested = schema.descriptor().is_some_and(|message| message.parent_message().is_some());
            let Some(known) = registry().known(schema.name()) else {
                assert!(nested, "{} is not in the list", schema.name());
                continue;
            };
            let message = (known.decode)(Bytes::new()).expect("no bytes are a message of defaults");
            assert_eq!(message.schema().name(), schema.name());
        }
    }

    #[test]
    fn adding_a_crate_again_changes_nothing_and_another_message_of_a_name_is_refused() {
        static OTHER: Bundle = Bundle::new(
            // A file `x.proto` of package `foxglove` with an empty message `Color`.
            b"\x0a\x24\x0a\x07x.proto\x12\x08foxglove\"\x07\x0a\x05Color\x62\x06proto3",
            &[Known {
                name: "foxglove.Color",
                decode: |_| unreachable!(),
                timestamp: |_| None,
                frame_id: |_| None,
            }],
        );
        let before = registry().schemas().len();
        assert_eq!(registry().add(&crate::messages::BUNDLE), Ok(()));
        let error = registry().add(&OTHER).expect_err("the name is taken");
        assert_eq!(
            error.to_string(),
            "two different messages are named foxglove.Color, expected each name once"
        );
        assert_eq!(registry().schemas().len(), before);
    }
}
