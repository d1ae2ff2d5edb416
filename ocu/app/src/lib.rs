//! The program `ocu`: an operator control unit and diagnostics tool, with its window and its command line.
//!
//! This crate puts sources, views and plugins together. Algorithms are in the plugins, and each view is in `ocu-views`;
//! nothing here depends on a particular one of them.
//!
//! # Where to begin
//!
//! - [`main`](fn@main) executes a command line.
//! - [`cli`]: all flags, each defined once.
//! - [`window`]: the window; [`render`] draws the same contents without one.
//! - [`run`], [`diff`], [`info`], [`check`], [`export`], [`graph`], [`latency`], [`plugins`], [`stack_tool`], [`sample`], [`sweep`], [`tune`],
//!   [`eval`]: the commands.
//! - [`bundled`]: the files that are compiled in; [`layout`], [`stacks`], [`assets`] read them.
//!
//! # Example
//!
//! ```
//! use clap::Parser as _;
//! use ocu_app::cli::Cli;
//!
//! let cli = Cli::parse_from(["ocu", "plugins", "world_model"]);
//! let (mut out, mut errors) = (Vec::new(), Vec::new());
//! assert_eq!(ocu_app::main(&cli, &mut out, &mut errors), 0);
//! assert!(String::from_utf8(out).unwrap().contains("world_model"));
//! ```

mod asked;
pub mod assets;
pub mod bundled;
pub mod check;
pub mod cli;
mod comparison;
pub mod cut;
pub mod diff;
pub mod eval;
pub mod export;
pub mod graph;
pub mod info;
mod kept_layouts;
pub mod latency;
pub mod layout;
mod layout_fit;
mod nearest;
pub mod offscreen;
pub mod open;
mod output;
mod parquet;
mod parts;
pub mod past_args;
mod plain;
pub mod plugins;
pub mod remembered;
pub mod render;
pub mod run;
mod runs;
pub mod sample;
pub mod stack_edit;
pub mod stack_tool;
mod stack_warnings;
pub mod stacks;
pub mod sweep;
mod table;
mod time;
pub mod tune;
pub mod window;

use cli::{Cli, Command};
use rcs_eval::EvalError;
use rcs_log::LogError;
use rcs_runtime::source::SourceError;
use rcs_runtime::{RunError, StackError};
use std::io::Write;

/// Program and version, as written to logs.
pub const BUILD: &str = concat!("ocu ", env!("CARGO_PKG_VERSION"));

/// Exit code of a run that failed.
pub const FAILED: u8 = 1;
/// Exit code of wrong usage: arguments, stacks or layouts that are refused before anything runs, and files that cannot be
/// opened.
pub const USAGE: u8 = 2;

/// Exit code of a command that succeeded on a partly damaged recording.
pub const DAMAGED: u8 = 3;

/// Result of a command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ended {
    /// Success.
    Well,
    /// What was run or compared failed; the reason has been printed.
    Failed,
    /// Success, but a recording is damaged: the result covers only what could be read.
    Damaged,
}

impl Ended {
    /// The result of a command that has read a recording as far as it could be read.
    pub(crate) fn after(log: Option<&rcs_log::Log>) -> Self {
        if log.and_then(run::LogDamage::of).is_none() {
            return Self::Well;
        }
        tracing::warn!(
            "the recording is damaged, and the result is of what could be read; ocu check says where"
        );
        Self::Damaged
    }
}

/// Standard output, which records whether its reader has closed it.
struct Output<'a> {
    out: &'a mut dyn Write,
    closed: bool,
}

impl Output<'_> {
    fn note<T>(&mut self, result: std::io::Result<T>) -> std::io::Result<T> {
        let broken = |error: &std::io::Error| error.kind() == std::io::ErrorKind::BrokenPipe;
        self.closed |= result.as_ref().is_err_and(broken);
        // The text of the system does not say what could not be written.
        let told = |error: std::io::Error| format!("cannot write to standard output: {error}");
        result.map_err(|error| std::io::Error::new(error.kind(), told(error)))
    }
}

impl Write for Output<'_> {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        let result = self.out.write(bytes);
        self.note(result)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        let result = self.out.flush();
        self.note(result)
    }
}

/// Wrong usage.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct Usage(String);

/// A usage error.
pub(crate) fn usage(text: impl Into<String>) -> anyhow::Error {
    Usage(text.into()).into()
}

/// The text of an error with its causes, without repetition: errors of many libraries already contain their causes.
pub(crate) fn say(error: &anyhow::Error) -> String {
    let mut text = error.to_string();
    for cause in error.chain().skip(1).map(ToString::to_string) {
        if !text.contains(&cause) {
            text = format!("{text}: {cause}");
        }
    }
    plain::plain_lines(&text)
}

/// Executes a command line; returns the exit code. This is the only place where errors are printed.
pub fn main(cli: &Cli, out: &mut dyn Write, errors: &mut dyn Write) -> u8 {
    rcs_plugins::register();
    let mut output = Output { out, closed: false };
    let out = &mut output;
    let result = match &cli.command {
        None => window::run(&cli.window).map(|()| Ended::Well),
        Some(Command::Run(args)) => run::run(args, out),
        Some(Command::Diff(args)) => diff::diff(args, out),
        Some(Command::Info(args)) => info::info(args, out),
        Some(Command::Check(args)) => check::check(args, out),
        Some(Command::Cut(args)) => cut::cut(args, out),
        Some(Command::Export(args)) => export::export(args, out),
        Some(Command::Graph(args)) => graph::graph(args, out),
        Some(Command::Latency(args)) => latency::latency(args, out),
        Some(Command::Render(args)) => render::render(args),
        Some(Command::Sample(args)) => sample::sample(args).map(|()| Ended::Well),
        Some(Command::Eval(command)) => eval::eval(command, out),
        Some(Command::Tune(args)) => tune::tune(args, out),
        Some(Command::Plugins(args)) => plugins::plugins(args, out).map(|()| Ended::Well),
        Some(Command::Sweep(args)) => sweep::sweep(args, out),
        Some(Command::Stack(command)) => stack_tool::stack(command, out),
    };
    match result {
        Ok(Ended::Well) => 0,
        Ok(Ended::Failed) => FAILED,
        Ok(Ended::Damaged) => DAMAGED,
        // The reader of the output has closed it, as in `ocu info … | head`. A broken pipe of anything else is an
        // error.
        Err(error) if output.closed && is_broken_pipe(&error) => 0,
        Err(error) => {
            // If this cannot be written either, the exit code still reports the error.
            let _ = writeln!(errors, "error: {}", say(&error));
            code_of(&error)
        }
    }
}

/// Result of a command after its output was printed; an output closed by its reader is not an error.
pub(crate) fn despite_closed_output(printed: anyhow::Result<()>) -> anyhow::Result<()> {
    match printed {
        Err(error) if is_broken_pipe(&error) => Ok(()),
        other => other,
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

/// Whether a recording cannot be opened, or was refused before anything was written.
fn is_refused(error: &LogError) -> bool {
    matches!(
        error,
        LogError::Open { .. } | LogError::NotALog { .. } | LogError::Exists { .. } | LogError::Busy { .. }
    )
}

fn code_of(error: &anyhow::Error) -> u8 {
    let refused = error.chain().any(|cause| {
        cause.is::<Usage>()
            || cause.is::<StackError>()
            || cause.is::<layout::LayoutError>()
            || cause.downcast_ref().is_some_and(is_refused)
            || matches!(cause.downcast_ref(), Some(EvalError::Read { .. }))
            || matches!(cause.downcast_ref(), Some(RunError::Log(error)) if is_refused(error))
            || matches!(cause.downcast_ref(), Some(RunError::Stack(_) | RunError::Inputs(_)))
            || matches!(
                cause.downcast_ref(),
                Some(SourceError::Run(RunError::Stack(_) | RunError::Inputs(_)))
            )
    });
    if refused { USAGE } else { FAILED }
}
