//! Summary of a live run: messages and their hash, cycles and their durations.
//!
//! Hashing encodes every message, so it is done on a separate thread, and no process waits for it under the lock.

use crate::stack::{Plan, names};
use crate::summary::{BufferSummary, CycleTimes, ProcessSummary, Said, Summary, Tally, summary_of};
use crate::work::Work;
use rcs_bus::{Buffer, Sample};
use rcs_msg::{Stamp, rcs};
use std::collections::BTreeMap;
use std::sync::mpsc::{Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;

/// Channel of the messages to be hashed (`None` for the end), and the thread that hashes them.
type Hashing = (Sender<Option<(usize, Sample)>>, JoinHandle<Vec<Tally>>);
type Times = Arc<Mutex<BTreeMap<String, CycleTimes>>>;

/// Counts the messages and cycles of a live run from its start.
pub(crate) struct LiveTally {
    times: Times,
    hashing: Option<Hashing>,
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
        let hashing = if hash { Some(hash_on_a_thread(buffers)?) } else { None };
        Ok(Self { times, hashing })
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
        let tallies = self.hashing.and_then(|(sender, thread)| {
            // The thread can only be gone because it panicked, which joining it reports.
            let _ = sender.send(None);
            thread.join().ok()
        });
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

fn hash_on_a_thread(buffers: &[Arc<Buffer>]) -> std::io::Result<Hashing> {
    let (sender, receiver) = channel::<Option<(usize, Sample)>>();
    let mut tallies = vec![Tally::default(); buffers.len()];
    let thread = std::thread::Builder::new().name("hash".to_owned()).spawn(move || {
        while let Ok(Some((index, sample))) = receiver.recv() {
            tallies[index].take(&sample);
        }
        tallies
    })?;
    for (index, buffer) in buffers.iter().enumerate().filter(|(_, buffer)| buffer.name() != names::TIMING) {
        let sender = sender.clone();
        buffer.tap(Box::new(move |sample: &Sample| {
            // After the end of the run no one counts.
            let _ = sender.send(Some((index, sample.clone())));
        }));
    }
    Ok((sender, thread))
}
