//! What perception plugins share: everything here is needed by several processes that turn sensor data into labels or
//! costs.
//!
//! - [`Localizer`], [`PosePorts`]: the pose of the vehicle, from whatever a stack wires (odometry, a pose stream,
//!   transforms).
//! - [`Extrinsics`]: poses of vehicle and sensor at a time, as the parameter messages `rcs.VehiclePose` and `rcs.Mount`
//!   define them.
//! - [`ClockWatch`], [`InOrder`]: messages that come late, and clocks that begin again.
//! - [`FrameWatch`]: whether the local frame has begun again.
//! - [`SensorTime`]: when a sensor measured, where its clock may be ahead.
//! - [`ImageCheck`]: whether an image is usable: its size, its exposure, and that the camera is not frozen.
//! - [`CostGrid`], [`GridFrame`]: cost maps for the world model.
//! - [`is_slippery`], [`LastSlip`]: what slip over some metres tells of the ground.
//! - [`worth`], [`PlaneNoise`]: how much a vote counts.
//! - [`Origin`]: the origin of the global frame on the earth.
//! - [`Sample`]: the picture of what a model was learned from.
//! - [`model_to_delete`]: which learned model a command means.
//! - [`Standing`]: what stands in the cells of a world model, for a camera that is expected to see it.
//! - [`ObstacleLabel`]: codes of the pixels of obstacle label images.
//! - [`text_above`]: the text of a value that is above its limit.
//!
//! The crate is above the runtime and below the plugins. It contains no algorithm of a single plugin: those are in
//! `plugins/*`. A plugin begins with [`PosePorts`] for its inputs, and writes its results into a [`CostGrid`]:
//!
//! ```
//! use rcs_geom::DVec2;
//! use rcs_msg::Stamp;
//! use rcs_sense::{CELL_SIZE_M, CostGrid, GridFrame};
//! // A window of 51×51 cells around the vehicle, which is at (10 m, 4 m).
//! let mut costs = CostGrid::new(GridFrame::around(DVec2::new(10.0, 4.0), 51, CELL_SIZE_M));
//! costs.mark(DVec2::new(12.3, 4.1), 250);
//! assert_eq!(costs.at(DVec2::new(12.3, 4.1)), Some(250));
//! assert_eq!(costs.at(DVec2::new(8.0, 4.0)), None); // unknown
//! // The message that a world model reads as the votes of its source `my_sensor`.
//! let message = costs.into_message("my_sensor", "local", Stamp(0));
//! assert_eq!(message.fields[0].name, "cost.my_sensor");
//! ```

mod clock;
mod cost_grid;
mod extrinsics;
mod frame_watch;
mod image_check;
mod in_order;
mod label;
mod learned;
mod localizer;
mod origin;
mod plausible;
mod pose_ports;
mod sample;
mod sensor_time;
mod slippery;
mod standing;
mod text_above;
mod worth;

pub use clock::ClockWatch;
pub use cost_grid::{CostGrid, GridFrame, cost_field};
pub use extrinsics::{
    Axes, Extrinsics, MAX_ROLL_DEG, MIN_UPRIGHT, OnItsSide, Rolled, camera_of, camera_roll_deg,
    read_calibration, upright, upright_columns,
};
pub use frame_watch::FrameWatch;
pub use image_check::{
    ImageCheck, ImageFault, check_exposure, check_size, fingerprint, fingerprint_of_texts, luma, size_of,
};
pub use in_order::{InOrder, Repeats};
pub use label::ObstacleLabel;
pub use learned::{last_learned, learned_name, model_to_delete};
pub use localizer::{FrameNames, Localizer, LocalizerError, pose_message, pose_of};
pub use origin::Origin;
pub use plausible::{FASTEST_RADPS, FASTEST_WHEEL_MPS, HARDEST_MPS2};
pub use pose_ports::PosePorts;
pub use sample::{Rgb, SAMPLE_PX, Sample, SampleError};
pub use sensor_time::SensorTime;
pub use slippery::{LastSlip, SLIPPERY, is_by_images, is_slippery};
pub use standing::{Standing, is_obstacle, plane_height};
pub use text_above::text_above;
pub use worth::{PlaneNoise, worth};

pub use rcs_world::CELL_SIZE_M;

/// Reasons (`rcs.VehicleStatus.stop_reason`) for which a vehicle interface holds the vehicle that follow from what drives it:
/// no command came, the last one was refused, it leads ahead while the bumper is pressed, or it is a turn that the
/// vehicle cannot make.
pub mod stop_reason {
    /// The bumper is pressed, and the command leads ahead.
    pub const BUMPER: &str = "bumper is pressed";
    /// No command came within the timeout.
    pub const NO_COMMAND: &str = "no command";
    /// The command is a turn on the spot, and the vehicle has steering.
    pub const ON_THE_SPOT: &str = "a vehicle with steering cannot turn on the spot";
    /// The last command was refused.
    pub const REFUSED: &str = "the last command was refused";
}
