//! What is gathered from the messages of every run of a stack: tracks and events.

use super::run_tag::RunTag;
use crate::conversion::canonical;
use crate::history::{RunId, RunSummary};
use rcs_bus::{Buffer, Sample};
use rcs_msg::{AnyMessage, Stamp};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// What is gathered from the messages of one run.
pub(crate) trait Gathered: Default + Send + 'static {
    /// Whether it can come from messages of this type.
    fn takes(type_name: &str) -> bool;

    /// Adds a canonical message on `topic`.
    fn take(&mut self, topic: &Arc<str>, log_time: Stamp, message: &AnyMessage);

    /// What a run has that branches from this one at `time`.
    fn fork(&self, time: Stamp) -> Self;
}

/// One `T` for each run.
pub(crate) struct PerRun<T>(Arc<Mutex<Inner<T>>>);

struct Inner<T> {
    /// By run.
    runs: Vec<T>,
    current: usize,
}

impl<T: Gathered> PerRun<T> {
    /// Adds every message that is written to these buffers to the current run's `T`.
    pub(crate) fn tap<'a>(buffers: impl IntoIterator<Item = &'a Arc<Buffer>>) -> Self {
        let all = Self(Arc::new(Mutex::new(Inner { runs: vec![T::default()], current: 0 })));
        for buffer in buffers {
            if T::takes(buffer.spec().schema.name()) {
                let inner = Arc::clone(&all.0);
                let name: Arc<str> = buffer.name().into();
                buffer.tap_once(Box::new(move |sample: &Sample| {
                    if let Some(message) = canonical(&sample.message) {
                        let inner = &mut *inner.lock().unwrap_or_else(PoisonError::into_inner);
                        inner.runs[inner.current].take(&name, sample.header.log_time, &message);
                    }
                }));
            }
        }
        all
    }

    fn lock(&self) -> MutexGuard<'_, Inner<T>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Sets the run of what is written from now on. A new run begins with what it shares with the one that it branched
    /// from.
    pub(crate) fn follow(&self, runs: &[RunSummary], current: usize) {
        let mut inner = self.lock();
        for run in &runs[inner.runs.len().min(runs.len())..] {
            let gathered = match run.branched_from {
                Some((from, time)) => inner.runs[from.run.0 as usize].fork(time),
                None => T::default(),
            };
            inner.runs.push(gathered);
        }
        inner.current = current;
    }

    /// What `read` gives of every run.
    pub(crate) fn read<R>(&self, mut read: impl FnMut(RunTag, &T) -> R) -> Vec<R> {
        let runs = (0..).map(|run| RunTag::Run(RunId(run)));
        runs.zip(&self.lock().runs).map(|(run, gathered)| read(run, gathered)).collect()
    }
}
