//! How good and how fast a perception method is, on data of one's own: what `ocu eval` prints.
//!
//! | module | what is measured | against |
//! | --- | --- | --- |
//! | [`stereo`] | disparities of one pair of images | a disparity image: PFM, 16-bit PNG or NPZ |
//! | [`color`] | ground and obstacles by the colour models | label images |
//! | [`classify`] | label images of a recording, or of a stack that runs | label images of the same times |
//!
//! Each module has a job, which says what is measured, and a function that gives a report. A report is text by
//! [`Display`](std::fmt::Display) and JSON by [`Serialize`](serde::Serialize). The counts of pixels come from
//! [`rcs_metrics`].

pub mod classify;
pub mod color;
mod disparity_file;
mod error;
mod report;
pub mod stereo;

pub use error::EvalError;
pub use report::ClassReport;
