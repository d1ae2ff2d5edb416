//! Cost maps from bumper and infrared sensors, and detection of wheel slip (Albus 2006a, 3; Albus 2006b, 3.1).
//!
//! | port | direction | type | what |
//! | --- | --- | --- | --- |
//! | `bumper` | in, optional | `rcs.Bumper` | switches of the bumper |
//! | `infrared` | in, optional | `rcs.RangeReadings` | readings of range sensors that look along x of their frames, m |
//! | `motors` | in, optional | `rcs.MotorCurrents` | currents of the drive motors, A |
//! | `encoders` | in, optional | `rcs.WheelEncoders` | speeds of the wheels, m/s |
//! | `imu` | in, optional | `rcs.Imu` | accelerations and turn rates; its axes are the vehicle's |
//! | `way_slip` | in, optional | `rcs.WaySlip` | slip over the last metres |
//! | `odometry` | in, optional | `foxglove.Odometry` | pose of the vehicle in the local frame |
//! | `pose` | in, optional | `foxglove.PoseInFrame` | pose of the vehicle, or of the frame that `pose.stream_frame` names, in the local frame |
//! | `transforms` | in, optional | `foxglove.FrameTransforms` | transforms between frames at their times |
//! | `static_transforms` | in, optional | `foxglove.FrameTransforms` | transforms that hold at all times |
//! | `bumper_cost` | out | `foxglove.Grid` | field cost.bumper: 250 where the bumper hit, 0 under the vehicle unless its wheels slip, local frame |
//! | `infrared_cost` | out | `foxglove.Grid` | field cost.infrared: cones of the infrared sensors, local frame |
//! | `slip_cost` | out | `foxglove.Grid` | field cost.slip: 100 where the wheels slipped over some metres, local frame |
//! | `slip` | out | `rcs.SlipReport` | slip of the wheels, 0 to 1, and load of the motors |
//!
//! Period 50 ms. `bumper_cost` is sent for every reading whose switches changed, otherwise ten times a second (Albus
//! 2006a: 10–20 Hz); `infrared_cost` for every message of readings; `slip_cost` for every `way_slip` of 0.35 to 0.7; `slip` ten times a second. Cost: tens of
//! microseconds. State: the poses of the last seconds, the traction estimate.
//!
//! It reports what touches or nearly touches the vehicle. It does not stop the vehicle: `rcs-vehicle-interface` reads
//! the bumper itself.
//!
//! # Where to begin
//!
//! The papers name these sensors and their rates but not how they are processed. Here:
//!
//! - [`near`]: a pressed switch stands for one half of the bumper and marks the cells in front of it; the ground under
//!   the vehicle is free. An infrared cone is free up to the measured range, where there is an obstacle.
//! - [`costs`]: maps with the world model's cells in a window of 8 m, or as large as a long vehicle, or as what infrared
//!   sensors see, up to 40 m.
//! - [`traction`]: slip is the difference between the encoders and the inertial sensors. Gravity is removed with the
//!   pitch of the pose, so without a pose no slip is reported. A motor that draws current while its wheel hardly turns
//!   is stalled.
//!
//! Readings that are not finite, or of a sensor whose mount is unknown, are faults and are skipped. A bumper hit while
//! the pose of the vehicle is unknown is a fault, because no cell can be marked.
//!
//! Where infrared sensors or motor currents have spoken and are silent for longer than `sensor_timeout_s`,
//! the status warns of it, and stays `EXEC`.
//!
//! # Example
//!
//! ```
//! use rcs_geom::{DVec2, Pose};
//! use rcs_proximity::near::{Body, bumper_costs};
//!
//! let body =
//!     Body { bumper_x_m: 0.24, bumper_width_m: 0.66, bumper_depth_m: 0.2, rear_x_m: -0.72, width_m: 0.6 };
//! let (left, right) = (true, false);
//! let costs = bumper_costs(&Pose::IDENTITY, &body, left, right, true);
//! assert_eq!(costs.at(DVec2::new(0.3, 0.1)), Some(250), "in front of the pressed switch");
//! assert_eq!(costs.at(DVec2::new(-0.3, 0.1)), Some(0), "under the vehicle");
//! ```

rcs_msg::messages!(
    /// Messages of this plugin alone, from `proto/`.
    pub mod proto
);

pub mod costs;
pub mod near;
mod process;
pub mod traction;

pub use process::Proximity;
