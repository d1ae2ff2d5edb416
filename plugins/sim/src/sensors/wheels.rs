//! Wheel encoders.

use super::normal;
use crate::spec::EncoderSpec;
use rand_core::RngCore;
use serde::{Deserialize, Serialize};

/// State of the encoders.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Encoders {
    /// Relative error of each wheel's assumed radius.
    scale_error: [f64; 2],
    last_m: [f64; 2],
}

/// A reading of the encoders.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EncoderReading {
    /// Distance of the left and the right wheel in whole ticks, m.
    pub distance_m: [f64; 2],
    /// Speed from the ticks since the previous reading, m/s.
    pub speed_mps: [f64; 2],
}

impl Encoders {
    /// Draws the errors of the wheel radii.
    pub fn new(spec: &EncoderSpec, noise: bool, rng: &mut impl RngCore) -> Encoders {
        let scale_error = [0, 1].map(|_| {
            let drawn = normal(rng).clamp(-2.0, 2.0) * 0.5;
            if noise { spec.scale_error * drawn } else { 0.0 }
        });
        Encoders { scale_error, last_m: [0.0; 2] }
    }

    /// Counts ticks, given the distance rolled by the wheels, m, `elapsed_s` after the previous reading.
    pub fn measure(&mut self, spec: &EncoderSpec, rolled_m: [f64; 2], elapsed_s: f64) -> EncoderReading {
        let mut reading = EncoderReading { distance_m: [0.0; 2], speed_mps: [0.0; 2] };
        for (side, rolled_m) in rolled_m.into_iter().enumerate() {
            let believed = rolled_m * (1.0 + self.scale_error[side]);
            let distance = (believed / spec.tick_m).floor() * spec.tick_m;
            reading.distance_m[side] = distance;
            reading.speed_mps[side] = (distance - self.last_m[side]) / elapsed_s;
            self.last_m[side] = distance;
        }
        reading
    }
}
