//! Processes, stacks, the executors that run them, and the sources that a window shows.
//!
//! - [`Process`], [`Cycle`]: what the author of a plugin writes, and what a process can do in a cycle.
//! - [`StackFile`], [`Plan`]: which processes run; a plan is checked completely before anything runs.
//! - [`Stepped`]: runs a plan in simulated time, one event after another, with the same bytes in every run.
//! - [`Session`]: a stepped run that can go back.
//! - [`Live`]: runs a plan on the wall clock with one thread per process; [`Stepped`] can repeat its schedule.
//! - [`source`]: what a window shows.
//!
//! This crate contains no algorithm, no map and no perception: processes come from plugins, and what perception plugins
//! share is in `rcs-sense`. Begin with [`Process`] to write a plugin, and with [`Stepped`] to run a stack:
//!
//! ```
//! use rcs_msg::{Stamp, foxglove::Vector2, rcs::NoParams};
//! use rcs_runtime::{Cycle, NoCommands, Out, PortBuilder, Process, ProcessDef, ProcessType};
//! use rcs_runtime::{Plan, RunOptions, StackFile, Stepped};
//! use std::sync::Arc;
//!
//! #[derive(Clone, Debug, Default, serde::Serialize, serde::Deserialize)]
//! struct Counter(u32);
//!
//! #[derive(Debug)]
//! struct Ports {
//!     count: Out<Vector2>,
//! }
//!
//! impl Process for Counter {
//!     type Params = NoParams;
//!     type Ports = Ports;
//!     type Command = NoCommands;
//!     const DEF: ProcessDef = ProcessDef {
//!         plugin: "counter",
//!         summary: "Counts its cycles",
//!         period_ms: 100.0,
//!         latency_ms: 0.0,
//!         reads_ground_truth: false,
//!     };
//!
//!     fn ports(b: &mut PortBuilder) -> Ports {
//!         Ports { count: b.output("count", "number of cycles, in x").build() }
//!     }
//!
//!     fn new(_params: &NoParams) -> Self {
//!         Self::default()
//!     }
//!
//!     fn cycle(&mut self, ports: &Ports, _params: &NoParams, cx: &mut Cycle<'_>) {
//!         self.0 += 1;
//!         cx.write(&ports.count, cx.now(), Vector2 { x: self.0.into(), y: 0.0 });
//!         cx.exec("counts");
//!     }
//! }
//!
//! let stack = r#"
//! format = 1
//! name = "count"
//! description = "One counter."
//!
//! [[process]]
//! name = "counter"
//! plugin = "counter"
//! supervisor = "viewer"
//! "#;
//! let plan = Plan::new(StackFile::parse("count.toml", stack)?, &[ProcessType::of::<Counter>()], &[])?;
//! let mut run = Stepped::new(Arc::new(plan), None, RunOptions::default())?;
//! run.begin()?;
//! run.run_until(Stamp(1_000_000_000))?;
//! let count = run.bus().get("/counter/count").and_then(|buffer| buffer.latest());
//! assert!(count.and_then(|sample| sample.message.to::<Vector2>()).is_some_and(|count| count.x >= 9.0));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod children;
mod command;
mod compare;
mod conversion;
mod cycle;
mod diff;
mod error;
mod faults;
mod feed;
mod files;
mod history;
mod journal;
mod live;
mod live_tally;
mod machine;
mod node;
mod options;
mod overrides;
mod pool;
mod ports;
mod process;
mod record;
mod register;
mod replay;
mod role;
mod script;
mod shared;
mod snapshot;
pub mod source;
mod stack;
mod status;
mod stepped;
mod stepped_summary;
mod summary;
mod tally;
mod work;
mod workers;

pub use children::{Child, ChildDef, ChildReport, ChildState, Children, OwnCommand, Owner};
#[doc(hidden)]
pub use command::support as commands;
pub use command::{BUILT_IN, CommandDef, CommandSet, NoCommands, Obeys, Order};
pub use compare::Difference;
pub use conversion::{acquisition_time, states_acquisition};
pub use cycle::{Cycle, Msg};
pub use diff::{
    LaterRecording, NotCompared, RunDifference, ShorterRecording, diff, diff_each, diff_lengths, diff_runs,
    diff_starts, not_compared,
};
pub use error::RunError;
pub use files::{FileTable, NamedFile};
pub use history::{Moment, PastOptions, PastUse, RunId, RunSummary, Session};
pub use journal::{EventPlace, ExternalEvent, Journal};
pub use live::{Live, LiveOptions, Stopped, lower_priority};
pub use options::RunOptions;
pub use pool::Pool;
pub use ports::{In, Out, OutBuilder, PortBuilder, PortDef};
pub use process::{Process, ProcessDef, ProcessType, codecs};
pub use record::{RecordOptions, RecordWhat, Recording, metadata_of_part};
pub use replay::{RecordedRun, Replay};
pub use role::{InputRole, Role, UnknownRole};
pub use shared::shared;
pub use snapshot::Snapshot;
pub use stack::{
    Asset, Assets, BufferEntry, BufferPlan, ChildPlan, Class, InputEntry, InputPlan, NoAssets, Origin,
    OverflowEntry, ParamEntry, Plan, PlanOptions, ProcessEntry, ProcessPlan, StackError, StackFile, VIEWER,
    WritersEntry,
};
pub use status::Text;
pub use stepped::{Happened, Stepped};
pub use summary::{BufferSummary, ProcessSummary, Summary};
