//! Wheel encoders.

use super::normal;
use crate::drive::STEP_S;
use crate::spec::EncoderSpec;
use rand_core::RngCore;
use serde::{Deserialize, Serialize};

/// State of the encoders.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Encoders {
    /// Relative error of each wheel's assumed radius.
    scale_error: [f64; 2],
    /// Whether the last reading had these errors.
    noise: bool,
    /// What is added to the distances so that they do not leap when the errors are switched during a run, m.
    offset_m: [f64; 2],
    last_m: [f64; 2],
    /// Steps from the start of the run to the last reading.
    last_steps: u64,
}

/// A reading of the encoders.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EncoderReading {
    /// Distance of the left and the right wheel in whole ticks, m.
    pub distance_m: [f64; 2],
    /// Speed from the ticks since the previous reading, m/s; 0 in the first one.
    pub speed_mps: [f64; 2],
}

impl Encoders {
    /// Draws the errors of the wheel radii.
    pub fn new(spec: &EncoderSpec, rng: &mut impl RngCore) -> Encoders {
        let scale_error = [0, 1].map(|_| {
            let drawn = normal(rng).clamp(-2.0, 2.0) * 0.5;
            spec.scale_error * drawn
        });
        Encoders { scale_error, ..Encoders::default() }
    }

    /// Counts ticks, given the distance rolled by the wheels, m, this many steps after the start of the run. With
    /// `noise` the wheel radii have their errors.
    pub fn measure(
        &mut self,
        spec: &EncoderSpec,
        rolled_m: [f64; 2],
        steps: u64,
        noise: bool,
    ) -> EncoderReading {
        let elapsed_s = steps.saturating_sub(self.last_steps) as f64 * STEP_S;
        let mut reading = EncoderReading { distance_m: [0.0; 2], speed_mps: [0.0; 2] };
        for (side, rolled_m) in rolled_m.into_iter().enumerate() {
            let scale_error = self.scale_error[side];
            let factor = |noise: bool| if noise { 1.0 + scale_error } else { 1.0 };
            if noise != self.noise {
                self.offset_m[side] += rolled_m * (factor(self.noise) - factor(noise));
            }
            let believed = rolled_m * factor(noise) + self.offset_m[side];
            let distance = (believed / spec.tick_m).floor() * spec.tick_m;
            reading.distance_m[side] = distance;
            if elapsed_s > 0.0 {
                reading.speed_mps[side] = (distance - self.last_m[side]) / elapsed_s;
            }
            self.last_m[side] = distance;
        }
        self.noise = noise;
        self.last_steps = steps;
        reading
    }
}
