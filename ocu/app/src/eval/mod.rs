//! `ocu eval`: how good and how fast a method is, on the user's own data.

mod classify;
mod color;
mod npz;
mod segments;
mod stereo;
mod truth;

use crate::cli::EvalCommand;
use std::io::Write;

/// Prints the figures.
pub fn eval(command: &EvalCommand, out: &mut dyn Write) -> anyhow::Result<()> {
    match command {
        EvalCommand::Classify(args) => classify::classify(args, out),
        EvalCommand::Color(args) => color::color(args, out),
        EvalCommand::Stereo(args) => stereo::stereo(args, out),
    }
}
