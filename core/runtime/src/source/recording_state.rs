//! The state of a recording, as frames show it.

use rcs_msg::Stamp;
use std::path::PathBuf;

/// Why a recording ended.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub enum RecordingEnd {
    /// The operator ended it.
    Stopped,
    /// Another run was begun or shown.
    OtherRun,
    /// It could not be written, for example because the disk is full.
    Failed(String),
}

/// State of a recording.
#[derive(Clone, Debug, PartialEq)]
pub struct RecordingState {
    /// The file.
    pub path: PathBuf,
    /// Time at which it began.
    pub from: Stamp,
    /// Newest time in it.
    pub to: Stamp,
    /// Size of the file, bytes.
    pub bytes: u64,
    /// Messages that are missing in it.
    pub dropped: u64,
    /// Why it ended; `None` while it continues.
    pub ended: Option<RecordingEnd>,
}
