//! The tracks of every run of a stack.

use super::run_tag::RunTag;
use super::tracks::{Track, Tracks, is_pose_type};
use crate::conversion::canonical;
use crate::history::{RunId, RunSummary};
use crate::stepped::Stepped;
use rcs_bus::Sample;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// The tracks of every run.
pub(crate) struct RunTracks(Arc<Mutex<Inner>>);

struct Inner {
    /// By run.
    runs: Vec<Tracks>,
    current: usize,
}

impl RunTracks {
    /// Adds every position that a process writes to the current run's tracks.
    pub(crate) fn tap(run: &Stepped) -> Self {
        let all = Self(Arc::new(Mutex::new(Inner { runs: vec![Tracks::default()], current: 0 })));
        for &index in run.plan().processes.iter().flat_map(|process| &process.outputs) {
            let buffer = &run.buffers()[index];
            if is_pose_type(buffer.spec().schema.name()) {
                let inner = Arc::clone(&all.0);
                let name: Arc<str> = buffer.name().into();
                buffer.tap_once(Box::new(move |sample: &Sample| {
                    if let Some(message) = canonical(&sample.message) {
                        let inner = &mut *inner.lock().unwrap_or_else(PoisonError::into_inner);
                        inner.runs[inner.current].take(&name, sample.header.log_time, &message, false);
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
            let tracks = match run.branched_from {
                Some((from, time)) => inner.runs[from.run.0 as usize].fork(time),
                None => Tracks::default(),
            };
            inner.runs.push(tracks);
        }
        inner.current = current;
    }

    /// The tracks of every run.
    pub(crate) fn read(&self) -> Vec<Track> {
        let inner = self.lock();
        let runs = (0..).map(|run| RunTag::Run(RunId(run))).zip(&inner.runs);
        runs.flat_map(|(run, tracks)| tracks.read(run)).collect()
    }
}
