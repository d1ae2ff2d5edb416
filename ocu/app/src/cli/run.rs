//! `ocu run`.

use super::faults::FaultArgs;
use super::values::{Param, Save, parse_param, parse_save, parse_seconds, parse_seed, parse_what};
use crate::remembered::{Remembered, parse_remembered};
use clap::Args;
use rcs_runtime::RecordWhat;
use std::path::PathBuf;
use std::sync::Arc;

/// `ocu run`
#[derive(Debug, Clone, Args)]
#[command(after_help = "Examples:\n  ocu run --stack range_camera --log drive.mcap --json\n  \
                        ocu run --stack my_stack.toml --log drive.mcap --record out.mcap --until 10 \\\n          \
                        --param wm1.sources[0].weight=0.4\n  \
                        ocu run --stack truth_driver --course meadow --runs 3 --json\n  \
                        ocu run --stack lagr --course meadow --fault wm1:frozen@10..12\n  \
                        ocu run --live --stack simulation --until 10 --record live.mcap\n  \
                        ocu run --replay live.mcap --json\n\n\
                        The result depends on the log, the stack, the parameters and the seed alone: \
                        the hash is the same on every run and for any number of threads. A live run depends on the \
                        computer, too; its recording repeats it with the same hash. A stack on the recording of a run has \
                        the parameters of the stack and of --param; others that the recorded run began with, or that \
                        were sent during it, are in force with --replay only, and a warning names their processes.\n\n\
                        --acts gives what an operator does, as a JSON list: [{\"at_s\": 1, \"buffer\": \
                        \"/operator/teleop\", \"message\": {\"speedMps\": 0.5}, \"every_s\": 0.05, \"until_s\": 3}]. \
                        Without until_s, it is repeated to the end of the run. A parameter that holds a file takes the \
                        text of the file here, and its path with --param.\n\n\
                        --fault makes something go wrong, and the run shows what comes of it: --fault wm1:frozen@10..12, \
                        --fault /localization/local:dropped=0.3@5, --fault faults.toml with entries [[fault]] of \
                        process or buffer, kind, from_s, to_s, delay_ms, every, probability, seed, field.\n\n\
                        Exit codes: 0 the run came to its end; 1 it failed, or a replay differs from its recording; 2 it \
                        was refused, or a file cannot be opened; 3 a recording that was read is damaged.")]
#[expect(clippy::struct_excessive_bools, reason = "each is an option of the command line")]
pub struct RunArgs {
    /// Stack to run: the name of a bundled one, or a .toml file
    #[arg(long, short, value_name = "STACK", required_unless_present = "replay")]
    pub stack: Option<String>,
    /// Recording that the stack reads; of one that was split, the folder or the first file
    #[arg(long)]
    pub log: Option<PathBuf>,
    /// Course that a simulation runs: the name of a bundled one, or a .toml file
    #[arg(long, short, value_name = "COURSE", requires = "stack")]
    pub course: Option<String>,
    /// Number of runs of the course, with the seeds SEED, SEED + 1, …; a stack that remembers is handed what the run
    /// before has learned (runs of ocu sweep --runs are independent)
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    pub runs: u32,
    /// File to record the run to; with --runs, a file for each run: drive-1.mcap, drive-2.mcap … for
    /// drive.mcap
    #[arg(long, value_name = "OUT")]
    pub record: Option<PathBuf>,
    /// What is recorded: all, journal (external inputs only; the rest is computed again when the recording is opened),
    /// or buffers, separated by commas
    #[arg(long, value_name = "WHAT", requires = "record", value_parser = parse_what)]
    pub record_what: Option<RecordWhat>,
    /// Replace existing files, with --record and --save
    #[arg(long)]
    pub force: bool,
    /// Continue the run when recording fails, as on a full disk
    #[arg(long, requires = "record")]
    pub keep_going: bool,
    /// Repeat a recorded run, and compare it with the recording; of one that was split, the folder or the first file. The
    /// log that the run read is found in the folder of the recording, or is named by --log
    #[arg(long, value_name = "FILE", conflicts_with_all = ["runs", "live", "acts", "faults"])]
    pub replay: Option<PathBuf>,
    /// Run in real time, with one thread per process
    #[arg(long, conflicts_with_all = ["runs", "log"])]
    pub live: bool,
    /// Actions of an operator during the run, a JSON file
    #[arg(long, value_name = "FILE")]
    pub acts: Option<PathBuf>,
    /// What goes wrong on purpose.
    #[command(flatten)]
    pub faults: FaultArgs,
    /// At the end, write the newest message of a buffer to a file, as JSON; may be given several times
    #[arg(long = "save", value_name = "BUFFER=FILE", value_parser = parse_save)]
    pub save: Vec<Save>,
    /// What an earlier run remembers, a file that the window saved: the run begins with it
    #[arg(long, value_name = "FILE", value_parser = parse_remembered, conflicts_with = "replay")]
    pub remembered: Option<Arc<Remembered>>,
    /// Seed of the run's random numbers, by default that of the recorded run that it reads, else 0
    #[arg(long, value_parser = parse_seed, allow_negative_numbers = true)]
    pub seed: Option<u64>,
    /// Parameter of a process, as process.field=value; may be given several times
    #[arg(long = "param", value_name = "P.F=V", value_parser = parse_param)]
    pub params: Vec<Param>,
    /// Time at which the run is stopped, in seconds from the start of the recording
    #[arg(long, value_name = "T", value_parser = parse_seconds, allow_negative_numbers = true)]
    pub until: Option<f64>,
    /// Fail where a process could use no message of an input, or wrote nothing, and where the run ended before a fault
    /// or an act
    #[arg(long)]
    pub fail_on_fault: bool,
    /// Threads that processes may share, all of the machine's by default; the result does not depend on it
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub threads: Option<u16>,
    /// Print the result as JSON
    #[arg(long)]
    pub json: bool,
}
