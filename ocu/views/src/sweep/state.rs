//! A sweep as the window runs it: what was asked for, and what became of each run.

use std::path::PathBuf;

/// What to run: every combination of the values of its parameters and of its seeds.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SweepRequest {
    /// Values of parameters, as `process.field=V1,V2,…` or `process.field=FROM..TO:COUNT`.
    pub params: Vec<String>,
    /// Faults on demand, as for `ocu run --fault`.
    pub faults: Vec<String>,
    /// First seed.
    pub seed: u64,
    /// Number of seeds.
    pub runs: u32,
    /// Time at which a run is stopped, s; `None` for the end of the course or the recording.
    pub until_s: Option<f64>,
}

/// What became of one run.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SweepRow {
    /// The values of the parameters; empty without any.
    pub params: String,
    /// The seed.
    pub seed: u64,
    /// In one word: what the referee says, `ended` without one, or `failed`.
    pub outcome: String,
    /// Whether it reached its goal; `None` if nobody judges.
    pub reached: Option<bool>,
    /// Simulated time at its end, s.
    pub time_s: f64,
    /// What the referee counts: distance to the goal in m, collisions, bumper hits.
    pub course: Option<(f64, u32, u32)>,
    /// Errors of its processes, or why it could not run.
    pub errors: String,
    /// Its recording; opening it computes the run again.
    pub recording: Option<PathBuf>,
}

/// The state of a sweep.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SweepState {
    /// What would be run now; empty if nothing that is open can be.
    pub what: String,
    /// What runs, or ran: what the rows are of, once the sweep has been checked.
    pub ran: String,
    /// The runs that ended, in the order of the request; those of the sweep before until this one has been checked.
    pub rows: Vec<SweepRow>,
    /// Number of all runs; 0 until the sweep has been checked.
    pub total: usize,
    /// Whether runs are still to end.
    pub is_running: bool,
    /// Why it could not begin, or what went wrong.
    pub problem: Option<String>,
}
