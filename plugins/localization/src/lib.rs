//! Where the vehicle is: a local estimate that is smooth and drifts, and a global one that is noisy and does not (Albus
//! 2006a, 4).
//!
//! # `position`
//!
//! | port | direction | type | what |
//! | --- | --- | --- | --- |
//! | `encoders` | in | `rcs.WheelEncoders` | distances of the driven wheels, m |
//! | `imu` | in, optional | `rcs.Imu` | turn rates, accelerations and heading, vehicle axes |
//! | `gps` | in, optional | `foxglove.LocationFix` | position fixes of the antenna with their variances |
//! | `ground_speed` | in, optional | `rcs.GroundSpeed` | speed over ground that does not slip, instead of the encoders' |
//! | `local` | out | `foxglove.Odometry` | pose of the vehicle in the local frame with covariance: smooth, drifts |
//! | `global` | out | `foxglove.Odometry` | pose of the vehicle in the global frame with covariance: noisy, does not drift |
//! | `transforms` | out | `foxglove.FrameTransforms` | the local frame in the global frame |
//!
//! Period 20 ms. `local` is sent whenever a sensor has said something, `global` and `transforms` every 100 ms once two
//! position fixes have agreed. No commands beside the runtime's.
//!
//! - [`attitude`]: roll, pitch and yaw by a complementary filter of gyros and accelerometers.
//! - [`planar`]: place and heading with covariance; dead reckoning and the correction by a fix.
//! - [`fixes`]: which fixes are believed, and how much.
//! - [`wheels`]: what the wheels have rolled, and whether the vehicle stands.
//! - [`origin`]: the global frame on the earth.
//!
//! The local estimate begins at (0, 0, 0) with the heading of the inertial sensor's compass, or of a parameter. It uses
//! the wheels alone for distances, so when they slip it goes too far, and never hears of it; the global estimate does,
//! by the fixes. Neither knows of sideways slip.
//!
//! Noise that the covariances state, with the parameters' defaults: 5 % of each 20 m, as slip lasts, 0.5° of
//! heading in the square root of a second; a fix as its receiver states it, and fixes that err alike over 15 s, so that
//! 30 s of them are one measurement.
//!
//! Where this differs from the seed: Albus 2006a, 4 says what the two estimates are and not how they are made; the gate
//! is that of Wellington 2005, A.2: a likelihood ratio by the normalised error.
//!
//! Readings that cannot be used (not finite, older than the one before, wheels that jump, a place outside of UTM, an
//! outlier) are faults and are skipped.

rcs_msg::messages!(
    /// Messages of this plugin alone, from `proto/`.
    pub mod proto
);

pub mod attitude;
pub mod fixes;
pub mod origin;
pub mod planar;
mod process;
pub mod wheels;

pub use process::Localization;
