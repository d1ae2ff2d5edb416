//! Wheel encoders.

use super::normal;
use crate::spec::EncoderSpec;
use rand_core::RngCore;
use serde::{Deserialize, Serialize};

/// State of the encoders.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Encoders {
    /// Part by which each wheel's radius differs from what is believed.
    scale_error: [f64; 2],
    last_m: [f64; 2],
}

/// What the encoders say.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EncoderReading {
    /// Left and right, whole ticks, m.
    pub distance_m: [f64; 2],
    /// By the ticks since the last reading, m/s.
    pub speed_mps: [f64; 2],
}

impl Encoders {
    /// Draws the errors of the wheels' radii.
    pub fn new(spec: &EncoderSpec, noise: bool, rng: &mut impl RngCore) -> Encoders {
        let scale_error = [0, 1].map(|_| {
            let drawn = normal(rng).clamp(-2.0, 2.0) * 0.5;
            if noise { spec.scale_error * drawn } else { 0.0 }
        });
        Encoders { scale_error, last_m: [0.0; 2] }
    }

    /// Counts ticks of what the wheels have turned, m, `elapsed_s` after the last reading.
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
