//! Reads the messages of any run, the viewed one or another: in order as the run grows, those up to a moment, or all.
//!
//! A run that grows is read in pieces that another thread can decode: what was kept in memory is shared, and what is on
//! disk is read there. Up to a moment, only what is in memory is read. All messages of all runs are read at once, also
//! from disk.

use super::Session;
use super::pack::PackedSamples;
use super::runs::{Moment, RunId};
use super::samples::{Entry, Point, Samples};
use crate::stack::Plan;
use rcs_bus::Sample;
use rcs_log::Log;
use rcs_msg::Stamp;
use std::io;
use std::sync::Arc;

/// How far a run has been read.
pub(crate) struct RunReader {
    run: usize,
    /// Index in the run of the stretch that is read, and the point up to which it was read.
    place: usize,
    after: Point,
}

/// The messages of a part of a run.
pub(crate) struct Piece {
    held: Held,
    after: Point,
    to: Point,
    /// Time at which the part begins.
    pub(crate) from: Stamp,
    /// Every message before this time is in this part or in one before it.
    pub(crate) until: Stamp,
}

enum Held {
    Memory(Arc<Samples>),
    Disk(Arc<PackedSamples>),
    Entries(Vec<(usize, Entry)>),
    /// They were not kept.
    Nothing,
}

impl Session {
    /// A reader at the start of a run, or where the run parts from `other`.
    pub(crate) fn reader(&self, run: RunId, other: Option<RunId>) -> RunReader {
        let line = |run: RunId| &self.runs[run.0 as usize].line;
        let shared = other.map_or(0, |other| {
            line(run).iter().zip(line(other)).take_while(|(mine, theirs)| mine == theirs).count()
        });
        let from = line(run).get(shared).map_or(0, |&stretch| self.stretches[stretch].from);
        RunReader { run: run.0 as usize, place: shared, after: Point::after(from) }
    }

    /// What was written before the first event, which no reader gives: each message with the index of its buffer, in the
    /// order of time.
    pub(crate) fn opening(&self) -> Vec<(usize, Sample)> {
        let log = self.log();
        let lists = self.begun.written.iter().enumerate();
        let entries = lists.flat_map(|(buffer, written)| written.iter().map(move |entry| (buffer, entry)));
        let mut opening: Vec<(usize, Sample)> =
            entries.filter_map(|(buffer, entry)| Some((buffer, entry.sample(log.as_ref()).ok()?))).collect();
        opening.sort_by_key(|(_, sample)| sample.header.log_time);
        opening
    }

    /// The next messages of a run; `None` if there are none yet.
    pub(crate) fn read_on(&self, reader: &mut RunReader) -> Option<Piece> {
        let run = &self.runs[reader.run];
        let index = *run.line.get(reader.place)?;
        let next = run.line.get(reader.place + 1).map(|&next| &self.stretches[next]);
        let stretch = &self.stretches[index];
        let after = reader.after;
        // Writes after the last event of a stretch are in the next one.
        let end = next.map_or(run.end, |_| Point::after(stretch.to()));
        let (mut to, mut until) = (end, next.map_or(run.end_time, |next| next.start));
        let held = if let Some(samples) = &stretch.samples.memory {
            Held::Memory(Arc::clone(samples))
        } else if self.at_stretch == index {
            to = self.at().min(end);
            if to < end {
                until = self.machine.now();
            }
            let samples = self.tape.samples();
            let new = samples.written.iter().enumerate().flat_map(|(buffer, written)| {
                let from = written.partition_point(|entry| entry.point <= after);
                written[from..].iter().map(move |entry| (buffer, entry.clone()))
            });
            Held::Entries(new.collect())
        } else if let Some(packed) = &stretch.samples.disk {
            Held::Disk(Arc::clone(packed))
        } else {
            Held::Nothing
        };
        let is_done = next.is_some() && to == end;
        if to <= after && !is_done {
            return None;
        }
        reader.after = to;
        reader.place += usize::from(is_done);
        Some(Piece { held, after, to, from: stretch.start, until })
    }

    /// Number of messages of a buffer up to a moment.
    pub(crate) fn messages_in(&self, at: Moment, buffer: usize) -> u64 {
        let run = &self.runs[at.run.0 as usize];
        let index = run.line[run.place_of(&self.stretches, at.event)];
        let (stretch, at) = (&self.stretches[index], Point { event: at.event, write: at.write });
        if self.is_on_tape(index, at) {
            let samples = self.tape.samples();
            let done = samples.written[buffer].partition_point(|entry| entry.point <= at);
            return stretch.newest[buffer] + done as u64;
        }
        stretch.messages(buffer, at)
    }

    /// Messages of these buffers after `from` and up to a moment of the same run, as far as they are in memory, in the
    /// order of each buffer; whether that is all of them.
    pub(crate) fn since_in(
        &self,
        from: Point,
        at: Moment,
        buffers: &[usize],
        take: &mut dyn FnMut(usize, &Sample),
    ) -> bool {
        let log = self.log();
        let run = &self.runs[at.run.0 as usize];
        let to = Point { event: at.event, write: at.write };
        let place = |point: Point| run.place_of(&self.stretches, point.event);
        let mut is_whole = true;
        for &stretch in &run.line[place(from)..=place(to)] {
            let is_on_tape = self.is_on_tape(stretch, Point::end_of(self.stretches[stretch].to()).min(to));
            let memory = self.stretches[stretch].samples.memory.as_deref();
            is_whole &= is_on_tape || memory.is_some();
            // A part of the stretch may be on the tape.
            let tape = (self.at_stretch == stretch).then(|| self.tape.samples());
            let Some(samples) = memory.filter(|_| !is_on_tape).or(tape.as_deref()) else { continue };
            for &buffer in buffers {
                let written = &samples.written[buffer];
                let begin = written.partition_point(|entry| entry.point <= from);
                let end = written.partition_point(|entry| entry.point <= to);
                for entry in written.get(begin..end).unwrap_or_default() {
                    if let Ok(sample) = entry.sample(log.as_ref()) {
                        take(buffer, &sample);
                    }
                }
            }
        }
        is_whole
    }

    /// Every message of these buffers in all runs, as far as it was kept, with the indices of the runs that have it.
    /// Those of one buffer in one run are in the order in which they were written; `None` stands for messages that were
    /// not kept. Each stretch is read once, and what is on disk does not stay in memory. False if it was interrupted.
    pub(crate) fn each_message(
        &mut self,
        buffers: &[usize],
        is_interrupted: &dyn Fn() -> bool,
        take: &mut impl FnMut(&[usize], usize, Option<&Sample>),
    ) -> bool {
        if buffers.is_empty() {
            return true;
        }
        let log = self.log();
        let all: Vec<usize> = (0..self.runs.len()).collect();
        for &buffer in buffers {
            let written = &self.begun.written[buffer];
            for entry in written {
                if is_interrupted() {
                    return false;
                }
                take(&all, buffer, entry.sample(log.as_ref()).ok().as_ref());
            }
            // The session may have begun in the middle of the run.
            if written.len() as u64 != self.stretches[0].newest[buffer] {
                take(&all, buffer, None);
            }
        }
        // The stretches of each run are in ascending order.
        for stretch in 0..self.stretches.len() {
            let runs: Vec<usize> = (0..self.runs.len())
                .filter(|&run| self.runs[run].line.binary_search(&stretch).is_ok())
                .collect();
            // A stretch that several runs share lies before the end of each.
            let Some(end) = runs.iter().map(|&run| self.runs[run].end).min() else { continue };
            let is_on_tape = self.is_on_tape(stretch, Point::end_of(self.stretches[stretch].to()).min(end));
            let kept = if is_on_tape { None } else { self.read(stretch) };
            let tape = is_on_tape.then(|| self.tape.samples());
            let samples = kept.as_deref().or(tape.as_deref());
            for &buffer in buffers {
                let Some(samples) = samples else {
                    take(&runs, buffer, None);
                    continue;
                };
                for entry in samples.written[buffer].iter().filter(|entry| entry.point <= end) {
                    if is_interrupted() {
                        return false;
                    }
                    take(&runs, buffer, entry.sample(log.as_ref()).ok().as_ref());
                }
            }
        }
        true
    }
}

impl Piece {
    /// Reads the messages of the buffers for which `is_wanted` holds, in the order in which they were written. `None` if
    /// they were not kept.
    pub(crate) fn unpack(
        self,
        plan: &Plan,
        log: Option<&Log>,
        is_wanted: impl Fn(usize) -> bool,
    ) -> io::Result<Option<Vec<(usize, Sample)>>> {
        let is_in = |entry: &Entry| entry.point > self.after && entry.point <= self.to;
        let of_samples = |samples: &Samples| {
            let lists = samples.written.iter().enumerate().filter(|(buffer, _)| is_wanted(*buffer));
            let entries = lists.flat_map(|(buffer, list)| list.iter().map(move |entry| (buffer, entry)));
            entries.filter(|(_, entry)| is_in(entry)).map(|(buffer, entry)| (buffer, entry.clone())).collect()
        };
        let mut entries: Vec<(usize, Entry)> = match &self.held {
            Held::Nothing => return Ok(None),
            Held::Memory(samples) => of_samples(samples),
            Held::Disk(packed) => of_samples(&packed.load(plan)?),
            Held::Entries(entries) => {
                let wanted = entries.iter().filter(|(buffer, entry)| is_wanted(*buffer) && is_in(entry));
                wanted.cloned().collect()
            }
        };
        entries.sort_by_key(|(_, entry)| entry.point);
        let samples = entries.iter().map(|(buffer, entry)| Ok((*buffer, entry.sample(log)?)));
        samples.collect::<io::Result<_>>().map(Some)
    }
}
