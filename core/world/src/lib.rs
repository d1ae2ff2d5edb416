//! The world-model cell, its message layout and the fusion rule (Albus 2006a, 4, Albus 2006b, 3.4).
//!
//! - [`Source`]: who contributes to a cell, by name; [`Sources`]: those that a map holds. The set is open.
//! - [`Cell`], [`Evidence`], [`VoteRule`]: what is remembered of a piece of ground, and how a measurement changes it.
//! - [`fuse`]: the one rule that makes one cost of what the sources say. The world-model plugin and the window's tuning
//!   view both call it, so what an operator sees before sending new weights is what the robot will compute.
//! - [`Map`]: 201×201 cells around the vehicle, and the same as a `foxglove.Grid`.
//! - [`MapMessage`], [`MapCodec`]: a map as it is passed on, and as it is recorded: key frames and changed tiles.
//! - [`GridView`], [`fuse_grid`]: reading any `foxglove.Grid` or [`MapMessage`] by field without copying it, and fusing
//!   it anew with other weights.
//!
//! Cost is 0 (free) to 250 (do not touch), 255 is unknown; confidence is 0 to 255. Lengths are metres.

mod cell;
mod columns;
mod delta;
mod fusion;
mod grid_view;
mod layout;
mod map;
mod message;
mod source;

pub use cell::{Cell, Evidence, HeightStats, VoteRule};
pub use delta::{KEY_FRAME_NS, MAP_CODEC, MapCodec};
pub use fusion::{Fused, Label, SourceKind, Weighted, Weights, WeightsError, fuse};
pub use grid_view::{Field, GridView, GridViewError, NumericType, fuse_grid};
pub use layout::{MapGridError, MapOptions};
pub use map::{CELL_SIZE_M, Map, SIDE, WIDE_CELL_SIZE_M};
pub use message::MapMessage;
pub use source::{Source, SourceNameError, Sources};

/// The highest cost.
pub const MAX_COST: u8 = 250;
/// The cost of what nobody has seen.
pub const UNKNOWN_COST: u8 = 255;
/// From this cost on a vote is one for an obstacle, below it one for ground.
pub const OBSTACLE_COST: u8 = 125;
