//! Frames, poses, camera models, geodesy and the scrolling grid.
//!
//! - [`Pose`]: a rigid transform, read across frames: `p_world = world_from_robot * p_robot`.
//! - [`TransformTree`]: named frames, static and timed; any frame from any other at any time that has data.
//! - [`PinholeCamera`], [`Distortion`], [`Rectification`]: from points to pixels and back.
//! - [`Geodetic`], [`Utm`], [`Enu`]: places on the WGS84 ellipsoid.
//! - [`ScrollGrid`]: a square map that stays around the vehicle without moving its cells.
//!
//! Lengths are metres, angles radians, times nanoseconds, unless a name says otherwise.
//! Axes follow REP 103: x forward, y left, z up; optical frames x right, y down, z forward; the world is
//! east-north-up with yaw counter-clockwise from east.
//! Transcendental functions come from `libm` (glam's are built on it too), so that bits do not depend on the
//! system.

mod camera;
mod distortion;
pub mod geodesy;
mod pose;
mod rectify;
mod scroll_grid;
mod transform_tree;

pub use camera::{CameraError, PinholeCamera};
pub use distortion::Distortion;
pub use geodesy::{Enu, GeodesyError, Geodetic, Utm};
pub use glam::{DMat3, DQuat, DVec2, DVec3};
pub use pose::{Pose, PoseError, wrap_angle};
pub use rectify::Rectification;
pub use scroll_grid::{CellIndex, CellRect, Exposed, GridError, ScrollGrid, TILE};
pub use transform_tree::{TransformError, TransformTree};
