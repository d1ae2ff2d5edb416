//! `ocu sweep`.

use super::faults::FaultArgs;
use super::values::{Values, parse_seconds, parse_seed, parse_values};
use clap::Args;
use std::path::PathBuf;

/// `ocu sweep`
#[derive(Debug, Clone, Args)]
#[command(after_help = "Examples:\n  ocu sweep --stack truth_driver --course meadow --runs 20\n  \
                        ocu sweep --stack truth_driver --course corridor --record runs \\\n            \
                        --param truth_driver.vehicle_width_m=0.6..1.2:7 --runs 3\n  \
                        ocu sweep --stack range_camera --log drive.mcap \\\n            \
                        --param wm1.sources[0].weight=0.2,0.4,0.8\n\n\
                        Each line of the table can be repeated with ocu run, its parameters and its seed: the hash is \
                        the same. On the recording of a run, all runs have the parameters of the stack and of \
                        --param; others that the recorded run began with, or that were sent during it, are not in \
                        force, and a warning names their processes. Exit codes: 0 every run came to its end, whatever \
                        its outcome; 1 one could not; 2 the sweep was refused, or a file cannot be opened; 3 the recording is damaged.")]
pub struct SweepArgs {
    /// Stack to run: the name of a bundled one, or a .toml file
    #[arg(long, short, value_name = "STACK")]
    pub stack: String,
    /// Recording that the stack reads; of one that was split, the folder or the first file
    #[arg(long)]
    pub log: Option<PathBuf>,
    /// Further files of it, if it was split and the window has them by name.
    #[arg(skip)]
    pub parts: Vec<PathBuf>,
    /// Course that a simulation runs: the name of a bundled one, or a .toml file
    #[arg(long, short, value_name = "COURSE")]
    pub course: Option<String>,
    /// Values of a parameter, as process.field=V1,V2,… or process.field=FROM..TO:COUNT; may be given several times
    #[arg(long = "param", value_name = "P.F=VALUES", value_parser = parse_values)]
    pub params: Vec<Values>,
    /// What goes wrong on purpose, in every run.
    #[command(flatten)]
    pub faults: FaultArgs,
    /// Number of runs of each combination, with the seeds SEED, SEED + 1, …
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    pub runs: u32,
    /// First seed
    #[arg(long, default_value_t = 0, value_parser = parse_seed, allow_negative_numbers = true)]
    pub seed: u64,
    /// Time at which a run is stopped, in seconds from its start
    #[arg(long, value_name = "T", value_parser = parse_seconds, allow_negative_numbers = true)]
    pub until: Option<f64>,
    /// Folder to which each run is recorded. A recording has the external inputs only, so it is small; the rest is
    /// computed again when it is opened
    #[arg(long, value_name = "FOLDER")]
    pub record: Option<PathBuf>,
    /// Replace existing recordings
    #[arg(long, requires = "record")]
    pub force: bool,
    /// Number of runs at the same time; by default one for each core
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub jobs: Option<u16>,
    /// Print the result as JSON
    #[arg(long)]
    pub json: bool,
}
