//! Terrain models learned from range and from driving (Albus 2006a, 3.2, Albus 2006b, 3.6), and images classified by
//! them (Albus 2006a, 3.3).
//!
//! # `terrain_learner`
//!
//! | port | direction | type | what |
//! | --- | --- | --- | --- |
//! | `left_image` | in, optional | `foxglove.RawImage` | colour image of the left camera |
//! | `left_labels` | in, optional | `foxglove.RawImage` | obstacle labels of its pixels, mono8 |
//! | `left_depth` | in, optional | `foxglove.RawImage` | depth of its pixels along the optical axis, m |
//! | `left_calibration` | in, optional | `foxglove.CameraCalibration` | calibration of the left camera's image |
//! | `right_image` | in, optional | `foxglove.RawImage` | colour image of the right camera |
//! | `right_labels` | in, optional | `foxglove.RawImage` | obstacle labels of its pixels, mono8 |
//! | `right_depth` | in, optional | `foxglove.RawImage` | depth of its pixels along the optical axis, m |
//! | `right_calibration` | in, optional | `foxglove.CameraCalibration` | calibration of the right camera's image |
//! | `bumper` | in, optional | `rcs.Bumper` | switches of the bumper |
//! | `odometry` | in, optional | `foxglove.Odometry` | pose of the vehicle in the local frame |
//! | `pose` | in, optional | `foxglove.PoseInFrame` | pose of the vehicle, or of the frame that `pose.stream_frame` names, in the local frame |
//! | `transforms` | in, optional | `foxglove.FrameTransforms` | transforms between frames at their times |
//! | `static_transforms` | in, optional | `foxglove.FrameTransforms` | transforms that hold at all times |
//! | `cost` | out | `foxglove.Grid` | changed cells of 201x201 of 0.2 m: field cost.terrain, local frame |
//! | `models` | out | `rcs.TerrainModels` | models of the left camera, or of both |
//! | `models_right` | out | `rcs.TerrainModels` | models of the right camera, where it has its own |
//! | `learned_left` | out | `foxglove.RawImage` | points that were learned from, by their label |
//! | `learned_right` | out | `foxglove.RawImage` | points that were learned from, by their label |
//! | `stats` | out | `rcs.TerrainStats` | points, cells and models after each frame |
//!
//! Period 333 ms (3 Hz, Albus 2006b, 3.4). Command `CLEAR` forgets the map and all models. State: the last seconds of
//! poses, the cameras' last images, and a learning map with its models: one where the left camera learns alone or both
//! cameras share what they learn, else one for each camera.
//!
//! A camera's labels, depth and image belong together by their acquisition times. Per frame (Albus 2006a, 3.2): nothing
//! is learned while the vehicle turns fast or stands; each labelled point goes to its cell of a map of 201×201 cells of
//! 0.2 m, north-up; a cell with enough points of one label becomes a model or merges with the model that it resembles;
//! cells whose cost has changed are sent, with their model's obstacle fraction where they have one. Cells that come
//! under the vehicle, and cells that the bumper hits, add what was felt (B: learning by experience).
//!
//! - [`texture`]: local binary patterns and contrast. [`appearance`]: histograms and how they are compared.
//! - [`frame`]: from pixels to cells. [`map`]: the learning map. [`models`]: models, and the way to and from messages.
//! - [`sync`]: images that belong together by their times.
//!
//! Cost: linear in pixels. Counts are whole numbers, so any number of threads gives the same bits.
//!
//! What cannot be used is reported as a fault and skipped, and nothing is sent on for it: an image of another size than
//! its calibration, labels or depth of another size or time than all images, an image that is black, saturated or equal
//! to the one before it, no pose for its time; a camera that falls behind the other one is reported once.
//!
//! Models are saved as the message `rcs.TerrainModels` in JSON, and loaded from the parameters `models` and
//! `models_right`.
//!
//! # `classifier`
//!
//! Classifies windows of an image by these models. Its port table is in [`classifier`].

rcs_msg::messages!(
    /// Messages of this plugin alone, from `proto/`.
    pub mod proto
);

pub mod appearance;
mod camera;
pub mod classifier;
pub mod classify;
pub mod frame;
mod learner;
pub mod map;
pub mod models;
pub mod place;
pub mod sync;
pub mod texture;
mod unusable;

pub use classifier::Classifier;
pub use learner::{TerrainLearner, TerrainLearnerCommand};

#[cfg(test)]
mod classify_tests;
#[cfg(test)]
mod scene;
