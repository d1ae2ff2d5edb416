//! A stack that runs: on a log, or on nothing but itself. What was recorded and what is made now stand side by side.

use super::frame::{Frame, Playback, RunTag, SourceInfo, SourceKind, Topic};
use super::log_source::{info_of, neighbour};
use super::log_view::{LogView, opening_time};
use super::run_transforms::RunTransforms;
use super::tracks::{Tracks, is_pose_type};
use super::{Source, SourceError, Step, Task, canonical};
use crate::error::RunError;
use crate::history::Session;
use crate::journal::ExternalEvent;
use crate::options::RunOptions;
use crate::record::writer_of;
use crate::replay::RecordedRun;
use crate::stack::Plan;
use crate::stepped::{Happened, Stepped};
use rcs_bus::Sample;
use rcs_log::{Log, Place};
use rcs_msg::{AnyMessage, Stamp, rcs};
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

/// A stack that runs, forward and back.
pub struct StackSource {
    session: Session,
    recorded: Option<LogView>,
    /// Topics of the log that fill a buffer: shown once, as that buffer.
    wired: BTreeMap<String, Arc<str>>,
    info: Arc<SourceInfo>,
    processes: Arc<[rcs::ProcessInfo]>,
    /// One topic a buffer, in the order of the plan.
    topics: Vec<Topic>,
    tracks: Arc<Mutex<Tracks>>,
    transforms: Arc<Mutex<RunTransforms>>,
    /// Buffers that say where frames are, and whether what they say holds at all times.
    placing: Vec<(usize, bool)>,
    /// Where the operator stands: at the run's last event, or later where nothing has happened since.
    now: Stamp,
    generation: u64,
}

impl StackSource {
    /// A stack at its start, on a log where it reads one.
    pub fn new(plan: Arc<Plan>, log: Option<&Log>, options: RunOptions) -> Result<Self, SourceError> {
        Self::of(Stepped::new(plan, log, options)?, log, None)
    }

    /// A recorded run, computed again from its journal (and its schedule, where it was live): what its recording does
    /// not hold is there, too. What comes from outside now comes in addition to what was recorded.
    pub fn repeating(
        recorded: &RecordedRun,
        plan: &Arc<Plan>,
        log: Option<&Log>,
        options: RunOptions,
    ) -> Result<Self, SourceError> {
        Self::of(recorded.stepped(plan, log, options)?, log, Some(recorded))
    }

    fn of(run: Stepped, log: Option<&Log>, recorded: Option<&RecordedRun>) -> Result<Self, SourceError> {
        let plan = Arc::clone(run.plan());
        let tracks: Arc<Mutex<Tracks>> = Arc::default();
        let transforms: Arc<Mutex<RunTransforms>> = Arc::default();
        tap_tracks(&run, &tracks);
        let placing = tap_transforms(&run, &transforms);
        let topics = plan.buffers.iter().map(|buffer| Topic {
            name: buffer.spec.name.as_str().into(),
            run: RunTag::Run,
            schema: Arc::clone(&buffer.spec.schema),
            metadata: Arc::new(buffer.spec.metadata.clone()),
            writer: writer_of(&plan, &buffer.spec.name).into(),
            messages: 0,
            hz: 0.0,
            undecodable: None,
            latest: None,
            canonical: Arc::new(OnceLock::new()),
        });
        let topics = topics.collect();
        let mut info = match log {
            Some(log) => info_of(log, SourceKind::Replay),
            None => SourceInfo {
                kind: SourceKind::Stack,
                title: String::new(),
                detail: plan.file.description().to_owned(),
                start: run.start(),
                end: None,
                problems: Vec::new(),
            },
        };
        info.title = match log {
            Some(_) => format!("{} · {}", info.title, plan.file.name()),
            None => plan.file.name().to_owned(),
        };
        if let Some(horizon) = run.horizon() {
            // Behind the log's end, until its processes have taken the last messages.
            info.end = Some(horizon);
        }
        if let Some(recorded) = recorded {
            info.end = Some(recorded.end());
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
            processes,
            topics,
            tracks,
            transforms,
            placing,
            now,
            generation: 0,
        };
        // What the log holds at its first moment (or at its first picture, shortly after) is there at once.
        let opening = match log {
            // A log of one instant: what the processes make of it is what there is to see.
            Some(log) if log.info().start == log.info().end => source.last(),
            Some(log) => opening_time(log)?,
            None => now,
        };
        source.seek(opening, &Task::default())?;
        Ok(source)
    }

    /// The run with its past.
    pub fn session(&self) -> &Session {
        &self.session
    }

    /// Up to where there is anything to do.
    fn last(&self) -> Stamp {
        self.info.end.unwrap_or(Stamp::MAX)
    }

    fn arrived(&mut self, now: Stamp) -> Result<(), SourceError> {
        if now < self.now {
            self.place_anew();
        }
        self.now = now;
        match &mut self.recorded {
            Some(view) => view.go_to(Place::after(now.min(view.log().info().end))),
            None => Ok(()),
        }
    }

    /// After going back: what the buffers hold says where frames are.
    fn place_anew(&mut self) {
        let mut transforms = self.transforms.lock().unwrap_or_else(PoisonError::into_inner);
        transforms.clear();
        for &(buffer, is_static) in &self.placing {
            let newest = self.session.run().buffers()[buffer].latest();
            if let Some(sample) = newest
                && let Some(message) = canonical(&sample.message)
            {
                transforms.take(sample.header.log_time, &message, is_static);
            }
        }
    }

    fn buffer_of(&self, topic: &str) -> Option<usize> {
        let plan = self.session.run().plan();
        plan.inputs
            .iter()
            .find(|input| input.topic == topic && !input.is_static)
            .map(|input| input.buffer)
            .or_else(|| plan.buffers.iter().position(|buffer| buffer.spec.name == topic))
    }

    fn process_named(&self, name: &str) -> Result<usize, SourceError> {
        let processes = &self.session.run().plan().processes;
        processes
            .iter()
            .position(|process| &*process.name == name)
            .ok_or_else(|| SourceError::Unsupported(format!("there is no process {name} in this stack")))
    }

    fn step_message(&mut self, topic: Option<&str>, back: bool, task: &Task) -> Result<bool, SourceError> {
        let last = self.last();
        let Some(topic) = topic else {
            return self.step_event(back, task, |what| what == Happened::Input);
        };
        if let Some(buffer) = self.buffer_of(topic) {
            if back {
                return self.go_back(self.session.event_of_message_before(buffer), task);
            }
            let newest = self.session.run().buffers()[buffer].newest();
            return self.session.forward_to(last, task, |run, _| run.buffers()[buffer].newest() > newest);
        }
        // A recorded topic that the stack does not read.
        let Some(view) = &self.recorded else {
            return Err(SourceError::Unsupported(format!("there is no topic {topic}")));
        };
        let ids = view.topic_ids(topic);
        match neighbour(
            view.log(),
            Some(&ids),
            if back { Place::before(self.now) } else { Place::after(self.now) },
            back,
        )? {
            Some(message) => {
                self.session.go_to_time(message.log_time, task)?;
                self.now = message.log_time;
                Ok(true)
            }
            None => Ok(false),
        }
    }

    fn step_event(
        &mut self,
        back: bool,
        task: &Task,
        is_wanted: impl Fn(Happened) -> bool,
    ) -> Result<bool, SourceError> {
        if back {
            let event = self.session.event_before(is_wanted);
            return self.go_back(event, task);
        }
        let last = self.last();
        self.session.forward_to(last, task, |_, what| is_wanted(what))
    }

    fn go_back(&mut self, event: Option<u64>, task: &Task) -> Result<bool, SourceError> {
        match event {
            Some(event) => {
                self.session.go_to_event(event, task)?;
                Ok(true)
            }
            None => Ok(false),
        }
    }

    fn update_topics(&mut self) {
        let run = self.session.run();
        let elapsed_s = self.now.seconds_since(run.start());
        for (topic, buffer) in self.topics.iter_mut().zip(run.buffers()) {
            let latest = buffer.latest();
            let same = match (&topic.latest, &latest) {
                (Some(a), Some(b)) => a.header == b.header && a.message.same(&b.message),
                (None, None) => true,
                _ => false,
            };
            if !same {
                topic.latest = latest;
                topic.canonical = Arc::new(OnceLock::new());
            }
            topic.messages = buffer.newest();
            topic.hz =
                if topic.messages > 1 && elapsed_s > 0.0 { topic.messages as f64 / elapsed_s } else { 0.0 };
        }
    }
}

/// Every position that a process writes becomes part of a track.
fn tap_tracks(run: &Stepped, tracks: &Arc<Mutex<Tracks>>) {
    for &index in run.plan().processes.iter().flat_map(|process| &process.outputs) {
        let buffer = &run.buffers()[index];
        if is_pose_type(buffer.spec().schema.name()) {
            let tracks = Arc::clone(tracks);
            let name: Arc<str> = buffer.name().into();
            buffer.tap(Box::new(move |sample: &Sample| {
                if let Some(message) = canonical(&sample.message) {
                    let mut tracks = tracks.lock().unwrap_or_else(PoisonError::into_inner);
                    tracks.take(&name, sample.header.log_time, &message, false);
                }
            }));
        }
    }
}

/// Everything that says where a frame is goes into `transforms`; the buffers that do, each with whether it holds at
/// all times.
fn tap_transforms(run: &Stepped, transforms: &Arc<Mutex<RunTransforms>>) -> Vec<(usize, bool)> {
    let mut placing = Vec::new();
    for process in &run.plan().processes {
        for (def, &index) in process.kind.outputs().iter().zip(&process.outputs) {
            let buffer = &run.buffers()[index];
            let known = placing.iter().any(|&(other, _)| other == index);
            if known || !RunTransforms::takes(buffer.spec().schema.name()) {
                continue;
            }
            // The port's name says it, as it does for the inputs that every process reads poses from.
            let is_static = def.name == "static_transforms";
            placing.push((index, is_static));
            let transforms = Arc::clone(transforms);
            buffer.tap(Box::new(move |sample: &Sample| {
                if let Some(message) = canonical(&sample.message) {
                    let mut transforms = transforms.lock().unwrap_or_else(PoisonError::into_inner);
                    transforms.take(sample.header.log_time, &message, is_static);
                }
            }));
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
        self.update_topics();
        self.generation += 1;
        let recorded = self.recorded.as_ref();
        let recorded_topics = recorded.map_or(&[][..], |view| &view.topics).iter();
        let unwired =
            recorded_topics.filter(|topic| !self.wired.values().any(|buffer| *buffer == topic.name));
        let topics = unwired.chain(&self.topics).cloned().collect();
        let mut tracks: BTreeMap<_, _> =
            recorded.map(|view| (*view.shared_tracks).clone()).unwrap_or_default();
        tracks.extend(self.tracks.lock().unwrap_or_else(PoisonError::into_inner).share());
        Frame {
            generation: self.generation,
            info: Arc::clone(&self.info),
            now: self.now,
            topics,
            processes: Arc::clone(&self.processes),
            tracks: Arc::new(tracks),
            transforms: match recorded {
                Some(view) => Arc::clone(&view.shared_tree),
                None => self.transforms.lock().unwrap_or_else(PoisonError::into_inner).share(),
            },
            playback: Playback::default(),
        }
    }

    fn seek(&mut self, to: Stamp, task: &Task) -> Result<(), SourceError> {
        let to = to.clamp(self.info.start, self.last());
        let done = self.session.go_to_time(to, task);
        // Stopped on the way: stand where the run stands.
        let now = if done.is_ok() { to } else { self.session.run().now() };
        self.arrived(now)?;
        done
    }

    fn step(&mut self, step: &Step, task: &Task) -> Result<bool, SourceError> {
        let moved = match step {
            Step::Message { topic, back } => self.step_message(topic.as_deref(), *back, task)?,
            Step::Cycle { process, back } => {
                let process = process.as_ref().map(|name| self.process_named(name)).transpose()?;
                self.step_event(*back, task, |what| match what {
                    Happened::Cycle(index) => process.is_none_or(|process| process == index),
                    _ => false,
                })?
            }
            Step::Time { ns } => {
                let from = self.now;
                let to = if *ns >= 0 { from.after_ns(*ns as u64) } else { from.before_ns(ns.unsigned_abs()) };
                self.seek(to, task)?;
                return Ok(self.now != from);
            }
        };
        if moved {
            self.arrived(self.session.run().now())?;
        }
        Ok(moved)
    }

    fn write(&mut self, buffer: &str, message: AnyMessage) -> Result<(), SourceError> {
        let was_branch = self.session.is_branch();
        self.session.write(ExternalEvent::operator(buffer, message)).map_err(|error| match error {
            // What the operator asked for does not fit: nothing has changed.
            RunError::Refused(text) => SourceError::Unsupported(text),
            other => SourceError::Run(other),
        })?;
        if self.session.is_branch() && !was_branch {
            self.tracks.lock().unwrap_or_else(PoisonError::into_inner).truncate(self.now);
        }
        Ok(())
    }

    fn idle(&mut self) -> bool {
        self.recorded.as_mut().is_some_and(LogView::idle)
    }
}
