//! When a sensor measured, where its clock may be ahead of that of the run.

use rcs_msg::{Payload, Stamp};
use rcs_runtime::Msg;

/// When a sensor measured, by its own clock, and when its message came.
///
/// A clock may be ahead of that of the run, as one that keeps GPS time. Poses may have the same clock, or that of the run:
/// the localization counts readings from the future as taken when they came. So a time from the future is looked up by the
/// clock that the poses have: the own time if the newest pose is nearer to it than to the arrival, else the arrival. By the
/// arrival, what the message took on its way counts as motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SensorTime {
    /// Acquisition time of the message, by the clock of the sensor.
    pub acquired: Stamp,
    /// When the message came, by the clock of the run.
    pub arrived: Stamp,
}

impl SensorTime {
    /// Of a message.
    pub fn of<T: Payload>(message: &Msg<T>) -> SensorTime {
        SensorTime { acquired: message.acq_time(), arrived: message.header().log_time }
    }

    /// The time by the clock of the run: the acquisition time, and at most the arrival.
    pub fn on_arrival(self) -> Stamp {
        self.acquired.min(self.arrived)
    }

    /// The time by the clock of poses, of which the newest one is given; `None` for poses that hold at all times.
    pub(crate) fn by_clock_of(self, newest: Option<Stamp>) -> Stamp {
        let SensorTime { acquired, arrived } = self;
        let is_nearer_to_arrival =
            |newest: Stamp| newest.0.abs_diff(arrived.0) < newest.0.abs_diff(acquired.0);
        if acquired > arrived && newest.is_some_and(is_nearer_to_arrival) { arrived } else { acquired }
    }
}

impl From<Stamp> for SensorTime {
    /// A time by the clock of the run.
    fn from(time: Stamp) -> SensorTime {
        SensorTime { acquired: time, arrived: time }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_time_from_the_future_is_told_by_the_clock_of_the_poses_and_any_other_is_its_own() {
        let time = |acquired: u64, arrived: u64, newest: Option<u64>| {
            let time = SensorTime { acquired: Stamp(acquired), arrived: Stamp(arrived) };
            time.by_clock_of(newest.map(Stamp)).0
        };
        assert_eq!(time(29_000, 1_000, Some(990)), 1_000);
        assert_eq!(time(29_000, 1_000, Some(1_040)), 1_000, "a pose that came later");
        assert_eq!(time(29_000, 1_000, Some(28_950)), 29_000, "the poses are ahead, too");
        assert_eq!(time(29_000, 1_000, None), 29_000);
        assert_eq!(time(900, 1_000, Some(29_000)), 900, "not from the future");
        assert_eq!(SensorTime::from(Stamp(7)).by_clock_of(Some(Stamp(3))), Stamp(7));
    }
}
