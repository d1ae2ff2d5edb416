//! Errors of evaluations.

use rcs_log::LogError;
use rcs_runtime::RunError;
use std::error::Error;
use std::path::{Path, PathBuf};

/// Why an evaluation failed.
#[derive(Debug, thiserror::Error)]
pub enum EvalError {
    /// The arguments contradict each other; nothing was evaluated.
    #[error("{0}")]
    Refused(String),
    /// A file could not be read.
    #[error("cannot read {}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        source: Box<dyn Error + Send + Sync>,
    },
    /// The method refuses an image.
    #[error("cannot use {}", path.display())]
    Unusable {
        /// The image.
        path: PathBuf,
        /// Why.
        source: Box<dyn Error + Send + Sync>,
    },
    /// The stack cannot run.
    #[error("the stack cannot run")]
    Start(#[source] RunError),
    /// The run of the stack failed.
    #[error(transparent)]
    Run(#[from] RunError),
    /// The recording could not be read.
    #[error(transparent)]
    Log(#[from] LogError),
    /// The input contains nothing to evaluate.
    #[error("{0}")]
    Nothing(String),
}

impl EvalError {
    pub(crate) fn refused(text: impl Into<String>) -> EvalError {
        EvalError::Refused(text.into())
    }

    pub(crate) fn nothing(text: impl Into<String>) -> EvalError {
        EvalError::Nothing(text.into())
    }

    pub(crate) fn read(path: &Path, source: impl Into<Box<dyn Error + Send + Sync>>) -> EvalError {
        EvalError::Read { path: path.to_owned(), source: source.into() }
    }

    pub(crate) fn unusable(path: &Path, source: impl Into<Box<dyn Error + Send + Sync>>) -> EvalError {
        EvalError::Unusable { path: path.to_owned(), source: source.into() }
    }
}
