//! Models of the vehicle's simple sensors: measurements of the true motion, with noise.
//!
//! Each sensor keeps its own errors (biases, slow drifts) as state; white noise comes from the generator given by the
//! caller.

mod gps;
mod inertial;
mod infrared;
mod wheels;

pub use gps::{Gps, GpsFix, GpsSwitches};
pub use inertial::{Inertial, InertialReading};
pub use infrared::{InfraredReading, measure_infrared};
pub use wheels::{EncoderReading, Encoders};

use rand_core::RngCore;

/// A random number from a normal distribution with mean 0 and standard deviation 1 (Box-Muller).
pub(crate) fn normal(rng: &mut impl RngCore) -> f64 {
    let radius = (-2.0 * libm::log(uniform(rng))).sqrt();
    radius * libm::cos(std::f64::consts::TAU * uniform(rng))
}

/// A uniform random number in (0, 1].
pub(crate) fn uniform(rng: &mut impl RngCore) -> f64 {
    // A double holds 53 bits; one is added so that the logarithm is finite.
    ((rng.next_u64() >> 11) + 1) as f64 / (1_u64 << 53) as f64
}

/// Whether a sensor with this rate is due in the interval (before, now], given as times since the start, ns.
pub fn is_due(before_ns: u64, now_ns: u64, rate_hz: f64) -> bool {
    let index = |time_ns: u64| (time_ns as f64 * 1e-9 * rate_hz + 1e-6).floor();
    index(now_ns) > index(before_ns)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_schedule_is_met_as_often_as_its_rate_says() {
        for rate_hz in [1.0, 4.0, 5.0, 10.0, 20.0, 50.0, 100.0, 3.0] {
            let step = 10_000_000_u64;
            let count = (1..=3000).filter(|&n| is_due((n - 1) * step, n * step, rate_hz)).count();
            assert_eq!(count, (30.0 * rate_hz) as usize, "{rate_hz} Hz");
        }
    }
}
