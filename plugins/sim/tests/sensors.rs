//! The simple sensors compared with their parameters in the vehicle file.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

mod common;

use common::{Counter, lagr};
use glam::DVec3;
use rcs_geom::Pose;
use rcs_sim::sensors::{Encoders, Gps, GpsFix, GpsSwitches, Inertial};
use rcs_testkit::golden::Trace;

#[test]
fn at_rest_the_attitude_is_that_of_the_vehicle() {
    let spec = lagr().inertial;
    let mut rng = Counter(1);
    let mut sensor = Inertial::new(&spec, &mut rng);
    let truth = Pose::from_rpy(DVec3::ZERO, 0.2, -0.3, 1.0);
    let force = truth.rotation.conjugate() * (DVec3::Z * 9.81);
    let reading = sensor.measure(&spec, DVec3::ZERO, force, truth.yaw(), false, &mut rng);
    let [roll, pitch, yaw] = reading.orientation.rpy();
    assert!((roll - 0.2).abs() < 1e-9 && (pitch + 0.3).abs() < 1e-9 && (yaw - 1.0).abs() < 1e-9);
}

#[test]
fn noise_is_what_the_vehicle_file_says() {
    let spec = lagr().inertial;
    let mut rng = Counter(2);
    let mut sensor = Inertial::default();
    let force = DVec3::Z * 9.81;
    let readings: Vec<f64> = (0..20_000)
        .map(|_| sensor.measure(&spec, DVec3::ZERO, force, 0.0, true, &mut rng).force_mps2.x)
        .collect();
    let mean = readings.iter().sum::<f64>() / readings.len() as f64;
    let variance = readings.iter().map(|x| (x - mean) * (x - mean)).sum::<f64>() / readings.len() as f64;
    assert!((variance.sqrt() / spec.accel_noise_mps2 - 1.0).abs() < 0.03, "{}", variance.sqrt());
}

#[test]
fn the_errors_of_a_sensor_can_be_switched_during_a_run() {
    let mut rng = Counter(3);
    let mut spec = lagr().inertial;
    (spec.gyro_noise_radps, spec.gyro_walk_radps) = (0.0, 0.0);
    (spec.accel_noise_mps2, spec.heading_noise_rad) = (0.0, 0.0);
    let mut inertial = Inertial::new(&spec, &mut rng);
    let force = DVec3::Z * 9.81;
    let mut read = |noise| inertial.measure(&spec, DVec3::ZERO, force, 0.5, noise, &mut rng);
    let [ideal, biased] = [false, true].map(&mut read);
    assert_eq!((ideal.turn_radps, ideal.force_mps2), (DVec3::ZERO, force));
    assert!((ideal.orientation.yaw() - 0.5).abs() < 1e-9);
    assert!(biased.turn_radps.length() > 0.0 && biased.force_mps2 != force);
    assert!((biased.orientation.yaw() - 0.5).abs() > 1e-9);
    assert_eq!([false, true].map(read), [ideal, biased], "the biases are those drawn at the start");

    let spec = lagr().encoders;
    let mut encoders = Encoders::new(&spec, &mut Counter(4));
    // A kilometre in each interval of 1000 steps, 10 s.
    let mut read = |noise, interval: u64| {
        let rolled_m = 1000.0 * interval as f64;
        encoders.measure(&spec, [rolled_m; 2], 1000 * interval, noise).speed_mps[0]
    };
    let is_ideal = |speed_mps: f64| (speed_mps - 100.0).abs() <= 1.01 * spec.tick_m / 10.0;
    assert!(is_ideal(read(false, 1)), "without errors");
    assert!(is_ideal(read(true, 2)), "what was rolled before the switch stays");
    let speed_mps = read(true, 3);
    assert!(!is_ideal(speed_mps) && (speed_mps - 100.0).abs() <= 100.0 * spec.scale_error, "{speed_mps}");
    assert!(!is_ideal(read(false, 4)), "rolled before the switch");
    assert!(is_ideal(read(false, 5)), "without errors again");
}

const ALL: GpsSwitches = GpsSwitches { noise: true, outliers: true, dropouts: true };
const NONE: GpsSwitches = GpsSwitches { noise: false, outliers: false, dropouts: false };

fn fixes(count: usize, trees: usize, switches: GpsSwitches) -> Vec<Option<GpsFix>> {
    let spec = lagr().gps;
    let mut rng = Counter(7);
    let mut gps = Gps::new(&spec, &mut rng);
    (0..count).map(|_| gps.measure(&spec, DVec3::ZERO, trees, switches, &mut rng)).collect()
}

#[test]
fn without_errors_the_fix_is_the_antenna() {
    assert!(fixes(10_000, 0, NONE).iter().all(|fix| fix.is_some_and(|fix| fix.position == DVec3::ZERO)));
}

#[test]
fn errors_have_the_deviation_of_the_vehicle_file() {
    let spec = lagr().gps;
    let fixes = fixes(400_000, 0, GpsSwitches { noise: true, ..NONE });
    let square: f64 = fixes.iter().flatten().map(|fix| fix.position.x * fix.position.x).sum();
    let deviation = (square / fixes.len() as f64).sqrt();
    let expected = (spec.noise_m * spec.noise_m + spec.drift_m * spec.drift_m).sqrt();
    assert!((deviation / expected - 1.0).abs() < 0.1, "got {deviation}, expected {expected}");
}

#[test]
fn outliers_and_dropouts_are_as_frequent_as_the_vehicle_file_says_and_more_so_under_trees() {
    let spec = lagr().gps;
    let count = 400_000;
    let far = |trees| {
        let fixes = fixes(count, trees, GpsSwitches { outliers: true, ..NONE });
        fixes.iter().flatten().filter(|fix| fix.position.length() > 0.4 * spec.outlier_m).count() as f64
            / count as f64
    };
    assert!((far(0) / spec.outliers - 1.0).abs() < 0.1, "{}", far(0));
    assert!((far(1) / (spec.outliers * spec.tree_factor) - 1.0).abs() < 0.1, "{}", far(1));
    let lost = fixes(count, 0, ALL).iter().filter(|fix| fix.is_none()).count() as f64 / count as f64;
    let mean_s = 0.5 * (spec.dropout_s[0] + spec.dropout_s[1]);
    let expected = spec.dropouts_per_hour / 3600.0 * mean_s;
    assert!((lost / expected - 1.0).abs() < 0.2, "got {lost}, expected {expected}");
}

#[test]
fn a_switch_changes_nothing_but_its_own_effect() {
    let (with, without) = (fixes(5000, 0, ALL), fixes(5000, 0, GpsSwitches { dropouts: false, ..ALL }));
    assert!(with.iter().any(Option::is_none));
    assert!(with.iter().zip(&without).all(|(a, b)| a.is_none() || a == b));
}

#[test]
fn a_dropout_is_a_time_without_fixes_after_which_they_come_again() {
    let spec = lagr().gps;
    let mut trace = Trace::new(&["t_s", "fix", "east_m", "north_m", "up_m"]);
    let (mut gap, mut gaps) = (0, Vec::new());
    for (index, fix) in (0..).zip(fixes(2400, 0, ALL)) {
        let p = fix.map_or(DVec3::ZERO, |fix| fix.position);
        if index % 4 == 0 {
            trace.row(&[f64::from(index) / spec.rate_hz, f64::from(u8::from(fix.is_some())), p.x, p.y, p.z]);
        }
        if fix.is_none() {
            gap += 1;
        } else if gap > 0 {
            gaps.push(f64::from(gap) / spec.rate_hz);
            gap = 0;
        }
    }
    assert!(!gaps.is_empty());
    let [shortest, longest] = spec.dropout_s;
    let allowed = shortest..=longest + 1.0 / spec.rate_hz;
    assert!(gaps.iter().all(|gap| allowed.contains(gap)), "gaps {gaps:?} s, expected {allowed:?} s");
    trace.check(env!("CARGO_MANIFEST_DIR"), "gps_dropout.csv");
}

#[test]
fn true_labels_have_the_codes_of_label_images() {
    use rcs_scene::Label;
    use rcs_sense::ObstacleLabel;
    for (truth, label) in [
        (Label::Invalid, ObstacleLabel::Invalid),
        (Label::Ground, ObstacleLabel::Ground),
        (Label::Obstacle, ObstacleLabel::Obstacle),
        (Label::Short, ObstacleLabel::ShortObstacle),
        (Label::Cover, ObstacleLabel::Cover),
    ] {
        assert_eq!(truth.code(), label.code());
    }
}
