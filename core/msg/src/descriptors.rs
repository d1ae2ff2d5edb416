//! Descriptors of the messages in the registry: a schema of a log that is one of them needs no pool of its own.

use bytes::Bytes;
use prost_reflect::MessageDescriptor;
use std::collections::BTreeMap;
use std::sync::{LazyLock, PoisonError, RwLock, RwLockReadGuard};

/// A message type with its descriptor and with the file descriptor set that logs hold of it.
#[derive(Clone)]
pub(crate) struct Described {
    pub(crate) descriptor: MessageDescriptor,
    pub(crate) data: Bytes,
}

type ByName = BTreeMap<String, Described>;

/// By full name; those of this crate from the start.
static REGISTERED: LazyLock<RwLock<ByName>> = LazyLock::new(|| {
    let own = crate::messages::BUNDLE.described().iter();
    let own = own.map(|described| (described.descriptor.full_name().to_owned(), described.clone()));
    RwLock::new(own.collect())
});

fn read() -> RwLockReadGuard<'static, ByName> {
    REGISTERED.read().unwrap_or_else(PoisonError::into_inner)
}

/// Adds types; one that is there already stays.
pub(crate) fn add(types: &[Described]) {
    let mut registered = REGISTERED.write().unwrap_or_else(PoisonError::into_inner);
    for described in types {
        registered.entry(described.descriptor.full_name().to_owned()).or_insert_with(|| described.clone());
    }
}

/// The descriptor of that name, if `data` is what defines it.
pub(crate) fn registered(name: &str, data: &Bytes) -> Option<MessageDescriptor> {
    read().get(name).filter(|known| known.data == data).map(|known| known.descriptor.clone())
}

/// The descriptor of that name.
pub(crate) fn named(name: &str) -> Option<MessageDescriptor> {
    read().get(name).map(|known| known.descriptor.clone())
}

/// All descriptors, sorted by name.
pub(crate) fn all() -> Vec<MessageDescriptor> {
    read().values().map(|known| known.descriptor.clone()).collect()
}
