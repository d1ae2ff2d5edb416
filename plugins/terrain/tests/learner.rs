//! The process on a synthetic frame: the pictures of its models, their deletion, and examples of the operator.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use rcs_geom::{DVec2, DVec3, PinholeCamera, Pose};
use rcs_msg::foxglove::{CameraCalibration, Grid, Odometry, RawImage};
use rcs_msg::rcs::{
    Command, ExampleKind, ModelToDelete, PlanePoint, PlanePolygon, Status, TrainingExample, WaySlip,
};
use rcs_msg::{AnyMessage, Stamp, schema_of};
use rcs_runtime::{ExternalEvent, ProcessType};
use rcs_terrain::proto::{
    ClassifierParams, TerrainCameras, TerrainLearnerParams, TerrainModels, TerrainStats,
};
use rcs_terrain::{Classifier, TerrainLearner};
use rcs_testkit::bench::{Bench, Setup};
use rcs_world::{GridView, NumericType};

const STACK: &str = r#"
format = 1
name = "learner"

[[process]]
name = "terrain"
plugin = "terrain_learner"
supervisor = "viewer"
period_ms = 50.0

[process.inputs]
left_image = "/operator/image"
left_labels = "/operator/labels"
left_depth = "/operator/depth"
left_calibration = "/operator/calibration"
examples = "/operator/training"
way_slip = "/operator/way_slip"
odometry = "/operator/odometry"

[process.params]
learn_while_standing = true
min_points = 8
pose = { source = "POSE_FIXED" }
mount = { fixed = true, height_m = 1.0, pitch_deg = 35.0 }
"#;

const PROCESSES: &[ProcessType] = &[ProcessType::of::<TerrainLearner>()];
const SIZE: [u32; 2] = [64, 48];
const GRASS: [u8; 3] = [60, 120, 40];
const BARK: [u8; 3] = [150, 90, 50];

fn calibration() -> CameraCalibration {
    CameraCalibration {
        width: SIZE[0],
        height: SIZE[1],
        distortion_model: "plumb_bob".to_owned(),
        d: vec![0.0; 5],
        k: vec![50.0, 0.0, 31.5, 0.0, 50.0, 23.5, 0.0, 0.0, 1.0],
        ..CameraCalibration::default()
    }
}

fn image(encoding: &str, bytes_per_pixel: u32, data: Vec<u8>) -> RawImage {
    RawImage {
        timestamp: Some(Stamp(20_000_000).to_proto()),
        frame_id: "camera".to_owned(),
        width: SIZE[0],
        height: SIZE[1],
        encoding: encoding.to_owned(),
        step: bytes_per_pixel * SIZE[0],
        data: data.into(),
    }
}

/// A bench whose learner has seen flat ground: grass at the left (y above 0), and bark, which is labelled an obstacle,
/// at the right.
fn bench() -> Bench {
    let mut bench = Setup::new(STACK, PROCESSES).bench();
    let [rgb, labels, depth] = scene();
    bench.write("/operator/calibration", calibration());
    bench.write("/operator/image", rgb);
    bench.write("/operator/depth", depth);
    bench.write("/operator/labels", labels);
    bench.advance(100);
    assert_eq!(bench.faults("terrain").0, 0, "{}", bench.faults("terrain").1);
    bench
}

/// Image, labels and depth of the flat ground.
fn scene() -> [RawImage; 3] {
    let camera = PinholeCamera::from_calibration(SIZE, &calibration().k, "plumb_bob", &[0.0; 5]).unwrap();
    let mount =
        Pose::from_rpy(DVec3::new(0.0, 0.0, 1.0), 0.0, 35_f64.to_radians(), 0.0) * Pose::body_from_optical();
    let (mut rgb, mut labels, mut depth) = (Vec::new(), Vec::new(), Vec::new());
    for v in 0..SIZE[1] {
        for u in 0..SIZE[0] {
            let ray = mount.rotate(camera.unproject(DVec2::new(f64::from(u), f64::from(v))).unwrap());
            let depth_m = if ray.z < -0.1 { -1.0 / ray.z } else { f64::NAN };
            let is_grass = ray.y > 0.0;
            rgb.extend(if is_grass { GRASS } else { BARK });
            labels.push(if is_grass { 1 } else { 2 });
            depth.extend((depth_m as f32).to_le_bytes());
        }
    }
    [image("rgb8", 3, rgb), image("mono8", 1, labels), image("32FC1", 4, depth)]
}

/// Gives an image of a time, whose first pixel makes it differ from others, with its depth and, where the stack reads them,
/// its labels, and waits until they have been processed.
fn give(bench: &mut Bench, time_ms: u64) {
    let [mut rgb, labels, depth] = scene();
    let mut data = rgb.data.to_vec();
    data[0] = (time_ms / 100) as u8;
    rgb.data = data.into();
    for (buffer, image) in
        [("/operator/image", rgb), ("/operator/labels", labels), ("/operator/depth", depth)]
    {
        let message = AnyMessage::new(image);
        if bench.session.run().bus().get(buffer).is_none() {
            continue;
        }
        bench.session.write(ExternalEvent::sensed(buffer, Stamp(time_ms * 1_000_000), message)).unwrap();
    }
    bench.advance(100);
}

fn models(bench: &Bench) -> TerrainModels {
    bench.latest("/terrain/models")
}

/// Cost of the cell at a place; 255 where it is unknown.
fn cost(bench: &Bench, x: f64, y: f64) -> f64 {
    let grid: Grid = bench.latest("/terrain/cost");
    let view = GridView::new(&grid).unwrap();
    let cell = (DVec2::new(x, y) - view.frame_from_grid().translation.truncate()) / 0.2;
    let costs = view.field_of("cost.terrain", NumericType::Uint8).unwrap();
    costs.get(cell.x as usize, cell.y as usize).unwrap()
}

#[test]
fn each_model_carries_a_picture_of_what_it_was_learned_from() {
    let models = models(&bench()).models;
    assert!(models.len() >= 2, "{}", models.len());
    for model in &models {
        let sample = model.sample.as_ref().unwrap();
        assert_eq!((sample.encoding.as_str(), sample.frame_id.as_str()), ("rgb8", "camera"));
        assert!(sample.width <= 16 && sample.timestamp.is_some(), "{sample:?}");
        let own = if model.obstacle > model.ground { BARK } else { GRASS };
        let middle = (sample.height / 2 * sample.step + sample.width / 2 * 3) as usize;
        assert_eq!(sample.data[middle..middle + 3], own, "{} of {}", model.obstacle, model.ground);
    }
}

#[test]
fn a_deleted_model_is_gone_with_its_cells_and_what_is_no_model_any_more_is_a_fault() {
    let mut bench = bench();
    let before = models(&bench).models;
    let bark = before.iter().position(|model| model.obstacle > model.ground).unwrap();
    assert_eq!(cost(&bench, 2.1, -0.5), 250.0);
    let delete = |bench: &mut Bench, serial: u64, number: usize, name: &str| {
        let (output, name) = ("models".to_owned(), name.to_owned());
        let model = ModelToDelete { output, number: number as u32, name };
        let command = Command {
            serial,
            name: "DELETE".to_owned(),
            parameters_schema: schema_of::<ModelToDelete>().name().to_owned(),
            parameters: rcs_msg::prost::Message::encode_to_vec(&model).into(),
            ..Command::default()
        };
        bench.write("/terrain/command", command);
        bench.advance(100);
    };
    delete(&mut bench, 2, 99, &before[bark].name);
    let after = models(&bench).models;
    assert_eq!(after.len(), before.len() - 1);
    assert_eq!(
        after.iter().filter(|model| model.ground > 0).count(),
        before.iter().filter(|m| m.ground > 0).count()
    );
    delete(&mut bench, 3, bark, &before[bark].name);
    assert_eq!(models(&bench).models.len(), after.len(), "another model has its number now");
    let gone = format!("DELETE: there is no model {:?} any more", before[bark].name);
    assert!(bench.faults("terrain").1.starts_with(&gone), "{:?}", bench.faults("terrain"));
    delete(&mut bench, 4, 99, "");
    assert_eq!(models(&bench).models.len(), after.len());
    assert!(
        bench.faults("terrain").1.starts_with("DELETE: there is no model 99"),
        "{:?}",
        bench.faults("terrain")
    );
}

#[test]
fn ground_on_which_slip_lasts_is_dear_and_so_is_what_looks_like_it() {
    let mut bench = bench();
    let slip = |slip: f64| WaySlip {
        slip,
        middle: Some(rcs_sense::pose_message(&Pose::from_xy_yaw(2.1, 0.5, 0.0))),
        ..WaySlip::default()
    };
    let by_fixes = "by fixes: it stands, and the local frame moves on";
    for (value, rolled_m, why) in [(0.2, 1.0, "as in growth"), (0.9, 5.0, by_fixes)] {
        bench.write("/operator/way_slip", WaySlip { rolled_m, ..slip(value) });
        bench.advance(300);
        assert_eq!((cost(&bench, 2.1, 0.5), cost(&bench, 1.3, 0.3)), (0.0, 0.0), "{why}");
    }
    bench.write("/operator/way_slip", slip(0.5));
    bench.advance(300);
    for (x, y) in [(2.1, 0.5), (1.3, 0.3)] {
        assert!((80.0..=100.0).contains(&cost(&bench, x, y)), "at {x}, {y}: {}", cost(&bench, x, y));
    }
    assert_eq!(cost(&bench, 2.1, -0.7), 250.0, "bark");
    bench.write("/operator/way_slip", WaySlip { middle: None, ..slip(0.5) });
    bench.advance(100);
    assert!(bench.faults("terrain").1.starts_with("way_slip: "), "{:?}", bench.faults("terrain"));
}

#[test]
fn driving_teaches_after_a_while_and_not_where_slip_has_been_told_by_then() {
    let moving = STACK.replace("pose = { source = \"POSE_FIXED\" }\n", "driven_delay_s = 0.15\n");
    let mut bench = Setup::new(&moving, PROCESSES).bench();
    let under = |bench: &Bench| [0.0, 2.0, 4.0, 6.0, 8.0].map(|x| cost(bench, x, 0.1));
    for (step, slip) in [0.0, 0.1, 0.9, 0.9, 0.1].into_iter().enumerate() {
        let pose = Some(rcs_sense::pose_message(&Pose::from_xy_yaw(2.0 * step as f64, 0.0, 0.0)));
        // By position fixes, whose slip of 0.9 teaches nothing of the ground.
        bench
            .write("/operator/way_slip", WaySlip { slip, rolled_m: 5.0, middle: pose, ..WaySlip::default() });
        let frame_id = "local".to_owned();
        bench.write("/operator/odometry", Odometry { frame_id, pose, ..Odometry::default() });
        bench.advance(100);
    }
    assert_eq!(
        under(&bench),
        [0.0, 255.0, 255.0, 255.0, 255.0],
        "slip was told 0.1 s after the second place"
    );
    bench.advance(200);
    assert_eq!(under(&bench), [0.0, 255.0, 255.0, 255.0, 0.0]);
}

#[test]
fn what_the_operator_marks_is_an_obstacle_or_ground_and_so_is_what_looks_like_it() {
    let mut bench = bench();
    assert_eq!((cost(&bench, 2.1, 0.5), cost(&bench, 1.3, 0.3)), (0.0, 0.0));
    let point = |x_m, y_m| PlanePoint { x_m, y_m };
    let square = |x: f64, y: f64| PlanePolygon {
        points: vec![point(x, y), point(x + 0.4, y), point(x + 0.4, y + 0.4), point(x, y + 0.4)],
    };
    let example = |kind: ExampleKind, outline: PlanePolygon| TrainingExample {
        timestamp: None,
        frame_id: "local".to_owned(),
        kind: kind.into(),
        outline: Some(outline),
    };
    bench.write("/operator/training", example(ExampleKind::ExampleObstacle, square(2.0, 0.4)));
    bench.advance(100);
    let stats = |bench: &Bench| bench.newest::<TerrainStats>("/terrain/stats");
    assert_eq!(bench.faults("terrain").0, 0, "{}", bench.faults("terrain").1);
    assert!(cost(&bench, 2.1, 0.5) > 125.0, "a cell that was marked: {}", cost(&bench, 2.1, 0.5));
    assert!(cost(&bench, 1.3, 0.3) > 125.0, "a cell that looks like it: {}", cost(&bench, 1.3, 0.3));
    assert!(stats(&bench).is_some());
    // Where nothing was seen, the cells alone are known.
    bench.write("/operator/training", example(ExampleKind::ExampleObstacle, square(-5.0, 0.0)));
    bench.advance(100);
    assert_eq!(cost(&bench, -4.9, 0.1), 250.0);
    bench.write("/operator/training", example(ExampleKind::ExampleGround, square(2.0, -0.8)));
    bench.advance(100);
    assert!(cost(&bench, 2.1, -0.7) < 125.0);

    let elsewhere = TrainingExample {
        frame_id: "elsewhere".to_owned(),
        ..example(ExampleKind::ExampleObstacle, square(0.0, 0.0))
    };
    let refused = [
        (elsewhere, "is unknown"),
        (example(ExampleKind::ExampleObstacle, PlanePolygon::default()), "0 corners"),
        (example(ExampleKind::ExampleObstacle, square(900.0, 0.0)), "outside of the map"),
    ];
    for (count, (example, why)) in (1..).zip(refused) {
        bench.write("/operator/training", example);
        bench.advance(100);
        let (faults, last) = bench.faults("terrain");
        assert!(faults == count && last.contains(why), "{faults} faults, {last}");
    }
}

#[test]
fn what_is_cleared_and_what_was_counted_in_other_bins_is_withdrawn_at_once() {
    let mut cleared = bench();
    assert!(!models(&cleared).models.is_empty());
    cleared.write("/terrain/command", Command { serial: 2, name: "CLEAR".to_owned(), ..Command::default() });
    cleared.advance(100);
    assert!(models(&cleared).models.is_empty());
    assert_eq!(cost(&cleared, 2.1, -0.5), 255.0);
    let mut other_bins = bench();
    let mut params: TerrainLearnerParams = other_bins.latest("/terrain/params");
    params.ratio_span_octaves = 1.0;
    other_bins.write("/terrain/params", params);
    other_bins.advance(100);
    assert!(models(&other_bins).models.is_empty());
    assert_eq!(models(&other_bins).ratio_span_octaves, 1.0);
}

#[test]
fn without_images_the_map_is_around_the_vehicle_and_stays_there_when_it_is_cleared() {
    let moving = STACK.replace("pose = { source = \"POSE_FIXED\" }\n", "");
    let mut bench = Setup::new(&moving, PROCESSES).bench();
    let at = |bench: &mut Bench, x: f64| {
        let pose = Some(rcs_sense::pose_message(&Pose::from_xy_yaw(x, 0.0, 0.0)));
        let frame_id = "local".to_owned();
        bench.write("/operator/odometry", Odometry { frame_id, pose, ..Odometry::default() });
    };
    let clear = |bench: &mut Bench, serial: u64| {
        bench.write("/terrain/command", Command { serial, name: "CLEAR".to_owned(), ..Command::default() });
        bench.advance(100);
        let grid: Grid = bench.latest("/terrain/cost");
        GridView::new(&grid).unwrap().frame_from_grid().translation.x
    };
    bench.advance(100);
    at(&mut bench, 60.1);
    let west_m = clear(&mut bench, 2);
    assert!((west_m - 40.0).abs() < 1e-6, "{west_m}");
    let point = |x_m, y_m| PlanePoint { x_m, y_m };
    let outline = PlanePolygon { points: vec![point(61.8, 0.0), point(62.2, 0.0), point(62.2, 0.4)] };
    let example = TrainingExample {
        timestamp: None,
        frame_id: "local".to_owned(),
        kind: ExampleKind::ExampleObstacle.into(),
        outline: Some(outline),
    };
    at(&mut bench, 62.1);
    bench.write("/operator/training", example);
    bench.advance(100);
    assert_eq!(bench.faults("terrain"), (0, String::new()));
    assert_eq!(cost(&bench, 62.1, 0.1), 250.0);
    at(&mut bench, 62.1);
    assert_eq!(clear(&mut bench, 3), west_m, "the same cells are withdrawn");
    assert_eq!(cost(&bench, 62.1, 0.1), 255.0);
    // Farther on it follows.
    at(&mut bench, 70.1);
    let west_m = clear(&mut bench, 4);
    assert!((west_m - 50.0).abs() < 1e-6, "{west_m}");
}

#[test]
fn where_poses_leap_or_their_clock_begins_again_the_cells_are_forgotten_and_the_models_stay() {
    let moving = STACK.replace("pose = { source = \"POSE_FIXED\" }\n", "");
    let mut bench = Setup::new(&moving, PROCESSES).bench();
    let place = |bench: &mut Bench, time_ms: u64, x: f64| {
        let pose = Some(rcs_sense::pose_message(&Pose::from_xy_yaw(x, 0.0, 0.0)));
        let odometry = Odometry { frame_id: "local".to_owned(), pose, ..Odometry::default() };
        let (time, message) = (Stamp(time_ms * 1_000_000), AnyMessage::new(odometry));
        bench.session.write(ExternalEvent::sensed("/operator/odometry", time, message)).unwrap();
        bench.advance(100);
    };
    bench.write("/operator/calibration", calibration());
    bench.advance(20_000);
    place(&mut bench, 20_000, 0.0);
    give(&mut bench, 20_000);
    let learned = models(&bench).models.len();
    assert!(learned >= 2 && cost(&bench, 2.1, 0.5) == 0.0, "{learned}");
    place(&mut bench, 20_200, 8.0);
    assert_eq!((cost(&bench, 2.1, 0.5), models(&bench).models.len()), (255.0, learned));
    let why = "the pose in the local frame leapt by 8.0 m; the cells are forgotten, the models stay";
    assert_eq!(bench.faults("terrain"), (1, why.to_owned()));
    give(&mut bench, 20_200);
    assert_eq!(cost(&bench, 10.1, 0.5), 0.0);
    let learned = models(&bench).models.len();
    for time_ms in [1_000, 1_100, 1_200] {
        place(&mut bench, time_ms, 8.0);
    }
    assert_eq!((cost(&bench, 10.1, 0.5), models(&bench).models.len()), (255.0, learned));
    let why = "the clock of the poses has begun again; the cells are forgotten, the models stay";
    assert_eq!(bench.faults("terrain"), (2, why.to_owned()));
    // Of images by the new clock, the first ones may be late.
    give(&mut bench, 1_200);
    assert_eq!((cost(&bench, 10.1, 0.5), bench.faults("terrain").0), (255.0, 5));
    give(&mut bench, 1_300);
    let why = "left camera: the clock of the labels has begun again";
    assert_eq!((cost(&bench, 10.1, 0.5), bench.faults("terrain")), (0.0, (8, why.to_owned())));
}

#[test]
fn where_a_buffer_has_dropped_the_image_of_labels_the_fault_names_its_queue() {
    let mut bench = Setup::new(STACK, PROCESSES).bench();
    bench.write("/operator/calibration", calibration());
    bench.advance(1_000);
    let [rgb, labels, depth] = scene();
    // The second image replaces the first one before the next cycle.
    for (buffer, time_ms, image) in [
        ("/operator/image", 900, &rgb),
        ("/operator/image", 950, &rgb),
        ("/operator/depth", 900, &depth),
        ("/operator/labels", 900, &labels),
    ] {
        let message = AnyMessage::new(image.clone());
        bench.session.write(ExternalEvent::sensed(buffer, Stamp(time_ms * 1_000_000), message)).unwrap();
    }
    bench.advance(100);
    let why = "left camera: no image of the time of the labels: nearest is 0.050 s away; \
               1 dropped unread: its buffer needs a longer `queue`; frame skipped";
    assert_eq!(bench.faults("terrain"), (1, why.to_owned()));
}

#[test]
fn cameras_that_learn_together_from_now_on_begin_with_the_models_of_both() {
    let text = rcs_msg::to_json(&AnyMessage::new(models(&bench()))).unwrap();
    let mut bench = Setup::new(STACK, PROCESSES).bench();
    bench.advance(100);
    let params: TerrainLearnerParams = bench.latest("/terrain/params");
    let params = TerrainLearnerParams { models_right: text, ..params };
    bench.write("/terrain/params", params.clone());
    bench.advance(100);
    let cameras = TerrainCameras::TerrainCombined.into();
    bench.write("/terrain/params", TerrainLearnerParams { cameras, ..params });
    bench.advance(100);
    assert!(!models(&bench).models.is_empty());
}

const CLASSIFIER: &str = r#"
format = 1
name = "classifier"

[[process]]
name = "classifier"
plugin = "classifier"
supervisor = "viewer"
period_ms = 50.0

[process.inputs]
image = "/operator/image"
calibration = "/operator/calibration"
odometry = "/operator/odometry"
"#;

#[test]
fn the_classifier_takes_another_model_file_while_it_runs() {
    let mut bench = Setup::new(CLASSIFIER, &[ProcessType::of::<Classifier>()]).bench();
    bench.write("/operator/calibration", calibration());
    bench.write("/operator/image", image("rgb8", 3, GRASS.repeat((SIZE[0] * SIZE[1]) as usize)));
    bench.advance(100);
    let told = |bench: &Bench| bench.latest::<Status>("/classifier/status").state_text;
    assert_eq!(told(&bench), "waits for models");
    let mut params: ClassifierParams = bench.latest("/classifier/params");
    params.models = rcs_msg::to_json(&AnyMessage::new(models(&self::bench()))).unwrap();
    bench.write("/classifier/params", params);
    bench.advance(100);
    assert_ne!(told(&bench), "waits for models");
}

/// A time that is an hour ahead, ms.
const AHEAD_MS: u64 = 3_600_000;

#[test]
fn images_from_the_future_do_not_stop_the_learning() {
    let mut bench = bench();
    bench.advance(700);
    for (count, time_ms) in (1..).zip([AHEAD_MS, 850, 950, 1_050]) {
        give(&mut bench, time_ms);
        assert_eq!(bench.faults("terrain"), (0, String::new()), "{time_ms} ms");
        assert_eq!(bench.sent("/terrain/stats"), 1 + count, "{time_ms} ms");
    }
}

/// The classifier of whole images and depth with learned models, 800 ms after its start, and a camera with this mount.
fn classifier_bench(mount: &str) -> Bench {
    let models = rcs_msg::to_json(&AnyMessage::new(models(&self::bench()))).unwrap();
    let stack = CLASSIFIER.replace("odometry = ", "depth = \"/operator/depth\"\nodometry = ")
        + &format!("\n[process.params]\npose = {{ source = \"POSE_FIXED\" }}\nmount = {{ {mount} }}\n");
    let mut bench = Setup::new(&stack, &[ProcessType::of::<Classifier>()]).bench();
    bench.write("/operator/calibration", calibration());
    bench.advance(100);
    let mut params: ClassifierParams = bench.latest("/classifier/params");
    params.models = models;
    bench.write("/classifier/params", params);
    bench.advance(700);
    bench
}

#[test]
fn images_of_a_camera_upside_down_are_not_classified() {
    let mut bench = classifier_bench("fixed = true, height_m = 1.0, pitch_deg = 35.0, roll_deg = 180.0");
    give(&mut bench, 850);
    let (faults, last) = bench.faults("classifier");
    assert!(faults == 1 && last.contains("expected at most 45° either way"), "{faults}: {last}");
    assert_eq!(bench.sent("/classifier/stats"), 0);
}

#[test]
fn images_from_the_future_do_not_stop_the_classifier() {
    let mut bench = classifier_bench("fixed = true, height_m = 1.0, pitch_deg = 35.0");
    for (count, time_ms) in (1..).zip([AHEAD_MS, 850, 950, 1_050]) {
        give(&mut bench, time_ms);
        assert_eq!(bench.faults("classifier"), (0, String::new()), "{time_ms} ms");
        assert_eq!(bench.sent("/classifier/stats"), count, "{time_ms} ms");
    }
}
