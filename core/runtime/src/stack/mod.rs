//! Stack files: which processes run, how they are wired, with which parameters.
//!
//! [`StackFile::parse`] reads the text, [`Plan::new`] checks it against the list of plugins. Every error names the file,
//! the line, and what was expected; nothing runs before all of it has been checked.
//!
//! ```toml
//! format = 1
//! name = "range_camera"
//! description = "Obstacles from one depth camera."
//! course = "meadow"               # simulations: the course, and with it the world
//! authority_s = 10.0              # how long the operator's authority over a process lasts without a command
//!
//! [[input]]                       # a topic of the log, as the type that its readers want
//! buffer = "/camera/depth"
//! topic = "/cam_depth/image_raw"
//!
//! [[process]]
//! name = "obstacles"
//! plugin = "obstacles"
//! supervisor = "viewer"           # another process, or the one that is built into the window
//! as = "essential"                # which of the supervisor's children it is, where that does not follow from its name
//! period_ms = 50
//! latency_ms = 12                 # stepped: from the start of a cycle until its output shows
//! class = "normal"                # live: "realtime", "normal" where it is absent, or "background"
//! pool = "perception"             # live: threads shared with the processes that name the same pool
//! inputs = { depth = "/camera/depth" }
//! outputs = { labels = "/sp1/obstacles/labels" }
//! params = { depth_scale_m = 0.00390625 }
//!
//! [buffers."/sp1/obstacles/labels"]
//! queue = 8                       # latest only where it is absent
//! overflow = "drop_oldest"        # or "refuse"
//! record = true
//! record_hz = 5.0                 # at most; every message where it is absent
//! writers = "many"                # one writer where it is absent: a second one is refused
//! ```
//!
//! A stack may be made of parts (`[[include]]`, `[change.<process>]`): [`StackFile::compose`]. A parameter may be a value
//! of the course's files: `track_m = "${vehicle.wheels.track_m}"`.

mod assets;
mod builder;
mod compose;
mod error;
mod family;
mod file;
mod params;
mod plan;
mod sharing;

pub(crate) use builder::TRUTH;

pub use assets::{Asset, Assets, NoAssets};
pub use compose::Origin;
pub use error::StackError;
pub use file::{
    BufferEntry, Class, InputEntry, OverflowEntry, ParamEntry, ProcessEntry, StackFile, VIEWER, WritersEntry,
};
pub use params::PlanOptions;
pub(crate) use plan::names;
pub use plan::{BufferPlan, ChildPlan, InputPlan, Plan, ProcessPlan};
