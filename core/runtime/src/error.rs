//! Why a run cannot start or continue.

/// Why a run cannot start or continue.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// The stack does not fit the plugins or the log.
    #[error(transparent)]
    Stack(#[from] crate::StackError),
    /// The log does not have the topics that the stack reads, one error for each of them.
    #[error("{}", lines(.0))]
    Inputs(Vec<crate::StackError>),
    /// The log could not be read.
    #[error(transparent)]
    Log(#[from] rcs_log::LogError),
    /// A buffer could not be created.
    #[error(transparent)]
    Bus(#[from] rcs_bus::BusError),
    /// A message could not be written.
    #[error(transparent)]
    Write(#[from] rcs_bus::WriteError),
    /// A snapshot does not belong to this run, or could not be read.
    #[error("snapshot: {0}")]
    Snapshot(String),
    /// The request cannot be fulfilled.
    #[error("{0}")]
    Refused(String),
}

/// One error a line.
fn lines(errors: &[crate::StackError]) -> String {
    errors.iter().map(ToString::to_string).collect::<Vec<_>>().join("\n")
}
