//! Tests of tracks and transforms of a log.

use super::*;
use foxglove::{
    FrameTransform, FrameTransforms, KeyValuePair, LocationFix, Odometry, PoseInFrame, Quaternion, Vector3,
};

pub(in crate::source) const S: u64 = 1_000_000_000;
pub(in crate::source) const T0: u64 = 1_700_000_000 * S;
pub(in crate::source) const UPRIGHT: Quaternion = Quaternion { x: 0.0, y: 0.0, z: 0.0, w: 1.0 };
const UNSET: Quaternion = Quaternion { x: 0.0, y: 0.0, z: 0.0, w: 0.0 };

fn at(x: f64) -> Vector3 {
    Vector3 { x, y: 0.0, z: 0.0 }
}

pub(in crate::source) fn pose(x: f64, orientation: Quaternion) -> foxglove::Pose {
    foxglove::Pose { position: Some(at(x)), orientation: Some(orientation) }
}

pub(in crate::source) fn transform(parent: &str, child: &str, stamp_ns: u64, x: f64) -> AnyMessage {
    let transform = FrameTransform {
        timestamp: Some(Stamp(stamp_ns).to_proto()),
        parent_frame_id: parent.into(),
        child_frame_id: child.into(),
        translation: Some(at(x)),
        rotation: Some(UPRIGHT),
    };
    AnyMessage::new(FrameTransforms { transforms: vec![transform] })
}

fn odometry(stamp_ns: u64, x: f64, orientation: Quaternion) -> AnyMessage {
    AnyMessage::new(Odometry {
        timestamp: Some(Stamp(stamp_ns).to_proto()),
        frame_id: "/odom".into(),
        body_frame_id: "base".into(),
        pose: Some(pose(x, orientation)),
        ..Odometry::default()
    })
}

fn tracks(messages: impl IntoIterator<Item = (u64, &'static str, AnyMessage)>) -> Tracks {
    let mut tracks = Tracks::default();
    for (log_ns, topic, message) in messages {
        let topic: Arc<str> = topic.into();
        tracks.add(&topic, Stamp(log_ns), &message, false);
    }
    tracks
}

/// Where `base` is in `odom` at a log time.
fn x_at(tracks: &Tracks, log_ns: u64) -> f64 {
    let at = tracks.clock().at(Stamp(log_ns));
    tracks.tree().lookup_nearest("odom", "base", at.0).unwrap().translation.x
}

#[test]
fn transforms_with_another_clock_are_found_by_the_time_of_the_log() {
    for offset_ns in [T0 - 100 * S, 7200 * S, 0] {
        let message = |i: u64| transform("odom", "base", T0 + i * S - offset_ns, i as f64);
        let tracks = tracks((0..60).map(|i| (T0 + i * S, "/tf", message(i))));
        for i in [0, 20, 59] {
            assert_eq!(x_at(&tracks, T0 + i * S), i as f64, "{offset_ns} ns");
        }
        assert_eq!(x_at(&tracks, T0 - 5 * S), 0.0, "before the first one: the first one");
    }
    let only_odometry = tracks((0..60).map(|i| (T0 + i * S, "/odom", odometry(i * S, i as f64, UPRIGHT))));
    assert_eq!(x_at(&only_odometry, T0 + 20 * S), 20.0);
}

#[test]
fn a_transform_without_a_stamp_counts_with_its_log_time() {
    let all = tracks((0..60).map(|i| (T0 + i * S, "/tf", transform("odom", "base", 0, i as f64))));
    assert_eq!(x_at(&all, T0 + 20 * S), 20.0);
    // A simulation that begins at 0.
    let message = |i: u64| transform("odom", "base", i * S, i as f64);
    let simulated = tracks((0..60).map(|i| (i * S + 5, "/tf", message(i))));
    assert_eq!(simulated.tree().lookup("odom", "base", 0).unwrap().translation.x, 0.0);
}

#[test]
fn a_frame_is_the_same_with_and_without_a_slash_at_its_start() {
    let messages = [
        (1, "/tf", transform("/odom", "base", 1, 1.0)),
        (1, "/tf", transform("map", "odom", 1, 10.0)),
        (1, "/odometry", odometry(1, 0.0, UPRIGHT)),
    ];
    let tracks = tracks(messages);
    assert_eq!(tracks.tree().lookup("map", "base", 1).unwrap().translation.x, 11.0);
    assert_eq!(tracks.tree().frames(), ["base", "map", "odom"]);
    assert_eq!(tracks.read(RunTag::Recorded).next().unwrap().frame_id.as_ref(), "odom");
    assert_eq!(["/a/b", "a", "", "//a"].map(frame_name), ["a/b", "a", "", "/a"]);
}

#[test]
fn an_orientation_that_was_never_set_leaves_a_position_without_heading() {
    let stamped =
        PoseInFrame { frame_id: "odom".into(), pose: Some(pose(2.0, UNSET)), ..PoseInFrame::default() };
    for message in [odometry(1, 2.0, UNSET), AnyMessage::new(stamped)] {
        let place = Place::of(&message).unwrap();
        assert_eq!(place.position, Position::Local(DVec3::new(2.0, 0.0, 0.0)));
        assert!(place.yaw_rad.is_nan());
    }
    assert_eq!(Place::of(&odometry(1, f64::NAN, UNSET)), None);
    assert_eq!(Place::of(&odometry(1, 2.0, UPRIGHT)).unwrap().yaw_rad, 0.0);
    // It does not say how the body lies, so that nothing is placed by it.
    assert!(tracks([(1, "/odometry", odometry(1, 2.0, UNSET))]).tree().is_empty());
}

#[test]
fn a_receiver_without_a_fix_is_nowhere() {
    let fix = |status: &str, latitude: f64| {
        let metadata = vec![KeyValuePair { key: "status".into(), value: status.into() }];
        AnyMessage::new(LocationFix { latitude, metadata, ..LocationFix::default() })
    };
    for status in ["-1", "-2"] {
        assert_eq!(Place::of(&fix(status, 0.0)), None, "{status}");
    }
    let fixes = [("-2", 0.0), ("-1", 0.0), ("0", 48.0), ("2", 48.0)];
    let tracks = tracks((1..).zip(fixes).map(|(i, (status, latitude))| (i, "/fix", fix(status, latitude))));
    let track = tracks.read(RunTag::Recorded).next().unwrap();
    assert_eq!(track.points.len(), 2);
    let first = track.points.get(0).unwrap().position_m;
    assert!(first.iter().all(|v| v.abs() < 1e-6), "the first fix is the origin: {first:?}");
}

#[test]
fn a_fix_without_altitude_is_as_high_as_the_one_before_it() {
    let fix =
        |altitude: f64| AnyMessage::new(LocationFix { latitude: 48.0, altitude, ..LocationFix::default() });
    let altitudes = [f64::NAN, 500.0, f64::NAN, 510.0, f64::NAN];
    let tracks = tracks((1..).zip(altitudes).map(|(i, altitude)| (i, "/fix", fix(altitude))));
    let track = tracks.read(RunTag::Recorded).next().unwrap();
    assert_eq!(track.points.len(), 5);
    let check = |index: usize, height_m: f64| {
        let of_point = track.points.get(index).unwrap().position_m[2];
        // What views show of the message itself.
        let newest = fix(altitudes[index]);
        let of_message = track.metres(&Place::of(&newest).unwrap().position, Stamp(index as u64 + 1)).z;
        for z in [of_point, of_message] {
            assert!((z - height_m).abs() < 1e-6, "point {index}: {z}, expected {height_m}");
        }
    };
    // The origin has the first altitude that is stated.
    assert_eq!(track.origin.unwrap().origin().altitude_m, 500.0);
    for (index, height_m) in [0.0, 0.0, 0.0, 10.0, 10.0].into_iter().enumerate() {
        check(index, height_m);
    }
}

#[test]
fn a_branch_has_the_positions_that_were_written_before_it_and_no_others() {
    let topic: Arc<str> = "/odometry".into();
    let mut parent = Tracks::default();
    for messages in 1..=3_u64 {
        let time = messages * S;
        let position = odometry(time, messages as f64, UPRIGHT);
        parent.take(&topic, Written { time: Stamp(time), messages }, &position);
    }
    let xs = |tracks: &Tracks| {
        let points = tracks.read(RunTag::FIRST).next().unwrap().points;
        (0..points.len()).map(|index| points.get(index).unwrap().position_m[0]).collect::<Vec<_>>()
    };
    // The run branches at 2 s, before the position of then.
    let mut branch = parent.fork(Written { time: Stamp(2 * S), messages: 1 });
    assert_eq!(xs(&branch), [1.0]);
    let at = Written { time: Stamp(2 * S), messages: 2 };
    branch.take(&topic, at, &odometry(2 * S, 40.0, UPRIGHT));
    assert_eq!(xs(&branch), [1.0, 40.0]);
    assert_eq!(xs(&branch.fork(at)), [1.0, 40.0]);
    assert_eq!(xs(&parent), [1.0, 2.0, 3.0]);
}

#[test]
fn two_topics_that_move_one_frame_are_told_once() {
    let one = tracks((1..9).map(|i| (i, "/tf", transform("odom", "base", i, i as f64))));
    assert!(one.doubts().is_empty());
    let messages = (1..9)
        .flat_map(|i| ["/r1/tf", "/r2/tf"].map(|topic| (i, topic, transform("odom", "base", i, i as f64))));
    let two = tracks(messages);
    assert_eq!(two.doubts(), ["odom→base comes from /r1/tf and /r2/tf: their transforms are mixed"]);
}

#[test]
fn a_transform_that_is_refused_is_told_once_with_the_reason() {
    let messages = (1..9).flat_map(|i| {
        let transforms = [("map", "base"), ("odom", "base"), ("a", "b"), ("b", "a")];
        transforms.map(|(parent, child)| (i, "/tf", transform(parent, child, i, 1.0)))
    });
    let doubts = [
        "/tf: frame \"base\" already has parent \"map\", got \"odom\"; skipped",
        "/tf: frame \"a\" cannot hang under \"b\", which hangs under it; skipped",
    ];
    let tracks = tracks(messages);
    assert_eq!(tracks.doubts(), doubts);
    assert_eq!(tracks.tree().parent("base"), Some("map"));
}

#[test]
fn of_many_refused_transforms_some_are_told_and_that_there_are_more() {
    let (mut tracks, topic): (_, Arc<str>) = (Tracks::default(), "/tf".into());
    for object in 0..10_000 {
        let transform = FrameTransform {
            parent_frame_id: "map".into(),
            child_frame_id: format!("object_{object}"),
            translation: Some(at(1.0)),
            rotation: Some(UNSET),
            ..FrameTransform::default()
        };
        tracks.add(&topic, Stamp(1), &AnyMessage::new(transform), false);
    }
    assert_eq!((tracks.doubts().len(), tracks.refused.len()), (MOST_REFUSED + 1, MOST_REFUSED + 1));
    assert_eq!(tracks.doubts()[MOST_REFUSED], "further transforms were refused; skipped");
}

#[test]
fn a_static_transform_without_a_valid_rotation_is_told() {
    let refused = |rotation: Option<Quaternion>| {
        let transform = FrameTransform {
            parent_frame_id: "base".into(),
            child_frame_id: "laser".into(),
            translation: Some(at(1.0)),
            rotation,
            ..FrameTransform::default()
        };
        let (mut tracks, topic): (_, Arc<str>) = (Tracks::default(), "/tf_static".into());
        for _ in 0..2 {
            tracks.add(&topic, Stamp(1), &AnyMessage::new(transform.clone()), true);
        }
        tracks.doubts().to_vec()
    };
    let of = "/tf_static: transform from \"laser\" to \"base\"";
    assert_eq!(refused(None), [format!("{of} lacks translation or rotation; skipped")]);
    assert_eq!(refused(Some(UNSET)), [format!("{of}: rotation has norm 0, expected about 1; skipped")]);
    assert!(refused(Some(UPRIGHT)).is_empty());
}
