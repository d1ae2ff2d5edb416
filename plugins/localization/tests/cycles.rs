//! Whole cycles: readings of sensors that cannot be, and what becomes of the estimates.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use rcs_geom::Pose;
use rcs_localization::Localization;
use rcs_localization::proto::LocalizationParams;
use rcs_msg::foxglove::{KeyValuePair, LocationFix, Odometry, Quaternion, Vector3, location_fix};
use rcs_msg::{AnyMessage, Payload, Stamp, rcs};
use rcs_runtime::{ExternalEvent, ProcessType};
use rcs_sense::{pose_message, pose_of};
use rcs_testkit::bench::{Bench, Setup};
use std::f64::consts::FRAC_PI_2;

const STACK: &str = r#"
format = 1
name = "localization"

[[process]]
name = "localization"
plugin = "localization"
supervisor = "viewer"

[process.inputs]
encoders = "/operator/encoders"
imu = "/operator/imu"
gps = "/operator/gps"
"#;

/// A fix at latitude 39° this far north of there, m.
fn fix(north_m: f64, variance_m2: f64) -> LocationFix {
    let mut position_covariance = vec![0.0; 9];
    for axis in [0, 4, 8] {
        position_covariance[axis] = variance_m2;
    }
    LocationFix {
        latitude: 39.0 + north_m / 111_000.0,
        longitude: -77.0,
        position_covariance,
        position_covariance_type: location_fix::PositionCovarianceType::Known.into(),
        ..LocationFix::default()
    }
}

fn imu(turn_radps: f64) -> rcs::Imu {
    rcs::Imu {
        angular_velocity: Some(Vector3 { z: turn_radps, ..Vector3::default() }),
        linear_acceleration: Some(Vector3 { z: 9.81, ..Vector3::default() }),
        ..rcs::Imu::default()
    }
}

/// Stands for 2 s with ten good fixes.
fn standing() -> Bench {
    let mut bench = Setup::new(STACK, &[ProcessType::of::<Localization>()]).bench();
    bench.cycles(20, 1);
    for cycle in 0..100 {
        if cycle % 10 == 5 {
            bench.write("/operator/gps", fix(0.0, 1.0));
        }
        stand(&mut bench, imu(0.0));
    }
    assert_eq!(bench.faults("localization").0, 0);
    bench
}

fn stand(bench: &mut Bench, imu: rcs::Imu) {
    bench.write("/operator/encoders", rcs::WheelEncoders::default());
    bench.write("/operator/imu", imu);
    bench.cycles(20, 1);
}

/// Writes a message with this acquisition time.
fn sense<T: Payload>(bench: &mut Bench, buffer: &str, time: Stamp, message: T) {
    bench.session.write(ExternalEvent::sensed(buffer, time, AnyMessage::new(message))).unwrap();
}

fn start() -> Bench {
    Setup::new(STACK, &[ProcessType::of::<Localization>()]).bench()
}

/// Encoders of a vehicle that has rolled straight ahead.
fn rolled(way_m: f64) -> rcs::WheelEncoders {
    rcs::WheelEncoders { left_m: way_m, right_m: way_m, ..rcs::WheelEncoders::default() }
}

/// An inertial reading with a compass.
fn heading(yaw_rad: f64) -> rcs::Imu {
    rcs::Imu { orientation: pose_message(&Pose::from_yaw(yaw_rad)).orientation, ..imu(0.0) }
}

/// North, m, and heading, rad.
fn estimate(bench: &Bench, buffer: &str) -> [f64; 2] {
    let odometry: Odometry = bench.latest(buffer);
    let pose = pose_of(odometry.pose.as_ref(), &odometry.frame_id).unwrap();
    [pose.translation.y, pose.yaw()]
}

#[test]
fn a_fix_with_an_absurd_variance_is_a_fault_and_changes_nothing() {
    let mut bench = standing();
    let before = estimate(&bench, "/localization/global");
    for variance_m2 in [f64::MAX, 1e9, -1.0, f64::NAN] {
        bench.write("/operator/gps", fix(50.0, variance_m2));
        for _ in 0..10 {
            stand(&mut bench, imu(0.0));
        }
    }
    assert_eq!(bench.faults("localization").0, 4);
    assert_eq!(estimate(&bench, "/localization/global"), before);
}

#[test]
fn an_absurd_turn_rate_is_a_fault_and_does_not_turn_the_vehicle() {
    let mut bench = standing();
    let before = estimate(&bench, "/localization/local");
    for turn_radps in [100.0, 1e160, f64::NAN] {
        stand(&mut bench, imu(turn_radps));
        stand(&mut bench, imu(0.0));
    }
    assert_eq!(bench.faults("localization").0, 3);
    assert_eq!(estimate(&bench, "/localization/local"), before);
}

#[test]
fn a_fix_that_is_repeated_or_comes_too_late_is_a_fault_and_does_not_pull_the_estimate() {
    let mut bench = standing();
    let now_ns = bench.now_ms * 1_000_000;
    let before = estimate(&bench, "/localization/global");
    // 3 m away, by a receiver that repeats its fix of 2 s ago, and by one that is 4.6 s behind.
    let late = |bench: &mut Bench, time_ns: u64| {
        let message = AnyMessage::new(fix(3.0, 1.0));
        bench.session.write(ExternalEvent::sensed("/operator/gps", Stamp(time_ns), message)).unwrap();
    };
    late(&mut bench, now_ns);
    stand(&mut bench, imu(0.0));
    let once = estimate(&bench, "/localization/global");
    assert_ne!(once, before);
    for _ in 0..30 {
        late(&mut bench, now_ns);
        stand(&mut bench, imu(0.0));
    }
    assert_eq!(bench.faults("localization").0, 30);
    for _ in 0..200 {
        stand(&mut bench, imu(0.0));
    }
    for step in 0..100 {
        late(&mut bench, now_ns + step * 20_000_000);
        stand(&mut bench, imu(0.0));
    }
    let (count, text) = bench.faults("localization");
    assert!(count == 130 && text.contains(" s old, expected at most 2 s"), "{count} {text}");
    assert_eq!(estimate(&bench, "/localization/global"), once);
}

#[test]
fn a_position_that_stands_still_for_want_of_encoders_is_not_sent() {
    let no_distance = || rcs::WheelEncoders { left_m: f64::NAN, left_mps: 1.0, ..Default::default() };
    let old = Stamp(1_000_000_000);
    let stated = || rcs::WheelEncoders { timestamp: Some(Stamp(1).to_proto()), ..rolled(0.0) };
    for what in ["silent", "no number", "an old time", "repeated"] {
        let mut bench = standing();
        let mut without = |cycles: u64| {
            for _ in 0..cycles {
                match what {
                    "no number" => bench.write("/operator/encoders", no_distance()),
                    "repeated" => bench.write("/operator/encoders", stated()),
                    "an old time" => sense(&mut bench, "/operator/encoders", old, rolled(0.0)),
                    _ => {}
                }
                bench.write("/operator/imu", imu(0.0));
                bench.cycles(20, 1);
            }
            ["local", "global", "transforms"].map(|output| bench.sent(&format!("/localization/{output}")))
        };
        let before = without(20);
        let held = without(10);
        assert!(held[0] > before[0], "{what}: for half a second it goes on");
        assert_eq!(without(50), held, "{what}");
        let text = bench.latest::<rcs::Status>("/localization/status").state_text;
        assert!(text.contains("no encoders, the positions stand still"), "{what}: {text}");
        stand(&mut bench, imu(0.0));
        stand(&mut bench, imu(0.0));
        assert!(bench.sent("/localization/local") > held[0], "{what}: they are back");
    }
    // Encoders that never come.
    let mut bench = start();
    for _ in 0..100 {
        bench.write("/operator/imu", imu(0.0));
        bench.cycles(20, 1);
    }
    let sent = bench.sent("/localization/local");
    assert!((20..30).contains(&sent), "{sent}");
}

#[test]
fn a_fix_without_a_position_is_a_fault_and_does_not_place_the_origin() {
    let nowhere = LocationFix { latitude: 0.0, longitude: 0.0, ..fix(0.0, 1.0) };
    let metadata = |status: &str| vec![KeyValuePair { key: "status".to_owned(), value: status.to_owned() }];
    let cases = [
        (1, LocationFix { metadata: metadata("-1"), ..nowhere.clone() }),
        (1, LocationFix { position_covariance: vec![f64::NAN; 9], ..nowhere.clone() }),
        (1, LocationFix { metadata: metadata("-1"), ..fix(50.0, 1.0) }),
        (1, LocationFix { metadata: metadata("-2"), ..fix(50.0, 1.0) }),
        // A place like others, until the next fix does not agree with it.
        (0, nowhere),
    ];
    for (faults, bad) in cases {
        let mut bench = start();
        bench.cycles(20, 1);
        stand(&mut bench, imu(0.0));
        bench.write("/operator/gps", bad);
        stand(&mut bench, imu(0.0));
        for _ in 0..5 {
            bench.write("/operator/gps", fix(0.0, 1.0));
            for _ in 0..10 {
                stand(&mut bench, imu(0.0));
            }
        }
        let (count, text) = bench.faults("localization");
        assert_eq!(count, faults, "{text}");
        let [north_m, _] = estimate(&bench, "/localization/global");
        assert!(north_m.abs() < 0.01, "{north_m}");
    }
}

#[test]
fn a_run_that_begins_at_speed_gets_its_position_from_one_fix_a_second() {
    let mut bench = start();
    bench.cycles(20, 1);
    for cycle in 0..200 {
        // North at 12 m/s.
        let way_m = 12.0 * 0.02 * f64::from(cycle);
        if cycle % 50 == 5 {
            bench.write("/operator/gps", fix(way_m, 0.0004));
        }
        bench.write("/operator/encoders", rolled(way_m));
        bench.write("/operator/imu", heading(FRAC_PI_2));
        bench.cycles(20, 1);
    }
    assert!(bench.newest::<Odometry>("/localization/global").is_some());
}

#[test]
fn fixes_without_altitude_place_the_vehicle_and_leave_its_height_alone() {
    let fly = |altitudes_m: [f64; 2]| {
        let mut bench = start();
        bench.cycles(20, 1);
        for altitude in altitudes_m {
            for _ in 0..5 {
                bench.write("/operator/gps", LocationFix { altitude, ..fix(0.0, 1.0) });
                for _ in 0..10 {
                    stand(&mut bench, imu(0.0));
                }
            }
        }
        assert_eq!(bench.faults("localization"), (0, String::new()));
        let odometry: Odometry = bench.latest("/localization/global");
        pose_of(odometry.pose.as_ref(), &odometry.frame_id).unwrap().translation.z
    };
    // The antenna is 1 m above the vehicle.
    let cases = [([f64::NAN; 2], 0.0), ([31.0, f64::NAN], 30.0), ([f64::NAN, 31.0], 30.0)];
    for (altitudes_m, expected_m) in cases {
        let height_m = fly(altitudes_m);
        assert!((height_m - expected_m).abs() < 0.01, "{altitudes_m:?}: {height_m}");
    }
}

#[test]
fn what_is_rolled_and_turned_while_halted_is_followed() {
    let mut bench = standing();
    let say = |bench: &mut Bench, serial: u64, name: &str| {
        let command = rcs::Command { serial, name: name.to_owned(), ..Default::default() };
        bench.write("/localization/command", command);
    };
    let move_on = |bench: &mut Bench, way_m: f64, turn_radps: f64| {
        bench.write("/operator/encoders", rolled(way_m));
        bench.write("/operator/imu", imu(turn_radps));
        bench.cycles(20, 1);
    };
    say(&mut bench, 2, "HALT");
    // A quarter turn to the left within a second, then 1 m ahead: to the north.
    (0..50).for_each(|_| move_on(&mut bench, 0.0, std::f64::consts::FRAC_PI_2));
    (1..=50).for_each(|step| move_on(&mut bench, 0.02 * f64::from(step), 0.0));
    let status: rcs::Status = bench.latest("/localization/status");
    assert_eq!((status.state(), status.state_text.as_str()), (rcs::ProcessState::Done, "halted"));
    let [north_m, _] = estimate(&bench, "/localization/local");
    assert!((north_m - 1.0).abs() < 0.02, "{north_m}");
    say(&mut bench, 3, "RUN");
    move_on(&mut bench, 1.0, 0.0);
    let [north_m, _] = estimate(&bench, "/localization/local");
    assert!((north_m - 1.0).abs() < 0.02, "{north_m}");
}

/// A vehicle that has stood for four seconds, heading north, and drives ahead at 1 m/s.
struct Drive {
    bench: Bench,
    way_m: f64,
    /// What the inertial sensor tells, if there is one.
    imu: Option<rcs::Imu>,
}

impl Drive {
    fn start(imu: Option<rcs::Imu>, input_timeout_s: &str) -> Drive {
        let params =
            [("localization.start_heading_deg", "90"), ("localization.input_timeout_s", input_timeout_s)];
        let bench = Setup::new(STACK, &[ProcessType::of::<Localization>()]).params(&params).bench();
        let mut drive = Drive { bench, way_m: 0.0, imu };
        drive.bench.cycles(20, 1);
        drive.stand(200);
        drive
    }

    /// Stands, or drives on, for a number of cycles of 20 ms.
    fn stand(&mut self, cycles: u32) {
        for _ in 0..cycles {
            self.bench.write("/operator/encoders", rolled(self.way_m));
            if let Some(imu) = &self.imu {
                self.bench.write("/operator/imu", imu.clone());
            }
            self.bench.cycles(20, 1);
        }
    }

    fn on(&mut self, cycles: u32, has_fixes: bool) {
        for cycle in 0..cycles {
            self.way_m += 0.02;
            if has_fixes && cycle % 10 == 5 {
                self.bench.write("/operator/gps", fix(self.way_m, 1.0));
            }
            self.stand(1);
        }
    }

    fn order(&mut self, name: &str) {
        let serial = 100 + self.bench.now_ms;
        let command = rcs::Command { serial, name: name.to_owned(), ..rcs::Command::default() };
        self.bench.write("/localization/command", command);
    }

    /// How far north of where the vehicle has driven both estimates are, m, and the standard deviation of the global one, m.
    fn off_m(&self) -> [f64; 3] {
        let off_m = |buffer: &str| estimate(&self.bench, buffer)[0] - self.way_m;
        let global: Odometry = self.bench.latest("/localization/global");
        [off_m("/localization/local"), off_m("/localization/global"), global.pose_covariance[7].sqrt()]
    }

    /// Pitch and heading in the local frame, rad.
    fn pitch_and_yaw(&self) -> [f64; 2] {
        let odometry: Odometry = self.bench.latest("/localization/local");
        let [_, pitch, yaw] = pose_of(odometry.pose.as_ref(), "vehicle").unwrap().rpy();
        [pitch, yaw]
    }
}

#[test]
fn after_init_both_frames_go_on_with_fixes_and_without_and_without_inertial_sensors() {
    for (imu, input_timeout_s) in [(Some(imu(0.0)), "0.5"), (None, "0.5"), (None, "1.5")] {
        for has_fixes in [true, false] {
            let mut drive = Drive::start(imu.clone(), input_timeout_s);
            drive.on(1000, true);
            drive.on(50, has_fixes);
            let before = drive.off_m();
            let sent = drive.bench.sent("/localization/local");
            drive.order("INIT");
            drive.on(10, has_fixes);
            assert_eq!(drive.bench.sent("/localization/local"), sent, "it is sent from RUN on");
            drive.order("RUN");
            drive.on(100, has_fixes);
            let after = drive.off_m();
            let changed_m = [0, 1, 2].map(|at| (after[at] - before[at]).abs());
            assert!(changed_m[0] < 0.1, "{before:?} {after:?}");
            assert!(changed_m.iter().all(|&changed_m| changed_m < 0.3), "{before:?} {after:?}");
            let [_, yaw_rad] = drive.pitch_and_yaw();
            assert!((yaw_rad - FRAC_PI_2).abs() < 0.01, "{yaw_rad}");
            assert_eq!(drive.bench.faults("localization"), (0, String::new()));
        }
    }
}

#[test]
fn after_init_the_bias_of_the_gyro_is_known_and_a_vehicle_that_brakes_is_level() {
    let mut drive = Drive::start(Some(imu(0.05)), "0.5");
    drive.on(50, false);
    let braking = Vector3 { x: -1.0, z: 9.81, ..Vector3::default() };
    drive.imu = Some(rcs::Imu { linear_acceleration: Some(braking), ..imu(0.05) });
    drive.order("INIT");
    drive.on(2, false);
    drive.imu = Some(imu(0.05));
    drive.order("RUN");
    drive.on(10, false);
    let [pitch_rad, _] = drive.pitch_and_yaw();
    assert!(pitch_rad.abs() < 0.02, "{pitch_rad}");
    drive.on(200, false);
    let [_, yaw_rad] = drive.pitch_and_yaw();
    assert!((yaw_rad - FRAC_PI_2).abs() < 0.02, "{yaw_rad}");
}

#[test]
fn where_nothing_followed_the_vehicle_before_init_its_position_is_hardly_known_until_there_is_a_fix() {
    for inertial in [Some(imu(0.0)), None] {
        let mut drive = Drive::start(inertial, "0.5");
        drive.on(1000, true);
        // As after a panic.
        drive.bench.cycles(20, 100);
        drive.order("INIT");
        drive.on(30, false);
        drive.order("RUN");
        drive.on(10, false);
        let [local_m, global_m, deviation_m] = drive.off_m();
        assert!(local_m.abs() < 0.3 && global_m.abs() < 0.5 && deviation_m > 5.0, "{:?}", drive.off_m());
        drive.on(50, true);
        let [local_m, global_m, deviation_m] = drive.off_m();
        assert!(local_m.abs() < 0.3 && global_m.abs() < 0.5 && deviation_m < 4.0, "{:?}", drive.off_m());
    }
}

#[test]
fn a_vehicle_that_was_carried_before_init_has_the_first_heading_that_can_be_used() {
    let mut drive = Drive::start(Some(heading(FRAC_PI_2)), "0.5");
    drive.on(500, true);
    drive.bench.cycles(20, 100);
    drive.order("INIT");
    drive.imu = Some(rcs::Imu { orientation: Some(Quaternion::default()), ..imu(0.0) });
    drive.stand(5);
    drive.imu = Some(heading(1.0));
    drive.order("RUN");
    drive.stand(5);
    let [_, yaw_rad] = drive.pitch_and_yaw();
    assert!((yaw_rad - 1.0).abs() < 1e-6, "{yaw_rad}");
    assert!(drive.off_m()[0].abs() < 0.1, "the local frame goes on");
}

#[test]
fn with_another_heading_at_the_start_the_estimates_begin_anew_by_init() {
    let mut drive = Drive::start(Some(imu(0.0)), "0.5");
    drive.on(100, false);
    let params: LocalizationParams = drive.bench.latest("/localization/params");
    drive.bench.write("/localization/params", LocalizationParams { start_heading_deg: 0.0, ..params });
    drive.order("INIT");
    drive.stand(5);
    drive.order("RUN");
    drive.stand(5);
    let [north_m, yaw_rad] = estimate(&drive.bench, "/localization/local");
    assert!(north_m.abs() < 0.01 && yaw_rad.abs() < 0.01, "{north_m} {yaw_rad}");
}

#[test]
fn an_inertial_sensor_that_begins_late_gives_the_heading_at_the_start() {
    for (moved_m, expected_rad) in [(0.0, 1.0), (1.0, 0.0)] {
        let mut bench = start();
        bench.cycles(20, 1);
        for step in 0..100 {
            bench.write("/operator/encoders", rolled(moved_m * f64::from(step) / 99.0));
            bench.cycles(20, 1);
        }
        bench.write("/operator/encoders", rolled(moved_m));
        bench.write("/operator/imu", heading(1.0));
        bench.cycles(20, 2);
        let [_, yaw_rad] = estimate(&bench, "/localization/local");
        assert!((yaw_rad - expected_rad).abs() < 1e-6, "{moved_m} m: {yaw_rad}");
    }
}

/// An inertial reading whose orientation was never set.
fn unset_orientation(turn_radps: f64) -> rcs::Imu {
    rcs::Imu { orientation: Some(Quaternion::default()), ..imu(turn_radps) }
}

#[test]
fn an_orientation_that_cannot_be_used_is_a_fault_once_and_gyros_and_accelerometers_count() {
    for compass_time_s in ["0", "20"] {
        let params =
            [("localization.start_heading_deg", "90"), ("localization.compass_time_s", compass_time_s)];
        let mut bench = Setup::new(STACK, &[ProcessType::of::<Localization>()]).params(&params).bench();
        bench.cycles(20, 1);
        for _ in 0..50 {
            stand(&mut bench, unset_orientation(0.0));
        }
        let [_, yaw_rad] = estimate(&bench, "/localization/local");
        assert!((yaw_rad - std::f64::consts::FRAC_PI_2).abs() < 1e-6, "{compass_time_s}: {yaw_rad}");
        for _ in 0..50 {
            stand(&mut bench, unset_orientation(0.5));
        }
        let [_, yaw_rad] = estimate(&bench, "/localization/local");
        assert!((yaw_rad - std::f64::consts::FRAC_PI_2 - 0.5).abs() < 0.02, "{compass_time_s}: {yaw_rad}");
        let (count, text) = bench.faults("localization");
        assert!(count == 1 && text.contains("imu: orientation: "), "{compass_time_s}: {count} {text}");
    }
}

#[test]
fn an_orientation_that_comes_before_the_vehicle_moves_gives_the_heading_at_the_start() {
    for (moved_m, expected_rad) in [(0.0, 1.0), (1.0, 0.0)] {
        let mut bench = start();
        bench.cycles(20, 1);
        for step in 0..100 {
            bench.write("/operator/encoders", rolled(moved_m * f64::from(step) / 99.0));
            bench.write("/operator/imu", unset_orientation(0.0));
            bench.cycles(20, 1);
        }
        for _ in 0..2 {
            bench.write("/operator/encoders", rolled(moved_m));
            bench.write("/operator/imu", heading(1.0));
            bench.cycles(20, 1);
        }
        let [_, yaw_rad] = estimate(&bench, "/localization/local");
        assert!((yaw_rad - expected_rad).abs() < 1e-6, "{moved_m} m: {yaw_rad}");
    }
}

#[test]
fn a_reading_from_the_future_does_not_block_those_after_it() {
    let mut bench = standing();
    let hour = Stamp(3_600_000_000_000);
    sense(&mut bench, "/operator/encoders", hour, rolled(0.0));
    sense(&mut bench, "/operator/imu", hour, imu(0.0));
    sense(&mut bench, "/operator/gps", hour, fix(0.0, 1.0));
    bench.cycles(20, 1);
    let sent: Odometry = bench.latest("/localization/local");
    let time = sent.timestamp.as_ref().and_then(Stamp::from_proto).unwrap();
    assert!(time <= Stamp(bench.now_ms * 1_000_000), "{time:?}");
    for step in 1..=50 {
        bench.write("/operator/encoders", rolled(0.02 * f64::from(step)));
        bench.write("/operator/imu", imu(0.0));
        if step % 10 == 0 {
            bench.write("/operator/gps", fix(0.0, 100.0));
        }
        bench.cycles(20, 1);
    }
    assert_eq!(bench.faults("localization"), (0, String::new()));
    let odometry: Odometry = bench.latest("/localization/local");
    let pose = pose_of(odometry.pose.as_ref(), &odometry.frame_id).unwrap();
    assert!((pose.translation.x - 1.0).abs() < 0.02, "{}", pose.translation);
}

#[test]
fn the_estimates_begin_anew_when_the_clocks_of_encoders_and_inertial_sensor_have_both_begun_again() {
    let mut bench = start();
    bench.cycles(20, 600);
    // Gives a way of the wheels by both clocks, ms. Returns how far east the estimate is, m, and the number of faults.
    let mut drive = |way_m: f64, encoders_ms: u64, imu_ms: u64| {
        let stamp = |ms: u64| Stamp(ms * 1_000_000);
        sense(&mut bench, "/operator/encoders", stamp(encoders_ms), rolled(way_m));
        sense(&mut bench, "/operator/imu", stamp(imu_ms), heading(0.0));
        bench.cycles(20, 1);
        let odometry: Option<Odometry> = bench.newest("/localization/local");
        let pose = odometry.map(|odometry| pose_of(odometry.pose.as_ref(), "local").unwrap());
        (pose.map_or(0.0, |pose| pose.translation.x), bench.faults("localization"))
    };
    let mut last = (0.0, (0, String::new()));
    for step in 0..50_u32 {
        last = drive(0.02 * f64::from(step), 11_000 + 20 * u64::from(step), 11_000 + 20 * u64::from(step));
    }
    let (before_m, faults) = last.clone();
    assert!(before_m > 0.8 && faults.0 == 0, "{before_m}: {faults:?}");
    // With the encoders alone, turns would count twice.
    for step in 0..10_u32 {
        last = drive(5.0 + 0.02 * f64::from(step), 500 + 20 * u64::from(step), 12_000 + 20 * u64::from(step));
    }
    assert_eq!((last.0, last.1.0), (before_m, 10));
    for step in 0..20_u32 {
        last = drive(0.02 * f64::from(step), 700 + 20 * u64::from(step), 700 + 20 * u64::from(step));
    }
    // Of the second pair of readings on.
    assert!((0.3..0.37).contains(&last.0), "{last:?}");
    let why = "the clocks of the sensors have begun again; the estimates begin anew";
    assert_eq!(last.1, (13, why.to_owned()));
}
