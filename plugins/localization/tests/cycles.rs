//! Whole cycles: readings of sensors that cannot be, and what becomes of the estimates.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use rcs_localization::Localization;
use rcs_msg::foxglove::{LocationFix, Odometry, Vector3, location_fix};
use rcs_msg::{AnyMessage, Stamp, rcs};
use rcs_runtime::{ExternalEvent, ProcessType};
use rcs_sense::pose_of;
use rcs_testkit::bench::{Bench, Setup};

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
