//! The process on synthetic images: what it learns and when, what it sends, and that unusable images are reported and
//! skipped without output.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use rand_chacha::ChaCha8Rng;
use rand_core::{RngCore, SeedableRng};
use rcs_color::ColorModelLearner;
use rcs_color::proto::{ColorLearning, ColorModels, ColorModelsParams, ColorStats};
use rcs_geom::{DVec2, DVec3, PinholeCamera, Pose};
use rcs_msg::foxglove::{CameraCalibration, Grid, ImageAnnotations, PoseInFrame, RawImage};
use rcs_msg::{AnyMessage, Payload, Stamp, rcs, schema_of, to_json};
use rcs_runtime::source::Task;
use rcs_runtime::{
    Asset, Assets, ExternalEvent, NoAssets, ProcessType, RunOptions, Session, Snapshot, Stepped,
};
use rcs_sense::pose_message;
use rcs_testkit::bench::{self, Setup, newest};
use rcs_testkit::logs::hand_made;
use rcs_world::{GridView, Map, MapOptions, NumericType, Source, VoteRule, Weights};

const STACK: &str = r#"
format = 1
name = "hand_made"
input = [
    { buffer = "/image", topic = "/image" },
    { buffer = "/calibration", topic = "/calibration" },
    { buffer = "/pose", topic = "/pose" },
    { buffer = "/map", topic = "/map" },
]

[[process]]
name = "color"
plugin = "color_models"
supervisor = "viewer"
period_ms = 20.0
inputs = { image = "/image", calibration = "/calibration", pose = "/pose", map = "/map" }
params = { mount = { fixed = true, height_m = 1.0, pitch_deg = 25.0 }, learning_period_s = 0.5 }
"#;

const PROCESSES: &[ProcessType] = &[ProcessType::of::<ColorModelLearner>()];
const OUTPUTS: [&str; 5] = ["probability", "sample", "cost", "models", "stats"];
const SIZE: [u32; 2] = [320, 240];
const MULCH: [u8; 3] = [120, 84, 58];
const LIME: [u8; 3] = [205, 200, 185];
const GRASS: [u8; 3] = [88, 122, 50];

struct Given {
    at_ms: u64,
    topic: &'static str,
    message: AnyMessage,
}

fn give<T: Payload>(at_ms: u64, topic: &'static str, value: T) -> Given {
    Given { at_ms, topic, message: AnyMessage::new(value) }
}

fn camera() -> PinholeCamera {
    PinholeCamera::from_calibration(SIZE, &calibration().k, "plumb_bob", &[0.0; 5]).unwrap()
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

fn raw(data: Vec<u8>) -> RawImage {
    RawImage {
        frame_id: "camera".to_owned(),
        width: SIZE[0],
        height: SIZE[1],
        encoding: "rgb8".to_owned(),
        step: 3 * SIZE[0],
        data: data.into(),
        ..RawImage::default()
    }
}

/// A path 1.6 m wide straight ahead through grass, below a sky; each seed gives other light and noise.
fn scene(path: [u8; 3], seed: u64) -> RawImage {
    let camera = camera();
    let mount =
        Pose::from_rpy(DVec3::new(0.0, 0.0, 1.0), 0.0, 25_f64.to_radians(), 0.0) * Pose::body_from_optical();
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut noise = |spread: f64| (f64::from(rng.next_u32()) / f64::from(u32::MAX) - 0.5) * 2.0 * spread;
    let mut data = Vec::new();
    for v in 0..SIZE[1] {
        for u in 0..SIZE[0] {
            let ray = mount.rotate(camera.unproject(DVec2::new(f64::from(u), f64::from(v))).unwrap());
            let base = match ray.z {
                z if z >= 0.0 => [170, 200, 235],
                z if (ray.y / -z).abs() < 0.8 => path,
                _ => GRASS,
            };
            let light = 1.0 + noise(0.25);
            data.extend(base.map(|v| (f64::from(v) * light + noise(5.0)).clamp(0.0, 255.0) as u8));
        }
    }
    raw(data)
}

fn pose(x_m: f64, yaw_rad: f64) -> PoseInFrame {
    let pose = Some(pose_message(&Pose::from_xy_yaw(x_m, 0.0, yaw_rad)));
    PoseInFrame { frame_id: "local".to_owned(), pose, ..PoseInFrame::default() }
}

/// A map with one obstacle 1.8 m ahead of a vehicle at this x.
fn blocked_map(x_m: f64) -> Grid {
    let mut map = Map::new(0.2).unwrap();
    let cell = map.grid().cell_at(DVec2::new(x_m + 1.8, 0.0)).unwrap();
    map.vote(cell, Source::STEREO, 250, 1, Stamp(1), VoteRule::default());
    let sources = [Source::STEREO].into_iter().collect();
    let options = MapOptions { sources, heights: true, weights: Weights::default() };
    Grid { timestamp: None, ..map.to_grid("local", Stamp(1), &options) }
}

/// An image every 200 ms, from a time on, of a vehicle that drives with this speed and turn rate.
fn drive(from_ms: u64, images: u64, path: [u8; 3], speed_mps: f64, turn_dps: f64) -> Vec<Given> {
    (0..images)
        .flat_map(|i| {
            let (at_ms, after_s) = (from_ms + 200 * i, 0.2 * i as f64);
            let yaw = (turn_dps * after_s).to_radians();
            [
                give(at_ms, "/pose", pose(speed_mps * after_s, yaw)),
                give(at_ms + 1, "/image", scene(path, at_ms)),
            ]
        })
        .collect()
}

/// Returns the same text for every file.
struct Shelf(String);

impl Assets for Shelf {
    fn read(&self, _kind: &str, name: &str, _beside: &str) -> Result<Asset, String> {
        Ok(Asset { file: name.to_owned(), text: self.0.clone() })
    }
}

fn begin(given: &[Given], threads: usize, params: &[(&str, &str)]) -> Stepped {
    begin_with(given, threads, params, &NoAssets)
}

/// Starts the stack on a log of these messages.
fn begin_with(given: &[Given], threads: usize, params: &[(&str, &str)], assets: &dyn Assets) -> Stepped {
    let topics = [
        ("/image", schema_of::<RawImage>()),
        ("/calibration", schema_of::<CameraCalibration>()),
        ("/pose", schema_of::<PoseInFrame>()),
        ("/map", schema_of::<Grid>()),
    ];
    let timed =
        given.iter().map(|given| (Stamp((1_000 + given.at_ms) * 1_000_000), given.topic, &given.message));
    let options = RunOptions { threads, hash: true, ..RunOptions::default() };
    let setup = Setup::new(STACK, PROCESSES).params(params).assets(assets).options(options);
    setup.stepped(Some(&hand_made(&topics, timed)))
}

fn until(run: &mut Stepped, at_ms: u64) {
    run.run_until(Stamp((1_000 + at_ms) * 1_000_000)).unwrap();
}

fn latest<T: Payload>(run: &Stepped, buffer: &str) -> T {
    newest(run, buffer).unwrap()
}

fn sent(run: &Stepped) -> u64 {
    OUTPUTS.iter().map(|name| bench::sent(run, &format!("/color/{name}"))).sum()
}

fn faults(run: &Stepped) -> (u64, String) {
    bench::faults(run, "color")
}

fn with_calibration(rest: impl IntoIterator<Item = Given>) -> Vec<Given> {
    [give(0, "/calibration", calibration())].into_iter().chain(rest).collect()
}

#[test]
fn on_a_path_the_path_is_cheap_and_the_grass_is_dear() {
    let mut run = begin(&with_calibration(drive(10, 10, MULCH, 1.0, 0.0)), 1, &[]);
    until(&mut run, 2_100);
    assert_eq!(faults(&run).0, 0, "{}", faults(&run).1);
    let stats: ColorStats = latest(&run, "/color/stats");
    assert_eq!((stats.learning(), stats.ground_models), (ColorLearning::ColorUpdated, 1));

    let grid: Grid = latest(&run, "/color/cost");
    assert_eq!((grid.frame_id.as_str(), grid.cell_size.unwrap().x), ("local", 0.2));
    let view = GridView::new(&grid).unwrap();
    let costs = view.field_of("cost.color", NumericType::Uint8).unwrap();
    let corner = view.frame_from_grid().translation.truncate();
    let at = |x: f64, y: f64| {
        let cell = (DVec2::new(x, y) - corner) / 0.2;
        costs.get(cell.x as usize, cell.y as usize).unwrap()
    };
    // The vehicle is at 1.8 m.
    for x in [4.5, 6.5, 8.5] {
        let (path, grass) = (at(x, 0.0), at(x, 1.7));
        assert!(path < 60.0 && grass > 190.0 && grass <= 250.0, "at {x}: {path} {grass}");
    }
    assert_eq!(at(0.5, 0.0), 255.0, "behind the camera's view");
    let overlay: RawImage = latest(&run, "/color/probability");
    assert_eq!((overlay.width, overlay.height, overlay.encoding.as_str()), (128, 96, "mono8"));
    let outline: ImageAnnotations = latest(&run, "/color/sample");
    assert_eq!(outline.points.len(), 1);
    let models: ColorModels = latest(&run, "/color/models");
    assert_eq!(
        models.models.iter().map(|model| model.name.as_str()).collect::<Vec<_>>(),
        ["learned 1", "background"]
    );
}

fn command_with<T: Payload>(session: &mut Session, serial: u64, name: &str, parameters: Option<T>) {
    let command = rcs::Command {
        serial,
        name: name.to_owned(),
        parameters_schema: parameters.iter().map(|_| schema_of::<T>().name()).collect(),
        parameters: parameters.map(|message| message.encode_to_vec().into()).unwrap_or_default(),
        ..rcs::Command::default()
    };
    session.write(ExternalEvent::operator("/color/command", AnyMessage::new(command))).unwrap();
}

fn command(session: &mut Session, serial: u64, name: &str) {
    command_with::<rcs::ModelToDelete>(session, serial, name, None);
}

#[test]
fn a_model_is_deleted_by_its_name_and_shows_what_it_was_made_from() {
    let mut session = Session::new(begin(&with_calibration(drive(10, 5, MULCH, 1.0, 0.0)), 1, &[])).unwrap();
    let names = |session: &mut Session, at_ms: u64| -> Vec<String> {
        session.forward_until(Stamp((1_000 + at_ms) * 1_000_000), &Task::default()).unwrap();
        let models: ColorModels = latest(session.run(), "/color/models");
        models.models.into_iter().map(|model| model.name).collect()
    };
    assert_eq!(names(&mut session, 600), ["learned 1", "background"]);
    let models: ColorModels = latest(session.run(), "/color/models");
    let sample = models.models[0].sample.as_ref().unwrap();
    assert_eq!((sample.frame_id.as_str(), sample.encoding.as_str()), ("camera", "rgb8"));
    let [red, green, blue] = [0, 1, 2].map(|channel| {
        let values = sample.data.iter().skip(channel).step_by(3);
        values.clone().map(|&value| f64::from(value)).sum::<f64>() / values.count() as f64
    });
    assert!((red - 120.0).abs() < 15.0 && (green - 84.0).abs() < 12.0 && (blue - 58.0).abs() < 9.0);
    assert_eq!(models.models[1].sample, None, "the background's pixels lie apart");

    let delete = |session: &mut Session, serial: u64, output: &str, number: u32, name: &str| {
        let (output, name) = (output.to_owned(), name.to_owned());
        let model = rcs::ModelToDelete { output, number, name };
        command_with(session, serial, "DELETE", Some(model));
    };
    let known = faults(session.run()).0;
    command(&mut session, 2, "LEARN_OFF");
    delete(&mut session, 3, "models", 1, "learned 1");
    assert_eq!(names(&mut session, 800), ["background"]);
    assert_eq!(faults(session.run()).0, known, "{}", faults(session.run()).1);
    delete(&mut session, 4, "models", 0, "learned 1");
    assert_eq!(names(&mut session, 840), ["background"]);
    let gone = "DELETE: there is no model \"learned 1\" any more; there are 1";
    assert_eq!(faults(session.run()), (known + 1, gone.to_owned()));
    delete(&mut session, 5, "sample", 0, "");
    assert_eq!(names(&mut session, 880), ["background"]);
    assert_eq!(faults(session.run()).1, "DELETE: there are no models of \"sample\"");
}

/// Drives on mulch, then on lime as given; returns what was done with the last sample and the number of ground models.
fn learning_on_lime(
    speed_mps: f64,
    turn_dps: f64,
    extra: Option<Given>,
    params: &[(&str, &str)],
) -> (ColorLearning, u32) {
    let mut given = with_calibration(drive(10, 5, MULCH, 1.0, 0.0));
    given.extend(extra);
    given.extend(drive(1_010, 8, LIME, speed_mps, turn_dps));
    let mut run = begin(&given, 1, params);
    until(&mut run, 2_600);
    let stats: ColorStats = latest(&run, "/color/stats");
    (stats.learning(), stats.ground_models)
}

#[test]
fn new_ground_is_learned_after_the_period_while_the_vehicle_drives_straight() {
    assert_eq!(learning_on_lime(1.0, 0.0, None, &[]), (ColorLearning::ColorUpdated, 2));
    assert_eq!(learning_on_lime(1.0, 9.0, None, &[]), (ColorLearning::ColorUpdated, 2), "below the limit");
}

#[test]
fn new_ground_is_learned_where_images_come_faster_than_poses() {
    let mut given = with_calibration(drive(10, 5, MULCH, 1.0, 0.0));
    // At 1 m/s, 20 images a second, of which every second one has the pose of the one before.
    given.extend((0..20_u32).flat_map(|image| {
        let at_ms = 1_010 + 50 * u64::from(image);
        let moved = image.is_multiple_of(2).then(|| give(at_ms, "/pose", pose(0.05 * f64::from(image), 0.0)));
        moved.into_iter().chain([give(at_ms + 1, "/image", scene(LIME, at_ms))])
    }));
    let mut run = begin(&given, 1, &[]);
    until(&mut run, 2_100);
    let stats: ColorStats = latest(&run, "/color/stats");
    assert_eq!((stats.learning(), stats.ground_models), (ColorLearning::ColorUpdated, 2));
}

#[test]
fn nothing_is_learned_while_the_vehicle_turns_fast() {
    assert_eq!(learning_on_lime(1.0, 11.0, None, &[]), (ColorLearning::ColorOffTurning, 1));
    assert_eq!(learning_on_lime(1.0, -40.0, None, &[]), (ColorLearning::ColorOffTurning, 1));
}

#[test]
fn nothing_is_learned_while_the_vehicle_stands() {
    assert_eq!(learning_on_lime(0.0, 0.0, None, &[]), (ColorLearning::ColorOffStanding, 1));
}

#[test]
fn nothing_is_learned_with_an_obstacle_of_the_map_in_the_sample() {
    let obstacle = || Some(give(1_005, "/map", blocked_map(0.0)));
    assert_eq!(learning_on_lime(0.1, 0.0, obstacle(), &[]), (ColorLearning::ColorOffObstacle, 1));
    // An old map is ignored.
    let old = [("color.map_max_age_s", "0.5")];
    assert_eq!(learning_on_lime(0.1, 0.0, obstacle(), &old), (ColorLearning::ColorUpdated, 2));
}

#[test]
fn the_operator_stops_learning_and_makes_it_forget() {
    let mut given = with_calibration(drive(10, 5, MULCH, 1.0, 0.0));
    given.extend(drive(1_010, 20, LIME, 1.0, 0.0));
    let run = begin(&given, 1, &[]);
    let mut session = Session::new(run).unwrap();
    let go = |session: &mut Session, at_ms: u64| {
        session.forward_until(Stamp((1_000 + at_ms) * 1_000_000), &Task::default()).unwrap();
        let stats: ColorStats = latest(session.run(), "/color/stats");
        (stats.learning(), stats.ground_models)
    };
    assert_eq!(go(&mut session, 900), (ColorLearning::ColorUpdated, 1));
    // The run started with the operator's RUN, whose serial was 1.
    command(&mut session, 2, "LEARN_OFF");
    assert_eq!(go(&mut session, 2_400), (ColorLearning::ColorOffCommand, 1));
    command(&mut session, 3, "LEARN_ON");
    assert_eq!(go(&mut session, 3_600), (ColorLearning::ColorUpdated, 2));
    command(&mut session, 4, "CLEAR");
    // The ground ahead becomes the first ground model again, and the only one.
    assert_eq!(go(&mut session, 3_900).1, 1);
}

#[test]
fn what_was_cleared_is_withdrawn_and_another_model_file_is_told_at_once() {
    let mut session = Session::new(begin(&with_calibration(drive(10, 5, MULCH, 1.0, 0.0)), 1, &[])).unwrap();
    let models = |session: &mut Session, at_ms: u64| -> ColorModels {
        session.forward_until(Stamp((1_000 + at_ms) * 1_000_000), &Task::default()).unwrap();
        latest(session.run(), "/color/models")
    };
    let learned = models(&mut session, 900);
    assert_eq!(learned.models.len(), 2);
    // The last image was at 811 ms.
    command(&mut session, 2, "CLEAR");
    assert_eq!(models(&mut session, 940).models.len(), 0);
    let mut params: ColorModelsParams = latest(session.run(), "/color/params");
    params.models = to_json(&AnyMessage::new(learned)).unwrap();
    session.write(ExternalEvent::operator("/color/params", AnyMessage::new(params))).unwrap();
    assert_eq!(models(&mut session, 980).models.len(), 2);
    assert_eq!(faults(session.run()).0, 0, "{}", faults(session.run()).1);
}

#[test]
fn an_image_from_the_future_does_not_stop_the_sending_of_models() {
    let ahead = RawImage { timestamp: Some(Stamp(3_600_000_000_000).to_proto()), ..scene(MULCH, 1) };
    let images = (1..8).map(|i| give(100 + 200 * i, "/image", scene(MULCH, 1 + i)));
    let given = with_calibration([give(100, "/image", ahead)].into_iter().chain(images));
    let mut run = begin(&given, 1, &[("color.pose.source", "POSE_FIXED")]);
    until(&mut run, 180);
    let before = bench::sent(&run, "/color/models");
    assert_eq!(before, 1);
    until(&mut run, 1_600);
    assert!(bench::sent(&run, "/color/models") > before);
}

#[test]
fn models_are_sent_on_after_the_clock_of_the_camera_has_begun_again() {
    let given = with_calibration((0..8).map(|i| {
        let time_ms = if i == 0 { 30_000 } else { 1_000 + 200 * i };
        let timestamp = Some(Stamp(time_ms * 1_000_000).to_proto());
        give(30_000 + 200 * i, "/image", RawImage { timestamp, ..scene(MULCH, 1 + i) })
    }));
    let params = [("color.pose.source", "POSE_FIXED"), ("color.learning_period_s", "60")];
    let mut run = begin(&given, 1, &params);
    until(&mut run, 30_180);
    let before = bench::sent(&run, "/color/models");
    assert_eq!(before, 1);
    until(&mut run, 31_600);
    let said = (2, "the clock of the images has begun again".to_owned());
    assert_eq!(faults(&run), said, "of the new clock, the first image is refused");
    assert!(bench::sent(&run, "/color/models") > before);
}

#[test]
fn after_init_the_calibration_that_was_sent_once_is_still_known() {
    let given = with_calibration(drive(10, 8, MULCH, 1.0, 0.0));
    let mut session = Session::new(begin(&given, 1, &[])).unwrap();
    let go = |session: &mut Session, at_ms: u64| {
        session.forward_until(Stamp((1_000 + at_ms) * 1_000_000), &Task::default()).unwrap();
    };
    go(&mut session, 700);
    assert_eq!(faults(session.run()).0, 0, "{}", faults(session.run()).1);
    command(&mut session, 2, "INIT");
    go(&mut session, 740);
    command(&mut session, 3, "RUN");
    let before = sent(session.run());
    go(&mut session, 1_700);
    assert_eq!(faults(session.run()).0, 0, "{}", faults(session.run()).1);
    assert!(sent(session.run()) > before);
}

#[test]
fn models_are_scaled_when_the_sample_budget_changes() {
    let given = with_calibration(drive(10, 15, MULCH, 1.0, 0.0));
    let mut session = Session::new(begin(&given, 1, &[])).unwrap();
    let go = |session: &mut Session, at_ms: u64| {
        session.forward_until(Stamp((1_000 + at_ms) * 1_000_000), &Task::default()).unwrap();
        let stats: ColorStats = latest(session.run(), "/color/stats");
        (stats.learning(), stats.ground_models)
    };
    assert_eq!(go(&mut session, 900), (ColorLearning::ColorUpdated, 1));
    let mut params: ColorModelsParams = latest(session.run(), "/color/params");
    params.samples = 1000;
    session.write(ExternalEvent::operator("/color/params", AnyMessage::new(params))).unwrap();
    // The ground is the same, and remains one model.
    for at_ms in [1_100, 2_900] {
        assert_eq!(go(&mut session, at_ms), (ColorLearning::ColorUpdated, 1), "{at_ms} ms");
    }
    let models: ColorModels = latest(session.run(), "/color/models");
    for model in &models.models {
        let sum: f32 = model.counts.iter().sum();
        assert!((sum - 1000.0).abs() < 1.0, "{}: {sum}", model.name);
    }
}

#[test]
fn images_that_cannot_be_used_are_skipped_with_nothing_sent_and_the_next_one_is_used() {
    let good = |seed: u64| scene(MULCH, seed);
    let small = RawImage { width: 160, height: 120, step: 480, ..good(2) };
    let steps: Vec<(&'static str, AnyMessage, Option<&str>)> = vec![
        ("/image", AnyMessage::new(good(1)), Some("image without a calibration")),
        (
            "/calibration",
            AnyMessage::new(CameraCalibration { k: vec![0.0; 9], ..calibration() }),
            Some("not calibrated"),
        ),
        ("/image", AnyMessage::new(good(2)), Some("image without a calibration")),
        ("/calibration", AnyMessage::new(calibration()), None),
        ("/image", AnyMessage::new(good(3)), None),
        ("/image", AnyMessage::new(good(3)), Some("the camera is frozen")),
        ("/image", AnyMessage::new(good(4)), None),
        (
            "/image",
            AnyMessage::new(small),
            Some("image has [160, 120] pixels, its calibration is for [320, 240]"),
        ),
        ("/image", AnyMessage::new(raw(vec![0; 320 * 240 * 3])), Some("image is 100 % black")),
        ("/image", AnyMessage::new(raw(vec![255; 320 * 240 * 3])), Some("100 % saturated")),
        ("/image", AnyMessage::new(raw(vec![1; 1000])), Some("bytes of the image")),
        (
            "/image",
            AnyMessage::new(RawImage { encoding: "h264".to_owned(), ..good(5) }),
            Some("got encoding \"h264\""),
        ),
        (
            "/image",
            AnyMessage::new(RawImage { timestamp: Some(Stamp(5).to_proto()), ..good(6) }),
            Some("older than the one before"),
        ),
        ("/image", AnyMessage::new(good(7)), None),
    ];
    let given: Vec<Given> = (0..)
        .zip(&steps)
        .map(|(i, (topic, message, _))| Given { at_ms: 100 * i, topic, message: message.clone() })
        .collect();
    let mut run = begin(&given, 1, &[("color.pose.source", "POSE_FIXED")]);
    for (i, (topic, _, why)) in (0..).zip(&steps) {
        let (before, outputs) = if i == 0 { (0, 0) } else { (faults(&run).0, sent(&run)) };
        until(&mut run, 100 * i + 80);
        let (count, last) = faults(&run);
        assert_eq!(count - before, u64::from(why.is_some()), "message {i}: {last}");
        if let Some(why) = why {
            assert!(last.contains(why), "message {i}: got {last:?}, expected {why:?}");
        }
        let goes_out = *topic == "/image" && why.is_none();
        assert_eq!(sent(&run) > outputs, goes_out, "message {i}: {last}");
    }
}

#[test]
fn a_first_image_from_the_future_does_not_make_the_next_one_old() {
    let ahead = RawImage { timestamp: Some(Stamp(3_600_000_000_000).to_proto()), ..scene(MULCH, 1) };
    let given = with_calibration([give(100, "/image", ahead), give(200, "/image", scene(MULCH, 2))]);
    let mut run = begin(&given, 1, &[("color.pose.source", "POSE_FIXED")]);
    let mut outputs = 0;
    for at_ms in [180, 280] {
        until(&mut run, at_ms);
        assert_eq!(faults(&run).0, 0, "{}", faults(&run).1);
        assert!(sent(&run) > outputs, "{at_ms} ms");
        outputs = sent(&run);
    }
}

#[test]
fn an_image_of_a_camera_upside_down_or_on_its_side_is_skipped() {
    let given = with_calibration([give(10, "/image", scene(MULCH, 1))]);
    for (roll_deg, images) in [("180.0", 0), ("-90.0", 0), ("30.0", 1)] {
        let params = [("color.pose.source", "POSE_FIXED"), ("color.mount.roll_deg", roll_deg)];
        let mut run = begin(&given, 1, &params);
        until(&mut run, 200);
        let (count, last) = faults(&run);
        assert_eq!((count, sent(&run) > 0), (1 - images, images == 1), "{roll_deg}: {last}");
        assert!(images == 1 || last.contains("expected at most 45° either way"), "{roll_deg}: {last}");
    }
}

#[test]
fn an_image_without_a_pose_is_skipped() {
    let mut run = begin(&with_calibration([give(10, "/image", scene(MULCH, 1))]), 1, &[]);
    until(&mut run, 200);
    assert_eq!((faults(&run).0, sent(&run)), (1, 0), "{}", faults(&run).1);
}

#[test]
fn models_that_were_saved_classify_from_the_first_image_of_the_next_run() {
    let mut run = begin(&with_calibration(drive(10, 10, MULCH, 1.0, 0.0)), 1, &[]);
    until(&mut run, 2_100);
    let models: ColorModels = latest(&run, "/color/models");
    let text = to_json(&AnyMessage::new(models)).unwrap();

    // The vehicle stands on lime next to a mulch path with the colours of the file, and learns nothing.
    let given = with_calibration(drive(10, 3, MULCH, 0.0, 0.0));
    let mut run = begin_with(&given, 1, &[("color.models", "saved")], &Shelf(text));
    until(&mut run, 100);
    let stats: ColorStats = latest(&run, "/color/stats");
    assert_eq!((stats.learning(), stats.ground_models), (ColorLearning::ColorOffStanding, 1));
    assert!(stats.ground > 2_000 && stats.unclassified < 100, "{stats:?}");
}

#[test]
fn a_file_that_holds_no_models_is_refused_before_anything_runs() {
    let refused = |text: &str| {
        let shelf = Shelf(text.to_owned());
        let setup = Setup::new(STACK, PROCESSES).params(&[("color.models_2", "broken")]).assets(&shelf);
        setup.plan().unwrap_err().to_string()
    };
    let error = refused("{\"models\": [{\"name\": \"mulch\", \"counts\": [1, 2]}]}");
    assert!(error.contains("broken:1: model \"mulch\" has 2 counts"), "{error}");
    let error = refused("nonsense");
    assert!(error.contains("expected the JSON of a rcs.ColorModels"), "{error}");
}

#[test]
fn a_run_gives_the_same_bytes_again_with_two_threads_and_from_a_snapshot() {
    let mut given = with_calibration(drive(10, 4, MULCH, 1.0, 0.0));
    given.extend(drive(810, 4, LIME, 1.0, 0.0));
    let hash = |threads: usize| {
        let mut run = begin(&given, threads, &[]);
        until(&mut run, 2_000);
        run.summary().hash
    };
    let expected = hash(1);
    assert!(expected.is_some());
    assert_eq!(hash(2), expected);
    let mut run = begin(&given, 1, &[]);
    until(&mut run, 900);
    let bytes = run.snapshot().to_bytes().unwrap();
    until(&mut run, 2_000);
    run.restore(&Snapshot::from_bytes(&bytes).unwrap()).unwrap();
    until(&mut run, 2_000);
    assert_eq!(run.summary().hash, expected);
}
