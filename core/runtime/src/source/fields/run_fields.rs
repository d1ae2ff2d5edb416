//! Fields of the runs of a stack: taps follow what is written, and what was written before comes from the past that was
//! kept.

use super::extract::Extractor;
use super::{FieldPoint, FieldSeries};
use crate::history::{RunId, RunSummary, Session};
use crate::source::rates::RunTimes;
use crate::source::run_tag::RunTag;
use crate::source::series::SeriesWriter;
use crate::stepped::Stepped;
use rcs_bus::Sample;
use rcs_formula::FieldRef;
use rcs_msg::Stamp;
use std::collections::BTreeSet;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// The fields that are gathered from the runs of a stack.
pub(crate) struct RunFields {
    inner: Arc<Mutex<Inner>>,
    /// For each buffer, whether a field of it is gathered.
    wanted: Arc<[AtomicBool]>,
}

#[derive(Default)]
struct Inner {
    fields: Vec<RunField>,
    /// Number of runs.
    runs: usize,
    current: usize,
}

struct RunField {
    field: FieldRef,
    buffer: usize,
    /// Why the messages have no such field.
    extractor: Result<Extractor, Arc<str>>,
    /// By run.
    runs: Vec<RunPoints>,
}

/// The values of a field in one run.
#[derive(Default)]
struct RunPoints {
    points: SeriesWriter<FieldPoint>,
    /// Sequence of the message of the last point.
    newest: u64,
    /// Whether some of the past was not kept.
    is_lossy: bool,
}

impl RunPoints {
    /// The values for a run that branches from this one at `time`, and shares so many messages with it.
    fn fork(&self, time: Stamp, shared: u64) -> Self {
        let known = self.points.read();
        let until = known.count_until(time);
        // Of the messages at the time of the branch, a part may have been written after it.
        let kept = if self.is_lossy {
            until
        } else {
            let later = self.newest.saturating_sub(shared) as usize;
            known.len().saturating_sub(later).clamp(known.count_before(time), until)
        };
        let newest = self.newest.min(shared);
        Self { points: self.points.fork_first(kept), newest, is_lossy: self.is_lossy }
    }
}

impl RunField {
    /// Whether its values are read from the messages; times are known without them.
    fn is_in_messages(&self) -> bool {
        self.extractor.as_ref().is_ok_and(|extractor| !extractor.is_time())
    }

    /// Adds the value of a message that these runs have; `None` for messages that were not kept.
    fn take(&mut self, runs: &[usize], sample: Option<&Sample>) {
        let Ok(extractor) = &mut self.extractor else { return };
        let read = sample.map(|sample| {
            let value = extractor.read(&sample.message);
            (sample.header.sequence, FieldPoint { stamp: sample.header.log_time, value })
        });
        for &run in runs {
            let Some(of_run) = self.runs.get_mut(run) else { continue };
            match read {
                Some((sequence, point)) => {
                    of_run.points.append(point);
                    of_run.newest = sequence;
                }
                None => of_run.is_lossy = true,
            }
        }
    }
}

impl RunFields {
    /// Follows the buffers of a stack.
    pub(crate) fn tap(run: &Stepped) -> Self {
        let inner = Arc::new(Mutex::new(Inner { runs: 1, ..Inner::default() }));
        let wanted: Arc<[AtomicBool]> = run.buffers().iter().map(|_| AtomicBool::new(false)).collect();
        for (index, buffer) in run.buffers().iter().enumerate() {
            let (inner, wanted) = (Arc::clone(&inner), Arc::clone(&wanted));
            buffer.tap_once(Box::new(move |sample: &Sample| {
                if wanted[index].load(Ordering::Relaxed) {
                    let inner = &mut *inner.lock().unwrap_or_else(PoisonError::into_inner);
                    let of_buffer = inner.fields.iter_mut().filter(|field| field.buffer == index);
                    of_buffer.for_each(|field| field.take(&[inner.current], Some(sample)));
                }
            }));
        }
        Self { inner, wanted }
    }

    fn lock(&self) -> MutexGuard<'_, Inner> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Gathers these fields, and no others. The past is read once for all that are new. False if that was interrupted:
    /// then those that are new are not gathered.
    pub(crate) fn gather(
        &self,
        session: &mut Session,
        times: &RunTimes,
        fields: &[FieldRef],
        is_interrupted: &dyn Fn() -> bool,
    ) -> bool {
        let inner = &mut *self.lock();
        inner.fields.retain(|known| fields.contains(&known.field));
        let before = inner.fields.len();
        for field in fields {
            let buffers = session.run().buffers();
            let found = buffers.iter().position(|buffer| buffer.name() == field.topic);
            let Some(index) = found.filter(|_| !inner.fields.iter().any(|known| known.field == *field))
            else {
                continue;
            };
            let extractor = Extractor::new(&buffers[index].spec().schema, &field.path).map_err(Into::into);
            let runs = (0..inner.runs).map(|_| RunPoints::default()).collect();
            let mut new = RunField { field: field.clone(), buffer: index, extractor, runs };
            if new.extractor.as_ref().is_ok_and(Extractor::is_time) {
                // Times are known without reading the messages again.
                for (run, of_run) in new.runs.iter_mut().enumerate() {
                    let times = times.of(run, index);
                    of_run.newest = times.len() as u64;
                    let points = times.into_iter().map(|stamp| FieldPoint { stamp, value: 1.0 });
                    of_run.points.append_all(points);
                }
            }
            inner.fields.push(new);
        }
        let new = &mut inner.fields[before..];
        let read = new.iter().filter(|field| field.is_in_messages()).map(|field| field.buffer);
        let buffers: Vec<usize> = read.collect::<BTreeSet<_>>().into_iter().collect();
        let is_whole = session.each_message(&buffers, is_interrupted, &mut |runs, buffer, sample| {
            let of_buffer = new.iter_mut().filter(|field| field.buffer == buffer && field.is_in_messages());
            of_buffer.for_each(|field| field.take(runs, sample));
        });
        if !is_whole {
            inner.fields.truncate(before);
        }
        for (index, wanted) in self.wanted.iter().enumerate() {
            wanted.store(inner.fields.iter().any(|field| field.buffer == index), Ordering::Relaxed);
        }
        is_whole
    }

    /// Sets the run of what is written from now on. A new run begins with what it shares with the one that it branched
    /// from: `shared` messages of each buffer.
    pub(crate) fn follow(&self, runs: &[RunSummary], current: usize, shared: &[u64]) {
        let inner = &mut *self.lock();
        for run in &runs[inner.runs.min(runs.len())..] {
            for field in &mut inner.fields {
                let begun = run.branched_from.and_then(|(from, time)| {
                    Some(field.runs.get(from.run.0 as usize)?.fork(time, shared[field.buffer]))
                });
                field.runs.push(begun.unwrap_or_default());
            }
            inner.runs += 1;
        }
        inner.current = current;
    }

    /// The fields of every run.
    pub(crate) fn read(&self) -> Vec<FieldSeries> {
        let inner = self.lock();
        let series = |field: &RunField, run: usize| {
            let RunPoints { points, is_lossy, .. } = &field.runs[run];
            let lost = is_lossy.then(|| "a part of the past was not kept".into());
            let extractor = field.extractor.as_ref().ok();
            let problem = match &field.extractor {
                Ok(extractor) => lost.or_else(|| extractor.lacking()),
                Err(problem) => Some(Arc::clone(problem)),
            };
            FieldSeries {
                field: field.field.clone(),
                run: RunTag::Run(RunId(run as u32)),
                points: points.read(),
                names: extractor.map(|extractor| Arc::clone(&extractor.names)).unwrap_or_default(),
                states: extractor.map(|extractor| Arc::clone(&extractor.states)).unwrap_or_default(),
                reading: None,
                problem,
            }
        };
        let fields = inner.fields.iter();
        fields.flat_map(|field| (0..field.runs.len()).map(move |run| series(field, run))).collect()
    }
}
