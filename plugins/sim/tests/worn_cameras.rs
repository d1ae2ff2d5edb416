//! Cameras as they are: each key of the vehicle file does what it says, and nothing else.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

mod common;

use common::bench::{Bench, Files, STACK, VehicleBench, plan};
use common::{Counter, LAGR};
use rcs_geom::DVec3;
use rcs_msg::foxglove::RawImage;
use rcs_sim::camera_condition::Condition;
use rcs_sim::spec::{CameraSpec, VehicleSpec};

const WORN: &str = include_str!("../../../assets/vehicles/lagr_worn.toml");

#[test]
fn the_worn_robot_differs_from_the_other_in_its_cameras_alone() {
    let (lagr, worn) = (VehicleSpec::from_toml(LAGR).unwrap(), VehicleSpec::from_toml(WORN).unwrap());
    let mended = |camera: &CameraSpec| CameraSpec {
        calibration_error_rad: 0.0,
        vertical_offset_px: 0.0,
        stamp_jitter_s: 0.0,
        exposure_control: None,
        ..camera.clone()
    };
    assert!(worn.clouds.is_some());
    for camera in &worn.cameras {
        assert!((0.1..=0.3).contains(&camera.calibration_error_rad.to_degrees()));
        assert!(camera.vertical_offset_px.abs() == 1.0 && camera.stamp_jitter_s > 0.0);
        assert!(camera.exposure_control.is_some());
    }
    let cameras = worn.cameras.iter().map(mended).collect();
    assert_eq!(VehicleSpec { name: lagr.name.clone(), cameras, clouds: None, ..worn }, lagr);
}

#[test]
fn bad_values_are_refused_with_their_line_and_reason() {
    for (from, to, expected) in [
        (
            "error_deg = 0.2",
            "error_deg = 9",
            "camera.calibration_error_deg is 9, expected a number from 0 to 5",
        ),
        ("error_deg = 0.2", "error_deg = nan", "camera.calibration_error_deg is nan"),
        (
            "offset_px = 1.0",
            "offset_px = 40",
            "camera.vertical_offset_px is 40, expected a number from -20 to 20",
        ),
        ("jitter_ms = 8.0", "jitter_ms = -1", "camera.stamp_jitter_ms is -1, expected a number from 0 to 20"),
        (
            "target = 105.0",
            "target = 300",
            "camera.exposure_control.target is 300, expected a number from 10",
        ),
        ("target = 105.0, ", "", "camera.exposure_control.target is missing"),
        (
            "max_gain = 3.0",
            "max_gain = 0.5",
            "camera.exposure_control.max_gain is 0.5, expected a number from 1",
        ),
        ("cover = 0.4", "cover = 1.4", "clouds.cover is 1.4, expected a number from 0 to 1"),
        ("period_s = 40.0", "", "clouds.period_s is missing"),
        ("least_sunlight = 0.3", "least_sunlight = 0.3\nwind = 1", "clouds.wind is unknown"),
    ] {
        assert!(WORN.contains(from), "{from}");
        let vehicle = WORN.replacen(from, to, 1);
        let line = 1 + WORN.lines().position(|line| line.contains(from)).unwrap();
        let files = Files { vehicle, ..Files::default() };
        let error = plan(STACK, &files, &[]).expect_err("it was not refused");
        assert!(error.contains(expected), "got {error:?}, expected {expected:?}");
        assert!(error.starts_with("vehicles/lagr.toml:"), "{error}");
        if !expected.contains("missing") && !expected.contains("unknown") {
            assert!(
                error.starts_with(&format!("vehicles/lagr.toml:{line}:")),
                "{error}, expected line {line}"
            );
        }
    }
}

#[test]
fn each_camera_is_turned_by_the_stated_angle_about_an_axis_of_its_own() {
    let spec = VehicleSpec::from_toml(WORN).unwrap().cameras[0].clone();
    let condition = |seed: u64| Condition::new(&spec, &mut Counter(seed));
    for seed in 0..20 {
        let [left, right] = [0, 1].map(|side| condition(seed).camera_from_turned(side).rotation);
        for turned in [left, right] {
            let angle_deg = (2.0 * libm::asin(turned.xyz().length())).to_degrees();
            assert!((angle_deg - 0.2).abs() < 1e-4, "{angle_deg}°");
        }
        assert!(left.xyz().distance(right.xyz()) > 1e-5);
        assert_eq!(condition(seed), condition(seed));
    }
    let directions: DVec3 =
        (0..400).map(|seed| condition(seed).camera_from_turned(0).rotation.xyz().normalize()).sum();
    assert!(directions.length() < 60.0, "no direction is preferred: {directions}");
}

/// The newest images of the left and the right camera, from a vehicle that stands, without noise and distortion.
fn images(vehicle: &str) -> [RawImage; 2] {
    let files = Files { vehicle: vehicle.to_owned(), ..Files::default() };
    let params = [("front_left.noise", "false"), ("front_left.distortion", "false")];
    let mut bench = Bench::start(STACK, &files, &params);
    bench.advance(400);
    ["/front_left/left", "/front_left/right"].map(|buffer| bench.latest(buffer))
}

fn with_keys(keys: &str) -> String {
    LAGR.replacen("vignette = 0.12\n", &format!("vignette = 0.12\n{keys}\n"), 1)
}

#[test]
fn a_vertical_offset_moves_the_right_image_down_and_leaves_the_left_one() {
    let ([left, right], [same, lower]) = (images(LAGR), images(&with_keys("vertical_offset_px = 1.0")));
    assert_eq!(left.data, same.data);
    let row = right.step as usize;
    let rows = right.data.len() - row;
    let equal = right.data[..rows].iter().zip(&lower.data[row..]).filter(|(a, b)| a == b).count();
    assert!(equal > rows * 99 / 100, "{equal} of {rows} bytes");
}

#[test]
fn a_turned_camera_sees_another_image() {
    let ([left, right], turned) = (images(LAGR), images(&with_keys("calibration_error_deg = 0.3")));
    for (image, turned) in [left, right].iter().zip(&turned) {
        let differ = image.data.iter().zip(&turned.data).filter(|(a, b)| a != b).count();
        assert!(differ > image.data.len() / 2, "{differ} bytes differ");
    }
}

#[test]
fn stamps_are_off_by_at_most_the_jitter_and_equal_in_a_pair_and_its_truth() {
    let files = Files { vehicle: with_keys("stamp_jitter_ms = 8.0"), ..Files::default() };
    let mut bench = Bench::start(STACK, &files, &[]);
    let mut errors = Vec::new();
    for _ in 0..40 {
        bench.advance(200);
        let stamps = ["left", "right", "ground_truth_depth", "ground_truth_class"].map(|port| {
            let image: RawImage = bench.latest(&format!("/front_left/{port}"));
            let stamp = image.timestamp.unwrap();
            stamp.seconds as f64 * 1e3 + f64::from(stamp.nanos) * 1e-6
        });
        assert!(stamps.iter().all(|stamp| *stamp == stamps[0]), "{stamps:?}");
        // Poses are sent every 10 ms, and the cameras take images every 50 ms.
        errors.push(stamps[0] - (stamps[0] / 10.0).round() * 10.0);
    }
    let largest = errors.iter().fold(0.0_f64, |most, error| most.max(error.abs()));
    assert!(largest > 2.0, "{errors:?}");
    let different = errors.windows(2).filter(|pair| pair[0] != pair[1]).count();
    assert!(different > 30, "{errors:?}");
}

#[test]
fn clouds_darken_sunlit_ground_more_than_what_is_in_the_shade() {
    let clouds = "[clouds]\ncover = 1.0\nperiod_s = 40.0\nleast_sunlight = 0.2\n\n[[infrared]]";
    let clouded = LAGR.replacen("[[infrared]]", clouds, 1);
    let ([clear, _], [dark, _]) = (images(LAGR), images(&clouded));
    let ratios: Vec<f64> = clear
        .data
        .iter()
        .zip(&dark.data)
        // The lower half of the image is ground.
        .skip(clear.data.len() / 2)
        .filter(|(clear, _)| **clear > 20)
        .map(|(clear, dark)| f64::from(*dark) / f64::from(*clear))
        .collect();
    let mean = ratios.iter().sum::<f64>() / ratios.len() as f64;
    assert!((0.5..0.85).contains(&mean), "{mean}");
    assert!(ratios.iter().all(|ratio| *ratio < 1.3));
}
