//! The events of every run of a stack.

use super::events::{EventWatch, Events, is_event_type};
use super::run_tag::RunTag;
use crate::conversion::canonical;
use crate::history::{RunId, RunSummary};
use crate::stepped::Stepped;
use rcs_bus::Sample;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// The events of every run.
pub(crate) struct RunEvents(Arc<Mutex<Inner>>);

struct Inner {
    /// By run.
    runs: Vec<EventWatch>,
    current: usize,
}

impl RunEvents {
    /// Looks for events in every message that is written in the current run.
    pub(crate) fn tap(run: &Stepped) -> Self {
        let all = Self(Arc::new(Mutex::new(Inner { runs: vec![EventWatch::default()], current: 0 })));
        for buffer in run.buffers() {
            if is_event_type(buffer.spec().schema.name()) {
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

    fn lock(&self) -> MutexGuard<'_, Inner> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Sets the run of what is written from now on. A new run begins with what it shares with the one that it branched
    /// from.
    pub(crate) fn follow(&self, runs: &[RunSummary], current: usize) {
        let mut inner = self.lock();
        for run in &runs[inner.runs.len().min(runs.len())..] {
            let events = match run.branched_from {
                Some((from, time)) => inner.runs[from.run.0 as usize].fork(time),
                None => EventWatch::default(),
            };
            inner.runs.push(events);
        }
        inner.current = current;
    }

    /// The events of every run.
    pub(crate) fn read(&self) -> Vec<Events> {
        let inner = self.lock();
        let runs = (0..).map(|run| RunTag::Run(RunId(run))).zip(&inner.runs);
        runs.map(|(run, events)| events.read(run)).collect()
    }
}
