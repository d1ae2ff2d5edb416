//! Entities of scenes: what the `foxglove.SceneUpdate` messages of a topic add, replace and delete.
//!
//! An entity exists from the log time of its message until another message replaces or deletes it, or its lifetime has
//! passed (by log time, too, since stamps may be of another clock). All entities of a recording or run are gathered with
//! the periods in which they exist, so that the entities of a moment do not depend on how it was reached: playing and
//! seeking, forward and back, show the same.
//!
//! The memory of a topic is bounded. Where it is exceeded, the entities that ended first are forgotten, and before the
//! last forgotten one the newest message alone counts, as it does where the recording has not been read yet.

use super::per_run::Gathered;
use super::run_tag::RunTag;
use bytes::Bytes;
use rcs_msg::foxglove::scene_entity_deletion::Type as Deletion;
use rcs_msg::foxglove::{
    ArrowPrimitive, Color, CubePrimitive, CylinderPrimitive, LinePrimitive, ModelPrimitive, Point3,
    SceneEntity, SceneUpdate, SpherePrimitive, TextPrimitive, TriangleListPrimitive,
};
use rcs_msg::prost_types::Duration;
use rcs_msg::{AnyMessage, Stamp};
use std::collections::BTreeMap;
use std::fmt;
use std::sync::{Arc, OnceLock, PoisonError, RwLock, RwLockReadGuard};

/// The type of messages with entities.
const SCENE_UPDATE: &str = "foxglove.SceneUpdate";
/// Most entities of a topic that exist at one moment.
const MOST_ENTITIES: usize = 20_000;
/// Most memory for the entities of a topic, bytes.
const MOST_BYTES: usize = 64 << 20;
/// Memory of an entity besides its contents, bytes: references and the id by which it is found.
const OVERHEAD: usize = 160;

pub(crate) fn is_scene_type(name: &str) -> bool {
    name == SCENE_UPDATE
}

/// One entity.
#[derive(Clone, Debug, PartialEq)]
pub struct Entity {
    /// What it consists of. Models have no data, because they are not drawn.
    pub content: SceneEntity,
    /// Log time of its message.
    pub from: Stamp,
    /// Log time at which its lifetime has passed; [`Stamp::MAX`] if it has none.
    pub expires: Stamp,
}

impl Entity {
    /// An entity of a message with this log time.
    pub fn new(mut content: SceneEntity, from: Stamp) -> Self {
        content.models.iter_mut().for_each(|model| model.data = Bytes::new());
        let expires = lifetime_ns(content.lifetime.as_ref()).map_or(Stamp::MAX, |ns| from.after_ns(ns));
        Self { content, from, expires }
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

/// The lifetime in nanoseconds; `None` if the entity lives until it is replaced or deleted.
fn lifetime_ns(lifetime: Option<&Duration>) -> Option<u64> {
    let lifetime = lifetime?;
    let ns = i128::from(lifetime.seconds) * 1_000_000_000 + i128::from(lifetime.nanos);
    u64::try_from(ns).ok().filter(|ns| *ns > 0)
}

/// About how much memory an entity takes, bytes.
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
    size_of::<Entity>()
        + OVERHEAD
        + 2 * entity.id.len()
        + entity.frame_id.len()
        + entity.arrows.len() * size_of::<ArrowPrimitive>()
        + entity.cubes.len() * size_of::<CubePrimitive>()
        + entity.spheres.len() * size_of::<SpherePrimitive>()
        + entity.cylinders.len() * size_of::<CylinderPrimitive>()
        + lines.chain(triangles).chain(texts).chain(models).chain(pairs).sum::<usize>()
}

/// An entity until it was replaced or deleted.
#[derive(Clone)]
struct Version {
    entity: Arc<Entity>,
    /// Log time of the message that replaced or deleted it; [`Stamp::MAX`] while none has.
    ended: Stamp,
    size: usize,
}

impl Version {
    fn exists_at(&self, at: Stamp) -> bool {
        self.entity.is_alive(at) && at < self.ended
    }

    fn end(&self) -> Stamp {
        self.ended.min(self.entity.expires)
    }
}

/// The entities of a topic.
#[derive(Default)]
struct Store {
    /// In the order of their messages.
    versions: Vec<Version>,
    /// From this time on nothing was forgotten.
    complete_from: Stamp,
    /// Log time of the last message that was read.
    read_until: Option<Stamp>,
    /// Number of entities that were left out, because too many others existed.
    left_out: usize,
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
            let existing = store.versions.iter().filter(|version| version.exists_at(self.now));
            is_known.then(|| existing.map(|version| Arc::clone(&version.entity)).collect())
        });
        found.as_deref()
    }

    /// Number of entities of the topic that are nowhere shown, because too many others existed.
    pub fn left_out(&self) -> usize {
        self.store().left_out
    }

    fn store(&self) -> RwLockReadGuard<'_, Store> {
        self.store.read().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The entities of a topic as they are gathered.
#[derive(Default)]
struct Growing {
    store: Arc<RwLock<Store>>,
    /// The entities that nothing has replaced or deleted, by id: indices of versions.
    open: BTreeMap<String, usize>,
    bytes: usize,
}

impl Growing {
    fn add(&mut self, log_time: Stamp, update: &SceneUpdate) {
        let Self { store, open, bytes } = self;
        let mut store = store.write().unwrap_or_else(PoisonError::into_inner);
        let store = &mut *store;
        for deletion in &update.deletions {
            match deletion.r#type() {
                Deletion::All => {
                    for index in std::mem::take(open).into_values() {
                        store.versions[index].ended = log_time;
                    }
                }
                Deletion::MatchingId => {
                    if let Some(index) = open.remove(&deletion.id) {
                        store.versions[index].ended = log_time;
                    }
                }
            }
        }
        if open.len() + update.entities.len() > MOST_ENTITIES {
            open.retain(|_, index| store.versions[*index].entity.is_alive(log_time));
        }
        let mut has_forgotten = false;
        for entity in &update.entities {
            if let Some(index) = open.remove(&entity.id) {
                store.versions[index].ended = log_time;
            }
            let size = size(entity);
            if *bytes + size > MOST_BYTES && !std::mem::replace(&mut has_forgotten, true) {
                forget(store, open, log_time);
                *bytes = store.versions.iter().map(|version| version.size).sum();
            }
            if open.len() >= MOST_ENTITIES || *bytes + size > MOST_BYTES {
                store.left_out += 1;
                continue;
            }
            *bytes += size;
            open.insert(entity.id.clone(), store.versions.len());
            let entity = Arc::new(Entity::new(entity.clone(), log_time));
            store.versions.push(Version { entity, ended: Stamp::MAX, size });
        }
        store.read_until = Some(log_time);
    }

    /// What was known up to and including `time`.
    fn fork(&self, time: Stamp) -> Self {
        let from = self.store.read().unwrap_or_else(PoisonError::into_inner);
        let mut store = Store { complete_from: from.complete_from, ..Store::default() };
        let mut open = BTreeMap::new();
        for version in from.versions.iter().filter(|version| version.entity.from <= time) {
            let mut version = version.clone();
            if version.ended > time {
                version.ended = Stamp::MAX;
                open.insert(version.entity.content.id.clone(), store.versions.len());
            }
            store.versions.push(version);
        }
        store.read_until = from.read_until.map(|until| until.min(time));
        let bytes = store.versions.iter().map(|version| version.size).sum();
        Self { store: Arc::new(RwLock::new(store)), open, bytes }
    }
}

/// Forgets the half of the entities that ended first; nothing if so few have ended that it would come again at once.
fn forget(store: &mut Store, open: &mut BTreeMap<String, usize>, log_time: Stamp) {
    let ends = store.versions.iter().map(Version::end).filter(|end| *end <= log_time);
    let mut ends: Vec<Stamp> = ends.collect();
    if ends.len() < store.versions.len() / 8 || ends.is_empty() {
        return;
    }
    let middle = ends.len() / 2;
    let (_, cut, _) = ends.select_nth_unstable(middle);
    let cut = *cut;
    store.versions.retain(|version| version.end() > cut);
    store.complete_from = cut;
    let versions = store.versions.iter().enumerate().filter(|(_, version)| version.ended == Stamp::MAX);
    *open = versions.map(|(index, version)| (version.entity.content.id.clone(), index)).collect();
}

/// The entities of one run or recording, as they are gathered.
#[derive(Default)]
pub(crate) struct EntityWatch(BTreeMap<Arc<str>, Growing>);

impl Gathered for EntityWatch {
    fn takes(type_name: &str) -> bool {
        is_scene_type(type_name)
    }

    fn take(&mut self, topic: &Arc<str>, log_time: Stamp, message: &AnyMessage) {
        self.look(topic, log_time, message);
    }

    fn fork(&self, time: Stamp) -> Self {
        Self(self.0.iter().map(|(topic, growing)| (Arc::clone(topic), growing.fork(time))).collect())
    }
}

impl EntityWatch {
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
