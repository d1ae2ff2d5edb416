//! What a window asks of a source.

use super::Step;
use super::compared::Compared;
use super::held::HeldControl;
use crate::history::RunId;
use rcs_formula::FieldRef;
use rcs_msg::{AnyMessage, Stamp};
use std::path::PathBuf;

/// Requests to a source.
#[derive(Clone, Debug)]
pub enum Control {
    /// Play.
    Play,
    /// Pause.
    Pause,
    /// Seconds of the source per second of the clock; infinite for as fast as possible.
    Speed(f64),
    /// Whether to start again at the end.
    Loop(bool),
    /// Seek to a time.
    Seek(Stamp),
    /// Go one step.
    Step(Step),
    /// Write a message into a buffer.
    Write {
        /// Its name.
        buffer: String,
        /// The message.
        message: AnyMessage,
    },
    /// Go to another run of the stack.
    SwitchRun(RunId),
    /// Undo the last write: continue from before it, in another run.
    Undo,
    /// Show the same moment of these runs beside the viewed one.
    Watch(Vec<RunId>),
    /// Gather the values of these fields over time, and of no others.
    Gather(Vec<FieldRef>),
    /// Compare these pairs of runs and recordings, and no others ([`super::Frame::comparisons`]).
    Compare(Vec<[Compared; 2]>),
    /// Choose the files of the recording that [`Compared::Other`] means: one, several if it was split, or none.
    Against(Vec<PathBuf>),
    /// Whether the moment in that recording is shown ([`super::Frame::other`]); until this is said, it is.
    ShowOther(bool),
    /// Write a message repeatedly while the source plays. To be repeated at least every [`HeldControl::LEASE`] while
    /// the control is held; otherwise nothing is written until it is repeated. When the view goes back or to another
    /// run, the control ends: nothing is written until it has been released and is held again.
    Hold(HeldControl),
    /// Release a held control, and write a last message, unless the control has ended before.
    LetGo(HeldControl),
    /// Record the run to a file that does not exist yet.
    Record {
        /// The file.
        path: PathBuf,
        /// Program and version.
        build: String,
    },
    /// End the recording.
    StopRecording,
    /// Cancel long work.
    Cancel,
}

impl Control {
    /// Goes to the time of something that happened, and pauses there, also where time runs.
    pub fn pause_at(at: Stamp) -> [Self; 2] {
        [Self::Pause, Self::Seek(at)]
    }

    /// Whether it takes the view to another moment, other than by playing.
    pub fn goes_elsewhere(&self) -> bool {
        matches!(self, Self::Seek(_) | Self::Step(_) | Self::SwitchRun(_) | Self::Undo)
    }
}
