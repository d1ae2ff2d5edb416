//! Whether the vehicle stands while its wheels turn: on a slippery slope the encoders and the local frame move on, and only
//! the position fixes tell that it does not.

use rcs_geom::DVec2;
use rcs_msg::Stamp;
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;

/// Time between two samples, and length of the time that is looked at, s.
const STEP_S: f64 = 0.5;
const WINDOW_S: f64 = 8.0;
/// Least way that the wheels have rolled in that time, m: more than the noise of position fixes.
const LEAST_ROLLED_M: f64 = 5.0;
/// Share of it that the vehicle has moved at most.
const MOST_MOVED: f64 = 0.35;

/// The last seconds: what the wheels rolled, and where the vehicle was.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Spinning {
    /// Time, way rolled since the start, m, and position in the global frame, m.
    samples: VecDeque<(Stamp, f64, DVec2)>,
    rolled_m: f64,
    newest: Option<Stamp>,
}

impl Spinning {
    /// Takes a position in the global frame, m, and the speed of the wheels, m/s. Whether they turn on the spot; then it
    /// begins anew.
    pub fn take(&mut self, now: Stamp, at: DVec2, speed_mps: f64) -> bool {
        let elapsed_s = self.newest.map_or(0.0, |before| now.seconds_since(before)).clamp(0.0, STEP_S);
        self.newest = Some(now);
        self.rolled_m += speed_mps.abs() * elapsed_s;
        if self.samples.back().is_some_and(|(time, ..)| now.seconds_since(*time) < STEP_S) {
            return false;
        }
        self.samples.push_back((now, self.rolled_m, at));
        while self
            .samples
            .front()
            .is_some_and(|(time, ..)| now.seconds_since(*time) > WINDOW_S + 0.5 * STEP_S)
        {
            self.samples.pop_front();
        }
        let Some(&(since, rolled_before_m, _)) = self.samples.front() else { return false };
        let rolled_m = self.rolled_m - rolled_before_m;
        let is_long = now.seconds_since(since) >= WINDOW_S - 0.5 * STEP_S && rolled_m >= LEAST_ROLLED_M;
        let steps = self.samples.iter().zip(self.samples.iter().skip(1));
        let moved_m: f64 = steps.map(|((.., from), (.., to))| from.distance(*to)).sum();
        let spins = is_long && moved_m <= MOST_MOVED * rolled_m;
        if spins {
            self.samples.clear();
        }
        spins
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Seconds until wheels that roll 1 m/s are found to spin, for a vehicle that moves like this within 60 s.
    fn spins_after_s(at: impl Fn(f64) -> DVec2, speed_mps: f64) -> Option<f64> {
        let mut spinning = Spinning::default();
        let times = (0..600_u32).map(|step| f64::from(step) / 10.0);
        times.into_iter().find(|&time_s| spinning.take(Stamp((time_s * 1e9) as u64), at(time_s), speed_mps))
    }

    #[test]
    fn wheels_that_turn_while_the_vehicle_stands_are_found_within_seconds() {
        let noise = |time_s: f64| 0.1 * libm::sin(3.0 * time_s);
        let after_s = spins_after_s(|time_s| DVec2::new(noise(time_s), noise(time_s + 1.0)), 1.0).unwrap();
        assert!((7.0..9.0).contains(&after_s), "{after_s}");
        // It drives for 20 s first.
        let after_s = spins_after_s(|time_s| DVec2::new(time_s.min(20.0), 0.0), 1.0).unwrap();
        assert!((24.0..28.0).contains(&after_s), "{after_s}");
    }

    #[test]
    fn a_vehicle_that_drives_circles_slips_a_little_or_stands_does_not_spin() {
        let circle = |time_s: f64| DVec2::from_angle(time_s);
        assert_eq!(spins_after_s(circle, 1.0), None);
        assert_eq!(spins_after_s(|time_s| DVec2::new(0.5 * time_s, 0.0), 1.0), None, "mud");
        assert_eq!(spins_after_s(|_| DVec2::ZERO, 0.0), None);
        assert_eq!(spins_after_s(|_| DVec2::ZERO, 0.3), None, "too little to tell");
    }
}
