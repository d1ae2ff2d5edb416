//! Retention of the past: what is kept in memory and on disk, within one budget in bytes for each.
//!
//! When memory becomes scarce, stretches are written to disk and dropped from memory, those farthest from the cursor
//! first. When disk becomes scarce, the messages of complete stretches are dropped, so that the density of what is kept
//! decreases with the distance (a dropped stretch can be executed again from its snapshot); then snapshots are dropped
//! by the same rule.

use super::Session;
use super::disk::Disk;
use super::options::PastOptions;
use super::samples::Tape;
use super::spill::{Done, Job, Spill};
use super::stretch::Stretch;
use crate::snapshot::Snapshot;
use crate::stack::Plan;
use rcs_msg::Stamp;
use std::collections::BTreeSet;
use std::sync::Arc;

/// Above this fraction of the memory, stretches are written to disk.
const WRITE_AT: f64 = 0.45;
/// Stretches on disk are dropped from memory until at most this fraction is used.
const KEEP: f64 = 0.6;
/// Above this fraction, the run waits for the disk.
const WAIT_AT: f64 = 0.8;
/// Above the first fraction of the disk, it is thinned, down to the second.
const THIN_AT: f64 = 0.92;
const THIN_TO: f64 = 0.85;
/// Number of stretches that are being written to disk at the same time.
const ON_THE_WAY: usize = 6;
/// After a disk error, this many stretches are kept in memory only before the disk is tried again.
const PAUSE: u32 = 30;
/// Snapshots this close to the cursor or to the end of the run stay in memory.
const SNAPSHOTS_NEAR_NS: u64 = 3_000_000_000;
/// An estimate, until one has been written.
const SNAPSHOT_BYTES: usize = 1 << 20;
const PROBLEMS: usize = 20;

/// Memory and disk that a past takes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PastUse {
    /// Approximate memory, bytes; shared data count once.
    pub memory_bytes: u64,
    /// Disk, bytes.
    pub disk_bytes: u64,
    /// Number of stretches of about a second.
    pub stretches: usize,
    /// Number of stretches whose messages are kept, in memory or on disk.
    pub with_messages: usize,
    /// Number of stretches with a snapshot, from which a run can continue at once.
    pub with_snapshot: usize,
    /// How often the messages of a stretch were read from disk.
    pub reads: u64,
}

pub(super) struct Retention {
    options: PastOptions,
    /// The part of the memory that others take, bytes.
    pub(super) reserved_bytes: u64,
    /// Memory of what was written before the first event, which always stays.
    pub(super) begun_bytes: usize,
    /// How often the messages of a stretch were read from disk.
    pub(super) reads: u64,
    plan: Arc<Plan>,
    disk: Arc<Disk>,
    spill: Option<Spill>,
    /// Jobs that must be first once the thread is running.
    early: Vec<Job>,
    problems: Vec<String>,
    /// Number of stretches to wait before the disk is tried again.
    pause: u32,
    snapshot_bytes: usize,
}

impl Retention {
    pub(super) fn new(options: PastOptions, plan: Arc<Plan>) -> Self {
        let disk = Disk::new(options.folder.clone(), options.disk_bytes);
        Self {
            options,
            reserved_bytes: 0,
            begun_bytes: 0,
            reads: 0,
            plan,
            disk,
            spill: None,
            early: Vec::new(),
            problems: Vec::new(),
            pause: 0,
            snapshot_bytes: SNAPSHOT_BYTES,
        }
    }

    pub(super) fn problems(&self) -> &[String] {
        &self.problems
    }

    /// Reports once what could not be done.
    pub(super) fn report(&mut self, problem: String) {
        if !self.problems.contains(&problem) && self.problems.len() < PROBLEMS {
            tracing::warn!("{problem}");
            self.problems.push(problem);
        }
    }

    pub(super) fn send(&mut self, job: Job) {
        match &mut self.spill {
            Some(spill) => spill.send(job),
            None => self.early.push(job),
        }
    }

    fn can_write(&self) -> bool {
        self.pause == 0 && self.options.disk_bytes > 0
    }

    /// Starts the thread if it is not running.
    fn start(&mut self) -> bool {
        if self.spill.is_some() {
            return true;
        }
        match Spill::start(Arc::clone(&self.disk), Arc::clone(&self.plan)) {
            Ok(mut spill) => {
                self.early.drain(..).for_each(|job| spill.send(job));
                self.spill = Some(spill);
                true
            }
            Err(error) => {
                self.report(format!("the past stays in memory: {error}"));
                self.pause = PAUSE;
                false
            }
        }
    }

    /// Memory that the past may take, bytes.
    fn memory_budget(&self) -> f64 {
        self.options.memory_bytes.saturating_sub(self.reserved_bytes) as f64
    }

    fn waiting(&self) -> usize {
        self.spill.as_ref().map_or(0, Spill::waiting)
    }

    /// Memory of the messages and the snapshot of a stretch.
    fn memory_of(&self, stretch: &Stretch) -> usize {
        let samples = stretch.samples.memory.is_some();
        let snapshot = stretch.snapshot.memory.is_some();
        usize::from(samples) * stretch.bytes + usize::from(snapshot) * self.snapshot_bytes
    }

    fn memory(&self, stretches: &[Stretch]) -> usize {
        let of_stretches = stretches.iter().map(|stretch| stretch.fixed_bytes() + self.memory_of(stretch));
        self.begun_bytes + of_stretches.sum::<usize>()
    }

    pub(super) fn usage(&self, stretches: &[Stretch], tape: &Tape) -> PastUse {
        PastUse {
            memory_bytes: (self.memory(stretches) + tape.samples().bytes()) as u64,
            disk_bytes: self.disk.bytes(),
            stretches: stretches.len(),
            with_messages: stretches.iter().filter(|stretch| stretch.samples.is_kept()).count(),
            with_snapshot: stretches.iter().filter(|stretch| stretch.snapshot.is_kept()).count(),
            reads: self.reads,
        }
    }
}

impl Session {
    /// Processes what has been written to disk since the last call.
    pub(super) fn collect_written(&mut self) {
        let done = self.retention.spill.as_mut().map(|spill| spill.done(false)).unwrap_or_default();
        self.take_done(done);
    }

    fn take_done(&mut self, done: Vec<Done>) {
        for done in done {
            let failed = match done {
                Done::Samples { stretch, packed } => {
                    let kept = &mut self.stretches[stretch].samples;
                    kept.pending = false;
                    packed.map(|packed| kept.disk = Some(packed)).err()
                }
                Done::Snapshot { stretch, packed } => {
                    let kept = &mut self.stretches[stretch].snapshot;
                    kept.pending = false;
                    match packed {
                        Ok(packed) => {
                            let (old, new) = (self.retention.snapshot_bytes, packed.bytes);
                            self.retention.snapshot_bytes = (old * 7 + new * 2) / 8;
                            kept.disk = Some(packed);
                            None
                        }
                        Err(error) => Some(error),
                    }
                }
            };
            if let Some(error) = failed {
                // A disk that is full because of its budget is thinned at once, and what is dropped is computed again;
                // a disk that is full by itself may stay so.
                let by_budget = error.contains(super::disk::OVER_BUDGET);
                self.retention.pause = if by_budget { 2 } else { PAUSE };
                if !by_budget {
                    self.retention.report(format!("the past could not be written to disk: {error}"));
                }
            }
        }
    }

    /// Enforces the budgets. Called whenever a stretch has been added to memory.
    pub(super) fn enforce_budgets(&mut self) {
        self.collect_written();
        self.retention.pause = self.retention.pause.saturating_sub(1);
        let budget = self.retention.memory_budget();
        let mut used = self.retention.memory(&self.stretches) as f64;
        if used > WRITE_AT * budget {
            self.write_out(used - WRITE_AT * budget);
        }
        if used > KEEP * budget {
            used = self.let_go(used, KEEP * budget, None);
        }
        while used > WAIT_AT * budget && self.retention.waiting() > 0 {
            let done = self.retention.spill.as_mut().map(|spill| spill.done(true)).unwrap_or_default();
            self.take_done(done);
            used = self.let_go(self.retention.memory(&self.stretches) as f64, KEEP * budget, None);
        }
        if used > WAIT_AT * budget {
            self.drop_from_memory(used, KEEP * budget);
        }
        self.thin_disk();
    }

    /// Enforces the budget for memory after a stretch was read from disk; that one stays.
    pub(super) fn make_room_for(&mut self, read: usize) {
        self.collect_written();
        let budget = self.retention.memory_budget();
        let used = self.retention.memory(&self.stretches) as f64;
        if used > KEEP * budget {
            self.let_go(used, KEEP * budget, Some(read));
        }
    }

    /// Measures the memory of a snapshot.
    pub(super) fn measure_snapshot(&mut self, snapshot: &Snapshot) {
        if let Ok(bytes) = snapshot.encode(&mut |_| Some(0)) {
            self.retention.snapshot_bytes = bytes.len();
        }
    }

    /// Distance of a stretch from the cursor and from the end of the run, in seconds; doubled for runs other than the
    /// viewed one.
    fn distance_s(&self, stretch: &Stretch, cursor: Stamp) -> f64 {
        let run = &self.runs[self.run];
        let end = run.end_time;
        let to_cursor = cursor.seconds_since(stretch.start).abs();
        let to_end = end.seconds_since(stretch.start).abs();
        let place = run.place_of(&self.stretches, stretch.from);
        let is_ours = self.stretches[run.line[place]].from == stretch.from
            && self.stretches[run.line[place]].run == stretch.run;
        to_cursor.min(to_end) * if is_ours { 1.0 } else { 2.0 } + if is_ours { 0.0 } else { 1.0 }
    }

    /// All stretches that are not in use, farthest first.
    fn farthest_first(&self) -> Vec<(usize, f64)> {
        let cursor = self.now();
        let ends: BTreeSet<usize> = self.runs.iter().filter_map(|run| run.line.last().copied()).collect();
        let looked_at =
            self.runs[self.run].line[self.runs[self.run].place_of(&self.stretches, self.cursor.event)];
        let free = |index: &usize| !ends.contains(index) && *index != self.at_stretch && *index != looked_at;
        let mut list: Vec<_> = (0..self.stretches.len())
            .filter(free)
            .map(|index| (index, self.distance_s(&self.stretches[index], cursor)))
            .collect();
        list.sort_by(|a, b| b.1.total_cmp(&a.1));
        list
    }

    /// Sends stretches to disk until `bytes` are being written.
    fn write_out(&mut self, bytes: f64) {
        if !self.retention.can_write() {
            return;
        }
        let mut sent = 0.0;
        for (index, _) in self.farthest_first() {
            if sent >= bytes || self.retention.waiting() >= 2 * ON_THE_WAY || !self.retention.start() {
                return;
            }
            let stretch = &mut self.stretches[index];
            if let Some(snapshot) = &stretch.snapshot.memory
                && stretch.snapshot.disk.is_none()
                && !stretch.snapshot.pending
            {
                stretch.snapshot.pending = true;
                let snapshot = Arc::clone(snapshot);
                self.retention.send(Job::Snapshot { stretch: index, run: stretch.run, snapshot });
            }
            if let Some(samples) = &stretch.samples.memory {
                sent += stretch.bytes as f64;
                if stretch.samples.disk.is_none() && !stretch.samples.pending {
                    stretch.samples.pending = true;
                    let samples = Arc::clone(samples);
                    self.retention.send(Job::Samples { stretch: index, run: stretch.run, samples });
                }
            }
        }
    }

    /// Drops from memory what is on disk, except of the stretch `kept`, until at most `to` bytes are used; returns the
    /// use.
    fn let_go(&mut self, mut used: f64, to: f64, kept: Option<usize>) -> f64 {
        for (index, distance) in self.farthest_first() {
            if kept == Some(index) {
                continue;
            }
            let stretch = &mut self.stretches[index];
            // The first snapshot stays, because everything can be recomputed from it whatever happens to the disk.
            if index > 0
                && stretch.snapshot.memory.is_some()
                && stretch.snapshot.disk.is_some()
                && distance * 1e9 > SNAPSHOTS_NEAR_NS as f64
            {
                stretch.snapshot.memory = None;
                used -= self.retention.snapshot_bytes as f64;
            }
            if stretch.samples.memory.is_some() && stretch.samples.disk.is_some() {
                stretch.samples.memory = None;
                used -= stretch.bytes as f64;
            }
            if used <= to {
                break;
            }
        }
        used
    }

    /// Drops messages, and then snapshots, that are in memory only, because there is no disk for them.
    fn drop_from_memory(&mut self, mut used: f64, to: f64) {
        let list = self.farthest_first();
        for &(index, distance) in &list {
            let stretch = &mut self.stretches[index];
            if used <= to || distance < 2.0 {
                break;
            }
            if stretch.samples.memory.take().is_some() {
                used -= stretch.bytes as f64;
            }
        }
        while used > to {
            let victim = self.sparsest(&list, |stretch| stretch.snapshot.memory.is_some());
            let Some(index) = victim else { return };
            self.stretches[index].snapshot.memory = None;
            used -= self.retention.snapshot_bytes as f64;
        }
    }

    /// Drops messages on disk, and then snapshots, if the disk's budget is nearly used up.
    fn thin_disk(&mut self) {
        let budget = self.retention.options.disk_bytes as f64;
        if self.retention.disk.bytes() as f64 <= THIN_AT * budget || budget == 0.0 {
            return;
        }
        let list = self.farthest_first();
        while self.retention.disk.living() as f64 > THIN_TO * budget {
            if let Some(index) = self.sparsest(&list, |stretch| stretch.samples.disk.is_some()) {
                self.stretches[index].samples.disk = None;
                self.stretches[index].samples.memory = None;
            } else if let Some(index) = self.sparsest(&list, |stretch| stretch.snapshot.disk.is_some()) {
                self.stretches[index].snapshot.disk = None;
                self.stretches[index].snapshot.memory = None;
            } else {
                return;
            }
        }
    }

    /// Of the stretches that have something to drop, the one whose gap would be smallest in relation to its distance,
    /// so that the density of what is kept decreases with the distance. The first stretch is never returned, because
    /// everything can be recomputed from it.
    fn sparsest(&self, list: &[(usize, f64)], has: impl Fn(&Stretch) -> bool) -> Option<usize> {
        let mut kept: Vec<(usize, f64)> =
            list.iter().copied().filter(|&(index, _)| index > 0 && has(&self.stretches[index])).collect();
        kept.sort_by_key(|&(index, _)| (self.stretches[index].run, self.stretches[index].from));
        let gap = |i: usize| {
            let start = |i: usize| self.stretches[kept[i].0].start;
            let (first, last) = (i.saturating_sub(1), (i + 1).min(kept.len() - 1));
            start(last).seconds_since(start(first)).abs().max(1.0)
        };
        let worth = |i: usize| gap(i) / (kept[i].1 + 0.1);
        (0..kept.len()).min_by(|&a, &b| worth(a).total_cmp(&worth(b))).map(|i| kept[i].0)
    }
}
