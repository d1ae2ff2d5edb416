//! Everything that a stepped run remembers, at one moment: in memory, or as bytes.
//!
//! In memory a snapshot shares messages and the large parts of states with the run: it costs what changed since the
//! last. As bytes it goes on from disk, or in another program that has the same stack and log.

use crate::cycle::{InputView, Staged};
use crate::error::RunError;
use crate::node::{NodeState, Output, SavedBody};
use crate::status::{StatusCell, StatusOnDisk};
use crate::stepped::{Event, EventKind, Stepped};
use crate::summary::Tally;
use rand_chacha::ChaCha8Rng;
use rcs_bus::{BufferState, Header, Override, Sample};
use rcs_log::Position;
use rcs_msg::{AnyMessage, Stamp};
use serde::{Deserialize, Serialize};
use std::sync::{Arc, PoisonError};

/// Everything that a stepped run remembers, at one moment.
#[derive(Clone)]
pub struct Snapshot {
    pub(crate) now: Stamp,
    pub(crate) events: u64,
    order: u64,
    queue: Vec<Event>,
    buffers: Vec<BufferState>,
    nodes: Vec<NodeState>,
    position: Option<Position>,
    tallies: Option<Vec<Tally>>,
    stack_hash: String,
}

impl Snapshot {
    /// Simulated time of the moment.
    pub fn now(&self) -> Stamp {
        self.now
    }

    /// How many events had been done.
    pub fn events(&self) -> u64 {
        self.events
    }
}

impl Stepped {
    /// The run as it is now.
    pub fn snapshot(&self) -> Snapshot {
        let machine = self.machine();
        let tallies = self.tallies.as_ref();
        Snapshot {
            now: self.now,
            events: self.events,
            order: self.order,
            queue: self.queue.iter().cloned().collect(),
            buffers: machine.buffers.iter().map(|buffer| buffer.save()).collect(),
            nodes: machine.nodes.iter().map(|slot| slot.look(|node, _| node.save())).collect(),
            position: self.feed.as_ref().map(crate::feed::Feed::position),
            tallies: tallies.map(|tallies| tallies.lock().unwrap_or_else(PoisonError::into_inner).clone()),
            stack_hash: machine.plan.hash.clone(),
        }
    }

    /// Makes the run what it was when the snapshot was taken. Taps see nothing of it.
    pub fn restore(&mut self, snapshot: &Snapshot) -> Result<(), RunError> {
        let machine = self.machine_mut();
        let fits = snapshot.stack_hash == machine.plan.hash
            && snapshot.buffers.len() == machine.buffers.len()
            && snapshot.nodes.len() == machine.nodes.len();
        if !fits {
            return Err(RunError::Snapshot(format!(
                "it is of the stack with hash {}; expected {}",
                snapshot.stack_hash, machine.plan.hash
            )));
        }
        for (buffer, state) in machine.buffers.iter().zip(&snapshot.buffers) {
            buffer.restore(state);
        }
        for (slot, state) in machine.nodes.iter_mut().zip(&snapshot.nodes) {
            slot.get().restore(state).map_err(RunError::Snapshot)?;
        }
        self.now = snapshot.now;
        self.events = snapshot.events;
        self.order = snapshot.order;
        self.queue = snapshot.queue.iter().cloned().collect();
        if let (Some(feed), Some(position)) = (&mut self.feed, &snapshot.position) {
            feed.restore(position.clone());
        }
        if let (Some(tallies), Some(saved)) = (&self.tallies, &snapshot.tallies) {
            tallies.lock().unwrap_or_else(PoisonError::into_inner).clone_from(saved);
        }
        Ok(())
    }
}

/// The format of [`Snapshot::to_bytes`].
const FORMAT: u32 = 1;

#[derive(Serialize, Deserialize)]
struct OnDisk {
    format: u32,
    now: Stamp,
    events: u64,
    order: u64,
    queue: Vec<EventOnDisk>,
    buffers: Vec<BufferOnDisk>,
    nodes: Vec<NodeOnDisk>,
    position: Option<Position>,
    tallies: Option<Vec<Tally>>,
    stack_hash: String,
}

#[derive(Serialize, Deserialize)]
struct MessageOnDisk {
    schema: String,
    bytes: Vec<u8>,
}

#[derive(Serialize, Deserialize)]
struct SampleOnDisk {
    header: Header,
    message: MessageOnDisk,
}

#[derive(Serialize, Deserialize)]
struct StagedOnDisk {
    output: usize,
    acq_time: Stamp,
    message: MessageOnDisk,
}

#[derive(Serialize, Deserialize)]
struct BufferOnDisk {
    ring: Vec<SampleOnDisk>,
    newest: u64,
    cursors: Vec<Option<u64>>,
    overrides: Vec<Override>,
}

#[derive(Serialize, Deserialize)]
struct EventOnDisk {
    time: Stamp,
    rank: u32,
    order: u64,
    /// When the cycle started that wrote it, what it wrote, and its status; `None` for a cycle.
    publish: Option<(Stamp, Vec<StagedOnDisk>, MessageOnDisk)>,
}

#[derive(Serialize, Deserialize)]
struct NodeOnDisk {
    body: Vec<u8>,
    views: Vec<ViewOnDisk>,
    status: StatusOnDisk,
    running: Option<bool>,
    panicked: bool,
    rng: ChaCha8Rng,
}

#[derive(Serialize, Deserialize)]
struct ViewOnDisk {
    fresh: Vec<SampleOnDisk>,
    latest: Option<SampleOnDisk>,
    missed: u64,
}

impl From<&AnyMessage> for MessageOnDisk {
    fn from(message: &AnyMessage) -> Self {
        Self { schema: message.schema().name().to_owned(), bytes: message.bytes().to_vec() }
    }
}

impl MessageOnDisk {
    fn message(self) -> Result<AnyMessage, RunError> {
        let bad = || RunError::Snapshot(format!("a message of type {} does not decode", self.schema));
        let schema = rcs_msg::registry().schema(&self.schema).ok_or_else(bad)?;
        match rcs_msg::canonical(schema, &self.bytes.clone().into()) {
            Some(Ok(message)) => Ok(message),
            _ => Err(bad()),
        }
    }
}

impl From<&Sample> for SampleOnDisk {
    fn from(sample: &Sample) -> Self {
        Self { header: sample.header, message: (&sample.message).into() }
    }
}

impl SampleOnDisk {
    fn sample(self) -> Result<Sample, RunError> {
        Ok(Sample { header: self.header, message: self.message.message()? })
    }
}

fn samples(list: Vec<SampleOnDisk>) -> Result<Vec<Sample>, RunError> {
    list.into_iter().map(SampleOnDisk::sample).collect()
}

impl Snapshot {
    /// The snapshot as bytes.
    ///
    /// An error where a state does not serialise, or for a run on a
    /// recorded schedule with writes still to come.
    pub fn to_bytes(&self) -> Result<Vec<u8>, RunError> {
        let codec = |error: postcard::Error| RunError::Snapshot(error.to_string());
        let mut queue = Vec::new();
        for event in &self.queue {
            let publish = match &event.kind {
                EventKind::Cycle => None,
                EventKind::Publish { started, output } => {
                    let output =
                        output.get().ok_or_else(|| RunError::Snapshot("a cycle is not done".to_owned()))?;
                    let staged = output.staged.iter().map(|item| StagedOnDisk {
                        output: item.output,
                        acq_time: item.acq_time,
                        message: (&item.message).into(),
                    });
                    let status = rcs_msg::rcs::Status::from(output.status.clone());
                    Some((*started, staged.collect(), (&AnyMessage::new(status)).into()))
                }
                EventKind::Write => {
                    return Err(RunError::Snapshot("a recorded event is still to come".to_owned()));
                }
            };
            queue.push(EventOnDisk { time: event.time, rank: event.rank, order: event.order, publish });
        }
        let mut nodes = Vec::new();
        for node in &self.nodes {
            let body = match &node.body {
                SavedBody::Live(saved) => saved.encode().map_err(codec)?,
                SavedBody::Encoded(bytes) => bytes.clone(),
            };
            let view = |view: &InputView| ViewOnDisk {
                fresh: view.fresh.iter().map(SampleOnDisk::from).collect(),
                latest: view.latest.as_ref().map(SampleOnDisk::from),
                missed: view.missed,
            };
            nodes.push(NodeOnDisk {
                body,
                views: node.views.iter().map(view).collect(),
                status: (&node.status).into(),
                running: node.running,
                panicked: node.panicked,
                rng: node.rng.clone(),
            });
        }
        let buffer = |state: &BufferState| BufferOnDisk {
            ring: state.ring.iter().map(SampleOnDisk::from).collect(),
            newest: state.newest,
            cursors: state.cursors.clone(),
            overrides: state.overrides.clone(),
        };
        let disk = OnDisk {
            format: FORMAT,
            now: self.now,
            events: self.events,
            order: self.order,
            queue,
            buffers: self.buffers.iter().map(buffer).collect(),
            nodes,
            position: self.position.clone(),
            tallies: self.tallies.clone(),
            stack_hash: self.stack_hash.clone(),
        };
        postcard::to_stdvec(&disk).map_err(codec)
    }

    /// A snapshot from bytes.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, RunError> {
        let disk: OnDisk =
            postcard::from_bytes(bytes).map_err(|error| RunError::Snapshot(error.to_string()))?;
        if disk.format != FORMAT {
            return Err(RunError::Snapshot(format!(
                "format {} is not known; expected {FORMAT}",
                disk.format
            )));
        }
        let mut queue = Vec::new();
        for event in disk.queue {
            let kind = match event.publish {
                None => EventKind::Cycle,
                Some((started, list, status)) => {
                    let mut staged = Vec::new();
                    for item in list {
                        let message = item.message.message()?;
                        staged.push(Staged { output: item.output, acq_time: item.acq_time, message });
                    }
                    let status = prost::Message::decode(status.bytes.as_slice())
                        .map_err(|error| RunError::Snapshot(error.to_string()))?;
                    let output = Output { staged, status: crate::status::StatusRecord::from_status(&status) };
                    EventKind::Publish { started, output: Arc::new(output.into()) }
                }
            };
            queue.push(Event { time: event.time, rank: event.rank, order: event.order, kind });
        }
        let mut buffers = Vec::new();
        for state in disk.buffers {
            let ring = samples(state.ring)?;
            buffers.push(BufferState {
                ring,
                newest: state.newest,
                cursors: state.cursors,
                overrides: state.overrides,
            });
        }
        let mut nodes = Vec::new();
        for node in disk.nodes {
            let mut views = Vec::new();
            for view in node.views {
                let latest = view.latest.map(SampleOnDisk::sample).transpose()?;
                views.push(InputView { fresh: samples(view.fresh)?.into(), latest, missed: view.missed });
            }
            let status =
                StatusCell::try_from(&node.status).map_err(|error| RunError::Snapshot(error.to_string()))?;
            nodes.push(NodeState {
                body: SavedBody::Encoded(node.body),
                views,
                status,
                running: node.running,
                panicked: node.panicked,
                rng: node.rng,
            });
        }
        Ok(Self {
            now: disk.now,
            events: disk.events,
            order: disk.order,
            queue,
            buffers,
            nodes,
            position: disk.position,
            tallies: disk.tallies,
            stack_hash: disk.stack_hash,
        })
    }
}
