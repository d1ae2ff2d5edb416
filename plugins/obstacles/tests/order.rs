//! `obstacles` on the bench: range data that come twice, late or in other axes than the mount, what is known after `INIT`,
//! obstacles beyond the cost map, and what the votes of clouds are worth.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use rcs_msg::foxglove::packed_element_field::NumericType;
use rcs_msg::foxglove::{
    self, CameraCalibration, FrameTransform, FrameTransforms, Grid, Odometry, PackedElementField, PointCloud,
    Quaternion, Vector3,
};
use rcs_msg::rcs::Command;
use rcs_msg::{AnyMessage, Stamp, schema_of};
use rcs_obstacles::Obstacles;
use rcs_obstacles::proto::ObstacleStats;
use rcs_runtime::{ExternalEvent, ProcessType};
use rcs_testkit::bench::{Bench, Setup, faults, newest, sent};
use rcs_testkit::logs::hand_made;
use rcs_world::GridView;

const STACK: &str = r#"
format = 1
name = "obstacles"

[[process]]
name = "obstacles"
plugin = "obstacles"
supervisor = "viewer"
period_ms = 50.0
inputs = { cloud = "/operator/cloud" }

[process.params]
pose = { source = "POSE_FIXED" }
mount = { fixed = true, height_m = 1.0 }
"#;

/// Flat ground 2 to 10 m ahead of a sensor 1 m above it.
fn cloud() -> PointCloud {
    cloud_of(ground(100))
}

/// Flat ground up to a wall so many metres ahead, 1.2 m high.
fn wall(ahead_m: i32) -> PointCloud {
    let x = ahead_m as f32 + 0.05;
    let of_wall = |y: i32| (0..24).map(move |z| [x, y as f32 * 0.02, z as f32 * 0.05 - 1.0]);
    cloud_of(ground(10 * ahead_m).chain((-100..100).flat_map(of_wall)))
}

/// Points of the ground each 0.1 m, from 2 m ahead.
fn ground(end: i32) -> impl Iterator<Item = [f32; 3]> {
    (20..end).flat_map(|x| (-20..20).map(move |y| [x as f32 * 0.1, y as f32 * 0.1, -1.0]))
}

fn cloud_of(places: impl Iterator<Item = [f32; 3]>) -> PointCloud {
    let data: Vec<u8> = places.flatten().flat_map(f32::to_le_bytes).collect();
    let fields = ["x", "y", "z"].iter().zip([0, 4, 8]).map(|(name, offset)| PackedElementField {
        name: (*name).to_owned(),
        offset,
        r#type: NumericType::Float32.into(),
    });
    PointCloud {
        frame_id: "lidar".to_owned(),
        point_stride: 12,
        fields: fields.collect(),
        data: data.into(),
        ..PointCloud::default()
    }
}

/// Gives a cloud of a time, and says how many cost maps have been sent since the start, and how many faults.
fn give(bench: &mut Bench, time_ms: u64) -> (u64, u64) {
    give_cloud(bench, time_ms, cloud())
}

fn give_cloud(bench: &mut Bench, time_ms: u64, cloud: PointCloud) -> (u64, u64) {
    let message = AnyMessage::new(cloud);
    bench
        .session
        .write(ExternalEvent::sensed("/operator/cloud", Stamp(time_ms * 1_000_000), message))
        .unwrap();
    bench.cycles(50, 2);
    (bench.sent("/obstacles/cost"), bench.faults("obstacles").0)
}

#[test]
fn a_cloud_that_comes_twice_or_late_is_a_fault_and_one_from_the_future_does_not_make_the_next_late() {
    let mut bench = Setup::new(STACK, &[ProcessType::of::<Obstacles>()]).bench();
    bench.advance(1_000);
    assert_eq!(give(&mut bench, 900), (1, 0));
    assert_eq!(give(&mut bench, 900), (1, 1), "it comes twice");
    assert_eq!(give(&mut bench, 850), (1, 2), "it comes late");
    assert!(bench.faults("obstacles").1.contains("0.050 s older than the one before"));
    assert_eq!(give(&mut bench, 950), (2, 2));
    assert_eq!(give(&mut bench, 3_600_000), (3, 2));
    assert_eq!(give(&mut bench, 1_000), (4, 2));
}

#[test]
fn clouds_whose_clock_begins_again_are_used_from_the_second_one_on() {
    let mut bench = Setup::new(STACK, &[ProcessType::of::<Obstacles>()]).bench();
    bench.advance(20_000);
    assert_eq!(give(&mut bench, 19_900), (1, 0));
    assert_eq!(give(&mut bench, 1_000), (1, 1), "it may be late");
    assert_eq!(give(&mut bench, 1_100), (2, 2));
    let why = "the clock of the clouds has begun again; ground and obstacles seen before are forgotten";
    assert_eq!(bench.faults("obstacles").1, why);
    assert_eq!(give(&mut bench, 1_200), (3, 2));
}

#[test]
fn obstacles_that_were_seen_before_the_local_frame_began_again_are_forgotten() {
    let stack = STACK
        .replace("pose = { source = \"POSE_FIXED\" }", "positive_frames = 2\nsure_range_m = 0.0")
        .replace("/operator/cloud\" }", "/operator/cloud\", odometry = \"/operator/odometry\" }");
    let mut bench = Setup::new(&stack, &[ProcessType::of::<Obstacles>()]).bench();
    bench.advance(1_000);
    // Whether the wall is reported by a vehicle that is this far east, m.
    let mut is_seen = |x_m: f64| {
        let position = Some(Vector3 { x: x_m, ..Vector3::default() });
        let orientation = Some(Quaternion { w: 1.0, ..Quaternion::default() });
        let pose = Some(foxglove::Pose { position, orientation });
        let odometry = Odometry { frame_id: "local".to_owned(), pose, ..Odometry::default() };
        bench.write("/operator/odometry", odometry);
        let now_ms = bench.now_ms;
        give_cloud(&mut bench, now_ms, wall(5));
        bench.latest::<ObstacleStats>("/obstacles/stats").obstacle_cells > 0
    };
    assert_eq!([is_seen(0.0), is_seen(0.0)], [false, true], "in the second frame");
    assert_eq!([is_seen(8.0), is_seen(8.0)], [false, true], "it is elsewhere");
    assert_eq!([is_seen(0.0), is_seen(0.0)], [false, true]);
    let why = "the pose in the local frame leapt by 8.0 m; ground and obstacles seen before are forgotten";
    assert_eq!(bench.faults("obstacles"), (2, why.to_owned()));
}

#[test]
fn an_obstacle_beyond_the_cost_map_keeps_its_label_however_many_frames_an_obstacle_needs() {
    // Number of points of a wall that are labelled as an obstacle, in three frames.
    let labelled = |ahead_m: i32, positive_frames: u32| {
        let frames = format!("[process.params]\npositive_frames = {positive_frames}\nsure_range_m = 0.0");
        let stack = STACK.replace("[process.params]", &frames);
        let mut bench = Setup::new(&stack, &[ProcessType::of::<Obstacles>()]).bench();
        bench.advance(1_000);
        [1_000, 1_100, 1_200].map(|time_ms| {
            give_cloud(&mut bench, time_ms, wall(ahead_m));
            bench.latest::<ObstacleStats>("/obstacles/stats").obstacle
        })
    };
    assert_eq!(labelled(5, 3)[..2], [0, 0], "the map has it");
    let far = labelled(25, 3);
    assert_eq!(far, labelled(25, 1), "the map ends 20 m ahead");
    assert!(far[0] > 1_000, "{far:?}");
}

#[test]
fn a_cloud_by_a_clock_that_is_ahead_is_placed_by_poses_by_the_clock_of_the_run() {
    let stack = STACK
        .replace("pose = { source = \"POSE_FIXED\" }", "")
        .replace("/operator/cloud\" }", "/operator/cloud\", odometry = \"/operator/odometry\" }");
    let mut bench = Setup::new(&stack, &[ProcessType::of::<Obstacles>()]).bench();
    bench.advance(1_000);
    for given in 1..=3 {
        let orientation = Some(Quaternion { w: 1.0, ..Quaternion::default() });
        let pose = Some(foxglove::Pose { position: Some(Vector3::default()), orientation });
        let odometry = Odometry { frame_id: "local".to_owned(), pose, ..Odometry::default() };
        bench.write("/operator/odometry", odometry);
        assert_eq!(give(&mut bench, 29_000 + 100 * given), (given, 0), "{}", bench.faults("obstacles").1);
    }
}

/// A frame this far above another one, m.
fn placed(parent: &str, child: &str, z: f64) -> FrameTransforms {
    let transform = FrameTransform {
        parent_frame_id: parent.to_owned(),
        child_frame_id: child.to_owned(),
        translation: Some(Vector3 { x: 0.0, y: 0.0, z }),
        rotation: Some(Quaternion { w: 1.0, ..Quaternion::default() }),
        ..FrameTransform::default()
    };
    FrameTransforms { transforms: vec![transform] }
}

#[test]
fn the_static_transforms_of_several_messages_of_a_log_are_all_known() {
    let stack = STACK
        .replace("mount = { fixed = true, height_m = 1.0 }", "mount = { fixed = false }")
        .replace("/operator/cloud\" }", "/cloud\", static_transforms = \"/static\" }")
        .replace(
            "format = 1",
            "format = 1\ninput = [{ buffer = \"/cloud\", topic = \"/cloud\" }, \
             { buffer = \"/static\", topic = \"/tf_static\" }]",
        );
    let topics = [("/tf_static", schema_of::<FrameTransforms>()), ("/cloud", schema_of::<PointCloud>())];
    let [mast, lidar] = [placed("vehicle", "mast", 0.4), placed("mast", "lidar", 0.6)].map(AnyMessage::new);
    let cloud = AnyMessage::new(cloud());
    let messages = [(1_000, "/tf_static", &mast), (1_010, "/tf_static", &lidar), (1_200, "/cloud", &cloud)];
    let timed = messages.map(|(ms, topic, message)| (Stamp(ms * 1_000_000), topic, message));
    let log = hand_made(&topics, timed);
    let mut run = Setup::new(&stack, &[ProcessType::of::<Obstacles>()]).stepped(Some(&log));
    run.run_until(Stamp(1_500_000_000)).unwrap();
    assert_eq!(faults(&run, "obstacles"), (0, String::new()));
    assert_eq!(sent(&run, "/obstacles/cost"), 1);
    let known: FrameTransforms = newest(&run, "/static").unwrap();
    let known: Vec<&str> = known.transforms.iter().map(|known| known.child_frame_id.as_str()).collect();
    assert_eq!(known, ["mast", "lidar"], "after INIT, only the newest message is read again");
}

#[test]
fn after_init_the_static_transforms_that_were_sent_once_are_still_known() {
    let stack = STACK
        .replace("mount = { fixed = true, height_m = 1.0 }", "mount = { fixed = false }")
        .replace("/operator/cloud\" }", "/operator/cloud\", static_transforms = \"/operator/static\" }");
    let mut bench = Setup::new(&stack, &[ProcessType::of::<Obstacles>()]).bench();
    bench.write("/operator/static", placed("vehicle", "lidar", 1.0));
    bench.advance(1_000);
    assert_eq!(give(&mut bench, 900), (1, 0));
    for (serial, name) in [(2, "INIT"), (3, "RUN")] {
        bench.write("/obstacles/command", Command { serial, name: name.to_owned(), ..Command::default() });
        bench.cycles(50, 2);
    }
    assert_eq!(give(&mut bench, 1_100), (2, 0), "{}", bench.faults("obstacles").1);
}

#[test]
fn the_votes_of_clouds_do_not_have_the_noise_of_the_stereo_camera_beside_them() {
    let stack = STACK
        .replace("[process.params]", "[process.params]\nbaseline_m = 0.1")
        .replace("/operator/cloud\" }", "/operator/cloud\", calibration = \"/operator/calibration\" }");
    let worths = |has_camera: bool| -> Vec<f64> {
        let mut bench = Setup::new(&stack, &[ProcessType::of::<Obstacles>()]).bench();
        if has_camera {
            let calibration = CameraCalibration {
                width: 320,
                height: 240,
                k: vec![250.0, 0.0, 159.5, 0.0, 250.0, 119.5, 0.0, 0.0, 1.0],
                ..CameraCalibration::default()
            };
            bench.write("/operator/calibration", calibration);
        }
        bench.advance(1_000);
        assert_eq!(give(&mut bench, 900), (1, 0), "{}", bench.faults("obstacles").1);
        let grid: Grid = bench.latest("/obstacles/cost");
        let view = GridView::new(&grid).unwrap();
        view.field("worth.stereo").unwrap().values().collect()
    };
    let expected = worths(false);
    assert!(expected.iter().any(|&worth| worth > 0.0));
    assert_eq!(worths(true), expected);
}

#[test]
fn a_cloud_of_an_optical_frame_is_a_fault_with_a_mount() {
    let mut bench = Setup::new(STACK, &[ProcessType::of::<Obstacles>()]).bench();
    bench.advance(1_000);
    let optical = PointCloud { frame_id: "camera_depth_optical_frame".to_owned(), ..cloud() };
    assert_eq!(give_cloud(&mut bench, 900, optical), (0, 1));
    let fault = bench.faults("obstacles").1;
    assert!(fault.contains("frame \"camera_depth_optical_frame\" is optical"), "{fault}");
    assert_eq!(give(&mut bench, 950), (1, 1));
}
