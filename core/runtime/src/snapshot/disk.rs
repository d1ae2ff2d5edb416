//! Snapshots as bytes.
//!
//! A table contains every message once, however many buffers and states refer to it; large messages may be stored
//! elsewhere under a number.

use super::Snapshot;
use crate::children::ChildLinksState;
use crate::cycle::{InputView, Staged};
use crate::error::RunError;
use crate::node::{NodeState, Output, SavedBody};
use crate::register::{Register, RegisterOnDisk};
use crate::status::{StatusCell, StatusOnDisk};
use crate::stepped::{Event, EventKind};
use crate::summary::CycleTimes;
use crate::tally::Tally;
use rand_chacha::ChaCha8Rng;
use rcs_bus::{BufferState, Header, Override, Sample};
use rcs_log::Position;
use rcs_msg::{AnyMessage, DeferredSource as _, Stamp};
use serde::{Deserialize, Serialize};
use std::collections::HashMap;
use std::sync::Arc;

/// Version of the format of [`Snapshot::to_bytes`].
const FORMAT: u32 = 7;

/// Bytes that are serialised as a whole instead of one by one.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Block(pub(crate) Vec<u8>);

impl Serialize for Block {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_bytes(&self.0)
    }
}

impl<'de> Deserialize<'de> for Block {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Visitor;
        impl serde::de::Visitor<'_> for Visitor {
            type Value = Block;

            fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str("bytes")
            }

            fn visit_bytes<E>(self, bytes: &[u8]) -> Result<Block, E> {
                Ok(Block(bytes.to_vec()))
            }
        }
        deserializer.deserialize_bytes(Visitor)
    }
}

#[derive(Serialize, Deserialize)]
struct OnDisk {
    format: u32,
    now: Stamp,
    events: u64,
    order: u64,
    timing_due: Stamp,
    messages: Vec<MessageOnDisk>,
    queue: Vec<EventOnDisk>,
    buffers: Vec<BufferOnDisk>,
    nodes: Vec<NodeOnDisk>,
    times: Vec<CycleTimes>,
    position: Option<Position>,
    tallies: Option<Vec<Tally>>,
    stack_hash: String,
}

#[derive(Serialize, Deserialize)]
enum MessageOnDisk {
    Here { schema: String, bytes: Block },
    Elsewhere(u32),
}

/// A message by its index in the table.
#[derive(Serialize, Deserialize)]
struct SampleOnDisk {
    header: Header,
    message: u32,
}

#[derive(Serialize, Deserialize)]
struct StagedOnDisk {
    output: usize,
    acq_time: Stamp,
    message: u32,
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
    kind: EventKindOnDisk,
}

#[derive(Serialize, Deserialize)]
enum EventKindOnDisk {
    Publish {
        started: Stamp,
        staged: Vec<StagedOnDisk>,
        status: Option<Block>,
    },
    Cycle,
    /// The script of the run has the event itself.
    Write,
}

#[derive(Serialize, Deserialize)]
struct NodeOnDisk {
    body: Block,
    views: Vec<ViewOnDisk>,
    status: StatusOnDisk,
    register: RegisterOnDisk,
    child_links: ChildLinksState,
    panicked: bool,
    rng: ChaCha8Rng,
}

#[derive(Serialize, Deserialize)]
struct ViewOnDisk {
    fresh: Vec<SampleOnDisk>,
    latest: Option<SampleOnDisk>,
    missed: u64,
}

/// The table of messages during serialisation.
struct Table<'a> {
    messages: Vec<MessageOnDisk>,
    /// Index in the table, by address.
    known: HashMap<usize, u32>,
    elsewhere: &'a mut dyn FnMut(&AnyMessage) -> Option<u32>,
}

impl Table<'_> {
    fn message(&mut self, message: &AnyMessage) -> u32 {
        if let Some(&place) = self.known.get(&message.address()) {
            return place;
        }
        let entry = match (self.elsewhere)(message) {
            Some(number) => MessageOnDisk::Elsewhere(number),
            None => MessageOnDisk::Here {
                schema: message.schema().name().to_owned(),
                bytes: Block(message.encode().to_vec()),
            },
        };
        self.messages.push(entry);
        let place = self.messages.len() as u32 - 1;
        self.known.insert(message.address(), place);
        place
    }

    fn sample(&mut self, sample: &Sample) -> SampleOnDisk {
        SampleOnDisk { header: sample.header, message: self.message(&sample.message) }
    }

    fn view(&mut self, view: &InputView) -> ViewOnDisk {
        ViewOnDisk {
            fresh: view.fresh.iter().map(|sample| self.sample(sample)).collect(),
            latest: view.latest.as_ref().map(|sample| self.sample(sample)),
            missed: view.missed,
        }
    }

    fn event(&mut self, event: &Event) -> Result<EventOnDisk, RunError> {
        let kind = match &event.kind {
            EventKind::Cycle => EventKindOnDisk::Cycle,
            EventKind::Write => EventKindOnDisk::Write,
            EventKind::Publish { started, output } => {
                let output =
                    output.get().ok_or_else(|| RunError::Snapshot("a cycle is not done".to_owned()))?;
                let staged = output.staged.iter().map(|item| StagedOnDisk {
                    output: item.output,
                    acq_time: item.acq_time,
                    message: self.message(&item.message),
                });
                let staged = staged.collect();
                let status = output.status.as_ref().map(|status| Block(status.encode()));
                EventKindOnDisk::Publish { started: *started, staged, status }
            }
        };
        Ok(EventOnDisk { time: event.time, rank: event.rank, order: event.order, kind })
    }

    fn node(&mut self, node: &NodeState) -> Result<NodeOnDisk, RunError> {
        let body = match &node.body {
            SavedBody::Live(saved) => saved.encode().map_err(codec)?,
            SavedBody::Encoded(bytes) => bytes.clone(),
        };
        Ok(NodeOnDisk {
            body: Block(body),
            views: node.views.iter().map(|view| self.view(view)).collect(),
            status: (&node.status).into(),
            register: (&node.register).into(),
            child_links: node.child_links.clone(),
            panicked: node.panicked,
            rng: node.rng.clone(),
        })
    }
}

/// The messages of a table, after reading.
struct Messages(Vec<AnyMessage>);

impl Messages {
    fn get(&self, place: u32) -> Result<AnyMessage, RunError> {
        let message = self.0.get(place as usize);
        message.cloned().ok_or_else(|| RunError::Snapshot(format!("there is no message {place}")))
    }

    fn sample(&self, sample: &SampleOnDisk) -> Result<Sample, RunError> {
        Ok(Sample { header: sample.header, message: self.get(sample.message)? })
    }

    fn samples<R: FromIterator<Sample>>(&self, list: &[SampleOnDisk]) -> Result<R, RunError> {
        list.iter().map(|sample| self.sample(sample)).collect()
    }

    fn event(&self, event: EventOnDisk) -> Result<Event, RunError> {
        let kind = match event.kind {
            EventKindOnDisk::Cycle => EventKind::Cycle,
            EventKindOnDisk::Write => EventKind::Write,
            EventKindOnDisk::Publish { started, staged, status } => {
                let staged = staged.iter().map(|item| {
                    let message = self.get(item.message)?;
                    Ok(Staged { output: item.output, acq_time: item.acq_time, message })
                });
                let staged = staged.collect::<Result<_, RunError>>()?;
                let status = status.map(|status| prost::Message::decode(status.0.as_slice())).transpose();
                let status = status.map_err(|error| RunError::Snapshot(error.to_string()))?;
                let status = status.as_ref().map(crate::status::StatusRecord::from_status);
                let output = Output { staged, status };
                EventKind::Publish { started, output: Arc::new(output.into()) }
            }
        };
        Ok(Event { time: event.time, rank: event.rank, order: event.order, kind })
    }

    fn node(&self, node: NodeOnDisk) -> Result<NodeState, RunError> {
        let view = |view: &ViewOnDisk| {
            let latest = view.latest.as_ref().map(|sample| self.sample(sample)).transpose()?;
            Ok(InputView { fresh: self.samples(&view.fresh)?, latest, missed: view.missed })
        };
        let bad = |error: prost::DecodeError| RunError::Snapshot(error.to_string());
        Ok(NodeState {
            body: SavedBody::Encoded(node.body.0),
            views: node.views.iter().map(view).collect::<Result<_, RunError>>()?,
            status: StatusCell::try_from(&node.status).map_err(bad)?,
            register: Register::try_from(&node.register).map_err(bad)?,
            child_links: node.child_links,
            panicked: node.panicked,
            rng: node.rng,
        })
    }
}

#[expect(clippy::needless_pass_by_value, reason = "it is given to `map_err`")]
fn codec(error: postcard::Error) -> RunError {
    RunError::Snapshot(error.to_string())
}

/// Decodes a message of a type in the registry.
pub(crate) fn message_of(schema: &str, bytes: Vec<u8>) -> Result<AnyMessage, RunError> {
    let bad = || RunError::Snapshot(format!("a message of type {schema} does not decode"));
    let known = rcs_msg::registry().schema(schema).ok_or_else(bad)?;
    match rcs_msg::canonical(known, &bytes.into()) {
        Some(Ok(message)) => Ok(message),
        _ => Err(bad()),
    }
}

impl Snapshot {
    /// The snapshot as bytes, including all messages.
    ///
    /// An error if a state cannot be serialised.
    pub fn to_bytes(&self) -> Result<Vec<u8>, RunError> {
        self.encode(&mut |_| None)
    }

    /// The snapshot as bytes, without the messages that are stored elsewhere, which have the number that `elsewhere`
    /// returns.
    pub(crate) fn encode(
        &self,
        elsewhere: &mut dyn FnMut(&AnyMessage) -> Option<u32>,
    ) -> Result<Vec<u8>, RunError> {
        let mut table = Table { messages: Vec::new(), known: HashMap::new(), elsewhere };
        let buffers = self.buffers.iter().map(|state| BufferOnDisk {
            ring: state.ring.iter().map(|sample| table.sample(sample)).collect(),
            newest: state.newest,
            cursors: state.cursors.clone(),
            overrides: state.overrides.clone(),
        });
        let buffers = buffers.collect();
        let queue = self.queue.iter().map(|event| table.event(event)).collect::<Result<_, _>>()?;
        let nodes = self.nodes.iter().map(|(_, node)| table.node(node)).collect::<Result<_, _>>()?;
        let disk = OnDisk {
            format: FORMAT,
            now: self.now,
            events: self.events,
            order: self.order,
            timing_due: self.timing_due,
            messages: table.messages,
            queue,
            buffers,
            nodes,
            times: self.times.clone(),
            position: self.position.clone(),
            tallies: self.tallies.clone(),
            stack_hash: self.stack_hash.clone(),
        };
        postcard::to_stdvec(&disk).map_err(codec)
    }

    /// Reads a snapshot from bytes.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, RunError> {
        Self::decode(bytes, &mut |number| {
            Err(RunError::Snapshot(format!("message {number} lies elsewhere, which is not known here")))
        })
    }

    /// Reads a snapshot from bytes and from the messages that are stored elsewhere.
    pub(crate) fn decode(
        bytes: &[u8],
        elsewhere: &mut dyn FnMut(u32) -> Result<AnyMessage, RunError>,
    ) -> Result<Self, RunError> {
        // The version comes first, so that another version is recognised whatever follows it.
        let (format, _): (u32, _) = postcard::take_from_bytes(bytes).map_err(codec)?;
        if format != FORMAT {
            return Err(RunError::Snapshot(format!("format {format} is not known; expected {FORMAT}")));
        }
        let disk: OnDisk = postcard::from_bytes(bytes).map_err(codec)?;
        let messages = disk.messages.into_iter().map(|message| match message {
            MessageOnDisk::Here { schema, bytes } => message_of(&schema, bytes.0),
            MessageOnDisk::Elsewhere(number) => elsewhere(number),
        });
        let messages = Messages(messages.collect::<Result<_, _>>()?);
        let queue = disk.queue.into_iter().map(|event| messages.event(event)).collect::<Result<_, _>>()?;
        let buffers = disk.buffers.into_iter().map(|state| {
            Ok(BufferState {
                ring: messages.samples(&state.ring)?,
                newest: state.newest,
                cursors: state.cursors,
                overrides: state.overrides,
            })
        });
        let buffers = buffers.collect::<Result<_, RunError>>()?;
        let nodes = disk.nodes.into_iter().map(|node| Ok((u64::MAX, Arc::new(messages.node(node)?))));
        Ok(Self {
            now: disk.now,
            events: disk.events,
            order: disk.order,
            timing_due: disk.timing_due,
            queue,
            buffers,
            nodes: nodes.collect::<Result<_, RunError>>()?,
            times: disk.times,
            position: disk.position,
            tallies: disk.tallies,
            stack_hash: disk.stack_hash,
        })
    }
}
