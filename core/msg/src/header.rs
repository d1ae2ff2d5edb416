//! Acquisition time and frame of a message.

use crate::any::AnyMessage;
use crate::foxglove::FrameTransforms;
use crate::registry::{Known, registry};
use crate::time::Stamp;
use crate::value::Value;
use prost_types::Timestamp;

/// Acquisition time of a message: its `timestamp`, that of its ROS header, or its `stamp`; for transforms that of the
/// first one. `None` if it has none.
pub fn header_stamp(message: &AnyMessage) -> Option<Stamp> {
    if let Some(timestamp) = typed(message, |known| known.timestamp) {
        return Stamp::from_proto(&timestamp);
    }
    if let Some(transforms) = message.get::<FrameTransforms>() {
        return Stamp::from_proto(transforms.transforms.first()?.timestamp.as_ref()?);
    }
    if message.is_typed() { None } else { message.value().ok()?.header_stamp() }
}

/// Frame of a message: its `frame_id`, or that of its ROS header. `None` if it has none.
pub fn header_frame(message: &AnyMessage) -> Option<String> {
    let name = message.schema();
    let frame = registry().known(name.name()).and_then(|known| (known.frame_id)(message));
    match frame {
        Some(frame) => Some(frame.to_owned()),
        None if message.is_typed() => None,
        None => message.value().ok()?.header_frame().map(str::to_owned),
    }
}

fn typed(
    message: &AnyMessage,
    field: impl Fn(&'static Known) -> fn(&AnyMessage) -> Option<Timestamp>,
) -> Option<Timestamp> {
    field(registry().known(message.schema().name())?)(message)
}

impl Value {
    /// Acquisition time of a message of any encoding: see [`header_stamp`].
    pub fn header_stamp(&self) -> Option<Stamp> {
        let own = |value: &Value| {
            let stamp = value.field("timestamp").or_else(|| value.field("header")?.field("stamp"));
            // Messages without a header, such as ROS 2's lines of a log.
            stamp.or_else(|| value.field("stamp"))?.as_stamp()
        };
        own(self).or_else(|| own(&*self.field("transforms")?.item(0)?))
    }

    /// Frame of a message of any encoding: see [`header_frame`].
    pub fn header_frame(&self) -> Option<&str> {
        self.field("frame_id").or_else(|| self.field("header")?.field("frame_id"))?.as_text()
    }
}
