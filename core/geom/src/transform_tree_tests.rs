use glam::DVec3;
use proptest::prelude::*;

use super::*;

fn translated(x: f64) -> Pose {
    Pose::from_translation(DVec3::new(x, 0.0, 0.0))
}

/// global ─ local ─ vehicle ┬ left
///                          └ right          and, apart, island ─ hut
fn tree() -> TransformTree {
    let mut tree = TransformTree::new();
    tree.set_static("vehicle", "left", Pose::from_rpy(DVec3::new(0.3, 0.1, 1.0), 0.0, 0.2, 0.4)).unwrap();
    tree.set_static("vehicle", "right", Pose::from_rpy(DVec3::new(0.3, -0.1, 1.0), 0.0, 0.2, -0.4)).unwrap();
    tree.insert("local", "vehicle", 1000, Pose::from_xy_yaw(0.0, 0.0, 0.0)).unwrap();
    tree.insert("local", "vehicle", 2000, Pose::from_xy_yaw(2.0, 0.0, 1.0)).unwrap();
    tree.insert("global", "local", 1500, translated(100.0)).unwrap();
    tree.set_static("island", "hut", translated(1.0)).unwrap();
    tree
}

fn near(a: &Pose, b: &Pose) -> bool {
    a.translation.abs_diff_eq(b.translation, 1e-12)
        && a.rotation_matrix().abs_diff_eq(b.rotation_matrix(), 1e-12)
}

#[test]
fn lookup_composes_the_edges_and_interpolates_between_neighbours() {
    let tree = tree();
    let expected =
        translated(100.0) * Pose::from_xy_yaw(1.0, 0.0, 0.5) * tree.lookup("vehicle", "left", 0).unwrap();
    assert!(near(&tree.lookup("global", "left", 1500).unwrap(), &expected));
    assert!(near(&tree.lookup("left", "global", 1500).unwrap(), &expected.inverse()));
}

#[test]
fn a_frame_is_in_itself_at_any_time() {
    assert_eq!(tree().lookup("vehicle", "vehicle", 9_999_999), Ok(Pose::IDENTITY));
    assert_eq!(tree().lookup("global", "global", 0), Ok(Pose::IDENTITY));
}

#[test]
fn static_way_below_a_timed_edge_is_valid_at_all_times() {
    let tree = tree();
    assert!(tree.lookup("left", "right", 0).is_ok());
    assert!(tree.lookup("left", "right", u64::MAX).is_ok());
    assert_eq!(tree.newest("left", "right"), Ok(None));
    assert_eq!(tree.newest("global", "left"), Ok(Some(1500)));
    assert_eq!(tree.newest("local", "left"), Ok(Some(2000)));
}

#[test]
fn the_newest_sample_until_a_time_is_not_later_than_it() {
    let tree = tree();
    let newest = |target, source, time| tree.newest_until(target, source, time);
    for (asked, found) in [(1000, 1000), (1999, 1000), (2000, 2000), (u64::MAX, 2000)] {
        assert_eq!(newest("local", "left", asked), Ok(Some(found)), "{asked}");
    }
    assert_eq!(
        [1500, 1999, 9000].map(|time| newest("global", "left", time)),
        [Ok(Some(1000)), Ok(Some(1000)), Ok(Some(1500))]
    );
    assert_eq!(newest("left", "right", 0), Ok(None));
    assert!(matches!(newest("local", "left", 999), Err(TransformError::OutsideData { time_ns: 999, .. })));
    assert!(matches!(newest("moon", "left", 0), Err(TransformError::UnknownFrame { .. })));
}

#[test]
fn outside_of_the_data_the_nearer_end_is_used() {
    let tree = tree();
    for (asked, used) in [(0, 1000), (999, 1000), (1200, 1200), (2001, 2000), (u64::MAX, 2000)] {
        let expected = tree.lookup("local", "left", used).unwrap();
        assert_eq!(tree.lookup_nearest("local", "left", asked), Ok(expected), "{asked}");
    }
    // One sample above counts at all times, and does not restrict the way to its time.
    for asked in [1200, 1500, 1900] {
        let expected = translated(100.0) * tree.lookup("local", "left", asked).unwrap();
        assert!(near(&tree.lookup_nearest("global", "left", asked).unwrap(), &expected), "{asked}");
    }
    assert_eq!(tree.lookup_nearest("left", "right", 0), tree.lookup("left", "right", 7));
    assert!(matches!(tree.lookup_nearest("moon", "left", 0), Err(TransformError::UnknownFrame { .. })));
    let mut apart = TransformTree::new();
    apart.insert("a", "b", 0, translated(1.0)).unwrap();
    apart.insert("b", "c", 9, translated(1.0)).unwrap();
    assert_eq!(apart.lookup_nearest("a", "c", 5), Ok(translated(2.0)), "no common time is needed");
}

#[test]
fn errors_say_what_is_missing() {
    let tree = tree();
    let error = |target, source, time| tree.lookup(target, source, time).unwrap_err().to_string();
    assert_eq!(error("moon", "left", 0), "frame \"moon\" is unknown");
    assert_eq!(
        error("hut", "left", 0),
        "frames \"hut\" and \"left\" are not connected: roots are \"island\" and \"global\""
    );
    let outside = "no transform from \"vehicle\" to \"local\" at 999 ns: data reach from 1000 to 2000 ns";
    assert_eq!(error("local", "left", 999), outside);
    assert!(matches!(tree.lookup("local", "left", 2001), Err(TransformError::OutsideData { .. })));
}

#[test]
fn a_second_parent_a_cycle_and_nan_are_refused_and_change_nothing() {
    let mut tree = tree();
    assert!(matches!(
        tree.insert("global", "vehicle", 0, translated(0.0)),
        Err(TransformError::TwoParents { .. })
    ));
    assert!(matches!(tree.set_static("left", "global", translated(0.0)), Err(TransformError::Cycle { .. })));
    assert!(matches!(tree.set_static("a", "a", translated(0.0)), Err(TransformError::Cycle { .. })));
    assert!(matches!(
        tree.insert("local", "vehicle", 0, translated(f64::NAN)),
        Err(TransformError::NotFinite { .. })
    ));
    assert_eq!(tree.frames(), ["global", "hut", "island", "left", "local", "right", "vehicle"]);
}

#[test]
fn history_forgets_what_is_too_old_to_interpolate_from() {
    let mut tree = TransformTree::with_history_ns(100);
    for time in (0..=1000).step_by(30) {
        tree.insert("local", "vehicle", time, translated(time as f64)).unwrap();
    }
    // The newest sample is at 990: every time from 890 on must still have an answer.
    assert!(near(&tree.lookup("local", "vehicle", 890).unwrap(), &translated(890.0)));
    assert!(tree.lookup("local", "vehicle", 869).is_err());
}

#[test]
fn a_sample_from_the_future_is_forgotten_when_the_next_one_arrives_that_is_not() {
    let mut tree = TransformTree::with_history_ns(1000);
    let mut insert = |time: u64, now: u64| {
        tree.insert_as_of("local", "vehicle", time, translated(time as f64), now).unwrap();
        tree.newest("local", "vehicle").unwrap()
    };
    assert_eq!(insert(10, 20), Some(10));
    // A clock that is always ahead forgets nothing.
    assert_eq!([insert(500, 30), insert(400, 40)], [Some(500); 2]);
    assert_eq!(insert(50, 50), Some(50));
    assert_eq!(insert(40, 60), Some(50), "a late one is not from the future");
    assert!(near(&tree.lookup("local", "vehicle", 45).unwrap(), &translated(45.0)));
    assert!(near(&tree.lookup("local", "vehicle", 10).unwrap(), &translated(10.0)));
}

#[test]
fn samples_of_a_clock_that_begins_again_are_kept_and_two_late_ones_forget_nothing() {
    let mut tree = TransformTree::with_history_ns(10);
    let mut now = 1000;
    let mut insert = |tree: &mut TransformTree, time: u64| {
        now += 1;
        tree.insert_as_of("local", "vehicle", time, translated(time as f64), now).unwrap();
    };
    let is_at = |tree: &TransformTree, time: u64| {
        near(&tree.lookup("local", "vehicle", time).unwrap(), &translated(time as f64))
    };
    for time in 480..=500 {
        insert(&mut tree, time);
    }
    for late in [100, 101] {
        insert(&mut tree, late);
        assert!(is_at(&tree, 495) && tree.newest("local", "vehicle") == Ok(Some(500 + late - 100)));
        insert(&mut tree, 401 + late);
    }
    // The same one twice does not count twice.
    for late in [100, 101, 101, 102] {
        insert(&mut tree, late);
        assert!(is_at(&tree, 495) && tree.newest("local", "vehicle") == Ok(Some(502)));
    }
    for time in [503, 1, 3, 5] {
        insert(&mut tree, time);
    }
    assert_eq!(tree.newest("local", "vehicle"), Ok(Some(5)));
    assert!([1, 2, 4, 5].into_iter().all(|time| is_at(&tree, time)));
}

#[test]
fn a_snapshot_is_not_changed_by_later_samples() {
    let mut tree = tree();
    let snapshot = tree.clone();
    tree.insert("local", "vehicle", 3000, translated(9.0)).unwrap();
    assert_eq!(snapshot.newest("local", "vehicle"), Ok(Some(2000)));
    assert_eq!(tree.newest("local", "vehicle"), Ok(Some(3000)));
}

proptest! {
    #[test]
    fn order_of_arrival_does_not_matter(times in prop::collection::vec(0..1000_u64, 2..20), query in 0..1000_u64) {
        let mut sorted = times.clone();
        sorted.sort_unstable();
        let (mut a, mut b) = (TransformTree::new(), TransformTree::new());
        for t in times { a.insert("local", "vehicle", t, translated(t as f64)).unwrap(); }
        for t in sorted { b.insert("local", "vehicle", t, translated(t as f64)).unwrap(); }
        prop_assert_eq!(a.lookup("local", "vehicle", query), b.lookup("local", "vehicle", query));
        if let Ok(pose) = a.lookup("local", "vehicle", query) {
            prop_assert!((pose.translation.x - query as f64).abs() < 1e-9);
        }
    }
}

#[test]
fn a_frame_that_becomes_the_root_leaves_all_poses_as_they_are() {
    let before = tree();
    let mut after = tree();
    after.make_root("vehicle");
    assert_eq!(
        ["vehicle", "local", "global"].map(|frame| after.parent(frame)),
        [None, Some("vehicle"), Some("local")]
    );
    for (target, source) in [("local", "left"), ("right", "local"), ("global", "left")] {
        for time in [1000, 2000] {
            let poses = [&before, &after].map(|tree| tree.lookup_nearest(target, source, time).unwrap());
            assert!(near(&poses[0], &poses[1]), "{target} {source} {time}");
        }
    }
    after.make_root("vehicle");
    after.make_root("moon");
    assert_eq!(after.frames(), before.frames());
}

#[test]
fn what_another_tree_says_of_frames_without_a_transform_is_taken() {
    let mut tree = TransformTree::new();
    tree.set_static("vehicle", "camera", Pose::from_translation(DVec3::Z)).unwrap();
    let mut other = TransformTree::new();
    other.insert("local", "vehicle", 5, Pose::from_translation(DVec3::X)).unwrap();
    other.insert("elsewhere", "camera", 5, Pose::IDENTITY).unwrap();
    tree.take_missing(&other);
    assert_eq!(tree.parent("camera"), Some("vehicle"), "what is known stays");
    let local_from_camera = tree.lookup("local", "camera", 5).unwrap();
    assert_eq!(local_from_camera.translation, DVec3::new(1.0, 0.0, 1.0));
    let mut loops = TransformTree::new();
    loops.set_static("camera", "local", Pose::IDENTITY).unwrap();
    tree.take_missing(&loops);
    assert_eq!(tree.parent("local"), None, "a loop is not closed");
}

#[test]
fn static_transforms_and_those_that_were_sent_once_last() {
    let lasting = tree().lasting();
    assert_eq!(lasting.frames(), ["global", "hut", "island", "left", "local", "right", "vehicle"]);
    assert_eq!(lasting.parent("vehicle"), None, "it moves");
    assert_eq!(lasting.lookup("global", "local", 9_999), Ok(translated(100.0)));
    assert_eq!(lasting.lookup("left", "right", 0), tree().lookup("left", "right", 0));
}
