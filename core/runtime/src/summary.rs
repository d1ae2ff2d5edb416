//! Summary of a run: cycles, messages, and a hash of everything that was written.

use crate::stack::{ProcessPlan, names};
use crate::tally::Tally;
use crate::work::Work;
use rcs_bus::Buffer;
use rcs_msg::rcs;
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use twox_hash::XxHash3_128;

/// Measured durations of one process's cycles.
///
/// Two clock readings take a fifth of the time of the shortest cycle. So for a cheap process one cycle in [`SAMPLED`]
/// is measured, after that many at the beginning; after a cycle that took [`CHEAP_NS`], the next [`WATCHED`] cycles are
/// measured, too. Thus a process that works in one cycle of many is measured in all of them, and an interruption by the
/// system does not cause measurements of all later cycles.
#[derive(Clone, Copy, Default, Serialize, Deserialize)]
pub(crate) struct CycleTimes {
    pub(crate) begun: u64,
    /// All cycles before this one are measured.
    watched_until: u64,
    measured: u64,
    total_ns: u64,
    max_ns: u64,
    pub(crate) overruns: u64,
}

/// A process whose cycles take less is cheap.
const CHEAP_NS: u64 = 10_000;
/// Number of cycles that are measured after one that was not cheap.
const WATCHED: u64 = 1000;
/// A prime, so that a process that works in every fourth cycle, for example, is sampled in all phases.
const SAMPLED: u64 = 17;

impl CycleTimes {
    /// Whether to measure the cycle that begins.
    pub(crate) fn begin(&mut self) -> bool {
        let is_due = self.begun < self.watched_until.max(SAMPLED) || self.begun.is_multiple_of(SAMPLED);
        self.begun += 1;
        is_due
    }

    /// Mean of the measured durations.
    pub(crate) fn mean_us(&self) -> f64 {
        self.total_ns as f64 * 1e-3 / self.measured.max(1) as f64
    }

    pub(crate) fn max_us(&self) -> f64 {
        self.max_ns as f64 * 1e-3
    }

    pub(crate) fn count(&mut self, took_ns: u64, period_ns: u64) {
        self.measured += 1;
        if took_ns >= CHEAP_NS {
            self.watched_until = self.begun + WATCHED;
        }
        self.total_ns += took_ns;
        self.max_ns = self.max_ns.max(took_ns);
        self.overruns += u64::from(took_ns > period_ns);
    }
}

/// State and text of each process when the log ended.
pub(crate) type AtLogEnd = Vec<(rcs::ProcessState, String)>;

/// A summary with the buffers by name and the hash of all of them.
pub(crate) fn summary_of(
    time_s: f64,
    processes: Vec<ProcessSummary>,
    mut buffers: Vec<BufferSummary>,
) -> Summary {
    buffers.sort_by(|a, b| a.name.cmp(&b.name));
    let hash = buffers.iter().all(|buffer| buffer.hash.is_some()).then(|| {
        let mut content = Vec::new();
        for buffer in buffers.iter().filter(|buffer| buffer.name != names::TIMING) {
            content.extend(buffer.name.as_bytes());
            content.extend(buffer.messages.to_le_bytes());
            content.extend(buffer.hash.as_deref().unwrap_or_default().as_bytes());
        }
        hex(XxHash3_128::oneshot(&content))
    });
    Summary { time_s, processes, buffers, hash }
}

/// What the last status of a process says.
pub(crate) struct Said {
    pub(crate) state: rcs::ProcessState,
    pub(crate) state_text: String,
    pub(crate) cycles: u64,
    pub(crate) faults: u64,
    pub(crate) last_fault: String,
}

impl From<rcs::Status> for Said {
    fn from(status: rcs::Status) -> Self {
        let (state, cycles, faults) = (status.state(), status.cycle, status.faults);
        Self { state, state_text: status.state_text, cycles, faults, last_fault: status.last_fault }
    }
}

impl ProcessSummary {
    pub(crate) fn new(process: &ProcessPlan, said: Said, times: &CycleTimes, work: &Work) -> Self {
        let port = |index: usize| process.kind.inputs()[index].name.to_owned();
        Self {
            name: process.name.to_string(),
            state: said.state,
            state_text: said.state_text,
            cycles: said.cycles,
            mean_us: times.mean_us(),
            max_us: times.max_us(),
            overruns: times.overruns,
            faults: said.faults,
            last_fault: said.last_fault,
            written: (!process.outputs.is_empty()).then(|| work.written()),
            refused_input: work.refused_input().map(port),
        }
    }
}

impl BufferSummary {
    pub(crate) fn new(buffer: &Arc<Buffer>, tally: Option<&Tally>) -> Self {
        Self {
            name: buffer.name().to_owned(),
            schema: buffer.spec().schema.name().to_owned(),
            messages: buffer.newest(),
            bytes: tally.map(|tally| tally.bytes),
            hash: tally.map(|tally| hex(tally.hash)),
        }
    }
}

fn hex(hash: u128) -> String {
    format!("{:016x}", hash >> 64)
}

/// Summary of a run so far.
#[derive(Clone, Debug, Default)]
pub struct Summary {
    /// Simulated seconds since the start.
    pub time_s: f64,
    /// Processes, in the order of the stack file.
    pub processes: Vec<ProcessSummary>,
    /// Buffers, by name.
    pub buffers: Vec<BufferSummary>,
    /// Hash of all buffers except `/runtime/timing`; `None` if hashing is off.
    pub hash: Option<String>,
}

/// Summary of a process. Durations are measured and differ from run to run; for a process whose cycles take
/// microseconds, only some cycles are measured.
#[derive(Clone, Debug)]
pub struct ProcessSummary {
    /// Its name.
    pub name: String,
    /// Its state.
    pub state: rcs::ProcessState,
    /// What its status says about the state: for `ERROR`, the reason.
    pub state_text: String,
    /// Number of cycles.
    pub cycles: u64,
    /// Mean duration of a cycle.
    pub mean_us: f64,
    /// Longest measured duration of a cycle.
    pub max_us: f64,
    /// Number of cycles that took longer than the period.
    pub overruns: u64,
    /// Faults that it counted: inputs that it could not use.
    pub faults: u64,
    /// What the last of them was; empty where there was none.
    pub last_fault: String,
    /// Messages that it wrote to its output ports; `None` where it has no such port.
    pub written: Option<u64>,
    /// The input port each of whose messages came with a fault (two at least).
    pub refused_input: Option<String>,
}

/// Summary of a buffer.
#[derive(Clone, Debug)]
pub struct BufferSummary {
    /// Its name.
    pub name: String,
    /// Type of its messages.
    pub schema: String,
    /// Number of messages written.
    pub messages: u64,
    /// Their total size, bytes; `None` if hashing is off.
    pub bytes: Option<u64>,
    /// Their hash, 16 hexadecimal digits; `None` if hashing is off.
    pub hash: Option<String>,
}
