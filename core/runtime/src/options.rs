//! How a stack is run.

use crate::history::PastOptions;

/// How a stack is run.
#[derive(Clone, Debug)]
pub struct RunOptions {
    /// Seed of every random number.
    pub seed: u64,
    /// Threads that processes compute on.
    pub threads: usize,
    /// Whether every buffer is hashed, which encodes every message.
    pub hash: bool,
    /// Program and version, for the log.
    pub build: String,
    /// Identity of the log that the run reads, by its content; a stepped run finds it out itself.
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
