//! Entities of scenes: what the `foxglove.SceneUpdate` messages of a topic add, replace and delete.
//!
//! An entity exists from the log time of its message until another message replaces or deletes it, or its lifetime has
//! passed (by log time, too, since stamps may be of another clock). All entities of a recording or run are gathered with
//! the periods in which they exist, so that the entities of a moment do not depend on how it was reached: playing and
//! seeking, forward and back, show the same.
//!
//! The memory of a topic is bounded. Where it is exceeded, the entities that ended first are forgotten, and before the
//! last forgotten one the newest message alone counts, as it does where the recording has not been read yet. An entity
//! that is sent again without a change, except for its time stamp, shares its content with the one before.
//!
//! One thread adds; the interface's thread looks up. The lock is held while references are moved, but not while contents
//! are copied or freed.

use super::per_run::{Gathered, Written};
use super::run_tag::RunTag;
use bytes::Bytes;
use rcs_msg::foxglove::scene_entity_deletion::Type as Deletion;
use rcs_msg::foxglove::{
    ArrowPrimitive, Color, CubePrimitive, CylinderPrimitive, LinePrimitive, ModelPrimitive, Point3,
    SceneEntity, SceneUpdate, SpherePrimitive, TextPrimitive, TriangleListPrimitive,
};
use rcs_msg::prost_types::Duration;
use rcs_msg::{AnyMessage, DELETES_NAMESPACE, Stamp};
use std::collections::{BTreeMap, BTreeSet, HashSet};
use std::fmt;
use std::sync::{Arc, OnceLock, PoisonError, RwLock, RwLockReadGuard, RwLockWriteGuard};

/// The type of messages with entities.
const SCENE_UPDATE: &str = "foxglove.SceneUpdate";
/// Most entities of a topic that exist at one moment.
const MOST_ENTITIES: usize = 20_000;
/// Most memory for the entities of a topic, bytes.
const MOST_BYTES: usize = 64 << 20;
/// Memory of an entity besides its content, bytes: itself, references, and the id by which it is found.
const EACH: usize = size_of::<Entity>() + 160;
/// Versions of which the latest end is known, so that a look-up passes over those that have all ended.
const BLOCK: usize = 256;

pub(crate) fn is_scene_type(name: &str) -> bool {
    name == SCENE_UPDATE
}

/// One entity.
#[derive(Clone, Debug, PartialEq)]
pub struct Entity {
    /// What it consists of, without its time stamp. Models have no data, because they are not drawn. Entities with equal
    /// contents may share it.
    pub content: Arc<SceneEntity>,
    /// Its time stamp; `None` if it has none, or one of 0.
    pub stamp: Option<Stamp>,
    /// Log time of its message.
    pub from: Stamp,
    /// Log time at which its lifetime has passed; [`Stamp::MAX`] if it has none.
    pub expires: Stamp,
}

impl Entity {
    /// An entity of a message with this log time.
    pub fn new(mut content: SceneEntity, from: Stamp) -> Self {
        let stamp = stamp_of(&content);
        content.timestamp = None;
        content.models.iter_mut().for_each(|model| model.data = Bytes::new());
        Self::of(Arc::new(content), stamp, from)
    }

    fn of(content: Arc<SceneEntity>, stamp: Option<Stamp>, from: Stamp) -> Self {
        let expires = lifetime_ns(content.lifetime.as_ref()).map_or(Stamp::MAX, |ns| from.after_ns(ns));
        Self { content, stamp, from, expires }
    }

    /// Whether its message has come and its lifetime has not passed.
    pub fn is_alive(&self, at: Stamp) -> bool {
        self.from <= at && at < self.expires
    }
}

/// The entities of the newest message of a topic.
pub(crate) fn entities_of(update: &SceneUpdate, log_time: Stamp) -> Vec<Arc<Entity>> {
    let entities = update.entities.iter().take(MOST_ENTITIES).cloned();
    entities.map(|content| Arc::new(Entity::new(content, log_time))).collect()
}

/// The time stamp; one of 0 is none.
fn stamp_of(entity: &SceneEntity) -> Option<Stamp> {
    entity.timestamp.as_ref().and_then(Stamp::from_proto).filter(|stamp| stamp.0 != 0)
}

/// Whether an entity of a message equals a stored content, except for its time stamp. One with models never does, since
/// their data are not stored.
fn is_same(entity: &SceneEntity, stored: &SceneEntity) -> bool {
    let SceneEntity {
        timestamp: _,
        frame_id,
        id,
        lifetime,
        frame_locked,
        metadata,
        arrows,
        cubes,
        spheres,
        cylinders,
        lines,
        triangles,
        texts,
        models,
    } = entity;
    *id == stored.id
        && *frame_id == stored.frame_id
        && *lifetime == stored.lifetime
        && *frame_locked == stored.frame_locked
        && *metadata == stored.metadata
        && *arrows == stored.arrows
        && *cubes == stored.cubes
        && *spheres == stored.spheres
        && *cylinders == stored.cylinders
        && *lines == stored.lines
        && *triangles == stored.triangles
        && *texts == stored.texts
        && models.is_empty()
        && stored.models.is_empty()
}

/// The lifetime in nanoseconds; `None` if the entity lives until it is replaced or deleted.
fn lifetime_ns(lifetime: Option<&Duration>) -> Option<u64> {
    let lifetime = lifetime?;
    let ns = i128::from(lifetime.seconds) * 1_000_000_000 + i128::from(lifetime.nanos);
    u64::try_from(ns).ok().filter(|ns| *ns > 0)
}

/// About how much memory the content of an entity takes, bytes.
fn size(entity: &SceneEntity) -> usize {
    let vertices = |points: usize, colors: usize, indices: usize| {
        points * size_of::<Point3>() + colors * size_of::<Color>() + indices * size_of::<u32>()
    };
    let lines = entity.lines.iter().map(|line| {
        size_of::<LinePrimitive>() + vertices(line.points.len(), line.colors.len(), line.indices.len())
    });
    let triangles = entity.triangles.iter().map(|list| {
        let vertices = vertices(list.points.len(), list.colors.len(), list.indices.len());
        size_of::<TriangleListPrimitive>() + vertices
    });
    let texts = entity.texts.iter().map(|text| size_of::<TextPrimitive>() + text.text.len());
    let models = entity.models.iter().map(|model| size_of::<ModelPrimitive>() + model.url.len());
    let pairs = entity.metadata.iter().map(|pair| 48 + pair.key.len() + pair.value.len());
    size_of::<SceneEntity>()
        + 2 * entity.id.len()
        + entity.frame_id.len()
        + entity.arrows.len() * size_of::<ArrowPrimitive>()
        + entity.cubes.len() * size_of::<CubePrimitive>()
        + entity.spheres.len() * size_of::<SpherePrimitive>()
        + entity.cylinders.len() * size_of::<CylinderPrimitive>()
        + lines.chain(triangles).chain(texts).chain(models).chain(pairs).sum::<usize>()
}

/// About how much memory entities take, bytes. A content that several of them share counts once.
fn bytes_of(versions: &[Version]) -> usize {
    let mut counted = HashSet::new();
    let content = |content: &Arc<SceneEntity>| {
        let is_first = counted.insert(Arc::as_ptr(content));
        if is_first { size(content) } else { 0 }
    };
    EACH * versions.len() + versions.iter().map(|version| &version.entity.content).map(content).sum::<usize>()
}

/// An entity until it was replaced or deleted. Its times are kept here, so that a look-up reads nothing else.
struct Version {
    entity: Arc<Entity>,
    /// Log time of its message.
    from: Stamp,
    /// Log time at which it was replaced or deleted, or its lifetime has passed; [`Stamp::MAX`] while neither is known.
    end: Stamp,
}

/// The entities of a topic.
#[derive(Default)]
struct Store {
    /// In the order of their messages.
    versions: Vec<Version>,
    /// The latest end in each block of [`BLOCK`] versions.
    latest_ends: Vec<Stamp>,
    /// From this time on nothing was forgotten; [`Stamp::MAX`] until everything has been deleted once.
    complete_from: Stamp,
    /// Log time of the last message that was read.
    read_until: Option<Stamp>,
    /// Number of entities that were left out, because too many others existed.
    left_out: usize,
}

impl Store {
    fn existing_at(&self, at: Stamp) -> Vec<Arc<Entity>> {
        let begun = self.versions.partition_point(|version| version.from <= at);
        let blocks = self.versions[..begun].chunks(BLOCK).zip(&self.latest_ends);
        let blocks = blocks.filter(|(_, latest)| at < **latest);
        let existing = blocks.flat_map(|(block, _)| block).filter(|version| at < version.end);
        existing.map(|version| Arc::clone(&version.entity)).collect()
    }

    fn push(&mut self, version: Version) {
        if self.versions.len().is_multiple_of(BLOCK) {
            self.latest_ends.push(version.end);
        } else if let Some(latest) = self.latest_ends.last_mut() {
            *latest = version.end.max(*latest);
        }
        self.versions.push(version);
    }

    /// Ends these versions, unless they have ended before.
    fn end(&mut self, ended: &[usize], at: Stamp) {
        let mut blocks = BTreeSet::new();
        for &index in ended {
            let end = &mut self.versions[index].end;
            *end = at.min(*end);
            blocks.insert(index / BLOCK);
        }
        for block in blocks {
            let last = self.versions.len().min((block + 1) * BLOCK);
            self.latest_ends[block] = latest_end(&self.versions[block * BLOCK..last]);
        }
    }

    /// Removes and returns what has ended at `cut` or before.
    fn forget_until(&mut self, cut: Stamp) -> Vec<Version> {
        let gone = self.versions.extract_if(.., |version| version.end <= cut).collect();
        self.latest_ends = self.versions.chunks(BLOCK).map(latest_end).collect();
        self.complete_from = self.complete_from.max(cut);
        gone
    }
}

fn latest_end(block: &[Version]) -> Stamp {
    block.iter().map(|version| version.end).max().unwrap_or_default()
}

/// The entities of a topic at one moment.
#[derive(Clone)]
pub struct Entities {
    /// The topic.
    pub topic: Arc<str>,
    /// Its run.
    pub run: RunTag,
    /// The moment.
    pub now: Stamp,
    store: Arc<RwLock<Store>>,
    /// What was found, once it has been asked for; `None` where not everything is known.
    found: Arc<OnceLock<Option<Vec<Arc<Entity>>>>>,
}

impl fmt::Debug for Entities {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Entities({} of {:?} at {})", self.topic, self.run, self.now)
    }
}

impl Entities {
    /// Those of the same topic at another moment.
    #[must_use]
    pub fn at(&self, now: Stamp) -> Self {
        Self { now, found: Arc::default(), ..self.clone() }
    }

    /// The entities that exist at the moment, whose newest message has this log time; `None` where not everything is
    /// known that decides it.
    pub(crate) fn found(&self, newest: Stamp) -> Option<&[Arc<Entity>]> {
        let found = self.found.get_or_init(|| {
            let store = self.store();
            let is_known = store.complete_from <= self.now && store.read_until.is_some_and(|at| at >= newest);
            is_known.then(|| store.existing_at(self.now))
        });
        found.as_deref()
    }

    /// Number of entities of the topic that are nowhere shown, because too many others existed.
    pub fn left_out(&self) -> usize {
        self.store().left_out
    }

    fn store(&self) -> RwLockReadGuard<'_, Store> {
        read(&self.store)
    }
}

fn read(store: &RwLock<Store>) -> RwLockReadGuard<'_, Store> {
    store.read().unwrap_or_else(PoisonError::into_inner)
}

fn write(store: &RwLock<Store>) -> RwLockWriteGuard<'_, Store> {
    store.write().unwrap_or_else(PoisonError::into_inner)
}

/// The entities of a topic as they are gathered. Nothing else writes to the store.
#[derive(Default)]
struct Growing {
    store: Arc<RwLock<Store>>,
    /// The entities that nothing has replaced or deleted, by id: indices of versions. Some of those whose lifetime has
    /// passed may be missing.
    open: BTreeMap<String, usize>,
    /// No entity in `open` expires before this log time.
    first_expiry: Stamp,
    bytes: usize,
    /// Forgetting would be in vain before this log time, unless so many entities have been replaced or deleted.
    in_vain: (Stamp, usize),
}

impl Growing {
    fn add(&mut self, log_time: Stamp, update: &SceneUpdate) {
        // The order of versions is that of their times.
        let log_time = read(&self.store).read_until.map_or(log_time, |until| until.max(log_time));
        let mut deleted = BTreeMap::new();
        let mut ended = Vec::<usize>::new();
        let mut deletes_all = false;
        let mut namespaces = BTreeSet::new();
        for deletion in &update.deletions {
            if deletion.r#type == DELETES_NAMESPACE {
                // It may come many times, and after the first time nothing is left of it.
                if namespaces.insert(deletion.id.as_str()) {
                    deleted.append(&mut self.take_namespace(&deletion.id));
                }
                continue;
            }
            match deletion.r#type() {
                Deletion::All => {
                    deleted.append(&mut self.open);
                    deletes_all = true;
                }
                Deletion::MatchingId => ended.extend(self.open.remove(&deletion.id)),
            }
        }
        ended.extend(deleted.values());
        if self.open.len() + update.entities.len() > MOST_ENTITIES && self.first_expiry <= log_time {
            self.close_expired(log_time);
        }
        let replaced: Vec<Option<usize>> =
            update.entities.iter().map(|entity| self.open.remove(&entity.id)).collect();
        ended.extend(replaced.iter().flatten());
        let shared = {
            let store = read(&self.store);
            let before = |(entity, replaced): (&SceneEntity, Option<usize>)| {
                let index = replaced.or_else(|| deleted.get(&entity.id).copied())?;
                let content = &store.versions[index].entity.content;
                is_same(entity, content).then(|| Arc::clone(content))
            };
            update.entities.iter().zip(replaced.iter().copied()).map(before).collect::<Vec<_>>()
        };
        {
            let mut store = write(&self.store);
            store.end(&ended, log_time);
            if deletes_all {
                store.complete_from = store.complete_from.min(log_time);
            }
        }
        self.in_vain.1 = self.in_vain.1.saturating_sub(ended.len());
        let sizes = update.entities.iter().zip(&shared);
        let sizes = sizes.map(|(entity, shared)| EACH + if shared.is_some() { 0 } else { size(entity) });
        let sizes: Vec<usize> = sizes.collect();
        let (from, count) = self.in_vain;
        if self.bytes + sizes.iter().sum::<usize>() > MOST_BYTES && (from <= log_time || count == 0) {
            self.forget(log_time);
        }
        self.append(log_time, update, shared, &sizes, &replaced);
    }

    /// Takes the entities of a namespace out of `open`.
    fn take_namespace(&mut self, namespace: &str) -> BTreeMap<String, usize> {
        let begin = format!("{namespace}/");
        let ids = self.open.range(begin.clone()..).map(|(id, _)| id);
        // An id with another slash is of a namespace that begins like this one.
        let is_own = |id: &&String| !id[begin.len()..].contains('/');
        let own: Vec<String> = ids.take_while(|id| id.starts_with(&begin)).filter(is_own).cloned().collect();
        own.iter().filter_map(|id| self.open.remove_entry(id)).collect()
    }

    /// Adds the entities of a message as far as there is room; those that it replaces have been closed.
    fn append(
        &mut self,
        log_time: Stamp,
        update: &SceneUpdate,
        shared: Vec<Option<Arc<SceneEntity>>>,
        sizes: &[usize],
        replaced: &[Option<usize>],
    ) {
        let begin = read(&self.store).versions.len();
        let (mut added, mut left_out) = (Vec::<Version>::new(), 0);
        // What is replaced keeps its room.
        let mut reserved = replaced.iter().flatten().count();
        for (index, (entity, content)) in update.entities.iter().zip(shared).enumerate() {
            reserved -= usize::from(replaced[index].is_some());
            // An id may come twice in a message.
            if let Some(former) = self.open.remove(&entity.id) {
                added[former - begin].end = log_time;
            }
            if self.open.len() + reserved >= MOST_ENTITIES || self.bytes + sizes[index] > MOST_BYTES {
                left_out += 1;
                continue;
            }
            self.bytes += sizes[index];
            self.open.insert(entity.id.clone(), begin + added.len());
            let entity = match content {
                Some(content) => Entity::of(content, stamp_of(entity), log_time),
                None => Entity::new(entity.clone(), log_time),
            };
            self.first_expiry = self.first_expiry.min(entity.expires);
            added.push(Version { from: log_time, end: entity.expires, entity: Arc::new(entity) });
        }
        let mut store = write(&self.store);
        store.left_out += left_out;
        for version in added {
            store.push(version);
        }
        store.read_until = Some(log_time);
    }

    /// Takes those whose lifetime has passed out of `open`.
    fn close_expired(&mut self, log_time: Stamp) {
        let store = read(&self.store);
        self.open.retain(|_, index| log_time < store.versions[*index].end);
        let ends = self.open.values().map(|index| store.versions[*index].end);
        self.first_expiry = ends.min().unwrap_or(Stamp::MAX);
    }

    /// Forgets the half of the entities that ended first; nothing if so few have ended that it would come again at once.
    fn forget(&mut self, log_time: Stamp) {
        let mut ends: Vec<Stamp> = read(&self.store).versions.iter().map(|version| version.end).collect();
        ends.sort_unstable();
        let ended = ends.partition_point(|end| *end <= log_time);
        let least = (ends.len() / 8).max(1);
        if ended < least {
            // One half of those that are missing has to expire, or as many have to be replaced or deleted.
            let half = (least - ended).div_ceil(2);
            self.in_vain = (ends.get(ended + half - 1).copied().unwrap_or(Stamp::MAX), half);
            return;
        }
        let cut = ends[ended / 2];
        let gone_at: Vec<usize> = {
            let store = read(&self.store);
            let versions = store.versions.iter().enumerate();
            versions.filter(|(_, version)| version.end <= cut).map(|(index, _)| index).collect()
        };
        let gone = write(&self.store).forget_until(cut);
        drop(gone);
        self.open.retain(|_, index| {
            let before = gone_at.partition_point(|gone| *gone < *index);
            let is_kept = gone_at.get(before) != Some(index);
            *index -= before;
            is_kept
        });
        self.bytes = bytes_of(&read(&self.store).versions);
    }

    /// What was known up to and including `time`.
    fn fork(&self, time: Stamp) -> Self {
        let from = read(&self.store);
        let read_until = from.read_until.map(|until| until.min(time));
        let mut store = Store { complete_from: from.complete_from, read_until, ..Store::default() };
        if from.complete_from > time {
            // What existed at that time was forgotten, so nothing is known until everything is deleted.
            store.complete_from = Stamp::MAX;
            return Self { store: Arc::new(RwLock::new(store)), ..Self::default() };
        }
        let mut open = BTreeMap::new();
        for version in from.versions.iter().take_while(|version| version.from <= time) {
            let (entity, mut end) = (Arc::clone(&version.entity), version.end);
            if end > time {
                end = entity.expires;
                open.insert(entity.content.id.clone(), store.versions.len());
            }
            store.push(Version { entity, from: version.from, end });
        }
        let bytes = bytes_of(&store.versions);
        Self { store: Arc::new(RwLock::new(store)), open, bytes, ..Self::default() }
    }
}

/// The entities of one run or recording, as they are gathered.
#[derive(Default)]
pub(crate) struct EntityWatch(BTreeMap<Arc<str>, Growing>);

impl Gathered for EntityWatch {
    fn takes(type_name: &str) -> bool {
        is_scene_type(type_name)
    }

    fn take(&mut self, topic: &Arc<str>, at: Written, message: &AnyMessage) {
        self.look(topic, at.time, message);
    }

    fn fork(&self, at: Written) -> Self {
        Self(self.0.iter().map(|(topic, growing)| (Arc::clone(topic), growing.fork(at.time))).collect())
    }
}

impl EntityWatch {
    /// One of topics of which nothing has been read yet.
    pub(crate) fn of(topics: impl IntoIterator<Item = Arc<str>>) -> Self {
        Self(topics.into_iter().map(|topic| (topic, Growing::default())).collect())
    }

    /// Takes the entities of a canonical message on `topic`; other messages have none.
    pub(crate) fn look(&mut self, topic: &Arc<str>, log_time: Stamp, message: &AnyMessage) {
        if let Some(update) = message.get::<SceneUpdate>() {
            self.0.entry(Arc::clone(topic)).or_default().add(log_time, update);
        }
    }

    /// The entities of all topics at a moment, as those of a run.
    pub(crate) fn read(&self, run: RunTag, now: Stamp) -> impl Iterator<Item = Entities> + '_ {
        self.0.iter().map(move |(topic, growing)| Entities {
            topic: Arc::clone(topic),
            run,
            now,
            store: Arc::clone(&growing.store),
            found: Arc::default(),
        })
    }
}

#[cfg(test)]
#[path = "entities_tests.rs"]
mod tests;
