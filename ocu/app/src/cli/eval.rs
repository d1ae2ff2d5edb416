//! `ocu eval`.

use super::values::{Param, parse_param, parse_seconds, parse_seed};
use clap::{Args, Subcommand, ValueEnum};
use std::path::PathBuf;

pub(super) const EVAL_EXAMPLE: &str = "Examples:\n  \
    ocu eval stereo --left left.png --right right.png --truth disparity.pfm\n  \
    ocu eval color --image path_*.png --labels labels_*.png --ground-ids 1,4";

/// Methods that can be evaluated.
#[derive(Debug, Subcommand)]
pub enum EvalCommand {
    /// Disparities of a pair of images: quality against ground truth, density and time
    Stereo(EvalStereoArgs),
    /// Colour models of ground and background: quality against labelled images, and time
    Color(EvalColorArgs),
    /// Paths on a map of MovingAI: lengths against the optimal ones, and time
    Plan(EvalPlanArgs),
    /// Label images of a recording, or of a stack that runs on it: quality against true ones
    Classify(EvalClassifyArgs),
    /// Maps of a recording: whether vehicle-wide arcs are called free or blocked as they truly are
    Obstacles(EvalObstaclesArgs),
}

/// `ocu eval stereo`
#[derive(Debug, Clone, Args)]
#[command(
    after_help = "Example:\n  ocu eval stereo --left left.png --right right.png --truth disparity.pfm \\\n    \
                        --disparities 64 --method sgm --json\n\n\
                        With ground truth, all figures are over pixels seen by both cameras: those that have truth, lie at \
                        x >= the number of disparities, and of which no other pixel of the row with a disparity \
                        larger by more than 1 claims the same column of the right image. bad2_valid_pct is of \
                        pixels with a disparity; in bad2_dense_pct a pixel without one counts as bad. pixels is \
                        the number of pixels seen by both cameras.\n\n\
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
    /// Calibration of both cameras, a TOML file; without it, the images must be rectified
    #[arg(long, value_name = "C")]
    pub calib: Option<PathBuf>,
    /// True disparities of the (rectified) left image: PFM, 16-bit PNG in 1/256 pixel, or NPZ
    #[arg(long, value_name = "T")]
    pub truth: Option<PathBuf>,
    /// Number of disparities, pixels: a multiple of 16, from 16 to 256
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
                        one of the ground ids, everything else is obstacle; at least one of the ids must occur. A pixel is \
                        called what its pixel of the 128x96 image is called. One that no model knows is unclassified: it is missed by both \
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
    /// Ids of ground
    #[arg(long, value_name = "IDS", num_args = 1.., value_delimiter = ',', required = true)]
    pub ground_ids: Vec<u16>,
    /// Ids that are ignored
    #[arg(long, value_name = "IDS", num_args = 1.., value_delimiter = ',')]
    pub ignore_ids: Vec<u16>,
    /// Initial models: the name of bundled ones, or a .json file
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
    after_help = "Examples:\n  ocu eval classify --log run.mcap --truth-topic /front_left/ground_truth_labels --topic /classifier_left/classes\n  \
                        ocu eval classify --log drive.mcap --stack my_stack.toml --truth-topic /labels --json\n  \
                        ocu eval classify --stack learning --course meadow --until 40 \\\n    \
                        --truth-topic /front_left/ground_truth_labels --topic /classifier_left/classes\n\n\
                        Label images are mono8. 1 is ground or traversable, 2 obstacle or not traversable, 3 a short \
                        obstacle, which counts as ground. Other values are of no class: pixels whose true label is \
                        one of them are not counted, pixels that are judged so are unclassified: missed by both \
                        classes, and counted in unclassified_pct. Images are matched by the time at which they were \
                        taken, and must be of one size. images is how many were compared, \
                        images_without_counterpart how many were judged and have no true one, pixels how many were \
                        counted. IoU is intersection over union, f1 is that of ground; null where there is nothing of the class. ms_median is the time of a cycle of the stack's process \
                        that writes the label images, on one thread; null without a stack."
)]
pub struct EvalClassifyArgs {
    /// Recording with the label images, or with what the stack needs to make them; of one that was split, the folder or
    /// the first file
    #[arg(long, required_unless_present = "stack")]
    pub log: Option<PathBuf>,
    /// Topic of the true label images, of the recording or of the stack
    #[arg(long, value_name = "T")]
    pub truth_topic: String,
    /// Topic of the label images to evaluate; by default the one whose palette is `classes`
    #[arg(long, value_name = "TOPIC")]
    pub topic: Option<String>,
    /// Stack that makes the label images: the name of a bundled one, or a .toml file
    #[arg(long, short, value_name = "STACK")]
    pub stack: Option<String>,
    /// Course that a simulation runs: the name of a bundled one, or a .toml file
    #[arg(long, short, value_name = "COURSE", requires = "stack")]
    pub course: Option<String>,
    /// Seed of the run's random numbers
    #[arg(long, default_value_t = 0, value_parser = parse_seed, allow_negative_numbers = true)]
    pub seed: u64,
    /// Parameter of a process, as process.field=value; may be given several times
    #[arg(long = "param", value_name = "P.F=V", value_parser = parse_param, requires = "stack")]
    pub params: Vec<Param>,
    /// Time at which the stack is stopped, in seconds from its start
    #[arg(
        long,
        value_name = "T",
        value_parser = parse_seconds,
        requires = "stack",
        allow_negative_numbers = true,
    )]
    pub until: Option<f64>,
    /// Maximum time difference of label images that are compared, seconds
    #[arg(
        long,
        value_name = "S",
        default_value = "0.005",
        value_parser = parse_seconds,
        allow_negative_numbers = true,
    )]
    pub tolerance: f64,
    /// Print the result as JSON
    #[arg(long)]
    pub json: bool,
}

/// `ocu eval plan`
#[derive(Debug, Clone, Args)]
#[command(after_help = "Example:\n  ocu eval plan --map arena.map --scen arena.map.scen\n\n\
                        The result is a JSON object, with or without --json. Every scenario is searched once, by \
                        the search of the process `planner`. A step costs 1, a diagonal one the square root of 2 and \
                        only where both cells beside it are free. Cells . G S are free, @ O T W blocked. \
                        cost_ratio_max is the greatest ratio of a length to the optimal one of the file; null where \
                        nothing was solved. A scenario whose path is longer than about 10 million cells is refused. \
                        Times are of one search on one thread, with the copy of the map, without reading the files.")]
pub struct EvalPlanArgs {
    /// Map: a .map file of MovingAI
    #[arg(long, value_name = "M")]
    pub map: PathBuf,
    /// Scenarios of the map: a .scen file of MovingAI
    #[arg(long, value_name = "S")]
    pub scen: PathBuf,
    /// Print the result as JSON. It is the only form
    #[arg(long)]
    pub json: bool,
}

/// `ocu eval obstacles`
#[derive(Debug, Clone, Args)]
#[command(
    after_help = "Examples:\n  ocu run --stack learning --course meadow --until 60 --record run.mcap\n  \
                        ocu eval obstacles run.mcap --json\n  \
                        ocu eval obstacles run.mcap --width 2 --front 3.1 --view 60 --eye-height 2.7\n\n\
                        The vehicle is that of the vehicle file in the recording, as far as no option says otherwise: \
                        width and front of its body, the height of its lowest camera, and the angle that its cameras \
                        cover together, as far to the left as to the right. The report says which values were \
                        taken.\n\n\
                        Arcs of 3 m and 5 m leave the front of the vehicle at each map, once per 0.1 m driven. One is \
                        truly blocked if a cell that the true map calls blocked lies under the vehicle's width, and \
                        truly free if none lies within the tolerance around it either; arcs between the two are not \
                        counted. An arc is called blocked if a cell under the vehicle's width has a cost of 125 or \
                        more; for a truly blocked arc a cell within the tolerance suffices. An arc that is not called \
                        blocked and of which the fused map knows less than 90 % is not judged. Each source alone is \
                        judged on the same arcs; what it does not know blocks nothing.\n\n\
                        A thing is in the way while it is the first true thing on an arc. It is late if it was in the \
                        way from at least 2 m, came nearer later, and did not block an arc at 2 m or more by then. \
                        Long things are counted in parts of about 1.5 m.\n\n\
                        A thing is sighted from each pose 2 m to 5 m before it at which it is in the way, within the \
                        angle of view, not hidden from the cameras, taken as one eye above the front, and has been so \
                        over the last 0.5 m. The report says, by distance, from how many of these poses it blocks the arc. \
                        It is missed if it was sighted from less than 3 m, and does not block from the nearest pose."
)]
pub struct EvalObstaclesArgs {
    /// Recording with maps, the true map and the true pose of the vehicle; of one that was split, the folder or
    /// the first file
    #[arg(value_name = "RUN")]
    pub run: PathBuf,
    /// Topic of the maps; by default the one whose role is map
    #[arg(long, value_name = "TOPIC")]
    pub map: Option<String>,
    /// Topic of the vehicle's poses in the frame of the maps; by default all whose role is pose
    #[arg(long, value_name = "TOPIC")]
    pub pose: Option<String>,
    /// Topic of the true map, a grid with the field `blocked`; by default the one marked as ground truth
    #[arg(long, value_name = "TOPIC")]
    pub truth_map: Option<String>,
    /// Topic of the true poses of the vehicle; by default the one marked as ground truth
    #[arg(long, value_name = "TOPIC")]
    pub truth_pose: Option<String>,
    /// Width of the vehicle, m; by default that of the vehicle file in the recording, without one 0.7
    #[arg(long, value_name = "M", value_parser = parse_width, allow_negative_numbers = true)]
    pub width: Option<f64>,
    /// Distance of the vehicle's front ahead of the origin of its frame, m; by default that of the vehicle file,
    /// without one 0.24
    #[arg(long, value_name = "M", value_parser = parse_metres, allow_negative_numbers = true)]
    pub front: Option<f64>,
    /// Angle of view of all cameras together, degrees, half of it to either side of straight ahead; by default that
    /// of the vehicle file, without one 100
    #[arg(long, value_name = "DEG", value_parser = parse_view, allow_negative_numbers = true)]
    pub view: Option<f64>,
    /// Height of the cameras above the ground, m; by default that of the lowest one in the vehicle file, without one
    /// 0.95
    #[arg(long, value_name = "M", value_parser = parse_metres, allow_negative_numbers = true)]
    pub eye_height: Option<f64>,
    /// Tolerance around things, m
    #[arg(
        long,
        value_name = "M",
        default_value_t = 0.2,
        value_parser = parse_metres,
        allow_negative_numbers = true,
    )]
    pub tolerance: f64,
    /// Print the result as JSON
    #[arg(long)]
    pub json: bool,
}

/// A length from 0 to 10 m.
fn parse_metres(text: &str) -> Result<f64, String> {
    let metres = parse_number(text)?;
    (0.0..=10.0).contains(&metres).then_some(metres).ok_or_else(|| format!("{metres} m, expected 0 to 10 m"))
}

/// A length above 0, up to 10 m: a vehicle without a width covers no cell.
fn parse_width(text: &str) -> Result<f64, String> {
    let metres = parse_number(text)?;
    let is_width = metres > 0.0 && metres <= 10.0;
    is_width.then_some(metres).ok_or_else(|| format!("{metres} m, expected more than 0 and at most 10 m"))
}

/// An angle above 0, up to a full turn: a vehicle without a view sees nothing.
fn parse_view(text: &str) -> Result<f64, String> {
    let degrees = parse_number(text)?;
    let is_view = degrees > 0.0 && degrees <= 360.0;
    let refused = || format!("{degrees} degrees, expected more than 0 and at most 360");
    is_view.then_some(degrees).ok_or_else(refused)
}

fn parse_number(text: &str) -> Result<f64, String> {
    text.parse().map_err(|_| format!("{text:?} is no number"))
}

/// How disparities are found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum StereoMethod {
    /// Block matching
    Bm,
    /// Semi-global matching
    Sgm,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_vehicle_has_a_width_and_a_view_and_other_lengths_may_be_0() {
        assert_eq!((parse_width("0.7"), parse_width("10"), parse_metres("0")), (Ok(0.7), Ok(10.0), Ok(0.0)));
        for width in ["0", "-0.0", "-1", "11", "nan"] {
            let error = parse_width(width).unwrap_err();
            assert!(error.ends_with(" m, expected more than 0 and at most 10 m"), "{width}: {error}");
        }
        assert_eq!(parse_view("360"), Ok(360.0));
        for view in ["0", "-1", "361", "nan"] {
            assert!(parse_view(view).unwrap_err().contains("expected more than 0"), "{view}");
        }
    }
}
