//! Evaluates perception and planning on data of one's own, for accuracy and speed: the implementation of `ocu eval`.
//!
//! | module | evaluates | against |
//! | --- | --- | --- |
//! | [`stereo`] | disparities of one pair of images | a disparity image: PFM, 16-bit PNG or NPZ |
//! | [`color`] | ground and obstacles by the colour models | label images |
//! | [`plan`] | the planner's search on maps of MovingAI | the optimal lengths of their scenarios |
//! | [`obstacles`] | arcs called free or blocked by the maps of a recording | the true map of the simulation |
//! | [`classify`] | label images of a recording, or of a stack that runs | label images of the same times |
//!
//! [`tune`] learns the weights of a world model from a drive: the implementation of `ocu tune`.
//!
//! Each module has a `Job`, which says what is evaluated, and functions that return a report. A report is text by
//! [`Display`](std::fmt::Display) and JSON by [`Serialize`](serde::Serialize); that of [`plan`] is JSON alone.
//!
//! This crate parses no command line and draws nothing; that is the task of `ocu`. The counts of pixels come from
//! [`rcs_metrics`]. Begin with the module of the method:
//!
//! ```no_run
//! use rcs_eval::classify::{Job, recording};
//! let log = rcs_log::Log::open("run.mcap")?;
//! let job = Job { truth_topic: "/camera/true_labels", topic: None, tolerance_s: 0.01 };
//! println!("{}", recording(&job, &log)?);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod classify;
pub mod color;
mod disparity_file;
mod error;
mod messages;
pub mod obstacles;
pub mod plan;
mod report;
pub mod stereo;
pub mod tune;

pub use error::EvalError;
pub use report::ClassReport;
