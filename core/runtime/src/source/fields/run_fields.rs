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
    /// By run: the points, and whether some of the past was not kept.
    runs: Vec<(SeriesWriter<FieldPoint>, bool)>,
}

impl RunField {
    fn take(&mut self, run: usize, sample: &Sample) {
        if let (Ok(extractor), Some((points, _))) = (&mut self.extractor, self.runs.get(run)) {
            let value = extractor.read(&sample.message);
            points.append(FieldPoint { stamp: sample.header.log_time, value });
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
                    of_buffer.for_each(|field| field.take(inner.current, sample));
                }
            }));
        }
        Self { inner, wanted }
    }

    fn lock(&self) -> MutexGuard<'_, Inner> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Gathers these fields, and no others.
    pub(crate) fn gather(&self, session: &mut Session, times: &RunTimes, fields: &[FieldRef]) {
        let mut inner = self.lock();
        inner.fields.retain(|known| fields.contains(&known.field));
        for field in fields {
            let buffers = session.run().buffers();
            let found = buffers.iter().position(|buffer| buffer.name() == field.topic);
            let Some(index) = found.filter(|_| !inner.fields.iter().any(|known| known.field == *field))
            else {
                continue;
            };
            let extractor = Extractor::new(&buffers[index].spec().schema, &field.path).map_err(Into::into);
            let mut new = RunField { field: field.clone(), buffer: index, extractor, runs: Vec::new() };
            for run in 0..inner.runs {
                new.runs.push((SeriesWriter::default(), false));
                if new.extractor.as_ref().is_ok_and(Extractor::is_time) {
                    // Times are known without reading the messages again.
                    let points =
                        times.of(run, index).into_iter().map(|stamp| FieldPoint { stamp, value: 1.0 });
                    new.runs[run].0.append_all(points);
                } else if new.extractor.is_ok() {
                    let id = RunId(run as u32);
                    let complete = session.each_message(id, index, &mut |sample| new.take(run, sample));
                    new.runs[run].1 = !complete;
                }
            }
            inner.fields.push(new);
        }
        for (index, wanted) in self.wanted.iter().enumerate() {
            wanted.store(inner.fields.iter().any(|field| field.buffer == index), Ordering::Relaxed);
        }
    }

    /// Sets the run of what is written from now on. A new run begins with what it shares with the one that it branched
    /// from.
    pub(crate) fn follow(&self, runs: &[RunSummary], current: usize) {
        let inner = &mut *self.lock();
        for run in &runs[inner.runs.min(runs.len())..] {
            for field in &mut inner.fields {
                let begun = run.branched_from.and_then(|(from, time)| {
                    let (points, lost) = field.runs.get(from.run.0 as usize)?;
                    Some((points.fork(time), *lost))
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
            let (points, lost) = &field.runs[run];
            let lost = lost.then(|| "a part of the past was not kept".into());
            FieldSeries {
                field: field.field.clone(),
                run: RunTag::Run(RunId(run as u32)),
                points: points.read(),
                names: field
                    .extractor
                    .as_ref()
                    .map(|extractor| Arc::clone(&extractor.names))
                    .unwrap_or_default(),
                reading: None,
                problem: field.extractor.as_ref().err().cloned().or(lost),
            }
        };
        let fields = inner.fields.iter();
        fields.flat_map(|field| (0..field.runs.len()).map(move |run| series(field, run))).collect()
    }
}
