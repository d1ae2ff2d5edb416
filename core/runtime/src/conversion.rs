//! Converts messages of a log to the types of buffers.

use rcs_msg::foxglove::CompressedImage;
use rcs_msg::{AnyMessage, Schema};

pub(crate) const RAW: &str = "foxglove.RawImage";
pub(crate) const COMPRESSED: &str = "foxglove.CompressedImage";

/// Converts the message to its canonical type; typed messages are canonical.
pub(crate) fn canonical(message: &AnyMessage) -> Option<AnyMessage> {
    if message.is_typed() {
        return Some(message.clone());
    }
    rcs_msg::canonical(&message.schema(), &message.bytes())?.ok()
}

/// A log's message converted to the type of a buffer; `None` if it does not decode.
pub(crate) fn for_buffer(raw: &AnyMessage, wanted: &Schema) -> Option<AnyMessage> {
    let message = canonical(raw)?;
    match message.get::<CompressedImage>().filter(|_| wanted.name() == RAW) {
        Some(image) => rcs_msg::image::decompress(image).ok().map(AnyMessage::new),
        None => Some(message),
    }
}

/// Whether a topic of canonical type `got` can feed a buffer of type `wanted`; compressed images are decoded.
pub(crate) fn converts(got: &str, wanted: &str) -> bool {
    got == wanted || (got == COMPRESSED && wanted == RAW)
}
