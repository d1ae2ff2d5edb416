//! Motion by images on the simulated vehicle: told within centimetres also where its wheels slip, so that the local estimate
//! knows how far the vehicle has moved; and images that cannot be used.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use rcs_msg::foxglove::{CameraCalibration, Odometry, RawImage};
use rcs_msg::{AnyMessage, Stamp, rcs};
use rcs_plugins::all;
use rcs_runtime::{Asset, Assets, ExternalEvent, RunOptions};
use rcs_sense::pose_of;
use rcs_testkit::bench::{Bench, Setup};

/// Grass, and from 6 m ahead of the vehicle on 8 m of mud in which it gets on at about half the speed of its wheels.
const WORLD: &str = r#"
name = "field"
bounds_m = [[0, 0], [100, 100]]
base = "short_grass"

[origin]
zone = 32
easting_m = 500000.0
northing_m = 5400000.0

[surface.mud]
traction = 0.34
rolling_resistance = 0.16
slip_at_limit = 0.7

[[paint]]
surface = "mud"
polygon = [[36, 40], [44, 40], [44, 60], [36, 60]]
"#;

const STACK: &str = r#"
format = 1
name = "field"

[[process]]
name = "vehicle"
plugin = "sim_vehicle"
supervisor = "viewer"
inputs = { wheels = "/operator/wheels" }
params = { world = "w", vehicle = "lagr", start_east_m = 30.0, start_north_m = 50.0 }

[[process]]
name = "localization"
plugin = "localization"
supervisor = "viewer"
inputs = { encoders = "/vehicle/encoders", imu = "/vehicle/imu", visual_motion = "/visual_motion/motion" }
params = { world = "w", track_m = 0.58, rolling_slip = 0.025, tilt_time_s = 5.0 }

[[process]]
name = "front_left"
plugin = "sim_cameras"
supervisor = "viewer"
inputs = { ground_truth_state = "/vehicle/ground_truth_state" }
params = { world = "w", vehicle = "lagr", pair = "front_left", ground_truth = false }

[[process]]
name = "stereo"
plugin = "stereo"
supervisor = "viewer"
params = { disparities = 48 }

[process.inputs]
left = "/front_left/left"
right = "/front_left/right"
left_calibration = "/front_left/left_calibration"
right_calibration = "/front_left/right_calibration"

[[process]]
name = "visual_motion"
plugin = "visual_motion"
supervisor = "viewer"

[process.inputs]
image = "/stereo/rectified"
depth = "/stereo/depth"
calibration = "/stereo/calibration"
odometry = "/localization/local"
static_transforms = "/vehicle/static_transforms"

[buffers."/vehicle/imu"]
queue = 16

[buffers."/vehicle/encoders"]
queue = 8

[buffers."/operator/wheels"]
queue = 8
"#;

struct Files;

impl Assets for Files {
    fn read(&self, kind: &str, name: &str, _beside: &str) -> Result<Asset, String> {
        let text = match kind {
            "world" => WORLD,
            _ => include_str!("../../../assets/vehicles/lagr.toml"),
        };
        Ok(Asset { file: name.to_owned(), text: text.to_owned() })
    }
}

/// True and estimated distance from the start, m, after driving with both wheels at these speeds for so many steps of
/// 100 ms each, and the motions that were told, each with the true one, m.
fn drive(stack: &str, legs: &[(f64, u64)]) -> ([f64; 2], Vec<[f64; 2]>) {
    let options = RunOptions { seed: 3, ..RunOptions::default() };
    let mut bench = Setup::new(stack, all()).assets(&Files).options(options).bench();
    let (mut told, mut last, mut truths) = (Vec::new(), None, vec![truth_m(&bench)]);
    for &(speed_mps, tenths) in legs {
        for _ in 0..tenths {
            let timestamp = Some(Stamp(bench.now_ms * 1_000_000).to_proto());
            let (left_mps, right_mps) = (speed_mps, speed_mps);
            let command = rcs::WheelCommand { timestamp, left_mps, right_mps, curvature_per_m: 0.0 };
            bench.write("/operator/wheels", command);
            bench.advance(100);
            truths.push(truth_m(&bench));
            let motion: Option<rcs::VisualMotion> = bench.newest("/visual_motion/motion");
            let Some(motion) = motion.filter(|motion| motion.timestamp != last) else { continue };
            last = motion.timestamp;
            // The truth at the step of 100 ms in which the image was taken, or between two.
            let at = |stamp: Option<&_>| {
                let tenths = stamp.and_then(Stamp::from_proto).unwrap().0 as f64 / 1e8;
                let (step, part) = (tenths as usize, tenths % 1.0);
                let after = truths.get(step + 1).copied().unwrap_or(truths[step]);
                truths[step] + (after - truths[step]) * part
            };
            told.push([motion.forward_m, at(motion.timestamp.as_ref()) - at(motion.since.as_ref())]);
        }
    }
    let local: Odometry = bench.latest("/localization/local");
    let local_m = pose_of(local.pose.as_ref(), "vehicle").unwrap().translation.truncate().length();
    ([truth_m(&bench), local_m], told)
}

fn truth_m(bench: &Bench) -> f64 {
    let truth: Option<Odometry> = bench.newest("/vehicle/ground_truth_pose");
    truth.map_or(0.0, |truth| pose_of(truth.pose.as_ref(), "vehicle").unwrap().translation.x - 30.0)
}

#[test]
fn images_tell_the_motion_of_a_vehicle_whose_wheels_slip() {
    // Through half of the mud, back a little, and out of it.
    let legs = [(0.0, 5), (1.2, 80), (0.0, 10), (-0.5, 20), (1.2, 80), (0.0, 10)];
    let ([true_m, local_m], told) = drive(STACK, &legs);
    assert!(told.len() > 90, "{} motions", told.len());
    let mut errors: Vec<f64> = told.iter().map(|[told, truth]| (told - truth).abs()).collect();
    errors.sort_by(f64::total_cmp);
    let worst = errors[errors.len() * 19 / 20];
    assert!(worst < 0.02, "95 % are within {worst:.3} m");
    let unseen = STACK.replace(", visual_motion = \"/visual_motion/motion\"", "");
    let [_, unseen_m] = drive(&unseen, &legs).0;
    assert!(unseen_m > true_m + 2.0, "by the wheels {unseen_m:.2} m instead of {true_m:.2} m");
    assert!((local_m - true_m).abs() < 0.3, "{local_m:.2} m instead of {true_m:.2} m");
}

/// `visual_motion` alone, on a vehicle that stands.
fn standing() -> Bench {
    let begin = STACK.find("[[process]]\nname = \"visual_motion\"").unwrap();
    let process = &STACK[begin..STACK.find("[buffers.").unwrap()];
    let mount = "mount = { fixed = true, height_m = 1.0, pitch_deg = 20.0 }";
    let params = format!("params = {{ pose = {{ source = \"POSE_FIXED\" }}, {mount} }}\n[process.inputs]");
    let stack = format!("format = 1\nname = \"one\"\n{process}")
        .replace("[process.inputs]", &params)
        .replace(
            "odometry = \"/localization/local\"\nstatic_transforms = \"/vehicle/static_transforms\"\n",
            "",
        )
        .replace("/stereo/", "/operator/");
    Setup::new(&stack, all()).bench()
}

/// Of a camera with 64×48 pixels.
fn calibration() -> CameraCalibration {
    let k = vec![60.0, 0.0, 31.5, 0.0, 60.0, 23.5, 0.0, 0.0, 1.0];
    CameraCalibration { width: 64, height: 48, k, d: vec![], ..CameraCalibration::default() }
}

#[test]
fn images_that_cannot_be_used_are_faults_and_tell_nothing() {
    let mut bench = standing();
    let mut give = |width: u32, encoding: &str, calibrated: bool| {
        let timestamp = Some(Stamp(bench.now_ms * 1_000_000).to_proto());
        let image = |encoding: &str, bytes: usize| RawImage {
            timestamp,
            width,
            height: 48,
            encoding: encoding.to_owned(),
            step: width * bytes as u32,
            data: vec![60; width as usize * 48 * bytes].into(),
            ..RawImage::default()
        };
        if calibrated {
            bench.write("/operator/calibration", calibration());
        }
        bench.write("/operator/rectified", image("mono8", 1));
        bench.write("/operator/depth", image(encoding, 2));
        bench.advance(100);
        (bench.faults("visual_motion"), bench.sent("/visual_motion/motion"))
    };
    for (number, (width, encoding, calibrated, expected)) in [
        (64, "16UC1", false, "no calibration"),
        (32, "16UC1", true, "has [32, 48] pixels"),
        (64, "yuyv", true, "yuyv"),
    ]
    .into_iter()
    .enumerate()
    {
        let ((faults, last), sent) = give(width, encoding, calibrated);
        assert!(faults == number as u64 + 1 && last.contains(expected), "{faults} {last}");
        assert_eq!(sent, 0);
    }
    for _ in 0..3 {
        let ((faults, last), sent) = give(64, "16UC1", true);
        assert_eq!((faults, sent), (3, 0), "an even grey tells nothing: {last}");
    }
}

#[test]
fn an_image_that_comes_later_than_its_depth_tells_the_motion_and_one_that_never_comes_is_a_fault_once() {
    let mut bench = standing();
    let image = |encoding: &str, data: Vec<u8>| {
        let (width, height, step) = (64, 48, data.len() as u32 / 48);
        let (encoding, data) = (encoding.to_owned(), data.into());
        AnyMessage::new(RawImage { width, height, step, encoding, data, ..RawImage::default() })
    };
    let noise = (0..64 * 48_u32).map(|pixel| {
        let hash = pixel.wrapping_mul(0x9e37_79b1);
        ((hash ^ (hash >> 15)).wrapping_mul(0x2c1b_3c6d) >> 24) as u8
    });
    let grey = image("mono8", noise.collect());
    let depth = image("16UC1", 2000_u16.to_le_bytes().repeat(64 * 48));
    let sense = |bench: &mut Bench, buffer: &str, time_ms: u64, message: &AnyMessage| {
        let event = ExternalEvent::sensed(buffer, Stamp(time_ms * 1_000_000), message.clone());
        bench.session.write(event).unwrap();
    };
    bench.write("/operator/calibration", calibration());
    bench.advance(100);
    for _ in 0..3 {
        let time_ms = bench.now_ms;
        sense(&mut bench, "/operator/depth", time_ms, &depth);
        bench.advance(50);
        sense(&mut bench, "/operator/rectified", time_ms + 1, &grey);
        bench.advance(50);
    }
    assert_eq!(bench.faults("visual_motion"), (0, String::new()));
    assert_eq!(bench.sent("/visual_motion/motion"), 2);
    let motion: rcs::VisualMotion = bench.latest("/visual_motion/motion");
    assert!(motion.forward_m.abs() < 0.006 && motion.left_m.abs() < 0.006, "{motion:?}");
    for _ in 0..30 {
        let time_ms = bench.now_ms;
        sense(&mut bench, "/operator/depth", time_ms, &depth);
        bench.advance(100);
    }
    let (faults, last) = bench.faults("visual_motion");
    assert!(faults == 1 && last.contains("s apart, expected at most 0.002 s"), "{faults} {last}");
}
