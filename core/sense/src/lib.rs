//! What perception shares: every process that turns a sensor's data into labels or costs needs these, and each exists
//! once.
//!
//! - [`Localizer`], [`PosePorts`]: where the vehicle is, from whatever a stack wires (odometry, a pose stream,
//!   transforms).
//! - [`Extrinsics`]: pose of vehicle and sensor at a time, as the parameter messages `rcs.VehiclePose` and `rcs.Mount`
//!   ask for.
//! - [`ImageCheck`]: whether an image can be used: its size, its exposure, and that the camera does not hang.
//! - [`CostGrid`], [`GridFrame`]: cost maps as the world model takes them.
//! - [`ObstacleLabel`]: codes of the pixels of label images.
//!
//! It stands above the runtime and below the plugins; no algorithm of one plugin belongs here.

mod cost_grid;
mod extrinsics;
mod image_check;
mod label;
mod localizer;
mod pose_ports;

pub use cost_grid::{CostGrid, GridFrame, cost_field};
pub use extrinsics::{Axes, Extrinsics, MIN_UPRIGHT, OnItsSide, camera_of, upright};
pub use image_check::{ImageCheck, ImageFault, check_exposure, check_size, fingerprint, luma, size_of};
pub use label::ObstacleLabel;
pub use localizer::{FrameNames, Localizer, LocalizerError, pose_message, pose_of};
pub use pose_ports::PosePorts;

pub use rcs_world::{CELL_SIZE_M, WIDE_CELL_SIZE_M};
