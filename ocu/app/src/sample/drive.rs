//! The drive of the generated recording: where the vehicle is at each moment.

use glam::DVec3;
use libm::{cos, sin};
use std::f64::consts::TAU;

/// Time between two states, in seconds.
pub(super) const STEP_S: f64 = 0.01;
/// Cruising speed.
const CRUISE_MPS: f64 = 1.3;
/// Acceleration at the start and before the end.
const ACCELERATION_MPS2: f64 = 0.6;

/// The vehicle at one moment, in the frame `local` (x east, y north, z up).
#[derive(Clone, Copy, Debug)]
pub(super) struct State {
    pub(super) time_s: f64,
    pub(super) position_m: DVec3,
    pub(super) yaw_rad: f64,
    pub(super) pitch_rad: f64,
    pub(super) speed_mps: f64,
    pub(super) yaw_rate_radps: f64,
    pub(super) acceleration_mps2: f64,
}

/// The whole drive, one state every [`STEP_S`]: a gentle S, from standstill to standstill.
pub(super) fn states(duration_s: f64) -> Vec<State> {
    let count = (duration_s / STEP_S).round() as usize;
    let mut position_m = DVec3::ZERO;
    let mut states = Vec::with_capacity(count + 1);
    for index in 0..=count {
        let time_s = index as f64 * STEP_S;
        let speed_mps = speed_at(time_s, duration_s);
        let phase = TAU * time_s / 18.0;
        let yaw_rad = 0.5 * sin(phase);
        states.push(State {
            time_s,
            position_m,
            yaw_rad,
            // The vehicle nods a little on uneven ground.
            pitch_rad: 0.006 * sin(5.1 * time_s) * (speed_mps / CRUISE_MPS),
            speed_mps,
            yaw_rate_radps: 0.5 * TAU / 18.0 * cos(phase),
            acceleration_mps2: (speed_at(time_s + STEP_S, duration_s) - speed_mps) / STEP_S,
        });
        position_m += DVec3::new(cos(yaw_rad), sin(yaw_rad), 0.0) * speed_mps * STEP_S;
    }
    states
}

fn speed_at(time_s: f64, duration_s: f64) -> f64 {
    (ACCELERATION_MPS2 * time_s.min(duration_s - time_s)).clamp(0.0, CRUISE_MPS)
}

/// Repeatable noise: the same for the same seed, on every machine.
#[derive(Clone, Debug)]
pub(super) struct Noise(u64);

impl Noise {
    pub(super) fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// Uniform in 0 to 1 (splitmix64).
    pub(super) fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Uniform between two bounds.
    pub(super) fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.uniform()
    }

    /// Close to a normal distribution with that standard deviation (sum of twelve uniforms).
    pub(super) fn normal(&mut self, sigma: f64) -> f64 {
        let sum: f64 = (0..12).map(|_| self.uniform()).sum();
        (sum - 6.0) * sigma
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn drive_starts_and_ends_at_rest_and_moves_in_between() {
        let states = states(20.0);
        assert_eq!(states.len(), 2001);
        assert_eq!(states[0].speed_mps, 0.0);
        assert!(states[2000].speed_mps.abs() < 1e-9);
        assert!(states[1000].position_m.length() > 10.0);
    }

    #[test]
    fn noise_repeats_for_a_seed_and_has_the_asked_spread() {
        let (mut a, mut b) = (Noise::new(7), Noise::new(7));
        let values: Vec<f64> = (0..4000).map(|_| a.normal(2.0)).collect();
        assert!(values.iter().all(|&value| value == b.normal(2.0)));
        let variance = values.iter().map(|value| value * value).sum::<f64>() / 4000.0;
        assert!((variance - 4.0).abs() < 0.3, "variance {variance}");
    }
}
