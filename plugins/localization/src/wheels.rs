//! Distance rolled by the wheels since the last reading, and whether the vehicle stands.

use rcs_msg::Stamp;
use rcs_sense::SensorTime;
use serde::{Deserialize, Serialize};

/// Fastest plausible speed of a wheel, m/s; readings that imply more are refused.
pub const FASTEST_MPS: f64 = 20.0;
/// Wheels that have rolled less than this in [`STANDING_S`] stand still, m.
const STANDING_M: f64 = 0.001;
/// Time over which [`STANDING_M`] is measured, s.
const STANDING_S: f64 = 0.5;
/// A clock that is ahead is steady if it and that of the run measure an interval that differs by less than this, s.
const STEADY_S: f64 = 1.0;

/// The last reading of the encoders.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Wheels {
    /// When it was taken, and at most when it came.
    pub time: Stamp,
    /// When it was taken by the clock of the encoders, which may be ahead.
    acquired: Stamp,
    /// Time of the first reading.
    pub since: Stamp,
    distance_m: [f64; 2],
    /// Time at which the wheels last moved, and their distances at that time, m.
    moved: Option<Stamp>,
    moved_at_m: [f64; 2],
}

/// Motion of the wheels between two readings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rolled {
    /// Distance rolled by the left and right wheel, m.
    pub rolled_m: [f64; 2],
    /// Time between the readings, s.
    pub elapsed_s: f64,
}

impl Wheels {
    /// The first reading. The wheels are assumed to stand until they move.
    pub fn new(taken: impl Into<SensorTime>, distance_m: [f64; 2]) -> Wheels {
        let taken: SensorTime = taken.into();
        let time = taken.on_arrival();
        let acquired = taken.acquired;
        Wheels { time, acquired, since: time, distance_m, moved: None, moved_at_m: distance_m }
    }

    /// Whether the wheels have moved since the first reading.
    pub fn has_moved(&self) -> bool {
        self.moved.is_some()
    }

    /// Whether the wheels have stood still for a while.
    pub fn stand(&self) -> bool {
        self.moved.is_none_or(|moved| self.time.seconds_since(moved) > STANDING_S)
    }

    /// Takes the next reading. A jump of the counters is refused once; the next reading is compared with the new
    /// values.
    ///
    /// The interval between readings is that of the encoders' clock also while that is steadily ahead: by their arrival, two
    /// readings that come together would be a jump.
    pub fn roll(&mut self, taken: impl Into<SensorTime>, distance_m: [f64; 2]) -> Result<Rolled, String> {
        if !distance_m.iter().all(|distance| distance.is_finite()) {
            return Err(format!("distances are {distance_m:?} m, expected finite ones"));
        }
        let taken: SensorTime = taken.into();
        let time = taken.on_arrival();
        let by_arrival_s = time.seconds_since(self.time);
        let by_sensor_s = taken.acquired.seconds_since(self.acquired);
        let is_ahead = taken.acquired > time && self.acquired > self.time;
        let is_steady = is_ahead && (by_sensor_s - by_arrival_s).abs() < STEADY_S;
        let elapsed_s = if is_steady { by_sensor_s } else { by_arrival_s };
        if elapsed_s <= 0.0 {
            return Err(format!("reading is {:.3} s older than the one before", -elapsed_s));
        }
        let rolled_m = [distance_m[0] - self.distance_m[0], distance_m[1] - self.distance_m[1]];
        (self.time, self.acquired) = (time, taken.acquired);
        self.distance_m = distance_m;
        if rolled_m.iter().any(|rolled| rolled.abs() > FASTEST_MPS * elapsed_s) {
            return Err(format!("wheels rolled {rolled_m:?} m in {elapsed_s:.3} s"));
        }
        let away = |side: usize| (distance_m[side] - self.moved_at_m[side]).abs();
        if away(0).max(away(1)) > STANDING_M {
            self.moved = Some(time);
            self.moved_at_m = distance_m;
        }
        Ok(Rolled { rolled_m, elapsed_s })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(ms: u64) -> Stamp {
        Stamp(ms * 1_000_000)
    }

    #[test]
    fn a_jump_is_refused_once_and_nonsense_changes_nothing() {
        let mut wheels = Wheels::new(at(0), [0.0; 2]);
        assert!(wheels.roll(at(20), [f64::NAN, 0.0]).is_err());
        assert_eq!(wheels.roll(at(20), [0.01, 0.02]).unwrap().rolled_m, [0.01, 0.02]);
        assert!(wheels.roll(at(20), [0.01, 0.02]).is_err(), "the same moment twice");
        assert!(wheels.roll(at(40), [5.0, 5.0]).is_err(), "250 m/s");
        let rolled = wheels.roll(at(60), [5.01, 5.01]).unwrap();
        assert!((rolled.rolled_m[0] - 0.01).abs() < 1e-12);
    }

    #[test]
    fn readings_of_a_clock_that_is_ahead_lose_no_way_when_they_come_together() {
        let ahead = |ms: u64, arrived: u64| SensorTime { acquired: at(30_000 + ms), arrived: at(arrived) };
        let mut wheels = Wheels::new(ahead(0, 0), [0.0; 2]);
        // The second one comes late, and the third one with it.
        for (ms, arrived, way_m) in [(20, 39, 0.1), (40, 40, 0.2), (60, 40, 0.3), (80, 80, 0.4)] {
            let rolled = wheels.roll(ahead(ms, arrived), [way_m; 2]).unwrap();
            assert!((rolled.rolled_m[0] - 0.1).abs() < 1e-12 && (rolled.elapsed_s - 0.02).abs() < 1e-9);
            assert_eq!(wheels.time, at(arrived));
        }
        // The clock is set back to that of the run.
        assert!((wheels.roll(at(100), [0.5; 2]).unwrap().elapsed_s - 0.02).abs() < 1e-9);
        assert!(wheels.roll(ahead(0, 100), [0.5; 2]).is_err(), "ahead again, at the same moment");
    }

    #[test]
    fn wheels_stand_after_half_a_second_without_ticks() {
        let mut wheels = Wheels::new(at(0), [0.0; 2]);
        assert!(wheels.stand(), "from the beginning");
        wheels.roll(at(20), [0.1, 0.1]).unwrap();
        for ms in (40..=520).step_by(20) {
            wheels.roll(at(ms), [0.1, 0.1005]).unwrap();
        }
        assert!(!wheels.stand());
        wheels.roll(at(540), [0.1, 0.1005]).unwrap();
        assert!(wheels.stand());
        wheels.roll(at(560), [0.11, 0.11]).unwrap();
        assert!(!wheels.stand());
    }
}
