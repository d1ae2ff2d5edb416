//! The command line: every flag is defined here, once.

use crate::past_args::PastArgs;
use clap::{Args, Parser, Subcommand, ValueEnum};
use rcs_runtime::RecordWhat;
use std::path::PathBuf;

/// The program's arguments.
#[derive(Debug, Parser)]
#[command(
    name = "ocu",
    version,
    about = "Operator control unit and diagnostics tool for 4D/RCS robots",
    args_conflicts_with_subcommands = true,
    after_help = "Examples:\n  ocu                                   drive in the simulation\n  \
                  ocu --course hill                     drive on another course\n  \
                  ocu drive.mcap                        look at a recording\n  \
                  ocu drive.mcap --stack range_camera   run a stack on it and step both ways\n  \
                  ocu info drive.mcap                   say what it holds\n\n\
                  Exit codes: 0 success, 1 the run failed, 2 wrong usage."
)]
pub struct Cli {
    /// What to do; without one, the window opens.
    #[command(subcommand)]
    pub command: Option<Command>,
    /// Arguments of the window.
    #[command(flatten)]
    pub window: WindowArgs,
}

/// The commands beside the window.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Run a stack to its end, without a window
    Run(RunArgs),
    /// Say whether two recordings agree, and where they first do not
    Diff(DiffArgs),
    /// Say what a recording holds, and what of it was lost
    Info(InfoArgs),
    /// Draw a layout at a time into a PNG; needs no display
    Render(RenderArgs),
    /// Record a small simulated drive to look at
    Sample(SampleArgs),
    /// Measure a method on your own data
    #[command(subcommand, after_help = EVAL_EXAMPLE)]
    Eval(EvalCommand),
    /// List the plugins, or the ports, parameters and commands of one
    Plugins(PluginsArgs),
    /// Show a stack with its parts in place, or check it
    #[command(subcommand, after_help = STACK_EXAMPLE)]
    Stack(StackCommand),
}

const STACK_EXAMPLE: &str = "Examples:\n  \
    ocu stack show simulation\n  \
    ocu stack check my_stack.toml --log drive.mcap";

/// What can be done with a stack file.
#[derive(Debug, Subcommand)]
pub enum StackCommand {
    /// Print the stack with every part in its place, and where each line came from
    #[command(after_help = "Example:\n  ocu stack show simulation")]
    Show(StackShowArgs),
    /// Find everything that a run would refuse, and warn of what is probably not meant
    #[command(after_help = "Example:\n  ocu stack check my_stack.toml --log drive.mcap")]
    Check(StackCheckArgs),
}

/// `ocu stack show`
#[derive(Debug, Clone, Args)]
pub struct StackShowArgs {
    /// Stack to show: the name of a bundled one, or a .toml file
    pub stack: String,
    /// Without where each line came from: a stack file that runs by itself
    #[arg(long)]
    pub plain: bool,
}

/// `ocu stack check`
#[derive(Debug, Clone, Args)]
pub struct StackCheckArgs {
    /// Stack to check: the name of a bundled one, or a .toml file
    pub stack: String,
    /// Recording that it is to read
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
    /// Plugin to tell everything about
    pub name: Option<String>,
    /// Print the result as JSON
    #[arg(long)]
    pub json: bool,
}

const EVAL_EXAMPLE: &str = "Examples:\n  \
    ocu eval stereo --left left.png --right right.png --truth disparity.pfm\n  \
    ocu eval color --image path_*.png --labels labels_*.png --ground-ids 1,4";

/// The methods that can be measured.
#[derive(Debug, Subcommand)]
pub enum EvalCommand {
    /// Disparities of a pair of images: quality against a truth, density and time
    Stereo(EvalStereoArgs),
    /// Colour models of ground and background: quality against labelled images, and time
    Color(EvalColorArgs),
    /// Label images of a recording, or of a stack that runs on it, against true ones
    Classify(EvalClassifyArgs),
}

/// `ocu [LOG]`
#[derive(Debug, Clone, Default, Args)]
pub struct WindowArgs {
    /// Recording to open
    pub log: Option<PathBuf>,
    /// Stack to run on it: the name of a bundled one, or a .toml file
    #[arg(long, short, value_name = "STACK")]
    pub stack: Option<String>,
    /// Course that a simulation runs: the name of a bundled one, or a .toml file
    #[arg(long, short, value_name = "COURSE")]
    pub course: Option<String>,
    /// Seed of the random numbers
    #[arg(long, default_value_t = 0)]
    pub seed: u64,
    /// Layout to start with: the name of a bundled one, or a .ron file
    #[arg(long, short, value_name = "LAYOUT")]
    pub layout: Option<String>,
    /// What draws the window; by default wgpu, or glow where the only graphics adapter is a software one
    #[arg(long, value_enum)]
    pub renderer: Option<Renderer>,
    /// How much of its past a run keeps
    #[command(flatten)]
    pub past: PastArgs,
}

/// What draws the window.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Renderer {
    /// Vulkan, through wgpu
    Wgpu,
    /// OpenGL, through glow
    Glow,
}

/// `ocu run`
#[derive(Debug, Clone, Args)]
#[command(after_help = "Examples:\n  ocu run --stack range_camera --log drive.mcap --json\n  \
                        ocu run --stack my_stack.toml --log drive.mcap --record out.mcap --until 10 \\\n          \
                        --param wm1.sources[0].weight=0.4\n  \
                        ocu run --stack truth_driver --course meadow --runs 3 --json\n  \
                        ocu run --live --stack simulation --until 10 --record live.mcap\n  \
                        ocu run --replay live.mcap --json\n\n\
                        The result depends on the log, the stack, the parameters and the seed alone: \
                        the hash is the same on every run and for any number of threads. A live run depends on the \
                        computer, too; its recording repeats it with the same hash.\n\n\
                        --acts gives what an operator does, as a JSON list: [{\"at_s\": 1, \"buffer\": \
                        \"/operator/teleop\", \"message\": {\"speedMps\": 0.5}, \"every_s\": 0.05, \"until_s\": 3}].")]
pub struct RunArgs {
    /// Stack to run: the name of a bundled one, or a .toml file
    #[arg(long, short, value_name = "STACK", required_unless_present = "replay")]
    pub stack: Option<String>,
    /// Recording that it reads
    #[arg(long)]
    pub log: Option<PathBuf>,
    /// Course that a simulation runs: the name of a bundled one, or a .toml file
    #[arg(long, short, value_name = "COURSE")]
    pub course: Option<String>,
    /// Runs of the course, with the seeds SEED, SEED + 1, …
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    pub runs: u32,
    /// File to record the run to
    #[arg(long, value_name = "OUT", conflicts_with = "runs")]
    pub record: Option<PathBuf>,
    /// What is recorded: all, journal (what came from outside; the rest is computed again when it is opened), or
    /// buffers, separated by commas
    #[arg(long, value_name = "WHAT", requires = "record", value_parser = parse_what)]
    pub record_what: Option<RecordWhat>,
    /// Repeat a recorded run, and compare it with what was recorded
    #[arg(long, value_name = "FILE", conflicts_with_all = ["runs", "live", "acts"])]
    pub replay: Option<PathBuf>,
    /// Run on the wall clock, a thread a process
    #[arg(long, conflicts_with_all = ["runs", "log"])]
    pub live: bool,
    /// What an operator does meanwhile, a JSON file
    #[arg(long, value_name = "FILE")]
    pub acts: Option<PathBuf>,
    /// At the end, write the newest message of a buffer to a file, as JSON; may be given several times
    #[arg(long = "save", value_name = "BUFFER=FILE", value_parser = parse_save)]
    pub save: Vec<Save>,
    /// Seed of the run's random numbers, 0 where it is not given
    #[arg(long)]
    pub seed: Option<u64>,
    /// Parameter of a process, as process.field=value; may be given several times
    #[arg(long = "param", value_name = "P.F=V", value_parser = parse_param)]
    pub params: Vec<Param>,
    /// Stop at this time, in seconds from the log's start
    #[arg(long, value_name = "T", value_parser = parse_seconds)]
    pub until: Option<f64>,
    /// Threads that processes may share, all of the machine's by default; the result does not depend on it
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub threads: Option<u16>,
    /// Print the result as JSON
    #[arg(long)]
    pub json: bool,
}

/// `ocu diff`
#[derive(Debug, Clone, Args)]
#[command(after_help = "Example:\n  ocu diff one.mcap other.mcap --json\n\n\
                        Messages are compared by buffer and number; measured time is left out. Exit codes: 0 the \
                        recordings agree, 1 they differ.")]
pub struct DiffArgs {
    /// Recording
    pub first: PathBuf,
    /// Recording that is compared with it
    pub second: PathBuf,
    /// Print the result as JSON
    #[arg(long)]
    pub json: bool,
}

/// `ocu info`
#[derive(Debug, Clone, Args)]
#[command(after_help = "Example:\n  ocu info drive.mcap --json")]
pub struct InfoArgs {
    /// Recording to describe
    pub log: PathBuf,
    /// Print the result as JSON
    #[arg(long)]
    pub json: bool,
}

/// `ocu render`
#[derive(Debug, Clone, Args)]
#[command(
    after_help = "Example:\n  ocu render drive.mcap --stack range_camera --layout default --at 12.5 \\\n    \
                        --size 1600x900 -o picture.png"
)]
pub struct RenderArgs {
    /// Recording to draw
    #[arg(required_unless_present = "stack")]
    pub log: Option<PathBuf>,
    /// Stack to run on it: the name of a bundled one, or a .toml file
    #[arg(long, short, value_name = "STACK")]
    pub stack: Option<String>,
    /// Course that a simulation runs: the name of a bundled one, or a .toml file
    #[arg(long, short, value_name = "COURSE")]
    pub course: Option<String>,
    /// Seed of the random numbers
    #[arg(long, default_value_t = 0)]
    pub seed: u64,
    /// Layout to draw: the name of a bundled one, or a .ron file
    #[arg(long, short, value_name = "LAYOUT")]
    pub layout: String,
    /// Moment to draw, in seconds from the log's start
    #[arg(long, value_name = "T", value_parser = parse_seconds)]
    pub at: f64,
    /// Size of the picture in pixels: 1600x900
    #[arg(long, value_name = "WxH", value_parser = parse_size)]
    pub size: Size,
    /// File to write
    #[arg(short, long, value_name = "PNG")]
    pub output: PathBuf,
    /// Light instead of dark colours
    #[arg(long)]
    pub light: bool,
}

/// `ocu sample`
#[derive(Debug, Clone, Args)]
#[command(after_help = "Example:\n  ocu sample drive.mcap && ocu drive.mcap --stack sample")]
pub struct SampleArgs {
    /// File to write
    pub path: PathBuf,
    /// Length of the recording in seconds
    #[arg(long, value_name = "T", default_value = "20", value_parser = parse_seconds)]
    pub duration: f64,
}

/// `ocu eval stereo`
#[derive(Debug, Clone, Args)]
#[command(
    after_help = "Example:\n  ocu eval stereo --left left.png --right right.png --truth disparity.pfm \\\n    \
                        --disparities 64 --method sgm --json\n\n\
                        With a truth, all figures are over pixels seen by both eyes: those that have truth, lie at \
                        x >= the number of disparities, and of which no other pixel of the row with a disparity \
                        larger by more than 1 claims the same column of the right image. bad2_valid_pct is of \
                        pixels with a disparity; in bad2_dense_pct a pixel without one counts as bad.\n\n\
                        A calibration is a TOML file with tables [left] and [right], each with width, height, k (9 \
                        numbers), model, d, r (9) and p (12), as in calibration messages; the images are then \
                        rectified first."
)]
pub struct EvalStereoArgs {
    /// Left image
    #[arg(long, value_name = "L")]
    pub left: PathBuf,
    /// Right image, of the same size
    #[arg(long, value_name = "R")]
    pub right: PathBuf,
    /// Calibration of both cameras, a TOML file; without it, the images are taken as rectified
    #[arg(long, value_name = "C")]
    pub calib: Option<PathBuf>,
    /// True disparities of the (rectified) left image: PFM, 16-bit PNG in 1/256 pixel, or NPZ
    #[arg(long, value_name = "T")]
    pub truth: Option<PathBuf>,
    /// Disparities that are tried, pixels: a multiple of 16, from 16 to 256
    #[arg(long, value_name = "N", default_value_t = 64)]
    pub disparities: usize,
    /// Method
    #[arg(long, value_enum, default_value_t = StereoMethod::Bm)]
    pub method: StereoMethod,
    /// Threads to match on; semi-global matching uses one
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub threads: u16,
    /// Print the result as JSON
    #[arg(long)]
    pub json: bool,
}

/// `ocu eval color`
#[derive(Debug, Args)]
#[command(
    after_help = "Example:\n  ocu eval color --image 1.png 2.png --labels 1_labels.png 2_labels.png \\\n    \
                        --ground-ids 1,4 --apriori orange_fence --json\n\n\
                        The images are taken in order. From each, the models learn before it is classified: ground \
                        from a trapezoid at the bottom centre (from 68 % to 96 % of the height; 20 % of the width \
                        at its top, 40 % at its bottom), background from random pixels above the horizon and up to \
                        50 pixels below it in the first image, and from what the models call background later. A \
                        trapezoid whose colours differ from all models becomes a model at once, up to 5. There is \
                        no fusion over time: images of one's own need not be a sequence.\n\n\
                        Counted is every pixel of the label images but those with an ignored id. Ground is what has \
                        one of the ground ids, everything else is obstacle. A pixel is called what its pixel of the \
                        128x96 image is called. One that no model knows is unclassified: it is missed by both \
                        classes, and counts in unclassified_pct. IoU is intersection over union, f1 is that of \
                        ground; null where nothing is of the class or called so. ms_median is the time to learn from and to \
                        classify an image, on one thread, without reading the file."
)]
pub struct EvalColorArgs {
    /// Images: PNG or JPEG
    #[arg(long, value_name = "I", num_args = 1.., required = true)]
    pub image: Vec<PathBuf>,
    /// A label image for each image, of the same size: grey PNG whose values are ids
    #[arg(long, value_name = "L", num_args = 1.., required = true)]
    pub labels: Vec<PathBuf>,
    /// Ids that are ground
    #[arg(long, value_name = "IDS", num_args = 1.., value_delimiter = ',', required = true)]
    pub ground_ids: Vec<u16>,
    /// Ids that are not counted
    #[arg(long, value_name = "IDS", num_args = 1.., value_delimiter = ',')]
    pub ignore_ids: Vec<u16>,
    /// Models to begin with: the name of bundled ones, or a .json file
    #[arg(long, value_name = "F")]
    pub apriori: Vec<String>,
    /// Height of the horizon, percent of the image from the top
    #[arg(long, value_name = "PERCENT", default_value_t = 40.0)]
    pub horizon: f64,
    /// Print the result as JSON
    #[arg(long)]
    pub json: bool,
}

/// `ocu eval classify`
#[derive(Debug, Clone, Args)]
#[command(
    after_help = "Examples:\n  ocu eval classify --log run.mcap --truth-topic /eyes_left/truth_labels --topic /classifier/classes\n  \
                        ocu eval classify --log drive.mcap --stack my_stack.toml --truth-topic /labels --json\n  \
                        ocu eval classify --stack learning --course meadow --until 40 \\\n    \
                        --truth-topic /eyes_left/truth_labels --topic /classifier_left/classes\n\n\
                        Label images are mono8. 1 is ground or traversable, 2 obstacle or not traversable, 3 a short \
                        obstacle, which counts as ground. Other values are of no class: pixels whose true label is \
                        one of them are not counted, pixels that are judged so are unclassified: missed by both \
                        classes, and counted in unclassified_pct. Images are matched by the time at which they were \
                        taken, and must be of one size. IoU is intersection over union, f1 is that of ground; null \
                        where there is nothing of the class. ms_median is the time of a cycle of the stack's process \
                        that writes the label images, on one thread; null without a stack."
)]
pub struct EvalClassifyArgs {
    /// Recording with the label images, or what the stack needs to make them
    #[arg(long, required_unless_present = "stack")]
    pub log: Option<PathBuf>,
    /// Topic of the true label images, of the recording or of the stack
    #[arg(long, value_name = "T")]
    pub truth_topic: String,
    /// Topic of the label images that are judged; by default the one whose palette is `classes`
    #[arg(long, value_name = "TOPIC")]
    pub topic: Option<String>,
    /// Stack that makes the label images: the name of a bundled one, or a .toml file
    #[arg(long, short, value_name = "STACK")]
    pub stack: Option<String>,
    /// Course that a simulation runs: the name of a bundled one, or a .toml file
    #[arg(long, short, value_name = "COURSE", requires = "stack")]
    pub course: Option<String>,
    /// Seed of the run's random numbers
    #[arg(long, default_value_t = 0)]
    pub seed: u64,
    /// Parameter of a process, as process.field=value; may be given several times
    #[arg(long = "param", value_name = "P.F=V", value_parser = parse_param, requires = "stack")]
    pub params: Vec<Param>,
    /// Stop the stack at this time, in seconds from its start
    #[arg(long, value_name = "T", value_parser = parse_seconds, requires = "stack")]
    pub until: Option<f64>,
    /// Label images that were taken no farther apart than this belong together, seconds
    #[arg(long, value_name = "S", default_value = "0.005", value_parser = parse_seconds)]
    pub tolerance: f64,
    /// Print the result as JSON
    #[arg(long)]
    pub json: bool,
}

/// How disparities are found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum StereoMethod {
    /// Block matching
    Bm,
    /// Semi-global matching
    Sgm,
}

/// One parameter given on the command line.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Param {
    /// Name of the process in the stack.
    pub process: String,
    /// Name of the field.
    pub field: String,
    /// Its value, as text.
    pub value: String,
}

/// A buffer whose newest message is written to a file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Save {
    /// Name of the buffer.
    pub buffer: String,
    /// File to write.
    pub path: PathBuf,
}

/// Size of a picture in pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Size {
    /// Pixels from left to right.
    pub width: u32,
    /// Pixels from top to bottom.
    pub height: u32,
}

fn parse_save(text: &str) -> Result<Save, String> {
    match text.split_once('=') {
        Some((buffer, path)) if buffer.starts_with('/') && !path.is_empty() => {
            Ok(Save { buffer: buffer.to_owned(), path: path.into() })
        }
        _ => Err(format!("expected /buffer=file, got {text:?}")),
    }
}

fn parse_what(text: &str) -> Result<RecordWhat, String> {
    match text {
        "all" => Ok(RecordWhat::All),
        "journal" => Ok(RecordWhat::Journal),
        list if list.split(',').all(|name| name.starts_with('/') && name.len() > 1) => {
            Ok(RecordWhat::Buffers(list.split(',').map(str::to_owned).collect()))
        }
        _ => Err(format!("expected all, journal, or buffers like /wm1/map,/wm1/status, got {text:?}")),
    }
}

fn parse_param(text: &str) -> Result<Param, String> {
    let expected = || format!("expected process.field=value, got {text:?}");
    let (path, value) = text.split_once('=').ok_or_else(expected)?;
    let (process, field) = path.split_once('.').ok_or_else(expected)?;
    if process.is_empty() || field.is_empty() || value.is_empty() {
        return Err(expected());
    }
    Ok(Param { process: process.to_owned(), field: field.to_owned(), value: value.to_owned() })
}

fn parse_seconds(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(seconds) if seconds.is_finite() && (0.0..=1e9).contains(&seconds) => Ok(seconds),
        _ => Err(format!("expected seconds from 0 to 1e9, got {text:?}")),
    }
}

fn parse_size(text: &str) -> Result<Size, String> {
    const RANGE: std::ops::RangeInclusive<u32> = 16..=8192;
    let side = |part: &str| part.parse::<u32>().ok().filter(|side| RANGE.contains(side));
    text.split_once('x')
        .and_then(|(width, height)| Some(Size { width: side(width)?, height: side(height)? }))
        .ok_or_else(|| format!("expected WIDTHxHEIGHT with sides from 16 to 8192 pixels, got {text:?}"))
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
    fn sizes_times_and_parameters_out_of_range_are_refused() {
        assert_eq!(parse_size("1600x900"), Ok(Size { width: 1600, height: 900 }));
        for text in ["", "x", "1600", "15x900", "1600x99999", "1600X900", "-1x5"] {
            assert!(parse_size(text).is_err(), "{text}");
        }
        assert_eq!(parse_seconds("12.5"), Ok(12.5));
        for text in ["", "-1", "NaN", "inf", "1e300", "3 s"] {
            assert!(parse_seconds(text).is_err(), "{text}");
        }
        let param = Param { process: "wm1".into(), field: "weight_stereo".into(), value: "0.4".into() };
        assert_eq!(parse_param("wm1.weight_stereo=0.4"), Ok(param));
        for text in ["", "wm1", "wm1=1", "wm1.x", "wm1.=1", ".x=1", "wm1.x="] {
            assert!(parse_param(text).is_err(), "{text}");
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
}
