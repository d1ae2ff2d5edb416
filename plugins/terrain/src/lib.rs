//! Terrain models learned from range and from driving (Albus 2006a, 3.2, Albus 2006b, 3.6), and classification of
//! images by them (Albus 2006a, 3.3).
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
//! | `examples` | in, optional | `rcs.TrainingExample` | places that the operator says are obstacles or ground |
//! | `slip` | in, optional | `rcs.SlipReport` | slip of the wheels: ground on which they begin to spin is dear; while they slip, driving teaches nothing |
//! | `way_slip` | in, optional | `rcs.WaySlip` | slip over the last metres: ground on which it lasts is dear |
//! | `odometry` | in, optional | `foxglove.Odometry` | pose of the vehicle in the local frame |
//! | `pose` | in, optional | `foxglove.PoseInFrame` | pose of the vehicle, or of the frame that `pose.stream_frame` names, in the local frame |
//! | `transforms` | in, optional | `foxglove.FrameTransforms` | transforms between frames at their times |
//! | `static_transforms` | in, optional | `foxglove.FrameTransforms` | transforms that hold at all times |
//! | `cost` | out | `foxglove.Grid` | all known cells of 201x201 of 0.2 m: fields cost.terrain, conf.terrain and backing.terrain, local frame |
//! | `models` | out | `rcs.TerrainModels` | models of the left camera, or of both |
//! | `models_right` | out | `rcs.TerrainModels` | models of the right camera, where it has its own |
//! | `learned_left` | out | `foxglove.RawImage` | pixels that were learned from, with their label |
//! | `learned_right` | out | `foxglove.RawImage` | pixels that were learned from, with their label |
//! | `stats` | out | `rcs.TerrainStats` | points, cells and models after each frame |
//!
//! Period 333 ms (3 Hz, Albus 2006b, 3.4). Command `CLEAR` forgets the map and all models, `DELETE` one model and the
//! cells that are part of it. A model carries a picture of one of its cells, from the first frame that shows one.
//! State: the poses of the last seconds, the last images of the cameras, and a learning map with its models: one map
//! where only the left camera learns or both cameras share what they learn, otherwise one per camera.
//!
//! A camera's labels, depth and image are matched by their acquisition times. Images and depths of the last 2 s are kept
//! for that, at least 8 and at most 64. Where they come faster than the cycles, their buffers need a `queue`, else some are
//! dropped before they are read. Steps for each frame (Albus 2006a, 3.2):
//!
//! 1. Nothing is learned while the vehicle turns fast or stands.
//! 2. Each labelled point is added to its cell of a north-up map of 201×201 cells of 0.2 m.
//! 3. A cell with enough points of one label becomes a model, or is merged with the model that it resembles.
//! 4. All known cells are sent, with the obstacle fraction of their model where they have one, and how far experience
//!    backs it. The paper sends changed cells only; here a message is a state that replaces the previous one, so that a
//!    message lost, or a world model cleared, loses nothing.
//! 5. Cells under the vehicle, and cells that the bumper hits, add experience (Albus 2006b, 3.6: learning by
//!    experience), and so do cells on which the wheels begin to spin. Cells that the operator marks add it in the same way.
//!
//! Unusable data are reported as a fault and skipped, and nothing is sent: an image of another size than its
//! calibration; labels or depth of another size or time than every image; an image that is black, saturated or equal to
//! the previous one; no pose for its time. A camera that falls behind the other one is reported once.
//!
//! Models are saved as the message `rcs.TerrainModels` in JSON, and loaded from the parameters `models` and
//! `models_right`.
//!
//! The learner needs obstacle labels, from range or from another detector: it does not detect obstacles itself.
//!
//! # `classifier`
//!
//! Classifies windows of an image by these models. Its port table is in [`classifier`].
//!
//! # Where to begin
//!
//! - [`appearance`]: histograms and their comparison. [`texture`]: local binary patterns and contrast.
//! - [`frame`]: from pixels to cells. [`map`] and [`cell`]: the learning map. [`models`]: models, and their conversion to messages.
//! - [`judgement`]: what the map says of a cell. [`surroundings`]: cells that cannot be compared.
//! - [`classify`]: windows of an image. [`place`]: their position on the ground.
//! - [`sync`]: matching of images by time.
//!
//! Cost: linear in pixels. Counts are whole numbers, so the result is the same bit for bit with any number of threads.
//!
//! # Example
//!
//! ```
//! use rcs_terrain::appearance::{Histograms, MatchWeights};
//!
//! let weights = MatchWeights { histograms: [1.0; 5], contrast: 1.0 }.normalised();
//! let (mut grass, mut mulch) = (Histograms::default(), Histograms::default());
//! grass.add(0o00000, 0);
//! mulch.add(0o11111, 0); // in another bin of every histogram
//! let (grass, mulch) = (weights.signature(&grass), weights.signature(&mulch));
//! assert_eq!(grass.distance(&grass), 0.0);
//! assert!(grass.distance(&mulch) > 1.0);
//! ```

rcs_msg::messages!(
    /// Messages of this plugin alone, from `proto/`.
    pub mod proto
);

pub mod appearance;
mod camera;
pub mod cell;
pub mod classifier;
pub mod classify;
mod experience;
pub mod frame;
pub mod judgement;
mod learner;
pub mod map;
pub mod model_file;
pub mod models;
pub mod place;
pub mod surroundings;
pub mod sync;
pub mod texture;
mod unusable;

pub use classifier::Classifier;
pub use learner::{TerrainLearner, TerrainLearnerCommand};

#[cfg(test)]
mod classify_tests;
#[cfg(test)]
mod growth_tests;
#[cfg(test)]
mod scene;
