//! Why a run could not start, or could not go on.

/// Why a stack could not be made to run, or could not run on.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// The stack does not fit the plugins or the log.
    #[error(transparent)]
    Stack(#[from] crate::StackError),
    /// The log could not be read.
    #[error(transparent)]
    Log(#[from] rcs_log::LogError),
    /// A buffer could not be made.
    #[error(transparent)]
    Bus(#[from] rcs_bus::BusError),
    /// A message could not be written.
    #[error(transparent)]
    Write(#[from] rcs_bus::WriteError),
    /// A snapshot does not belong here, or could not be read back.
    #[error("snapshot: {0}")]
    Snapshot(String),
    /// What was asked for cannot be done.
    #[error("{0}")]
    Refused(String),
}
