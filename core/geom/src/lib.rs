//! Frames, poses, camera models, geodesy and the scrolling grid.
//!
//! - [`Pose`]: a rigid transform. Frames read across: `p_world = world_from_robot * p_robot`.
//! - [`TransformTree`]: named frames with static and timed transforms; looks up the pose of any frame in any other.
//! - [`PinholeCamera`], [`Distortion`], [`Rectification`]: from points to pixels and back.
//! - [`Geodetic`], [`Utm`], [`Enu`]: positions on the WGS84 ellipsoid.
//! - [`ScrollGrid`]: a square grid around the vehicle whose cells keep their place in memory when it moves.
//!
//! This crate is pure mathematics. It knows no messages, no buffers and no map: `rcs-msg` has the messages, and
//! `rcs-world` has the map that is built on [`ScrollGrid`].
//! Begin with [`Pose`]; it is used everywhere.
//!
//! ```
//! use rcs_geom::{DVec3, PinholeCamera, Pose};
//! // A camera 1 m above the ground and 0.5 m in front of the vehicle's origin, looking straight ahead.
//! let vehicle_from_camera = Pose::from_translation(DVec3::new(0.5, 0.0, 1.0)) * Pose::body_from_optical();
//! let world_from_vehicle = Pose::from_xy_yaw(10.0, 0.0, 0.0);
//! let camera_from_world = (world_from_vehicle * vehicle_from_camera).inverse();
//! // A point on the ground, 4 m in front of the camera.
//! let p_camera = camera_from_world * DVec3::new(14.5, 0.0, 0.0);
//! let camera = PinholeCamera::from_horizontal_fov([640, 480], 1.0)?;
//! let pixel = camera.project(p_camera).expect("in front of the camera");
//! assert!((pixel.x - 319.5).abs() < 1e-9 && pixel.y > 239.5);
//! # Ok::<(), rcs_geom::CameraError>(())
//! ```
//!
//! Lengths are metres, angles radians and times nanoseconds, unless a name says otherwise.
//! Axes follow REP 103: x forward, y left, z up; optical frames x right, y down, z forward; the world is east-north-up
//! with yaw counter-clockwise from east.
//! Transcendental functions come from `libm` (glam's are built on it, too), so that results are bit-identical on every
//! system.

mod camera;
mod camera_error;
mod distortion;
pub mod geodesy;
mod pose;
mod rectify;
mod scroll_grid;
mod transform_tree;

pub use camera::PinholeCamera;
pub use camera_error::CameraError;
pub use distortion::Distortion;
pub use geodesy::{Enu, GeodesyError, Geodetic, Utm};
pub use glam::{DMat3, DQuat, DVec2, DVec3};
pub use pose::{Pose, PoseError, wrap_angle};
pub use rectify::Rectification;
pub use scroll_grid::{CellIndex, CellRect, Exposed, GridError, ScrollGrid, TILE};
pub use transform_tree::{TransformError, TransformTree};
