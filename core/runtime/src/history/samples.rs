//! What was written during one stretch of a run: every message of every buffer, with its place in the order.

use super::disk::Piece;
use rcs_bus::{Buffer, Header, Sample};
use rcs_log::{CursorOptions, Log, MessagePosition, TopicId};
use rcs_msg::{AnyMessage, Schema};
use serde::{Deserialize, Serialize};
use std::io;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};

/// A point in a run: so many events done, and so many writes from outside behind the last of them.
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

/// A message of a log, to be read again.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct LogRef {
    pub(crate) topic: TopicId,
    pub(crate) place: MessagePosition,
}

/// A message, or where it is.
#[derive(Clone)]
pub(crate) enum Stored {
    InMemory(AnyMessage),
    Elsewhere(Arc<StoredElsewhere>),
}

/// A message that is not in memory until someone looks at it.
pub(crate) struct StoredElsewhere {
    pub(crate) place: Location,
    schema: Arc<Schema>,
    message: OnceLock<AnyMessage>,
}

/// Where a message is that is not in memory.
pub(crate) enum Location {
    Disk(Arc<Piece>),
    Log(LogRef),
}

impl StoredElsewhere {
    pub(crate) fn new(place: Location, schema: Arc<Schema>) -> Self {
        Self { place, schema, message: OnceLock::new() }
    }

    /// A message that is in memory now, and can be had from there when it is not.
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

/// The typed message of a schema from its bytes; encoded where the schema is no type of ours.
pub(crate) fn decoded(schema: &Arc<Schema>, bytes: Vec<u8>) -> io::Result<AnyMessage> {
    let bytes = bytes.into();
    match rcs_msg::canonical(schema, &bytes) {
        Some(Ok(message)) => Ok(message),
        Some(Err(error)) => Err(io::Error::new(io::ErrorKind::InvalidData, error.to_string())),
        None => Ok(AnyMessage::encoded(Arc::clone(schema), bytes)),
    }
}

/// The message of a log in the form in which its buffer holds it.
fn from_log(log: Option<&Log>, wanted: LogRef, schema: &Schema) -> io::Result<AnyMessage> {
    let lost = || io::Error::new(io::ErrorKind::NotFound, "the log no longer gives a message that it gave");
    let log = log.ok_or_else(lost)?;
    let time = wanted.place.time;
    let options = CursorOptions { topics: Some(vec![wanted.topic]), start: time, end: time };
    let found = log.cursor(options).flatten().find(|message| message.place == wanted.place);
    let found = found.ok_or_else(lost)?;
    let topic = log.info().topic(found.topic).ok_or_else(lost)?;
    let raw = AnyMessage::encoded(Arc::clone(&topic.schema), found.data);
    crate::feed::for_buffer(&raw, schema).ok_or_else(lost)
}

/// One message of a buffer and when it came into it.
#[derive(Clone)]
pub(crate) struct Entry {
    pub(crate) point: Point,
    pub(crate) header: Header,
    pub(crate) held: Stored,
}

impl Entry {
    /// The message, read where it is not in memory.
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

/// Everything that was written during a stretch of a run, and what lay in the buffers before it.
#[derive(Clone, Default)]
pub(crate) struct Samples {
    /// The newest message of each buffer at the start.
    pub(crate) opening: Vec<Option<Entry>>,
    /// What was written to each buffer, in order.
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

    /// About how much memory it takes. Messages of a buffer are taken to be as large as the newest one; what lay in the
    /// buffers before is counted where it was written.
    pub(crate) fn bytes(&self) -> usize {
        let written = self.written.iter();
        let messages: usize =
            written.map(|list| list.last().map_or(0, |entry| entry.bytes() * list.len())).sum();
        messages + self.opening.len() * (size_of::<Option<Entry>>() + size_of::<Vec<Entry>>())
    }
}

/// Takes down what the buffers of a run tell, by taps.
pub(crate) struct Tape {
    /// Where in the order what is written now stands: the event in the upper 40 bits, the write in the lower 24.
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

    /// What is written from now on stands there.
    pub(crate) fn at(&self, point: Point) {
        self.point.store((point.event << WRITE_BITS) | u64::from(point.write), Ordering::Relaxed);
    }

    /// What has been taken down since the last [`Tape::replace`].
    pub(crate) fn samples(&self) -> MutexGuard<'_, Samples> {
        self.samples.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Begins another stretch, and gives the last one.
    pub(crate) fn replace(&self, samples: Samples) -> Samples {
        std::mem::replace(&mut self.samples(), samples)
    }
}
