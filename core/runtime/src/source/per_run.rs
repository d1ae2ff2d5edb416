//! What is gathered from the messages of every run of a stack: tracks, entities and events.

use super::run_tag::RunTag;
use crate::conversion::canonical;
use crate::history::{RunId, RunSummary};
use rcs_bus::{Buffer, Sample};
use rcs_msg::{AnyMessage, Stamp};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// What a run has written up to a certain message.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Written {
    /// Log time of the message.
    pub(crate) time: Stamp,
    /// Number of messages of the run in the followed buffers, including this one. Of several messages at one time, it
    /// tells which were written before a branch.
    pub(crate) messages: u64,
}

/// What is gathered from the messages of one run.
pub(crate) trait Gathered: Default + Send + 'static {
    /// Whether it can come from messages of this type.
    fn takes(type_name: &str) -> bool;

    /// Adds a canonical message on `topic`.
    fn take(&mut self, topic: &Arc<str>, at: Written, message: &AnyMessage);

    /// What a run has that branches from this one when so much is written.
    fn fork(&self, at: Written) -> Self;
}

/// One `T` for each run.
pub(crate) struct PerRun<T> {
    inner: Arc<Mutex<Inner<T>>>,
    /// Indices of the followed buffers, in the order of the plan.
    followed: Vec<usize>,
}

struct Inner<T> {
    /// By run.
    runs: Vec<OneRun<T>>,
    current: usize,
}

struct OneRun<T> {
    gathered: T,
    /// Number of messages that were written to the followed buffers.
    messages: u64,
}

impl<T: Gathered> PerRun<T> {
    /// Adds every message that is written to certain ones of a plan's buffers, by index, to the current run's `T`.
    pub(crate) fn tap(buffers: &[Arc<Buffer>], is_wanted: impl Fn(usize) -> bool) -> Self {
        let is_followed = |&index: &usize| T::takes(buffers[index].spec().schema.name()) && is_wanted(index);
        let followed: Vec<usize> = (0..buffers.len()).filter(is_followed).collect();
        let messages: u64 = followed.iter().map(|&index| buffers[index].newest()).sum();
        let first = OneRun { gathered: T::default(), messages };
        let inner = Arc::new(Mutex::new(Inner { runs: vec![first], current: 0 }));
        for &index in &followed {
            let (buffer, inner) = (&buffers[index], Arc::clone(&inner));
            let name: Arc<str> = buffer.name().into();
            buffer.tap_once(Box::new(move |sample: &Sample| {
                let message = canonical(&sample.message);
                let inner = &mut *inner.lock().unwrap_or_else(PoisonError::into_inner);
                let run = &mut inner.runs[inner.current];
                // A message without a canonical form counts, too.
                run.messages += 1;
                if let Some(message) = message {
                    let at = Written { time: sample.header.log_time, messages: run.messages };
                    run.gathered.take(&name, at, &message);
                }
            }));
        }
        Self { inner, followed }
    }

    fn lock(&self) -> MutexGuard<'_, Inner<T>> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Sets the run of what is written from now on. A new run begins with what it shares with the one that it branched
    /// from: `shared` messages of each buffer of the plan.
    pub(crate) fn follow(&self, runs: &[RunSummary], current: usize, shared: &[u64]) {
        let messages: u64 = self.followed.iter().map(|&buffer| shared[buffer]).sum();
        let mut inner = self.lock();
        for run in &runs[inner.runs.len().min(runs.len())..] {
            let begun = match run.branched_from {
                Some((from, time)) => {
                    let parent = &inner.runs[from.run.0 as usize];
                    OneRun { gathered: parent.gathered.fork(Written { time, messages }), messages }
                }
                None => OneRun { gathered: T::default(), messages: 0 },
            };
            inner.runs.push(begun);
        }
        inner.current = current;
    }

    /// What `read` gives of every run.
    pub(crate) fn read<R>(&self, mut read: impl FnMut(RunTag, &T) -> R) -> Vec<R> {
        let runs = (0..).map(|run| RunTag::Run(RunId(run)));
        runs.zip(&self.lock().runs).map(|(run, known)| read(run, &known.gathered)).collect()
    }
}
