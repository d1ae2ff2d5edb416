//! Converts messages of a log to the types of buffers, and finds when they were acquired.

use rcs_msg::channel::WRITER;
use rcs_msg::foxglove::CompressedImage;
use rcs_msg::{AnyMessage, Schema, Stamp, header_stamp};
use std::collections::BTreeMap;

pub(crate) const RAW: &str = "foxglove.RawImage";
pub(crate) const COMPRESSED: &str = "foxglove.CompressedImage";

/// Converts the message to its canonical type; typed messages are canonical.
pub(crate) fn canonical(message: &AnyMessage) -> Option<AnyMessage> {
    if message.is_typed() {
        return Some(message.clone());
    }
    rcs_msg::canonical(&message.schema(), &message.bytes())?.ok()
}

/// When what a log's message tells was acquired: the sensor's own stamp (that of the message, or of its ROS header), else
/// the time of publication, else the log time. A recording of ROS states no time of publication of its own: it repeats
/// the log time, by which a message may be late.
///
/// A time of 0 counts as absent, because many writers leave it so. Known flaw: so does the stamp of a message that was
/// acquired at 0 exactly. Of a simulation that begins at 0, publication and log time are near 0 as well.
pub fn acquisition_time(message: &AnyMessage, publish_time: Stamp, log_time: Stamp) -> Stamp {
    header_stamp(message).and_then(stated).unwrap_or_else(|| publication_time(publish_time, log_time))
}

/// When a log's message was published, else the log time.
pub(crate) fn publication_time(publish_time: Stamp, log_time: Stamp) -> Stamp {
    stated(publish_time).unwrap_or(log_time)
}

fn stated(time: Stamp) -> Option<Stamp> {
    (time.0 != 0).then_some(time)
}

/// Whether the messages of a channel have the time of acquisition as their time of publication, whatever is in them: this
/// program has recorded it.
pub fn states_acquisition(metadata: &BTreeMap<String, String>) -> bool {
    metadata.contains_key(WRITER)
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

#[cfg(test)]
mod tests {
    use super::*;
    use rcs_msg::foxglove::{PointCloud, Vector3};

    #[test]
    fn a_message_was_acquired_at_its_own_stamp_else_when_it_was_published_else_logged() {
        let cloud = |timestamp: Option<u64>| {
            AnyMessage::new(PointCloud {
                timestamp: timestamp.map(|ns| Stamp(ns).to_proto()),
                ..PointCloud::default()
            })
        };
        let acquired =
            |message: &AnyMessage, publish: u64| acquisition_time(message, Stamp(publish), Stamp(9)).0;
        assert_eq!(acquired(&cloud(Some(5)), 7), 5);
        assert_eq!(acquired(&cloud(Some(0)), 7), 7);
        assert_eq!(acquired(&cloud(None), 7), 7);
        assert_eq!(acquired(&cloud(Some(0)), 0), 9);
        assert_eq!(acquired(&AnyMessage::new(Vector3::default()), 7), 7);
        // As stored, not decoded.
        let stored = cloud(Some(5));
        assert_eq!(acquired(&AnyMessage::encoded(stored.schema(), stored.bytes()), 7), 5);
    }
}
