//! The registry of generated messages: by their full names, their schemas, descriptors and typed forms.

use crate::any::AnyMessage;
use crate::descriptors::{self, Described};
use crate::schema::Schema;
use bytes::Bytes;
use prost_reflect::{DescriptorPool, MessageDescriptor};
use prost_types::Timestamp;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, LazyLock, OnceLock, PoisonError, RwLock, RwLockReadGuard};

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
    described: OnceLock<Vec<Described>>,
}

impl Bundle {
    /// Messages with the descriptor set that they were generated from.
    pub const fn new(descriptors: &'static [u8], known: &'static [Known]) -> Self {
        Self { descriptors, known, pool: OnceLock::new(), described: OnceLock::new() }
    }

    /// Descriptors of the messages and of everything that they import, with our field options.
    #[expect(clippy::expect_used, reason = "the build script has compiled this very set")]
    fn pool(&self) -> &DescriptorPool {
        self.pool.get_or_init(|| {
            DescriptorPool::decode(self.descriptors).expect("the embedded descriptor set decodes")
        })
    }

    /// The messages of the bundle, including nested ones.
    pub(crate) fn described(&self) -> &[Described] {
        self.described.get_or_init(|| {
            let is_own = |message: &MessageDescriptor| {
                let file = message.parent_file();
                self.known.iter().any(|known| file.messages().any(|own| own.full_name() == known.name))
            };
            let own = self.pool().all_messages().filter(is_own);
            own.map(|descriptor| Described { data: file_descriptor_set(&descriptor), descriptor }).collect()
        })
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
pub struct Registry {
    inner: RwLock<Inner>,
}

#[derive(Default)]
struct Inner {
    /// Addresses of the bundles that have been added.
    bundles: Vec<usize>,
    /// Leaked, because a type has one schema for the life of the program.
    schemas: BTreeMap<String, &'static Arc<Schema>>,
    known: BTreeMap<&'static str, &'static Known>,
}

/// The one registry. It holds Foxglove's messages and those of the package `rcs` from the start.
#[expect(clippy::expect_used, reason = "an empty registry has no other message of that name")]
pub fn registry() -> &'static Registry {
    static REGISTRY: LazyLock<Registry> = LazyLock::new(|| {
        let registry = Registry { inner: RwLock::default() };
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
        let types = bundle.described();
        let mut inner = self.inner.write().unwrap_or_else(PoisonError::into_inner);
        if inner.bundles.contains(&address) {
            return Ok(());
        }
        for Described { descriptor, data } in types {
            let name = descriptor.full_name();
            if inner.schemas.get(name).is_some_and(|known| known.data() != data) {
                return Err(DuplicateMessage { name: name.to_owned() });
            }
        }
        descriptors::add(types);
        for Described { descriptor, data } in types {
            let schema = || Arc::new(Schema::of_descriptor(descriptor.clone(), data.clone()));
            inner
                .schemas
                .entry(descriptor.full_name().to_owned())
                .or_insert_with(|| Box::leak(Box::new(schema())));
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
        descriptors::named(name)
    }

    /// All descriptors, sorted by name.
    pub fn descriptors(&self) -> Vec<MessageDescriptor> {
        descriptors::all()
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
