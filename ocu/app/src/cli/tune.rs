//! `ocu tune`.

use super::values::{Param, parse_param};
use clap::Args;
use std::path::PathBuf;

/// `ocu tune`
#[derive(Debug, Clone, Args)]
#[command(after_help = "Examples:\n  ocu tune --log drive.mcap --stack lagr\n  \
                  ocu tune --log drive.mcap --stack lagr --process wm2 -o tuned.toml\n\n\
                  The maps of the drive tell what each source said of cells that the vehicle drove over, bumped into, \
                  or saw from near later. What was driven over, only a source of kind SOURCE_OVERRIDE tells, as the \
                  bumper of lagr does: without one, nothing is learned.\n\n\
                  Weights are fitted to every other stretch of ten seconds and checked on \
                  the rest: they are kept if they do better there, too. The maps are those of the recording if it \
                  has some, else the stack runs on it; --run lets it run in any case. So drive.mcap is a recording of \
                  lagr with its maps.\n\n\
                  The weight of the first range sensor stays, because only ratios of weights matter. The \
                  squared error without a source, beside that with all, says what the source is worth. A wrong \
                  judgement is a cost of an obstacle where the vehicle drove, or one of free ground where there was \
                  an obstacle.")]
pub struct TuneArgs {
    /// Recording of the drive; of one that was split, the folder or the first file
    #[arg(long)]
    pub log: PathBuf,
    /// Stack whose weights are learned: the name of a bundled one, or a .toml file
    #[arg(long, short, value_name = "STACK")]
    pub stack: String,
    /// Process whose weights are learned, by default the first one of the stack that has some
    #[arg(long, value_name = "P")]
    pub process: Option<String>,
    /// Course that a simulation runs: the name of a bundled one, or a .toml file
    #[arg(long, short, value_name = "COURSE")]
    pub course: Option<String>,
    /// Parameter of a process, as process.field=value; may be given several times
    #[arg(long = "param", value_name = "P.F=V", value_parser = parse_param)]
    pub params: Vec<Param>,
    /// Run the stack on the recording even if that has maps
    #[arg(long)]
    pub run: bool,
    /// File to which the stack with the new weights is written; an error if they are not kept
    #[arg(long, short, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// Replace an existing file
    #[arg(long, requires = "output")]
    pub force: bool,
    /// Print the result as JSON
    #[arg(long)]
    pub json: bool,
}
