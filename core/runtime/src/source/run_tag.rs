//! Which run a topic or a track belongs to.

use crate::history::RunId;

/// The run of a topic. Recorded and computed topics are shown side by side and never mixed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum RunTag {
    /// Read from the recording.
    Recorded,
    /// Computed by the stack, in this run of it.
    Run(RunId),
}

impl RunTag {
    /// The first run of the stack.
    pub const FIRST: Self = Self::Run(RunId(0));

    /// Whether the topic was read from the recording.
    pub fn is_recorded(self) -> bool {
        self == Self::Recorded
    }
}
