//! Conversion of the text of a vehicle file to a [`VehicleSpec`].

use super::reader::{FileError, Section};
use super::sensors;
use super::{BodySpec, BumperSpec, MotorSpec, Rates, SteeringSpec, VehicleSpec, WheelSpec};
use std::collections::BTreeSet;

/// Version of the file format.
const FORMAT: f64 = 1.0;

pub(super) fn vehicle(file: &Section<'_>) -> Result<VehicleSpec, FileError> {
    file.number("format", FORMAT..=FORMAT)?;
    // For human readers; not used.
    file.text_or_empty("description")?;
    let spec = VehicleSpec {
        name: file.text("name")?,
        body: file.table("body", body)?,
        wheels: file.table("wheels", wheels)?,
        motors: file.table("motors", motors)?,
        steering: file.optional_table("steering", steering)?,
        bumper: file.table("bumper", bumper)?,
        encoders: file.table("encoders", sensors::encoders)?,
        inertial: file.table("inertial", sensors::inertial)?,
        gps: file.table("gps", sensors::gps)?,
        doppler: file.optional_table("doppler", sensors::doppler)?,
        rates: file.table("rates", rates)?,
        infrared: file.tables("infrared", sensors::infrared)?,
        cameras: file.tables("camera", sensors::camera)?,
        ladars: file.tables("ladar", sensors::ladar)?,
        clouds: file.optional_table("clouds", sensors::clouds)?,
    };
    check_names(file, &spec)?;
    Ok(spec)
}

/// Refuses a camera with the name of another one, and a sensor whose frame there is already: a frame lies at one place.
fn check_names(file: &Section<'_>, spec: &VehicleSpec) -> Result<(), FileError> {
    for (index, camera) in spec.cameras.iter().enumerate() {
        if spec.cameras[..index].iter().any(|other| other.name == camera.name) {
            let reason = format!("has the name {:?} twice", camera.name);
            return Err(file.error_of_name("camera", index, reason));
        }
    }
    let infrared = spec.infrared.iter().enumerate().map(|(index, it)| ("infrared", index, it.name.clone()));
    let ladars = spec.ladars.iter().enumerate().map(|(index, it)| ("ladar", index, it.name.clone()));
    let cameras = spec.cameras.iter().enumerate().flat_map(|(index, camera)| {
        (0..camera.cameras()).map(move |side| ("camera", index, camera.frame(side)))
    });
    let mut taken: BTreeSet<String> = ["vehicle", "imu", "gps"].map(str::to_owned).into();
    for (key, index, frame) in infrared.chain(cameras).chain(ladars) {
        let reason = format!("has the frame {frame:?}, which is taken, expected another name");
        if !taken.insert(frame) {
            return Err(file.error_of_name(key, index, reason));
        }
    }
    Ok(())
}

fn body(t: &Section<'_>) -> Result<BodySpec, FileError> {
    Ok(BodySpec {
        mass_kg: t.number("mass_kg", 1.0..=50_000.0)?,
        yaw_inertia_kgm2: t.number("yaw_inertia_kgm2", 0.01..=200_000.0)?,
        centre_height_m: t.number("centre_height_m", 0.0..=5.0)?,
        front_m: t.number("front_m", 0.01..=10.0)?,
        rear_m: t.number("rear_m", 0.01..=10.0)?,
        width_m: t.number("width_m", 0.05..=10.0)?,
        height_m: t.number("height_m", 0.05..=10.0)?,
        clearance_m: t.number("clearance_m", 0.0..=2.0)?,
        tip_over_rad: t.number("tip_over_deg", 5.0..=89.0)?.to_radians(),
        settle_s: t.number("settle_s", 0.0..=1.0)?,
    })
}

fn wheels(t: &Section<'_>) -> Result<WheelSpec, FileError> {
    let max_speed_mps = t.number("max_speed_mps", 0.01..=50.0)?;
    let other_axle_x_m = t.number("other_axle_x_m", -10.0..=10.0)?;
    if other_axle_x_m.abs() < 0.05 {
        return Err(t.error("other_axle_x_m", "is under the driven axle, expected at least 0.05 m from it"));
    }
    Ok(WheelSpec {
        radius_m: t.number("radius_m", 0.02..=2.0)?,
        track_m: t.number("track_m", 0.05..=5.0)?,
        other_axle_x_m,
        other_track_m: t.number("other_track_m", 0.0..=5.0)?,
        driven_load: t.number("driven_load", 0.05..=1.0)?,
        max_speed_mps,
        max_wheel_speed_mps: t.number("max_wheel_speed_mps", max_speed_mps..=60.0)?,
        rim_mass_kg: t.number("rim_mass_kg", 0.1..=5000.0)?,
        rolling_resistance: t.number("rolling_resistance", 0.0..=1.0)?,
        slip_at_limit: t.number("slip_at_limit", 0.001..=0.9)?,
        scrub_nm: t.number("scrub_nm", 0.0..=100_000.0)?,
        climb_m: t.number("climb_m", 0.01..=2.0)?,
        side_slip_at_limit: t.number("side_slip_at_limit", 0.0..=1.0)?,
    })
}

fn motors(t: &Section<'_>) -> Result<MotorSpec, FileError> {
    Ok(MotorSpec {
        max_current_a: t.number("max_current_a", 0.1..=10_000.0)?,
        newton_per_amp: t.number("newton_per_amp", 0.1..=10_000.0)?,
        idle_current_a: t.number("idle_current_a", 0.0..=1000.0)?,
        response_s: t.number("response_s", 0.005..=10.0)?,
        brake_n: t.number("brake_n", 0.0..=1e6)?,
        noise_a: t.number("noise_a", 0.0..=100.0)?,
    })
}

fn steering(t: &Section<'_>) -> Result<SteeringSpec, FileError> {
    Ok(SteeringSpec {
        max_curvature_per_m: t.number("max_curvature_per_m", 0.001..=10.0)?,
        delay_s: t.number("delay_s", 0.0..=2.0)?,
        time_constant_s: t.number("time_constant_s", 0.0..=10.0)?,
        noise_per_m: t.number("noise_per_m", 0.0..=1.0)?,
    })
}

fn bumper(t: &Section<'_>) -> Result<BumperSpec, FileError> {
    let bottom_m = t.number("bottom_m", 0.0..=5.0)?;
    let travel_m = t.number("travel_m", 0.001..=0.5)?;
    Ok(BumperSpec {
        width_m: t.number("width_m", 0.05..=10.0)?,
        bottom_m,
        top_m: t.number("top_m", bottom_m..=5.0)?,
        travel_m,
        stiffness_npm: t.number("stiffness_npm", 0.0..=1e7)?,
        switch_m: t.number("switch_m", 0.0..=travel_m)?,
        stops_drive: t.flag("stops_drive")?,
    })
}

fn rates(t: &Section<'_>) -> Result<Rates, FileError> {
    Ok(Rates {
        infrared_hz: t.number("infrared_hz", 0.1..=100.0)?,
        bumper_hz: t.number("bumper_hz", 0.1..=100.0)?,
        motors_hz: t.number("motors_hz", 0.1..=100.0)?,
        ground_truth_hz: t.number("ground_truth_hz", 1.0..=100.0)?,
    })
}
