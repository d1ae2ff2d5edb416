//! Reassembles messages that were stored as key frames and deltas.
//!
//! - Our own recordings: channel metadata ([`DELTA_OF`]) says which channel holds the deltas of which topic. The codec is
//!   the one for that delta type among those of the log ([`Log::with_codecs`]).
//! - Grids of ROS, whose updates are on a second topic: see [`grid_decoder`]. A recording may hold a single whole grid, at
//!   its start. So the way from it is bounded (`REACH_BYTES`), for reading on as for seeking, so that what is shown does
//!   not depend on the way there; and a seek keeps some of the grids on its way, from which the next seek begins.
//!
//! A channel of deltas that belongs to none of these remains a separate topic.

use crate::cursor::CursorOptions;
use crate::error::LogError;
use crate::find::Contents;
use crate::info::{LogMessage, LogTopic, MessagePosition, TopicId};
use crate::log::Log;
use rcs_msg::{AnyMessage, DELTA_OF, DeltaCodec, DeltaDecoder, GRID_UPDATES, grid_decoder};
use std::collections::{BTreeMap, VecDeque};

/// Greatest size of the segments with updates, uncompressed, from a whole grid of ROS to the last update that is applied
/// to it.
const REACH_BYTES: u64 = 1 << 30;
/// A seek keeps a grid after each such part of the greatest size.
const KEPT_PARTS: u64 = 32;
/// Greatest size of all grids that are kept.
const KEPT_BYTES: usize = 64 << 20;

/// Reassembles the messages of a log's channels with deltas, read in order from the position of [`Reassembly::seek`].
pub struct Reassembly {
    log: Log,
    streams: Vec<Stream>,
    /// All topics of each stream.
    by_topic: BTreeMap<TopicId, usize>,
}

/// Key frames and their deltas.
struct Stream {
    /// Channels of the key frames and of the deltas, at least one of each. Only grids of ROS have several, as after the
    /// restart of a node.
    keys: Vec<TopicId>,
    deltas: Vec<TopicId>,
    decoder: Box<dyn DeltaDecoder>,
    /// How far behind its key frame a delta may lie; `None` for our own recordings, which have a key frame every few
    /// seconds.
    reach: Option<Reach>,
    /// Topic and position of the last key frame.
    key: Option<(TopicId, MessagePosition)>,
    /// Complete messages of earlier seeks, in no order; only where there is a reach.
    kept: VecDeque<Reassembled>,
    /// A delta was refused and has been reported: those that follow are skipped without another report.
    broken: bool,
}

/// Bound of the way from a key frame to its deltas.
struct Reach {
    /// Contents of the segments with deltas.
    contents: Contents,
    /// Greatest size of these from a key frame to a delta.
    most_bytes: u64,
}

/// A complete message, with the header of its key frame or delta.
#[derive(Clone, Debug)]
pub struct Reassembled {
    /// Its header and position in the log; its `data` are the stored bytes.
    pub stored: LogMessage,
    /// Topic of the key frames.
    pub topic: TopicId,
    /// The message.
    pub message: AnyMessage,
}

impl Reassembly {
    /// Positioned before the first message of a log.
    pub fn new(log: &Log) -> Self {
        let (mut streams, mut by_topic) = (Vec::<Stream>::new(), BTreeMap::<TopicId, usize>::new());
        for topic in &log.info().topics {
            let found = own_stream(log, topic).or_else(|| grid_stream(log, topic));
            let is_free = |found: &Stream| found.topics().all(|id| !by_topic.contains_key(&id));
            let Some(stream) = found.filter(is_free) else { continue };
            by_topic.extend(stream.topics().map(|id| (id, streams.len())));
            streams.push(stream);
        }
        Self { log: log.clone(), streams, by_topic }
    }

    /// Whether the topic has key frames or deltas.
    pub fn takes(&self, topic: TopicId) -> bool {
        self.by_topic.contains_key(&topic)
    }

    /// Topic of the key frames for the deltas of this topic; the first one where several channels with one name have key
    /// frames.
    pub fn keys_of(&self, deltas: TopicId) -> Option<TopicId> {
        self.streams.iter().find(|stream| stream.deltas.contains(&deltas))?.keys.first().copied()
    }

    /// Topics of the deltas for the key frames of this topic. Where several channels with one name have key frames, the
    /// first one has all deltas.
    pub fn deltas_of(&self, keys: TopicId) -> &[TopicId] {
        let stream = self.streams.iter().find(|stream| stream.keys.first() == Some(&keys));
        stream.map(|stream| stream.deltas.as_slice()).unwrap_or_default()
    }

    /// Accepts the next message of one of these topics. `None` if it gives no complete message: the topic is another,
    /// or the delta does not fit what was accepted before, which is reported as a problem of the log.
    pub fn take(&mut self, stored: &LogMessage) -> Option<Reassembled> {
        let index = *self.by_topic.get(&stored.topic)?;
        if self.streams[index].keys.contains(&stored.topic) {
            return self.take_key(index, stored);
        }
        if self.take_delta(index, stored) { self.complete(index, stored.clone()) } else { None }
    }

    /// Moves to `place`, as if every message up to and including it had been accepted. Returns the newest complete
    /// message of each stream there.
    pub fn seek(&mut self, place: MessagePosition) -> Result<Vec<Reassembled>, LogError> {
        let mut newest = Vec::new();
        for index in 0..self.streams.len() {
            newest.extend(self.seek_stream(index, place)?);
        }
        Ok(newest)
    }

    fn take_key(&mut self, index: usize, stored: &LogMessage) -> Option<Reassembled> {
        let (stream, topic) = (&mut self.streams[index], stored.topic);
        let schema = self.log.info().topic(topic)?.schema.clone();
        let message = AnyMessage::encoded(schema, stored.data.clone());
        stream.decoder.take_whole(stored.sequence, &message);
        (stream.key, stream.broken) = (Some((topic, stored.place)), false);
        Some(Reassembled { stored: stored.clone(), topic, message })
    }

    /// Accepts the next delta; `false` if it is refused. Of those that are refused one after another, the first is
    /// reported.
    fn take_delta(&mut self, index: usize, stored: &LogMessage) -> bool {
        let too_far = self.too_far(index, stored.place);
        let stream = &mut self.streams[index];
        let (taken, left_out) = match too_far {
            Some(why) => (Err(why), "left out, like those up to the next whole grid"),
            None => (stream.decoder.take_delta(stored.sequence, &stored.data), "left out"),
        };
        let Err(error) = taken else {
            stream.broken = false;
            return true;
        };
        if !std::mem::replace(&mut stream.broken, true) {
            let name = |id| self.log.info().topic(id).map_or("", |topic| topic.name.as_str());
            let text = if stream.reach.is_some() {
                format!("{}: update at {}: {error}; {left_out}", name(stored.topic), stored.log_time)
            } else {
                format!("{}: {error}; skipped up to the next key frame", name(stream.keys[0]))
            };
            self.log.report_at(stored.place, text);
        }
        false
    }

    /// Why a delta is too far behind its key frame, if it is.
    fn too_far(&self, index: usize, place: MessagePosition) -> Option<String> {
        let stream = &self.streams[index];
        let (_, key) = stream.key?;
        let Reach { contents, most_bytes } = stream.reach.as_ref()?;
        let bytes = contents.between(key, place);
        (bytes > *most_bytes).then(|| {
            let [got, most] = [bytes, *most_bytes].map(|bytes| bytes.div_ceil(1 << 20));
            format!(
                "updates since the whole grid lie in {got} MiB of the recording, expected at most {most} MiB"
            )
        })
    }

    /// Whether the deltas of a topic of key frames are left out at a place, because they are too far behind the last one.
    pub fn is_out_of_reach(&self, keys: TopicId, place: MessagePosition) -> bool {
        self.by_topic.get(&keys).is_some_and(|&index| self.too_far(index, place).is_some())
    }

    /// The complete message after a delta that was accepted.
    fn complete(&self, index: usize, stored: LogMessage) -> Option<Reassembled> {
        let stream = &self.streams[index];
        let (topic, _) = stream.key?;
        Some(Reassembled { stored, topic, message: stream.decoder.message()? })
    }

    fn seek_stream(&mut self, index: usize, place: MessagePosition) -> Result<Option<Reassembled>, LogError> {
        let behind = MessagePosition { offset: place.offset.saturating_add(1), ..place };
        let stream = &mut self.streams[index];
        stream.decoder.forget();
        (stream.key, stream.broken) = (None, false);
        let Some(key) = self.log.previous_message(behind, Some(&stream.keys))? else {
            // Deltas without a key frame are reported at the first of them, from wherever one comes.
            let first = self.log.next_message(MessagePosition::default(), Some(&stream.deltas))?;
            if let Some(first) = first.filter(|first| first.place <= place) {
                self.take_delta(index, &first);
            }
            return Ok(None);
        };
        let Some(mut last) = self.take_key(index, &key) else { return Ok(None) };
        let stream = &mut self.streams[index];
        let is_behind = |kept: &&Reassembled| key.place < kept.stored.place && kept.stored.place <= place;
        let nearest = stream.kept.iter().filter(is_behind).max_by_key(|kept| kept.stored.place);
        if let Some(kept) = nearest.cloned() {
            stream.decoder.take_whole(kept.stored.sequence, &kept.message);
            last = kept;
        }
        let deltas = stream.deltas.clone();
        let options = CursorOptions { topics: Some(deltas), start: key.log_time, end: place.time };
        let (mut accepted, mut kept_at) = (None, last.stored.place);
        for delta in self.log.cursor_after(options, last.stored.place) {
            let delta = delta?;
            if delta.place > place {
                break;
            }
            let at = delta.place;
            if self.take_delta(index, &delta) {
                accepted = Some(delta.clone());
                let is_far =
                    |reach: &Reach| reach.contents.between(kept_at, at) > reach.most_bytes / KEPT_PARTS;
                if self.streams[index].reach.as_ref().is_some_and(is_far) {
                    self.keep(index, delta);
                    kept_at = at;
                }
            } else if self.too_far(index, at).is_some() {
                break;
            }
        }
        let newest = accepted.and_then(|stored| self.complete(index, stored));
        Ok(Some(newest.unwrap_or(last)))
    }

    /// Keeps the message after a delta that was accepted. Those that were kept first make room.
    fn keep(&mut self, index: usize, stored: LogMessage) {
        let Some(whole) = self.complete(index, stored) else { return };
        let most = KEPT_BYTES / self.streams.iter().filter(|stream| stream.reach.is_some()).count().max(1);
        let kept = &mut self.streams[index].kept;
        kept.push_back(whole);
        while kept.iter().map(|whole| whole.message.size_hint()).sum::<usize>() > most {
            kept.pop_front();
        }
    }
}

impl Stream {
    fn new(keys: Vec<TopicId>, deltas: Vec<TopicId>, decoder: Box<dyn DeltaDecoder>) -> Self {
        Self { keys, deltas, decoder, reach: None, key: None, kept: VecDeque::new(), broken: false }
    }

    fn topics(&self) -> impl Iterator<Item = TopicId> {
        self.keys.iter().chain(&self.deltas).copied()
    }
}

/// The stream of a topic with deltas of our own recordings.
fn own_stream(log: &Log, topic: &LogTopic) -> Option<Stream> {
    let keys = log.info().topics_named(topic.metadata.get(DELTA_OF)?).next()?;
    let named = |codec: &&&'static dyn DeltaCodec| codec.delta_schema().name() == topic.schema.name();
    let codec = log.codecs().iter().find(named)?;
    Some(Stream::new(vec![keys.id], vec![topic.id], codec.decoder()))
}

/// The stream of a topic with updates of grids of ROS. As for whoever subscribes to it, an update belongs to the last
/// grid with the name of the topic, whichever channel has it.
fn grid_stream(log: &Log, topic: &LogTopic) -> Option<Stream> {
    let (name, info) = (topic.name.strip_suffix(GRID_UPDATES)?, log.info());
    let is_grid = |grids: &&LogTopic| grid_decoder(&grids.schema, &topic.schema).is_some();
    let first = info.topics_named(name).find(is_grid)?;
    let is_alike = |grids: &&LogTopic| is_grid(grids) && grids.schema.reads_like(&first.schema);
    let grids: Vec<&LogTopic> = info.topics_named(name).filter(is_alike).collect();
    let is_update =
        |updates: &&LogTopic| updates.messages > 0 && grid_decoder(&first.schema, &updates.schema).is_some();
    let updates = info.topics_named(&topic.name).filter(is_update);
    let updates: Vec<TopicId> = updates.map(|updates| updates.id).collect();
    let decoder = grid_decoder(&first.schema, &topic.schema).filter(|_| !updates.is_empty())?;
    let reach = Some(Reach { contents: log.contents_of(&updates), most_bytes: REACH_BYTES });
    let stream = Stream::new(grids.iter().map(|grids| grids.id).collect(), updates, decoder);
    Some(Stream { reach, ..stream })
}

impl std::fmt::Debug for Reassembly {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Reassembly").field("topics", &self.by_topic).finish_non_exhaustive()
    }
}

#[cfg(test)]
#[path = "reassembly_tests.rs"]
mod tests;
