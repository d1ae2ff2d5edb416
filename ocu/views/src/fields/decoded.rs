//! Messages as trees of values, which other threads decode.

use crate::cached::SameMessage;
use crate::prepare::prepared;
use egui::{Context, Id};
use rcs_msg::{Stamp, Value};
use rcs_runtime::source::Topic;
use std::sync::Arc;

/// A decoded message.
pub(super) struct Decoded {
    pub(super) value: Value,
    pub(super) log_time: Stamp,
}

impl Decoded {
    /// The newest message of a topic, or why it cannot be decoded; `None` before the first one is decoded. Views share it.
    pub(super) fn of(ctx: &Context, topic: &Topic) -> Option<Result<Arc<Self>, String>> {
        let sample = topic.latest.as_ref()?;
        let (message, log_time) = (sample.message.clone(), sample.header.log_time);
        let slot = Id::unique(("fields", &*topic.name, topic.run));
        let decoded = prepared(ctx, slot, SameMessage(message.clone()), move || {
            let value = message.value().map_err(|error| error.to_string())?;
            Ok(Arc::new(Self { value, log_time }))
        });
        decoded.map(|decoded| (*decoded).clone())
    }
}
