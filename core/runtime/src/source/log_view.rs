//! The topics of a log at one moment, and background reading of the log.

use super::entities::{Entities, EntityWatch, is_scene_type};
use super::epochs::Epochs;
use super::events::{EventWatch, Events, is_event_type};
use super::fields::{FieldSeries, LogFields, alike};
use super::frame::{Topic, UPDATES};
use super::hierarchy::WRITER_KEYS;
use super::rates::{self, LogRate};
use super::run_tag::RunTag;
use super::tracks::{Track, is_pose_type, is_transform_type};
use super::transform_clock::TransformClock;
use super::{Source, SourceError};
use crate::conversion::canonical;
use crate::role::has_static_transforms;
use rcs_bus::{Header, Sample, WriterId};
use rcs_formula::FieldRef;
use rcs_geom::TransformTree;
use rcs_log::{
    Cursor, CursorOptions, Log, LogMessage, LogTopic, MessagePosition, Reassembled, Reassembly, TopicId,
};
use rcs_msg::channel::WRITER;
use rcs_msg::{AnyMessage, Stamp, rcs};
use std::collections::{BTreeMap, VecDeque};
use std::iter;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Types whose messages have something to show.
const IMAGE_TYPES: [&str; 4] =
    ["foxglove.RawImage", "foxglove.CompressedImage", "foxglove.PointCloud", "foxglove.Grid"];
/// A log without an image where it opens is opened at its first image after that, if that is within this time.
const FIRST_IMAGE_NS: u64 = 1_000_000_000;
/// A longer jump looks up all topics instead of reading everything in between.
const JUMP_NS: u64 = 2_000_000_000;
/// Greatest duration of one piece of background work.
const PIECE: Duration = Duration::from_millis(8);
/// Time between two looks at what another thread has read.
const WAIT: Duration = Duration::from_millis(4);
/// Least time between two looks whether the files of the log have changed.
const LOOK: Duration = Duration::from_secs(1);

/// The topics of a log at one moment.
pub(crate) struct LogView {
    log: Log,
    /// Channels with one name whose messages are read alike are one topic.
    pub(crate) topics: Vec<Topic>,
    /// The rate of each topic; none in a view without rates.
    rates: Vec<LogRate>,
    /// The channels that are read; `None` for all.
    read: Option<Vec<TopicId>>,
    /// Index of the topic of each channel.
    by_id: BTreeMap<TopicId, usize>,
    shown: Option<MessagePosition>,
    /// Reassembles messages that were stored as key frames and deltas, so that they appear as one topic.
    reassembly: Reassembly,
    cursor: Cursor,
    ahead: Option<LogMessage>,
    /// What is read in the background, one after another: poses, transforms and events; then entities, which take longer.
    background: VecDeque<Cursor>,
    fields: LogFields,
    epochs: Epochs,
    entities: EntityWatch,
    events: EventWatch,
    /// Number of problems of the log, and of doubts about its transforms, that have been told.
    told: [usize; 2],
    /// When the files of the log were last looked at.
    looked: Option<Instant>,
}

impl LogView {
    /// A view of all topics; those in `wired` have the name of the buffer that they feed.
    pub(crate) fn new(log: &Log, wired: &BTreeMap<String, Arc<str>>) -> Self {
        Self::of(log, wired, |_| true)
    }

    /// A view of the topics whose types (by the names that views request) are wanted, and of nothing else: their rates
    /// are not known.
    pub(crate) fn of_types(log: &Log, is_wanted: impl Fn(&str) -> bool) -> Self {
        let view = Self::of(log, &BTreeMap::new(), is_wanted);
        let deltas = |id: TopicId| view.reassembly.deltas_of(id).iter().copied();
        let read = view.by_id.keys().flat_map(|&id| iter::once(id).chain(deltas(id))).collect();
        Self { rates: Vec::new(), read: Some(read), ..view }
    }

    fn of(log: &Log, wired: &BTreeMap<String, Arc<str>>, is_wanted: impl Fn(&str) -> bool) -> Self {
        let info = log.info();
        let (mut topics, mut channels) = (Vec::<Topic>::new(), Vec::<Vec<TopicId>>::new());
        let (mut by_id, mut by_name) = (BTreeMap::new(), BTreeMap::<&str, Vec<usize>>::new());
        let reassembly = Reassembly::new(log);
        for topic in &info.topics {
            let type_name = rcs_msg::canonical_name(&topic.schema).unwrap_or_else(|| topic.schema.name());
            if reassembly.keys_of(topic.id).is_some() || !is_wanted(type_name) {
                continue;
            }
            let deltas = reassembly.deltas_of(topic.id).iter().filter_map(|id| info.topic(*id));
            let deltas: Vec<&LogTopic> = deltas.collect();
            let ids = iter::once(topic.id).chain(deltas.iter().map(|deltas| deltas.id));
            let messages = topic.messages + deltas.iter().map(|deltas| deltas.messages).sum::<u64>();
            let named = by_name.entry(&topic.name).or_default();
            let known = named.iter().copied().find(|&index| topics[index].schema.reads_like(&topic.schema));
            by_id.insert(topic.id, known.unwrap_or(topics.len()));
            if let Some(index) = known {
                join(&mut topics[index], topic, messages);
                channels[index].extend(ids);
                continue;
            }
            named.push(topics.len());
            channels.push(ids.collect());
            topics.push(Topic {
                name: wired.get(&topic.name).map_or_else(|| topic.name.as_str().into(), Arc::clone),
                run: RunTag::Recorded,
                schema: Arc::clone(&topic.schema),
                metadata: Arc::new(topic.metadata.clone()),
                writer: writer_of(&topic.metadata).into(),
                messages,
                hz: None,
                seldom_hz: None,
                undecodable: topic.undecodable_because.as_deref().map(Arc::from),
                latest: None,
                pending: false,
                derived: Arc::default(),
                type_name: Arc::default(),
                read_lately: Arc::default(),
            });
        }
        for (&keys, &index) in &by_id {
            let updates = reassembly.deltas_of(keys).iter().filter_map(|id| info.topic(*id));
            let updates: Vec<&LogTopic> = updates.collect();
            if let Some(first) = updates.first() {
                let messages: u64 = updates.iter().map(|updates| updates.messages).sum();
                let text = format!("{messages} on {}", first.name);
                Arc::make_mut(&mut topics[index].metadata).insert(UPDATES.to_owned(), text);
            }
        }
        let rates = topics.iter().zip(channels);
        let rates = rates.map(|(topic, channels)| LogRate::new(channels, topic.messages, info)).collect();
        let ids = |is_read: fn(&str) -> bool| -> Vec<TopicId> {
            let is_read = |topic: &&LogTopic| rcs_msg::canonical_name(&topic.schema).is_some_and(is_read);
            let shown = info.topics.iter().filter(|topic| by_id.contains_key(&topic.id));
            shown.filter(is_read).map(|topic| topic.id).collect()
        };
        let first = ids(|name| is_pose_type(name) || is_transform_type(name) || is_event_type(name));
        let background = [first, ids(is_scene_type)].into_iter().filter(|ids| !ids.is_empty());
        let background = background
            .map(|ids| log.cursor(CursorOptions { topics: Some(ids), ..CursorOptions::default() }))
            .collect();
        let scenes = topics.iter().filter(|topic| is_scene_type(topic.type_name()));
        let entities = EntityWatch::of(scenes.map(|topic| Arc::clone(&topic.name)));
        Self {
            log: log.clone(),
            rates,
            read: None,
            topics,
            by_id,
            shown: None,
            reassembly,
            cursor: log.cursor(CursorOptions::default()),
            ahead: None,
            background,
            fields: LogFields::default(),
            epochs: Epochs::new(info.start),
            entities,
            events: EventWatch::default(),
            told: [info.problems.len(), 0],
            looked: None,
        }
    }

    pub(crate) fn log(&self) -> &Log {
        &self.log
    }

    /// The channels of the log with the topic of that name, including its deltas.
    pub(crate) fn topic_ids(&self, name: &str) -> Vec<TopicId> {
        let keys = self.log.info().topics_named(name).map(|topic| topic.id);
        keys.flat_map(|id| iter::once(id).chain(self.reassembly.deltas_of(id).iter().copied())).collect()
    }

    /// Shows everything up to and including `to`. If that cannot be read, what was shown before stays.
    pub(crate) fn go_to(&mut self, to: MessagePosition) -> Result<(), SourceError> {
        let before = self.topics.clone();
        let moved = self.move_to(to);
        if moved.is_err() {
            // The cursor and the key frames may be anywhere between the two places, so the next place is looked up.
            (self.topics, self.shown) = (before, None);
        }
        moved
    }

    fn move_to(&mut self, to: MessagePosition) -> Result<(), SourceError> {
        match self.shown {
            Some(shown) if to >= shown && to.time.0 - shown.time.0 <= JUMP_NS => {}
            _ => self.look_up_before(to.time)?,
        }
        self.read_on(to)?;
        self.shown = Some(to);
        self.update_rates(to.time)
    }

    fn read_on(&mut self, to: MessagePosition) -> Result<(), SourceError> {
        loop {
            let Some(message) = self.ahead.take().map(Ok).or_else(|| self.cursor.next()).transpose()? else {
                return Ok(());
            };
            if message.place > to {
                self.ahead = Some(message);
                return Ok(());
            }
            self.show(message);
        }
    }

    /// Shows everything before `time`, and positions the cursor there.
    fn look_up_before(&mut self, time: Stamp) -> Result<(), SourceError> {
        self.topics.iter_mut().for_each(|topic| topic.set_latest(None));
        let mut found = self.reassembly.seek(MessagePosition::before(time))?;
        if time > Stamp(0) {
            let direct = self.log.latest_at(time.before_ns(1), self.read.as_deref())?.into_iter().flatten();
            found.extend(direct.filter_map(|stored| self.direct(stored)));
        }
        // Of the channels of a topic, the newest message counts.
        found.sort_unstable_by_key(|whole| whole.stored.place);
        let placed = found.into_iter().filter_map(|whole| Some((*self.by_id.get(&whole.topic)?, whole)));
        let newest: BTreeMap<usize, Reassembled> = placed.collect();
        for (index, whole) in newest {
            self.set_latest(index, whole);
        }
        self.rates.iter_mut().for_each(|rate| rate.begin_at(time));
        self.ahead = None;
        let topics = self.read.clone();
        self.cursor = self.log.cursor(CursorOptions { topics, start: time, ..CursorOptions::default() });
        Ok(())
    }

    /// Updates the rates to the viewed time.
    fn update_rates(&mut self, time: Stamp) -> Result<(), SourceError> {
        let newest = |topic: &Topic| topic.latest.as_ref().map(|latest| latest.header.log_time);
        let newest: Vec<Option<Stamp>> = self.topics.iter().map(newest).collect();
        rates::measure(&mut self.rates, &newest, &self.log, time)?;
        for (topic, rate) in self.topics.iter_mut().zip(&self.rates) {
            (topic.hz, topic.seldom_hz) = (rate.hz(), rate.seldom_hz());
        }
        Ok(())
    }

    fn show(&mut self, message: LogMessage) {
        let whole = if self.reassembly.takes(message.topic) {
            self.reassembly.take(&message)
        } else {
            self.direct(message)
        };
        if let Some(whole) = whole
            && let Some(&index) = self.by_id.get(&whole.topic)
        {
            self.set_latest(index, whole);
        }
    }

    /// A message that is stored whole; `None` for one of a topic with deltas.
    fn direct(&self, stored: LogMessage) -> Option<Reassembled> {
        let topic = stored.topic;
        if self.reassembly.takes(topic) {
            return None;
        }
        let schema = &self.topics[*self.by_id.get(&topic)?].schema;
        let message = AnyMessage::encoded(Arc::clone(schema), stored.data.clone());
        Some(Reassembled { stored, topic, message })
    }

    fn set_latest(&mut self, index: usize, whole: Reassembled) {
        let Reassembled { stored, message, .. } = whole;
        let topic = &mut self.topics[index];
        let header = Header {
            sequence: u64::from(stored.sequence),
            log_time: stored.log_time,
            // What the message itself says is read where it is needed: `Topic::acq_time`.
            acq_time: stored.publish_time,
            writer: WriterId::RUNTIME,
        };
        topic.set_latest(Some(Sample { header, message }));
        if let Some(rate) = self.rates.get_mut(index) {
            rate.take(header.log_time);
        }
    }

    /// Gathers these fields of the topics for which `is_wanted` holds, and no others.
    pub(crate) fn gather(&mut self, fields: &[FieldRef], is_wanted: impl Fn(&str) -> bool) {
        let Self { log, topics, by_id, reassembly, fields: gathered, .. } = self;
        gathered.gather(log, fields, |name| {
            let shown = by_id.iter().filter(|(_, index)| *topics[**index].name == *name && is_wanted(name));
            alike(shown.filter_map(|(id, _)| log.info().topic(*id)), reassembly)
        });
    }

    /// The gathered fields, as far as they have been read.
    pub(crate) fn fields(&self) -> impl Iterator<Item = FieldSeries> + '_ {
        self.fields.read()
    }

    /// Reads poses, transforms, events and entities for a few milliseconds; `true` if some are left.
    pub(crate) fn idle(&mut self) -> bool {
        let Some(cursor) = self.background.front_mut() else {
            let reads = self.fields.is_reading();
            if reads {
                // Another thread reads; this one shows its progress.
                std::thread::sleep(WAIT);
            }
            return reads;
        };
        let until = Instant::now() + PIECE;
        let mut more = true;
        while more && Instant::now() < until {
            match cursor.next() {
                Some(Ok(message)) => {
                    let Some(&index) = self.by_id.get(&message.topic) else { continue };
                    let topic = &self.topics[index];
                    let raw = AnyMessage::encoded(Arc::clone(&topic.schema), message.data);
                    if let Some(message_out) = canonical(&raw) {
                        let is_static = is_static_topic(&self.log, message.topic);
                        self.events.look(&topic.name, message.log_time, &message_out);
                        self.entities.look(&topic.name, message.log_time, &message_out);
                        self.epochs.add(&topic.name, message.log_time, &message_out, is_static);
                    }
                }
                // The log has reported chunks that cannot be read; the cursor continues after them.
                Some(Err(_)) => {}
                None => more = false,
            }
        }
        if !more {
            self.background.pop_front();
        }
        if !more || self.epochs.is_outgrown() {
            self.epochs.share();
        }
        more || !self.background.is_empty() || self.fields.is_reading()
    }

    /// The tracks of the log by which a moment is shown, as far as they have been read: those of the run of its clock.
    pub(crate) fn tracks(&self, now: Stamp) -> impl Iterator<Item = Track> + '_ {
        self.epochs.tracks(RunTag::Recorded, now)
    }

    /// The transforms of the log by which a moment is shown, as far as they have been read: those of the run of its clock.
    pub(crate) fn transforms(&self, now: Stamp) -> &Arc<TransformTree> {
        self.epochs.tree(now)
    }

    /// The clock of [`LogView::transforms`].
    pub(crate) fn transform_clock(&self, now: Stamp) -> &Arc<TransformClock> {
        self.epochs.clock(now)
    }

    /// The entities of the log at a moment, as far as they have been read.
    pub(crate) fn entities(&self, now: Stamp) -> impl Iterator<Item = Entities> + '_ {
        self.entities.read(RunTag::Recorded, now)
    }

    /// The problems of the log, and the doubts about its transforms, that were found since it was opened or this was
    /// last asked.
    pub(crate) fn take_problems(&mut self) -> Vec<String> {
        if self.looked.is_none_or(|looked| looked.elapsed() >= LOOK) {
            self.looked = Some(Instant::now());
            self.log.look_for_changes();
        }
        let (problems, doubts) = (self.log.problems(), self.epochs.doubts());
        let [told, told_doubts] = std::mem::replace(&mut self.told, [problems.len(), doubts.len()]);
        problems.into_iter().skip(told).chain(doubts.iter().skip(told_doubts).cloned()).collect()
    }

    /// The events of the log, as far as they have been read.
    pub(crate) fn events(&self) -> Events {
        self.events.read(RunTag::Recorded)
    }

    /// All processes that the log describes.
    pub(crate) fn processes(&self) -> Result<Arc<[rcs::ProcessInfo]>, SourceError> {
        let ids = self.topic_ids(crate::stack::names::PROCESSES);
        if ids.is_empty() {
            return Ok(Arc::new([]));
        }
        let mut found: Vec<rcs::ProcessInfo> = Vec::new();
        for message in self.log.cursor(CursorOptions { topics: Some(ids), ..CursorOptions::default() }) {
            if let Ok(info) = <rcs::ProcessInfo as prost::Message>::decode(message?.data)
                && !found.iter().any(|known| known.name == info.name)
            {
                found.push(info);
            }
        }
        Ok(found.into())
    }
}

/// The process that writes a channel; empty if unknown.
fn writer_of(metadata: &BTreeMap<String, String>) -> &str {
    metadata.get(WRITER).map_or("", String::as_str)
}

/// Adds a channel with this number of messages to a topic whose messages are read like its own.
fn join(topic: &mut Topic, channel: &LogTopic, messages: u64) {
    if topic.messages == 0 {
        // Channels without messages describe nothing.
        topic.metadata = Arc::new(channel.metadata.clone());
    } else if messages > 0 {
        join_writers(Arc::make_mut(&mut topic.metadata), &channel.metadata);
    }
    topic.writer = writer_of(&topic.metadata).into();
    topic.messages += messages;
}

/// Adds the writers of another channel, separated by commas.
fn join_writers(metadata: &mut BTreeMap<String, String>, other: &BTreeMap<String, String>) {
    // This key also says how the times of messages are read, so it must hold for all of them.
    if !other.contains_key(WRITER) {
        metadata.remove(WRITER);
    }
    for key in WRITER_KEYS {
        let (Some(known), Some(others)) = (metadata.get_mut(key), other.get(key)) else { continue };
        for writer in others.split(", ") {
            if known.split(", ").all(|known| known != writer) {
                known.push_str(", ");
                known.push_str(writer);
            }
        }
    }
}

/// The initial time: `from`, or the first image after that if it follows shortly.
pub(crate) fn opening_time(log: &Log, from: Stamp) -> Result<Stamp, SourceError> {
    let info = log.info();
    let is_image = |schema| rcs_msg::canonical_name(schema).is_some_and(|name| IMAGE_TYPES.contains(&name));
    let topics: Vec<TopicId> =
        info.topics.iter().filter(|topic| is_image(&topic.schema)).map(|topic| topic.id).collect();
    if topics.is_empty() {
        return Ok(from);
    }
    let end = from.after_ns(FIRST_IMAGE_NS);
    let first = log.cursor(CursorOptions { topics: Some(topics), start: from, end }).next().transpose()?;
    Ok(first.map_or(from, |message| message.log_time))
}

fn is_static_topic(log: &Log, id: TopicId) -> bool {
    log.info().topic(id).is_some_and(|topic| has_static_transforms(&topic.name, &topic.metadata))
}

/// Runs the `idle` work of a source to its end.
pub fn finish_idle(source: &mut dyn Source) {
    while source.idle() {}
}
