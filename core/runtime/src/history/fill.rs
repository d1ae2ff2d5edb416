//! Viewing the past, and recomputing what is no longer kept.

use super::runs::{Moment, Run, RunId};
use super::samples::{Entry, Point, Samples, Stored};
use super::{Session, Shown};
use crate::error::RunError;
use crate::snapshot::Snapshot;
use crate::source::{SourceError, Task};
use crate::stepped::Happened;
use rcs_bus::Sample;
use rcs_log::Log;
use rcs_msg::Stamp;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Greatest duration of one piece of background work.
const PIECE: Duration = Duration::from_millis(8);

/// The content of the buffers at a snapshot.
pub(super) fn opening(snapshot: &Snapshot) -> Vec<Option<Entry>> {
    let entry = |sample: &Sample| Entry {
        point: Point::after(snapshot.events),
        header: sample.header,
        held: Stored::InMemory(sample.message.clone()),
    };
    snapshot.latest().map(|sample| sample.map(entry)).collect()
}

impl Session {
    /// Number of events up to a time, within the executed part of the run.
    pub(crate) fn events_at(&self, time: Stamp) -> u64 {
        let run = &self.runs[self.run];
        let place = run.line.partition_point(|&stretch| self.stretches[stretch].start <= time);
        // If a stretch boundary lies between events of the same time, the later stretch begins at that time.
        self.stretches[run.line[place.saturating_sub(1)]].events_at(time)
    }

    /// Moves the view to a point of the run; executes nothing.
    pub(crate) fn look(&mut self, at: Point) {
        self.gave_up = None;
        let end = self.runs[self.run].end;
        let at = at.min(end);
        let before = self.place();
        let went_back = at < self.cursor;
        self.cursor = at;
        let place = self.place();
        // After a step back or a jump more steps back are likely, so the previous stretch is prepared.
        self.went_back = went_back || place > before + 1;
        if self.filling.is_some_and(|filling| filling != place || self.at_run != self.run) {
            self.filling = None;
        }
        if self.filling.is_none() && !self.is_at_hand(place) {
            self.begin_fill(place);
        }
    }

    /// Moves the view to the moment after an event and the writes that follow it.
    pub(crate) fn look_at_event(&mut self, event: u64) {
        let at = self.runs[self.run].settled(event);
        self.look(at);
    }

    /// Moves the view to the end of the run.
    pub(crate) fn look_at_end(&mut self) {
        self.look(Point::end_of(u64::MAX));
    }

    /// Moves the view to a time.
    pub(crate) fn look_at_time(&mut self, time: Stamp) {
        self.look_at_event(self.events_at(time));
    }

    /// Index of the viewed stretch in the run.
    fn place(&self) -> usize {
        self.runs[self.run].place_of(&self.stretches, self.cursor.event)
    }

    /// Whether the tape has the messages of a stretch up to a point.
    pub(super) fn is_on_tape(&self, stretch: usize, at: Point) -> bool {
        self.at_stretch == stretch && self.at() >= at
    }

    /// Whether the messages of a stretch up to the cursor are available; reads them from disk if necessary.
    fn is_at_hand(&mut self, place: usize) -> bool {
        let stretch = self.runs[self.run].line[place];
        self.is_on_tape(stretch, self.cursor) || self.load(stretch)
    }

    /// Brings the messages of a stretch into memory if they are on disk; `false` if they are not kept.
    fn load(&mut self, stretch: usize) -> bool {
        if self.stretches[stretch].samples.memory.is_some() {
            return true;
        }
        let Some(samples) = self.read(stretch) else { return false };
        self.stretches[stretch].samples.memory = Some(samples);
        self.make_room_for(stretch);
        true
    }

    /// The messages of a stretch from memory, or from disk without keeping them in memory. What cannot be read is
    /// reported.
    pub(super) fn read(&mut self, stretch: usize) -> Option<Arc<Samples>> {
        let kept = &self.stretches[stretch].samples;
        if let Some(samples) = &kept.memory {
            return Some(Arc::clone(samples));
        }
        let packed = kept.disk.clone()?;
        self.retention.reads += 1;
        match packed.load(self.machine.plan()) {
            Ok(samples) => Some(Arc::new(samples)),
            Err(error) => {
                self.lose(stretch, &error.to_string());
                None
            }
        }
    }

    /// Messages of a stretch could not be read: they are computed again.
    fn lose(&mut self, stretch: usize, why: &str) {
        let at = self.stretches[stretch].start.seconds_since(self.machine.start);
        self.retention.report(format!(
            "what was kept of {at:.0} s could not be read back, and is computed again: {why}"
        ));
        self.stretches[stretch].samples.disk = None;
        self.stretches[stretch].samples.memory = None;
    }

    fn begin_fill(&mut self, place: usize) {
        let stretch = self.runs[self.run].line[place];
        let point = Point::after(self.stretches[stretch].from);
        if self.at_run != self.run || self.at() > point || self.at_stretch != stretch {
            self.leave();
            if let Err(error) = self.place_machine(self.run, point) {
                self.retention.report(error.to_string());
                self.give_up(stretch);
                return;
            }
        }
        self.filling = Some(place);
    }

    /// A stretch could not be computed.
    fn give_up(&mut self, stretch: usize) {
        (self.filling, self.gave_up) = (None, Some(stretch));
    }

    /// Continues recomputing for a limited time; `true` if work is left.
    pub(crate) fn fill_for(&mut self, time: Duration) -> bool {
        let until = Instant::now() + time;
        while let Some(place) = self.filling {
            let stretch = self.runs[self.run].line[place];
            if self.at().event >= self.stretches[stretch].to() || self.at_run != self.run {
                self.filling = None;
                break;
            }
            match self.step() {
                Ok(Some(_)) => {}
                Ok(None) => self.give_up(stretch),
                Err(error) => {
                    self.retention.report(error.to_string());
                    self.give_up(stretch);
                }
            }
            if Instant::now() >= until {
                break;
            }
        }
        self.filling.is_some()
    }

    /// Recomputes everything that the view needs.
    pub(crate) fn fill(&mut self, task: &Task) -> Result<(), SourceError> {
        while self.filling.is_some() && self.is_pending() {
            task.check()?;
            self.fill_for(PIECE);
            task.report(self.fill_progress().unwrap_or(1.0));
        }
        Ok(())
    }

    /// Whether something that the view needs is still to be recomputed.
    pub(crate) fn is_pending(&self) -> bool {
        let stretch = self.runs[self.run].line[self.place()];
        self.stretches[stretch].samples.memory.is_none() && !self.is_on_tape(stretch, self.cursor)
    }

    /// Progress of the recomputation, 0 to 1; `None` if there is none.
    pub(crate) fn fill_progress(&self) -> Option<f64> {
        let place = self.filling?;
        let stretch = &self.stretches[self.runs[self.run].line[place]];
        let start = self.fill_start(place);
        Some((self.at().event.saturating_sub(start)) as f64 / (stretch.to() - start).max(1) as f64)
    }

    /// Number of events at the nearest snapshot before a stretch.
    fn fill_start(&self, place: usize) -> u64 {
        let line = &self.runs[self.run].line[..=place];
        let kept = line.iter().rev().find(|&&stretch| self.stretches[stretch].snapshot.is_kept());
        kept.map_or(0, |&stretch| self.stretches[stretch].from)
    }

    /// Background work: recomputes what the view needs and, when going back, the previous stretch.
    pub(crate) fn idle(&mut self) -> bool {
        self.collect_written();
        if self.filling.is_some() {
            return self.fill_for(PIECE) || self.went_back;
        }
        let place = self.place();
        let viewed = self.runs[self.run].line[place];
        let prepares = self.went_back && place > 0;
        if self.gave_up == Some(viewed) || (!prepares && !self.is_pending()) {
            return false;
        }
        // The viewed stretch comes first: a part of it that is only on the tape is lost when the machine moves away.
        let is_in_it = self.at_run == self.run && self.at_stretch == viewed;
        let is_whole = is_in_it && self.at().event >= self.stretches[viewed].to();
        if !is_whole && !self.load(viewed) {
            if is_in_it {
                self.filling = Some(place);
            } else {
                self.begin_fill(place);
            }
            return self.filling.is_some();
        }
        self.went_back = false;
        if !prepares {
            return false;
        }
        let before = self.runs[self.run].line[place - 1];
        if !self.is_on_tape(before, Point::after(self.stretches[before].to())) && !self.load(before) {
            self.begin_fill(place - 1);
        }
        self.filling.is_some()
    }

    /// The newest message of a buffer at the viewed moment.
    pub(crate) fn latest(&mut self, buffer: usize) -> Shown {
        let stretch = self.runs[self.run].line[self.place()];
        let (entry, pending) = if self.is_on_tape(stretch, self.cursor) {
            (self.tape.samples().latest(buffer, self.cursor).cloned(), false)
        } else if let Some(samples) = &self.stretches[stretch].samples.memory {
            (samples.latest(buffer, self.cursor).cloned(), false)
        } else {
            let after = Point { event: self.cursor.event, write: self.cursor.write.saturating_add(1) };
            let wanted = self.stretches[stretch].written_before(buffer, after);
            let pending = self.at_stretch != stretch || wanted.is_some_and(|wanted| wanted > self.at());
            (self.tape.samples().latest(buffer, self.cursor).cloned(), pending)
        };
        let Some(entry) = entry else { return Shown { sample: None, pending } };
        match entry.sample(self.log().as_ref()) {
            Ok(sample) => Shown { sample: Some(sample), pending },
            Err(error) => {
                self.lose(stretch, &error.to_string());
                let place = self.place();
                self.begin_fill(place);
                Shown { sample: None, pending: true }
            }
        }
    }

    /// The moment of another run at a time, and its time: the end of that run, if it ended before.
    pub(crate) fn moment_in(&self, run: RunId, time: Stamp) -> (Moment, Stamp) {
        let known = &self.runs[run.0 as usize];
        let place = known.line.partition_point(|&stretch| self.stretches[stretch].start <= time);
        let event = self.stretches[known.line[place.saturating_sub(1)]].events_at(time);
        let at = known.settled(event).min(known.end);
        (Moment { run, event: at.event, write: at.write }, time.min(known.end_time))
    }

    /// The newest message of a buffer at a moment of any run, as far as it was kept; nothing is computed again for it.
    pub(crate) fn latest_in(&mut self, at: Moment, buffer: usize) -> Shown {
        let run = &self.runs[at.run.0 as usize];
        let stretch = run.line[run.place_of(&self.stretches, at.event)];
        let at = Point { event: at.event, write: at.write };
        let entry = if self.is_on_tape(stretch, at) {
            self.tape.samples().latest(buffer, at).cloned()
        } else if self.load(stretch) {
            let samples = self.stretches[stretch].samples.memory.as_ref();
            samples.and_then(|samples| samples.latest(buffer, at).cloned())
        } else {
            return Shown { sample: None, pending: true };
        };
        let sample = entry.and_then(|entry| entry.sample(self.log().as_ref()).ok());
        Shown { sample, pending: false }
    }

    pub(super) fn log(&self) -> Option<Log> {
        self.machine.feed.as_ref().map(|feed| feed.log().clone())
    }

    /// Number of messages of a buffer up to the viewed moment.
    pub(crate) fn messages(&self, buffer: usize) -> u64 {
        self.messages_in(self.moment(), buffer)
    }

    /// The viewed point.
    pub(crate) fn cursor(&self) -> Point {
        self.cursor
    }

    /// Number of events after the last event before the cursor that `is_wanted` accepts.
    pub fn event_before(&self, mut is_wanted: impl FnMut(Happened) -> bool) -> Option<u64> {
        let line = &self.runs[self.run].line[..=self.place()];
        let before = self.cursor.event;
        line.iter().rev().find_map(|&stretch| self.stretches[stretch].event_before(before, &mut is_wanted))
    }

    /// The same for the first event after the cursor, within the executed part of the run.
    pub fn event_after(&self, mut is_wanted: impl FnMut(Happened) -> bool) -> Option<u64> {
        let run = &self.runs[self.run];
        let line = &run.line[self.place()..];
        line.iter()
            .find_map(|&stretch| self.stretches[stretch].event_after(self.cursor.event, &mut is_wanted))
            .filter(|&event| event <= run.end.event)
    }

    /// The last point before the cursor at which a message was written to a buffer (index in the plan).
    pub(crate) fn message_before(&self, buffer: usize) -> Option<Point> {
        let line = &self.runs[self.run].line[..=self.place()];
        line.iter().rev().find_map(|&stretch| {
            if self.is_on_tape(stretch, self.cursor) {
                let samples = self.tape.samples();
                let written = &samples.written[buffer];
                let before = written.partition_point(|entry| entry.point < self.cursor);
                return before.checked_sub(1).map(|index| written[index].point);
            }
            self.stretches[stretch].written_before(buffer, self.cursor)
        })
    }

    /// The point at which the message with this sequence, from 1, was written to a buffer: the start of the run if that
    /// was before its first event. `None` if it was not written up to the cursor.
    pub(crate) fn written_at(&self, buffer: usize, sequence: u64) -> Option<Point> {
        let line = &self.runs[self.run].line[..=self.place()];
        let later = line.partition_point(|&stretch| self.stretches[stretch].newest[buffer] < sequence);
        let Some(place) = later.checked_sub(1) else {
            return (sequence > 0).then(|| Point::after(self.stretches[line[0]].from));
        };
        let stretch = &self.stretches[line[place]];
        let index = (sequence - stretch.newest[buffer] - 1) as usize;
        let point = if self.is_on_tape(line[place], self.cursor) {
            self.tape.samples().written[buffer].get(index).map(|entry| entry.point)
        } else {
            stretch.written_nth(buffer, index)
        };
        point.filter(|&point| point <= self.cursor)
    }

    /// The first point after the cursor at which a message was written to a buffer, within the executed part of the
    /// run.
    pub(crate) fn message_after(&self, buffer: usize) -> Option<Point> {
        let run = &self.runs[self.run];
        run.line[self.place()..].iter().find_map(|&stretch| {
            if self.is_on_tape(stretch, Point::end_of(self.stretches[stretch].to()).min(run.end)) {
                let samples = self.tape.samples();
                let written = &samples.written[buffer];
                let after = written.partition_point(|entry| entry.point <= self.cursor);
                return written.get(after).map(|entry| entry.point);
            }
            self.stretches[stretch].written_after(buffer, self.cursor)
        })
    }

    /// Moves the machine to a point of a run.
    pub(super) fn bring(&mut self, run: usize, to: Point, task: &Task) -> Result<(), SourceError> {
        (self.filling, self.gave_up) = (None, None);
        if !self.is_near(run, to) {
            self.leave();
            self.place_machine(run, to)?;
        }
        let from = self.at().event;
        while self.at() < to {
            task.check()?;
            if self.at().event == to.event {
                self.repeat_write()?;
            } else if self.step()?.is_none() {
                break;
            }
            task.report((self.at().event - from) as f64 / (to.event - from).max(1) as f64);
        }
        Ok(())
    }

    /// Whether it is faster to run the machine on to a point than to restore a snapshot.
    fn is_near(&self, run: usize, to: Point) -> bool {
        if self.at_run != run || self.at() > to {
            return false;
        }
        let line = &self.runs[run].line;
        let place = self.runs[run].place_of(&self.stretches, to.event);
        let (Some(from), Some(_)) = (line.iter().position(|&s| s == self.at_stretch), line.get(place)) else {
            return false;
        };
        let head = to == self.runs[run].end && self.runs[run].head.is_some();
        !head && !line[from + 1..=place.max(from)].iter().any(|&s| self.stretches[s].snapshot.is_kept())
    }

    /// Called before the machine moves away: keeps its state if it is at the end of a run.
    pub(super) fn leave(&mut self) {
        if !self.is_machine_at_end() || self.runs[self.at_run].head.is_some() {
            return;
        }
        let empty = Samples::begin(vec![None; self.machine.buffers().len()]);
        let samples = Arc::new(self.tape.replace(empty));
        let stretch = &mut self.stretches[self.at_stretch];
        stretch.set_index(&samples);
        stretch.samples.memory = Some(samples);
        self.runs[self.at_run].head = Some(Arc::new(self.machine.snapshot()));
    }

    /// Moves the machine to a point of a run, or to the nearest snapshot before it.
    fn place_machine(&mut self, run: usize, to: Point) -> Result<(), RunError> {
        if to == self.runs[run].end
            && let Some(&stretch) = self.runs[run].line.last()
            && self.load(stretch)
            && let Some(head) = self.runs[run].head.take()
        {
            self.machine.restore(&head)?;
            let samples = self.stretches[stretch].samples.memory.take();
            self.tape.replace(samples.map(Arc::unwrap_or_clone).unwrap_or_default());
            (self.at_run, self.at_stretch, self.at_write) = (run, stretch, to.write);
            return Ok(());
        }
        for place in (0..=self.runs[run].place_of(&self.stretches, to.event)).rev() {
            let stretch = self.runs[run].line[place];
            if let Some(snapshot) = self.snapshot_of(stretch) {
                self.machine.restore(&snapshot)?;
                self.tape.replace(Samples::begin(opening(&snapshot)));
                (self.at_run, self.at_stretch, self.at_write) = (run, stretch, 0);
                return Ok(());
            }
        }
        Err(RunError::Snapshot(format!("there is none before event {}", to.event)))
    }

    /// The snapshot at the start of a stretch, read from disk if necessary. If it cannot be read, this is reported and
    /// the snapshot is dropped.
    fn snapshot_of(&mut self, stretch: usize) -> Option<Arc<Snapshot>> {
        let kept = &mut self.stretches[stretch].snapshot;
        if let Some(snapshot) = &kept.memory {
            return Some(Arc::clone(snapshot));
        }
        let packed = kept.disk.clone()?;
        match packed.load() {
            Ok(snapshot) => Some(Arc::new(snapshot)),
            Err(error) => {
                kept.disk = None;
                let at = self.stretches[stretch].start.seconds_since(self.machine.start);
                self.retention.report(format!("{error}; an older one than that of {at:.0} s is used"));
                None
            }
        }
    }

    /// The machine has reached the end of a stretch that was executed before.
    pub(super) fn enter_next(&mut self) {
        let Run { line, .. } = &self.runs[self.at_run];
        let place = line.iter().position(|&stretch| stretch == self.at_stretch);
        let Some(&next) = place.and_then(|place| line.get(place + 1)) else { return };
        let closing = self.tape.samples().closing();
        let samples = self.tape.replace(Samples::begin(closing));
        let stretch = &mut self.stretches[self.at_stretch];
        if stretch.samples.memory.is_none() {
            stretch.set_index(&samples);
            stretch.samples.memory = Some(Arc::new(samples));
        }
        self.at_stretch = next;
        self.enforce_budgets();
    }
}
