//! Summary of a live run: messages and their hash, cycles and their durations.
//!
//! Messages are hashed on a thread of their own, so that no process waits for it under the lock of a buffer.

use crate::stack::{Plan, names};
use crate::summary::{BufferSummary, CycleTimes, ProcessSummary, Said, Summary, summary_of};
use crate::tally::{Tallies, Tally};
use crate::work::Work;
use rcs_bus::{Buffer, Sample};
use rcs_msg::{Stamp, rcs};
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

/// Messages that may wait to be hashed, those of some seconds; a writer of more waits.
const MOST_UNHASHED: usize = 1 << 14;

type Times = Arc<Mutex<BTreeMap<String, CycleTimes>>>;

/// Counts the messages and cycles of a live run from its start.
pub(crate) struct LiveTally {
    times: Times,
    tallies: Option<Tallies>,
}

impl LiveTally {
    /// Taps the buffers of a run that has not begun.
    pub(crate) fn tap(plan: &Plan, buffers: &[Arc<Buffer>], hash: bool) -> std::io::Result<Self> {
        let times = Times::default();
        let periods: BTreeMap<String, u64> =
            plan.processes.iter().map(|process| (process.name.to_string(), process.period_ns)).collect();
        for buffer in buffers.iter().filter(|buffer| buffer.name() == names::SCHEDULE) {
            let (times, periods) = (Arc::clone(&times), periods.clone());
            buffer.tap(Box::new(move |sample: &Sample| {
                let Some(record) = sample.message.get::<rcs::CycleRecord>() else { return };
                let period_ns = periods.get(&record.process).copied().unwrap_or(u64::MAX);
                let mut times = times.lock().unwrap_or_else(PoisonError::into_inner);
                let took_ns = record.end_ns.saturating_sub(record.start_ns);
                times.entry(record.process.clone()).or_default().count(took_ns, period_ns);
            }));
        }
        let tallies =
            hash.then(|| Tallies::tap_on_a_thread(plan, buffers, MOST_UNHASHED, || {})).transpose()?;
        Ok(Self { times, tallies })
    }

    /// What the run has done from `start` to `now`, after its processes have ended with this `work`, in the order of the
    /// plan.
    pub(crate) fn finish(
        self,
        plan: &Plan,
        buffers: &[Arc<Buffer>],
        work: &[Work],
        (start, now): (Stamp, Stamp),
    ) -> Summary {
        let tallies = self.tallies.as_ref().and_then(Tallies::get);
        let times = self.times.lock().unwrap_or_else(PoisonError::into_inner).clone();
        let process = |(process, work): (&crate::stack::ProcessPlan, &Work)| {
            let status = buffers[process.status_buffer].latest();
            let status = status.and_then(|sample| sample.message.to::<rcs::Status>()).unwrap_or_default();
            let times = times.get(&*process.name).copied().unwrap_or_default();
            ProcessSummary::new(process, Said::from(status), &times, work)
        };
        let buffer = |(index, buffer): (usize, &Arc<Buffer>)| {
            BufferSummary::new(buffer, tallies.as_ref().map(|tallies: &Vec<Tally>| &tallies[index]))
        };
        let processes = plan.processes.iter().zip(work).map(process).collect();
        summary_of(now.seconds_since(start), processes, buffers.iter().enumerate().map(buffer).collect())
    }
}
