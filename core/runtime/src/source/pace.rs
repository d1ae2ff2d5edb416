//! Pacing: where a source should be according to the clock, and how far it is behind.

use rcs_msg::Stamp;
use std::time::{Duration, Instant};

/// Greatest delay that a source catches up with, in seconds of the clock. A greater delay is given up, because a
/// vehicle that someone drives must not race through the time of a stall.
const CATCH_UP_S: f64 = 0.25;
/// Least time over which the achieved speed is measured.
const MEASURED_OVER: Duration = Duration::from_millis(500);
/// Initial size of pieces of work; it adapts to how long they take.
const FIRST_PIECE_NS: u64 = 20_000_000;
const PIECES_NS: std::ops::RangeInclusive<u64> = 1_000_000..=10_000_000_000;

/// Paces a source by the clock. Clock times are arguments, so that tests can use their own.
#[derive(Debug)]
pub(super) struct Pace {
    /// Seconds of the source per second of the clock; infinite for as fast as possible.
    speed: f64,
    /// A clock time, and the target time of the source at that time.
    anchor: Option<(Instant, Stamp)>,
    /// Time of the source that will not be caught up with, in seconds.
    given_up_s: f64,
    lag_s: f64,
    /// Start of the measurement of the achieved speed.
    measured: Option<(Instant, Stamp)>,
    achieved: Option<f64>,
    /// Size of the next piece of work.
    piece_ns: u64,
}

impl Pace {
    /// A pace for a source that is not playing yet.
    pub(super) fn new() -> Self {
        Self {
            speed: 1.0,
            anchor: None,
            given_up_s: 0.0,
            lag_s: 0.0,
            measured: None,
            achieved: None,
            piece_ns: FIRST_PIECE_NS,
        }
    }

    /// Restarts at the current time of the source: after a pause, a seek, or a change of speed.
    pub(super) fn restart(&mut self, speed: f64) {
        *self = Self { speed, piece_ns: self.piece_ns, ..Self::new() };
    }

    /// Target time of the source now. Gives up what it cannot catch up with.
    pub(super) fn target(&mut self, clock: Instant, now: Stamp) -> Stamp {
        self.measured.get_or_insert((clock, now));
        if self.speed.is_infinite() {
            return Stamp::MAX;
        }
        let (since, from) = *self.anchor.get_or_insert((clock, now));
        let due =
            from.after_ns((clock.saturating_duration_since(since).as_secs_f64() * self.speed * 1e9) as u64);
        let most_behind_ns = (CATCH_UP_S * self.speed * 1e9) as u64;
        let reachable = now.after_ns(most_behind_ns);
        if due <= reachable {
            return due;
        }
        self.given_up_s += due.seconds_since(reachable);
        self.anchor = Some((clock, reachable));
        reachable
    }

    /// Updates the pace: the source is at `now`; its target is `target`.
    pub(super) fn arrived(&mut self, clock: Instant, now: Stamp, target: Stamp) {
        if !self.speed.is_infinite() {
            self.lag_s = self.given_up_s + target.seconds_since(now).max(0.0);
        }
        if let Some((since, from)) = self.measured {
            let elapsed = clock.saturating_duration_since(since);
            if elapsed >= MEASURED_OVER {
                self.achieved = Some(now.seconds_since(from) / elapsed.as_secs_f64());
                self.measured = Some((clock, now));
            }
        }
    }

    /// Delay of the source relative to the clock since it was last started, in its own seconds.
    pub(super) fn lag_s(&self) -> f64 {
        self.lag_s
    }

    /// Measured seconds of the source per second; `None` until it has played for a moment.
    pub(super) fn achieved(&self) -> Option<f64> {
        self.achieved
    }

    /// How much time of the source to process at once.
    pub(super) fn piece_ns(&self) -> u64 {
        self.piece_ns
    }

    /// Adapts the size of the pieces to the duration of the last one, so that several fit into `budget`.
    pub(super) fn piece_took(&mut self, took: Duration, budget: Duration) {
        let next = if took > budget / 2 {
            self.piece_ns / 2
        } else if took < budget / 8 {
            self.piece_ns.saturating_mul(2)
        } else {
            self.piece_ns
        };
        self.piece_ns = next.clamp(*PIECES_NS.start(), *PIECES_NS.end());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn seconds(s: f64) -> Duration {
        Duration::from_secs_f64(s)
    }

    #[test]
    fn a_source_that_keeps_up_is_where_the_clock_says() {
        let (start, mut pace) = (Instant::now(), Pace::new());
        pace.restart(2.0);
        let mut now = Stamp(5_000_000_000);
        for i in 0..100 {
            let clock = start + seconds(f64::from(i) * 0.02);
            let target = pace.target(clock, now);
            now = target;
            pace.arrived(clock, now, target);
        }
        assert!((now.seconds_since(Stamp(5_000_000_000)) - 2.0 * 99.0 * 0.02).abs() < 1e-6);
        assert_eq!(pace.lag_s(), 0.0);
        assert!((pace.achieved().unwrap() - 2.0).abs() < 0.01);
    }

    #[test]
    fn a_source_that_cannot_keep_up_falls_behind_and_never_races_to_catch_up() {
        let (start, mut pace) = (Instant::now(), Pace::new());
        pace.restart(1.0);
        let mut now = Stamp(0);
        // Half of real time for ten seconds.
        for i in 0..=500 {
            let clock = start + seconds(f64::from(i) * 0.02);
            let target = pace.target(clock, now);
            assert!(target.seconds_since(now) <= CATCH_UP_S + 1e-9, "the work to do does not grow");
            now = now.after_ns(10_000_000).min(target);
            pace.arrived(clock, now, target);
        }
        assert!((pace.lag_s() - 5.0).abs() < 0.05, "{}", pace.lag_s());
        assert!((pace.achieved().unwrap() - 0.5).abs() < 0.02);
        // Then fast again: it continues at speed 1 and reports the lost time.
        let (from, since) = (now, start + seconds(10.0));
        for i in 1..=50 {
            let clock = since + seconds(f64::from(i) * 0.02);
            let target = pace.target(clock, now);
            now = target;
            pace.arrived(clock, now, target);
        }
        assert!(now.seconds_since(from) < 1.0 + CATCH_UP_S + 1e-6);
        assert!((4.7..5.0).contains(&pace.lag_s()), "{}", pace.lag_s());
    }

    #[test]
    fn as_fast_as_it_goes_has_no_lag_and_says_how_fast_that_is() {
        let (start, mut pace) = (Instant::now(), Pace::new());
        pace.restart(f64::INFINITY);
        let mut now = Stamp(0);
        for i in 0..60 {
            let clock = start + seconds(f64::from(i) * 0.01);
            let target = pace.target(clock, now);
            assert_eq!(target, Stamp::MAX);
            now = now.after_ns(70_000_000);
            pace.arrived(clock, now, target);
        }
        assert_eq!(pace.lag_s(), 0.0);
        assert!((pace.achieved().unwrap() - 7.0).abs() < 0.2);
    }

    #[test]
    fn pieces_grow_and_shrink_within_bounds() {
        let mut pace = Pace::new();
        let budget = Duration::from_millis(24);
        for _ in 0..40 {
            pace.piece_took(Duration::ZERO, budget);
        }
        assert_eq!(pace.piece_ns(), *PIECES_NS.end());
        for _ in 0..40 {
            pace.piece_took(Duration::from_secs(1), budget);
        }
        assert_eq!(pace.piece_ns(), *PIECES_NS.start());
    }
}
