//! Detection of obstacles above and below the ground in range images and point clouds by column scan (Albus 2006a,
//! 3.1.1), and projection of their labels into images.
//!
//! # `obstacles`
//!
//! | port | direction | type | what |
//! | --- | --- | --- | --- |
//! | `image` | in, optional | `foxglove.RawImage` | colour image of the same camera, pixel for pixel |
//! | `depth` | in, optional | `foxglove.RawImage` | depth image along the optical axis: 16UC1, mono16 or 32FC1 |
//! | `cloud` | in, optional | `foxglove.PointCloud` | point cloud with x, y and z, m, in any order |
//! | `calibration` | in, optional | `foxglove.CameraCalibration` | calibration of the depth image |
//! | `odometry` | in, optional | `foxglove.Odometry` | pose of the vehicle in the local frame |
//! | `pose` | in, optional | `foxglove.PoseInFrame` | pose of the vehicle, or of the frame that `pose.stream_frame` names, in the local frame |
//! | `transforms` | in, optional | `foxglove.FrameTransforms` | transforms between frames at their times |
//! | `static_transforms` | in, optional | `foxglove.FrameTransforms` | transforms that hold at all times |
//! | `labels` | out | `foxglove.RawImage` | label of each pixel of the depth image |
//! | `points` | out | `foxglove.PointCloud` | points of the cloud with a label each, in the cloud's frame, m |
//! | `cost` | out | `foxglove.Grid` | cost of cells of 0.2 m around the vehicle within the greatest range, at most 201x201, local frame |
//! | `stats` | out | `rcs.ObstacleStats` | pixels by label, cells, ranges in m |
//!
//! Period 200 ms (5 Hz, the rate of stereo). No commands besides those of the runtime. State: the poses of the last
//! seconds, the camera, the ground map of the negative obstacles, and in how many frames each cell was an obstacle (with
//! `positive_frames`); apart from these, frames are independent of each other.
//!
//! It labels what the current range data show. It does not track obstacles or remember them: that is the task of the
//! world model.
//!
//! # `label_overlay`
//!
//! Projects labelled points into a camera image. Its port table is in [`overlay_process`].
//!
//! # Where to begin
//!
//! - [`scan`]: the scan of one column for positive obstacles, and the meaning of the labels.
//! - [`negative`]: the scan of one column for negative obstacles; [`ground_map`] accumulates their borders over columns
//!   and frames. Pixels and cells of confirmed borders are reported as obstacles, and counted separately.
//! - [`columns`]: strips of columns, and their votes for cells.
//! - [`depth_image`] and [`cloud`]: conversion of sensor data to columns. A cloud is sorted into vertical half-planes,
//!   so it requires neither order nor a camera.
//! - [`cost_map`]: from votes to the cost map.
//!
//! Cost: linear in pixels. The strips are fixed, so the result is the same bit for bit with any number of threads.
//!
//! Unusable data are reported as a fault and skipped, and nothing is sent: range data without a calibration, with one
//! of another size, with an unknown encoding, without any valid range, or at a time without a pose, depth images of a
//! camera on its side (upside down it may be), and a cloud of an optical frame with a fixed mount. A colour image of
//! another size is a fault, too, but then the map lacks only its colours.
//!
//! # Example
//!
//! ```
//! use rcs_obstacles::scan::{ColumnScan, Label, ScanParams, ScanPoint, Start};
//!
//! // A sensor 1 m above flat ground, and a wall 3 m ahead.
//! let ground = (10..30).map(|i| ScanPoint::at(0.1 * i as f32, 0.0, -1.0));
//! let wall = (0..10).map(|i| ScanPoint::at(3.0, 0.0, -1.0 + 0.1 * i as f32));
//! let points: Vec<_> = ground.chain(wall).collect();
//! let mut labels = vec![Label::Invalid; points.len()];
//! let start = Start { rho: 0.9, z: -1.0, slope: 0.0 };
//! ColumnScan::default().scan(&points, start, &ScanParams::default(), &mut labels);
//! assert_eq!(labels[10], Label::Ground);
//! assert_eq!(labels[29], Label::Obstacle);
//! ```

rcs_msg::messages!(
    /// Messages of this plugin alone, from `proto/`.
    pub mod proto
);

pub mod cloud;
pub mod columns;
pub mod cost_map;
pub mod depth_image;
pub mod ground_map;
mod level;
pub mod negative;
pub mod overlay;
pub mod overlay_process;
mod params;
mod process;
mod results;
pub mod scan;
mod sensor_pose;
mod sightings;

pub use overlay_process::LabelOverlay;
pub use process::Obstacles;

#[cfg(test)]
mod negative_tests;
#[cfg(test)]
mod scan_tests;
#[cfg(test)]
mod scene;
