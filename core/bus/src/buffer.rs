//! One buffer: a ring of samples behind one lock.

use crate::overrides::{Active, Due, Override, OverrideChanges, Release};
use crate::sample::{Draft, Header, Sample, WriterId};
use rcs_msg::{Schema, Stamp};
use std::collections::{BTreeMap, VecDeque};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// What happens to a write where a queue is full: where the slowest reader has not read its oldest message.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Overflow {
    /// The oldest message goes; readers that had not read it are told how many they missed.
    #[default]
    DropOldest,
    /// The write is refused with [`WriteError::Full`].
    Refuse,
    /// The queue grows until its slowest reader has read: nothing is lost that anyone waits for. For orders, which are
    /// small and few; a queue of [`Mode::MOST_GROWN`] drops its oldest after all.
    Grow,
}

/// How many messages a buffer keeps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Mode {
    /// The newest message only: a write replaces it.
    #[default]
    Latest,
    /// The newest `depth` messages.
    Queue {
        /// At least 1.
        depth: usize,
        /// What happens when a reader falls behind by more than that.
        overflow: Overflow,
    },
}

impl Mode {
    /// The most messages that a queue grows to.
    pub const MOST_GROWN: usize = 65_536;

    /// How many messages may wait for a reader.
    pub fn most_unread(self) -> usize {
        match self {
            Mode::Queue { overflow: Overflow::Grow, .. } => Self::MOST_GROWN,
            mode => mode.depth(),
        }
    }

    fn depth(self) -> usize {
        match self {
            Mode::Latest => 1,
            Mode::Queue { depth, .. } => depth.max(1),
        }
    }

    fn refuses(self) -> bool {
        matches!(self, Mode::Queue { overflow: Overflow::Refuse, .. })
    }
}

/// What a buffer is: its name, its one message type, how much it keeps.
#[derive(Clone, Debug)]
pub struct BufferSpec {
    /// Like `/wm1/map`.
    pub name: String,
    /// Type of every message in it.
    pub schema: Arc<Schema>,
    /// How much it keeps.
    pub mode: Mode,
    /// Channel metadata: `rcs.role`, `rcs.overlay_of`, ….
    pub metadata: BTreeMap<String, String>,
}

/// Why a message was not written.
#[derive(Debug, thiserror::Error)]
pub enum WriteError {
    /// A queue that refuses is full.
    #[error("the queue of {depth} in {buffer} is full: a reader has not kept up")]
    Full {
        /// Name of the buffer.
        buffer: String,
        /// How many messages it holds.
        depth: usize,
    },
    /// The message is of another type than the buffer.
    #[error("a {got} was written to {buffer}, which holds {expected}")]
    WrongType {
        /// Name of the buffer.
        buffer: String,
        /// Type of the message.
        got: String,
        /// Type of the buffer.
        expected: String,
    },
}

/// Called with every message, in order, while the buffer is locked: it must return at once.
pub type Tap = Box<dyn FnMut(&Sample) + Send>;

/// A named mailbox of one message type.
pub struct Buffer {
    spec: BufferSpec,
    inner: Mutex<Inner>,
    /// Whether any buffer of the bus may have overrides: shared by all of them, so that one look tells.
    overridden: Arc<AtomicBool>,
}

#[derive(Default)]
struct Inner {
    ring: VecDeque<Sample>,
    /// Sequence of the newest message; 0 before the first.
    newest: u64,
    /// Per reader, the sequence that it read last; `None` where the reader has gone.
    cursors: Vec<Option<u64>>,
    taps: Vec<Tap>,
    /// Taps of those outside, which a run that is done again tells nothing.
    once: Vec<Tap>,
    /// Sequence of the newest message that those have seen.
    seen: u64,
    overrides: Active,
}

/// All that a buffer remembers, apart from its taps: part of a snapshot.
#[derive(Clone, Debug, Default)]
pub struct BufferState {
    /// Messages that it holds, oldest first: the newest, and what some reader has not read.
    pub ring: Vec<Sample>,
    /// Sequence of the newest message ever written.
    pub newest: u64,
    /// Per reader, the sequence that it read last.
    pub cursors: Vec<Option<u64>>,
    /// Overrides in force.
    pub overrides: Vec<Override>,
}

impl Buffer {
    /// An empty buffer.
    pub fn new(spec: BufferSpec) -> Arc<Self> {
        Self::on_bus(spec, Arc::default())
    }

    /// An empty buffer that shares a bus's flag.
    pub(crate) fn on_bus(spec: BufferSpec, overridden: Arc<AtomicBool>) -> Arc<Self> {
        Arc::new(Self { spec, inner: Mutex::default(), overridden })
    }

    /// What the buffer is.
    pub fn spec(&self) -> &BufferSpec {
        &self.spec
    }

    /// Its name.
    pub fn name(&self) -> &str {
        &self.spec.name
    }

    /// A new reader, which sees what is written from now on and the newest message that is there already.
    pub fn reader(self: &Arc<Self>) -> Reader {
        let mut inner = self.lock();
        let cursor = Some(inner.newest.saturating_sub(1));
        let slot = inner.cursors.iter().position(Option::is_none).unwrap_or(inner.cursors.len());
        if slot == inner.cursors.len() {
            inner.cursors.push(cursor);
        } else {
            inner.cursors[slot] = cursor;
        }
        drop(inner);
        Reader { buffer: Arc::clone(self), slot }
    }

    /// A new writer.
    pub fn writer(self: &Arc<Self>, id: WriterId) -> Writer {
        Writer { buffer: Arc::clone(self), id }
    }

    /// Adds a tap, which sees every message from now on, those of a past that is run again among them.
    pub fn tap(&self, tap: Tap) {
        self.lock().taps.push(tap);
    }

    /// Adds a tap that sees every message from now on once: for recorders, links and whoever else is told of a run as it
    /// goes on. What is written again after [`Buffer::restore`], up to the newest message that was ever written, it does
    /// not see.
    pub fn tap_once(&self, tap: Tap) {
        self.lock().once.push(tap);
    }

    /// From now on what is written is new: another run goes on from here.
    pub fn begin_anew(&self) {
        let mut inner = self.lock();
        inner.seen = inner.newest;
    }

    /// The newest message.
    pub fn latest(&self) -> Option<Sample> {
        self.lock().ring.back().cloned()
    }

    /// Sequence of the newest message: how many were written.
    pub fn newest(&self) -> u64 {
        self.lock().newest
    }

    /// Lays an operator's hand on the buffer.
    pub fn set_override(&self, new: Override) {
        self.lock().overrides.set(new);
        self.overridden.store(true, Ordering::Relaxed);
    }

    /// Takes overrides away, and says how many.
    pub fn release_overrides(&self, which: &Release) -> usize {
        self.lock().overrides.release(which)
    }

    /// The overrides in force, and those that wait for their cycle.
    pub fn overrides(&self) -> Vec<Override> {
        self.lock().overrides.list().to_vec()
    }

    /// Drops overrides that have expired, puts in force those whose cycle has come, and says what became of all since
    /// the last call. `is_due` must not look at this buffer.
    pub fn update_overrides(&self, now: Stamp, is_due: impl Fn(&Due) -> bool) -> OverrideChanges {
        self.lock().overrides.update(now, is_due)
    }

    /// All that the buffer remembers.
    pub fn save(&self) -> BufferState {
        let inner = self.lock();
        BufferState {
            ring: inner.ring.iter().cloned().collect(),
            newest: inner.newest,
            cursors: inner.cursors.clone(),
            overrides: inner.overrides.list().to_vec(),
        }
    }

    /// Makes the buffer what it was; taps see nothing. A reader that has joined since then stands at the newest message
    /// of then, and one that has gone since then stays gone.
    pub fn restore(&self, state: &BufferState) {
        let mut inner = self.lock();
        inner.ring = state.ring.iter().cloned().collect();
        inner.newest = state.newest;
        let joined = Some(state.newest.saturating_sub(1));
        for (slot, cursor) in inner.cursors.iter_mut().enumerate() {
            if cursor.is_some() {
                *cursor = state.cursors.get(slot).copied().flatten().or(joined);
            }
        }
        inner.overrides = Active::from_list(state.overrides.clone());
        if !state.overrides.is_empty() {
            self.overridden.store(true, Ordering::Relaxed);
        }
    }

    fn lock(&self) -> MutexGuard<'_, Inner> {
        // Nothing is left half done where a tap panics: the message is in the ring, or it is not.
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn publish(&self, inner: &mut Inner, writer: WriterId, draft: Draft) -> u64 {
        let message = if inner.overrides.is_empty() {
            draft.message
        } else {
            inner.overrides.apply(draft.log_time, draft.message)
        };
        inner.newest += 1;
        let header =
            Header { sequence: inner.newest, log_time: draft.log_time, acq_time: draft.acq_time, writer };
        let sample = Sample { header, message };
        for tap in &mut inner.taps {
            tap(&sample);
        }
        if inner.newest > inner.seen {
            inner.seen = inner.newest;
            for tap in &mut inner.once {
                tap(&sample);
            }
        }
        let mode = self.spec.mode;
        if inner.ring.len() >= mode.most_unread() {
            inner.ring.pop_front();
        }
        // A queue that has grown shrinks again by what has been read.
        while inner.ring.len() >= mode.depth() && !inner.is_full(mode.depth()) {
            inner.ring.pop_front();
        }
        inner.ring.push_back(sample);
        inner.drop_consumed();
        inner.newest
    }
}

impl Inner {
    /// Forgets what every reader has read, but for the newest message, which a reader that joins may still see.
    fn drop_consumed(&mut self) {
        if self.ring.len() < 2 {
            return;
        }
        let read = self.cursors.iter().flatten().copied().min().unwrap_or(u64::MAX);
        while self.ring.len() > 1 && self.ring.front().is_some_and(|oldest| oldest.header.sequence <= read) {
            self.ring.pop_front();
        }
    }

    /// Whether the slowest reader has yet to read the message that the next write would drop.
    fn is_full(&self, depth: usize) -> bool {
        self.ring.len() >= depth
            && self.ring.front().is_some_and(|oldest| {
                self.cursors.iter().flatten().any(|&read| read < oldest.header.sequence)
            })
    }

    /// The next message for the reader in `slot`, its place in the ring, and how many it missed before that.
    fn next_unread(&self, slot: usize) -> Option<(&Sample, u64)> {
        let read = self.cursors[slot].unwrap_or(0);
        let oldest = self.ring.front()?.header.sequence;
        let wanted = (read + 1).max(oldest);
        let sample = self.ring.get((wanted - oldest) as usize)?;
        Some((sample, wanted - read - 1))
    }
}

/// Writes to one buffer under one name.
#[derive(Clone)]
pub struct Writer {
    buffer: Arc<Buffer>,
    id: WriterId,
}

impl Writer {
    /// Writes a message and returns its sequence. Never waits for a reader.
    pub fn write(&self, draft: Draft) -> Result<u64, WriteError> {
        let buffer = &*self.buffer;
        if !draft.message.is_a(&buffer.spec.schema) {
            return Err(WriteError::WrongType {
                buffer: buffer.spec.name.clone(),
                got: draft.message.schema().name().to_owned(),
                expected: buffer.spec.schema.name().to_owned(),
            });
        }
        let depth = buffer.spec.mode.depth();
        let mut inner = buffer.lock();
        if buffer.spec.mode.refuses() && inner.is_full(depth) {
            return Err(WriteError::Full { buffer: buffer.spec.name.clone(), depth });
        }
        Ok(buffer.publish(&mut inner, self.id, draft))
    }

    /// The buffer that it writes to.
    pub fn buffer(&self) -> &Arc<Buffer> {
        &self.buffer
    }
}

/// Reads one buffer at its own pace; no reader takes a message from another.
pub struct Reader {
    buffer: Arc<Buffer>,
    slot: usize,
}

impl Reader {
    /// The next message that this reader has not read; in a latest-only buffer, the newest.
    pub fn read(&mut self) -> Option<Sample> {
        Self::take(&mut self.buffer.lock(), self.slot).map(|(sample, _)| sample)
    }

    /// Takes every unread message, oldest first, into `fresh`, and returns how many were missed before them.
    pub fn drain_into(&mut self, fresh: &mut Vec<Sample>) -> u64 {
        let mut inner = self.buffer.lock();
        let read = inner.cursors[self.slot].unwrap_or(0);
        let newest = inner.newest;
        let Some(oldest) = inner.ring.front().map(|sample| sample.header.sequence) else { return 0 };
        if newest <= read {
            return 0;
        }
        let wanted = (read + 1).max(oldest);
        fresh.extend(inner.ring.iter().skip((wanted - oldest) as usize).cloned());
        inner.cursors[self.slot] = Some(newest);
        inner.drop_consumed();
        wanted - read - 1
    }

    fn take(inner: &mut Inner, slot: usize) -> Option<(Sample, u64)> {
        let (sample, missed) = inner.next_unread(slot).map(|(sample, missed)| (sample.clone(), missed))?;
        inner.cursors[slot] = Some(sample.header.sequence);
        inner.drop_consumed();
        Some((sample, missed))
    }
}

impl Drop for Reader {
    fn drop(&mut self) {
        let mut inner = self.buffer.lock();
        if let Some(cursor) = inner.cursors.get_mut(self.slot) {
            *cursor = None;
        }
        inner.drop_consumed();
    }
}
