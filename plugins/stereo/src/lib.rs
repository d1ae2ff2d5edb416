//! Range from pairs of images (Albus 2006a, 3.1.1): from two grey images to disparities, and from those to points with
//! colour.
//!
//! # `stereo`
//!
//! | port | direction | type | what |
//! | --- | --- | --- | --- |
//! | `left` | in | `foxglove.RawImage` | image of the left camera as its camera took it |
//! | `right` | in | `foxglove.RawImage` | image of the right camera as its camera took it |
//! | `left_calibration` | in | `foxglove.CameraCalibration` | calibration of the left camera: K, D, R and P |
//! | `right_calibration` | in | `foxglove.CameraCalibration` | calibration of the right camera; its P has the baseline |
//! | `rectified` | out | `foxglove.RawImage` | left image, rectified, rgb8 |
//! | `calibration` | out | `foxglove.CameraCalibration` | camera of the rectified left image |
//! | `disparity` | out | `foxglove.RawImage` | disparity of each rectified pixel, 32FC1, px; NaN where none |
//! | `depth` | out | `foxglove.RawImage` | range along the optical axis, 32FC1, m; NaN where none |
//! | `points` | out | `foxglove.PointCloud` | points with colour and pixel, left rectified optical frame, m |
//! | `stats` | out | `rcs.StereoStats` | pixels with a range, ranges in m, pairs |
//!
//! Period 50 ms, so that a pair is matched soon after its second image has come. No commands beside the runtime's.
//! State: both calibrations and the images that wait for their other camera; pairs do not depend on each other.
//!
//! Images are paired by the time at which they were taken. Everything that goes out is of the left image's time and in
//! its frame, which, as in ROS, is that of the *rectified* left camera: a mount is given for it.
//!
//! Reported as a fault and skipped, with nothing sent on: an image that is black, saturated or cannot be decoded, one
//! whose bytes are those of the one before (the camera hangs), one whose other camera is missing or late, one that is
//! older than the one before, a pair of another size than its calibration, calibrations that are missing or not those
//! of a pair (R no rotation, rows that differ, cameras exchanged), more disparities than columns, a pair in which
//! nothing has a range.
//!
//! # The engine
//!
//! | part | what | in | out |
//! | --- | --- | --- | --- |
//! | [`StereoCamera`] | a pair's calibration: rectification, and range of a disparity | two calibrations | rectified images, m |
//! | [`Matcher`] | disparities of a rectified pair, by the method that [`Settings`] name | two grey images | 1/16 pixel |
//! | [`Point`] | points with pixel and colour | disparities, colour image | m, left optical frame |
//! | [`score`] | figures against the ground truth | disparities, ground truth | percent, pixels |
//! | [`Width`] | the processor's vectors | | |
//!
//! | [`Method`] | how |
//! | --- | --- |
//! | [`Method::Block`] | Laplacian of Gaussian, sums of absolute differences over a square, both images searched |
//! | [`Method::SemiGlobal`] | the same filter and brightness over 3×3, then costs along five paths |
//!
//! Both check that a match is unique and that left and right agree, find a fraction of a pixel, and take out speckles.
//! The columns left of `disparities − 1` have none: their matches may lie outside of the right image. Rows and columns
//! beyond the image are copies of its outermost ones.
//!
//! Quality, with [`Settings::new`], on Middlebury's Motorcycle at quarter size with 64 disparities, over pixels seen by
//! both cameras (see [`score`]): block 3.1 % of the pixels more than 2 pixels off at a density of 90.6 %, semi-global
//! 3.4 % at 95.4 %.
//!
//! Integers until the fraction of a pixel, which is one division of exact numbers: the same bits from vectors of any
//! width and from any number of strips.

rcs_msg::messages!(
    /// Messages of this plugin alone, from `proto/`.
    pub mod proto
);

mod block;
mod camera;
mod checks;
mod image;
mod matcher;
mod pairing;
mod points;
mod prefilter;
mod process;
mod publish;
mod rig;
pub mod score;
mod settings;
mod sgm;
mod width;

pub use camera::{CalibrationError, CameraInfo, StereoCamera};
pub use checks::STEPS_PER_PIXEL;
pub use matcher::{Matcher, Strip};
pub use points::Point;
pub use process::Stereo;
pub use settings::{Method, Settings, StereoError};
pub use width::Width;

/// Marks a pixel without disparity.
pub const NO_DISPARITY: u16 = u16::MAX;

#[cfg(test)]
mod match_tests;
#[cfg(test)]
mod reference;
