//! The vehicle interface between controller and vehicle (Albus 2006a, 5, the lowest module of behavior generation).
//!
//! | port | direction | type | what |
//! | --- | --- | --- | --- |
//! | `drive` | in, optional | `rcs.DriveCommand` | heading (local frame) and speed from the driver |
//! | `teleop` | in, optional | `rcs.DriveCommand` | the same from the operator, with priority while it is recent |
//! | `emergency_stop` | in, optional | `rcs.EmergencyStop` | stops the vehicle until a message releases it |
//! | `above` | in, optional | `rcs.Status` | status of the driver; it is not obeyed while in ERROR |
//! | `local` | in, optional | `foxglove.Odometry` | pose of the vehicle in the local frame; headings need it |
//! | `imu` | in, optional | `rcs.Imu` | turn rate, and attitude where `local` has none; its axes are the vehicle's |
//! | `encoders` | in, optional | `rcs.WheelEncoders` | speeds of the wheels, m/s |
//! | `motors` | in, optional | `rcs.MotorCurrents` | currents of the drive motors, A |
//! | `bumper` | in, optional | `rcs.Bumper` | switches of the bumper |
//! | `wheels` | out | `rcs.WheelCommand` | speeds of the wheels, m/s, and curvature, 1/m |
//! | `vehicle` | out | `rcs.VehicleStatus` | state of the vehicle |
//!
//! Period 20 ms; both outputs every cycle. Cost: microseconds. State: the last command of each input, the emergency
//! stop, the ramps, what turns lacked, and the last sensor readings.
//!
//! It limits and converts motion commands, and stops the vehicle when in doubt. It does not plan a path or avoid
//! obstacles; the bumper is the only obstacle sensor that it reads. It is not a certified safety device.
//!
//! Method (Albus 2006a, 5): "takes a desired heading and direction from the waypoint follower and slows the velocity to
//! limit acceleration, converts it to wheel speeds, and posts vehicle status": [`control`]. The papers name neither
//! gains nor limits; here they are parameters.
//!
//! Commands have this priority:
//!
//! 1. The emergency stop stops the vehicle at once, and holds until a message with `active = false` that is not older.
//! 2. The operator (`teleop`), while the last command is younger than 200 ms.
//! 3. The driver (`drive`), while the last command is younger than 200 ms and the driver's status is not ERROR.
//! 4. Otherwise the vehicle brakes.
//!
//! A command that is not finite, exceeds a limit, is out of order, too old or from the future is a fault, is counted in
//! the vehicle status, and stops the vehicle until a valid command arrives on that input or the refusal expires, like a
//! command, after 200 ms: [`gate`]. A command without a timestamp has the time of its arrival.
//!
//! `HALT` and `INIT` brake the vehicle and are `DONE` when it stands; earlier requests are not resumed after `RUN`.
//! `LIMIT_SPEED` (`rcs.SpeedLimit`) limits every driver until `RUN`: a turn rate decreases with the speed, so that the
//! vehicle drives the same arc, and with a limit of 0 it is held. An emergency stop remains active across `INIT`; a
//! pressed bumper still holds after it, and a sensor that was silent before is still missed. A sensor that repeats its last
//! message, by the time that this states, is silent. The status has NaN as speed, turn rate or attitude where its sensor is
//! not wired, or has been silent for longer than `sensor_timeout_s` (if that is above 0); `HALT` and `INIT` do not wait for
//! such a speed.
//!
//! Not in the papers: a pressed bumper blocks forward motion (backward motion and turning remain possible). Where wheels
//! slip on one side, what the turn lacks is added to it ([`control::Slip`]), while encoders and inertial sensor both send.
//! A vehicle with steering that is told to turn on the spot stands, and the status says why.
//!
//! # Where to begin
//!
//! [`control`] computes wheel speeds, [`gate`] checks commands, [`VehicleInterface`] decides between them.
//!
//! ```
//! use rcs_msg::Stamp;
//! use rcs_vehicle_interface::gate::{DriveRequest, Gate, LastRequest, Limits, Turn};
//!
//! let limits = Limits { speed_mps: 1.3, yaw_rate_radps: 1.0, timeout_s: 0.2 };
//! let ahead = DriveRequest { speed_mps: 1.0, turn: Turn::Rate(0.0) };
//! let mut gate = Gate::default();
//! gate.take(ahead, Stamp(0), Stamp(0), &limits).unwrap();
//! assert_eq!(gate.last_request(Stamp(100_000_000), 0.2), LastRequest::Drive(ahead));
//! assert_eq!(gate.last_request(Stamp(300_000_000), 0.2), LastRequest::Nothing, "expired after 200 ms");
//! ```

rcs_msg::messages!(
    /// Messages of this plugin alone, from `proto/`.
    pub mod proto
);

pub mod control;
pub mod gate;
mod process;

pub use process::{VehicleInterface, VehicleInterfaceCommand};
