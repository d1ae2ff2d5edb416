//! Range from pairs of images (A 3.1.1): from two grey images to disparities, and from those to points with colour.
//!
//! | part | what | in | out |
//! | --- | --- | --- | --- |
//! | [`StereoCamera`] | a pair's calibration: rectification, and range of a disparity | two calibrations | rectified images, m |
//! | [`Matcher`] | disparities of a rectified pair, by the method that [`Settings`] name | two grey images | 1/16 pixel |
//! | [`Point`] | points with pixel and colour | disparities, colour image | m, left optical frame |
//! | [`score`] | figures against the truth | disparities, truth | percent, pixels |
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
//! both eyes (see [`score`]): block 3.1 % of the pixels more than 2 pixels off at a density of 90.6 %, semi-global 3.4 %
//! at 95.4 %.
//!
//! Integers until the fraction of a pixel, which is one division of exact numbers: the same bits from vectors of any
//! width and from any number of strips.

mod block;
mod camera;
mod checks;
mod matcher;
mod points;
mod prefilter;
pub mod score;
mod settings;
mod sgm;
mod width;

pub use camera::{CalibrationError, Eye, StereoCamera};
pub use checks::STEPS_PER_PIXEL;
pub use matcher::{Matcher, Strip};
pub use points::Point;
pub use settings::{Method, Settings, StereoError};
pub use width::Width;

/// Marks a pixel without disparity.
pub const NO_DISPARITY: u16 = u16::MAX;

#[cfg(test)]
mod match_tests;
#[cfg(test)]
mod reference;
