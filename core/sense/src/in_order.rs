//! The order of the messages of an input, by the times of their content.

use crate::clock::ClockWatch;
use rcs_msg::Stamp;
use serde::{Deserialize, Serialize};

/// Refuses messages that come twice or late: they would be counted twice, or replace newer ones.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct InOrder {
    last: Option<Stamp>,
    clock: ClockWatch,
}

impl InOrder {
    /// Takes the time of a message. Returns whether its clock has begun again; of such a clock, the first message is refused
    /// ([`ClockWatch`]). If it is not newer than the one before, the error is by how much it is older, s. A time from the
    /// future does not make others older, which would all be refused until the clock is there, but does not count twice.
    pub fn take(&mut self, time: Stamp, now: Stamp) -> Result<bool, f64> {
        let begins_again = self.clock.begins_again(self.last.filter(|&last| last <= now), time);
        let is_older = |last: &Stamp| *last == time || (time..=now).contains(last);
        if let Some(last) = self.last.filter(|last| !begins_again && is_older(last)) {
            return Err(last.seconds_since(time));
        }
        self.last = Some(time);
        Ok(begins_again)
    }
}

/// Tells a sensor that repeats its last message from one that measures, by the time that the message itself states.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Repeats {
    last: Option<Stamp>,
}

impl Repeats {
    /// Takes the time in a message. Returns whether it is that of the message before; without one, nothing is known. A time
    /// of 0 counts as none, as in the feed of a log: drivers that state no time leave it so.
    pub fn take(&mut self, stated: Option<Stamp>) -> bool {
        let stated = stated.filter(|time| time.0 != 0);
        let repeats = stated.is_some() && stated == self.last;
        self.last = stated;
        repeats
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_message_with_the_time_of_the_one_before_repeats_it() {
        let mut repeats = Repeats::default();
        let times = [Some(1), Some(1), Some(2), Some(1), None, None, Some(1)];
        let told = times.map(|time| repeats.take(time.map(Stamp)));
        assert_eq!(told, [false, true, false, false, false, false, false]);
    }

    #[test]
    fn messages_that_leave_their_time_at_0_state_none_and_repeat_nothing() {
        let mut repeats = Repeats::default();
        let times = [0, 0, 0, 7, 0, 7].map(|time| repeats.take(Some(Stamp(time))));
        assert_eq!(times, [false; 6]);
    }

    #[test]
    fn what_comes_twice_or_late_is_refused_and_a_time_from_the_future_does_not_make_the_next_late() {
        let second = |s: u64| Stamp(s * 1_000_000_000);
        let mut order = InOrder::default();
        let mut take = |time_s: u64, now_s: u64| order.take(second(time_s), second(now_s));
        assert_eq!(take(10, 11), Ok(false));
        assert_eq!(take(10, 11), Err(0.0));
        assert_eq!(take(8, 11), Err(2.0));
        assert_eq!(take(11, 11), Ok(false));
        assert_eq!(take(3600, 12), Ok(false));
        assert_eq!(take(12, 13), Ok(false));
        assert_eq!(take(11, 13), Err(1.0));
    }

    #[test]
    fn of_a_clock_that_begins_again_one_message_is_refused_and_one_late_message_makes_no_other_late() {
        let ms = |ms: u64| Stamp(ms * 1_000_000);
        let mut order = InOrder::default();
        let mut take = |time_ms: u64| order.take(ms(time_ms), ms(900_000)).ok();
        let begins_again = [500_000, 1_000, 1_100, 1_200, 1_150].map(&mut take);
        assert_eq!(begins_again, [Some(false), None, Some(true), Some(false), None]);
        let one_is_late = [500_000, 1_300, 500_100, 500_050].map(take);
        assert_eq!(one_is_late, [Some(false), None, Some(false), None]);
    }

    #[test]
    fn what_comes_twice_from_a_sensor_whose_clock_is_ahead_is_refused() {
        let ms = |ms: u64| Stamp(ms * 1_000_000);
        let mut order = InOrder::default();
        assert_eq!(order.take(ms(28_000), ms(10_000)), Ok(false));
        assert_eq!(order.take(ms(28_000), ms(10_200)), Err(0.0));
        assert_eq!(order.take(ms(28_200), ms(10_400)), Ok(false));
    }
}
