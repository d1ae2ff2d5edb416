//! Clocks of inertial sensor and encoders that begin again, as where a simulation was started again during a recording.
//!
//! The estimates begin anew only when both have begun again. Until then, readings by the new clock are refused: the turns
//! between two readings of the one sensor would be counted again by the other.

use super::Localization;
use rcs_msg::Stamp;
use rcs_runtime::Cycle;
use rcs_sense::ClockWatch;
use serde::{Deserialize, Serialize};

/// Places of the sensors in lists of both.
pub(super) const INERTIAL: usize = 0;
pub(super) const ENCODERS: usize = 1;

/// The clock of a sensor.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct SensorClock {
    watch: ClockWatch,
    /// Whether its last readings are by a clock that has begun again.
    has_begun_again: bool,
}

impl SensorClock {
    /// Takes the time of a reading, and that of the newest one that was used before.
    fn take(&mut self, newest: Option<Stamp>, time: Stamp) {
        let is_behind = newest.is_some_and(|newest| ClockWatch::is_far_behind(newest, time));
        let begins_again = self.watch.begins_again(newest, time);
        self.has_begun_again = begins_again || (self.has_begun_again && is_behind);
    }
}

impl Localization {
    /// Takes the time of a reading of a sensor. If the clocks of all sensors that have told anything have begun again, the
    /// estimates begin anew, with that reading; the origin of the global frame stays.
    pub(super) fn take_time(&mut self, sensor: usize, time: Stamp, cx: &mut Cycle<'_>) {
        let mut newest = [None; 2];
        newest[INERTIAL] = self.felt;
        newest[ENCODERS] = self.wheels.map(|wheels| wheels.time);
        self.clocks[sensor].take(newest[sensor], time);
        let is_old =
            |(newest, clock): (&Option<Stamp>, &SensorClock)| newest.is_some() && !clock.has_begun_again;
        let any_is_old = std::iter::zip(&newest, &self.clocks).any(is_old);
        if self.clocks[sensor].has_begun_again && !any_is_old {
            *self = Self {
                origin: self.origin,
                repeats: self.repeats,
                refuses_compass: self.refuses_compass,
                ..Self::default()
            };
            cx.fault("the clocks of the sensors have begun again; the estimates begin anew");
        }
    }
}
