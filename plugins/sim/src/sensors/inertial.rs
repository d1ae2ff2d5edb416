//! Gyros, accelerometers, and the attitude derived from them and a compass.

use super::normal;
use crate::spec::InertialSpec;
use glam::DVec3;
use rand_core::RngCore;
use rcs_geom::Pose;
use serde::{Deserialize, Serialize};

/// Standard deviation of roll and pitch stated by the sensor, rad: they come from the accelerometers alone, so every
/// acceleration of the vehicle disturbs them.
const TILT_DEVIATION_RAD: f64 = 0.1;

/// State of the sensor: its biases.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Inertial {
    gyro_bias: DVec3,
    accel_bias: DVec3,
    heading_bias_rad: f64,
}

/// A reading of the sensor, vehicle axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InertialReading {
    /// Turn rates, rad/s.
    pub turn_radps: DVec3,
    /// Specific force, gravity included: +9.81 along z at rest and level, m/s².
    pub force_mps2: DVec3,
    /// Attitude from accelerometers and compass; without translation.
    pub orientation: Pose,
    /// Variances of roll, pitch and yaw, rad²; of the gyros, (rad/s)²; of the accelerometers, (m/s²)².
    pub variances: [DVec3; 3],
}

fn normals(rng: &mut impl RngCore) -> DVec3 {
    DVec3::new(normal(rng), normal(rng), normal(rng))
}

impl Inertial {
    /// Draws the biases.
    pub fn new(spec: &InertialSpec, rng: &mut impl RngCore) -> Inertial {
        Inertial {
            gyro_bias: normals(rng) * spec.gyro_bias_radps,
            accel_bias: normals(rng) * spec.accel_bias_mps2,
            heading_bias_rad: normal(rng) * spec.heading_bias_rad,
        }
    }

    /// Measures a motion, given true turn rates and specific forces in vehicle axes and true yaw. With `noise` the
    /// reading has the biases and white noise.
    pub fn measure(
        &mut self,
        spec: &InertialSpec,
        turn_radps: DVec3,
        force_mps2: DVec3,
        yaw_rad: f64,
        noise: bool,
        rng: &mut impl RngCore,
    ) -> InertialReading {
        let drawn = [normals(rng), normals(rng), normals(rng)];
        let heading_noise = normal(rng);
        let on = if noise { 1.0 } else { 0.0 };
        self.gyro_bias += drawn[2] * (on * spec.gyro_walk_radps / spec.rate_hz.sqrt());
        let bias = if noise { *self } else { Inertial::default() };
        let turn = turn_radps + bias.gyro_bias + drawn[0] * (on * spec.gyro_noise_radps);
        let limit = DVec3::splat(spec.accel_limit_mps2);
        let force = force_mps2 + bias.accel_bias + drawn[1] * (on * spec.accel_noise_mps2);
        let force = force.clamp(-limit, limit);
        let yaw = yaw_rad + bias.heading_bias_rad + on * spec.heading_noise_rad * heading_noise;
        let roll = libm::atan2(force.y, force.z);
        let pitch = libm::atan2(-force.x, DVec3::new(0.0, force.y, force.z).length());
        let square = |deviation: f64| deviation * deviation;
        let heading = square(spec.heading_noise_rad) + square(spec.heading_bias_rad);
        InertialReading {
            turn_radps: turn,
            force_mps2: force,
            orientation: Pose::from_rpy(DVec3::ZERO, roll, pitch, yaw),
            variances: [
                DVec3::new(square(TILT_DEVIATION_RAD), square(TILT_DEVIATION_RAD), heading),
                DVec3::splat(square(spec.gyro_noise_radps) + square(spec.gyro_bias_radps)),
                DVec3::splat(square(spec.accel_noise_mps2) + square(spec.accel_bias_mps2)),
            ],
        }
    }
}
