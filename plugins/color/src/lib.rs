//! Colour models of ground and background, learned from what the vehicle drives on (Albus 2006a, 3.1.2, Albus 2006b,
//! 3.3).
//!
//! # `color_models`
//!
//! | port | direction | type | what |
//! | --- | --- | --- | --- |
//! | `image` | in | `foxglove.RawImage` | colour image, distorted as the calibration says or rectified |
//! | `calibration` | in | `foxglove.CameraCalibration` | calibration of the image |
//! | `odometry` | in, optional | `foxglove.Odometry` | pose of the vehicle in the local frame |
//! | `pose` | in, optional | `foxglove.PoseInFrame` | pose of the vehicle, or of the frame that `pose.stream_frame` names, in the local frame |
//! | `transforms` | in, optional | `foxglove.FrameTransforms` | transforms between frames at their times |
//! | `static_transforms` | in, optional | `foxglove.FrameTransforms` | transforms that hold at all times |
//! | `map` | in, optional | `foxglove.Grid` | world model, local frame: obstacles in the ground sample prevent learning, and hide known obstacles behind them |
//! | `probability` | out | `foxglove.RawImage` | cost 250(1 - P) of the 128x96 image, 255 unclassified |
//! | `sample` | out | `foxglove.ImageAnnotations` | outline of the ground sample, pixels of the image |
//! | `cost` | out | `foxglove.Grid` | cost of 201x201 cells of 0.2 m around the vehicle, and its backing by known obstacles, local frame |
//! | `models` | out | `rcs.ColorModels` | the models, once a second and after each new one |
//! | `stats` | out | `rcs.ColorStats` | pixels by class, models, learning |
//!
//! Period 200 ms (5 Hz). Commands: `CLEAR` forgets all learned models, `DELETE` one model, `LEARN_OFF` and `LEARN_ON`
//! switch learning. A learned ground model carries a picture of what it was made from.
//! State: the models, the probabilities of the 128×96 pixels, the poses of the last seconds, the camera.
//!
//! It classifies each pixel by its colour alone: it neither finds obstacles by their shape (`rcs-obstacles`) nor learns
//! texture or cost from driving (`rcs-terrain`).
//!
//! # Where to begin
//!
//! [`engine`] runs the complete algorithm on one image; [`ColorModelLearner`] connects it to ports and parameters.
//!
//! - [`histogram`]: histograms of 30×30 bins of red and green. [`models`]: ground, background and known obstacles, and
//!   learning mode. [`background`](mod@background): the pixels from which the background is learned.
//! - [`image`]: reduction to 128×96 pixels. [`fusion`]: `P_ground`, temporal fusion, cost.
//! - [`region`]: the trapezoid of the ground sample, and the horizon. [`cost_map`]: costs on the ground plane.
//! - [`mesh`]: the colours of known obstacles that the ground is seen through. [`upright`]: where known obstacles stand.
//!   [`posts`](mod@posts): the posts of a fence, and what is between them. [`hidden`]: what stands in front of them.
//! - [`gate`]: when ground is not learned. [`file`](mod@file): conversion of models to messages and files.
//!
//! Cost: 2 ms for 640×480 on one thread (`benches/color.rs`); linear in the pixels of the image. With known obstacles
//! about 1 ms more, and once a second the blends of their colours with those of each ground model, about 1 ms each, and
//! for posts a third of that.
//!
//! Unusable data are reported as a fault and skipped: nothing is learned from them and nothing is sent. Such data are
//! an image without calibration, of another size than its calibration, black, saturated, of an unknown encoding or one of
//! depth, equal to the previous one or older than it, an image at a time without a pose, and one of a camera that is
//! rolled by more than 45°.
//!
//! # Example
//!
//! ```
//! use rcs_color::histogram::Histogram;
//! use rcs_color::models::{Learned, Models, Settings};
//! use rcs_msg::Stamp;
//!
//! let settings = Settings::default();
//! let mut brown = Histogram::default();
//! for _ in 0..settings.samples {
//!     brown.add(120, 90);
//! }
//! let mut models = Models::default();
//! assert_eq!(models.learn_ground(&brown, || None, Stamp(0), 0, &settings), Learned::Added);
//! assert_eq!(models.best_match(&brown).0, 0.0);
//! ```

rcs_msg::messages!(
    /// Messages of this plugin alone, from `proto/`.
    pub mod proto
);

pub mod background;
pub mod cost_map;
pub mod engine;
pub mod file;
pub mod fusion;
pub mod gate;
pub mod hidden;
pub mod histogram;
pub mod image;
pub mod mesh;
pub mod models;
mod output;
mod ports;
pub mod posts;
mod process;
pub mod region;
mod settings;
pub mod upright;

pub use process::{ColorModelLearner, ColorModelsCommand};

#[cfg(test)]
mod engine_tests;
#[cfg(test)]
mod models_tests;
