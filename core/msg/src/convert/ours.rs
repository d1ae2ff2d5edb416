//! Messages that are canonical already, typed by their name. The list is written by the build script.

use crate::any::AnyMessage;
use bytes::Bytes;
use prost_types::Timestamp;

/// One generated message type.
pub(crate) struct Known {
    /// Full name: `foxglove.Grid`.
    pub(crate) name: &'static str,
    pub(crate) decode: fn(Bytes) -> Result<AnyMessage, prost::DecodeError>,
    /// Its field `timestamp`, if it has one.
    pub(crate) timestamp: fn(&AnyMessage) -> Option<Timestamp>,
    /// Its field `frame_id`, if it has one.
    pub(crate) frame_id: fn(&AnyMessage) -> Option<&str>,
}

/// All types, by name.
const KNOWN: &[Known] = include!(concat!(env!("OUT_DIR"), "/known.rs"));

/// The type of that full name.
pub(crate) fn known(name: &str) -> Option<&'static Known> {
    KNOWN.binary_search_by(|known| known.name.cmp(name)).ok().map(|at| &KNOWN[at])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::schema::registry;

    #[test]
    fn every_message_of_the_registry_is_typed_by_its_name() {
        assert!(KNOWN.is_sorted_by_key(|known| known.name));
        for schema in registry().schemas() {
            let nested = schema.descriptor().is_some_and(|message| message.parent_message().is_some());
            let Some(known) = known(schema.name()) else {
                assert!(nested, "{} is not in the list", schema.name());
                continue;
            };
            let message = (known.decode)(Bytes::new()).expect("no bytes are a message of defaults");
            assert_eq!(message.schema().name(), schema.name());
        }
    }
}
