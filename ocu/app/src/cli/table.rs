//! Commands that print or write what a recording holds: `ocu export`, `ocu graph`.

use super::values::parse_seconds;
use clap::{Args, ValueEnum};
use std::path::PathBuf;

/// `ocu export`
#[derive(Debug, Clone, Args)]
#[command(
    after_help = "Examples:\n  ocu export drive.mcap --fields /localization/local.pose.position.x -o x.csv\n  \
                        ocu export run.mcap --to 20 -o t.csv \\\n    \
                        --fields /wm1/status.state 'smooth(/vehicle_interface/vehicle.speed_mps, 0.5)'\n\n\
                        A row for each time at which a field has a value. States and texts are written by name. A field \
                        may also be a formula, with the functions that the manual lists, except spectrum. Exit codes: 0 \
                        success, 2 the recording cannot be opened, 3 it is damaged, or not all messages could be \
                        read, and the table has the others."
)]
pub struct ExportArgs {
    /// Recording to read; of one that was split, the folder or the first file
    pub log: PathBuf,
    /// Fields or formulas: a column each
    #[arg(long, required = true, num_args = 1.., value_name = "FIELD")]
    pub fields: Vec<String>,
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
    /// File to write: text (.csv) or Parquet (.parquet)
    #[arg(short, long, value_name = "FILE")]
    pub output: PathBuf,
    /// Replace an existing file
    #[arg(long)]
    pub force: bool,
}

/// `ocu graph`
#[derive(Debug, Clone, Args)]
#[command(
    after_help = "Examples:\n  ocu graph simulation\n  ocu graph run.mcap --format dot | dot -Tsvg > graph.svg\n\n\
                        Supervisors are found from who writes whose command, peers from who reads whose data."
)]
pub struct GraphArgs {
    /// Recording (of one that was split, the folder or the first file), or a stack: the name of a bundled one, or a
    /// .toml file
    #[arg(value_name = "LOG|STACK")]
    pub source: String,
    /// Course that a simulation runs, of a stack: the name of a bundled one, or a .toml file
    #[arg(long, short, value_name = "COURSE")]
    pub course: Option<String>,
    /// Format of the output
    #[arg(long, value_enum, default_value = "text")]
    pub format: GraphFormat,
}

/// Format of a graph.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum GraphFormat {
    /// An indented text
    Text,
    /// The language of Graphviz
    Dot,
}
