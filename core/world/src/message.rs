//! A published map: the map itself, which is converted to a `foxglove.Grid` only for readers that do not know its type.

use std::collections::BTreeSet;
use std::sync::Arc;

use rcs_msg::foxglove::Grid;
use rcs_msg::{AnyMessage, DeferredSource, Stamp};

use crate::{Map, MapOptions};

/// A published map. A clone shares its tiles, and the fused costs if the message has them. Converting it to a
/// `foxglove.Grid` writes all 40 401 cells, so that is left to the readers that need the message. The message, also
/// through [`GridView`](crate::GridView), states heights rounded to 1/1024 m and variances to eight binary digits; the
/// cells of the map have them exactly.
#[derive(Clone, Debug)]
pub struct MapMessage {
    map: Map,
    frame_id: Arc<str>,
    time: Stamp,
    options: MapOptions,
    costs: Option<Arc<[u8]>>,
}

impl PartialEq for MapMessage {
    fn eq(&self, other: &MapMessage) -> bool {
        self.frame_id == other.frame_id
            && self.time == other.time
            && self.options == other.options
            && self.map == other.map
    }
}

impl MapMessage {
    /// A map in a frame at a time. The options are the content of its message: they include every source that has voted,
    /// and the weights of the fused cost.
    pub fn new(map: Map, frame_id: impl Into<Arc<str>>, time: Stamp, options: MapOptions) -> MapMessage {
        MapMessage { map, frame_id: frame_id.into(), time, options, costs: None }
    }

    /// The same map with another content of its message.
    #[must_use]
    pub fn with_options(self, options: MapOptions) -> MapMessage {
        MapMessage::new(self.map, self.frame_id, self.time, options)
    }

    /// The cells.
    pub fn map(&self) -> &Map {
        &self.map
    }

    /// Frame of the map.
    pub fn frame_id(&self) -> &str {
        &self.frame_id
    }

    /// Time of the map.
    pub fn time(&self) -> Stamp {
        self.time
    }

    /// Content of its message.
    pub fn options(&self) -> &MapOptions {
        &self.options
    }

    /// The same message with the fused costs, so that its readers need not compute them.
    #[must_use]
    pub fn with_costs(self) -> MapMessage {
        let mut costs = Vec::with_capacity(self.map.side() * self.map.side());
        self.each_cost(|cost| costs.push(cost));
        MapMessage { costs: Some(costs.into()), ..self }
    }

    /// Calls `visit` with the fused cost of each cell, by rows from the south, west to east: 0 to 250, or 255 for
    /// unknown.
    pub fn each_cost(&self, mut visit: impl FnMut(u8)) {
        match &self.costs {
            Some(costs) => costs.iter().for_each(|&cost| visit(cost)),
            None => self.map.for_each_fused(&self.options.weights, |_, fused| visit(fused.cost)),
        }
    }

    /// Tiles that are not shared with a map before it, in any of their grids.
    pub(crate) fn tiles_written_since(&self, before: &Map) -> BTreeSet<usize> {
        let mut tiles: BTreeSet<usize> = self.map.grid().tiles_written_since(before.grid()).collect();
        for source in self.options.sources.iter() {
            match (before.layer(source), self.map.layer(source)) {
                (Some(before), Some(layer)) => tiles.extend(layer.tiles_written_since(before)),
                (None, None) => {}
                _ => tiles.extend(0..self.map.grid().tile_count()),
            }
        }
        tiles
    }

    /// Its message without the cells, and their size, bytes.
    pub(crate) fn header(&self) -> (Grid, usize) {
        self.map.header(&self.frame_id, self.time, &self.options)
    }

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
        let costs = self.costs.as_ref().map_or(0, |costs| costs.len());
        size_of_val(self) + self.map.share_of_memory() + costs
    }
}
