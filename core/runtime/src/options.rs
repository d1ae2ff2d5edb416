//! Options of a run.

use crate::history::PastOptions;

/// Options of a run.
#[derive(Clone, Debug)]
pub struct RunOptions {
    /// Seed of all random numbers.
    pub seed: u64,
    /// Number of threads on which processes compute.
    pub threads: usize,
    /// Whether to hash every buffer, which encodes every message.
    pub hash: bool,
    /// Program and version, for the recording.
    pub build: String,
    /// Identity of the log that the run reads, from its content; a stepped run determines it itself.
    pub log_identity: String,
    /// How much of its past a [`Session`](crate::Session) keeps, and where.
    pub past: PastOptions,
}

impl Default for RunOptions {
    fn default() -> Self {
        Self {
            seed: 0,
            threads: 1,
            hash: false,
            build: concat!("ocu ", env!("CARGO_PKG_VERSION")).to_owned(),
            log_identity: String::new(),
            past: PastOptions::default(),
        }
    }
}
