//! One buffer: a ring of samples guarded by one mutex.

use crate::faults::Fault;
use crate::overrides::{Active, Due, Override, OverrideChanges, Release};
use crate::sample::{Draft, Header, Sample, WriterId};
use rcs_msg::{Schema, Stamp};
use std::collections::{BTreeMap, VecDeque};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// What a write does if the queue is full, which means that the slowest reader has not read its oldest message.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Overflow {
    /// The oldest message is dropped; readers that had not read it learn how many messages they missed.
    #[default]
    DropOldest,
    /// The write is refused with [`WriteError::Full`].
    Refuse,
    /// The queue grows until its slowest reader has read it, so that no message is lost. For orders, which are small
    /// and few. A queue of [`Mode::MOST_GROWN`] messages drops its oldest.
    Grow,
}

/// How many messages a buffer keeps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Mode {
    /// The newest message only: each write replaces it.
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
    /// Greatest number of messages in a growing queue.
    pub const MOST_GROWN: usize = 65_536;

    /// Greatest number of messages that can wait for a reader.
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

/// Specification of a buffer: name, message type, number of messages kept.
#[derive(Clone, Debug)]
pub struct BufferSpec {
    /// Like `/wm1/map`.
    pub name: String,
    /// Type of its messages.
    pub schema: Arc<Schema>,
    /// Number of messages kept.
    pub mode: Mode,
    /// Channel metadata: `rcs.role`, `rcs.overlay_of`, ….
    pub metadata: BTreeMap<String, String>,
}

/// Why a message was not written.
#[derive(Debug, thiserror::Error)]
pub enum WriteError {
    /// The queue is full, and its rule is to refuse.
    #[error("the queue of {depth} in {buffer} is full: a reader has not kept up")]
    Full {
        /// Name of the buffer.
        buffer: String,
        /// Number of messages in it.
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

/// A function that is called with every message, in order, while the buffer is locked. It must return at once.
pub type Tap = Box<dyn FnMut(&Sample) + Send>;

/// A named mailbox of one message type.
pub struct Buffer {
    spec: BufferSpec,
    inner: Mutex<Inner>,
    /// Whether any buffer of the bus may have overrides; shared by all buffers, so that one check suffices.
    overridden: Arc<AtomicBool>,
}

#[derive(Default)]
struct Inner {
    ring: VecDeque<Sample>,
    /// Sequence of the newest message; 0 before the first.
    newest: u64,
    /// For each reader, the sequence of the last message that it read; `None` if the reader was dropped.
    cursors: Vec<Option<u64>>,
    taps: Vec<Tap>,
    /// Taps of [`Buffer::tap_once`], which are not called again when a run repeats a part of its past.
    once: Vec<Tap>,
    /// Sequence of the newest message that these taps have seen.
    seen: u64,
    overrides: Active,
}

/// State of a buffer without its taps: part of a snapshot.
#[derive(Clone, Debug, Default)]
pub struct BufferState {
    /// Its messages, oldest first: the newest, and those that some reader has not read.
    pub ring: Vec<Sample>,
    /// Sequence of the newest message.
    pub newest: u64,
    /// For each reader, the sequence of the last message that it read.
    pub cursors: Vec<Option<u64>>,
    /// Overrides in force.
    pub overrides: Vec<Override>,
}

impl Buffer {
    /// An empty buffer.
    pub fn new(spec: BufferSpec) -> Arc<Self> {
        Self::on_bus(spec, Arc::default())
    }

    /// An empty buffer that shares the flag of its bus.
    pub(crate) fn on_bus(spec: BufferSpec, overridden: Arc<AtomicBool>) -> Arc<Self> {
        Arc::new(Self { spec, inner: Mutex::default(), overridden })
    }

    /// Its specification.
    pub fn spec(&self) -> &BufferSpec {
        &self.spec
    }

    /// Its name.
    pub fn name(&self) -> &str {
        &self.spec.name
    }

    /// A new reader, which gets the newest message and all later ones.
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

    /// Adds a tap that sees every message from now on, including those of a part of the past that is run again.
    pub fn tap(&self, tap: Tap) {
        self.lock().taps.push(tap);
    }

    /// Adds a tap that sees every message from now on once: for recorders, links and others that follow a run. After
    /// [`Buffer::restore`] it does not see messages up to the newest that was ever written.
    pub fn tap_once(&self, tap: Tap) {
        self.lock().once.push(tap);
    }

    /// Marks all messages from now on as new for the taps of [`Buffer::tap_once`]: another run continues from here.
    pub fn begin_anew(&self) {
        let mut inner = self.lock();
        inner.seen = inner.newest;
    }

    /// The newest message.
    pub fn latest(&self) -> Option<Sample> {
        self.lock().ring.back().cloned()
    }

    /// Sequence of the newest message, which equals the number of messages written.
    pub fn newest(&self) -> u64 {
        self.lock().newest
    }

    /// Sets an override.
    pub fn set_override(&self, new: Override) {
        self.lock().overrides.set(new);
        self.overridden.store(true, Ordering::Relaxed);
    }

    /// Releases overrides and returns their number.
    pub fn release_overrides(&self, which: &Release) -> usize {
        self.lock().overrides.release(which)
    }

    /// The overrides in force, and those that wait for their cycle.
    pub fn overrides(&self) -> Vec<Override> {
        self.lock().overrides.list().to_vec()
    }

    /// The faults in force.
    pub fn faults(&self, now: Stamp) -> Vec<Fault> {
        let inner = self.lock();
        let active = inner.overrides.list().iter().filter(|active| active.applies(now));
        active.filter_map(Override::fault).cloned().collect()
    }

    /// Drops expired overrides, puts those in force whose cycle has come, and reports the changes since the last call.
    /// `is_due` must not access this buffer.
    pub fn update_overrides(&self, now: Stamp, is_due: impl Fn(&Due) -> bool) -> OverrideChanges {
        self.lock().overrides.update(now, is_due)
    }

    /// The state of the buffer.
    pub fn save(&self) -> BufferState {
        let inner = self.lock();
        BufferState {
            ring: inner.ring.iter().cloned().collect(),
            newest: inner.newest,
            cursors: inner.cursors.clone(),
            overrides: inner.overrides.list().to_vec(),
        }
    }

    /// Restores a state; taps are not called. A reader that was created later continues at the newest message of the
    /// state, and a reader that was dropped later stays dropped.
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
        // A panic of a tap leaves no inconsistent state: the message is in the ring, or it is not.
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn publish(&self, inner: &mut Inner, writer: WriterId, draft: Draft) -> u64 {
        let message = if inner.overrides.is_empty() {
            draft.message
        } else {
            let newest = inner.ring.back().map(|sample| &sample.message);
            match inner.overrides.apply(draft.log_time, writer, draft.message, newest) {
                Some(message) => message,
                None => return inner.newest,
            }
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
        // A queue that has grown shrinks by the messages that have been read.
        while inner.ring.len() >= mode.depth() && !inner.is_full(mode.depth()) {
            inner.ring.pop_front();
        }
        inner.ring.push_back(sample);
        inner.drop_consumed();
        inner.newest
    }
}

impl Inner {
    /// Drops the messages that every reader has read, except the newest, which a new reader gets.
    fn drop_consumed(&mut self) {
        if self.ring.len() < 2 {
            return;
        }
        let read = self.cursors.iter().flatten().copied().min().unwrap_or(u64::MAX);
        while self.ring.len() > 1 && self.ring.front().is_some_and(|oldest| oldest.header.sequence <= read) {
            self.ring.pop_front();
        }
    }

    /// Whether the slowest reader has not read the message that the next write would drop.
    fn is_full(&self, depth: usize) -> bool {
        self.ring.len() >= depth
            && self.ring.front().is_some_and(|oldest| {
                self.cursors.iter().flatten().any(|&read| read < oldest.header.sequence)
            })
    }

    /// The next message for the reader in `slot`, its index in the ring, and the number of messages missed before it.
    fn next_unread(&self, slot: usize) -> Option<(&Sample, u64)> {
        let read = self.cursors[slot].unwrap_or(0);
        let oldest = self.ring.front()?.header.sequence;
        let wanted = (read + 1).max(oldest);
        let sample = self.ring.get((wanted - oldest) as usize)?;
        Some((sample, wanted - read - 1))
    }
}

/// Writes to one buffer as one writer.
#[derive(Clone)]
pub struct Writer {
    buffer: Arc<Buffer>,
    id: WriterId,
}

impl Writer {
    /// Writes a message and returns its sequence, or that of the newest one if a fault drops it. It never waits for a
    /// reader.
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

    /// The buffer.
    pub fn buffer(&self) -> &Arc<Buffer> {
        &self.buffer
    }
}

/// Reads one buffer at its own pace; readers do not take messages from each other.
pub struct Reader {
    buffer: Arc<Buffer>,
    slot: usize,
}

impl Reader {
    /// The next unread message; in a latest-only buffer the newest one.
    pub fn read(&mut self) -> Option<Sample> {
        Self::take(&mut self.buffer.lock(), self.slot).map(|(sample, _)| sample)
    }

    /// Moves every unread message into `fresh`, oldest first, and returns how many were missed before them.
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
