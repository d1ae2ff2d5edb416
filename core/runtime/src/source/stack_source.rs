//! A stack as a source, with or without a log. Recorded and computed topics are shown side by side.

use super::beside::Beside;
use super::compared::Compared;
use super::comparison::{Comparing, Subject};
use super::entities::EntityWatch;
use super::events::EventWatch;
use super::fields::RunFields;
use super::frame::{Frame, Playback, Runs, SourceInfo, SourceKind, Topic};
use super::log_source::info_of;
use super::log_view::{LogView, opening_time};
use super::per_run::PerRun;
use super::rates::RunTimes;
use super::recording::SourceRecording;
use super::recording_state::RecordingEnd;
use super::run_tag::RunTag;
use super::run_transforms::{POSES_NS, Refusal, RunTransforms};
use super::tracks::{Refused, Tracks};
use super::{Source, SourceError, Step, Task};
use crate::error::RunError;
use crate::history::{Point, RunId, Session};
use crate::journal::ExternalEvent;
use crate::options::RunOptions;
use crate::record::{RecordOptions, writer_of};
use crate::replay::RecordedRun;
use crate::role::{ROLE, Role};
use crate::stack::Plan;
use crate::stepped::{Happened, Stepped};
use rcs_bus::Sample;
use rcs_log::{Log, MessagePosition};
use rcs_msg::{AnyMessage, Stamp, rcs};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A forward move by less than this through dropped messages executes them at once, because the source plays or steps.
const STEP_NS: u64 = 500_000_000;

/// A stack that can go forward and back.
pub struct StackSource {
    pub(super) session: Session,
    pub(super) recorded: Option<LogView>,
    /// Topics of the log that feed a buffer: each is shown once, as that buffer.
    wired: BTreeMap<String, Arc<str>>,
    info: Arc<SourceInfo>,
    /// End of a recorded run that is computed again, unless the operator acts in it.
    recorded_end: Option<Stamp>,
    /// End of any other run.
    own_end: Option<Stamp>,
    processes: Arc<[rcs::ProcessInfo]>,
    /// One topic per buffer, in the order of the plan.
    topics: Vec<Topic>,
    gathering: Gathering,
    transforms: RunTransforms,
    refused: Refused,
    /// The moment of `transforms`; `None` if they must be computed again.
    placed: Option<crate::Moment>,
    /// Buffers that give poses of frames, and whether these are static.
    placing: Vec<(usize, bool)>,
    /// The viewed time: that of an event of the run, or later if nothing has happened since.
    pub(super) now: Stamp,
    runs: Arc<[crate::RunSummary]>,
    beside: Beside,
    comparing: Comparing,
    problems: usize,
    generation: u64,
    recording: Option<SourceRecording>,
}

/// What is gathered from the messages of every run.
struct Gathering {
    tracks: PerRun<Tracks>,
    entities: PerRun<EntityWatch>,
    events: PerRun<EventWatch>,
    times: RunTimes,
    fields: RunFields,
}

impl Gathering {
    /// Sets the run of what is written from now on: the session's. This must be called when a run begins, before
    /// anything is written in it.
    fn follow(&self, session: &Session) {
        let (runs, current) = (session.runs(), session.moment().run.0 as usize);
        // If a run has just begun, these are the numbers of messages that it shares with its parent.
        let shared: Vec<u64> = session.run().buffers().iter().map(|buffer| buffer.newest()).collect();
        self.tracks.follow(&runs, current, &shared);
        self.entities.follow(&runs, current, &shared);
        self.events.follow(&runs, current, &shared);
        self.times.follow(&runs, current, &shared);
        self.fields.follow(&runs, current, &shared);
    }
}

impl StackSource {
    /// A stack at its start, on a log if it reads one.
    pub fn new(plan: Arc<Plan>, log: Option<&Log>, options: RunOptions) -> Result<Self, SourceError> {
        Self::of(Stepped::new(plan, log, options)?, log, None)
    }

    /// A recorded run, computed again from its journal (and its schedule, if it was live), so that it includes what was
    /// not recorded. External events are accepted in addition to the recorded ones. A run with such an event goes on
    /// beyond the recorded end, unless the recorded run was live.
    pub fn repeating(
        recorded: &RecordedRun,
        plan: &Arc<Plan>,
        log: Option<&Log>,
        options: RunOptions,
    ) -> Result<Self, SourceError> {
        Self::of(recorded.stepped(plan, log, options)?, log, Some(recorded))
    }

    /// The same source with a title that tells its run from others of the stack.
    #[must_use]
    pub fn titled(mut self, title: &str) -> Self {
        let info = Arc::make_mut(&mut self.info);
        info.title = format!("{} · {title}", info.title);
        self
    }

    fn of(run: Stepped, log: Option<&Log>, recorded: Option<&RecordedRun>) -> Result<Self, SourceError> {
        let plan = Arc::clone(run.plan());
        // The tracks and entities of a recording are read from it.
        let is_output =
            |buffer: usize| plan.processes.iter().any(|process| process.outputs.contains(&buffer));
        let gathering = Gathering {
            tracks: PerRun::tap(run.buffers(), is_output),
            entities: PerRun::tap(run.buffers(), is_output),
            events: PerRun::tap(run.buffers(), |_| true),
            times: RunTimes::tap(&run),
            fields: RunFields::tap(&run),
        };
        let placing = placing(&plan);
        let topics = plan.buffers.iter().map(|buffer| Topic {
            metadata: Arc::new(buffer.spec.metadata.clone()),
            writer: writer_of(&plan, &buffer.spec.name).into(),
            ..Topic::new(&buffer.spec.name, RunTag::FIRST, Arc::clone(&buffer.spec.schema))
        });
        let topics = topics.collect();
        let mut info = match log {
            Some(log) => info_of(log, SourceKind::Replay),
            None => SourceInfo {
                kind: SourceKind::Stack,
                detail: plan.file.description().to_owned(),
                start: run.start(),
                ..SourceInfo::default()
            },
        };
        info.title = match log {
            Some(_) => format!("{} · {}", info.title, plan.file.name()),
            None => plan.file.name().to_owned(),
        };
        info.problems.extend(plan.warnings.iter().cloned());
        // It runs beyond the log's end, until its processes have handled the last messages. A live run is repeated from
        // its schedule, which has nothing after its end.
        let live_end = recorded.filter(|run| run.info().live).map(RecordedRun::end);
        let own_end = live_end.or(run.horizon());
        let recorded_end = recorded.map(RecordedRun::end);
        info.end = recorded_end.or(own_end);
        if let Some(recorded) = recorded {
            info.problems.extend(recorded.problems().iter().cloned());
            info.detail = format!("{} (recorded, computed again)", info.detail);
        }
        let now = run.start();
        let wired: BTreeMap<String, Arc<str>> = plan
            .inputs
            .iter()
            .map(|input| (input.topic.clone(), plan.buffers[input.buffer].spec.name.as_str().into()))
            .collect();
        let view = log.map(|log| LogView::new(log, &wired));
        let processes = plan.process_infos().into();
        let session = Session::new(run)?;
        let info = Arc::new(info);
        let mut source = Self {
            session,
            recorded: view,
            wired,
            info,
            recorded_end,
            own_end,
            processes,
            topics,
            gathering,
            transforms: RunTransforms::default(),
            refused: Refused::default(),
            placed: None,
            placing,
            now,
            runs: Arc::new([]),
            beside: Beside::default(),
            comparing: Comparing::default(),
            problems: 0,
            generation: 0,
            recording: None,
        };
        source.follow_runs();
        // The first frame shows what the log has at its start (or at its first image, if that is shortly after).
        let opening = match log {
            // In a log with a single time, the output of the processes is what there is to show.
            Some(log) if log.info().start == log.info().end => source.last(),
            Some(log) => opening_time(log, log.info().start)?,
            None => now,
        };
        source.seek(opening, &Task::default())?;
        Ok(source)
    }

    /// The run with its past.
    pub fn session(&self) -> &Session {
        &self.session
    }

    /// Time up to which there is anything to do.
    pub(super) fn last(&self) -> Stamp {
        self.info.end.unwrap_or(Stamp::MAX)
    }

    pub(super) fn arrived(&mut self, now: Stamp) -> Result<(), SourceError> {
        self.now = now;
        self.follow_runs();
        self.place();
        match &mut self.recorded {
            Some(view) => view.go_to(MessagePosition::after(now.min(view.log().info().end))),
            None => Ok(()),
        }
    }

    /// Updates the list of runs, the viewed one, and its end.
    fn follow_runs(&mut self) {
        let is_repeated = self.session.journal().is_empty();
        let end = self.recorded_end.filter(|_| is_repeated).or(self.own_end);
        if self.info.end != end {
            Arc::make_mut(&mut self.info).end = end;
        }
        let tag = RunTag::Run(self.session.moment().run);
        self.runs = self.session.runs().into();
        self.gathering.follow(&self.session);
        if self.topics.first().is_some_and(|topic| topic.run != tag) {
            self.topics.iter_mut().for_each(|topic| topic.run = tag);
        }
    }

    /// Updates the transforms to the viewed moment: from what was written since, or completely after a jump back. Where
    /// a part of what was written since is not in memory, they are computed as after a jump back, and frames that get
    /// none by that keep theirs.
    fn place(&mut self) {
        let moment = self.session.moment();
        let from = match self.placed {
            Some(placed) if placed == moment => return,
            Some(placed) if placed.run == moment.run && placed < moment => {
                Some(Point { event: placed.event, write: placed.write })
            }
            _ => None,
        };
        let pending = self.session.is_pending();
        if pending && from.is_some() {
            // They stay as they are until the messages of the moment are there.
            return;
        }
        let buffers: Vec<usize> = self.placing.iter().map(|&(buffer, _)| buffer).collect();
        let since = |from: Point| {
            let mut samples: Vec<(usize, Sample)> = Vec::new();
            let is_whole = self.session.since_in(from, moment, &buffers, &mut |buffer, sample| {
                samples.push((buffer, sample.clone()));
            });
            (samples, is_whole)
        };
        let mut refused = Vec::new();
        let is_whole = from.is_some_and(|from| {
            let (samples, is_whole) = since(from);
            refused.extend(self.transforms.take_all(samples, &self.placing));
            is_whole
        });
        if !is_whole {
            let older = std::mem::take(&mut self.transforms);
            let before = self.session.now().before_ns(POSES_NS);
            let (mut samples, _) = since(Point::after(self.session.events_at(before).min(moment.event)));
            // Older messages that are still valid.
            for &buffer in &buffers {
                if !samples.iter().any(|(other, _)| *other == buffer) {
                    samples.extend(self.session.latest(buffer).sample.map(|sample| (buffer, sample)));
                }
            }
            refused.extend(self.transforms.take_all(samples, &self.placing));
            if from.is_some() {
                self.transforms.take_missing(&older);
            }
        }
        self.placed = (!pending).then_some(moment);
        self.tell_refused(refused);
    }

    /// The source reports transforms of the run that were refused.
    fn tell_refused(&mut self, refused: Vec<(usize, Refusal)>) {
        let told = refused.into_iter().filter_map(|(buffer, Refusal { parent, child, why })| {
            self.refused.tell(&self.topics[buffer].name, &parent, &child, &why)
        });
        let told: Vec<String> = told.collect();
        if !told.is_empty() {
            Arc::make_mut(&mut self.info).problems.extend(told);
        }
    }

    fn update_topics(&mut self) {
        let run = self.session.moment().run;
        for (buffer, topic) in self.topics.iter_mut().enumerate() {
            let shown = self.session.latest(buffer);
            topic.pending = shown.pending;
            let latest = shown.sample;
            let same = match (&topic.latest, &latest) {
                (Some(a), Some(b)) => a.header == b.header && a.message.same(&b.message),
                (None, None) => true,
                _ => false,
            };
            if !same {
                topic.set_latest(latest);
            }
            topic.messages = self.session.messages(buffer);
            topic.hz = self.gathering.times.rate_hz(run, buffer, topic.messages);
        }
    }

    /// The source reports what the past could not store or read.
    fn tell_problems(&mut self) {
        let problems = self.session.problems();
        if problems.len() > self.problems {
            let info = Arc::make_mut(&mut self.info);
            info.problems.extend_from_slice(&problems[self.problems..]);
            self.problems = problems.len();
        }
        let found = self.recorded.as_mut().map(LogView::take_problems).unwrap_or_default();
        if !found.is_empty() {
            Arc::make_mut(&mut self.info).problems.extend(found);
        }
    }
}

/// What is done before anything of another run is executed or written: the recording ends, of a run that has reached
/// `end`, and what is gathered from now on is of the session's run.
fn leaving(
    recording: &mut Option<SourceRecording>,
    gathering: &Gathering,
    end: Stamp,
) -> impl FnOnce(&Session) {
    move |session| {
        if let Some(recording) = recording {
            recording.end(end, RecordingEnd::OtherRun);
        }
        gathering.follow(session);
    }
}

/// The buffers that give poses of frames, and whether these are static.
fn placing(plan: &Plan) -> Vec<(usize, bool)> {
    let mut placing: Vec<(usize, bool)> = Vec::new();
    for process in &plan.processes {
        for (def, &index) in process.kind.outputs().iter().zip(&process.outputs) {
            let known = placing.iter().any(|&(other, _)| other == index);
            if !known && RunTransforms::takes(plan.buffers[index].spec.schema.name()) {
                let is_static =
                    def.metadata.get(ROLE).is_some_and(|role| role == Role::StaticTransforms.name());
                placing.push((index, is_static));
            }
        }
    }
    placing
}

impl Source for StackSource {
    fn info(&self) -> Arc<SourceInfo> {
        Arc::clone(&self.info)
    }

    fn now(&self) -> Stamp {
        self.now
    }

    fn frame(&mut self) -> Frame {
        self.place();
        self.update_topics();
        self.tell_problems();
        self.generation += 1;
        let recorded = self.recorded.as_ref();
        let recorded_topics = recorded.map_or(&[][..], |view| &view.topics).iter();
        let unwired =
            recorded_topics.filter(|topic| !self.wired.values().any(|buffer| *buffer == topic.name));
        let topics = unwired.chain(&self.topics).cloned().collect();
        let now = self.now;
        let recorded_tracks = recorded.into_iter().flat_map(|view| view.tracks(now));
        let own = self.gathering.tracks.read(|run, tracks| tracks.read(run).collect::<Vec<_>>());
        let tracks = recorded_tracks.chain(own.into_iter().flatten()).collect();
        let recorded_entities = recorded.into_iter().flat_map(|view| view.entities(now));
        let own = self.gathering.entities.read(|run, entities| entities.read(run, now).collect::<Vec<_>>());
        let entities = recorded_entities.chain(own.into_iter().flatten()).collect();
        let own = self.gathering.events.read(|run, events| events.read(run));
        let events = recorded.map(LogView::events).into_iter().chain(own).collect();
        let end = self.session.end();
        let own = self.gathering.fields.read();
        let fields = recorded.into_iter().flat_map(LogView::fields).chain(own).collect();
        let mut frame = Frame {
            generation: self.generation,
            info: Arc::clone(&self.info),
            now: self.now,
            topics,
            processes: Arc::clone(&self.processes),
            tracks,
            entities,
            events,
            fields,
            transforms: match recorded {
                Some(view) => self.transforms.share_with(view.transforms(now)),
                None => self.transforms.share(),
            },
            transform_clock: recorded.map_or_else(Arc::default, |view| Arc::clone(view.transform_clock(now))),
            runs: Runs {
                all: Arc::clone(&self.runs),
                moment: self.session.moment(),
                is_at_end: self.session.is_at_end(),
                filling: self.session.fill_progress(),
            },
            playback: Playback::default(),
            recording: self.recording.as_mut().map(|recording| recording.state(end).clone()),
            beside: Arc::new([]),
            is_beside: false,
            comparisons: {
                self.comparing.feed(Some(&self.session));
                self.comparing.read(self.info.start, end)
            },
            against: self.comparing.other(),
            other: None,
        };
        let Self { session, gathering, placing, beside, recorded, comparing, .. } = self;
        frame.beside = beside.frames(&frame, session, &gathering.times, placing, recorded.as_ref());
        frame.other = comparing.other_frame(&frame);
        frame
    }

    fn watch(&mut self, runs: &[RunId]) {
        self.beside.watch(runs);
    }

    fn seek(&mut self, to: Stamp, task: &Task) -> Result<(), SourceError> {
        let to = to.clamp(self.info.start, self.last());
        let end = self.session.end();
        let goes_on = to > self.now && to.0 - self.now.0 < STEP_NS;
        let done = if to < end || (to == end && !self.session.is_at_end()) {
            self.session.look_at_time(to);
            if goes_on { self.session.fill(task) } else { Ok(()) }
        } else {
            self.session.look_at_end();
            self.session.forward_until(to, task).map(|_| ())
        };
        // Cancelled on the way: the source is where the run is.
        let now = if done.is_ok() { to } else { self.session.now() };
        self.arrived(now)?;
        done
    }

    fn step(&mut self, step: &Step, task: &Task) -> Result<bool, SourceError> {
        let before = self.session.moment();
        let moved = match step {
            Step::Message { topic: None, back } => self.step_input(*back, task),
            Step::Message { topic: Some(topic), back } => match self.buffer_of(topic) {
                Some(buffer) => self.step_message(buffer, *back, task),
                None => return self.step_recorded(topic, *back, task),
            },
            Step::Cycle { process, back } => {
                let process = process.as_ref().map(|name| self.process_named(name)).transpose()?;
                self.step_event(*back, task, |what| match what {
                    Happened::Cycle(index) => process.is_none_or(|process| process == index),
                    _ => false,
                })
            }
            Step::BackTo { topic, sequence } => self.step_back_to(topic, *sequence),
            Step::Time { ns } => {
                let from = self.now;
                let to = if *ns >= 0 { from.after_ns(*ns as u64) } else { from.before_ns(ns.unsigned_abs()) };
                self.seek(to, task)?;
                return Ok(self.now != from);
            }
        };
        // The source is where the run is, also after a step that found nothing or was cancelled.
        if self.session.moment() != before {
            self.arrived(self.session.now())?;
        }
        moved
    }

    fn record(&mut self, path: &Path, options: &RecordOptions) -> Result<(), SourceError> {
        if let Some(running) = self.recording.as_mut().filter(|recording| recording.is_running()) {
            let path = running.state(self.session.end()).path.display();
            return Err(SourceError::Unsupported(format!("the run is recorded already: {path}")));
        }
        self.recording = Some(SourceRecording::start(&mut self.session, path, options)?);
        Ok(())
    }

    fn stop_recording(&mut self) {
        if let Some(recording) = &mut self.recording {
            recording.end(self.session.end(), RecordingEnd::Stopped);
        }
    }

    fn write(&mut self, buffer: &str, message: AnyMessage) -> Result<(), SourceError> {
        let end = self.session.end();
        let Self { session, gathering, recording, .. } = self;
        let event = ExternalEvent::operator(buffer, message);
        let written = session.write_with(event, leaving(recording, gathering, end));
        written.map_err(|error| match error {
            // The operator's request was refused: nothing has changed.
            RunError::Refused(text) => SourceError::Unsupported(text),
            other => SourceError::Run(other),
        })?;
        self.follow_runs();
        Ok(())
    }

    fn switch_run(&mut self, run: RunId) -> Result<(), SourceError> {
        let end = self.session.end();
        let Self { session, gathering, recording, .. } = self;
        session.switch_to_with(run, leaving(recording, gathering, end))?;
        self.arrived(self.session.now())
    }

    fn undo(&mut self) -> Result<bool, SourceError> {
        let end = self.session.end();
        let Self { session, gathering, recording, .. } = self;
        let undone = session.undo_with(leaving(recording, gathering, end))?;
        if undone {
            self.arrived(self.session.now())?;
        }
        Ok(undone)
    }

    fn reserve(&mut self, bytes: u64) {
        self.session.reserve(bytes);
    }

    fn gather(&mut self, fields: &[rcs_formula::FieldRef], is_interrupted: &dyn Fn() -> bool) -> bool {
        let Self { session, recorded, wired, gathering, .. } = self;
        let is_whole = gathering.fields.gather(session, &gathering.times, fields, is_interrupted);
        if let Some(view) = recorded {
            // A topic that feeds a buffer is shown as that buffer.
            view.gather(fields, |name| !wired.values().any(|buffer| **buffer == *name));
        }
        is_whole
    }

    fn compare(&mut self, pairs: &[[Compared; 2]]) {
        let subject = Subject::of(&self.session, self.recorded.as_ref(), self.info.start);
        self.comparing.compare(pairs, &subject);
    }

    fn against(&mut self, files: &[PathBuf]) {
        let subject = Subject::of(&self.session, self.recorded.as_ref(), self.info.start);
        self.comparing.against(files, &subject);
    }

    fn show_other(&mut self, is_shown: bool) {
        self.comparing.show_other(is_shown);
    }

    fn idle(&mut self) -> bool {
        let past = self.session.idle();
        let reads = self.recorded.as_mut().is_some_and(LogView::idle) || past;
        self.comparing.idle(Some(&self.session)) || reads
    }
}
