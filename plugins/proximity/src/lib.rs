//! What is near enough to touch, and whether the wheels grip (Albus 2006a, 3; Albus 2006b, 3.1).
//!
//! | port | direction | type | what |
//! | --- | --- | --- | --- |
//! | `bumper` | in, optional | `rcs.Bumper` | switches of the bumper |
//! | `infrared` | in, optional | `rcs.RangeReadings` | readings of range sensors that look along x of their frames, m |
//! | `motors` | in, optional | `rcs.MotorCurrents` | currents of the drive motors, A |
//! | `encoders` | in, optional | `rcs.WheelEncoders` | speeds of the wheels, m/s |
//! | `imu` | in, optional | `rcs.Imu` | accelerations and turn rates; its axes are the vehicle's |
//! | `odometry` | in, optional | `foxglove.Odometry` | pose of the vehicle in the local frame |
//! | `pose` | in, optional | `foxglove.PoseInFrame` | pose of the vehicle, or of the frame that `pose.stream_frame` names, in the local frame |
//! | `transforms` | in, optional | `foxglove.FrameTransforms` | transforms between frames at their times |
//! | `static_transforms` | in, optional | `foxglove.FrameTransforms` | transforms that hold at all times |
//! | `bumper_cost` | out | `foxglove.Grid` | field cost.bumper: 250 where the bumper hit, 0 under the vehicle, local frame |
//! | `infrared_cost` | out | `foxglove.Grid` | field cost.infrared: cones of the infrared sensors, local frame |
//! | `slip` | out | `rcs.SlipReport` | slip of the wheels, 0 to 1, and load of the motors |
//!
//! Period 50 ms. `bumper_cost` goes out for every reading whose switches changed, else ten times a second (A: 10–20
//! Hz);
//! `infrared_cost` for every message of readings; `slip` ten times a second. Cost: tens of microseconds. State: the
//! last seconds of poses, the estimate of the wheels' grip.
//!
//! Method: the papers name these sensors and their rates, not what is made of them. The half of the bumper that a
//! pressed switch stands for marks the cells in front of it, and the ground under the vehicle is free; an infrared cone
//! is free up to what it sees, which is an obstacle: [`near`]. Maps have the world model's cells in a window of 8 m:
//! [`costs`]. Slip compares the encoders with the inertial sensors, whose gravity is told apart by the position
//! estimate's pitch (no slip is told without a pose), and a motor that draws current while its wheel hardly turns is
//! stalled: [`traction`].
//!
//! Readings that are no numbers, or of a sensor whose place on the vehicle is not known, are faults and are skipped. A
//! bumper hit while the vehicle's pose is not known is a fault, as it can mark nothing.

rcs_msg::messages!(
    /// Messages of this plugin alone, from `proto/`.
    pub mod proto
);

pub mod costs;
pub mod near;
mod process;
pub mod traction;

pub use process::Proximity;
