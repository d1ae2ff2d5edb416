//! Acceptance test of terrain learning and classification in simulation: models learned with stereo suffice to detect
//! obstacles without stereo.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use rcs_metrics::Confusion;
use rcs_msg::foxglove::RawImage;
use rcs_msg::{AnyMessage, Payload, Stamp, image::depth_m, to_json};
use rcs_plugins::all;
use rcs_runtime::{Asset, Assets, Plan, PlanOptions, RunOptions, StackFile, Stepped};
use rcs_terrain::proto::TerrainModels;
use std::sync::Arc;

/// Pixels are counted from this time of the drive on, s, when the first bush has been passed.
const FROM_S: u32 = 15;
const UNTIL_S: u32 = 40;
/// Pixels farther away than this are not counted, m.
const REACH_M: f32 = 15.0;

/// The vehicle, its driver and one camera.
const DRIVE: &str = r#"
format = 1
name = "terrain_course"
course = "meadow"

[[process]]
name = "vehicle"
plugin = "sim_vehicle"
supervisor = "viewer"
inputs = { wheels = "/vehicle_interface/wheels" }

[[process]]
name = "driver"
plugin = "truth_driver"
supervisor = "viewer"
inputs = { ground_truth_pose = "/vehicle/ground_truth_pose", ground_truth_map = "/vehicle/ground_truth_map", goal = "/vehicle/goal" }

[[process]]
name = "vehicle_interface"
plugin = "vehicle_interface"
supervisor = "viewer"
inputs = { drive = "/driver/drive", local = "/localization/local", imu = "/vehicle/imu", encoders = "/vehicle/encoders" }
params = { track_m = 0.58 }

[[process]]
name = "localization"
plugin = "localization"
supervisor = "viewer"
inputs = { encoders = "/vehicle/encoders", imu = "/vehicle/imu", gps = "/vehicle/gps" }
params = { track_m = 0.58 }

[[process]]
name = "front_left"
plugin = "sim_cameras"
supervisor = "viewer"
inputs = { ground_truth_state = "/vehicle/ground_truth_state" }
params = { pair = "front_left" }

[buffers."/vehicle/imu"]
queue = 16

[buffers."/vehicle/encoders"]
queue = 8
"#;

/// Stereo, its obstacle labels, and the models learned from them.
const LEARNING: &str = r#"
[[process]]
name = "stereo_left"
plugin = "stereo"
supervisor = "viewer"

[process.inputs]
left = "/front_left/left"
right = "/front_left/right"
left_calibration = "/front_left/left_calibration"
right_calibration = "/front_left/right_calibration"

[process.params]
disparities = 48
max_range_m = 20.0

[[process]]
name = "obstacles_left"
plugin = "obstacles"
supervisor = "viewer"
period_ms = 50.0

[process.inputs]
image = "/stereo_left/rectified"
depth = "/stereo_left/depth"
calibration = "/stereo_left/calibration"
odometry = "/localization/local"
static_transforms = "/vehicle/static_transforms"

[process.params]
max_range_m = 10.0
wheels_x_m = 0.0

[[process]]
name = "terrain"
plugin = "terrain_learner"
supervisor = "viewer"

[process.inputs]
left_image = "/stereo_left/rectified"
left_labels = "/obstacles_left/labels"
left_depth = "/stereo_left/depth"
left_calibration = "/stereo_left/calibration"
bumper = "/vehicle/bumper"
odometry = "/localization/local"
static_transforms = "/vehicle/static_transforms"

[process.params]
min_points = 50
merge_distance = 0.03
ratio_span_octaves = 0.6
front_m = 0.24
rear_m = 0.72
"#;

/// Classification of whole images of one camera.
const CLASSIFIER: &str = r#"
[[process]]
name = "classifier"
plugin = "classifier"
supervisor = "viewer"
period_ms = 50.0

[process.inputs]
image = "/front_left/left"
calibration = "/front_left/left_calibration"
models = "/terrain/models"
odometry = "/localization/local"
static_transforms = "/vehicle/static_transforms"

[process.params]
window_px = 8
"#;

/// The bundled files, and the models that a run has learned.
struct Files {
    models: String,
}

impl Assets for Files {
    #[expect(clippy::disallowed_methods, reason = "a test reads the program's files")]
    fn read(&self, kind: &str, name: &str, _beside: &str) -> Result<Asset, String> {
        if kind == "models" {
            return Ok(Asset { file: name.to_owned(), text: self.models.clone() });
        }
        let file = format!("assets/{kind}s/{name}.toml");
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").join(&file);
        let text = std::fs::read_to_string(path).map_err(|error| format!("{error}: {file}"))?;
        Ok(Asset { file, text })
    }
}

/// Starts a stack on a course.
fn start(text: &str, course: &str, models: String, seed: u64) -> Stepped {
    let file = StackFile::parse("terrain_course", text).unwrap_or_else(|error| panic!("{error}"));
    let options = PlanOptions { overrides: &[], course: Some(course), assets: &Files { models } };
    let plan = Plan::with(file, all(), &options).unwrap_or_else(|error| panic!("{error}"));
    let options = RunOptions { seed, ..RunOptions::default() };
    let mut run = Stepped::new(Arc::new(plan), None, options).unwrap();
    run.begin().unwrap();
    run
}

fn latest<T: Payload>(run: &Stepped, buffer: &str) -> Option<T> {
    run.bus().get(buffer).unwrap().latest()?.message.to()
}

/// Pixels within a range by true class and classified class.
#[derive(Clone, Copy, Debug, Default)]
struct Score {
    /// Ground and obstacles.
    confusion: Confusion<2>,
}

impl Score {
    /// Counts the newest classes of a run if they have the time of the newest true labels.
    fn count(&mut self, run: &Stepped, reach_m: f32) {
        let truth = |name: &str| latest::<RawImage>(run, &format!("/front_left/{name}"));
        let (Some(labels), Some(depth)) = (truth("ground_truth_labels"), truth("ground_truth_depth")) else {
            return;
        };
        let Some(classes) = latest::<RawImage>(run, "/classifier/classes") else { return };
        if classes.timestamp != labels.timestamp || depth.timestamp != labels.timestamp {
            return;
        }
        let depths = depth_m(&depth, 1.0).unwrap();
        for ((&label, &class), depth) in labels.data.iter().zip(classes.data.iter()).zip(depths) {
            if depth <= reach_m && (label == 1 || label == 2) {
                // Classes: 0 is unknown, 1 traversable, 2 not traversable.
                self.confusion.add(usize::from(label - 1), class.checked_sub(1).map(usize::from));
            }
        }
    }

    fn obstacle_recall(&self) -> f64 {
        self.confusion.recall(1).unwrap_or(0.0)
    }

    fn iou(&self, of: usize) -> f64 {
        self.confusion.iou(of).unwrap_or(0.0)
    }

    fn unclassified(&self) -> f64 {
        self.confusion.unclassified_share().unwrap_or(0.0)
    }
}

/// The models learned on a drive with stereo, and the score of their classes between two times, s.
fn with_stereo(course: &str, from_s: u32, until_s: u32) -> (String, Score) {
    let mut run = start(&[DRIVE, LEARNING, CLASSIFIER].concat(), course, String::new(), 0);
    let mut score = Score::default();
    for step in 1..=until_s * 5 {
        run.run_until(Stamp(u64::from(step) * 200_000_000 + 150_000_000)).unwrap();
        if step > from_s * 5 {
            score.count(&run, REACH_M);
        }
    }
    let models: TerrainModels = latest(&run, "/terrain/models").unwrap();
    (to_json(&AnyMessage::new(models)).unwrap(), score)
}

/// The same drive with another noise seed, without stereo and with models from a file.
fn without_stereo(course: &str, models: String, from_s: u32, until_s: u32) -> Score {
    let classifier = CLASSIFIER.replace("models = \"/terrain/models\"\n", "") + "models = \"learned\"\n";
    let mut run = start(&[DRIVE, &classifier].concat(), course, models, 1);
    let mut score = Score::default();
    for step in 1..=until_s * 5 {
        run.run_until(Stamp(u64::from(step) * 200_000_000 + 150_000_000)).unwrap();
        if step > from_s * 5 {
            score.count(&run, REACH_M);
        }
    }
    score
}

#[test]
fn without_stereo_classification_keeps_its_obstacle_recall() {
    let course = "meadow";
    let (models, with) = with_stereo(course, FROM_S, UNTIL_S);
    let without = without_stereo(course, models, FROM_S, UNTIL_S);
    for (name, score) in [("with stereo", with), ("without stereo", without)] {
        let (recall, unclassified) = (score.obstacle_recall(), score.unclassified());
        let [ground, obstacle] = [score.iou(0), score.iou(1)];
        println!(
            "{course}, {name}: obstacle recall {recall:.3}, obstacle IoU {obstacle:.3}, ground IoU {ground:.3}, {unclassified:.3} unclassified"
        );
        // Of 5 images per second. With fewer pixels of ground and obstacles per image there is nothing to judge by.
        let images = u64::from(UNTIL_S - FROM_S) * 5;
        let [ground, obstacle] = [0, 1].map(|class| score.confusion.of_class(class));
        assert!(ground > images * 1000 && obstacle > images * 10, "{name}: {score:?}");
    }
    assert!(without.obstacle_recall() >= 0.8 * with.obstacle_recall(), "{with:?}, {without:?}");
    // Trunks and stones narrower than a window are missed; bushes and logs are found.
    assert!(without.obstacle_recall() >= 0.4 && without.iou(0) >= 0.95, "{without:?}");
}
