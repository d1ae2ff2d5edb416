//! Errors that concern a log as a whole.
//!
//! Damage inside of a log is not an error: [`Lost`](crate::Lost) counts it, and the log's problems describe it.

use std::io;
use std::path::PathBuf;

/// Why a log cannot be opened, read or written.
#[derive(Debug, thiserror::Error)]
pub enum LogError {
    /// The file cannot be opened.
    #[error("cannot open the log: {source}: {path}")]
    Open {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: io::Error,
    },
    /// The output file cannot be created.
    #[error("cannot write the recording: {source}: {path}")]
    Create {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: io::Error,
    },
    /// The output file exists already.
    #[error("the file exists already; expected the name of a new file: {path}")]
    Exists {
        /// The file.
        path: PathBuf,
    },
    /// Another recorder is writing the output file.
    #[error("the file is being recorded to by another program or run: {path}")]
    Busy {
        /// The file.
        path: PathBuf,
    },
    /// The file does not begin like an MCAP log.
    #[error("not an mcap log: got {got}; expected a recording in the format mcap: {path}")]
    NotALog {
        /// What the file is, in words.
        got: String,
        /// The file.
        path: PathBuf,
    },
    /// The system refused to read bytes that were there when the log was opened.
    #[error("cannot read {length} bytes at byte {offset} of the log: {source}: {path}")]
    Read {
        /// First byte.
        offset: u64,
        /// Number of bytes.
        length: u64,
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: io::Error,
    },
    /// A requested part of the log is damaged.
    #[error("{what} at byte {offset}: expected {expected}, got {got}: {path}")]
    Damaged {
        /// Which part.
        what: String,
        /// Offset of its start.
        offset: u64,
        /// The expected value.
        expected: String,
        /// The value found.
        got: String,
        /// The file.
        path: PathBuf,
    },
    /// Writing failed, for example because the disk is full. Data flushed before remain readable; nothing more is
    /// written.
    #[error("cannot write the log after byte {offset}: {source}: {path}")]
    Write {
        /// Number of bytes written before.
        offset: u64,
        /// The file.
        path: PathBuf,
        /// The error of the system or the format.
        source: io::Error,
    },
    /// The writer got something that a log cannot hold.
    #[error("the log cannot hold {what}: expected {expected}, got {got}")]
    Refused {
        /// What it got.
        what: &'static str,
        /// The accepted values.
        expected: String,
        /// The value.
        got: String,
    },
}
