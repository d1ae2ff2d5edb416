//! Tests of the entities of scenes.

use super::*;
use rcs_msg::foxglove::SceneEntityDeletion;

const S: u64 = 1_000_000_000;

fn entity(id: &str, lifetime_s: i64) -> SceneEntity {
    let lifetime = Some(Duration { seconds: lifetime_s, nanos: 0 });
    SceneEntity { id: id.to_owned(), lifetime, ..SceneEntity::default() }
}

fn deletion(kind: Deletion, id: &str) -> SceneEntityDeletion {
    SceneEntityDeletion { timestamp: None, r#type: kind.into(), id: id.to_owned() }
}

/// Gathers updates with their log times in seconds.
fn watch(updates: impl IntoIterator<Item = (u64, SceneUpdate)>) -> EntityWatch {
    let mut watch = EntityWatch::default();
    for (second, update) in updates {
        watch.look(&"/scene".into(), Stamp(second * S), &AnyMessage::new(update));
    }
    watch
}

fn adds(entities: &[(&str, i64)]) -> SceneUpdate {
    let entities = entities.iter().map(|(id, lifetime_s)| entity(id, *lifetime_s)).collect();
    SceneUpdate { entities, ..SceneUpdate::default() }
}

fn deletes(kind: Deletion, id: &str) -> SceneUpdate {
    SceneUpdate { deletions: vec![deletion(kind, id)], ..SceneUpdate::default() }
}

/// Id and time of the message of each entity that exists at a second; `None` where that is not known.
fn at(watch: &EntityWatch, second: u64, newest: u64) -> Option<Vec<(String, u64)>> {
    let all = watch.read(RunTag::Recorded, Stamp(second * S)).next().unwrap();
    let found = all.found(Stamp(newest * S))?.iter();
    Some(found.map(|entity| (entity.content.id.clone(), entity.from.0 / S)).collect())
}

#[allow(clippy::unnecessary_wraps, reason = "it is compared with an option")]
fn known(expect: &[(&str, u64)]) -> Option<Vec<(String, u64)>> {
    Some(expect.iter().map(|(id, from)| ((*id).to_owned(), *from)).collect())
}

#[test]
fn an_entity_exists_until_it_is_replaced_or_deleted_or_its_lifetime_has_passed() {
    let watch = watch([
        (1, adds(&[("a", 0), ("b", 0), ("short", 2)])),
        (2, adds(&[("a", 0), ("c", -1)])),
        (4, deletes(Deletion::MatchingId, "b")),
        (5, deletes(Deletion::MatchingId, "nobody")),
        (6, SceneUpdate { deletions: vec![deletion(Deletion::All, "")], ..adds(&[("d", 0)]) }),
    ]);
    // In any order.
    for (second, expect) in [
        (5, known(&[("a", 2), ("c", 2)])),
        (0, known(&[])),
        (1, known(&[("a", 1), ("b", 1), ("short", 1)])),
        (6, known(&[("d", 6)])),
        (2, known(&[("b", 1), ("short", 1), ("a", 2), ("c", 2)])),
        (3, known(&[("b", 1), ("a", 2), ("c", 2)])),
        (100, known(&[("d", 6)])),
    ] {
        assert_eq!(at(&watch, second, second.min(6)), expect, "at {second} s");
    }
}

#[test]
fn entities_of_a_namespace_are_deleted_and_those_of_one_that_begins_like_it_stay() {
    let ids = [("a/1", 0), ("a/b/1", 0), ("ab/1", 0), ("a", 0)];
    let namespace = SceneEntityDeletion { timestamp: None, r#type: DELETES_NAMESPACE, id: "a".to_owned() };
    let deletes = |entities| SceneUpdate { deletions: vec![namespace.clone()], ..entities };
    let again = deletes(adds(&[("a/3", 0)]));
    let watch = watch([(1, adds(&ids)), (2, deletes(adds(&[]))), (3, adds(&[("a/2", 0)])), (4, again)]);
    let stays = [("a/b/1", 1), ("ab/1", 1), ("a", 1)];
    // In any order.
    assert_eq!(at(&watch, 4, 4), known(&[&stays[..], &[("a/3", 4)]].concat()));
    assert_eq!(at(&watch, 2, 2), known(&stays));
    assert_eq!(at(&watch, 3, 3), known(&[&stays[..], &[("a/2", 3)]].concat()));
    assert_eq!(at(&watch, 1, 1), known(&ids.map(|(id, _)| (id, 1))));
}

#[test]
fn what_has_not_been_read_yet_is_not_known() {
    let watch = watch([(1, adds(&[("a", 0)]))]);
    assert_eq!(at(&watch, 3, 1), known(&[("a", 1)]));
    assert_eq!(at(&watch, 3, 2), None, "the newest message has not been read");
}

#[test]
fn a_run_that_branches_begins_with_the_entities_of_its_moment() {
    let parent =
        watch([(1, adds(&[("a", 0), ("b", 0)])), (3, adds(&[("a", 0)])), (4, deletes(Deletion::All, ""))]);
    let mut child = parent.fork(Written { time: Stamp(2 * S), messages: 1 });
    child.look(&"/scene".into(), Stamp(5 * S), &AnyMessage::new(adds(&[("b", 0)])));
    assert_eq!(at(&child, 4, 1), known(&[("a", 1), ("b", 1)]));
    assert_eq!(at(&child, 5, 5), known(&[("a", 1), ("b", 5)]));
    assert_eq!(at(&parent, 4, 4), known(&[]));
}

#[test]
fn where_there_are_too_many_entities_the_later_ones_are_left_out_and_counted() {
    let ids: Vec<String> = (0..MOST_ENTITIES + 10).map(|id| id.to_string()).collect();
    let many = |lifetime_s: i64| {
        let all: Vec<(&str, i64)> = ids.iter().map(|id| (id.as_str(), lifetime_s)).collect();
        adds(&all)
    };
    let forever = watch([(1, many(0)), (2, adds(&[("one more", 0)]))]);
    assert_eq!(at(&forever, 2, 2).unwrap().len(), MOST_ENTITIES);
    assert_eq!(forever.read(RunTag::Recorded, Stamp(0)).next().unwrap().left_out(), 11);
    // Those whose lifetime has passed make room.
    let short = watch([(1, many(1)), (3, adds(&[("one more", 0)]))]);
    assert_eq!(at(&short, 3, 3), known(&[("one more", 3)]));
}

#[test]
fn where_memory_ends_the_oldest_are_forgotten_and_the_newest_are_right() {
    let big = |id: u64| {
        let points = vec![Point3 { x: id as f64, ..Point3::default() }; 100_000];
        let lines = vec![LinePrimitive { points, ..LinePrimitive::default() }];
        let content = SceneEntity { lines, ..entity(if id.is_multiple_of(2) { "even" } else { "odd" }, 0) };
        SceneUpdate { entities: vec![content], ..SceneUpdate::default() }
    };
    let watch = watch((1..100).map(|second| (second, big(second))));
    let all = watch.read(RunTag::Recorded, Stamp(0)).next().unwrap();
    let bytes = bytes_of(&all.store().versions);
    assert!(bytes <= MOST_BYTES && all.left_out() == 0, "{bytes}");
    for second in [90_u64, 99] {
        let expect =
            [second - 1, second].map(|from| (if from.is_multiple_of(2) { "even" } else { "odd" }, from));
        assert_eq!(at(&watch, second, second), known(&expect));
    }
    assert_eq!(at(&watch, 5, 5), None, "forgotten");
}

/// Entities of ids that come only once, which live for a second. The content of each takes about so many bytes.
fn passing(second: u64, count: usize, bytes: usize) -> SceneUpdate {
    let entity =
        |index: usize| SceneEntity { frame_id: "f".repeat(bytes), ..entity(&format!("{second} {index}"), 1) };
    SceneUpdate { entities: (0..count).map(entity).collect(), ..SceneUpdate::default() }
}

#[test]
fn what_has_expired_takes_no_room_from_what_lives_after_something_was_forgotten() {
    // Memory is full about every fourth message, when more entities are kept than may exist at one moment.
    let watch = watch((0..12).map(|step| (2 * step, passing(2 * step, 11_000, 700))));
    let growing = &watch.0["/scene"];
    let store = read(&growing.store);
    assert!(store.complete_from > Stamp(0), "something was forgotten");
    assert_eq!(store.left_out, 0);
    let is_open = |index: &usize| store.versions.get(*index).is_some();
    assert!(growing.open.len() <= MOST_ENTITIES && growing.open.values().all(is_open));
    drop(store);
    assert_eq!(at(&watch, 22, 22).unwrap().len(), 11_000);
}

#[test]
fn a_look_up_finds_what_a_search_of_all_versions_finds() {
    let mut all = EntityWatch::default();
    for step in 0..600_u64 {
        let [a, b, c] = [5, 11, 301].map(|modulus| (step * 7 % modulus).to_string());
        let mut update = adds(&[(a.as_str(), 0), (b.as_str(), 3), (c.as_str(), 40)]);
        if step.is_multiple_of(97) {
            update.deletions.push(deletion(Deletion::All, ""));
        } else if step.is_multiple_of(13) {
            update.deletions.push(deletion(Deletion::MatchingId, &a));
        }
        all.look(&"/scene".into(), Stamp(step * S), &AnyMessage::new(update));
    }
    let mut growing = all.0.remove("/scene").unwrap();
    for forgets in [false, true] {
        if forgets {
            growing.forget(Stamp(600 * S));
        }
        let store = read(&growing.store);
        for at in (0..700).step_by(9).map(|second| Stamp(second * S)) {
            let exists = |version: &&Version| version.from <= at && at < version.end;
            let reference = store.versions.iter().filter(exists).map(|version| Arc::clone(&version.entity));
            assert_eq!(store.existing_at(at), reference.collect::<Vec<_>>(), "at {at}");
        }
        for (id, index) in &growing.open {
            assert_eq!(store.versions[*index].entity.content.id, *id);
        }
    }
}

#[test]
fn what_cannot_be_forgotten_is_not_looked_for_again_before_enough_has_ended() {
    // Nothing of this ends.
    let forever = |from: usize, count: usize| {
        let entities = (from..from + count)
            .map(|id| SceneEntity { frame_id: "f".repeat(6_000), ..entity(&id.to_string(), 0) });
        SceneUpdate { entities: entities.collect(), ..SceneUpdate::default() }
    };
    let mut all = watch([(1, forever(0, 12_000)), (2, forever(12_000, 1))]);
    let is_in_vain = |all: &EntityWatch| {
        let (from, count) = all.0["/scene"].in_vain;
        from == Stamp::MAX && count > 0
    };
    assert!(is_in_vain(&all));
    assert!(all.read(RunTag::Recorded, Stamp(0)).next().unwrap().left_out() > 1_000);
    all.look(&"/scene".into(), Stamp(3 * S), &AnyMessage::new(deletes(Deletion::All, "")));
    assert!(!is_in_vain(&all), "all of it has ended");
    all.look(&"/scene".into(), Stamp(4 * S), &AnyMessage::new(forever(0, 100)));
    assert_eq!(at(&all, 4, 4).unwrap().len(), 100);
}

#[test]
fn content_that_is_sent_again_is_kept_once() {
    let stamped = |second: u64, kind: &str| {
        let metadata = vec![rcs_msg::foxglove::KeyValuePair { key: kind.to_owned(), value: String::new() }];
        let timestamp = Some(Stamp(second * S).to_proto());
        SceneEntity { timestamp, metadata, ..entity("a", 0) }
    };
    let update = |entity: SceneEntity, deletes_all: bool| SceneUpdate {
        deletions: deletes_all.then(|| deletion(Deletion::All, "")).into_iter().collect(),
        entities: vec![entity],
    };
    let watch = watch([
        (1, update(stamped(1, "cube"), false)),
        (2, update(stamped(2, "cube"), false)),
        (3, update(stamped(3, "cube"), true)),
        (4, update(stamped(4, "sphere"), false)),
    ]);
    let store = read(&watch.0["/scene"].store);
    let entities: Vec<&Arc<Entity>> = store.versions.iter().map(|version| &version.entity).collect();
    let is_shared = |a: usize, b: usize| Arc::ptr_eq(&entities[a].content, &entities[b].content);
    assert_eq!([is_shared(0, 1), is_shared(1, 2), is_shared(2, 3)], [true, true, false]);
    let stamps: Vec<_> = entities.iter().map(|entity| entity.stamp.unwrap().0 / S).collect();
    assert_eq!(stamps, [1, 2, 3, 4]);
    assert_eq!(watch.0["/scene"].bytes, bytes_of(&store.versions));
    assert_eq!(watch.0["/scene"].bytes, 4 * EACH + size(&entities[0].content) + size(&entities[3].content));
}

#[test]
fn a_run_that_branches_where_its_parent_has_forgotten_knows_nothing_until_everything_is_deleted() {
    let parent = watch((0..12).map(|step| (2 * step, passing(2 * step, 11_000, 700))));
    let complete_from = read(&parent.0["/scene"].store).complete_from;
    assert!(complete_from > Stamp(3 * S));
    let mut child = parent.fork(Written { time: Stamp(3 * S), messages: 0 });
    child.look(&"/scene".into(), complete_from.after_ns(S), &AnyMessage::new(adds(&[("a", 0)])));
    let second = complete_from.0 / S;
    assert_eq!(at(&child, second + 2, second), None);
    let all = SceneUpdate { deletions: vec![deletion(Deletion::All, "")], ..adds(&[("b", 0)]) };
    child.look(&"/scene".into(), Stamp((second + 3) * S), &AnyMessage::new(all));
    assert_eq!(at(&child, second + 3, second + 3), known(&[("b", second + 3)]));
    assert_eq!(at(&parent.fork(Written { time: Stamp(23 * S), messages: 0 }), 23, 22), known(&[]));
}

#[test]
fn numbers_that_cannot_be_do_not_harm() {
    for (seconds, nanos) in [(i64::MAX, i32::MAX), (i64::MIN, i32::MIN), (0, -1), (0, 0)] {
        let lifetime = Some(Duration { seconds, nanos });
        let entity = Entity::new(SceneEntity { lifetime, ..SceneEntity::default() }, Stamp(5));
        assert_eq!(entity.expires, Stamp::MAX);
    }
    assert!(Entity::new(entity("", 0), Stamp(5)).is_alive(Stamp(5)));
}
