//! Repeats a recorded run from its journal (and its schedule if it was live), and compares it with the recording.

use crate::compare::{Difference, Entry, Matcher, Side, is_measured, put_until};
use crate::error::RunError;
use crate::journal::{ExternalEvent, Journal};
use crate::options::RunOptions;
use crate::process::ProcessType;
use crate::record::{RUN_END, lacks_beginning};
use crate::script::ScheduledCycle;
use crate::stack::{Assets, NoAssets, Plan, PlanOptions, names};
use crate::stepped::Stepped;
use rcs_bus::Sample;
use rcs_log::{Cursor, CursorOptions, Log, Reassembly, TopicId};
use rcs_msg::{AnyMessage, Stamp, Value, rcs};
use std::iter::Peekable;
use std::sync::{Arc, Mutex, PoisonError};

/// Everything in a recording that is needed to repeat its run.
#[derive(Clone, Debug)]
pub struct RecordedRun {
    recording: Log,
    info: rcs::RunInfo,
    start: Stamp,
    /// Time from which the recording is complete.
    from: Option<Stamp>,
    /// Time up to which it can be repeated.
    end: Stamp,
    /// Whether the recording is complete: it was finished, and no message was dropped.
    whole: bool,
    /// Cycles of a live run: index of the process in `processes`, start and end.
    schedule: Vec<(u16, Stamp, Stamp)>,
    processes: Vec<String>,
    journal: Journal,
    problems: Vec<String>,
}

impl RecordedRun {
    /// Reads a recording's identity, journal and schedule. A truncated or damaged recording is used as far as journal
    /// and schedule have no gap; [`RecordedRun::problems`] reports it. A part without the beginning of its recording
    /// ([`metadata_of_part`](crate::metadata_of_part)) is refused. The journal may contain messages of any of the plugins.
    pub fn read(recording: &Log, plugins: &[ProcessType]) -> Result<Self, RunError> {
        plugins.iter().for_each(ProcessType::register);
        let info = recording.info();
        let ids = |name: &str| info.topics_named(name).map(|topic| topic.id).collect::<Vec<TopicId>>();
        let [runs, schedules, journals] = [names::RUN, names::SCHEDULE, names::JOURNAL].map(ids);
        if !runs.is_empty() && lacks_beginning(recording) {
            return Err(RunError::Refused(format!(
                "the recording is a part of a run without its beginning, from which a run is repeated; \
                 expected the whole recording, or a part from its beginning on: {}",
                info.path.display()
            )));
        }
        let topics = [runs.clone(), schedules.clone(), journals.clone()].concat();
        let end = recording.metadata().iter().rev().find(|metadata| metadata.name == RUN_END);
        let end = end.and_then(|metadata| {
            let number = |key: &str| metadata.entries.get(key)?.parse::<u64>().ok();
            Some((Stamp(number("time_ns")?), number("dropped")?))
        });
        let mut read = Self {
            recording: recording.clone(),
            info: rcs::RunInfo::default(),
            start: info.start,
            from: info.complete_from,
            end: end.map_or(info.end, |(time, _)| time),
            whole: end.is_some_and(|(_, dropped)| dropped == 0) && info.problems.is_empty(),
            schedule: Vec::new(),
            processes: Vec::new(),
            journal: Journal::default(),
            problems: info.problems.clone(),
        };
        let (mut known, mut last) = (false, [0_u32; 2]);
        let mut good = info.start;
        let mut events = Vec::new();
        let options = CursorOptions { topics: Some(topics), ..CursorOptions::default() };
        for message in recording.cursor(options) {
            let message = message?;
            let Some(topic) = info.topic(message.topic) else { continue };
            let raw = AnyMessage::encoded(topic.schema.clone(), message.data.clone());
            if runs.contains(&message.topic) {
                if let Some(run) = raw.to::<rcs::RunInfo>().filter(|_| !known) {
                    (read.info, read.start, known) = (run, message.log_time, true);
                }
                continue;
            }
            let is_journal = journals.contains(&message.topic);
            let sequence = &mut last[usize::from(is_journal)];
            *sequence = sequence.wrapping_add(1);
            let problem = if message.sequence == *sequence {
                if is_journal {
                    take_event(&raw, &mut events)
                } else {
                    take_cycle(&raw, &mut read.processes, &mut read.schedule)
                }
                .err()
            } else {
                Some(format!("message {sequence} of {} is missing", topic.name))
            };
            if let Some(problem) = problem {
                read.problems.push(format!("{problem}: the run can be repeated up to {good} only"));
                (read.end, read.whole) = (good, false);
                break;
            }
            good = message.log_time;
        }
        if !known {
            return Err(RunError::Refused(format!(
                "the recording holds no run ({} is not in it, or was cut off); expected a file that a run was \
                 recorded to: {}",
                names::RUN,
                info.path.display()
            )));
        }
        if end.is_none() {
            if read.info.live {
                // Cycles and events are recorded after their messages, so the last messages may lack theirs.
                read.end = good;
            }
            let at = read.end.seconds_since(read.start);
            read.problems.push(format!("the recording was not finished: it goes up to {at:.3} s"));
        }
        // Cycles that end later are dropped, because their output was not recorded.
        let until = read.end;
        read.schedule.retain(|(_, _, end)| *end <= until);
        read.journal = Journal::new(events);
        Ok(read)
    }

    /// Its identity.
    pub fn info(&self) -> &rcs::RunInfo {
        &self.info
    }

    /// Start time.
    pub fn start(&self) -> Stamp {
        self.start
    }

    /// Time up to which it can be repeated.
    pub fn end(&self) -> Stamp {
        self.end
    }

    /// The journal.
    pub fn journal(&self) -> &Journal {
        &self.journal
    }

    /// Problems of the recording, one sentence each.
    pub fn problems(&self) -> &[String] {
        &self.problems
    }

    /// Whether the recording has the journal only, so that the rest is computed again when it is opened.
    pub fn is_journal_alone(recording: &Log) -> bool {
        let entry = |metadata: &rcs_log::Metadata| {
            metadata.entries.get("recorded").map(String::as_str) == Some("journal")
        };
        recording.metadata().iter().any(|metadata| metadata.name == "ocu" && entry(metadata))
    }

    /// The recorded stack with the recorded parameters, overlaid with those of the command line; [`RecordedRun::check`]
    /// reports whether they differ.
    pub fn plan_with(
        &self,
        plugins: &[ProcessType],
        overrides: &[(String, String)],
        assets: &dyn Assets,
    ) -> Result<Arc<Plan>, RunError> {
        let options = PlanOptions { overrides, course: None, assets };
        Ok(Arc::new(Plan::of_run(&self.info, plugins, &options)?))
    }

    /// The stack that ran, with the parameters at its start.
    pub fn plan(&self, plugins: &[ProcessType]) -> Result<Arc<Plan>, RunError> {
        let plan = self.plan_with(plugins, &[], &NoAssets)?;
        if plan.hash != self.info.stack_hash {
            return Err(RunError::Refused(format!(
                "the recording's stack and parameters have the hash {}; expected {}, as its identity says: it was \
                 changed, or made by another build ({})",
                plan.hash, self.info.stack_hash, self.info.build
            )));
        }
        Ok(plan)
    }

    /// Refuses a stack, parameters or a seed that differ from the recorded ones, and names the difference.
    pub fn check(&self, plan: &Plan, seed: Option<u64>) -> Result<(), RunError> {
        if let Some(seed) = seed.filter(|seed| *seed != self.info.seed) {
            return Err(RunError::Refused(format!(
                "the run was recorded with seed {}, got {seed}",
                self.info.seed
            )));
        }
        if plan.hash == self.info.stack_hash {
            return Ok(());
        }
        if plan.file.text != self.info.stack_text {
            return Err(RunError::Refused(format!(
                "the run was recorded with another stack: got {} with hash {}, expected {} with hash {}",
                plan.file.name(),
                plan.hash,
                self.info.stack,
                self.info.stack_hash
            )));
        }
        let recorded = self.info.params.iter();
        for (process, recorded) in plan.processes.iter().zip(recorded) {
            let schema = process.params.schema();
            let recorded = AnyMessage::encoded(Arc::clone(&schema), recorded.params.clone());
            if let Some((field, got, expected)) = other_parameter(&process.params, &recorded) {
                return Err(RunError::Refused(format!(
                    "the run was recorded with another parameter {}{field}: got {got}, expected {expected}",
                    process.name
                )));
            }
        }
        Err(RunError::Refused(format!(
            "the run was recorded with other parameters: got the hash {}, expected {}",
            plan.hash, self.info.stack_hash
        )))
    }

    /// The run at its start, on the log that it read, if any. It replays its journal and, if it was live, its schedule.
    pub fn stepped(
        &self,
        plan: &Arc<Plan>,
        log: Option<&Log>,
        options: RunOptions,
    ) -> Result<Stepped, RunError> {
        let options = RunOptions { seed: self.info.seed, build: self.info.build.clone(), ..options };
        if self.info.live {
            let place = |name: &String| {
                let place = plan.processes.iter().position(|known| *known.name == **name);
                place.ok_or_else(|| {
                    let text = format!("the schedule names process {name}, which the stack does not have");
                    RunError::Refused(text)
                })
            };
            let places = self.processes.iter().map(place).collect::<Result<Vec<_>, _>>()?;
            let cycle = |&(process, start, end): &(u16, Stamp, Stamp)| {
                let node = places[usize::from(process)];
                ScheduledCycle { node, start, end }
            };
            let cycles = self.schedule.iter().map(cycle).collect();
            return Stepped::on_schedule(Arc::clone(plan), options, self.start, cycles, self.journal.clone());
        }
        match (log, self.info.log.as_str()) {
            (None, "") => {}
            (Some(_), "") => {
                return Err(RunError::Refused(
                    "the run was recorded without a log; expected none".to_owned(),
                ));
            }
            (None, identity) => {
                return Err(RunError::Refused(format!(
                    "the run was recorded on a log with the identity {identity}; expected that log"
                )));
            }
            (Some(log), identity) => {
                let got = log.identity()?;
                if got != identity {
                    return Err(RunError::Refused(format!(
                        "the run was recorded on another log: got one with the identity {got}, expected {identity}: {}",
                        log.info().path.display()
                    )));
                }
            }
        }
        let mut run = Stepped::new(Arc::clone(plan), log, options)?;
        run.repeat(self.journal.clone());
        Ok(run)
    }
}

fn take_event(raw: &AnyMessage, events: &mut Vec<ExternalEvent>) -> Result<(), String> {
    let event = raw.to::<rcs::JournalEvent>().ok_or("an event of the journal does not decode")?;
    events.push(ExternalEvent::from_message(&event).map_err(|error| error.to_string())?);
    Ok(())
}

fn take_cycle(
    raw: &AnyMessage,
    processes: &mut Vec<String>,
    cycles: &mut Vec<(u16, Stamp, Stamp)>,
) -> Result<(), String> {
    let record = raw.to::<rcs::CycleRecord>().ok_or("a cycle of the schedule does not decode")?;
    let known = processes.iter().position(|known| *known == record.process);
    let place = known.unwrap_or(processes.len());
    let number = u16::try_from(place).map_err(|_| "the schedule names more processes than a run can have")?;
    if known.is_none() {
        processes.push(record.process);
    }
    cycles.push((number, Stamp(record.start_ns), Stamp(record.end_ns)));
    Ok(())
}

/// The first field in which two parameter messages differ, with both values.
fn other_parameter(got: &AnyMessage, expected: &AnyMessage) -> Option<(FieldText, String, String)> {
    let (got, expected) = (got.value().ok()?, expected.value().ok()?);
    let text = |value: &Value| match value {
        Value::Text(text) if text.len() > 60 => format!("a text of {} bytes", text.len()),
        Value::Text(text) => format!("{text:?}"),
        value => value.as_f64().map_or_else(|| value.kind().to_owned(), |number| number.to_string()),
    };
    let mut pairs = got.leaves().zip(expected.leaves());
    let ((path, got), (_, expected)) = pairs.find(|((_, got), (_, expected))| got != expected)?;
    Some((path.to_string(), text(got), text(expected)))
}

type FieldText = String;

type Seen = Arc<Mutex<Vec<(usize, Sample)>>>;

/// A recorded run that is repeated and compared with its recording.
pub struct Replay {
    run: Stepped,
    recorded: RecordedRun,
    messages: Peekable<Cursor>,
    reassembly: Reassembly,
    matcher: Matcher,
    seen: Seen,
    first: Option<Difference>,
}

impl Replay {
    /// From a run that [`RecordedRun::stepped`] has created and that has not begun.
    pub fn new(mut recorded: RecordedRun, run: Stepped) -> Result<Self, RunError> {
        // The plan has the codecs of the messages.
        let codecs = run.plan().buffers.iter().filter_map(|buffer| buffer.codec);
        recorded.recording = recorded.recording.with_codecs(codecs);
        let seen = Seen::default();
        let mut matcher = Matcher::new(recorded.start);
        let topics = &recorded.recording.info().topics;
        for (index, (buffer, plan)) in run.buffers().iter().zip(&run.plan().buffers).enumerate() {
            if is_measured(buffer.name()) || !topics.iter().any(|topic| topic.name == buffer.name()) {
                continue;
            }
            if plan.record_hz.is_some() || !recorded.whole {
                matcher.thin(Side::First, buffer.name());
            }
            let seen = Arc::clone(&seen);
            buffer.tap(Box::new(move |sample: &Sample| {
                seen.lock().unwrap_or_else(PoisonError::into_inner).push((index, sample.clone()));
            }));
        }
        let messages = recorded.recording.cursor(CursorOptions::default()).peekable();
        let reassembly = Reassembly::new(&recorded.recording);
        let mut replay = Self { run, recorded, messages, reassembly, matcher, seen, first: None };
        replay.run.begin()?;
        Ok(replay)
    }

    /// The run in its current state.
    pub fn run(&self) -> &Stepped {
        &self.run
    }

    /// The first difference from the recording found so far.
    pub fn first(&self) -> Option<&Difference> {
        self.first.as_ref()
    }

    /// Runs to a time, or to the end of the recording if that is earlier.
    pub fn run_until(&mut self, until: Stamp) -> Result<(), RunError> {
        let until = until.min(self.recorded.end);
        loop {
            if let Some(refused) = self.run.take_due() {
                self.first.get_or_insert(Difference {
                    time: refused.time,
                    time_s: refused.time.seconds_since(self.recorded.start),
                    buffer: refused.buffer.clone(),
                    sequence: 0,
                    field: "message".to_owned(),
                    detail: refused.to_string(),
                    values: Default::default(),
                });
            }
            match self.run.next_time()? {
                Some(time) if time <= until => {
                    if time > self.run.now() {
                        self.settle(self.run.now())?;
                    }
                    self.run.advance()?;
                }
                _ => break,
            }
        }
        self.settle(until)
    }

    /// Compares everything up to and including a time.
    fn settle(&mut self, time: Stamp) -> Result<(), RunError> {
        let seen = std::mem::take(&mut *self.seen.lock().unwrap_or_else(PoisonError::into_inner));
        if self.first.is_some() {
            return Ok(());
        }
        let recording = &self.recorded.recording;
        let (reassembly, messages) = (&mut self.reassembly, &mut self.messages);
        let is_wanted = |buffer: &str| !is_measured(buffer);
        put_until(&mut self.matcher, Side::First, recording, reassembly, messages, time, is_wanted)?;
        if self.recorded.from.is_some_and(|from| time <= from) {
            // What was before the recording is not in it, except for what held when it began.
            self.matcher.forget();
            return Ok(());
        }
        for (index, sample) in seen {
            let entry = Entry {
                sequence: sample.header.sequence as u32,
                log_time: sample.header.log_time,
                acq_time: sample.header.acq_time,
                message: sample.message,
            };
            self.matcher.put(Side::Second, self.run.buffers()[index].name(), entry);
        }
        self.first = self.matcher.settle();
        Ok(())
    }
}
