//! What can go wrong with a log as a whole.
//!
//! Damage inside a log is not an error: it is counted in [`Lost`](crate::Lost) and told in the log's problems.

use std::io;
use std::path::PathBuf;

/// Why a log cannot be opened, read or written: what, where, and what was expected.
#[derive(Debug, thiserror::Error)]
pub enum LogError {
    /// The file cannot be opened.
    #[error("cannot open the log: {source}: {path}")]
    Open {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// The file that was to be written cannot be created.
    #[error("cannot write the recording: {source}: {path}")]
    Create {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// The file that was to be written is there already.
    #[error("the file exists already; expected a new one, or leave to replace it: {path}")]
    Exists {
        /// The file.
        path: PathBuf,
    },
    /// The file that was to be written is being written by another recorder.
    #[error("the file is being recorded to by another program or run: {path}")]
    Busy {
        /// The file.
        path: PathBuf,
    },
    /// The file does not begin as an MCAP log does.
    #[error("not an mcap log: expected it to begin with 89 4d 43 41 50 30 0d 0a, got {got}: {path}")]
    NotALog {
        /// The first bytes, in hexadecimal.
        got: String,
        /// The file.
        path: PathBuf,
    },
    /// The system refused to read bytes that were there when the log was opened.
    #[error("cannot read {length} bytes at byte {offset} of the log: {source}: {path}")]
    Read {
        /// First byte.
        offset: u64,
        /// How many bytes.
        length: u64,
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// A part of the log that was asked for by name is damaged.
    #[error("{what} at byte {offset}: expected {expected}, got {got}: {path}")]
    Damaged {
        /// Which part.
        what: String,
        /// Where it begins.
        offset: u64,
        /// What it should be.
        expected: String,
        /// What it is.
        got: String,
        /// The file.
        path: PathBuf,
    },
    /// Writing failed: the disk is full, say. What was flushed before stays readable; nothing more is written.
    #[error("cannot write the log after byte {offset}: {source}: {path}")]
    Write {
        /// How many bytes had been written.
        offset: u64,
        /// The file.
        path: PathBuf,
        /// What the system or the format said.
        source: io::Error,
    },
    /// The writer was given something that a log cannot hold.
    #[error("the log cannot hold {what}: expected {expected}, got {got}")]
    Refused {
        /// What was given.
        what: &'static str,
        /// What it may be.
        expected: String,
        /// What it was.
        got: String,
    },
}
