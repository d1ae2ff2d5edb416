//! Messages made from a tree of values.

use rcs_msg::{AnyMessage, Schema, Value};
use std::sync::Arc;

pub(crate) type BoxError = Box<dyn std::error::Error + Send + Sync>;

/// The message with this content; of a known type it is typed.
pub(crate) fn from_tree(schema: &Arc<Schema>, tree: &Value) -> Result<AnyMessage, BoxError> {
    let bytes = schema.encode(tree)?;
    Ok(match rcs_msg::canonical(schema, &bytes) {
        Some(typed) => typed?,
        None => AnyMessage::encoded(Arc::clone(schema), bytes),
    })
}
