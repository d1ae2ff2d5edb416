//! Acceptance test of the colour models in simulation: while driving along the mulch path, they separate it from grass.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use rcs_color::proto::ColorStats;
use rcs_geom::{DVec2, DVec3, PinholeCamera, Pose};
use rcs_metrics::Confusion;
use rcs_msg::foxglove::{CameraCalibration, FrameTransforms, Odometry, RawImage};
use rcs_msg::rcs::{DriveCommand, Status};
use rcs_msg::{Payload, Stamp, image::depth_m};
use rcs_plugins::all;
use rcs_runtime::{
    Asset, Assets, Cycle, In, NoCommands, Out, Plan, PlanOptions, PortBuilder, Process, ProcessDef,
    ProcessType, Role, RunOptions, StackFile, Stepped,
};
use rcs_sense::{FrameNames, Localizer, pose_of};
use rcs_world::{OBSTACLE_COST, UNKNOWN_COST};
use rcs_world_model::proto::WorldModelParams;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

const STACK: &str = r#"
format = 1
name = "color_course"

[[process]]
name = "vehicle"
plugin = "sim_vehicle"
supervisor = "viewer"
inputs = { wheels = "/vehicle_interface/wheels" }
params = { world = "mulch_path", vehicle = "lagr", start_east_m = 10.0, start_north_m = 45.0 }

[[process]]
name = "driver"
plugin = "path_follower"
supervisor = "viewer"
inputs = { ground_truth_pose = "/vehicle/ground_truth_pose" }

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
params = { world = "mulch_path", vehicle = "lagr", pair = "front_left" }

[[process]]
name = "front_right"
plugin = "sim_cameras"
supervisor = "viewer"
inputs = { ground_truth_state = "/vehicle/ground_truth_state" }
params = { world = "mulch_path", vehicle = "lagr", pair = "front_right" }

[[process]]
name = "color_left"
plugin = "color_models"
supervisor = "viewer"
period_ms = 50.0

[process.inputs]
image = "/front_left/left"
calibration = "/front_left/left_calibration"
odometry = "/localization/local"
static_transforms = "/vehicle/static_transforms"

[[process]]
name = "color_right"
plugin = "color_models"
supervisor = "viewer"
period_ms = 50.0

[process.inputs]
image = "/front_right/left"
calibration = "/front_right/left_calibration"
odometry = "/localization/local"
static_transforms = "/vehicle/static_transforms"

[buffers."/vehicle/imu"]
queue = 16

[buffers."/vehicle/encoders"]
queue = 8
"#;

/// Centre line of the mulch path, as in the world file, m.
const PATH: [[f64; 2]; 10] = [
    [4.0, 45.0],
    [16.0, 45.0],
    [28.0, 52.0],
    [42.0, 50.0],
    [54.0, 40.0],
    [68.0, 37.0],
    [80.0, 45.0],
    [92.0, 51.0],
    [102.0, 46.0],
    [114.0, 45.0],
];

/// Follows [`PATH`] by the true pose. It stands in for a driver that knows the way.
#[derive(Clone, Serialize, Deserialize)]
struct PathFollower;

struct Ports {
    ground_truth_pose: In<Odometry>,
    drive: Out<DriveCommand>,
}

impl Process for PathFollower {
    type Params = WorldModelParams;
    type Ports = Ports;
    type Command = NoCommands;
    const DEF: ProcessDef = ProcessDef {
        plugin: "path_follower",
        summary: "Drives along the mulch path",
        period_ms: 50.0,
        latency_ms: 0.0,
        reads_ground_truth: true,
    };

    fn ports(b: &mut PortBuilder) -> Ports {
        Ports {
            ground_truth_pose: b.input("ground_truth_pose", "true pose"),
            drive: b.output("drive", "command").role(Role::Command).build(),
        }
    }

    fn new(_params: &WorldModelParams) -> Self {
        PathFollower
    }

    fn cycle(&mut self, ports: &Ports, _params: &WorldModelParams, cx: &mut Cycle<'_>) {
        let Some(odometry) = cx.latest(&ports.ground_truth_pose) else { return };
        let at = pose_of(odometry.pose.as_ref(), "").unwrap().translation.truncate();
        let to = ahead(at, 2.0) - at;
        let heading_rad = libm::atan2(to.y, to.x);
        let timestamp = Some(cx.now().to_proto());
        let command = DriveCommand { timestamp, heading_rad, speed_mps: 1.0, yaw_rate_radps: None };
        cx.write(&ports.drive, cx.now(), command);
        cx.exec("drives");
    }
}

/// The point of the path this far beyond the point nearest to `at`, m.
fn ahead(at: DVec2, distance_m: f64) -> DVec2 {
    let points: Vec<DVec2> = PATH
        .windows(2)
        .flat_map(|ends| {
            let [from, to] = [DVec2::from_array(ends[0]), DVec2::from_array(ends[1])];
            let steps = (from.distance(to) / 0.1) as usize;
            (0..steps).map(move |i| from.lerp(to, i as f64 / steps as f64))
        })
        .collect();
    let nearest =
        (0..points.len()).min_by(|&i, &j| points[i].distance(at).total_cmp(&points[j].distance(at)));
    points[(nearest.unwrap() + (distance_m / 0.1) as usize).min(points.len() - 1)]
}

/// The files named by the stack.
struct Files;

impl Assets for Files {
    fn read(&self, kind: &str, name: &str, _beside: &str) -> Result<Asset, String> {
        let text = match (kind, name) {
            ("world", "mulch_path") => include_str!("../../../assets/worlds/mulch_path.toml"),
            ("vehicle", "lagr") => include_str!("../../../assets/vehicles/lagr.toml"),
            _ => return Err(format!("no {kind} {name:?}")),
        };
        Ok(Asset { file: name.to_owned(), text: text.to_owned() })
    }
}

fn latest<T: Payload>(run: &Stepped, buffer: &str) -> Option<T> {
    run.bus().get(buffer)?.latest()?.message.to()
}

/// Classes of pixels.
const GRASS: usize = 0;
const PATH_CLASS: usize = 1;

const SHORT_GRASS: u8 = 1;
const TALL_WEEDS: u8 = 3;
const MULCH: u8 = 4;
const FAR_M: f64 = 8.0;

/// Counts the pixels of a camera's newest image that show mulch or grass within 8 m of the vehicle.
fn count(run: &Stepped, side: &str, counts: &mut Confusion<2>) {
    let pair = format!("/front_{side}");
    let predicted_costs: RawImage = latest(run, &format!("/color_{side}/probability")).unwrap();
    let class: RawImage = latest(run, &format!("{pair}/ground_truth_class")).unwrap();
    let depth: RawImage = latest(run, &format!("{pair}/ground_truth_depth")).unwrap();
    if predicted_costs.timestamp != class.timestamp || predicted_costs.timestamp != depth.timestamp {
        return;
    }
    let (camera, vehicle_from_camera) = (camera(run, &pair), mount(run, &class.frame_id));
    let depth = depth_m(&depth, 1.0).unwrap();
    for row in 0..class.height {
        for column in 0..class.width {
            let code = class.data[(row * class.step + column) as usize];
            if !(SHORT_GRASS..=TALL_WEEDS).contains(&code) && code != MULCH {
                continue;
            }
            let ray = camera.unproject(DVec2::new(f64::from(column), f64::from(row))).unwrap();
            let range = f64::from(depth[(row * class.width + column) as usize]);
            let place: DVec3 = vehicle_from_camera * (ray * range);
            if range.is_nan() || place.truncate().length() > FAR_M {
                continue;
            }
            let at = (row * predicted_costs.height / class.height) * predicted_costs.step
                + column * predicted_costs.width / class.width;
            let predicted = match predicted_costs.data[at as usize] {
                UNKNOWN_COST => None,
                OBSTACLE_COST.. => Some(GRASS),
                _ => Some(PATH_CLASS),
            };
            counts.add(if code == MULCH { PATH_CLASS } else { GRASS }, predicted);
        }
    }
}

fn camera(run: &Stepped, pair: &str) -> PinholeCamera {
    let calibration: CameraCalibration = latest(run, &format!("{pair}/left_calibration")).unwrap();
    let (model, d) = (&calibration.distortion_model, &calibration.d);
    PinholeCamera::from_calibration([calibration.width, calibration.height], &calibration.k, model, d)
        .unwrap()
}

fn mount(run: &Stepped, frame: &str) -> Pose {
    let transforms: FrameTransforms = latest(run, "/vehicle/static_transforms").unwrap();
    let mut localizer = Localizer::default();
    localizer.add_static_transforms(&transforms).unwrap();
    let names = FrameNames { local: "local", vehicle: "vehicle", pose: "" };
    localizer.lookup(names.vehicle, frame, Stamp(0), 0.0).unwrap()
}

#[test]
fn the_mulch_path_is_told_from_grass_within_8_m_after_10_s_of_driving() {
    let plugins: Vec<ProcessType> =
        all().iter().copied().chain([ProcessType::of::<PathFollower>()]).collect();
    let options = PlanOptions { overrides: &[], course: None, assets: &Files };
    let plan = Plan::with(StackFile::parse("color_course", STACK).unwrap(), &plugins, &options).unwrap();
    let mut run = Stepped::new(Arc::new(plan), None, RunOptions::default()).unwrap();
    run.begin().unwrap();
    let (start, mut counts, mut last) = (run.start(), Confusion::default(), [None, None]);
    for step in 0..320_u64 {
        run.run_until(start.after_ns((step + 1) * 50_000_000)).unwrap();
        for (side, last) in ["left", "right"].into_iter().zip(&mut last) {
            let Some(stats) = latest::<ColorStats>(&run, &format!("/color_{side}/stats")) else { continue };
            if *last != stats.timestamp && step >= 200 {
                count(&run, side, &mut counts);
            }
            *last = stats.timestamp;
        }
    }
    for side in ["left", "right"] {
        let status: Status = latest(&run, &format!("/color_{side}/status")).unwrap();
        println!("{side}: {} faults, {}", status.faults, status.last_fault);
        let stats: ColorStats = latest(&run, &format!("/color_{side}/stats")).unwrap();
        println!("{stats:?}");
    }
    let iou = counts.iou(PATH_CLASS).unwrap();
    let unclassified_pct = 100.0 * counts.unclassified_share().unwrap();
    println!(
        "intersection over union {iou:.3}, {unclassified_pct:.2} % of {} pixels unclassified",
        counts.total()
    );
    assert!(counts.total() > 1_000_000, "{counts:?}");
    assert!(iou >= 0.85, "intersection over union {iou:.3}");
}
