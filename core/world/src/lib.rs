//! The world-model map, its message layout and the fusion rule (Albus 2006a, 4, Albus 2006b, 3.4).
//!
//! - [`Source`]: a source of costs, by name; [`Sources`]: those of a map. The set is open.
//! - [`Cell`], [`Evidence`], [`Vote`], [`VoteRule`]: the state of a cell, and how a measurement updates it.
//! - [`fuse`]: the rule that computes one cost from the evidence of all sources. The world-model plugin and the
//!   window's tuning view both call it, so that an operator sees the effect of new weights before sending them.
//! - [`Map`]: cells around the vehicle; converts to and from a `foxglove.Grid`.
//! - [`MapMessage`], [`MapCodec`]: a map as it is published, and as it is recorded: key frames and changed cells.
//! - [`Experience`], [`fit`]: weights learned from what the vehicle drove over and bumped into.
//! - [`weights_of`]: the weights in the parameters of a process; [`weights_learned`]: those that learned ones replace;
//!   [`never_judged`]: why others cannot be learned from a drive.
//! - [`GridView`], [`fuse_grid`]: read any `foxglove.Grid` or [`MapMessage`] by field without copying it, and fuse it
//!   again with other weights.
//!
//! This crate is the data structure. It is no process and has no ports: the plugin `world_model` is the process that
//! keeps a map current. Begin with [`Map::vote`] and [`Map::fused`]:
//!
//! ```
//! use rcs_geom::DVec2;
//! use rcs_msg::Stamp;
//! use rcs_world::{CELL_SIZE_M, Label, Map, Source, VoteRule, Weights};
//! let mut map = Map::new(CELL_SIZE_M)?;
//! map.recentre(DVec2::new(10.0, 4.0));
//! let cell = map.grid().cell_at(DVec2::new(12.3, 4.1)).expect("finite");
//! // Message number 7 of the stereo source reports an obstacle there.
//! map.vote(cell, Source::STEREO, 250, 7, Stamp(0), VoteRule::default());
//! let fused = map.fused(cell, &Weights::default());
//! assert_eq!((fused.cost, fused.label), (250, Label::Obstacle));
//! # Ok::<(), rcs_geom::GridError>(())
//! ```
//!
//! Cost is 0 (free) to 250 (obstacle), 255 is unknown; confidence is 0 to 255. Lengths are metres.

mod cell;
mod columns;
mod delta;
#[cfg(test)]
mod delta_drive;
mod digest;
mod experience;
mod fusion;
mod grid_view;
mod layout;
mod map;
mod message;
mod options;
mod source;
mod weights_params;

pub use cell::{Cell, Evidence, HeightStats, Label, Vote, VoteRule};
pub use columns::OBSTACLE_SEEN_FROM;
pub use delta::{KEY_FRAME_NS, MAP_CODEC, MapCodec};
pub use experience::{Experience, Fit, FitRules, Judged, Outcome, Samples, WeightChange, fit};
pub use fusion::{Fused, SourceKind, Weighted, Weights, fuse};
pub use grid_view::{Field, GridView, GridViewError, NumericType, fuse_grid};
pub use layout::MapGridError;
pub use map::{CELL_SIZE_M, MAX_SIDE, Map, SIDE};
pub use message::MapMessage;
pub use options::MapOptions;
pub use source::{Source, SourceNameError, Sources};
pub use weights_params::{
    LEARNED_WEIGHTS, never_judged, weight_field, weights_beside, weights_learned, weights_of,
};

/// The highest cost.
pub const MAX_COST: u8 = 250;
/// The cost of an unknown cell.
pub const UNKNOWN_COST: u8 = 255;
/// A vote with at least this cost is for an obstacle, a lower one for ground.
pub const OBSTACLE_COST: u8 = 125;
