//! The messages of one stretch of a run: every message of every buffer, with its position in the order.

use super::disk::Piece;
use rcs_bus::{Buffer, Header, Sample};
use rcs_log::{CursorOptions, Log, MessagePosition, TopicId};
use rcs_msg::{AnyMessage, Schema};
use serde::{Deserialize, Serialize};
use std::io;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};

/// A point in a run: the number of events executed, and the number of external writes after the last of them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub(crate) struct Point {
    pub(crate) event: u64,
    pub(crate) write: u32,
}

impl Point {
    /// After that many events, before any write that follows them.
    pub(crate) fn after(event: u64) -> Self {
        Self { event, write: 0 }
    }

    /// After that many events and all writes that follow them.
    pub(crate) fn end_of(event: u64) -> Self {
        Self { event, write: u32::MAX }
    }
}

/// A reference to a message of a log.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct LogRef {
    pub(crate) topic: TopicId,
    pub(crate) place: MessagePosition,
}

/// A message, or its location.
#[derive(Clone)]
pub(crate) enum Stored {
    InMemory(AnyMessage),
    Elsewhere(Arc<StoredElsewhere>),
}

/// A message that is read into memory at the first access.
pub(crate) struct StoredElsewhere {
    pub(crate) place: Location,
    schema: Arc<Schema>,
    message: OnceLock<AnyMessage>,
}

/// Location of a message that is not in memory.
pub(crate) enum Location {
    Disk(Arc<Piece>),
    Log(LogRef),
}

impl StoredElsewhere {
    pub(crate) fn new(place: Location, schema: Arc<Schema>) -> Self {
        Self { place, schema, message: OnceLock::new() }
    }

    /// A message that is in memory now and can be read again after it has been dropped.
    pub(crate) fn with(place: Location, schema: Arc<Schema>, message: AnyMessage) -> Self {
        Self { place, schema, message: OnceLock::from(message) }
    }

    fn get(&self, log: Option<&Log>) -> io::Result<AnyMessage> {
        if let Some(message) = self.message.get() {
            return Ok(message.clone());
        }
        let message = match &self.place {
            Location::Disk(piece) => decoded(&self.schema, piece.read()?)?,
            Location::Log(place) => from_log(log, *place, &self.schema)?,
        };
        Ok(self.message.get_or_init(|| message).clone())
    }
}

/// Decodes a message of a schema; it stays encoded if the schema has no Rust type.
pub(crate) fn decoded(schema: &Arc<Schema>, bytes: Vec<u8>) -> io::Result<AnyMessage> {
    let bytes = bytes.into();
    match rcs_msg::canonical(schema, &bytes) {
        Some(Ok(message)) => Ok(message),
        Some(Err(error)) => Err(io::Error::new(io::ErrorKind::InvalidData, error.to_string())),
        None => Ok(AnyMessage::encoded(Arc::clone(schema), bytes)),
    }
}

/// The message of a log, converted to the type of its buffer.
fn from_log(log: Option<&Log>, wanted: LogRef, schema: &Schema) -> io::Result<AnyMessage> {
    let lost = || io::Error::new(io::ErrorKind::NotFound, "the log no longer gives a message that it gave");
    let log = log.ok_or_else(lost)?;
    let time = wanted.place.time;
    let options = CursorOptions { topics: Some(vec![wanted.topic]), start: time, end: time };
    let found = log.cursor(options).flatten().find(|message| message.place == wanted.place);
    let found = found.ok_or_else(lost)?;
    let topic = log.info().topic(found.topic).ok_or_else(lost)?;
    let raw = AnyMessage::encoded(Arc::clone(&topic.schema), found.data);
    crate::conversion::for_buffer(&raw, schema).ok_or_else(lost)
}

/// One message of a buffer, and when it was written.
#[derive(Clone)]
pub(crate) struct Entry {
    pub(crate) point: Point,
    pub(crate) header: Header,
    pub(crate) held: Stored,
}

impl Entry {
    /// The message, read if it is not in memory.
    pub(crate) fn sample(&self, log: Option<&Log>) -> io::Result<Sample> {
        let message = match &self.held {
            Stored::InMemory(message) => message.clone(),
            Stored::Elsewhere(there) => there.get(log)?,
        };
        Ok(Sample { header: self.header, message })
    }

    fn bytes(&self) -> usize {
        let message = match &self.held {
            Stored::InMemory(message) => message.size_hint(),
            Stored::Elsewhere(there) => 64 + there.message.get().map_or(0, AnyMessage::size_hint),
        };
        size_of::<Self>() + message
    }
}

/// Everything that was written during a stretch of a run, and the content of the buffers before it.
#[derive(Clone, Default)]
pub(crate) struct Samples {
    /// The newest message of each buffer at the start.
    pub(crate) opening: Vec<Option<Entry>>,
    /// The messages written to each buffer, in order.
    pub(crate) written: Vec<Vec<Entry>>,
}

impl Samples {
    /// A stretch that begins with these messages in the buffers.
    pub(crate) fn begin(opening: Vec<Option<Entry>>) -> Self {
        Self { written: vec![Vec::new(); opening.len()], opening }
    }

    /// The newest message of a buffer at a point.
    pub(crate) fn latest(&self, buffer: usize, at: Point) -> Option<&Entry> {
        let written = &self.written[buffer];
        let index = written.partition_point(|entry| entry.point <= at);
        index.checked_sub(1).map(|index| &written[index]).or(self.opening[buffer].as_ref())
    }

    /// The newest message of each buffer at the end.
    pub(crate) fn closing(&self) -> Vec<Option<Entry>> {
        let both = self.written.iter().zip(&self.opening);
        both.map(|(written, opening)| written.last().or(opening.as_ref()).cloned()).collect()
    }

    /// Approximate size in memory, assuming that all messages of a buffer are as large as the newest one; messages from
    /// before the stretch are counted where they were written.
    pub(crate) fn bytes(&self) -> usize {
        let written = self.written.iter();
        let messages: usize =
            written.map(|list| list.last().map_or(0, |entry| entry.bytes() * list.len())).sum();
        messages + self.opening.len() * (size_of::<Option<Entry>>() + size_of::<Vec<Entry>>())
    }
}

/// Records what is written to the buffers of a run, by taps.
pub(crate) struct Tape {
    /// Position of what is written now: the event in the upper 40 bits, the write in the lower 24.
    point: AtomicU64,
    samples: Mutex<Samples>,
}

const WRITE_BITS: u32 = 24;

impl Tape {
    /// A tape on these buffers.
    pub(crate) fn on(buffers: &[Arc<Buffer>]) -> Arc<Self> {
        let samples = Samples::begin(vec![None; buffers.len()]);
        let tape = Arc::new(Self { point: AtomicU64::new(0), samples: Mutex::new(samples) });
        for (index, buffer) in buffers.iter().enumerate() {
            let tape = Arc::clone(&tape);
            buffer.tap(Box::new(move |sample: &Sample| {
                let point = tape.point.load(Ordering::Relaxed);
                let point =
                    Point { event: point >> WRITE_BITS, write: (point & ((1 << WRITE_BITS) - 1)) as u32 };
                let held = Stored::InMemory(sample.message.clone());
                let entry = Entry { point, header: sample.header, held };
                tape.samples().written[index].push(entry);
            }));
        }
        tape
    }

    /// Sets the position of what is written from now on.
    pub(crate) fn at(&self, point: Point) {
        self.point.store((point.event << WRITE_BITS) | u64::from(point.write), Ordering::Relaxed);
    }

    /// Everything recorded since the last [`Tape::replace`].
    pub(crate) fn samples(&self) -> MutexGuard<'_, Samples> {
        self.samples.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Begins another stretch, and returns the previous one.
    pub(crate) fn replace(&self, samples: Samples) -> Samples {
        std::mem::replace(&mut self.samples(), samples)
    }
}
