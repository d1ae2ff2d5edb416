//! The viewed moment in other runs of a stack, from what was kept: nothing is computed again for it.

use super::frame::{Frame, Runs, Topic};
use super::log_view::LogView;
use super::rates::RunTimes;
use super::run_tag::RunTag;
use super::run_transforms::{POSES_NS, RunTransforms};
use crate::history::{Moment, Point, RunId, Session};
use rcs_bus::Sample;
use rcs_msg::Stamp;
use std::collections::BTreeMap;
use std::sync::Arc;

/// The runs that are shown beside the viewed one.
#[derive(Default)]
pub(super) struct Beside {
    watched: Vec<RunId>,
    transforms: BTreeMap<RunId, Placed>,
}

/// Transforms of a run.
#[derive(Default)]
struct Placed {
    transforms: RunTransforms,
    /// Their moment; `None` if they must be computed again.
    at: Option<Moment>,
}

impl Beside {
    /// Sets the runs that are shown, apart from the viewed one.
    pub(super) fn watch(&mut self, runs: &[RunId]) {
        self.watched = runs.to_vec();
        self.transforms.retain(|run, _| runs.contains(run));
    }

    /// The moment of `frame` in each of the runs: in a run that ended before, its end. `placing` are the buffers that
    /// give poses of frames, and whether these are static; `recorded` is the recording.
    pub(super) fn frames(
        &mut self,
        frame: &Frame,
        session: &mut Session,
        times: &RunTimes,
        placing: &[(usize, bool)],
        recorded: Option<&LogView>,
    ) -> Arc<[Arc<Frame>]> {
        let viewed = frame.runs.current();
        let mut watched = self.watched.clone();
        watched.retain(|&run| run != viewed && frame.runs.all.iter().any(|known| known.id == run));
        let frames = watched.into_iter().map(|run| {
            let (at, now) = session.moment_in(run, frame.now);
            // The topics of a run are in the order of its buffers.
            let (unwired, own): (Vec<&Topic>, Vec<&Topic>) =
                frame.topics.iter().partition(|topic| topic.run.is_recorded());
            let own = own.into_iter().enumerate().map(|(buffer, topic)| {
                let shown = session.latest_in(at, buffer);
                let messages = session.messages_in(at, buffer);
                let hz = times.rate_hz(run, buffer, messages);
                let mut topic =
                    Topic { run: RunTag::Run(run), messages, hz, pending: shown.pending, ..topic.clone() };
                topic.set_latest(shown.sample);
                topic
            });
            let topics = unwired.into_iter().cloned().chain(own).collect();
            let transforms = self.transforms.entry(run).or_default().go_to(at, now, session, placing);
            let transforms = match recorded {
                Some(view) => transforms.share_with(view.transforms(now)),
                None => transforms.share(),
            };
            let runs = Runs { moment: at, is_at_end: true, filling: None, ..frame.runs.clone() };
            let entities = frame.entities.iter().map(|entities| entities.at(now)).collect();
            let transform_clock =
                recorded.map_or_else(Arc::default, |view| Arc::clone(view.transform_clock(now)));
            let tracks = match recorded.filter(|_| now != frame.now) {
                // The recording may have another run of its clock at that time.
                Some(view) => {
                    let own = frame.tracks.iter().filter(|track| !track.run.is_recorded()).cloned();
                    view.tracks(now).chain(own).collect()
                }
                None => Arc::clone(&frame.tracks),
            };
            let placed = Frame { now, topics, entities, transforms, transform_clock, ..frame.clone() };
            Arc::new(Frame { tracks, runs, is_beside: true, ..placed })
        });
        frames.collect()
    }
}

impl Placed {
    /// The transforms at a moment of a run, whose time is `now`: from the last second before it that is in memory, and
    /// from older messages that are still valid. They stay while the moment stays.
    fn go_to(
        &mut self,
        at: Moment,
        now: Stamp,
        session: &mut Session,
        placing: &[(usize, bool)],
    ) -> &mut RunTransforms {
        if self.at == Some(at) {
            return &mut self.transforms;
        }
        let (before, _) = session.moment_in(at.run, now.before_ns(POSES_NS));
        let buffers: Vec<usize> = placing.iter().map(|&(buffer, _)| buffer).collect();
        let mut samples: Vec<(usize, Sample)> = Vec::new();
        session.since_in(Point::after(before.event), at, &buffers, &mut |buffer, sample| {
            samples.push((buffer, sample.clone()));
        });
        let mut is_pending = false;
        for &buffer in &buffers {
            let shown = session.latest_in(at, buffer);
            is_pending |= shown.pending;
            if !samples.iter().any(|(other, _)| *other == buffer) {
                samples.extend(shown.sample.map(|sample| (buffer, sample)));
            }
        }
        self.transforms.clear();
        // What is refused is told while its run is viewed.
        self.transforms.take_all(samples, placing);
        self.at = (!is_pending).then_some(at);
        &mut self.transforms
    }
}
