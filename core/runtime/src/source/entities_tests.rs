//! Tests of the entities of scenes.

#![allow(clippy::unwrap_used, reason = "a test may fail")]

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
fn what_has_not_been_read_yet_is_not_known() {
    let watch = watch([(1, adds(&[("a", 0)]))]);
    assert_eq!(at(&watch, 3, 1), known(&[("a", 1)]));
    assert_eq!(at(&watch, 3, 2), None, "the newest message has not been read");
}

#[test]
fn a_run_that_branches_begins_with_the_entities_of_its_moment() {
    let parent =
        watch([(1, adds(&[("a", 0), ("b", 0)])), (3, adds(&[("a", 0)])), (4, deletes(Deletion::All, ""))]);
    let mut child = parent.fork(Stamp(2 * S));
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
        let points = vec![Point3::default(); 100_000];
        let lines = vec![LinePrimitive { points, ..LinePrimitive::default() }];
        let content = SceneEntity { lines, ..entity(if id.is_multiple_of(2) { "even" } else { "odd" }, 0) };
        SceneUpdate { entities: vec![content], ..SceneUpdate::default() }
    };
    let watch = watch((1..100).map(|second| (second, big(second))));
    let all = watch.read(RunTag::Recorded, Stamp(0)).next().unwrap();
    let bytes: usize = all.store().versions.iter().map(|version| version.size).sum();
    assert!(bytes <= MOST_BYTES && all.left_out() == 0, "{bytes}");
    for second in [90_u64, 99] {
        let expect =
            [second - 1, second].map(|from| (if from.is_multiple_of(2) { "even" } else { "odd" }, from));
        assert_eq!(at(&watch, second, second), known(&expect));
    }
    assert_eq!(at(&watch, 5, 5), None, "forgotten");
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
