//! A map as it is passed on: the map itself, which becomes a `foxglove.Grid` only for those who do not know it.

use std::sync::Arc;

use rcs_msg::foxglove::Grid;
use rcs_msg::{AnyMessage, Stamp};

use crate::{Map, MapOptions};

/// A published map. Cloning shares its tiles; turning it into a `foxglove.Grid` writes all 40 401 cells, and is left to
/// those who need the message.
#[derive(Clone, Debug, PartialEq)]
pub struct MapMessage {
    /// The cells.
    pub map: Map,
    /// Frame of the map.
    pub frame_id: Arc<str>,
    /// Time of the map.
    pub time: Stamp,
    /// What is written of it, every source that has voted among it, and the weights of its fused cost.
    pub options: MapOptions,
}

impl MapMessage {
    /// As the message of a buffer of `foxglove.Grid`.
    pub fn into_message(self) -> AnyMessage {
        AnyMessage::deferred::<MapMessage, Grid>(self)
    }
}

impl From<MapMessage> for Grid {
    fn from(message: MapMessage) -> Grid {
        message.map.to_grid(&message.frame_id, message.time, &message.options)
    }
}
