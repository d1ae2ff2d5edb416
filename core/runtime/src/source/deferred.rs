//! Fields that an emergency stop kept from being gathered, and when they are to be.

use rcs_formula::FieldRef;
use std::time::{Duration, Instant};

/// They wait until no other stop has come for this time. A window sends a stop more often than that until the vehicle
/// confirms it, for which time must go on.
const AGAIN: Duration = Duration::from_secs(1);
/// From this time after the first interruption on, they wait no longer: the vehicle may never confirm the stop.
const AT_LAST: Duration = Duration::from_secs(5);

/// Fields that are to be gathered later.
pub(super) struct Deferred {
    pub(super) fields: Vec<FieldRef>,
    /// When a stop interrupted first.
    pub(super) first: Instant,
    at: Instant,
}

impl Deferred {
    /// Fields whose gathering was interrupted now, and `before` for the first time; `None` if never before.
    pub(super) fn new(fields: Vec<FieldRef>, before: Option<Instant>, now: Instant) -> Self {
        let mut deferred = Self { fields, first: before.unwrap_or(now), at: now };
        deferred.put_off(now);
        deferred
    }

    /// When the fields are to be gathered.
    pub(super) fn at(&self) -> Instant {
        self.at
    }

    /// Another stop has come.
    pub(super) fn put_off(&mut self, now: Instant) {
        self.at = (now + AGAIN).min(self.first + AT_LAST);
    }

    /// Whether fields that a stop interrupted `first` wait no longer.
    pub(super) fn is_overdue(first: Instant, now: Instant) -> bool {
        now >= first + AT_LAST
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_are_gathered_a_second_after_the_last_stop_and_at_last_although_stops_go_on() {
        let start = Instant::now();
        let mut deferred = Deferred::new(Vec::new(), None, start);
        assert_eq!(deferred.at(), start + AGAIN);
        for i in 1..20 {
            let now = start + i * AGAIN / 2;
            deferred.put_off(now);
            assert_eq!(deferred.at(), (now + AGAIN).min(start + AT_LAST));
        }
        assert!(!Deferred::is_overdue(start, start + AGAIN) && Deferred::is_overdue(start, deferred.at()));
        let again = Deferred::new(deferred.fields, Some(deferred.first), deferred.at);
        assert_eq!(again.at(), start + AT_LAST, "interrupted again, it counts from the first time");
    }
}
