//! Clocks that begin again, as where a simulation or the driver of a sensor was started again during a recording.

use rcs_msg::Stamp;
use serde::{Deserialize, Serialize};

/// A time that is behind another one by more than this is far behind it, s.
const FAR_BEHIND_S: f64 = 10.0;

/// Tells a clock that has begun again from a message that is late.
///
/// One message that is far behind the newest one ([`ClockWatch::is_far_behind`]) may be late, and is not used. A second one
/// in a row, which is later than the first, means that the clock has begun again: it is used.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ClockWatch {
    /// Time of the message before, if that was so far behind the newest one.
    behind: Option<Stamp>,
}

impl ClockWatch {
    /// Whether a time is behind the newest one by more than 10 s: it is late, or of a clock that has begun again. By less, it
    /// is late.
    pub fn is_far_behind(newest: Stamp, time: Stamp) -> bool {
        newest.seconds_since(time) > FAR_BEHIND_S
    }

    /// Takes the time of each message, and that of the newest one that was used before. Whether the clock has begun again.
    pub fn begins_again(&mut self, newest: Option<Stamp>, time: Stamp) -> bool {
        let is_behind = newest.is_some_and(|newest| Self::is_far_behind(newest, time));
        let before = self.behind.take();
        let begins_again = is_behind && before.is_some_and(|before| time > before);
        self.behind = (is_behind && !begins_again).then_some(time);
        begins_again
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whether the clock has begun again at each of these times, s, of messages that are used if they are newer than those
    /// before, or if it has.
    fn begins_again<const N: usize>(times_s: [u64; N]) -> [bool; N] {
        let (mut watch, mut newest) = (ClockWatch::default(), None);
        times_s.map(|time_s| {
            let time = Stamp(time_s * 1_000_000_000);
            let begins_again = watch.begins_again(newest, time);
            newest = if begins_again { Some(time) } else { newest.max(Some(time)) };
            begins_again
        })
    }

    #[test]
    fn of_two_messages_in_a_row_that_are_far_behind_the_second_says_that_the_clock_has_begun_again() {
        assert_eq!(begins_again([500, 1, 2, 3, 4]), [false, false, true, false, false]);
        assert_eq!(begins_again([500, 1, 1, 2]), [false, false, false, true], "the same one twice");
        assert_eq!(begins_again([500, 300, 301, 1, 2])[2..], [true, false, true], "and once more");
    }

    #[test]
    fn a_time_is_far_behind_the_newest_one_by_more_than_10_s() {
        let is_far_behind = |ms: u64| ClockWatch::is_far_behind(Stamp(20_000_000_000), Stamp(ms * 1_000_000));
        assert_eq!([9_999, 10_000, 20_000, 40_000].map(is_far_behind), [true, false, false, false]);
    }

    #[test]
    fn late_messages_alone_out_of_order_or_by_little_are_of_no_other_clock() {
        assert_eq!(begins_again([500, 1, 501, 2, 502, 3]), [false; 6], "not in a row");
        assert_eq!(begins_again([500, 2, 1]), [false; 3], "out of order");
        assert_eq!(begins_again([500, 490, 491, 492, 493]), [false; 5], "by 10 s and less");
        assert_eq!(begins_again([1, 2, 60]), [false; 3]);
    }
}
