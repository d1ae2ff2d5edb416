//! What a camera is expected to see of the world model: obstacles from foot to top, and a path on the ground.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use rcs_geom::{DVec2, DVec3, PinholeCamera, Pose};
use rcs_msg::Stamp;
use rcs_msg::foxglove::points_annotation::Type;
use rcs_msg::foxglove::{
    CameraCalibration, Grid, ImageAnnotations, PointsAnnotation, PoseInFrame, PosesInFrame, RawImage,
};
use rcs_msg::rcs::Command;
use rcs_runtime::ProcessType;
use rcs_sense::pose_message;
use rcs_testkit::bench::{Bench, Setup};
use rcs_world::{HeightStats, Map, MapOptions, Source, Sources, VoteRule, Weights};
use rcs_world_model::Prediction;

const STACK: &str = r#"
format = 1
name = "prediction"

[[process]]
name = "prediction"
plugin = "prediction"
supervisor = "viewer"
inputs = { image = "/operator/image", calibration = "/operator/calibration", map = "/operator/map", path = "/operator/path", pose = "/operator/pose" }
params = { mount = { fixed = true, height_m = 1.0, pitch_deg = 15.0 }, range_m = 10.0 }
"#;

const SIZE: [u32; 2] = [320, 240];
const POSE: [f64; 3] = [12.0, -7.0, 0.7];

fn vehicle() -> Pose {
    Pose::from_xy_yaw(POSE[0], POSE[1], POSE[2])
}

fn calibration() -> CameraCalibration {
    CameraCalibration {
        width: SIZE[0],
        height: SIZE[1],
        distortion_model: "plumb_bob".to_owned(),
        d: vec![0.0; 5],
        k: vec![200.0, 0.0, 159.5, 0.0, 200.0, 119.5, 0.0, 0.0, 1.0],
        ..CameraCalibration::default()
    }
}

/// Where the camera sees a place of the vehicle frame, pixels of the message.
fn pixel(place: DVec3) -> DVec2 {
    let camera = PinholeCamera::from_calibration(SIZE, &calibration().k, "plumb_bob", &[0.0; 5]).unwrap();
    let mount =
        Pose::from_rpy(DVec3::new(0.0, 0.0, 1.0), 0.0, 15_f64.to_radians(), 0.0) * Pose::body_from_optical();
    camera.project(mount.inverse() * place).unwrap() + 0.5
}

/// A map with obstacles of these heights at places of the vehicle frame, m; and their cells' middles in it.
fn map_with(obstacles: &[(DVec2, f32)], time: Stamp) -> (Grid, Vec<DVec3>) {
    let mut map = Map::new(0.2).unwrap();
    map.recentre(vehicle().translation.truncate()).unwrap();
    let mut middles = Vec::new();
    for &(place, height_m) in obstacles {
        let index = map.grid().cell_at((vehicle() * place.extend(0.0)).truncate()).unwrap();
        map.vote(index, Source::STEREO, 250, 1, time, VoteRule::default());
        let mut heights = HeightStats::default();
        (0..9).for_each(|_| heights.add(height_m));
        if height_m > 0.0 {
            let cell = map.cell_mut(index).unwrap();
            cell.observe_heights(&HeightStats::default(), &heights, 0.2, time, VoteRule::default());
        }
        middles.push(vehicle().inverse() * map.grid().middle_of(index).extend(0.0));
    }
    let sources: Sources = [Source::STEREO].into_iter().collect();
    let options = MapOptions { sources, heights: true, weights: Weights::default() };
    (map.to_grid("local", time, &options), middles)
}

fn bench(map: Grid) -> Bench {
    let mut bench = Setup::new(STACK, &[ProcessType::of::<Prediction>()]).bench();
    let path = [1.0, 3.0, 5.0, -2.0].map(|x| Pose::from_xy_yaw(x, 0.0, 0.0));
    bench.write("/operator/calibration", calibration());
    bench.write("/operator/map", map);
    bench.write(
        "/operator/path",
        PosesInFrame {
            frame_id: "local".to_owned(),
            poses: path.iter().map(|at| pose_message(&(vehicle() * *at))).collect(),
            ..PosesInFrame::default()
        },
    );
    bench.write("/operator/pose", pose());
    bench
}

fn pose() -> PoseInFrame {
    let pose = Some(pose_message(&vehicle()));
    PoseInFrame { frame_id: "local".to_owned(), pose, ..PoseInFrame::default() }
}

fn image() -> RawImage {
    RawImage { frame_id: "camera".to_owned(), width: SIZE[0], height: SIZE[1], ..RawImage::default() }
}

fn of(predicted: &ImageAnnotations, kind: Type) -> Vec<&PointsAnnotation> {
    predicted.points.iter().filter(|lines| lines.r#type() == kind).collect()
}

fn near(point: &rcs_msg::foxglove::Point2, expected: DVec2) -> bool {
    DVec2::new(point.x, point.y).distance(expected) < 0.05
}

#[test]
fn obstacles_stand_from_foot_to_top_where_the_camera_sees_them() {
    // In view with a height and without one, beyond the range, behind the camera, beside its view.
    let places = [(4.0, 0.5, 1.2), (5.0, -1.0, 0.0), (11.0, 0.0, 1.0), (-3.0, 0.0, 1.0), (2.0, 6.0, 1.0)];
    let places = places.map(|(x, y, height_m)| (DVec2::new(x, y), height_m));
    let (map, middles) = map_with(&places, Stamp(1));
    let mut bench = bench(map);
    bench.write("/operator/image", image());
    bench.cycles(50, 2);
    assert_eq!(bench.faults("prediction"), (0, String::new()));
    let predicted: ImageAnnotations = bench.latest("/prediction/predicted");
    let [lines] = of(&predicted, Type::LineList)[..] else { panic!("one list of lines") };
    let mut expected =
        vec![[middles[0], middles[0] + 1.2 * DVec3::Z], [middles[1], middles[1] + 0.1 * DVec3::Z]];
    assert_eq!(lines.points.len(), 4, "two obstacles are in view");
    for ends in lines.points.as_chunks::<2>().0 {
        let at = expected
            .iter()
            .position(|[foot, top]| near(&ends[0], pixel(*foot)) && near(&ends[1], pixel(*top)));
        expected.remove(at.unwrap_or_else(|| panic!("{ends:?} is none of {expected:?}")));
    }
}

#[test]
fn a_path_is_seen_where_it_lies_before_the_camera() {
    let mut bench = bench(map_with(&[], Stamp(1)).0);
    bench.write("/operator/image", image());
    bench.cycles(50, 2);
    let predicted: ImageAnnotations = bench.latest("/prediction/predicted");
    let parts = of(&predicted, Type::LineStrip);
    assert_eq!(parts.len(), 1, "what is behind the camera is cut off");
    let has = |x: f64| parts[0].points.iter().any(|point| near(point, pixel(DVec3::new(x, 0.0, 0.0))));
    assert!([1.0, 2.0, 3.0, 4.0, 5.0].into_iter().all(has), "{:?}", parts[0].points);
    assert!(of(&predicted, Type::LineList).is_empty());
}

#[test]
fn nothing_is_predicted_of_an_old_map_and_path_or_in_another_frame() {
    let mut old = bench(map_with(&[(DVec2::new(4.0, 0.5), 1.0)], Stamp(1)).0);
    old.cycles(50, 40);
    old.write("/operator/pose", pose());
    old.write("/operator/image", image());
    old.cycles(50, 2);
    assert_eq!(old.faults("prediction"), (0, String::new()));
    let predicted: ImageAnnotations = old.latest("/prediction/predicted");
    assert!(predicted.points.is_empty(), "{predicted:?}");

    let mut elsewhere = map_with(&[(DVec2::new(4.0, 0.5), 1.0)], Stamp(1)).0;
    elsewhere.frame_id = "map".to_owned();
    let mut bench = bench(elsewhere);
    bench.write("/operator/image", image());
    bench.cycles(50, 2);
    let (faults, why) = bench.faults("prediction");
    assert!(faults == 1 && why.contains("map is in the frame \"map\", expected \"local\""), "{faults} {why}");
    assert_eq!(bench.sent("/prediction/predicted"), 0);
}

#[test]
fn after_init_the_calibration_that_was_sent_once_is_still_known() {
    let mut bench = bench(map_with(&[], Stamp(1)).0);
    bench.cycles(50, 2);
    for (serial, name) in [(2, "INIT"), (3, "RUN")] {
        bench.write("/prediction/command", Command { serial, name: name.to_owned(), ..Command::default() });
        bench.cycles(50, 2);
    }
    bench.write("/operator/pose", pose());
    bench.write("/operator/image", image());
    bench.cycles(50, 2);
    assert_eq!(bench.faults("prediction"), (0, String::new()));
    let predicted: ImageAnnotations = bench.latest("/prediction/predicted");
    assert_eq!(of(&predicted, Type::LineStrip).len(), 1);
}
