//! Logs of other programs and our own, sound and damaged.

#![allow(clippy::unwrap_used, reason = "a test fails by a panic")]

mod common;
mod conformance;
mod damage;
mod order;
mod recording;
mod sound;
mod split;
mod writing;
