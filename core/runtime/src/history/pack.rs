//! Packs stretches of messages and snapshots for the disk, and unpacks them.
//!
//! Small messages of a stretch are packed together. A large message is a piece of its own, which is shared by
//! everything that holds the message: the stretch in which it was written, later stretches that begin with it, and
//! snapshots.

use super::disk::{Disk, Piece};
use super::samples::{Entry, Location, LogRef, Point, Samples, Stored, StoredElsewhere, decoded};
use crate::error::RunError;
use crate::snapshot::Snapshot;
use crate::snapshot::disk::{Block, message_of};
use crate::stack::Plan;
use rcs_bus::Header;
use rcs_msg::AnyMessage;
use serde::{Deserialize, Serialize};
use std::collections::HashMap;
use std::io;
use std::sync::{Arc, Weak};

/// Messages above this size are pieces of their own.
const LARGE: usize = 2048;

/// A stretch on disk.
pub(crate) struct PackedSamples {
    small: Arc<Piece>,
    large: Vec<Arc<Piece>>,
}

/// A snapshot on disk.
pub(crate) struct PackedSnapshot {
    state: Arc<Piece>,
    /// Each with the type of its message.
    large: Vec<(Arc<Piece>, String)>,
    /// Approximate size in memory.
    pub(crate) bytes: usize,
}

#[derive(Serialize, Deserialize)]
enum StoredOnDisk {
    Here(Block),
    Piece(u32),
    Log(LogRef),
}

#[derive(Serialize, Deserialize)]
struct EntryOnDisk {
    point: Point,
    header: Header,
    held: StoredOnDisk,
}

#[derive(Serialize, Deserialize)]
struct SamplesOnDisk {
    opening: Vec<Option<EntryOnDisk>>,
    written: Vec<Vec<EntryOnDisk>>,
}

/// Start of a run, to find out in which run a message was written.
pub(crate) struct Origin {
    pub(crate) parent: usize,
    /// Sequence of the newest message of each buffer at the start of the run.
    pub(crate) newest: Vec<u64>,
}

/// Packs stretches and snapshots.
pub(crate) struct Packer {
    disk: Arc<Disk>,
    plan: Arc<Plan>,
    /// Large messages on disk, by run, buffer and sequence.
    known: HashMap<(usize, usize, u64), Weak<Piece>>,
    /// By run; `None` for the first run.
    pub(crate) origins: HashMap<usize, Origin>,
    packed: u64,
}

impl Packer {
    pub(crate) fn new(disk: Arc<Disk>, plan: Arc<Plan>) -> Self {
        Self { disk, plan, known: HashMap::new(), origins: HashMap::new(), packed: 0 }
    }

    /// The run, among `run` and its ancestors, in which a message was written.
    fn writer_run(&self, mut run: usize, buffer: usize, sequence: u64) -> usize {
        while let Some(origin) = self.origins.get(&run)
            && origin.newest.get(buffer).is_some_and(|&newest| sequence <= newest)
        {
            run = origin.parent;
        }
        run
    }

    /// The piece of a message, written if it is not on disk yet; `None` if the message is small.
    fn large(
        &mut self,
        run: usize,
        (buffer, sequence): (usize, u64),
        message: &AnyMessage,
    ) -> io::Result<Option<Arc<Piece>>> {
        let key = (self.writer_run(run, buffer, sequence), buffer, sequence);
        if let Some(piece) = self.known.get(&key).and_then(Weak::upgrade) {
            return Ok(Some(piece));
        }
        if message.size_hint() <= LARGE && !self.plan.buffers[buffer].spec.schema.name().ends_with("Grid") {
            return Ok(None);
        }
        let bytes = message.encode();
        if bytes.len() <= LARGE {
            return Ok(None);
        }
        let piece = self.disk.write(&bytes)?;
        self.known.insert(key, Arc::downgrade(&piece));
        Ok(Some(piece))
    }

    fn entry(
        &mut self,
        run: usize,
        buffer: usize,
        entry: &Entry,
        large: &mut Vec<Arc<Piece>>,
    ) -> io::Result<EntryOnDisk> {
        let piece = match &entry.held {
            Stored::Elsewhere(there) => match &there.place {
                Location::Disk(piece) => Some(Arc::clone(piece)),
                Location::Log(place) => {
                    let held = StoredOnDisk::Log(*place);
                    return Ok(EntryOnDisk { point: entry.point, header: entry.header, held });
                }
            },
            Stored::InMemory(message) => self.large(run, (buffer, entry.header.sequence), message)?,
        };
        let held = match (piece, &entry.held) {
            (Some(piece), _) => {
                large.push(piece);
                StoredOnDisk::Piece(large.len() as u32 - 1)
            }
            (None, Stored::InMemory(message)) => StoredOnDisk::Here(Block(message.encode().to_vec())),
            (None, Stored::Elsewhere(_)) => return Err(io::ErrorKind::NotFound.into()),
        };
        Ok(EntryOnDisk { point: entry.point, header: entry.header, held })
    }

    /// Writes a stretch of a run.
    pub(crate) fn samples(&mut self, run: usize, samples: &Samples) -> io::Result<PackedSamples> {
        let mut large = Vec::new();
        let mut opening = Vec::new();
        for (buffer, entry) in samples.opening.iter().enumerate() {
            let entry = entry.as_ref().map(|entry| self.entry(run, buffer, entry, &mut large));
            opening.push(entry.transpose()?);
        }
        let mut written = Vec::new();
        for (buffer, list) in samples.written.iter().enumerate() {
            let list = list.iter().map(|entry| self.entry(run, buffer, entry, &mut large));
            written.push(list.collect::<io::Result<Vec<_>>>()?);
        }
        let bytes = postcard::to_stdvec(&SamplesOnDisk { opening, written }).map_err(io::Error::other)?;
        let small = self.disk.write(&bytes)?;
        self.tidy()?;
        Ok(PackedSamples { small, large })
    }

    /// Writes a snapshot of a run.
    pub(crate) fn snapshot(&mut self, run: usize, snapshot: &Snapshot) -> Result<PackedSnapshot, RunError> {
        let places = snapshot.places(&self.plan);
        let mut large = Vec::new();
        let mut failed = None;
        let bytes = snapshot.encode(&mut |message| {
            let place = *places.get(&message.address())?;
            match self.large(run, place, message) {
                Ok(piece) => {
                    large.push((piece?, message.schema().name().to_owned()));
                    Some(large.len() as u32 - 1)
                }
                Err(error) => {
                    failed.get_or_insert(error);
                    None
                }
            }
        })?;
        let said = |error: io::Error| RunError::Snapshot(error.to_string());
        if let Some(error) = failed {
            return Err(said(error));
        }
        let state = self.disk.write(&bytes).map_err(said)?;
        Ok(PackedSnapshot { state, large, bytes: bytes.len() })
    }

    /// From time to time removes entries that are no longer on disk, and rewrites files that are mostly dead.
    fn tidy(&mut self) -> io::Result<()> {
        self.packed += 1;
        if self.packed.is_multiple_of(64) {
            self.known.retain(|_, piece| piece.strong_count() > 0);
        }
        self.disk.compact().map(|_| ())
    }
}

impl PackedSamples {
    /// Unpacks a stretch; its large messages are read at the first access.
    pub(crate) fn load(&self, plan: &Plan) -> io::Result<Samples> {
        let bytes = self.small.read()?;
        let bad = |text: String| io::Error::new(io::ErrorKind::InvalidData, text);
        let disk: SamplesOnDisk = postcard::from_bytes(&bytes).map_err(|error| bad(error.to_string()))?;
        if disk.opening.len() != plan.buffers.len() || disk.written.len() != plan.buffers.len() {
            return Err(bad("it is of another stack".to_owned()));
        }
        let entry = |buffer: usize, entry: EntryOnDisk| {
            let schema = &plan.buffers[buffer].spec.schema;
            let there = |place| Stored::Elsewhere(Arc::new(StoredElsewhere::new(place, Arc::clone(schema))));
            let held = match entry.held {
                StoredOnDisk::Here(bytes) => Stored::InMemory(decoded(schema, bytes.0)?),
                StoredOnDisk::Piece(number) => {
                    let piece = self.large.get(number as usize);
                    let piece = piece.ok_or_else(|| bad(format!("it has no message {number}")))?;
                    there(Location::Disk(Arc::clone(piece)))
                }
                StoredOnDisk::Log(place) => there(Location::Log(place)),
            };
            Ok::<_, io::Error>(Entry { point: entry.point, header: entry.header, held })
        };
        let mut samples = Samples::default();
        for (buffer, opening) in disk.opening.into_iter().enumerate() {
            samples.opening.push(opening.map(|opening| entry(buffer, opening)).transpose()?);
        }
        for (buffer, list) in disk.written.into_iter().enumerate() {
            let list = list.into_iter().map(|written| entry(buffer, written));
            samples.written.push(list.collect::<io::Result<_>>()?);
        }
        Ok(samples)
    }
}

impl PackedSnapshot {
    /// Unpacks a snapshot.
    pub(crate) fn load(&self) -> Result<Snapshot, RunError> {
        let said = |error: io::Error| RunError::Snapshot(error.to_string());
        let bytes = self.state.read().map_err(said)?;
        Snapshot::decode(&bytes, &mut |number| {
            let large = self.large.get(number as usize);
            let (piece, schema) =
                large.ok_or_else(|| RunError::Snapshot(format!("it has no message {number}")))?;
            message_of(schema, piece.read().map_err(said)?)
        })
    }
}
