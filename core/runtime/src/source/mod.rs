//! What the window looks at: a running stack, a log, a log through a stack, or a remote robot. All answer [`Source`].
//!
//! A view gets a [`Frame`]: everything that can be known at one moment, shared and immutable. It can neither slow nor
//! stop the source. [`Driver`] runs a source on a thread of its own, paces it, and publishes frames.

mod driver;
mod frame;
mod held;
mod log_source;
mod log_view;
mod pace;
mod rates;
mod run_tracks;
mod run_transforms;
mod stack_source;
mod stack_steps;
mod tracks;

pub use driver::{Control, Driver};
pub(crate) use frame::canonical;
pub use frame::{Frame, Playback, RunTag, Runs, SourceInfo, SourceKind, Topic, Track};
pub use held::HeldControl;
pub use log_source::LogSource;
pub use log_view::finish_idle;
pub use stack_source::StackSource;

use rcs_msg::{AnyMessage, Stamp};
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};

/// One step of the timeline.
#[derive(Clone, Debug, PartialEq)]
pub enum Step {
    /// To the next (or previous) message.
    Message {
        /// Of this topic; of any where none is named.
        topic: Option<String>,
        /// The previous one.
        back: bool,
    },
    /// To the end of the next (or previous) cycle.
    Cycle {
        /// Of this process; of any where none is named.
        process: Option<String>,
        /// The previous one.
        back: bool,
    },
    /// By a time, forward or back.
    Time {
        /// Nanoseconds; negative goes back.
        ns: i64,
    },
}

/// Why a source could not do what it was asked.
#[derive(Debug, thiserror::Error)]
pub enum SourceError {
    /// The log could not be read.
    #[error(transparent)]
    Log(#[from] rcs_log::LogError),
    /// The stack could not run on.
    #[error(transparent)]
    Run(#[from] crate::RunError),
    /// The operator stopped it.
    #[error("stopped on request")]
    Cancelled,
    /// This kind of source cannot do that.
    #[error("{0}")]
    Unsupported(String),
}

/// Progress of long work, and the wish to stop it. Shared between the source's thread and the window.
#[derive(Debug, Default)]
pub struct Task {
    permille: AtomicU32,
    cancelled: AtomicBool,
}

impl Task {
    /// Says how far the work is, 0 to 1.
    pub fn report(&self, fraction: f64) {
        self.permille.store((fraction.clamp(0.0, 1.0) * 1000.0) as u32, Ordering::Relaxed);
    }

    /// How far the work is, 0 to 1.
    pub fn fraction(&self) -> f64 {
        f64::from(self.permille.load(Ordering::Relaxed)) / 1000.0
    }

    /// Asks the work to stop.
    pub fn cancel(&self) {
        self.cancelled.store(true, Ordering::Relaxed);
    }

    /// Whether someone asked the work to stop.
    pub fn is_cancelled(&self) -> bool {
        self.cancelled.load(Ordering::Relaxed)
    }

    /// An error if someone asked the work to stop.
    pub fn check(&self) -> Result<(), SourceError> {
        if self.is_cancelled() { Err(SourceError::Cancelled) } else { Ok(()) }
    }
}

/// What the window looks at. Calls may take long; they run on a [`Driver`]'s thread.
pub trait Source: Send {
    /// What it is, and its time range.
    fn info(&self) -> std::sync::Arc<SourceInfo>;
    /// Where it stands.
    fn now(&self) -> Stamp;
    /// All that can be known at this moment. Cheap: nothing large is copied.
    fn frame(&mut self) -> Frame;
    /// Goes to a time, forward or back.
    fn seek(&mut self, to: Stamp, task: &Task) -> Result<(), SourceError>;
    /// Goes one step; `false` where there is none.
    fn step(&mut self, step: &Step, task: &Task) -> Result<bool, SourceError>;
    /// An operator's write: a command, a parameter message, an edited message.
    fn write(&mut self, buffer: &str, message: AnyMessage) -> Result<(), SourceError>;
    /// Goes to another of its runs.
    fn switch_run(&mut self, run: crate::RunId) -> Result<(), SourceError> {
        Err(SourceError::Unsupported(format!("there is no {run}: nothing runs here")))
    }
    /// Goes to the moment before the last write, and on from there without it; `false` where there was none.
    fn undo(&mut self) -> Result<bool, SourceError> {
        Err(SourceError::Unsupported("nothing was written that could be taken back".to_owned()))
    }
    /// Work that may be done while nothing else is asked, in small pieces (tracks, for example); `true` if some is left.
    fn idle(&mut self) -> bool {
        false
    }
}
