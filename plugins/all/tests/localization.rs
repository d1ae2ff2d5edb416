//! The localization estimates on the simulated vehicle, compared with ground truth.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use rcs_geom::{DVec3, Pose, wrap_angle};
use rcs_msg::foxglove::{FrameTransforms, Odometry};
use rcs_msg::{Stamp, rcs};
use rcs_plugins::all;
use rcs_runtime::{Asset, Assets, RunOptions};
use rcs_sense::pose_of;
use rcs_testkit::bench::{Bench, Setup};

/// Nearly level dirt, 140 m by 100 m.
const WORLD: &str = r#"
name = "field"
bounds_m = [[0, 0], [140, 100]]
base = "dirt"

[origin]
zone = 32
easting_m = 500000.0
northing_m = 5400000.0

[[undulation]]
wavelength_m = 15
amplitude_m = 0.1
"#;

const STACK: &str = r#"
format = 1
name = "field"

[[process]]
name = "vehicle"
plugin = "sim_vehicle"
supervisor = "viewer"
inputs = { wheels = "/operator/wheels" }
params = { world = "w", vehicle = "lagr", start_east_m = 30.0, start_north_m = 50.0, start_heading_deg = 20.0 }

[[process]]
name = "localization"
plugin = "localization"
supervisor = "viewer"
inputs = { encoders = "/vehicle/encoders", imu = "/vehicle/imu", gps = "/vehicle/gps" }
params = { world = "w", track_m = 0.58 }

[buffers."/vehicle/imu"]
queue = 16

[buffers."/vehicle/encoders"]
queue = 8

[buffers."/operator/wheels"]
queue = 8
"#;

/// Mud without grip 18 m ahead of the vehicle.
const MUD: &str = r#"
[surface.mud]
traction = 0.05
rolling_resistance = 0.16

[[paint]]
surface = "mud"
polygon = [[48, 40], [70, 40], [70, 80], [48, 80]]
"#;

/// Mud in which a vehicle gets on at about half the speed of its wheels.
const SOFT_MUD: &str = r#"
[surface.mud]
traction = 0.34
rolling_resistance = 0.16
slip_at_limit = 0.7

[[paint]]
surface = "mud"
polygon = [[48, 40], [60, 40], [60, 80], [48, 80]]
"#;

/// Slip of the wheels.
const SLIP: &str = r#"
[[process]]
name = "proximity"
plugin = "proximity"
supervisor = "viewer"
inputs = { encoders = "/vehicle/encoders", imu = "/vehicle/imu", odometry = "/localization/local", static_transforms = "/vehicle/static_transforms" }
params = { track_m = 0.58 }
"#;

struct Files;

impl Assets for Files {
    fn read(&self, kind: &str, name: &str, _beside: &str) -> Result<Asset, String> {
        let text = match kind {
            "world" if name == "mud" => {
                return Ok(Asset { file: name.to_owned(), text: format!("{WORLD}{MUD}") });
            }
            "world" if name == "soft_mud" => {
                return Ok(Asset { file: name.to_owned(), text: format!("{WORLD}{SOFT_MUD}") });
            }
            "world" => WORLD,
            _ => include_str!("../../../assets/vehicles/lagr.toml"),
        };
        Ok(Asset { file: name.to_owned(), text: text.to_owned() })
    }
}

/// Estimated and true pose of the vehicle.
#[derive(Clone, Copy, Debug)]
struct Seen {
    local: Pose,
    global: Option<Pose>,
    global_variance: f64,
    truth: Pose,
}

fn start(seed: u64, params: &[(&str, &str)]) -> Bench {
    let options = RunOptions { seed, ..RunOptions::default() };
    Setup::new(STACK, all()).params(params).assets(&Files).options(options).bench()
}

/// Drives for `tenths` steps of 100 ms; returns the estimate after each.
fn drive(bench: &mut Bench, left_mps: f64, right_mps: f64, tenths: u64) -> Vec<Seen> {
    (0..tenths)
        .map(|_| {
            let timestamp = Some(Stamp(bench.now_ms * 1_000_000).to_proto());
            let command = rcs::WheelCommand { timestamp, left_mps, right_mps, curvature_per_m: 0.0 };
            bench.write("/operator/wheels", command);
            bench.advance(100);
            seen(bench)
        })
        .collect()
}

fn seen(bench: &Bench) -> Seen {
    let local: Odometry = bench.latest("/localization/local");
    let global: Option<Odometry> = bench.newest("/localization/global");
    let truth: Odometry = bench.latest("/vehicle/ground_truth_pose");
    let pose = |odometry: &Odometry| pose_of(odometry.pose.as_ref(), "vehicle").unwrap();
    Seen {
        local: pose(&local),
        global: global.as_ref().map(pose),
        global_variance: global.map_or(0.0, |global| global.pose_covariance[0]),
        truth: pose(&truth),
    }
}

fn status(bench: &Bench) -> rcs::Status {
    bench.latest("/localization/status")
}

/// A loop of about 90 m with turns in both directions.
fn lap(bench: &mut Bench) -> Vec<Seen> {
    let mut seen = drive(bench, 0.0, 0.0, 20);
    for (left, right, tenths) in [(1.0, 1.0, 200), (0.8, 1.1, 150), (1.1, 0.9, 250), (1.2, 1.2, 200)] {
        seen.extend(drive(bench, left, right, tenths));
    }
    seen
}

/// True position in the frame of the local estimate, which starts at the vehicle and is aligned with east.
fn local_truth(truth: &Pose) -> DVec3 {
    truth.translation - DVec3::new(30.0, 50.0, 0.0)
}

#[test]
fn the_local_estimate_is_smooth_and_drifts_by_a_few_per_cent_of_the_way() {
    for seed in 0..3 {
        let mut bench = start(seed, &[]);
        let seen = lap(&mut bench);
        for pair in seen.windows(2) {
            let step = (pair[1].local.translation - pair[0].local.translation).length();
            assert!(step < 0.2, "{step} m in a tenth of a second");
        }
        let last = seen.last().unwrap();
        let way_m: f64 = seen
            .windows(2)
            .map(|pair| (pair[1].truth.translation - pair[0].truth.translation).length())
            .sum();
        assert!(way_m > 75.0, "{way_m}");
        let error_m = (last.local.translation - local_truth(&last.truth)).truncate().length();
        assert!(error_m < 0.06 * way_m, "seed {seed}: {error_m:.2} m after {way_m:.0} m");
        let [roll, pitch, _] = last.local.rpy();
        let [true_roll, true_pitch, _] = last.truth.rpy();
        assert!((roll - true_roll).abs() < 0.03 && (pitch - true_pitch).abs() < 0.03);
    }
}

#[test]
fn the_global_estimate_stays_within_what_its_covariance_says() {
    let mut surprises = Vec::new();
    for seed in 0..4 {
        let mut bench = start(seed, &[]);
        let seen = lap(&mut bench);
        for now in seen.iter().skip(100).step_by(50) {
            let global = now.global.expect("there is a global estimate after 10 s");
            let error = (global.translation - now.truth.translation).truncate();
            surprises.push(error.length_squared() / (2.0 * now.global_variance));
            assert!(error.length() < 6.0, "seed {seed}: {} m", error.length());
            let turn = wrap_angle(global.yaw() - now.truth.yaw());
            assert!(turn.abs() < 0.2, "seed {seed}: heading is {turn} rad off");
        }
    }
    let mean = surprises.iter().sum::<f64>() / surprises.len() as f64;
    // Consecutive errors are correlated, so their mean is only roughly 1.
    assert!((0.2..2.5).contains(&mean), "squared error by its variance: {mean}");
}

#[test]
fn outliers_are_refused_and_do_not_move_the_global_estimate() {
    let params = [("vehicle.gps_dropouts", "false")];
    let mut bench = start(5, &params);
    let seen = lap(&mut bench);
    let status = status(&bench);
    assert!(status.faults > 0 && status.last_fault.contains("outlier"), "{status:?}");
    for pair in seen.windows(2).skip(50) {
        let (Some(a), Some(b)) = (pair[0].global, pair[1].global) else { continue };
        let jump = (b.translation - a.translation).length();
        assert!(jump < 1.0, "{jump} m in a tenth of a second");
    }
}

#[test]
fn without_fixes_the_global_estimate_goes_on_by_dead_reckoning_and_says_so() {
    let mut bench = start(1, &[("vehicle.gps_dropouts", "false")]);
    drive(&mut bench, 0.0, 0.0, 300);
    let params: rcs_sim::proto::SimVehicleParams = bench.latest("/vehicle/params");
    bench.write("/vehicle/params", rcs_sim::proto::SimVehicleParams { gps_off: true, ..params });
    let before = *drive(&mut bench, 0.0, 0.0, 1).last().unwrap();
    let after = *drive(&mut bench, 1.0, 1.0, 200).last().unwrap();
    assert!(status(&bench).state_text.contains("dead reckoning"), "{:?}", status(&bench).state_text);
    let error = |seen: &Seen| (seen.global.unwrap().translation - seen.truth.translation).truncate();
    let grown = (error(&after) - error(&before)).length();
    assert!(grown < 3.0, "the error grew by {grown} m in 20 m");
    assert!(after.global_variance > before.global_variance, "it knows that it knows less");
}

#[test]
fn the_local_frame_in_the_global_one_is_what_both_estimates_say() {
    let mut bench = start(2, &[]);
    let seen = *drive(&mut bench, 0.6, 0.9, 150).last().unwrap();
    let transforms: FrameTransforms = bench.latest("/localization/transforms");
    let transform = &transforms.transforms[0];
    assert_eq!((transform.parent_frame_id.as_str(), transform.child_frame_id.as_str()), ("global", "local"));
    let (t, q) = (transform.translation.as_ref().unwrap(), transform.rotation.as_ref().unwrap());
    let global_from_local = Pose::from_parts([t.x, t.y, t.z], [q.x, q.y, q.z, q.w]).unwrap();
    let global = seen.global.unwrap();
    // The global estimate may be 100 ms older.
    assert!((global_from_local * seen.local).translation.abs_diff_eq(global.translation, 0.15));
    assert!(wrap_angle((global_from_local * seen.local).yaw() - global.yaw()).abs() < 0.1);
    assert!(q.x.abs() < 1e-12 && q.y.abs() < 1e-12, "both frames are level");
}

#[test]
fn slipping_wheels_take_the_local_estimate_too_far_and_not_the_global_one() {
    let mut bench = start(3, &[("vehicle.traction_scale", "0.06"), ("vehicle.gps_outliers", "false")]);
    drive(&mut bench, 0.0, 0.0, 100);
    drive(&mut bench, 1.2, 1.2, 600);
    let seen = drive(&mut bench, 1.2, 1.2, 600);
    let last = seen.last().unwrap();
    let way = |pose: &Pose, start: DVec3| (pose.translation - start).truncate().length();
    let (believed, driven) = (way(&last.local, DVec3::ZERO), local_truth(&last.truth).truncate().length());
    assert!(believed > driven + 50.0, "believed {believed} m, driven {driven} m");
    let error = (last.global.unwrap().translation - last.truth.translation).truncate().length();
    // The wheel odometry contradicts the fixes throughout, so they are refused until enough of them agree to restart
    // the estimate: at full speed five seconds outside of the gate.
    assert!(error < 15.0, "global error {error} m");
}

#[test]
fn an_estimate_that_is_told_of_slip_counts_little_of_what_spinning_wheels_turn() {
    let options = RunOptions { seed: 4, ..RunOptions::default() };
    let mut error_m = Vec::new();
    let told = STACK.replace("gps =", "slip = \"/proximity/slip\", gps =") + SLIP;
    for stack in [STACK.to_owned(), told] {
        let params = [("vehicle.world", "mud"), ("localization.tilt_time_s", "5")];
        let setup = Setup::new(&stack, all()).params(&params).assets(&Files);
        let mut bench = setup.options(options.clone()).bench();
        drive(&mut bench, 0.0, 0.0, 50);
        let driven = drive(&mut bench, 1.2, 1.2, 140);
        let stuck = drive(&mut bench, 1.2, 1.2, 80);
        let [before, after] = [driven, stuck].map(|seen| *seen.last().unwrap());
        let error = |seen: &Seen| (seen.local.translation - local_truth(&seen.truth)).truncate();
        assert!((after.truth.translation - before.truth.translation).length() < 4.0, "it is stuck");
        error_m.push((error(&after) - error(&before)).length());
    }
    let [without, with] = error_m[..] else { panic!("two stacks") };
    assert!(without > 6.0, "without being told, it believes the wheels: {without:.2} m");
    assert!(with < 0.5 * without, "{with:.2} m, {without:.2} m without being told");
}

#[test]
fn what_wheels_roll_too_far_in_mud_is_taken_off_the_local_estimate_by_the_fixes() {
    let mut drifted_m = Vec::new();
    for stack in [STACK.replace(", gps = \"/vehicle/gps\"", ""), STACK.to_owned()] {
        let params = [("vehicle.world", "soft_mud"), ("localization.tilt_time_s", "5")];
        let options = RunOptions { seed: 5, ..RunOptions::default() };
        let mut bench = Setup::new(&stack, all()).params(&params).assets(&Files).options(options).bench();
        drive(&mut bench, 0.0, 0.0, 50);
        let firm = drive(&mut bench, 1.2, 1.2, 140);
        let through = drive(&mut bench, 1.2, 1.2, 360);
        let [before, after] = [firm, through].map(|seen| *seen.last().unwrap());
        let way_m = after.truth.translation.distance(before.truth.translation);
        assert!((20.0..38.0).contains(&way_m), "through the mud, and with slip: {way_m} m");
        let error = |seen: &Seen| (seen.local.translation - local_truth(&seen.truth)).truncate();
        drifted_m.push((error(&after) - error(&before)).length());
    }
    let [without, with] = drifted_m[..] else { panic!("two stacks") };
    assert!(without > 5.0, "without fixes, it believes the wheels: {without:.2} m");
    assert!(with < 0.4 * without, "{with:.2} m, {without:.2} m without fixes");
}

#[test]
fn position_fixes_tell_slip_that_lasts() {
    let params = [("vehicle.world", "mud"), ("localization.tilt_time_s", "5")];
    let stack = STACK.replace("gps =", "slip = \"/proximity/slip\", gps =") + SLIP;
    let mut bench = Setup::new(&stack, all()).params(&params).assets(&Files).bench();
    drive(&mut bench, 0.0, 0.0, 50);
    let mut told = |tenths: u64| -> Vec<f64> {
        let report = |bench: &Bench| bench.newest::<rcs::WaySlip>("/localization/way_slip");
        let seconds = (0..tenths).filter_map(|_| {
            drive(&mut bench, 1.2, 1.2, 1);
            report(&bench).map(|report| report.slip)
        });
        seconds.collect()
    };
    let firm = told(140);
    assert!(firm.len() > 80 && firm.iter().all(|&slip| slip < 0.25), "{firm:?}");
    let stuck = told(140);
    assert!(stuck.last().is_some_and(|&slip| slip > 0.7), "{stuck:?}");
}

#[test]
fn a_report_of_slip_counts_while_it_is_recent_and_an_unusable_one_is_a_fault() {
    let stack = STACK.replace("gps =", "slip = \"/operator/slip\", gps =");
    let mut bench = Setup::new(&stack, all()).assets(&Files).bench();
    drive(&mut bench, 0.0, 0.0, 20);
    drive(&mut bench, 1.0, 1.0, 30);
    let way_m = |seen: &[Seen]| (seen[9].local.translation - seen[0].local.translation).length();
    let mut told = Vec::new();
    for _ in 0..10 {
        let timestamp = Some(Stamp(bench.now_ms * 1_000_000).to_proto());
        let report = rcs::SlipReport { timestamp, slip: 0.8, inertial_speed_mps: 0.2, ..Default::default() };
        bench.write("/operator/slip", report);
        told.extend(drive(&mut bench, 1.0, 1.0, 1));
    }
    assert!((way_m(&told) - 0.18).abs() < 0.03, "{}", way_m(&told));
    drive(&mut bench, 1.0, 1.0, 3);
    let silent = drive(&mut bench, 1.0, 1.0, 10);
    assert!((way_m(&silent) - 0.9).abs() < 0.06, "{}", way_m(&silent));
    bench.write("/operator/slip", rcs::SlipReport { slip: f64::NAN, ..Default::default() });
    bench.advance(100);
    let (faults, last) = bench.faults("localization");
    assert!(faults > 0 && last.contains("slip: slip NaN"), "{faults} {last}");
}

#[test]
fn motion_by_images_counts_where_the_wheels_slip_and_an_unusable_one_is_a_fault() {
    let stack = STACK.replace("gps =", "visual_motion = \"/operator/motion\", gps =");
    let mut bench = Setup::new(&stack, all()).assets(&Files).bench();
    drive(&mut bench, 0.0, 0.0, 20);
    drive(&mut bench, 1.0, 1.0, 30);
    let tell = |bench: &mut Bench, forward_m: f64, since_ms: u64| {
        let since = Some(Stamp(since_ms * 1_000_000).to_proto());
        let timestamp = Some(Stamp(bench.now_ms * 1_000_000).to_proto());
        let motion = rcs::VisualMotion { timestamp, since, forward_m, ..Default::default() };
        bench.write("/operator/motion", motion);
        drive(bench, 1.0, 1.0, 2)
    };
    // Each shows half of the wheels' way of 0.2 s.
    let mut told = Vec::new();
    for _ in 0..20 {
        let since_ms = bench.now_ms - 200;
        told.extend(tell(&mut bench, 0.1, since_ms));
    }
    let way_m = (told[39].local.translation - told[19].local.translation).length();
    assert!((way_m - 1.0).abs() < 0.05, "{way_m}");
    let cases =
        [(0.1, 0, "does not begin before it ends"), (f64::NAN, 200, "moved NaN m"), (9.0, 200, "moved 9 m")];
    for (forward_m, before_ms, expected) in cases {
        let since_ms = bench.now_ms - before_ms;
        tell(&mut bench, forward_m, since_ms);
        let (_, last) = bench.faults("localization");
        assert!(last.contains("visual motion") && last.contains(expected), "{last}");
    }
}
