//! A supervisor of any group of processes: starts them, halts them in order, and says how they are (RCS: the upper half
//! of a node that has no planning of its own).
//!
//! | child | how many | what |
//! | --- | --- | --- |
//! | `vehicle_interface` | one, optional | what moves the vehicle: halted before all others, and when an essential child fails |
//! | `essential` | any number | children without which the vehicle must not move |
//! | `auxiliary` | any number | children whose failure is reported, and no more |
//!
//! A process whose stack entry does not say `as = "…"` is `essential`. There are no ports.
//!
//! Period 50 ms. Cost: one look at the newest status of each child. State: what has been halted, and why.
//!
//! `INIT` goes to all children at once; `DONE` when all are. `RUN` goes to all at once; `EXEC` from then on. `HALT`
//! goes to the vehicle interface, and when that stands (or has not for `halt_timeout_s`) to all others; `DONE` when all
//! are.
//!
//! An essential child that is in `ERROR`, or that posts no status, makes the supervisor `ERROR` with its name and its
//! reason, and halts the vehicle interface, which stays halted until the supervisor gets `RUN` again. A supervisor
//! above sees the `ERROR` and does the same, so that a failure anywhere below reaches the vehicle interface within one
//! period of each level. A child that the operator has taken is left to the operator; when the operator gives it back
//! with
//! `RELEASE`, it gets the standing order again. It does not get it where the operator's authority has lapsed: what the
//! operator halted stays halted until somebody says otherwise.

rcs_msg::messages!(
    /// Messages of this plugin alone, from `proto/`.
    pub mod proto
);

mod process;

pub use process::Supervisor;
