//! Commands on recordings: `ocu info`, `ocu check`, `ocu latency`, `ocu diff`, `ocu cut`, `ocu render`, `ocu sample`.

use super::values::{Size, parse_duration, parse_seconds, parse_seed, parse_size};
use clap::Args;
use std::path::PathBuf;

/// `ocu diff`
#[derive(Debug, Clone, Args)]
#[command(after_help = "Example:\n  ocu diff one.mcap other.mcap --all\n\n\
                        Messages are compared by buffer and number, from where both recordings are complete up to the \
                         end of the shorter one; measured time is left out. Recordings without a common time or buffer \
                         are not compared. What the recordings say of their runs (stack, parameters, seed, build) is \
                         told first. Recordings of the journal alone are refused. Exit codes: 0 the recordings agree, \
                         1 they differ, one begins later or is shorter, or they are not compared, 2 one cannot be \
                         opened, 3 they agree as far as they can be read, but one is damaged.")]
pub struct DiffArgs {
    /// Recording; of one that was split, the folder or the first file
    pub first: PathBuf,
    /// Recording with which it is compared; of one that was split, the folder or the first file
    pub second: PathBuf,
    /// Tell the first difference of each buffer, not only the first of all, and more than 20 different parameters
    #[arg(long)]
    pub all: bool,
    /// Print the result as JSON
    #[arg(long)]
    pub json: bool,
}

/// `ocu info`
#[derive(Debug, Clone, Args)]
#[command(after_help = "Example:\n  ocu info drive.mcap --json")]
pub struct InfoArgs {
    /// Recording to describe; of one that was split, the folder or the first file
    pub log: PathBuf,
    /// Print the result as JSON
    #[arg(long)]
    pub json: bool,
}

/// `ocu check`
#[derive(Debug, Clone, Args)]
#[command(after_help = "Example:\n  ocu check drive.mcap --json\n\n\
                        Checked are the checksums of chunks, attachments, index and data, counts, times, message \
                        indexes, and every message by its schema. Exit codes: 0 the recording is sound, 2 it cannot \
                        be opened, 3 something is wrong with it.")]
pub struct CheckArgs {
    /// Recording to check; of one that was split, the folder or the first file
    pub log: PathBuf,
    /// Print the result as JSON
    #[arg(long)]
    pub json: bool,
}

/// `ocu latency`
#[derive(Debug, Clone, Args)]
#[command(after_help = "Example:\n  ocu latency run.mcap --json")]
pub struct LatencyArgs {
    /// Recording of a run; of one that was split, the folder or the first file
    pub log: PathBuf,
    /// Print the result as JSON
    #[arg(long)]
    pub json: bool,
}

/// `ocu render`
#[derive(Debug, Clone, Args)]
#[command(
    after_help = "Example:\n  ocu render drive.mcap --stack range_camera --layout default --at 12.5 \\\n    \
                        --size 1600x900 -o picture.png\n  \
                        ocu render drive.mcap --at 2 --to 30 --speed 4 --size 800x450 -o drive.gif"
)]
pub struct RenderArgs {
    /// Recording to draw; of one that was split, the folder or the first file
    #[arg(required_unless_present = "stack")]
    pub log: Option<PathBuf>,
    /// Stack to run on it: the name of a bundled one, or a .toml file
    #[arg(long, short, value_name = "STACK")]
    pub stack: Option<String>,
    /// Course that a simulation runs: the name of a bundled one, or a .toml file
    #[arg(long, short, value_name = "COURSE")]
    pub course: Option<String>,
    /// Seed of the random numbers, by default that of the recorded run that the stack reads, else 0
    #[arg(long, value_parser = parse_seed, allow_negative_numbers = true)]
    pub seed: Option<u64>,
    /// Layout to draw: the name of a bundled one, as it comes, of one that you keep, or a .ron file; without it, the
    /// one that fits the source, or with --against the view Compare
    #[arg(long, short, value_name = "LAYOUT")]
    pub layout: Option<String>,
    /// Recording to compare with, for the view Compare; of one that was split, the folder or the first file
    #[arg(long, value_name = "FILE")]
    pub against: Option<PathBuf>,
    /// Time to draw, in seconds from the start of the recording
    #[arg(long, value_name = "T", value_parser = parse_seconds, allow_negative_numbers = true)]
    pub at: f64,
    /// End of an animation that begins at --at, in seconds from the start of the recording; the output is a GIF
    #[arg(long, value_name = "T", value_parser = parse_seconds, allow_negative_numbers = true)]
    pub to: Option<f64>,
    /// Time between two pictures of an animation, in seconds
    #[arg(
        long,
        value_name = "S",
        default_value = "0.5",
        value_parser = parse_seconds,
        requires = "to",
        allow_negative_numbers = true,
    )]
    pub every: f64,
    /// Speed of an animation: with 4, four seconds of the recording take one
    #[arg(
        long,
        value_name = "X",
        default_value = "1",
        value_parser = parse_seconds,
        requires = "to",
        allow_negative_numbers = true,
    )]
    pub speed: f64,
    /// Size of the image in pixels: 1600x900
    #[arg(long, value_name = "WxH", value_parser = parse_size)]
    pub size: Size,
    /// File to write: a PNG, or with --to a GIF
    #[arg(short, long, value_name = "FILE")]
    pub output: PathBuf,
    /// Replace an existing file
    #[arg(long)]
    pub force: bool,
    /// Use the light theme
    #[arg(long)]
    pub light: bool,
}

/// `ocu cut`
#[derive(Debug, Clone, Args)]
#[command(after_help = "Example:\n  ocu cut drive.mcap --from 12.5 --to 20 -o part.mcap\n\n\
                        Messages are copied byte for byte. What the range needs from before its start (transforms, \
                        calibrations, parameters, the map) is carried to its start. A part that begins \
                        later lacks the beginning of its run: ocu run --replay refuses it.")]
pub struct CutArgs {
    /// Recording to cut; of one that was split, the folder or the first file
    pub log: PathBuf,
    /// Start of the range, in seconds from the start of the recording
    #[arg(
        long,
        value_name = "T",
        default_value = "0",
        value_parser = parse_seconds,
        allow_negative_numbers = true,
    )]
    pub from: f64,
    /// End of the range, in seconds from the start of the recording; by default its end
    #[arg(long, value_name = "T", value_parser = parse_seconds, allow_negative_numbers = true)]
    pub to: Option<f64>,
    /// File to write
    #[arg(short, long, value_name = "LOG")]
    pub output: PathBuf,
    /// Replace an existing file
    #[arg(long)]
    pub force: bool,
}

/// `ocu sample`
#[derive(Debug, Clone, Args)]
#[command(after_help = "Example:\n  ocu sample drive.mcap && ocu drive.mcap --stack sample")]
pub struct SampleArgs {
    /// File to write
    pub path: PathBuf,
    /// Length of the recording in seconds
    #[arg(
        long,
        value_name = "T",
        default_value = "20",
        value_parser = parse_duration,
        allow_negative_numbers = true,
    )]
    pub duration: f64,
    /// Replace an existing file
    #[arg(long)]
    pub force: bool,
}
