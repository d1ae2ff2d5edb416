//! The command line: all flags, each defined once.

mod eval;
mod faults;
mod recording;
mod run;
mod stack;
mod sweep;
mod table;
mod tune;
mod values;

pub use eval::{
    EvalClassifyArgs, EvalColorArgs, EvalCommand, EvalObstaclesArgs, EvalPlanArgs, EvalStereoArgs,
    StereoMethod,
};
pub use faults::FaultArgs;
pub use recording::{CheckArgs, CutArgs, DiffArgs, InfoArgs, LatencyArgs, RenderArgs, SampleArgs};
pub use run::RunArgs;
pub use stack::{PluginsArgs, StackCheckArgs, StackCommand, StackShowArgs};
pub use sweep::SweepArgs;
pub use table::{ExportArgs, GraphArgs, GraphFormat};
pub use tune::TuneArgs;
pub(crate) use values::parse_values;
pub use values::{Param, Save, Size, Values};

use crate::past_args::PastArgs;
use crate::remembered::{Remembered, parse_remembered};
use crate::usage;
use clap::{Args, Parser, Subcommand, ValueEnum};
use eval::EVAL_EXAMPLE;
use stack::STACK_EXAMPLE;
use std::path::PathBuf;
use std::sync::Arc;
use values::parse_seed;

/// The program's arguments.
#[derive(Debug, Parser)]
#[command(
    name = "ocu",
    version,
    about = "Operator control unit and diagnostics tool for 4D/RCS robots",
    args_conflicts_with_subcommands = true,
    after_help = "Examples:\n  ocu                                   open a simulated robot; Play sends it to its goal\n  \
                  ocu --course hill                     drive on another course\n  \
                  ocu drive.mcap                        look at a recording\n  \
                  ocu drive.mcap --stack range_camera   run a stack on it and step both ways\n  \
                  ocu info drive.mcap                   say what it holds\n\n\
                  Exit codes: 0 success, 1 the run failed or recordings differ, 2 wrong usage or a file that cannot be \
                  opened, 3 a recording that was read is damaged."
)]
pub struct Cli {
    /// What to do; by default the window is opened.
    #[command(subcommand)]
    pub command: Option<Command>,
    /// Arguments of the window.
    #[command(flatten)]
    pub window: WindowArgs,
}

/// The commands without a window.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Run a stack to its end, without a window
    Run(RunArgs),
    /// Run a stack for every combination of parameter values and seeds, on all cores
    Sweep(SweepArgs),
    /// Compare two recordings and report the first difference
    Diff(DiffArgs),
    /// Show what a recording contains, and what of it was lost
    Info(InfoArgs),
    /// Check a recording: its index, its checksums and every message
    Check(CheckArgs),
    /// Write a range of a recording to a new one
    Cut(CutArgs),
    /// Write fields of a recording as a table (CSV or Parquet)
    Export(ExportArgs),
    /// Print who supervises whom and who reads whose data, of a stack or a recording
    Graph(GraphArgs),
    /// Say how old the messages of a recording were when they became visible
    Latency(LatencyArgs),
    /// Draw a layout at a time as a PNG, or over a time as a GIF; needs no display
    Render(RenderArgs),
    /// Record a short simulated drive, for a first look
    Sample(SampleArgs),
    /// Learn the weights of a world model from a drive
    Tune(TuneArgs),
    /// Measure a method on your own data
    #[command(subcommand, after_help = EVAL_EXAMPLE)]
    Eval(EvalCommand),
    /// List the plugins, or the ports, parameters and commands of one
    Plugins(PluginsArgs),
    /// Show a stack with its parts included, or check it
    #[command(subcommand, after_help = STACK_EXAMPLE)]
    Stack(StackCommand),
}

/// `ocu [LOG]`
#[derive(Debug, Clone, Default, Args)]
pub struct WindowArgs {
    /// Recording to open: a file, or the folder or the first file of a recording that was split; or a stack (.toml), a
    /// layout (.ron), or what a run remembers (.json)
    pub log: Option<PathBuf>,
    /// Further files of the same recording
    #[arg(value_name = "PART")]
    pub parts: Vec<PathBuf>,
    /// Stack to run on it: the name of a bundled one, or a .toml file
    #[arg(long, short, value_name = "STACK")]
    pub stack: Option<String>,
    /// Course that a simulation runs: the name of a bundled one, or a .toml file
    #[arg(long, short, value_name = "COURSE")]
    pub course: Option<String>,
    /// What an earlier run remembers, a file that the window saved: the stack begins with it
    #[arg(long, value_name = "FILE", value_parser = parse_remembered)]
    pub remembered: Option<Arc<Remembered>>,
    /// Seed of the random numbers, by default that of the recorded run that the stack reads, else 0
    #[arg(long, value_parser = parse_seed, allow_negative_numbers = true)]
    pub seed: Option<u64>,
    /// Layout to start with, as you last arranged it: the name of a bundled one, of one that you keep, or a .ron file
    #[arg(long, short, value_name = "LAYOUT")]
    pub layout: Option<String>,
    /// Graphics API of the window; by default wgpu, or glow if the only graphics adapter is a software one
    #[arg(long, value_enum)]
    pub renderer: Option<Renderer>,
    /// Limits of the history kept of a run
    #[command(flatten)]
    pub past: PastArgs,
}

impl WindowArgs {
    /// Refuses arguments that would have no effect.
    pub(crate) fn check(&self) -> anyhow::Result<()> {
        if self.remembered.is_some() && self.log.is_some() && self.stack.is_none() {
            return Err(usage(
                "--remembered: expected --stack, too, because a recording alone runs nothing that could remember",
            ));
        }
        Ok(())
    }
}

/// Graphics API of the window.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Renderer {
    /// Vulkan, through wgpu
    Wgpu,
    /// OpenGL, through glow
    Glow,
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn definitions_are_consistent_and_every_command_has_an_example() {
        let mut command = Cli::command();
        command.build();
        command.clone().debug_assert();
        for sub in command.get_subcommands().filter(|sub| sub.get_name() != "help") {
            let help = sub.get_after_help().map(ToString::to_string).unwrap_or_default();
            assert!(help.contains("Example"), "{} has no example", sub.get_name());
            for arg in sub.get_arguments() {
                assert!(arg.get_help().is_some(), "{} {} has no help", sub.get_name(), arg.get_id());
            }
        }
    }

    #[test]
    fn a_log_alone_opens_the_window_and_a_command_takes_its_own_arguments() {
        let cli = Cli::try_parse_from(["ocu", "drive.mcap", "--stack", "sample"]).unwrap();
        assert!(cli.command.is_none());
        assert_eq!(cli.window.stack.as_deref(), Some("sample"));
        let cli = Cli::try_parse_from(["ocu", "info", "drive.mcap", "--json"]).unwrap();
        assert!(matches!(cli.command, Some(Command::Info(InfoArgs { json: true, .. }))));
        assert!(Cli::try_parse_from(["ocu", "render", "--layout", "default"]).is_err());
    }

    #[test]
    fn a_negative_number_is_refused_with_the_range_of_its_flag() {
        let refused = |args: &[&str]| Cli::try_parse_from([&["ocu"], args].concat()).unwrap_err().to_string();
        let run = refused(&["run", "--stack", "lagr", "--until", "-1"]);
        assert!(run.contains("expected seconds from 0 to 1.8e10, got \"-1\""), "{run}");
        for args in [&["--seed", "-1"][..], &["run", "--stack", "lagr", "--seed", "-1"]] {
            let seed = refused(args);
            assert!(seed.contains("expected a whole number from 0 to"), "{seed}");
        }
    }

    #[test]
    fn what_a_run_remembers_needs_a_stack_that_runs() {
        let check = |log: Option<&str>, stack: Option<&str>| {
            let (log, stack) = (log.map(PathBuf::from), stack.map(str::to_owned));
            let remembered = Some(Arc::default());
            WindowArgs { log, stack, remembered, ..WindowArgs::default() }.check()
        };
        assert!(check(None, None).is_ok(), "the simulation");
        assert!(check(Some("a.mcap"), Some("lagr")).is_ok());
        let refused = check(Some("a.mcap"), None).unwrap_err();
        assert!(refused.is::<crate::Usage>() && refused.to_string().contains("--stack"), "{refused}");
    }
}
