//! `ocu stack` and `ocu plugins`.

use super::values::{Param, parse_param};
use clap::{Args, Subcommand};
use std::path::PathBuf;

pub(super) const STACK_EXAMPLE: &str = "Examples:\n  \
    ocu stack show simulation\n  \
    ocu stack check my_stack.toml --log drive.mcap";

/// Commands on stack files.
#[derive(Debug, Subcommand)]
pub enum StackCommand {
    /// Print the stack with its parts included, and the origin of each line
    #[command(after_help = "Example:\n  ocu stack show simulation")]
    Show(StackShowArgs),
    /// Report everything that a run would refuse, and warn of probable mistakes
    #[command(after_help = "Example:\n  ocu stack check my_stack.toml --log drive.mcap\n\n\
                            Exit codes: 0 a run would accept the stack, 1 a run would refuse it, 2 the stack or the \
                            recording cannot be opened, 3 a run would accept the stack, but the recording is damaged.")]
    Check(StackCheckArgs),
}

/// `ocu stack show`
#[derive(Debug, Clone, Args)]
pub struct StackShowArgs {
    /// Stack to show: the name of a bundled one, or a .toml file
    pub stack: String,
    /// Omit the origin of each line: prints a stack file that runs by itself
    #[arg(long)]
    pub plain: bool,
}

/// `ocu stack check`
#[derive(Debug, Clone, Args)]
pub struct StackCheckArgs {
    /// Stack to check: the name of a bundled one, or a .toml file
    pub stack: String,
    /// Recording that the stack is to read; of one that was split, the folder or the first file
    #[arg(long)]
    pub log: Option<PathBuf>,
    /// Course that a simulation runs: the name of a bundled one, or a .toml file
    #[arg(long, short, value_name = "COURSE")]
    pub course: Option<String>,
    /// Parameter of a process, as process.field=value; may be given several times
    #[arg(long = "param", value_name = "P.F=V", value_parser = parse_param)]
    pub params: Vec<Param>,
    /// Print the result as JSON
    #[arg(long)]
    pub json: bool,
}

/// `ocu plugins`
#[derive(Debug, Clone, Args)]
#[command(after_help = "Examples:\n  ocu plugins\n  ocu plugins stereo\n  ocu plugins --json")]
pub struct PluginsArgs {
    /// Plugin to describe in full
    pub name: Option<String>,
    /// Print the result as JSON
    #[arg(long)]
    pub json: bool,
}
