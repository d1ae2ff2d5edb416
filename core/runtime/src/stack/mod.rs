//! Stack files: which processes run, how they are wired, and which parameters they have.
//!
//! [`StackFile::parse`] parses the text, and [`Plan::new`] checks it against the list of plugins. Every error names the
//! file, the line, and what was expected; everything is checked before anything runs.
//!
//! ```toml
//! format = 1
//! name = "range_camera"
//! description = "Obstacles from one depth camera."
//! course = "meadow"               # simulations: the course, which names the world
//! remembers = true                # `ocu run --runs`: whether a run is handed what the run before has learned
//! authority_s = 10.0              # how long the operator keeps the authority over a process without a command
//!
//! [[input]]                       # a topic of the log, converted to the type of its readers
//! buffer = "/camera/depth"
//! topic = "/cam_depth/image_raw"
//!
//! [[process]]
//! name = "obstacles"
//! plugin = "obstacles"
//! supervisor = "viewer"           # another process, or the viewer, which is built into the window
//! as = "essential"                # which of the supervisor's children it is, if that does not follow from its name
//! period_ms = 50
//! latency_ms = 12                 # stepped runs: from the start of a cycle until its output is visible
//! class = "normal"                # live runs: "realtime", "normal" (the default), or "background"
//! pool = "perception"             # live runs: threads shared with the processes that name the same pool
//! inputs = { depth = "/camera/depth" }
//! outputs = { labels = "/sp1/obstacles/labels" }
//! params = { depth_scale_m = 0.00390625 }
//!
//! [buffers."/sp1/obstacles/labels"]
//! queue = 8                       # without it, the latest message only
//! overflow = "drop_oldest"        # or "refuse"
//! record = true
//! record_hz = 5.0                 # an upper limit; without it, every message
//! writers = "many"                # without it, one writer: a second one is refused
//! ```
//!
//! A stack can include parts (`[[include]]`, `[change.<process>]`): [`StackFile::compose`]. A parameter can be a value
//! from the course's files: `track_m = "${vehicle.wheels.track_m}"`.

mod assets;
mod builder;
mod compose;
mod construct;
mod course;
mod error;
mod family;
mod file;
mod params;
mod plan;
mod sharing;

pub use assets::{Asset, Assets, NoAssets};
pub use compose::Origin;
pub use error::StackError;
pub use file::{
    BufferEntry, Class, InputEntry, OverflowEntry, ParamEntry, ProcessEntry, StackFile, VIEWER, WritersEntry,
};
pub use params::PlanOptions;
pub use plan::{BufferPlan, ChildPlan, InputPlan, Plan, ProcessPlan};
pub(crate) use plan::{TRUTH, names};
