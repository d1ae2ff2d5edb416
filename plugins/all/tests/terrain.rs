//! The processes `terrain_learner` and `classifier` on hand-made messages: unusable ones are reported, counted and
//! skipped without output; usable ones are learned, and the next image is classified by them.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use rcs_geom::{DVec2, DVec3, PinholeCamera, Pose};
use rcs_msg::foxglove::{CameraCalibration, Grid, PoseInFrame, RawImage};
use rcs_msg::rcs::Bumper;
use rcs_msg::{AnyMessage, Payload, Stamp, schema_of, to_json};
use rcs_plugins::all;
use rcs_runtime::{RunOptions, Snapshot, Stepped};
use rcs_terrain::proto::{ClassifierStats, TerrainModels, TerrainStats};
use rcs_testkit::bench::{Setup, faults, newest, sent};
use rcs_testkit::logs::hand_made;
use std::sync::Arc;

const MOUNT: &str = "mount = { fixed = true, height_m = 1.0, pitch_deg = 12.0 }";

fn stack(learner: &str) -> String {
    let input = |name: &str| format!("{{ buffer = \"/{name}\", topic = \"{name}\" }},\n");
    let inputs: String = TOPICS.iter().map(|(name, _)| input(name)).collect();
    let camera = |side: &str, topic: &str| {
        format!(
            "{side}_image = \"/{topic}image\", {side}_labels = \"/{topic}labels\", {side}_depth = \"/{topic}depth\", {side}_calibration = \"/calibration\", "
        )
    };
    let (left, right) = (camera("left", ""), camera("right", "right_"));
    format!(
        "format = 1\nname = \"terrain\"\ninput = [\n{inputs}]\n\n\
         [[process]]\nname = \"terrain\"\nplugin = \"terrain_learner\"\nsupervisor = \"viewer\"\nperiod_ms = 100.0\n\
         inputs = {{ {left}{right}bumper = \"/bumper\", pose = \"/pose\" }}\n\
         params = {{ min_points = 40, merge_distance = 0.05, {learner}, {MOUNT} }}\n\n\
         [[process]]\nname = \"classifier\"\nplugin = \"classifier\"\nsupervisor = \"viewer\"\nperiod_ms = 100.0\n\
         inputs = {{ image = \"/image\", calibration = \"/calibration\", models = \"/terrain/models\", pose = \"/pose\" }}\n\
         params = {{ window_px = 8, pose = {{ max_age_s = 2.0 }}, {MOUNT} }}\n"
    )
}

/// Gives the schema of a topic.
type SchemaOf = fn() -> Arc<rcs_msg::Schema>;

/// Names of the log's topics, with their schemas.
const TOPICS: [(&str, SchemaOf); 9] = [
    ("image", || schema_of::<RawImage>().clone()),
    ("labels", || schema_of::<RawImage>().clone()),
    ("depth", || schema_of::<RawImage>().clone()),
    ("right_image", || schema_of::<RawImage>().clone()),
    ("right_labels", || schema_of::<RawImage>().clone()),
    ("right_depth", || schema_of::<RawImage>().clone()),
    ("calibration", || schema_of::<CameraCalibration>().clone()),
    ("pose", || schema_of::<PoseInFrame>().clone()),
    ("bumper", || schema_of::<Bumper>().clone()),
];

/// A message for a topic at a time in ms.
type Given = (u64, &'static str, AnyMessage);

const SIZE: [u32; 2] = [96, 72];

fn image(ms: u64, encoding: &str, bytes: u32, data: Vec<u8>) -> RawImage {
    RawImage {
        timestamp: Some(Stamp(ms * 1_000_000).to_proto()),
        frame_id: "camera".to_owned(),
        width: SIZE[0],
        height: SIZE[1],
        encoding: encoding.to_owned(),
        step: SIZE[0] * bytes,
        data: data.into(),
    }
}

fn calibration() -> CameraCalibration {
    let camera = PinholeCamera::from_horizontal_fov(SIZE, 1.0).unwrap();
    CameraCalibration {
        frame_id: "camera".to_owned(),
        width: SIZE[0],
        height: SIZE[1],
        distortion_model: "plumb_bob".to_owned(),
        d: vec![0.0; 5],
        k: vec![camera.fx, 0.0, camera.cx, 0.0, camera.fy, camera.cy, 0.0, 0.0, 1.0],
        ..CameraCalibration::default()
    }
}

/// Green ground before a brown wall 4 m ahead: image, labels, depth.
fn scene(ms: u64) -> [RawImage; 3] {
    let camera = PinholeCamera::from_horizontal_fov(SIZE, 1.0).unwrap();
    let mount = Pose::from_rpy(DVec3::new(0.0, 0.0, 1.0), 0.0, 12.0_f64.to_radians(), 0.0);
    let (mut rgb, mut labels, mut depth) = (Vec::new(), Vec::new(), Vec::new());
    let mut noise = ms as u32 | 1;
    for y in 0..SIZE[1] {
        for x in 0..SIZE[0] {
            noise = noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let light = (noise >> 28) as u8;
            let pixel = camera.unproject(DVec2::new(f64::from(x), f64::from(y))).unwrap();
            let ray = (mount * Pose::body_from_optical()).rotate(pixel);
            let (to_wall, to_ground) = (4.0 / ray.x, -1.0 / ray.z);
            let is_ground = to_ground > 0.0 && to_ground < to_wall;
            let is_wall = !is_ground && (1.0 + ray.z * to_wall) < 2.0;
            let (color, label, metres) = match (is_ground, is_wall) {
                (true, _) => ([60, 110 + light, 40], 1, to_ground),
                (_, true) => ([130 + light / 2, 85, 60], 2, to_wall),
                _ => ([180, 200, 240], 0, f64::NAN),
            };
            rgb.extend(color);
            labels.push(label);
            depth.extend((metres as f32).to_le_bytes());
        }
    }
    [image(ms, "rgb8", 3, rgb), image(ms, "mono8", 1, labels), image(ms, "32FC1", 4, depth)]
}

fn pose(ms: u64, x_m: f64) -> Given {
    let pose = Some(rcs_sense::pose_message(&Pose::from_xy_yaw(x_m, 0.0, 0.0)));
    let timestamp = Some(Stamp(ms * 1_000_000).to_proto());
    (ms, "pose", AnyMessage::new(PoseInFrame { timestamp, frame_id: "local".to_owned(), pose }))
}

/// A frame of the left camera, modified by the caller.
fn frame(ms: u64, change: impl Fn(&mut [RawImage; 3])) -> Vec<Given> {
    let mut images = scene(ms);
    change(&mut images);
    let names = ["image", "labels", "depth"];
    names.into_iter().zip(images).map(|(name, image)| (ms, name, AnyMessage::new(image))).collect()
}

/// Poses of a vehicle that drives east at this speed.
fn drive(speed_mps: f64, until_ms: u64) -> Vec<Given> {
    (0..until_ms / 100).map(|i| pose(i * 100 + 1, speed_mps * i as f64 * 0.1)).collect()
}

struct Replay(Stepped);

impl Replay {
    fn new(learner: &str, mut given: Vec<Given>, options: RunOptions) -> Replay {
        given.push((0, "calibration", AnyMessage::new(calibration())));
        given.sort_by_key(|(ms, ..)| *ms);
        let schemas = TOPICS.map(|(topic, schema)| (topic, schema()));
        let topics = schemas.each_ref().map(|(topic, schema)| (*topic, schema));
        let timed =
            given.iter().map(|(ms, topic, message)| (Stamp(ms * 1_000_000 + 1_000_000), *topic, message));
        let log = hand_made(&topics, timed);
        Replay(Setup::new(&stack(learner), all()).options(options).stepped(Some(&log)))
    }

    fn until(&mut self, ms: u64) {
        self.0.run_until(Stamp(ms * 1_000_000)).unwrap();
    }

    fn latest<T: Payload>(&self, buffer: &str) -> T {
        newest(&self.0, buffer).unwrap()
    }

    fn faults(&self, process: &str) -> (u64, String) {
        faults(&self.0, process)
    }

    fn sent(&self, buffers: &[&str]) -> u64 {
        buffers.iter().map(|name| sent(&self.0, name)).sum()
    }
}

const LEARNS: &str = "learn_while_standing = true, pose = { source = \"POSE_FIXED\" }";

#[test]
fn what_is_learned_from_range_classifies_the_next_image() {
    let given = [frame(100, |_| {}), frame(500, |_| {}), drive(0.0, 1000)].concat();
    let mut replay = Replay::new(LEARNS, given, RunOptions::default());
    replay.until(900);
    assert_eq!(replay.faults("terrain"), (0, String::new()));
    assert_eq!(replay.faults("classifier"), (0, String::new()));
    let stats: TerrainStats = replay.latest("/terrain/stats");
    assert!(stats.learned && stats.ground > 1000 && stats.obstacle > 1000 && stats.models >= 2, "{stats:?}");
    let grid: Grid = replay.latest("/terrain/cost");
    assert_eq!((grid.frame_id.as_str(), grid.fields[0].name.as_str()), ("local", "cost.terrain"));
    let stats: ClassifierStats = replay.latest("/classifier/stats");
    assert!(stats.traversable > 10 && stats.not_traversable > 10, "{stats:?}");
    let classes: RawImage = replay.latest("/classifier/classes");
    let [_, labels, _] = scene(500);
    let (mut right, mut wrong) = (0, 0);
    for (&label, &class) in labels.data.iter().zip(classes.data.iter()) {
        right += usize::from(label != 0 && label == class);
        wrong += usize::from(label != 0 && class != 0 && label != class);
    }
    // Windows of eight pixels straddle the base of the wall.
    assert!(wrong * 20 < right, "{wrong} wrong, {right} right");
    let grid: Grid = replay.latest("/classifier/cost");
    assert_eq!(grid.cell_size.unwrap().x, 0.2);
    let has = |range: std::ops::RangeInclusive<u8>| grid.data.iter().any(|cost| range.contains(cost));
    assert!(has(0..=20) && has(230..=250));
}

#[test]
fn frames_that_cannot_be_used_are_skipped_and_what_comes_after_them_is_used() {
    type Change = fn(&mut [RawImage; 3]);
    let cases: [(Change, &str); 8] = [
        (|images| images[0] = RawImage { width: 48, step: 144, ..images[0].clone() }, "calibration is for"),
        (|images| images[0].data = vec![2; images[0].data.len()].into(), "image is 100 % black"),
        (|images| images[0].data = vec![255; images[0].data.len()].into(), "100 % saturated"),
        (|images| images[0].data = scene(100)[0].data.clone(), "frozen"),
        (|images| images[1] = RawImage { width: 48, step: 48, ..images[1].clone() }, "its image is for"),
        (|images| images[1].encoding = "rgb8".to_owned(), "expected mono8"),
        (|images| images[1].timestamp = Some(Stamp(45_000_000).to_proto()), "is not newer"),
        (|images| images[2].encoding = "mono8".to_owned(), "depth"),
    ];
    for (change, why) in cases {
        let given = [frame(100, |_| {}), frame(500, change), frame(900, |_| {})].concat();
        let mut replay = Replay::new(LEARNS, given, RunOptions::default());
        replay.until(450);
        let outputs = ["/terrain/cost", "/terrain/models", "/terrain/learned_left", "/terrain/stats"];
        let sent = replay.sent(&outputs);
        assert_eq!(sent, 4, "{why}");
        replay.until(850);
        let (faults, last) = replay.faults("terrain");
        assert!(faults == 1 && last.contains(why), "got {faults} faults, {last:?}, expected {why:?}");
        assert_eq!(replay.sent(&outputs), sent, "nothing goes out: {why}");
        replay.until(1200);
        assert_eq!(replay.faults("terrain").0, 1, "{why}");
        assert!(replay.sent(&outputs) >= sent + 3, "{why}");
    }
}

#[test]
fn labels_whose_image_is_missing_or_of_another_time_are_skipped() {
    let mut given = [frame(100, |_| {}), drive(0.0, 1000)].concat();
    given.extend(frame(500, |_| {}).into_iter().filter(|(_, topic, _)| *topic != "image"));
    let mut replay = Replay::new(LEARNS, given, RunOptions::default());
    replay.until(900);
    let (faults, last) = replay.faults("terrain");
    assert!(faults == 1 && last.contains("no image of the time of the labels"), "{last}");
    // The classifier has no new image, and sends no old result again.
    assert_eq!(replay.sent(&["/classifier/classes"]), 1);
}

#[test]
fn nothing_is_learned_while_the_vehicle_stands_or_turns() {
    let turning = |ms: u64| -> Given {
        let pose = Pose::from_xy_yaw(0.1 * ms as f64 * 1e-2, 0.0, 0.5 * ms as f64 * 1e-3);
        let timestamp = Some(Stamp(ms * 1_000_000).to_proto());
        let pose = Some(rcs_sense::pose_message(&pose));
        (ms, "pose", AnyMessage::new(PoseInFrame { timestamp, frame_id: "local".to_owned(), pose }))
    };
    let turn: Vec<Given> = (0..12).map(|i| turning(i * 100 + 1)).collect();
    for (poses, learned) in [(drive(0.0, 1200), false), (turn, false), (drive(1.0, 1200), true)] {
        let given = [frame(801, |_| {}), poses].concat();
        let mut replay = Replay::new("pose = { max_age_s = 0.5 }", given, RunOptions::default());
        replay.until(1100);
        assert_eq!(replay.faults("terrain"), (0, String::new()));
        let stats: TerrainStats = replay.latest("/terrain/stats");
        assert_eq!((stats.learned, stats.ground > 0), (learned, learned), "{stats:?}");
    }
}

#[test]
fn a_hit_of_the_bumper_is_learned_once_until_it_is_released() {
    let bumper = |ms: u64, left: bool| -> Given {
        (
            ms,
            "bumper",
            AnyMessage::new(Bumper { timestamp: Some(Stamp(ms * 1_000_000).to_proto()), left, right: false }),
        )
    };
    let hits = vec![bumper(300, true), bumper(400, true), bumper(500, false), bumper(600, true)];
    let given = [frame(100, |_| {}), hits].concat();
    let mut replay = Replay::new(LEARNS, given, RunOptions::default());
    replay.until(250);
    let before = replay.sent(&["/terrain/cost"]);
    // Cells are stated with cost, confidence and backing.
    let dear = |replay: &Replay| {
        let grid: Grid = replay.latest("/terrain/cost");
        grid.data.chunks_exact(3).filter(|cell| cell[0] == 250).count()
    };
    let seen = dear(&replay);
    replay.until(450);
    assert_eq!(replay.sent(&["/terrain/cost"]), before + 1, "one change for two messages");
    // Half of the bumper is 0.3 m wide; what it hits lies up to 0.2 m ahead, where the camera sees nothing.
    let hit = dear(&replay) - seen;
    assert!((1..=4).contains(&hit), "{hit} cells");
    replay.until(900);
    assert_eq!(replay.faults("terrain"), (0, String::new()));
}

#[test]
fn an_camera_that_falls_behind_is_reported_once() {
    let lefts: Vec<Given> = (0..6).flat_map(|i| frame(100 + i * 400, |_| {})).collect();
    let right: Vec<Given> = ["right_image", "right_labels", "right_depth"]
        .into_iter()
        .zip(scene(100))
        .map(|(topic, image)| (100, topic, AnyMessage::new(image)))
        .collect();
    let both = format!("{LEARNS}, cameras = \"TERRAIN_SEPARATE\"");
    // The mount in the parameters is the left camera's; the right one has none, which is a separate fault.
    let mut replay = Replay::new(&both, [lefts, right].concat(), RunOptions::default());
    replay.until(900);
    let before = replay.faults("terrain").0;
    replay.until(2600);
    let (faults, last) = replay.faults("terrain");
    assert_eq!(faults, before + 1, "{last}");
    assert!(last.contains("right camera is") && last.contains("behind the left one"), "{last}");
}

#[test]
fn threads_and_snapshots_do_not_change_a_bit() {
    let given = || [(0..5).flat_map(|i| frame(500 + i * 300, |_| {})).collect(), drive(1.0, 2400)].concat();
    let replay = |threads: usize| {
        let options = RunOptions { threads, hash: true, ..RunOptions::default() };
        Replay::new("pose = { max_age_s = 0.5 }, driven_delay_s = 0.5", given(), options)
    };
    let mut one = replay(1);
    one.until(2300);
    let expected = one.0.summary().hash.unwrap();
    let stats: TerrainStats = one.latest("/terrain/stats");
    assert!(stats.models >= 2 && stats.driven > 0, "{stats:?}");
    let mut two = replay(2);
    two.until(1350);
    let saved = two.0.snapshot().to_bytes().unwrap();
    two.until(2300);
    assert_eq!(two.0.summary().hash.unwrap(), expected, "two threads");
    two.0.restore(&Snapshot::from_bytes(&saved).unwrap()).unwrap();
    two.until(2300);
    assert_eq!(two.0.summary().hash.unwrap(), expected, "from a snapshot");
}

#[test]
fn models_of_a_file_are_checked_before_anything_runs_and_classify_without_a_learner() {
    let mut replay = Replay::new(LEARNS, frame(100, |_| {}), RunOptions::default());
    replay.until(400);
    let models: TerrainModels = replay.latest("/terrain/models");
    let text = to_json(&AnyMessage::new(models)).unwrap();
    let types = all();
    let kind = types.iter().find(|kind| kind.def().plugin == "classifier").unwrap();
    assert_eq!(kind.params_schema().name(), "rcs.ClassifierParams");
    let params = |models: String| rcs_terrain::proto::ClassifierParams { models, ..Default::default() };
    let check = <rcs_terrain::Classifier as rcs_runtime::Process>::check;
    assert_eq!(check(&params(text.clone())), Ok(()));
    assert!(check(&params(text.replace("redGreen", "redGrean"))).is_err());
    assert!(check(&params("{".to_owned())).unwrap_err().starts_with("models: "));
}
