//! The vehicle interface between controller and vehicle (Albus 2006a, 5, the lowest module of behavior generation).
//!
//! | port | direction | type | what |
//! | --- | --- | --- | --- |
//! | `drive` | in, optional | `rcs.DriveCommand` | heading (local frame) and speed from who drives |
//! | `teleop` | in, optional | `rcs.DriveCommand` | the same from the operator; it wins while it is fresh |
//! | `emergency_stop` | in, optional | `rcs.EmergencyStop` | holds the vehicle until one says otherwise |
//! | `above` | in, optional | `rcs.Status` | status of who drives; on ERROR it is not obeyed |
//! | `local` | in, optional | `foxglove.Odometry` | pose of the vehicle in the local frame; headings need it |
//! | `imu` | in, optional | `rcs.Imu` | turn rate, and attitude where `local` has none; its axes are the vehicle's |
//! | `encoders` | in, optional | `rcs.WheelEncoders` | speeds of the wheels, m/s |
//! | `motors` | in, optional | `rcs.MotorCurrents` | currents of the drive motors, A |
//! | `bumper` | in, optional | `rcs.Bumper` | switches of the bumper |
//! | `wheels` | out | `rcs.WheelCommand` | speeds of the wheels, m/s, and curvature, 1/m |
//! | `vehicle` | out | `rcs.VehicleStatus` | what the vehicle says of itself |
//!
//! Period 20 ms; both outputs every cycle. Cost: microseconds. State: what each input said last, the emergency stop,
//! the ramps, and what the sensors said last.
//!
//! Method (Albus 2006a, 5): "takes a desired heading and direction from the waypoint follower and slows the velocity to
//! limit acceleration, converts it to wheel speeds, and posts vehicle status": [`control`]. The papers name neither
//! gains nor limits; ours are parameters.
//!
//! Who is obeyed, in this order: the emergency stop, which stands the vehicle at once and holds until a message with
//! `active = false` that is not older; the operator, while the last command is younger than 200 ms; who drives, unless
//! its status is ERROR, while the last command is younger than 200 ms; else the vehicle brakes. A command that is not a
//! number, faster than the limit, out of order, too old or of the future is a fault, is counted in the vehicle status,
//! and holds the vehicle until a good one comes: [`gate`]. A command without a timestamp counts from when it came.
//!
//! `HALT` and `INIT` brake: `DONE` when the vehicle stands, and what was asked for before is not taken up again after
//! `RUN`. `LIMIT_SPEED` (`rcs.SpeedLimit`) holds for whoever drives, until `RUN`. An emergency stop outlives `INIT`.
//!
//! Not in the papers: a pressed bumper holds the vehicle's way forward (backward and turning stay possible).

rcs_msg::messages!(
    /// Messages of this plugin alone, from `proto/`.
    pub mod proto
);

pub mod control;
pub mod gate;
mod process;

pub use process::{VehicleInterface, VehicleInterfaceCommand};
