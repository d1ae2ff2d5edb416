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

/// How many readings of those asked for a sensor gives, and why not more, for its status: at most one in each period, s,
/// of its process, and one for each true pose that comes, `poses_hz`. `None` if it gives all.
pub(crate) fn limit(rate_hz: f64, period_s: f64, poses_hz: f64) -> Option<String> {
    let cycles_hz = 1.0 / period_s;
    let most_hz = cycles_hz.min(poses_hz);
    // The period in ns is not exact in s.
    if rate_hz <= most_hz * 1.000_001 {
        return None;
    }
    let rounded = |number: f64| (number * 10.0).round() / 10.0;
    let why = if cycles_hz <= poses_hz {
        format!("the period is {} ms", rounded(1e3 * period_s))
    } else {
        format!("ground_truth_hz is {}", rounded(poses_hz))
    };
    Some(format!("{} of {} per s, {why}", rounded(most_hz), rounded(rate_hz)))
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
