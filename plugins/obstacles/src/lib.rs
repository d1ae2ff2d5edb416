//! Obstacles above and below the ground from range images and point clouds by column scan (Albus 2006a, 3.1.1), and
//! their labels on images.
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
//! | `cost` | out | `foxglove.Grid` | cost of 201x201 cells of 0.2 m around the vehicle, local frame |
//! | `stats` | out | `rcs.ObstacleStats` | pixels by label, cells, ranges in m |
//!
//! Period 200 ms (5 Hz, stereo's rate). No commands beside the runtime's. State: the last seconds of poses, the camera,
//! and the ground map of the negative obstacles, without which frames do not depend on each other.
//!
//! - [`scan`]: the scan of one column for positive obstacles, and what the labels mean.
//! - [`negative`]: the scan of one column for negative obstacles, and [`ground_map`], which gathers their borders over
//!   columns and frames. Pixels and cells of borders that count are reported as obstacles; the counts tell them apart.
//! - [`columns`]: strips of columns, and their votes for cells. [`depth_image`] and [`cloud`] make columns of what
//!   sensors give; a cloud is sorted into vertical half-planes, so it needs neither order nor a camera.
//! - [`cost_map`]: from votes to the map.
//!
//! Cost: linear in pixels. Strips are fixed, so any number of threads gives the same bits.
//!
//! Data that cannot be used (no calibration or one of another size, an encoding that is no depth, no pixel with a
//! range, no pose for that time) are reported as a fault and skipped: nothing is sent on for them. A colour image of
//! another size is a fault, too, and costs the map its colours alone.
//!
//! # `label_overlay`
//!
//! Projects the labelled points into a camera. Its port table is in [`overlay_process`].

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

pub use overlay_process::LabelOverlay;
pub use process::Obstacles;

#[cfg(test)]
mod negative_tests;
#[cfg(test)]
mod scan_tests;
#[cfg(test)]
mod scene;
