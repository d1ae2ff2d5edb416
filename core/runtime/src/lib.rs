//! Processes, stacks, executors, and what a window looks at.
//!
//! - [`Process`], [`Cycle`]: what a plugin's author writes, and what a process sees.
//! - [`StackFile`], [`Plan`]: which processes run, checked before anything does.
//! - [`Stepped`]: simulated time, one event after another, the same bytes on every run.
//! - [`Session`]: a stepped run that can go back.
//! - [`Live`]: a thread a process, on the wall clock; its schedule can be run again by [`Stepped`].
//! - [`source`]: what a window looks at.

mod children;
mod command;
mod compare;
mod cycle;
mod error;
mod feed;
mod history;
mod journal;
mod live;
mod live_tally;
mod machine;
mod node;
mod options;
mod overrides;
mod pool;
mod process;
mod record;
mod register;
mod replay;
mod role;
mod script;
mod snapshot;
pub mod source;
mod stack;
mod status;
mod stepped;
mod summary;
mod workers;

pub use children::{Child, ChildDef, ChildReport, ChildState, Children};
#[doc(hidden)]
pub use command::support as commands;
pub use command::{BUILT_IN, CommandDef, CommandSet, NoCommands, Order};
pub use compare::{Difference, diff};
pub use cycle::{Cycle, Msg};
pub use error::RunError;
pub use history::{Moment, PastOptions, PastUse, RunId, RunSummary, Session};
pub use journal::{EventPlace, ExternalEvent, Journal};
pub use live::{Live, LiveOptions, Stopped};
pub use options::RunOptions;
pub use pool::Pool;
pub use process::{In, Out, OutBuilder, PortBuilder, PortDef, Process, ProcessDef, ProcessType, codecs};
pub use record::{RecordOptions, RecordWhat, Recording};
pub use replay::{RecordedRun, Replay};
pub use role::{InputRole, Role, UnknownRole};
pub use snapshot::Snapshot;
pub use stack::{
    Asset, Assets, BufferEntry, BufferPlan, ChildPlan, Class, InputEntry, InputPlan, NoAssets, Origin,
    OverflowEntry, ParamEntry, Plan, PlanOptions, ProcessEntry, ProcessPlan, StackError, StackFile, VIEWER,
    WritersEntry,
};
pub use status::Text;
pub use stepped::{Happened, Stepped};
pub use summary::{BufferSummary, ProcessSummary, Summary};
