//! A supervisor for any group of processes: starts them, halts them in order, and reports their state (in RCS, the
//! executor part of a node without planning of its own).
//!
//! | child | how many | what |
//! | --- | --- | --- |
//! | `vehicle_interface` | one, optional | what moves the vehicle: halted before all others, and when an essential child fails |
//! | `essential` | any number | children without which the vehicle must not move |
//! | `auxiliary` | any number | children whose failure is reported, and no more |
//! | `maps` | any number | auxiliary children with a map, which `CLEAR` clears |
//! | `memory` | any number | auxiliary children that keep a map or a way from one run to the next: `SAVE` and `CLEAR` |
//!
//! A process whose stack entry has no `as = "…"` is `essential`. There are no ports.
//!
//! Period 50 ms. Cost: one read of the newest status of each child. State: what has been halted, and why.
//!
//! It supervises and stops. It does not plan, command motion, or restart what has failed.
//!
//! # Commands
//!
//! - `INIT` is sent to all children at once; the supervisor is `DONE` when all children are.
//! - `RUN` is sent to all children at once; the supervisor is in `EXEC` from then on.
//! - `HALT` is sent to the vehicle interface; when that stands, or after `halt_timeout_s`, to all others. The
//!   supervisor is `DONE` when all children are, except those that obey the operator, which its text names.
//! - `SAVE` and `CLEAR`, while it runs, are passed on to the children that keep a map or a way, which save or forget it;
//!   `CLEAR` also to those with maps. Nothing else changes.
//!
//! # Failures
//!
//! An essential child that is in `ERROR`, or that posts no status, puts the supervisor into `ERROR` with the child's
//! name and reason, and halts the vehicle interface, which stays halted until the supervisor receives `RUN` again. A
//! supervisor above sees the `ERROR` and does the same, so a failure at any level reaches the vehicle interface within
//! one period of each level.
//!
//! A child under the operator's authority refuses the orders of the supervisor. When the operator gives it back with
//! `RELEASE` and it does not obey the current order, it receives that order again: this is `HALT` for the vehicle
//! interface after a failure. Until then, the status of the supervisor says that it cannot stop the vehicle; it says
//! that it has stopped the vehicle when the vehicle interface has accepted `HALT`. When the operator's authority has
//! lapsed instead, `HALT` is sent again, but not `RUN`: what the operator halted stays halted until it is commanded
//! again. Nor is `RUN` sent again to a child that runs by a command of its own: a limit of the speed that the operator
//! has given outlasts `RELEASE`, and the status goes on naming the child. After a one-shot, such as `CLEAR`, the child
//! runs as before, and the status names it only while the operator has it.
//!
//! # Where to begin
//!
//! `tests/groups/main.rs` runs groups of children that obey, brake and fail. In a stack, children name the supervisor as
//! their parent; `assets/stacks/simulation.toml` has one.
//!
//! ```
//! use rcs_runtime::Process;
//! use rcs_supervisor::Supervisor;
//!
//! assert_eq!(Supervisor::DEF.plugin, "supervisor");
//! assert_eq!(Supervisor::DEF.period_ms, 50.0);
//! ```

rcs_msg::messages!(
    /// Messages of this plugin alone, from `proto/`.
    pub mod proto
);

mod process;

pub use process::{MapCommand, MemoryCommand, Supervisor, SupervisorCommand};
