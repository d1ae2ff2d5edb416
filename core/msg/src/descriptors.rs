//! Descriptors of the registered messages, so that a log's schema of a registered type needs no descriptor pool of its
//! own.

use bytes::Bytes;
use prost_reflect::MessageDescriptor;
use std::collections::BTreeMap;
use std::sync::{LazyLock, PoisonError, RwLock, RwLockReadGuard};

/// A message type with its descriptor, and the file descriptor set that logs contain for it.
#[derive(Clone)]
pub(crate) struct Described {
    pub(crate) descriptor: MessageDescriptor,
    pub(crate) data: Bytes,
}

type ByName = BTreeMap<String, Described>;

/// By full name; those of this crate are there from the start.
static REGISTERED: LazyLock<RwLock<ByName>> = LazyLock::new(|| {
    let own = crate::messages::BUNDLE.described().iter();
    let own = own.map(|described| (described.descriptor.full_name().to_owned(), described.clone()));
    RwLock::new(own.collect())
});

fn read() -> RwLockReadGuard<'static, ByName> {
    REGISTERED.read().unwrap_or_else(PoisonError::into_inner)
}

/// Adds types; types that are already there do not change.
pub(crate) fn add(types: &[Described]) {
    let mut registered = REGISTERED.write().unwrap_or_else(PoisonError::into_inner);
    for described in types {
        registered.entry(described.descriptor.full_name().to_owned()).or_insert_with(|| described.clone());
    }
}

/// The descriptor with this name, if `data` is its definition.
pub(crate) fn registered(name: &str, data: &Bytes) -> Option<MessageDescriptor> {
    read().get(name).filter(|known| known.data == data).map(|known| known.descriptor.clone())
}

/// The descriptor with this name.
pub(crate) fn named(name: &str) -> Option<MessageDescriptor> {
    read().get(name).map(|known| known.descriptor.clone())
}

/// All descriptors, sorted by name.
pub(crate) fn all() -> Vec<MessageDescriptor> {
    read().values().map(|known| known.descriptor.clone()).collect()
}
