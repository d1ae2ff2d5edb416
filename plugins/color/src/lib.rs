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
//! | `map` | in, optional | `foxglove.Grid` | world model, local frame: its obstacles stop learning |
//! | `probability` | out | `foxglove.RawImage` | cost 250(1 - P) of the 128x96 image, 255 unclassified |
//! | `sample` | out | `foxglove.ImageAnnotations` | outline of the ground sample, pixels of the image |
//! | `cost` | out | `foxglove.Grid` | cost of 201x201 cells of 0.2 m around the vehicle, local frame |
//! | `cost_wide` | out | `foxglove.Grid` | cost of 201x201 cells of 0.6 m around the vehicle, local frame |
//! | `models` | out | `rcs.ColorModels` | the models, once a second and when there is a new one |
//! | `stats` | out | `rcs.ColorStats` | pixels by class, models, learning |
//!
//! Period 200 ms (5 Hz). Commands: `CLEAR` forgets what was learned, `LEARN_OFF` and `LEARN_ON`. State: the models, the
//! probabilities of the 128×96 pixels, the last seconds of poses, the camera.
//!
//! - [`histogram`]: 30×30 bins of red and green. [`models`]: several of ground, one of background, known obstacles, and
//!   learning mode. [`background`](mod@background): which pixels the background is learned from.
//! - [`image`]: reduction to 128×96, images that tell nothing. [`fusion`]: `P_ground`, temporal fusion, cost.
//! - [`region`]: the trapezoid and the horizon in the image. [`cost_map`]: costs on the ground plane.
//! - [`gate`]: when nothing is learned. [`engine`]: all of it on one image. [`file`](mod@file): models in a message.
//!
//! Cost: 640×480 on one thread in 2 ms (`benches/color.rs`); linear in the pixels of the image.
//!
//! Data that cannot be used (no calibration or one of another size, no pose for that time, an image that is black,
//! saturated, of an unknown encoding, the same as the one before or older) are reported as a fault and skipped: nothing
//! is learned from them and nothing sent on for them.

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
pub mod histogram;
pub mod image;
pub mod models;
mod output;
mod process;
pub mod region;
mod settings;

pub use process::{ColorModelLearner, ColorModelsCommand};

#[cfg(test)]
mod engine_tests;
#[cfg(test)]
mod models_tests;
