//! Records the run of a source to a file, from any moment on.
//!
//! A recording that begins in the middle of a run opens with what holds at that moment (the newest message of every
//! buffer, with its own time; of static transforms the newest one of every child frame), the run's identity, the
//! descriptions of all processes, and the whole journal, so that it can be shown and repeated like one from the start.
//! It is of one run: it ends before another one begins.

use super::SourceError;
use super::recording_state::{RecordingEnd, RecordingState};
use super::tracks::frame_name;
use crate::conversion::canonical;
use crate::history::{Moment, RunId, Session};
use crate::record::{RecordOptions, Recording};
use crate::role::has_static_transforms;
use crate::stack::names;
use rcs_bus::{Header, Sample, WriterId};
use rcs_log::RecorderStatus;
use rcs_msg::{AnyMessage, DeferredSource, Stamp, foxglove};
use std::collections::BTreeMap;
use std::path::Path;

/// The recording of a source. Dropping it completes the file.
pub(super) struct SourceRecording {
    recording: Option<Recording>,
    state: RecordingState,
}

impl SourceRecording {
    /// Begins to record the viewed run at its end.
    pub(super) fn start(
        session: &mut Session,
        path: &Path,
        options: &RecordOptions,
    ) -> Result<Self, SourceError> {
        let path = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
        let from = session.end();
        let opening = opening(session);
        let options = RecordOptions { from: Some(from), ..options.clone() };
        let machine = session.run();
        let recording = Recording::start_with(&path, machine.plan(), machine.buffers(), &options, &opening)?;
        let state = RecordingState { path, from, to: from, bytes: 0, dropped: 0, ended: None };
        Ok(Self { recording: Some(recording), state })
    }

    /// Its state, when the run has reached `to`.
    pub(super) fn state(&mut self, to: Stamp) -> &RecordingState {
        if let Some(recording) = &self.recording {
            let status = recording.status();
            self.state.to = to;
            let failed = status.error.clone();
            self.take(&status);
            if let Some(error) = failed {
                self.recording = None;
                self.state.ended = Some(RecordingEnd::Failed(error));
            }
        }
        &self.state
    }

    fn take(&mut self, status: &RecorderStatus) {
        (self.state.bytes, self.state.dropped) = (status.bytes, status.dropped);
    }

    /// Completes the file, of a run that has reached `to`.
    pub(super) fn end(&mut self, to: Stamp, why: RecordingEnd) {
        let Some(recording) = self.recording.take() else { return };
        self.state.to = to;
        self.state.ended = Some(match recording.finish_at(to) {
            Ok(status) => {
                self.take(&status);
                status.error.map_or(why, RecordingEnd::Failed)
            }
            Err(error) => RecordingEnd::Failed(error.to_string()),
        });
    }

    /// Whether it continues.
    pub(super) fn is_running(&self) -> bool {
        self.recording.is_some()
    }
}

impl Drop for SourceRecording {
    fn drop(&mut self) {
        self.end(self.state.to, RecordingEnd::Stopped);
        if let Some(RecordingEnd::Failed(error)) = &self.state.ended {
            tracing::error!("the recording was not completed: {error}: {}", self.state.path.display());
        }
    }
}

/// What a recording of the viewed run that begins at its end opens with, by buffer and in the order of time.
fn opening(session: &mut Session) -> Vec<(usize, Sample)> {
    let run = session.moment().run;
    let (last, _) = session.moment_in(run, Stamp::MAX);
    let first = Moment { run, event: 0, write: 0 };
    let names: Vec<String> = session.run().buffers().iter().map(|buffer| buffer.name().to_owned()).collect();
    let fixed = static_transforms(session, run);
    let mut opening = Vec::new();
    for (index, name) in names.iter().enumerate() {
        if name == names::JOURNAL {
            opening.extend(journal(session).into_iter().map(|sample| (index, sample)));
            continue;
        }
        if name == names::PROCESSES {
            // Each message describes another process, and all of them were written before the first event.
            opening.extend(session.opening().into_iter().filter(|(buffer, _)| *buffer == index));
            continue;
        }
        let newest = session.latest_in(last, index).sample;
        if name == names::RUN
            && let Some(identity) = session.latest_in(first, index).sample
            && newest.as_ref().is_some_and(|newest| newest.header != identity.header)
        {
            opening.push((index, identity));
        }
        let is_newest =
            |sample: &Sample| newest.as_ref().is_some_and(|newest| newest.header == sample.header);
        let older = fixed.iter().filter(|(buffer, sample)| *buffer == index && !is_newest(sample));
        opening.extend(older.cloned());
        opening.extend(newest.map(|sample| (index, sample)));
    }
    opening.sort_by_key(|(_, sample)| sample.header.log_time);
    opening
}

/// The messages of static transforms that still hold at the end of a run, by buffer and in the order in which they were
/// written: of each child frame the newest one.
fn static_transforms(session: &mut Session, run: RunId) -> Vec<(usize, Sample)> {
    let buffers = session.run().plan().buffers.iter().enumerate();
    let fixed: Vec<usize> = buffers
        .filter(|(_, buffer)| has_static_transforms(&buffer.spec.name, &buffer.spec.metadata))
        .map(|(index, _)| index)
        .collect();
    let mut newest: BTreeMap<(usize, String), Sample> = BTreeMap::new();
    session.each_message(&fixed, &|| false, &mut |runs, buffer, sample| {
        let Some(sample) = sample.filter(|_| runs.contains(&(run.0 as usize))) else { return };
        for child in child_frames(&sample.message) {
            newest.insert((buffer, child), sample.clone());
        }
    });
    let by_sequence: BTreeMap<(usize, u64), Sample> =
        newest.into_iter().map(|((buffer, _), sample)| ((buffer, sample.header.sequence), sample)).collect();
    by_sequence.into_iter().map(|((buffer, _), sample)| (buffer, sample)).collect()
}

/// The frames that a message places.
fn child_frames(message: &AnyMessage) -> Vec<String> {
    let Some(message) = canonical(message) else { return Vec::new() };
    let transforms = match message.get::<foxglove::FrameTransforms>() {
        Some(list) => list.transforms.as_slice(),
        None => message.get::<foxglove::FrameTransform>().map_or(&[][..], std::slice::from_ref),
    };
    transforms.iter().map(|transform| frame_name(&transform.child_frame_id).to_owned()).collect()
}

/// The whole journal of the viewed run, as its messages.
fn journal(session: &Session) -> Vec<Sample> {
    let events = session.journal().events().iter().zip(1..);
    let sample = |(event, sequence): (&crate::journal::ExternalEvent, u64)| Sample {
        header: Header {
            sequence,
            log_time: event.place.time,
            acq_time: event.acq_time(),
            writer: WriterId::RUNTIME,
        },
        message: AnyMessage::new(event.to_message()),
    };
    events.map(sample).collect()
}
