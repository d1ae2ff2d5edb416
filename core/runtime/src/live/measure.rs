//! Measurements of a live process's cycles: waking, waiting for the lock and computing, separately.

use rcs_msg::rcs;
use std::time::Duration;

/// Number of buckets per power of two of microseconds: a percentile is at most an eighth too high.
const STEPS: usize = 8;
/// Enough buckets for an hour.
const BUCKETS: usize = 32 * STEPS;

/// A histogram of durations with logarithmic buckets.
#[derive(Clone)]
pub(super) struct Durations {
    buckets: Box<[u32; BUCKETS]>,
    count: u64,
    total: Duration,
    max: Duration,
}

impl Default for Durations {
    fn default() -> Self {
        Self { buckets: Box::new([0; BUCKETS]), count: 0, total: Duration::ZERO, max: Duration::ZERO }
    }
}

fn bucket_of(duration: Duration) -> usize {
    let us = u64::try_from(duration.as_micros()).unwrap_or(u64::MAX);
    let index = match us.checked_ilog2() {
        Some(exponent) if exponent >= 3 => {
            (exponent as usize - 2) * STEPS + (us >> (exponent - 3)) as usize % STEPS
        }
        _ => us as usize,
    };
    index.min(BUCKETS - 1)
}

/// Upper limit of the durations in a bucket.
fn bucket_end_us(index: usize) -> f64 {
    if index < STEPS {
        return (index + 1) as f64;
    }
    let exponent = index / STEPS + 2;
    ((STEPS + index % STEPS + 1) as f64) * ((exponent - 3) as f64).exp2()
}

fn us(duration: Duration) -> f64 {
    duration.as_secs_f64() * 1e6
}

impl Durations {
    pub(super) fn add(&mut self, duration: Duration) {
        let bucket = &mut self.buckets[bucket_of(duration)];
        *bucket = bucket.saturating_add(1);
        self.count += 1;
        self.total += duration;
        self.max = self.max.max(duration);
    }

    pub(super) fn mean_us(&self) -> f64 {
        us(self.total) / self.count.max(1) as f64
    }

    pub(super) fn max_us(&self) -> f64 {
        us(self.max)
    }

    /// The 99th percentile of the durations.
    pub(super) fn p99_us(&self) -> f64 {
        let wanted = (self.count * 99).div_ceil(100);
        let mut seen = 0;
        for (index, &count) in self.buckets.iter().enumerate() {
            seen += u64::from(count);
            if count > 0 && seen >= wanted {
                return bucket_end_us(index).min(self.max_us());
            }
        }
        0.0
    }
}

/// One cycle, measured.
#[derive(Clone, Copy, Debug)]
pub(super) struct CycleTimes {
    /// From when the cycle was due until its thread ran.
    pub(super) wake_late: Duration,
    /// From there until it had the lock to capture its inputs.
    pub(super) capture_wait: Duration,
    /// The process's own computation.
    pub(super) compute: Duration,
    /// From there until it had the lock to publish.
    pub(super) publish_wait: Duration,
    /// From when the cycle was due until everything was published.
    pub(super) whole: Duration,
}

/// All cycles of a process, measured.
#[derive(Clone, Default)]
pub(super) struct Measured {
    wake_late: Durations,
    start_late: Durations,
    lock_wait: Durations,
    compute: Durations,
    overruns: u64,
    missed: u64,
    missed_by_lock: u64,
}

impl Measured {
    /// Adds a cycle, and returns after how many periods the next one is due: 1 if this one ended in time. A cycle that
    /// began in time keeps its phase; cycles that could not begin are counted as missed and not made up for.
    pub(super) fn add(&mut self, times: &CycleTimes, period: Duration) -> u32 {
        let lock_wait = times.capture_wait + times.publish_wait;
        self.wake_late.add(times.wake_late);
        self.start_late.add(times.wake_late + times.capture_wait);
        self.lock_wait.add(lock_wait);
        self.compute.add(times.compute);
        if times.whole <= period {
            return 1;
        }
        self.overruns += 1;
        let period_ns = period.as_nanos().max(1);
        let skipped = ((times.whole.as_nanos() - 1) / period_ns).min(u128::from(u32::MAX - 1)) as u32;
        self.missed += u64::from(skipped);
        if times.whole.saturating_sub(lock_wait) <= period {
            self.missed_by_lock += u64::from(skipped);
        }
        skipped + 1
    }

    pub(super) fn report(&self, process: &str) -> rcs::ProcessTiming {
        rcs::ProcessTiming {
            process: process.to_owned(),
            cycles: self.compute.count,
            mean_us: self.compute.mean_us(),
            max_us: self.compute.max_us(),
            overruns: self.overruns,
            p99_us: self.compute.p99_us(),
            wake_late_mean_us: self.wake_late.mean_us(),
            wake_late_p99_us: self.wake_late.p99_us(),
            wake_late_max_us: self.wake_late.max_us(),
            lock_wait_mean_us: self.lock_wait.mean_us(),
            lock_wait_p99_us: self.lock_wait.p99_us(),
            lock_wait_max_us: self.lock_wait.max_us(),
            start_late_p99_us: self.start_late.p99_us(),
            missed: self.missed,
            missed_by_lock: self.missed_by_lock,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Duration = Duration::from_millis(1);

    fn cycle(wake_ms: u32, lock_ms: u32, compute_ms: u32) -> CycleTimes {
        CycleTimes {
            wake_late: MS * wake_ms,
            capture_wait: Duration::ZERO,
            compute: MS * compute_ms,
            publish_wait: MS * lock_ms,
            whole: MS * (wake_ms + lock_ms + compute_ms),
        }
    }

    #[test]
    fn a_percentile_is_at_most_an_eighth_too_high() {
        for us in [1_u64, 7, 8, 9, 100, 1000, 1999, 2000, 2001, 123_456, 60_000_000] {
            let mut durations = Durations::default();
            (0..200).for_each(|_| durations.add(Duration::from_micros(us)));
            durations.add(Duration::from_mins(50));
            let p99 = durations.p99_us();
            assert!(p99 >= us as f64 && p99 <= us as f64 * 1.126 + 1.0, "{us} µs reads {p99} µs");
        }
    }

    #[test]
    fn one_cycle_in_a_hundred_does_not_move_the_percentile_and_two_do() {
        let mut durations = Durations::default();
        (0..99).for_each(|_| durations.add(MS));
        durations.add(MS * 50);
        assert!(durations.p99_us() < 1200.0);
        durations.add(MS * 50);
        assert!(durations.p99_us() > 49_000.0);
    }

    #[test]
    fn after_an_overrun_the_grid_is_kept_and_what_could_not_begin_is_missed() {
        let mut measured = Measured::default();
        assert_eq!(measured.add(&cycle(1, 0, 5), MS * 20), 1);
        assert_eq!(measured.add(&cycle(0, 0, 20), MS * 20), 1, "done just in time");
        assert_eq!(measured.add(&cycle(0, 0, 25), MS * 20), 2);
        assert_eq!(measured.add(&cycle(2, 0, 63), MS * 20), 4);
        let report = measured.report("slow");
        assert_eq!((report.cycles, report.overruns, report.missed, report.missed_by_lock), (4, 2, 4, 0));
    }

    #[test]
    fn a_cycle_that_would_have_been_in_time_without_the_lock_is_missed_by_the_lock() {
        let mut measured = Measured::default();
        assert_eq!(measured.add(&cycle(1, 18, 5), MS * 20), 2);
        assert_eq!(measured.add(&cycle(1, 1, 25), MS * 20), 2);
        let report = measured.report("held up");
        assert_eq!((report.missed, report.missed_by_lock), (2, 1));
    }
}
