//! Estimates of the vehicle's pose: a local one that is smooth but drifts, and a global one that is noisy but does not
//! drift (Albus 2006a, 4).
//!
//! # `localization`
//!
//! | port | direction | type | what |
//! | --- | --- | --- | --- |
//! | `encoders` | in | `rcs.WheelEncoders` | distances of the driven wheels, m |
//! | `imu` | in, optional | `rcs.Imu` | turn rates, accelerations and heading, vehicle axes |
//! | `gps` | in, optional | `foxglove.LocationFix` | position fixes of the antenna with their variances |
//! | `ground_speed` | in, optional | `rcs.GroundSpeed` | speed over ground, unaffected by slip, used instead of that of the encoders |
//! | `slip` | in, optional | `rcs.SlipReport` | slip of the wheels, and the speed by the inertial sensors, which counts while they slip |
//! | `visual_motion` | in, optional | `rcs.VisualMotion` | motion by the images of a camera, which counts where the wheels slip |
//! | `local` | out | `foxglove.Odometry` | pose of the vehicle in the local frame with covariance: smooth, drifts |
//! | `global` | out | `foxglove.Odometry` | pose of the vehicle in the global frame with covariance: noisy, does not drift |
//! | `transforms` | out | `foxglove.FrameTransforms` | the local frame in the global frame |
//! | `way_slip` | out | `rcs.WaySlip` | slip of the wheels over the last metre that they have rolled, by images; over 5 m, by fixes, without them |
//!
//! Period 20 ms. `local` is sent whenever a sensor has reported, `global` and `transforms` every 100 ms after two
//! position fixes have agreed, `way_slip` every 0.4 m while there are images or fixes. No commands besides those of the runtime.
//!
//! The positions move at readings of the encoders, also where a radar gives the speed. When there have been none that can be
//! used for `input_timeout_s`, the positions stand still, whatever the vehicle does; then none is sent, so that those who
//! drive by them see their age. `HALT` changes nothing: a halted vehicle may roll out or be pushed.
//!
//! After `INIT` both estimates go on where they were; they follow the vehicle at once, and are sent from `RUN` on. If nothing
//! has followed it for more than a second before, as after a panic, it may have been moved: its heading is that of the
//! inertial sensor, if it states one, and the standard deviation of its global position is more than 5 m until there are
//! fixes. With another world file or another heading at the start, both begin anew.
//!
//! It fuses wheel encoders, inertial sensors, position fixes, and the motion that images show. It uses no map: there is no
//! loop closure.
//!
//! # `visual_motion`
//!
//! | port | direction | type | what |
//! | --- | --- | --- | --- |
//! | `image` | in | `foxglove.RawImage` | rectified image of the camera, pixel for pixel that of the depth |
//! | `depth` | in | `foxglove.RawImage` | depth image along the optical axis: 16UC1, mono16 or 32FC1 |
//! | `calibration` | in | `foxglove.CameraCalibration` | calibration of the depth image |
//! | `odometry` | in, optional | `foxglove.Odometry` | pose of the vehicle in the local frame |
//! | `pose` | in, optional | `foxglove.PoseInFrame` | pose of the vehicle, or of the frame that `pose.stream_frame` names, in the local frame |
//! | `transforms` | in, optional | `foxglove.FrameTransforms` | transforms between frames at their times |
//! | `static_transforms` | in, optional | `foxglove.FrameTransforms` | transforms that hold at all times |
//! | `motion` | out | `rcs.VisualMotion` | motion of the vehicle from one image to the next one |
//!
//! Period 50 ms; `motion` is sent for each image that shows the same as the one before. Cost: 2 ms for 320×240. State: the
//! poses of the last seconds, the camera, and up to 2000 points of the image before. It uses the turn of the poses alone,
//! and no distance.
//!
//! Images without calibration, of another size than it or not rectified, of an unknown encoding, or at a time without a pose
//! are faults and are skipped. An image may come later than its depth, and their times may differ by 2 ms; when no depth has
//! had its image for 1 s, that is a fault once. Nothing is sent, and that is no fault, where ground without texture, or with
//! a pattern that repeats itself, does not tell the motion.
//!
//! # Where to begin
//!
//! - [`planar`]: position and heading with covariance; dead reckoning, and correction by a fix.
//! - [`attitude`]: roll, pitch and yaw by a complementary filter of gyros and accelerometers.
//! - [`fixes`]: which fixes are accepted, and with what weight.
//! - [`visual`]: motion between two images with depth. [`grip`]: what it tells of the wheels.
//! - [`way_slip`]: slip that lasts, by the fixes, where images tell nothing.
//! - [`wheels`]: distance rolled by the wheels, and whether the vehicle stands.
//! - [`rcs_sense::Origin`]: the global frame on the earth.
//!
//! The local estimate starts at (0, 0, 0) with the heading of the inertial sensor's compass, or of a parameter. With the
//! parameter `compass_time_s` the compass also takes the drift from the gyro's heading while the vehicle drives: a bias of
//! 0.03°/s is 4° after 140 s, by which a way of 30 m ends 2 m beside its place. It
//! measures distance by the wheels; where images tell that they slip, by the images ([`grip`]). Without images, while slip is
//! reported, it measures distance by the inertial speed of that report. Roll and pitch follow the gyros alone then, because
//! an acceleration that the wheels do not tell would be taken for a tilt. Slip that neither tells makes the distance too
//! long. The fixes tell it 5 m later ([`way_slip`]): the global estimate is corrected by them, and what the local one has
//! counted too much is taken off its next metres ahead ([`way_slip::Slipped::share`]), so that it stays smooth. Neither
//! models sideways slip.
//!
//! Noise in the covariances, with default parameters: 5 % of distance, with one error per 20 m because slip depends on
//! the ground; 0.5° of heading per square root of a second; fixes as stated by the receiver, with errors correlated
//! over 15 s, so that 30 s of them count as one measurement.
//!
//! Differences from the papers: Albus 2006a, 4 describes the two estimates but not how they are computed. Its local one uses
//! encoders and inertial sensors alone, and "drifts even more if the wheels slip"; here images count while they do. The gate
//! is that of Wellington 2005, A.2: a likelihood ratio by the normalised error.
//!
//! Unusable readings (not finite or absurd, older than the previous one, wheel distances that jump, a position outside of
//! UTM, an outlier, a fix that is repeated or older than `gps_dropout_s`, or with the ROS status "no fix") are faults and are
//! skipped. An orientation of the inertial sensor that cannot be used, such as four zeros, is a fault once and counts as none.
//! A fix without altitude (NaN, by ROS conventions) leaves the height as it is. A reading from the future counts as
//! taken when it came: a sensor whose clock was ahead for a moment is not refused until that time is there. Where the clocks of
//! encoders and inertial sensor have both begun again, as where a simulation was started again, the estimates begin anew with
//! the second reading; while only one of them has, its readings are refused.
//!
//! Without a world file, the global frame has its origin at the first of the two fixes that agree. An inertial sensor that
//! begins later than `input_timeout_s` after the encoders still gives the heading at the start, unless the wheels have moved.
//!
//! # Example
//!
//! ```
//! use rcs_geom::DVec2;
//! use rcs_localization::planar::{MotionNoise, Planar};
//!
//! // Dead reckoning: 1 m to the east within a second.
//! let mut pose = Planar::new(DVec2::ZERO, 0.0, 0.0, 0.0);
//! let noise = MotionNoise { distance: 0.05, heading_rad: 0.01 };
//! pose.advance(&noise, 1.0, 0.0, 1.0);
//! assert!(pose.at.abs_diff_eq(DVec2::new(1.0, 0.0), 1e-12));
//! assert!(pose.covariance.x_axis.x > 0.0);
//! ```

rcs_msg::messages!(
    /// Messages of this plugin alone, from `proto/`.
    pub mod proto
);

pub mod attitude;
mod compass;
pub mod fixes;
pub mod grip;
pub mod planar;
mod process;
pub mod visual;
mod visual_process;
pub mod way_slip;
pub mod wheels;

pub use process::Localization;
pub use visual_process::VisualMotion;
