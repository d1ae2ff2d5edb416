//! Reassembles messages that were stored as key frames and deltas.
//!
//! Channel metadata ([`DELTA_OF`]) says which channel holds the deltas of which topic. The codec is the one for that
//! delta type among those of the log ([`Log::with_codecs`]). A channel of deltas without a known codec remains a
//! separate topic.

use crate::cursor::CursorOptions;
use crate::error::LogError;
use crate::info::{LogMessage, MessagePosition, TopicId};
use crate::log::Log;
use rcs_msg::{AnyMessage, DELTA_OF, DeltaCodec, DeltaDecoder};
use std::collections::BTreeMap;

/// Reassembles the messages of a log's channels with deltas, read in order from the position of [`Reassembly::seek`].
pub struct Reassembly {
    log: Log,
    channels: Vec<Channel>,
    /// Both topics of each channel.
    by_topic: BTreeMap<TopicId, usize>,
}

struct Channel {
    keys: TopicId,
    deltas: TopicId,
    codec: &'static dyn DeltaCodec,
    decoder: Box<dyn DeltaDecoder>,
    /// A message is missing and has been reported: deltas that follow are skipped without another report.
    broken: bool,
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
        let info = log.info();
        let (mut channels, mut by_topic) = (Vec::new(), BTreeMap::new());
        for topic in &info.topics {
            let base = topic.metadata.get(DELTA_OF).and_then(|name| info.topics_named(name).next());
            let named = |codec: &&&'static dyn DeltaCodec| codec.delta_schema().name() == topic.schema.name();
            let (Some(base), Some(&codec)) = (base, log.codecs().iter().find(named)) else { continue };
            if by_topic.contains_key(&base.id) {
                continue;
            }
            by_topic.insert(base.id, channels.len());
            by_topic.insert(topic.id, channels.len());
            let decoder = codec.decoder();
            let (keys, deltas) = (base.id, topic.id);
            channels.push(Channel { keys, deltas, codec, decoder, broken: false });
        }
        Self { log: log.clone(), channels, by_topic }
    }

    /// Whether the topic has key frames or deltas.
    pub fn takes(&self, topic: TopicId) -> bool {
        self.by_topic.contains_key(&topic)
    }

    /// Topic of the key frames for the deltas of this topic.
    pub fn keys_of(&self, deltas: TopicId) -> Option<TopicId> {
        self.channels.iter().find(|channel| channel.deltas == deltas).map(|channel| channel.keys)
    }

    /// Topic of the deltas for the key frames of this topic.
    pub fn deltas_of(&self, keys: TopicId) -> Option<TopicId> {
        self.channels.iter().find(|channel| channel.keys == keys).map(|channel| channel.deltas)
    }

    /// Accepts the next message of one of these topics. `None` if it gives no complete message: the topic is another,
    /// or the delta does not follow the previous message, which is reported as a problem of the log.
    pub fn take(&mut self, stored: &LogMessage) -> Option<Reassembled> {
        let channel = &mut self.channels[*self.by_topic.get(&stored.topic)?];
        let topic = channel.keys;
        if stored.topic == topic {
            let schema = self.log.info().topic(topic)?.schema.clone();
            let message = AnyMessage::encoded(schema, stored.data.clone());
            channel.decoder.take_whole(stored.sequence, &message);
            channel.broken = false;
            return Some(Reassembled { stored: stored.clone(), topic, message });
        }
        match channel.decoder.take_delta(stored.sequence, &stored.data) {
            Ok(message) => Some(Reassembled { stored: stored.clone(), topic, message }),
            Err(error) => {
                if !std::mem::replace(&mut channel.broken, true) {
                    let name = self.log.info().topic(topic).map_or("", |topic| topic.name.as_str());
                    let text = format!("{name}: {error}; skipped up to the next key frame");
                    self.log.report_at(stored.place, text);
                }
                None
            }
        }
    }

    /// Moves to `place`, as if every message up to and including it had been accepted. Returns the newest complete
    /// message of each channel there.
    pub fn seek(&mut self, place: MessagePosition) -> Result<Vec<Reassembled>, LogError> {
        let behind = MessagePosition { offset: place.offset.saturating_add(1), ..place };
        let mut newest = Vec::new();
        for index in 0..self.channels.len() {
            let channel = &mut self.channels[index];
            channel.decoder = channel.codec.decoder();
            channel.broken = false;
            let (keys, deltas) = (channel.keys, channel.deltas);
            let Some(key) = self.log.previous_message(behind, Some(&[keys]))? else { continue };
            let start = key.log_time;
            let after = key.place;
            let mut last = self.take(&key);
            let options = CursorOptions { topics: Some(vec![deltas]), start, end: place.time };
            for delta in self.log.cursor_after(options, after) {
                let delta = delta?;
                if delta.place > place {
                    break;
                }
                last = self.take(&delta).or(last);
            }
            newest.extend(last);
        }
        Ok(newest)
    }
}

impl std::fmt::Debug for Reassembly {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Reassembly").field("topics", &self.by_topic).finish_non_exhaustive()
    }
}
