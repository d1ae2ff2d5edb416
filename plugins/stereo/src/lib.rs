//! Stereo vision (Albus 2006a, 3.1.1): disparities from pairs of images, and coloured points from disparities.
//!
//! # `stereo`
//!
//! | port | direction | type | what |
//! | --- | --- | --- | --- |
//! | `left` | in | `foxglove.RawImage` | raw image of the left camera |
//! | `right` | in | `foxglove.RawImage` | raw image of the right camera |
//! | `left_calibration` | in | `foxglove.CameraCalibration` | calibration of the left camera: K, D, R and P |
//! | `right_calibration` | in | `foxglove.CameraCalibration` | calibration of the right camera; its P has the baseline |
//! | `rectified` | out | `foxglove.RawImage` | left image, rectified, rgb8 |
//! | `calibration` | out | `foxglove.CameraCalibration` | calibration of the rectified left image |
//! | `disparity` | out | `foxglove.RawImage` | disparity of each rectified pixel, 32FC1, px; NaN where none |
//! | `depth` | out | `foxglove.RawImage` | range along the optical axis, 32FC1, m; NaN where none |
//! | `points` | out | `foxglove.PointCloud` | points with colour and pixel, left rectified optical frame, m |
//! | `stats` | out | `rcs.StereoStats` | pixels with a range, ranges in m, pairs |
//!
//! Period 50 ms, so that a pair is matched soon after its second image has arrived. No commands besides those of the
//! runtime. State: both calibrations, and the images that wait for the other camera; pairs are independent of each
//! other.
//!
//! It needs a calibrated pair: it does not calibrate cameras. It measures range and does not interpret it; obstacles
//! are found by `rcs-obstacles`.
//!
//! Images are paired by acquisition time. All outputs have the time and the frame of the left image. As in ROS, this
//! frame is that of the *rectified* left camera, so a mount describes that camera.
//!
//! Reported as a fault and skipped, without output: an image that is black, saturated, undecodable, depth, identical to
//! the previous one (frozen camera), or older than the previous one; an image whose counterpart is missing or late; a pair
//! of another size than its calibration; calibrations that are missing or do not form a pair (R is not a rotation, rows
//! are not aligned, cameras are exchanged); more disparities than columns; a pair without any range.
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
//! | [`Method::SemiGlobal`] | the same filter and brightness over 3×3, then costs along four paths |
//!
//! Both check that a match is unique and consistent between left and right, refine it to a fraction of a pixel, and
//! remove speckles. Columns left of `disparities − 1` have no disparity, because their matches may lie outside of the
//! right image. Beyond its borders the image is continued with its outermost rows and columns.
//!
//! Quality, with [`Settings::new`], on Middlebury's Motorcycle at quarter size with 64 disparities, over pixels seen by
//! both cameras (see [`score`]): block 3.1 % of the pixels more than 2 pixels off at a density of 90.6 %, semi-global
//! 3.1 % at 95.4 %.
//!
//! Arithmetic is in integers up to the sub-pixel fraction, which is one division of exact numbers. The result is
//! therefore the same bit for bit for vectors of any width and for any number of strips.
//!
//! # Example
//!
//! ```
//! use rcs_stereo::{Matcher, Method, NO_DISPARITY, Settings};
//!
//! let mut matcher = Matcher::new([64, 48], Settings::new(Method::Block, 16))?;
//! let texture = |x: usize, y: usize| (x * x * 31 + y * y * 17 + x * y * 7) as u8;
//! let left: Vec<u8> = (0..64 * 48).map(|i| texture(i % 64, i / 64)).collect();
//! // The right camera sees everything 5 pixels further to the left.
//! let right: Vec<u8> = (0..64 * 48).map(|i| texture(i % 64 + 5, i / 64)).collect();
//! let mut disparity = Vec::new();
//! matcher.compute(&left, &right, &mut disparity)?;
//! assert_eq!(disparity[24 * 64 + 40], 5 * 16, "in 1/16 pixel");
//! assert_eq!(disparity[24 * 64 + 3], NO_DISPARITY);
//! # Ok::<(), rcs_stereo::StereoError>(())
//! ```

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
