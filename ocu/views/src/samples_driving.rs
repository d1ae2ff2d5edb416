//! A small synthetic frame of a running simulation, for the tests of the views.

use super::plan::{arcs, plan};
use super::{NOW, cloud, empty, grid, image, label_image, pose_on_track, topic, track, with_metadata};
use rcs_msg::classes::{CLASSES, OBSTACLE_CLASSES, classes_to_json};
use rcs_msg::foxglove::points_annotation::Type;
use rcs_msg::foxglove::{
    CircleAnnotation, Color, ImageAnnotations, Point2, PointsAnnotation, PoseInFrame, TextAnnotation, Vector3,
};
use rcs_msg::rcs::{
    CourseRun, DriveCommand, EmergencyStop, Mission, PlanePoint, PlanePolygon, PortInfo, ProcessInfo,
    ProcessTiming, SpeedLimit, Timing, TrainingExample, VehicleStatus,
};
use rcs_msg::{Schema, schema_of};
use rcs_runtime::source::{
    Event, EventKind, EventLevel, Events, Frame, RunTag, Runs, SourceInfo, SourceKind, Topic,
};
use std::sync::Arc;

/// The newest frame of a running stack: a moving vehicle, its course, shapes on an image, and ground truth.
pub(crate) fn driving() -> Frame {
    let classes = classes_to_json(&OBSTACLE_CLASSES);
    let labels = [("rcs.role", "labels"), ("rcs.overlay_of", "/camera/image"), (CLASSES, &*classes)];
    let truth = [labels[0], labels[1], ("rcs.ground_truth", "true")];
    let on_image = [("rcs.overlay_of", "/camera/image")];
    let mut topics = vec![
        with_metadata(topic("/camera/image", 5.0, 0.1, image(96, 64)), "camera", &[("rcs.role", "image")]),
        with_metadata(topic("/obstacles/labels", 5.0, 0.3, label_image(48, 32)), "obstacles", &labels),
        with_metadata(topic("/color/shapes", 5.0, 0.1, shapes()), "color", &on_image),
        with_metadata(topic("/camera/ground_truth_labels", 5.0, 0.1, label_image(48, 32)), "camera", &truth),
        with_metadata(topic("/wm1/map", 5.0, 0.2, grid(40, 40)), "wm1", &[("rcs.role", "map")]),
        with_metadata(
            topic("/vehicle/ground_truth_map", 0.1, 3.0, grid(80, 80)),
            "vehicle",
            &[("rcs.ground_truth", "true")],
        ),
        with_metadata(topic("/vehicle/goal", 1.0, 0.3, goal()), "vehicle", &[("rcs.role", "goal")]),
        with_metadata(
            topic("/generator/driven", 0.1, 5.0, mission()),
            "generator",
            &[("rcs.role", "mission")],
        ),
        topic("/planner/plan", 4.0, 0.2, plan()),
        topic("/follower/arcs", 20.0, 0.05, arcs()),
        topic("/camera/points", 5.0, 0.1, cloud(&[[1.0, 2.0, 0.1]])),
        topic("/localization/local", 50.0, 0.01, pose_on_track(125)),
        topic("/vehicle/run", 5.0, 0.1, run()),
        topic("/vehicle_interface/vehicle", 50.0, 0.02, status()),
        topic("/vehicle_interface/params", 0.0, 12.0, SpeedLimit { max_speed_mps: 1.0 }),
        topic("/operator/teleop", 20.0, 0.04, command()),
        topic("/runtime/timing", 1.0, 0.4, timing()),
        Topic::new("/operator/emergency_stop", RunTag::FIRST, Arc::clone(schema_of::<EmergencyStop>())),
    ];
    topics.sort_by(|a, b| a.name.cmp(&b.name));
    let port = |name: &str, buffer: &str, schema: &Schema, role: &str| PortInfo {
        name: name.into(),
        buffer: buffer.into(),
        schema: schema.name().into(),
        role: role.into(),
        ..PortInfo::default()
    };
    let vehicle_interface = ProcessInfo {
        name: "vehicle_interface".into(),
        supervisor: "viewer".into(),
        period_ns: 20_000_000,
        // Any message with the options of parameters will do.
        params_buffer: "/vehicle_interface/params".into(),
        inputs: vec![
            port("drive", "/driver/drive", schema_of::<DriveCommand>(), ""),
            port("teleop", "/operator/teleop", schema_of::<DriveCommand>(), "teleoperation"),
            port("stop", "/operator/emergency_stop", schema_of::<EmergencyStop>(), "emergency_stop"),
            port("mission", "/operator/mission", schema_of::<Mission>(), "mission"),
            port("examples", "/operator/training", schema_of::<TrainingExample>(), "training"),
        ],
        ..ProcessInfo::default()
    };
    let driver = ProcessInfo {
        name: "driver".into(),
        supervisor: "viewer".into(),
        period_ns: 100_000_000,
        outputs: vec![port("drive", "/driver/drive", schema_of::<DriveCommand>(), "")],
        ..ProcessInfo::default()
    };
    let tracks = [track("/localization/local", "local", 0.1), track("/vehicle/goal", "local", 0.0)];
    let nothing = empty();
    let info = SourceInfo { kind: SourceKind::Stack, end: None, ..(*nothing.info).clone() };
    let mut playback = nothing.playback.clone();
    (playback.playing, playback.achieved) = (true, Some(0.98));
    Frame {
        info: Arc::new(info),
        now: NOW,
        topics: topics.into(),
        processes: [vehicle_interface, driver].into(),
        tracks: tracks.into(),
        events: Arc::new([events()]),
        runs: Runs { is_at_end: true, ..Runs::default() },
        playback,
        ..nothing
    }
}

/// One event of each kind, in the past and in the future.
fn events() -> Events {
    let lines = [
        (9.0, EventKind::Command, EventLevel::Info, "planner", "RUN (3)"),
        (7.5, EventKind::Mode, EventLevel::Info, "planner", "EXEC · RUN · drives along the path"),
        (4.0, EventKind::Error, EventLevel::Warning, "stereo", "1 input not used: the images differ in size"),
        (2.0, EventKind::Bumper, EventLevel::Warning, "/vehicle/status", "bumper hit, left"),
        (1.0, EventKind::Operator, EventLevel::Info, "/operator/teleop", "drives by hand"),
        (0.5, EventKind::Error, EventLevel::Error, "driver", "ERROR · RUN · no pose for 2 s"),
        (-3.0, EventKind::Log, EventLevel::Info, "camera", "exposure is 12 ms"),
    ];
    let event = |(age_s, kind, level, source, text): (f64, _, _, &str, &str)| Event {
        stamp: rcs_msg::Stamp((NOW.0 as f64 - age_s * 1e9) as u64),
        kind,
        level,
        source: source.into(),
        text: text.into(),
    };
    Events::of(RunTag::FIRST, lines.map(event))
}

/// A process that has time, and one that has not.
fn timing() -> Timing {
    let process = |process: &str, mean_us: f64, max_us: f64, overruns: u64| ProcessTiming {
        process: process.into(),
        cycles: 4_200,
        mean_us,
        max_us,
        overruns,
        wake_late_mean_us: mean_us * 0.2,
        ..ProcessTiming::default()
    };
    let processes =
        vec![process("vehicle_interface", 1_840.0, 7_300.0, 0), process("driver", 86_000.0, 131_000.0, 17)];
    Timing { processes, ..Timing::default() }
}

fn run() -> CourseRun {
    CourseRun {
        course: "meadow".into(),
        time_s: 42.34,
        time_limit_s: 240.0,
        distance_m: 37.2,
        remaining_m: 63.9,
        bumper_hits: 1,
        slip_s: 0.4,
        ..CourseRun::default()
    }
}

fn status() -> VehicleStatus {
    VehicleStatus {
        speed_mps: 0.94,
        yaw_rate_radps: 0.38,
        roll_rad: -0.02,
        pitch_rad: 0.05,
        wanted_speed_mps: 1.0,
        refused: 2,
        max_speed_mps: 1.3,
        max_yaw_rate_radps: 1.2,
        last_refusal: "speed of 9 m/s; expected at most 1.3".into(),
        ..VehicleStatus::default()
    }
}

fn command() -> DriveCommand {
    DriveCommand { speed_mps: 1.0, yaw_rate_radps: Some(0.4), ..DriveCommand::default() }
}

/// Two goals, of which the first has been reached, an area, and a zone with a notch.
fn mission() -> Mission {
    let points = |at: &[(f64, f64)]| at.iter().map(|&(x_m, y_m)| PlanePoint { x_m, y_m }).collect();
    let polygon = |at: &[(f64, f64)]| PlanePolygon { points: points(at) };
    Mission {
        frame_id: "local".to_owned(),
        goals: points(&[(-3.0, -2.0), (9.0, 4.0)]),
        area: Some(polygon(&[(-7.0, -7.0), (11.0, -7.0), (11.0, 7.0), (-7.0, 7.0)])),
        keep_out: vec![polygon(&[(3.0, -6.0), (7.0, -6.0), (7.0, -2.5), (5.0, -4.5), (3.0, -2.5)])],
        reached: 1,
        ..Mission::default()
    }
}

fn goal() -> PoseInFrame {
    let position = Some(Vector3 { x: 60.0, y: 25.0, z: 0.0 });
    let pose = Some(rcs_msg::foxglove::Pose { position, orientation: None });
    PoseInFrame { frame_id: "local".into(), pose, ..PoseInFrame::default() }
}

fn shapes() -> ImageAnnotations {
    let point = |x: f64, y: f64| Point2 { x, y };
    let points = |kind: Type, points: Vec<Point2>| PointsAnnotation {
        r#type: kind.into(),
        points,
        outline_color: Some(Color { r: 1.0, g: 0.9, b: 0.1, a: 1.0 }),
        thickness: 1.0,
        ..PointsAnnotation::default()
    };
    let corners = vec![point(30.0, 60.0), point(42.0, 40.0), point(54.0, 40.0), point(66.0, 60.0)];
    let mut filled = points(Type::LineLoop, corners.clone());
    filled.fill_color = Some(Color { r: 1.0, g: 0.9, b: 0.1, a: 0.2 });
    ImageAnnotations {
        points: vec![
            filled,
            points(Type::LineStrip, vec![point(0.0, 32.0), point(95.0, 33.0)]),
            points(Type::LineList, vec![point(2.0, 2.0), point(8.0, 2.0), point(f64::NAN, 0.0)]),
            points(Type::Points, corners),
        ],
        circles: vec![CircleAnnotation {
            position: Some(point(80.0, 12.0)),
            diameter: 10.0,
            thickness: 1.0,
            ..CircleAnnotation::default()
        }],
        texts: vec![TextAnnotation {
            position: Some(point(30.0, 38.0)),
            text: "ground sample".into(),
            font_size: 6.0,
            ..TextAnnotation::default()
        }],
        ..ImageAnnotations::default()
    }
}
