//! Going back: a stepped run with its past.
//!
//! A [`Session`] divides a run into stretches of about one second. For each stretch it keeps all messages that were
//! written in it, and a snapshot of the run at its start. Viewing a moment reads messages and executes nothing. If the
//! messages were dropped to save space, the stretch is executed again in the background, from the nearest snapshot. The
//! viewed moment (the cursor) and the position of the machine are independent; the machine moves only to execute.
//!
//! A write in the past begins another run; the original run stays complete. The density of what is kept decreases with
//! the distance from the cursor, within one budget for memory and one for disk: see [`PastOptions`].

mod disk;
mod fill;
mod options;
mod pack;
mod reader;
mod retention;
mod runs;
mod samples;
mod spill;
mod stretch;

pub use options::PastOptions;
pub(crate) use reader::{Piece, RunReader};
pub use retention::PastUse;
pub use runs::{Moment, RunId, RunSummary};
pub(crate) use samples::{LogRef, Point};

use crate::error::RunError;
use crate::journal::{ExternalEvent, Journal};
use crate::source::{SourceError, Task};
use crate::stack::names;
use crate::stepped::{Happened, Stepped};
use pack::Origin;
use rcs_bus::Sample;
use rcs_msg::Stamp;
use retention::Retention;
use runs::Run;
use samples::{Location, Samples, Stored, StoredElsewhere, Tape};
use spill::Job;
use std::sync::Arc;
use stretch::Stretch;

/// A stretch ends with the first event at or after the next multiple of this time.
const STRETCH_NS: u64 = 1_000_000_000;
/// It may end up to this much later, in order to end at an event at which no cycle is computing.
const PATIENCE_NS: u64 = 300_000_000;
/// It ends at the latest after this many events.
const STRETCH_EVENTS: u64 = 16_384;

/// A stepped run that can go back.
pub struct Session {
    machine: Stepped,
    tape: Arc<Tape>,
    /// What was written before the first event, which is in no stretch.
    begun: Samples,
    stretches: Vec<Stretch>,
    runs: Vec<Run>,
    /// The viewed run, and the point in it.
    run: usize,
    cursor: Point,
    /// Position of the machine: the run, the stretch, and the number of writes since its last event.
    at_run: usize,
    at_stretch: usize,
    at_write: u32,
    /// Index in the run of the stretch that the machine executes again for the view.
    filling: Option<usize>,
    /// The stretch that could not be executed again; it is tried again only when something is asked for.
    gave_up: Option<usize>,
    went_back: bool,
    retention: Retention,
}

/// The newest message of a buffer at the viewed moment.
pub(crate) struct Shown {
    pub(crate) sample: Option<Sample>,
    /// Whether it is an older one, because the right one is still to be recomputed.
    pub(crate) pending: bool,
}

impl Session {
    /// A session of a run: from its beginning, or from where it is if it has begun.
    pub fn new(mut run: Stepped) -> Result<Self, RunError> {
        let tape = Tape::on(run.buffers());
        let mut retention = Retention::new(run.past_options().clone(), Arc::clone(run.plan()));
        run.begin()?;
        let snapshot = Arc::new(run.snapshot());
        let opening = fill::opening(&snapshot);
        let begun = tape.replace(Samples::begin(opening));
        retention.begun_bytes = begun.bytes();
        let (start, events) = (run.now, run.events);
        let first = Run {
            branched_from: None,
            line: vec![0],
            journal: Journal::default(),
            end: Point::after(events),
            end_time: start,
            head: None,
        };
        Ok(Self {
            machine: run,
            tape,
            begun,
            stretches: vec![Stretch::begin(0, snapshot)],
            runs: vec![first],
            run: 0,
            cursor: Point::after(events),
            at_run: 0,
            at_stretch: 0,
            at_write: 0,
            filling: None,
            gave_up: None,
            went_back: false,
            retention,
        })
    }

    /// The machine, at the position to which [`Session::forward`] and [`Session::go_to_event`] have moved it; the
    /// viewed moment may be another.
    pub fn run(&self) -> &Stepped {
        &self.machine
    }

    /// The viewed moment.
    pub fn moment(&self) -> Moment {
        Moment { run: RunId(self.run as u32), event: self.cursor.event, write: self.cursor.write }
    }

    /// Time of the last event before the viewed moment.
    pub fn now(&self) -> Stamp {
        self.time_of(self.cursor.event)
    }

    /// Time of the last event of the run.
    pub fn end(&self) -> Stamp {
        self.runs[self.run].end_time
    }

    /// Whether the viewed moment is the end of what was executed.
    pub fn is_at_end(&self) -> bool {
        self.cursor >= self.runs[self.run].end
    }

    /// All runs, in the order in which they began.
    pub fn runs(&self) -> Vec<RunSummary> {
        let summary = |(index, run): (usize, &Run)| RunSummary {
            id: RunId(index as u32),
            branched_from: run.branched_from.map(|(parent, at, time)| {
                (Moment { run: RunId(parent as u32), event: at.event, write: at.write }, time)
            }),
            end: run.end_time,
            events: run.end.event,
            writes: run.journal.len(),
        };
        self.runs.iter().enumerate().map(summary).collect()
    }

    /// The journal of the viewed run.
    pub fn journal(&self) -> &Journal {
        &self.runs[self.run].journal
    }

    /// What could not be stored or read, one line each.
    pub fn problems(&self) -> &[String] {
        self.retention.problems()
    }

    /// Leaves this much of the memory of the past to others, bytes.
    pub fn reserve(&mut self, bytes: u64) {
        self.retention.reserved_bytes = bytes;
    }

    /// Memory and disk that the past takes.
    pub fn past_use(&self) -> PastUse {
        self.retention.usage(&self.stretches, &self.tape)
    }

    /// Position of the machine.
    fn at(&self) -> Point {
        Point { event: self.machine.events, write: self.at_write }
    }

    fn is_machine_at_end(&self) -> bool {
        self.at() >= self.runs[self.at_run].end
    }

    fn time_of(&self, event: u64) -> Stamp {
        let run = &self.runs[self.run];
        // The event at which a stretch begins is the last one of the previous stretch.
        let place = run.place_of(&self.stretches, event.saturating_sub(1));
        self.stretches[run.line[place]].time_of(event)
    }

    /// Executes the next event; `None` if there is none.
    pub fn forward(&mut self) -> Result<Option<Happened>, RunError> {
        self.bring_to_cursor()?;
        let happened = self.step()?;
        self.cursor = self.at();
        Ok(happened)
    }

    fn bring_to_cursor(&mut self) -> Result<(), RunError> {
        if self.at_run == self.run && self.at() == self.cursor {
            return Ok(());
        }
        self.bring(self.run, self.cursor, &Task::default()).map_err(|error| match error {
            SourceError::Run(error) => error,
            other => RunError::Refused(other.to_string()),
        })
    }

    /// Executes everything up to and including `until`; `false` if nothing is left after that.
    pub fn forward_until(&mut self, until: Stamp, task: &Task) -> Result<bool, SourceError> {
        self.bring(self.run, self.cursor, task)?;
        let from = self.machine.now;
        let span = until.seconds_since(from);
        loop {
            task.check()?;
            match self.machine.next_time()? {
                Some(time) if time <= until => {
                    self.forward()?;
                    if span > 0.0 {
                        task.report(self.machine.now.seconds_since(from) / span);
                    }
                }
                next => return Ok(next.is_some()),
            }
        }
    }

    /// Goes forward to the end of the next event that `is_wanted` accepts; `false` if there is none before `until`.
    pub fn forward_to(
        &mut self,
        until: Stamp,
        task: &Task,
        mut is_wanted: impl FnMut(&Stepped, Happened) -> bool,
    ) -> Result<bool, SourceError> {
        self.bring(self.run, self.cursor, task)?;
        loop {
            task.check()?;
            match self.machine.next_time()? {
                Some(time) if time <= until => {}
                _ => return Ok(false),
            }
            match self.forward()? {
                Some(happened) if is_wanted(&self.machine, happened) => return Ok(true),
                Some(_) => {}
                None => return Ok(false),
            }
        }
    }

    /// Moves the machine to the point after `events` events: back to the nearest snapshot before it, then forward.
    pub fn go_to_event(&mut self, events: u64, task: &Task) -> Result<(), SourceError> {
        let run = &self.runs[self.run];
        let known = run.settled(events.min(run.end.event));
        let moved = self.bring(self.run, known, task);
        while moved.is_ok() && self.machine.events < events {
            task.check()?;
            if self.step()?.is_none() {
                break;
            }
        }
        self.look(self.at());
        moved
    }

    /// Moves the machine to a time: everything up to and including it has been executed, nothing after it.
    pub fn go_to_time(&mut self, to: Stamp, task: &Task) -> Result<(), SourceError> {
        let to_known = to.min(self.end());
        self.go_to_event(self.events_at(to_known), task)?;
        if to > to_known {
            self.forward_until(to, task)?;
        }
        Ok(())
    }

    /// Writes an external event at the viewed moment. If executed events lie ahead, the write begins another run.
    pub fn write(&mut self, event: ExternalEvent) -> Result<(), RunError> {
        self.write_with(event, |_| {})
    }

    /// [`Session::write`]; `begun` is called if another run begins, before anything is written there.
    pub(crate) fn write_with(
        &mut self,
        event: ExternalEvent,
        begun: impl FnOnce(&Self),
    ) -> Result<(), RunError> {
        self.bring_to_cursor()?;
        if !self.is_machine_at_end() {
            // A refused write must not leave a run behind.
            self.machine.check_event(&event)?;
            self.fork(begun)?;
        }
        self.tape.at(Point { event: self.machine.events, write: self.at_write + 1 });
        let taken = self.machine.take(event)?;
        self.written(taken);
        Ok(())
    }

    /// A write at the end of the run was executed.
    fn written(&mut self, event: ExternalEvent) {
        self.at_write += 1;
        let at = self.at();
        let run = &mut self.runs[self.at_run];
        run.journal.push(event);
        run.end = at;
        run.head = None;
        self.cursor = at;
    }

    /// Undoes the last write before the viewed moment: goes to the moment before it, and continues from there without
    /// it. The run with the write is kept. `false` if there is no write.
    pub fn undo(&mut self) -> Result<bool, RunError> {
        self.undo_with(|_| {})
    }

    /// [`Session::undo`]; `leaves` is called before anything of another run is executed or written.
    pub(crate) fn undo_with(&mut self, leaves: impl FnOnce(&Self)) -> Result<bool, RunError> {
        let run = &self.runs[self.run];
        let done = &run.journal.events()[..run.writes_done(self.cursor)];
        // A branch announcement of the runtime is not a write of the operator.
        let Some(last) = done.iter().rposition(|event| *event.buffer != *names::RUN) else {
            return Ok(false);
        };
        let event = done[last].place.events;
        let before = Point { event, write: (last - run.journal.before(event)) as u32 };
        if let Some((parent, at, _)) = run.branched_from
            && before.event == at.event
            && before.write == at.write + 1
        {
            // This write began the run: without it, this is the run that it branched from.
            leaves(self);
            self.switch_to_point(parent, at)?;
            return Ok(true);
        }
        self.cursor = before;
        self.bring_to_cursor()?;
        self.fork(leaves)?;
        Ok(true)
    }

    /// Goes to another run, at the viewed time or at the end of that run, whichever is earlier.
    pub fn switch_to(&mut self, run: RunId) -> Result<(), RunError> {
        self.switch_to_with(run, |_| {})
    }

    /// [`Session::switch_to`]; `leaves` is called if that is not the viewed run, before anything of it is executed.
    pub(crate) fn switch_to_with(&mut self, run: RunId, leaves: impl FnOnce(&Self)) -> Result<(), RunError> {
        let index = run.0 as usize;
        if index >= self.runs.len() {
            return Err(RunError::Refused(format!(
                "there is no {run}; expected 0 to {}",
                self.runs.len() - 1
            )));
        }
        if index != self.run {
            leaves(self);
        }
        let time = self.now().min(self.runs[index].end_time);
        let was_at_end = self.is_at_end();
        self.run = index;
        let target = &self.runs[index];
        let point = if was_at_end && time == target.end_time {
            target.end
        } else {
            target.settled(self.events_at(time))
        };
        self.switch_to_point(index, point)
    }

    fn switch_to_point(&mut self, run: usize, point: Point) -> Result<(), RunError> {
        self.run = run;
        // Taps that see every message once see only what is new in this run.
        self.cursor = self.runs[run].end;
        self.bring_to_cursor()?;
        self.machine.buffers().iter().for_each(|buffer| buffer.begin_anew());
        self.look(point);
        Ok(())
    }

    /// Begins another run at the position of the machine, calls `moved`, and announces it in the run.
    fn fork(&mut self, moved: impl FnOnce(&Self)) -> Result<(), RunError> {
        let (parent, at) = (self.at_run, self.at());
        let run = self.runs.len();
        let newest: Vec<u64> = self.machine.buffers().iter().map(|buffer| buffer.newest()).collect();
        let stretch = self.stretches[self.at_stretch].fork(run, at.event);
        let old = &self.runs[parent];
        let place = old.place_of(&self.stretches, at.event);
        let mut line = old.line[..=place].to_vec();
        line[place] = self.stretches.len();
        let begun = Run {
            branched_from: Some((parent, at, self.machine.now)),
            line,
            journal: Journal::new(old.journal.events()[..old.writes_done(at)].to_vec()),
            end: at,
            end_time: self.machine.now,
            head: None,
        };
        self.at_stretch = self.stretches.len();
        self.stretches.push(stretch);
        self.runs.push(begun);
        (self.at_run, self.run) = (run, run);
        (self.filling, self.gave_up) = (None, None);
        self.machine.buffers().iter().for_each(|buffer| buffer.begin_anew());
        self.retention.send(Job::Begun { run, origin: Origin { parent, newest } });
        moved(self);
        self.tape.at(Point { event: at.event, write: at.write + 1 });
        let said = self.machine.begin_branch(&RunId(parent as u32).to_string())?;
        self.written(said);
        Ok(())
    }

    /// Executes the writes after the last event, then the next event.
    fn step(&mut self) -> Result<Option<Happened>, RunError> {
        let all = self.runs[self.at_run].writes_at(self.machine.events);
        while self.at_write < all {
            self.repeat_write()?;
        }
        self.tape.at(Point::after(self.machine.events + 1));
        let Some(happened) = self.machine.advance()? else { return Ok(None) };
        self.at_write = 0;
        if happened == Happened::Input {
            self.refer_to_log();
        }
        let (event, now) = (self.machine.events, self.machine.now);
        if event > self.runs[self.at_run].end.event {
            let stretch = &mut self.stretches[self.at_stretch];
            stretch.mark(now, happened);
            let due = now.0 / STRETCH_NS > stretch.start.0 / STRETCH_NS || stretch.len() >= STRETCH_EVENTS;
            // A snapshot waits for cycles that are computing, so the stretch preferably ends when there are none.
            let late = now.0 - stretch.start.0 > STRETCH_NS + PATIENCE_NS;
            let run = &mut self.runs[self.at_run];
            run.end = Point::after(event);
            run.end_time = now;
            run.head = None;
            if due && (late || !self.machine.is_computing()) {
                self.cut();
            }
        } else if event == self.stretches[self.at_stretch].to() {
            self.enter_next();
        }
        Ok(Some(happened))
    }

    /// Executes the next of the writes at this event.
    fn repeat_write(&mut self) -> Result<(), RunError> {
        let run = &self.runs[self.at_run];
        let event = run.journal.events()[run.writes_done(self.at())].clone();
        self.at_write += 1;
        self.tape.at(self.at());
        self.machine.retake(event)
    }

    /// Messages that the last event read from the log need not be kept, because the log has them.
    fn refer_to_log(&mut self) {
        let Some(given) = self.machine.feed.as_ref().and_then(crate::feed::Feed::given) else { return };
        let mut samples = self.tape.samples();
        for input in &self.machine.plan().inputs {
            let buffer = &self.machine.buffers()[input.buffer];
            if let Some(entry) = samples.written[input.buffer].last_mut()
                && entry.point.event == self.machine.events
                && let Stored::InMemory(message) = &entry.held
            {
                let schema = Arc::clone(&buffer.spec().schema);
                let there = StoredElsewhere::with(Location::Log(given), schema, message.clone());
                entry.held = Stored::Elsewhere(Arc::new(there));
            }
        }
    }

    /// Ends a stretch at the end of a run, and begins the next one.
    fn cut(&mut self) {
        let closing = self.tape.samples().closing();
        let samples = Arc::new(self.tape.replace(Samples::begin(closing)));
        let stretch = &mut self.stretches[self.at_stretch];
        stretch.set_index(&samples);
        stretch.samples.memory = Some(samples);
        let last = stretch.snapshot.memory.clone();
        let snapshot = Arc::new(self.machine.snapshot_sharing(last.as_deref()));
        if self.stretches.len().is_power_of_two() {
            self.measure_snapshot(&snapshot);
        }
        self.at_stretch = self.stretches.len();
        self.stretches.push(Stretch::begin(self.at_run, snapshot));
        self.runs[self.at_run].line.push(self.at_stretch);
        self.enforce_budgets();
    }
}
