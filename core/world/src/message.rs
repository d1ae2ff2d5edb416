//! A published map: the map itself, which is converted to a `foxglove.Grid` only for readers that do not know its type.

use std::sync::Arc;

use rcs_msg::foxglove::Grid;
use rcs_msg::{AnyMessage, DeferredSource, Stamp};

use crate::{Map, MapOptions};

/// A published map. A clone shares its tiles. Converting it to a `foxglove.Grid` writes all 40 401 cells, so that is
/// left to the readers that need the message. The message, also through [`GridView`](crate::GridView), states heights
/// rounded to 1/1024 m and variances to eight binary digits; the cells of the map have them exactly.
#[derive(Clone, Debug, PartialEq)]
pub struct MapMessage {
    /// The cells.
    pub map: Map,
    /// Frame of the map.
    pub frame_id: Arc<str>,
    /// Time of the map.
    pub time: Stamp,
    /// Content of its message, including every source that has voted, and the weights of the fused cost.
    pub options: MapOptions,
}

impl MapMessage {
    /// A message for a buffer of `foxglove.Grid`.
    pub fn into_message(self) -> AnyMessage {
        AnyMessage::deferred::<MapMessage, Grid>(self)
    }
}

impl From<MapMessage> for Grid {
    fn from(message: MapMessage) -> Grid {
        message.to_message()
    }
}

impl DeferredSource<Grid> for MapMessage {
    fn to_message(&self) -> Grid {
        self.map.to_grid(&self.frame_id, self.time, &self.options)
    }

    fn size_hint(&self) -> usize {
        size_of_val(self) + self.map.share_of_memory()
    }
}
