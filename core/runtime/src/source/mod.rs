//! Sources: what the window shows. A running stack, a log, a stack that replays a log, or a remote robot; all implement
//! [`Source`].
//!
//! A view gets a [`Frame`]: everything that is known at one moment, shared and immutable. A view can neither slow nor
//! stop the source. [`Driver`] runs a source on a separate thread, paces it, and publishes frames.

mod acts;
mod beside;
mod compared;
mod comparison;
mod control;
mod deferred;
mod driver;
mod entities;
mod epochs;
mod events;
mod fields;
mod frame;
mod held;
mod hierarchy;
mod known;
mod log_source;
mod log_view;
mod pace;
mod per_run;
mod rates;
mod recording;
mod recording_state;
mod run_tag;
mod run_transforms;
mod series;
mod stack_source;
mod stack_steps;
mod tracks;
mod transform_clock;

pub use compared::{Compared, Comparison};
pub use control::Control;
pub use driver::Driver;
pub use entities::{Entities, Entity};
pub use events::{Event, EventKind, EventLevel, Events};
pub use fields::{FieldPoint, FieldSeries, exact_points, moments, points_of, read_fields, series_of};
pub use frame::{Frame, Playback, Runs, SourceInfo, SourceKind, Topic, UPDATES};
pub use held::HeldControl;
pub use hierarchy::{BufferInfo, Hierarchy, Node, Peer};
pub use log_source::LogSource;
pub use log_view::finish_idle;
pub use recording_state::{RecordingEnd, RecordingState};
pub use run_tag::RunTag;
pub use series::{Part, Piece, Record, Series, SeriesWriter, Stretch};
pub use stack_source::StackSource;
pub use tracks::{Place, Position, Track, TrackBounds, TrackPoint, WGS84, frame_name};
pub use transform_clock::TransformClock;

use rcs_msg::{AnyMessage, Stamp};
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};

/// One step of the timeline.
#[derive(Clone, Debug, PartialEq)]
pub enum Step {
    /// To the next or previous message.
    Message {
        /// Of this topic; `None` for any topic.
        topic: Option<String>,
        /// Whether to the previous one.
        back: bool,
    },
    /// To the end of the next or previous cycle.
    Cycle {
        /// Of this process; `None` for any process.
        process: Option<String>,
        /// Whether to the previous one.
        back: bool,
    },
    /// Back to when a message was written.
    BackTo {
        /// Its topic.
        topic: String,
        /// Its number in the buffer, from 1.
        sequence: u64,
    },
    /// By a duration, forward or back.
    Time {
        /// Nanoseconds; negative for back.
        ns: i64,
    },
}

impl Step {
    /// Whether it goes back.
    pub(crate) fn is_back(&self) -> bool {
        match self {
            Self::Message { back, .. } | Self::Cycle { back, .. } => *back,
            Self::BackTo { .. } => true,
            Self::Time { ns } => *ns < 0,
        }
    }
}

/// Why a source could not fulfil a request.
#[derive(Debug, thiserror::Error)]
pub enum SourceError {
    /// The log could not be read.
    #[error(transparent)]
    Log(#[from] rcs_log::LogError),
    /// The stack could not continue.
    #[error(transparent)]
    Run(#[from] crate::RunError),
    /// The operator cancelled it.
    #[error("stopped on request")]
    Cancelled,
    /// This kind of source does not support it.
    #[error("{0}")]
    Unsupported(String),
    /// There is no message of this number to go back to.
    #[error("message {sequence} of {topic} is not before this moment, or was not kept")]
    NoMessage {
        /// Its topic.
        topic: String,
        /// Its number in the buffer.
        sequence: u64,
    },
}

impl SourceError {
    fn no_message(topic: &str, sequence: u64) -> Self {
        Self::NoMessage { topic: topic.to_owned(), sequence }
    }
}

/// Progress and cancellation of long work. Shared between the source's thread and the window.
#[derive(Debug, Default)]
pub struct Task {
    permille: AtomicU32,
    cancelled: AtomicBool,
}

impl Task {
    /// Sets the progress, 0 to 1.
    pub fn report(&self, fraction: f64) {
        self.permille.store((fraction.clamp(0.0, 1.0) * 1000.0) as u32, Ordering::Relaxed);
    }

    /// The progress, 0 to 1.
    pub fn fraction(&self) -> f64 {
        f64::from(self.permille.load(Ordering::Relaxed)) / 1000.0
    }

    /// Requests cancellation.
    pub fn cancel(&self) {
        self.cancelled.store(true, Ordering::Relaxed);
    }

    /// Whether cancellation was requested.
    pub fn is_cancelled(&self) -> bool {
        self.cancelled.load(Ordering::Relaxed)
    }

    /// An error if cancellation was requested.
    pub fn check(&self) -> Result<(), SourceError> {
        if self.is_cancelled() { Err(SourceError::Cancelled) } else { Ok(()) }
    }
}

/// A source. Calls may take long; they run on the thread of a [`Driver`].
pub trait Source: Send {
    /// Its description and time range.
    fn info(&self) -> std::sync::Arc<SourceInfo>;
    /// Its current time.
    fn now(&self) -> Stamp;
    /// Everything known at this moment. Cheap: nothing large is copied.
    fn frame(&mut self) -> Frame;
    /// Seeks to a time, forward or back.
    fn seek(&mut self, to: Stamp, task: &Task) -> Result<(), SourceError>;
    /// Goes one step; `false` if there is none.
    fn step(&mut self, step: &Step, task: &Task) -> Result<bool, SourceError>;
    /// A write of the operator: a command, a parameter message, an edited message.
    fn write(&mut self, buffer: &str, message: AnyMessage) -> Result<(), SourceError>;
    /// Goes to another of its runs.
    fn switch_run(&mut self, run: crate::RunId) -> Result<(), SourceError> {
        Err(SourceError::Unsupported(format!("there is no {run}: nothing runs here")))
    }
    /// Undoes the last write: goes to the moment before it and continues from there; `false` if there is none.
    fn undo(&mut self) -> Result<bool, SourceError> {
        Err(SourceError::Unsupported("nothing was written that could be taken back".to_owned()))
    }
    /// Sets the runs that [`Frame::beside`] shows, apart from the viewed one.
    fn watch(&mut self, _runs: &[crate::RunId]) {}
    /// Begins to record the viewed run; an error if it is recorded already, or if the file cannot be created.
    fn record(
        &mut self,
        _path: &std::path::Path,
        _options: &crate::RecordOptions,
    ) -> Result<(), SourceError> {
        Err(SourceError::Unsupported("nothing runs here that could be recorded".to_owned()))
    }
    /// Ends the recording, and completes its file.
    fn stop_recording(&mut self) {}
    /// Gathers the values of these fields over time, and of no others ([`Frame::fields`]). False if it was interrupted
    /// before all of them were: it is to be called again.
    fn gather(&mut self, _fields: &[rcs_formula::FieldRef], _is_interrupted: &dyn Fn() -> bool) -> bool {
        true
    }
    /// Compares these pairs in the background, and no others ([`Frame::comparisons`]).
    fn compare(&mut self, _pairs: &[[Compared; 2]]) {}
    /// Sets the files of the recording that [`Compared::Other`] means; none for no recording.
    fn against(&mut self, _files: &[std::path::PathBuf]) {}
    /// Sets whether the moment in that recording is shown ([`Frame::other`]); until this is said, it is. Nothing is
    /// read for it while it is not.
    fn show_other(&mut self, _is_shown: bool) {}
    /// Leaves this much of the memory of its past to what is shown of it, bytes.
    fn reserve(&mut self, _bytes: u64) {}
    /// Background work in small pieces (for example tracks), while there are no requests, and between the frames while it
    /// plays and keeps up with the clock; `true` if some is left.
    fn idle(&mut self) -> bool {
        false
    }
}
