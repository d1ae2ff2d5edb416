//! The program `ocu`: its window and its command line.
//!
//! - [`cli`]: every flag, defined once.
//! - [`window`]: the window; [`render`] draws the same without one.
//! - [`run`], [`diff`], [`info`], [`plugins`], [`stack_tool`], [`sample`], [`eval`]: the commands.
//! - [`bundled`]: the files that come with the program; [`layout`], [`stacks`], [`assets`] read them.

pub mod assets;
pub mod bundled;
pub mod cli;
pub mod diff;
pub mod eval;
pub mod info;
pub mod layout;
pub mod offscreen;
pub mod open;
mod output;
pub mod past_args;
pub mod plugins;
pub mod render;
pub mod run;
mod runs;
pub mod sample;
pub mod stack_tool;
pub mod stacks;
mod table;
mod time;
pub mod window;

use cli::{Cli, Command};
use rcs_runtime::source::SourceError;
use rcs_runtime::{RunError, StackError};
use std::io::Write;

/// Program and version, for logs.
pub const BUILD: &str = concat!("ocu ", env!("CARGO_PKG_VERSION"));

/// Exit code of a run that failed.
pub const FAILED: u8 = 1;
/// Exit code of wrong usage: arguments, stacks and layouts that are refused before anything runs.
pub const USAGE: u8 = 2;

/// Something that was asked for in a wrong way.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct Usage(String);

/// An error of usage.
pub(crate) fn usage(text: impl Into<String>) -> anyhow::Error {
    Usage(text.into()).into()
}

/// An error with its causes, each said once: many errors of libraries name their cause themselves.
pub(crate) fn say(error: &anyhow::Error) -> String {
    let mut text = error.to_string();
    for cause in error.chain().skip(1).map(ToString::to_string) {
        if !text.contains(&cause) {
            text = format!("{text}: {cause}");
        }
    }
    text
}

/// Does what the command line says; gives the exit code. Errors are printed here, once.
pub fn main(cli: &Cli, out: &mut dyn Write, errors: &mut dyn Write) -> u8 {
    rcs_plugins::register();
    let result = match &cli.command {
        None => window::run(&cli.window).map(|()| true),
        Some(Command::Run(args)) => run::run(args, out),
        Some(Command::Diff(args)) => diff::diff(args, out),
        Some(Command::Info(args)) => info::info(args, out).map(|()| true),
        Some(Command::Render(args)) => render::render(args).map(|()| true),
        Some(Command::Sample(args)) => sample::sample(args).map(|()| true),
        Some(Command::Eval(command)) => eval::eval(command, out).map(|()| true),
        Some(Command::Plugins(args)) => plugins::plugins(args, out).map(|()| true),
        Some(Command::Stack(command)) => stack_tool::stack(command, out),
    };
    match result {
        Ok(true) => 0,
        Ok(false) => FAILED,
        // Whoever read the output has read enough: `ocu info … | head`.
        Err(error) if is_broken_pipe(&error) => 0,
        Err(error) => {
            // Where even this cannot be written, the exit code still tells.
            let _ = writeln!(errors, "error: {}", say(&error));
            code_of(&error)
        }
    }
}

fn is_broken_pipe(error: &anyhow::Error) -> bool {
    let of = |error: &std::io::Error| error.kind() == std::io::ErrorKind::BrokenPipe;
    error.chain().any(|cause| {
        let json = cause.downcast_ref::<serde_json::Error>();
        cause.downcast_ref().is_some_and(of)
            || json.is_some_and(|error| error.io_error_kind() == Some(std::io::ErrorKind::BrokenPipe))
    })
}

fn code_of(error: &anyhow::Error) -> u8 {
    let refused = error.chain().any(|cause| {
        cause.is::<Usage>()
            || cause.is::<StackError>()
            || cause.is::<layout::LayoutError>()
            || matches!(cause.downcast_ref(), Some(RunError::Stack(_)))
            || matches!(cause.downcast_ref(), Some(SourceError::Run(RunError::Stack(_))))
    });
    if refused { USAGE } else { FAILED }
}
