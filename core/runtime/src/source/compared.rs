//! What can be compared, and what is known of how two runs differ.

use crate::compare::Difference;
use crate::history::RunId;
use rcs_msg::Stamp;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// A side of a comparison.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Compared {
    /// The recording that is open.
    Recorded,
    /// A run of the stack.
    Run(RunId),
    /// Another recording ([`super::Control::Against`]).
    Other,
}

/// What is known of how two runs differ.
#[derive(Clone, Debug)]
pub struct Comparison {
    /// The first and the second.
    pub sides: [Compared; 2],
    /// The first difference of each buffer that differs, by time.
    pub differences: Arc<[Difference]>,
    /// Everything before this time was compared; `None` if nothing was.
    pub until: Option<Stamp>,
    /// Progress, 0 to 1; `None` when everything that is known of both was compared.
    pub progress: Option<f64>,
    /// The ends of those sides that are recordings; nothing after the first of them is compared.
    pub recording_ends: [Option<Stamp>; 2],
    /// Number of buffers that only the first has, and that only the second has.
    pub left_out: [usize; 2],
    /// Parts of which a side has no messages, because they were not kept.
    pub gaps: Arc<[(Stamp, Stamp)]>,
    /// Why they cannot be compared, or not in full.
    pub problem: Option<Arc<str>>,
}
