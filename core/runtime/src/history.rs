//! Going back: a stepped run with its past.
//!
//! A [`Session`] keeps snapshots (dense for the last cycles, thinned behind, on disk past a number) and what the
//! operator did, by event. Going back restores the nearest snapshot and runs forward, doing what the operator did
//! again. A write of the operator's after going back begins a branch: what was ahead is forgotten.

use crate::error::RunError;
use crate::journal::{ExternalEvent, Journal};
use crate::snapshot::Snapshot;
use crate::source::{SourceError, Task};
use crate::stepped::{Happened, Stepped};
use rcs_msg::Stamp;
use std::collections::{BTreeMap, VecDeque};
use std::fs;
use std::path::PathBuf;

/// How many snapshots are kept of the last moments at which processes ran.
const DENSE: usize = 96;
/// Behind those, one snapshot is kept in this much simulated time.
const THINNED_NS: u64 = 1_000_000_000;
/// How many thinned snapshots are kept in memory; older ones go to disk. With four cameras each is some 25 MB.
const THINNED_IN_MEMORY: usize = 24;
/// On disk, one snapshot is kept in this much simulated time.
const ON_DISK_NS: u64 = 10_000_000_000;

/// A stepped run that can go back.
pub struct Session {
    run: Stepped,
    dense: VecDeque<Snapshot>,
    thinned: BTreeMap<u64, Kept>,
    spill: Option<Spill>,
    /// What came from outside.
    journal: Journal,
    /// How many of its events the run has seen as it stands.
    writes_done: usize,
    marks: Vec<Mark>,
    /// Per buffer, after how many events a message was in it that was not there before; ascending.
    written: Vec<Vec<u64>>,
    /// Per buffer, the sequence of the newest message after the last of `marks`.
    newest: Vec<u64>,
    branched: bool,
}

enum Kept {
    InMemory(Box<Snapshot>),
    OnDisk { file: PathBuf, now: Stamp },
}

impl Kept {
    fn now(&self) -> Stamp {
        match self {
            Kept::InMemory(snapshot) => snapshot.now,
            Kept::OnDisk { now, .. } => *now,
        }
    }
}

/// A folder for snapshots, removed with the session.
struct Spill {
    folder: PathBuf,
}

impl Drop for Spill {
    fn drop(&mut self) {
        // Nothing can be done about a folder that does not go, and nothing depends on it.
        let _ = fs::remove_dir_all(&self.folder);
    }
}

/// What one event was, and when: enough to find the step before.
#[derive(Clone, Copy)]
struct Mark {
    time: Stamp,
    what: Happened,
}

impl Session {
    /// A session of a run that has not begun.
    pub fn new(mut run: Stepped) -> Result<Self, RunError> {
        run.begin()?;
        let newest = newest_of(&run);
        let mut session = Self {
            run,
            dense: VecDeque::new(),
            thinned: BTreeMap::new(),
            spill: None,
            journal: Journal::default(),
            writes_done: 0,
            marks: Vec::new(),
            written: vec![Vec::new(); newest.len()],
            newest,
            branched: false,
        };
        session.keep();
        Ok(session)
    }

    /// The run as it stands.
    pub fn run(&self) -> &Stepped {
        &self.run
    }

    /// Whether the operator has changed the past.
    pub fn is_branch(&self) -> bool {
        self.branched
    }

    /// Does the next event; `None` where nothing is left to do.
    pub fn forward(&mut self) -> Result<Option<Happened>, RunError> {
        self.repeat_writes()?;
        let before = self.run.now;
        let Some(happened) = self.run.advance()? else { return Ok(None) };
        if self.run.events as usize > self.marks.len() {
            self.marks.push(Mark { time: self.run.now, what: happened });
            for (buffer, newest) in newest_of(&self.run).into_iter().enumerate() {
                if newest > self.newest[buffer] {
                    self.newest[buffer] = newest;
                    self.written[buffer].push(self.run.events);
                }
            }
        }
        if self.run.now > before || matches!(happened, Happened::Cycle(_)) {
            self.keep();
        }
        Ok(Some(happened))
    }

    /// Does everything up to and with `until`; `false` where nothing is left after that.
    pub fn forward_until(&mut self, until: Stamp, task: &Task) -> Result<bool, SourceError> {
        let from = self.run.now;
        loop {
            task.check()?;
            match self.run.next_time()? {
                Some(time) if time <= until => {
                    self.forward()?;
                    let span = until.seconds_since(from);
                    if span > 0.0 {
                        task.report(self.run.now.seconds_since(from) / span);
                    }
                }
                next => return Ok(next.is_some()),
            }
        }
    }

    /// Goes forward to the end of the next event that `is_wanted` accepts; `false` where there is none before `until`.
    pub fn forward_to(
        &mut self,
        until: Stamp,
        task: &Task,
        mut is_wanted: impl FnMut(&Stepped, Happened) -> bool,
    ) -> Result<bool, SourceError> {
        loop {
            task.check()?;
            match self.run.next_time()? {
                Some(time) if time <= until => {}
                _ => return Ok(false),
            }
            match self.forward()? {
                Some(happened) if is_wanted(&self.run, happened) => return Ok(true),
                Some(_) => {}
                None => return Ok(false),
            }
        }
    }

    /// Goes to where `events` events have been done: back to the nearest snapshot before, then forward.
    pub fn go_to_event(&mut self, events: u64, task: &Task) -> Result<(), SourceError> {
        if events < self.run.events {
            self.restore_before(events)?;
        }
        let from = self.run.events;
        while self.run.events < events {
            task.check()?;
            if self.forward()?.is_none() {
                break;
            }
            task.report((self.run.events - from) as f64 / (events - from).max(1) as f64);
        }
        self.repeat_writes()?;
        Ok(())
    }

    /// Does again what the operator did at this very event.
    fn repeat_writes(&mut self) -> Result<(), RunError> {
        while let Some(event) = self.journal.events().get(self.writes_done)
            && event.place.events <= self.run.events
        {
            self.writes_done += 1;
            self.run.take(event.clone())?;
        }
        Ok(())
    }

    /// Goes to a time: everything up to and with it has been done, nothing after it.
    pub fn go_to_time(&mut self, to: Stamp, task: &Task) -> Result<(), SourceError> {
        if to < self.run.now {
            let events = self.marks.partition_point(|mark| mark.time <= to) as u64;
            return self.go_to_event(events, task);
        }
        self.forward_until(to, task)?;
        Ok(())
    }

    /// How many events had been done after the last event before now that `is_wanted` accepts.
    pub fn event_before(&self, mut is_wanted: impl FnMut(Happened) -> bool) -> Option<u64> {
        let done = (self.run.events as usize).min(self.marks.len());
        let before = &self.marks[..done.saturating_sub(1)];
        before.iter().rposition(|mark| is_wanted(mark.what)).map(|index| index as u64 + 1)
    }

    /// How many events had been done when the last message before now came into a buffer (by its place in the plan).
    pub fn event_of_message_before(&self, buffer: usize) -> Option<u64> {
        let events = &self.written[buffer];
        let before = events.partition_point(|&event| event < self.run.events);
        before.checked_sub(1).map(|index| events[index])
    }

    /// An operator's write, now. After going back it begins a branch.
    pub fn write(&mut self, event: ExternalEvent) -> Result<(), RunError> {
        let at = self.run.events;
        let event = self.run.take(event)?;
        if (at as usize) < self.marks.len() || self.journal.up_to(at) < self.journal.len() {
            self.branched = true;
            self.marks.truncate(at as usize);
            for events in &mut self.written {
                events.truncate(events.partition_point(|&event| event <= at));
            }
            self.newest = newest_of(&self.run);
            self.journal.truncate(self.journal.up_to(at));
            self.dense.retain(|snapshot| snapshot.events <= at);
            self.thinned.retain(|&event, _| event <= at);
        }
        // A snapshot of this very event was taken before the write: going back there does the write again.
        self.journal.push(event);
        self.writes_done = self.journal.len();
        Ok(())
    }

    fn keep(&mut self) {
        let at = self.run.events;
        if self.dense.back().is_some_and(|snapshot| snapshot.events >= at) || self.thinned.contains_key(&at) {
            return;
        }
        self.dense.push_back(self.run.snapshot());
        if self.dense.len() <= DENSE {
            return;
        }
        let Some(old) = self.dense.pop_front() else { return };
        let last = self.thinned.range(..old.events).next_back().map(|(_, kept)| kept.now());
        if last.is_none_or(|last| old.now.0 / THINNED_NS > last.0 / THINNED_NS) {
            self.thinned.insert(old.events, Kept::InMemory(Box::new(old)));
            self.spill_oldest();
        }
    }

    /// Moves the oldest thinned snapshot in memory to disk, where there are too many.
    fn spill_oldest(&mut self) {
        let in_memory = self.thinned.values().filter(|kept| matches!(kept, Kept::InMemory(_))).count();
        if in_memory <= THINNED_IN_MEMORY {
            return;
        }
        let oldest = self.thinned.iter().find_map(|(&event, kept)| match kept {
            // The very first stays: it is where everything can be reached from.
            Kept::InMemory(snapshot) if event > 0 => Some((event, snapshot)),
            _ => None,
        });
        let Some((event, snapshot)) = oldest else { return };
        let now = snapshot.now;
        let before = self.thinned.range(..event).next_back().map(|(_, kept)| kept.now());
        if before.is_some_and(|before| now.0 / ON_DISK_NS == before.0 / ON_DISK_NS) {
            self.thinned.remove(&event);
            return;
        }
        let encoded = snapshot.to_bytes();
        let written = encoded.map_err(|error| error.to_string()).and_then(|bytes| {
            let folder = self.spill_folder().map_err(|error| error.to_string())?;
            let file = folder.join(format!("{event}.snapshot"));
            fs::write(&file, bytes).map_err(|error| error.to_string())?;
            Ok(file)
        });
        match written {
            Ok(file) => {
                self.thinned.insert(event, Kept::OnDisk { file, now });
            }
            Err(error) => {
                // Going back takes longer without it, but stays possible.
                tracing::warn!("a snapshot was dropped: {error}");
                self.thinned.remove(&event);
            }
        }
    }

    fn spill_folder(&mut self) -> std::io::Result<PathBuf> {
        if let Some(spill) = &self.spill {
            return Ok(spill.folder.clone());
        }
        let unique = std::time::SystemTime::now()
            .duration_since(std::time::UNIX_EPOCH)
            .map_or(0, |since| since.as_nanos());
        let folder = std::env::temp_dir().join(format!("ocu-{}-{unique}", std::process::id()));
        fs::create_dir_all(&folder)?;
        self.spill = Some(Spill { folder: folder.clone() });
        Ok(folder)
    }

    fn restore_before(&mut self, events: u64) -> Result<(), RunError> {
        self.restore_nearest(events)?;
        // A snapshot is taken before what the operator writes at its event.
        self.writes_done = self.journal.before(self.run.events);
        Ok(())
    }

    fn restore_nearest(&mut self, events: u64) -> Result<(), RunError> {
        let dense = self.dense.iter().rev().find(|snapshot| snapshot.events <= events);
        if let Some(snapshot) = dense {
            let snapshot = snapshot.clone();
            return self.run.restore(&snapshot);
        }
        let Some((_, kept)) = self.thinned.range(..=events).next_back() else {
            return Err(RunError::Snapshot(format!("there is none before event {events}")));
        };
        match kept {
            Kept::InMemory(snapshot) => {
                let snapshot = snapshot.clone();
                self.run.restore(&snapshot)
            }
            Kept::OnDisk { file, .. } => {
                let bytes = fs::read(file)
                    .map_err(|error| RunError::Snapshot(format!("{error}: {}", file.display())))?;
                self.run.restore(&Snapshot::from_bytes(&bytes)?)
            }
        }
    }
}

fn newest_of(run: &Stepped) -> Vec<u64> {
    run.buffers().iter().map(|buffer| buffer.newest()).collect()
}
