//! The clock of a recording's transforms, where it is not that of the log.
//!
//! Transforms are kept by their own stamps. With simulated time, time since boot, or a clock that is hours off, these have
//! nothing to do with the log times by which a recording is played. So for a moment of the log the time of the transforms
//! is that of the newest transform message before it, plus the log time that has passed since.
//!
//! Publishers differ: corrections of a map are often stamped ahead of the odometry. So the clock follows the transforms of
//! one frame, the one that is sent most often; stamps of the others would move it to and fro.
//!
//! Where the stamps begin again, another [`TransformClock`] begins, too (`epochs.rs`).
//!
//! This holds only where most transforms are stamped more than [`SAME_NS`] away from their log times. Otherwise both clocks
//! count as one, and no time changes: delays, and stamps ahead of the clock, are as the recording has them.
//!
//! State: 24 bytes for a message whose stamp does not follow from the ones before it, and a count for each frame; none where
//! the clocks are one.

use rcs_msg::Stamp;
use std::collections::BTreeMap;

/// Clocks that are not farther apart than this count as one, ns.
pub(super) const SAME_NS: u64 = 10_000_000_000;
/// A clock whose stamps go back by more than this has begun again, ns; by less, they came out of order.
pub(super) const BEGINS_AGAIN_NS: u64 = 5_000_000_000;
/// A stamp that is as near as this to the expected one tells nothing new, ns.
const EXPECTED_NS: u64 = 5_000_000;

/// A message whose stamp is far from its log time.
#[derive(Clone, Copy, Debug)]
struct Pair {
    log_time: Stamp,
    stamp: Stamp,
    /// The clock is not later than this before the next pair: a clock that stands still, or runs slower than that of the
    /// log, does not overtake its next stamp.
    until: Stamp,
}

impl Pair {
    /// The time of the transforms at a later log time.
    fn at(&self, log_time: Stamp) -> Stamp {
        self.stamp.after_ns(log_time.0.saturating_sub(self.log_time.0)).min(self.until)
    }
}

/// Translates log times to times of the transforms.
#[derive(Clone, Debug, Default)]
pub struct TransformClock {
    /// By log time.
    pairs: Vec<Pair>,
    /// The last stamp of the followed frame that was far from its log time.
    newest: Stamp,
    /// The child frame whose transforms make the pairs; empty before the first one.
    followed: String,
    /// Number of transforms whose stamps are far from their log times, by child frame.
    far_of: BTreeMap<String, u64>,
    /// Number of transforms whose stamps are near their log times, and of the others.
    near: u64,
    far: u64,
    /// Oldest and newest stamp.
    span: Option<(Stamp, Stamp)>,
    /// Log time at which the stamps began again; `None` for the first ones of a log.
    begun: Option<Stamp>,
}

impl TransformClock {
    /// The clock from this log time on, at which the stamps begin again.
    pub(super) fn begun_at(log_time: Stamp) -> Self {
        Self { begun: Some(log_time), ..Self::default() }
    }

    /// Whether the stamps began again shortly before a log time, so that there may still be some of before.
    pub(super) fn has_just_begun(&self, log_time: Stamp) -> bool {
        self.begun.is_some_and(|begun| log_time < begun.after_ns(BEGINS_AGAIN_NS))
    }

    /// Adds the stamp of a transform of the frame `child`; log times ascend.
    pub(super) fn add(&mut self, child: &str, log_time: Stamp, stamp: Stamp) {
        let (first, last) = self.span.unwrap_or((stamp, stamp));
        self.span = Some((first.min(stamp), last.max(stamp)));
        if log_time.0.abs_diff(stamp.0) <= SAME_NS {
            self.near += 1;
            return;
        }
        self.far += 1;
        if !self.follows(child) {
            return;
        }
        let before = std::mem::replace(&mut self.newest, stamp);
        if let Some(last) = self.pairs.last_mut() {
            let is_expected = last.at(log_time).0.abs_diff(stamp.0) <= EXPECTED_NS;
            if is_expected || log_time <= last.log_time {
                return;
            }
            // Stamps that begin again are no limit.
            if stamp >= before {
                last.until = stamp;
            }
        }
        self.pairs.push(Pair { log_time, stamp, until: Stamp::MAX });
    }

    /// Counts a transform whose stamp is far from its log time; whether the pairs follow its frame. A frame that has been
    /// sent more than twice as often as the followed one is followed from then on: one that is sent once tells nothing of
    /// a clock that is not as fast as that of the log, and by less than twice the clock would change again and again.
    fn follows(&mut self, child: &str) -> bool {
        let count = if let Some(count) = self.far_of.get_mut(child) {
            *count += 1;
            *count
        } else {
            self.far_of.insert(child.to_owned(), 1);
            1
        };
        if *child != *self.followed {
            let of_followed = self.far_of.get(&self.followed).copied().unwrap_or_default();
            if count <= 2 * of_followed {
                return false;
            }
            child.clone_into(&mut self.followed);
        }
        true
    }

    /// Whether it has no transform.
    pub(super) fn is_empty(&self) -> bool {
        self.span.is_none()
    }

    /// The time of the transforms at a log time; the same where the clocks are one.
    pub(super) fn at(&self, log_time: Stamp) -> Stamp {
        if self.near >= self.far {
            return log_time;
        }
        let after = self.pairs.partition_point(|pair| pair.log_time <= log_time);
        match (after.checked_sub(1).and_then(|before| self.pairs.get(before)), self.pairs.first()) {
            (Some(pair), _) => pair.at(log_time),
            (None, Some(first)) => first.stamp.before_ns(first.log_time.0 - log_time.0),
            (None, None) => log_time,
        }
    }

    /// Whether the time that a message of a log time states can be of the clock of the transforms: near the time that they
    /// span, where the stamps have not begun again since the message. Without a transform, any can.
    pub(super) fn covers(&self, time: Stamp, log_time: Stamp) -> bool {
        let span = self.span.map(|(first, last)| first.before_ns(SAME_NS)..=last.after_ns(SAME_NS));
        self.begun.is_none_or(|begun| log_time >= begun) && span.is_none_or(|span| span.contains(&time))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const S: u64 = 1_000_000_000;
    const T0: u64 = 1_700_000_000 * S;

    fn clock(pairs: impl IntoIterator<Item = (u64, u64)>) -> TransformClock {
        let mut clock = TransformClock::default();
        pairs.into_iter().for_each(|(log, stamp)| clock.add("base", Stamp(log), Stamp(stamp)));
        clock
    }

    #[test]
    fn clocks_that_are_near_each_other_are_one() {
        assert_eq!(clock([]).at(Stamp(7)), Stamp(7));
        let late = clock((0..100).map(|i| (T0 + i * S, T0 + i * S - S / 2)));
        let one_publisher_is_off =
            clock((0..100).map(|i| (T0 + i * S, if i % 3 == 0 { i * S } else { T0 + i * S })));
        for time in [T0 - S, T0, T0 + 50 * S + 1, T0 + 1000 * S].map(Stamp) {
            assert_eq!([late.at(time), one_publisher_is_off.at(time)], [time; 2]);
        }
        let covers = |clock: &TransformClock, stamp: u64| clock.covers(Stamp(stamp), Stamp(T0));
        assert!(covers(&late, T0) && !covers(&late, 100 * S) && covers(&clock([]), 3));
    }

    #[test]
    fn a_clock_of_its_own_is_followed_from_message_to_message() {
        // Simulated time that runs at half the speed.
        let slow = clock((0..100).map(|i| (T0 + i * S, 100 * S + i * S / 2)));
        assert_eq!(slow.at(Stamp(T0 + 10 * S)), Stamp(105 * S));
        assert_eq!(slow.at(Stamp(T0 + 10 * S + S / 4)), Stamp(105 * S + S / 4));
        assert_eq!(
            slow.at(Stamp(T0 + 10 * S + S * 3 / 4)),
            Stamp(105 * S + S / 2),
            "not past the next stamp"
        );
        assert_eq!(slow.at(Stamp(T0 - S)), Stamp(99 * S), "before the first one");
        assert_eq!(slow.at(Stamp(T0 + 109 * S)), Stamp(149 * S + S / 2 + 10 * S), "after the last one");
        assert!(slow.covers(Stamp(95 * S), Stamp(T0)) && !slow.covers(Stamp(T0), Stamp(T0)));
    }

    #[test]
    fn stamps_of_another_publisher_that_are_ahead_do_not_move_the_clock() {
        // Simulated time from 100 s on. A correction, stamped 1 s ahead, is sent first and then once a second.
        let mut clock = TransformClock::default();
        let times = |i: u64| (T0 + i * S / 50, 100 * S + i * S / 50);
        for (i, (log, stamp)) in (0..500).map(|i| (i, times(i))) {
            if i % 50 == 0 {
                clock.add("odom", Stamp(log - 1000), Stamp(stamp + S));
            }
            clock.add("base", Stamp(log), Stamp(stamp));
        }
        for (log, stamp) in (3..500).map(times) {
            assert_eq!(clock.at(Stamp(log - 500)), Stamp(stamp - 500));
        }
        // One that is sent once does not stop a clock of half the speed from being followed.
        clock = TransformClock::default();
        clock.add("camera", Stamp(T0), Stamp(100 * S));
        (0..100).for_each(|i| clock.add("base", Stamp(T0 + i * S), Stamp(100 * S + i * S / 2)));
        assert_eq!(clock.at(Stamp(T0 + 90 * S)), Stamp(145 * S));
    }

    #[test]
    fn an_offset_is_one_pair_however_long_the_recording_is() {
        let offset = clock((0..1000).map(|i| (T0 + i * S / 50, T0 - 7200 * S + i * S / 50)));
        assert_eq!(offset.pairs.len(), 1);
        assert_eq!(offset.at(Stamp(T0 + 3 * S)), Stamp(T0 - 7197 * S));
        // Started again: the stamps begin again, and are followed there.
        let again = clock((0..100).map(|i| (T0 + i * S, (i % 50) * S)));
        assert_eq!([again.at(Stamp(T0 + 49 * S)), again.at(Stamp(T0 + 50 * S))], [Stamp(49 * S), Stamp(0)]);
    }
}
