//! Slip over some metres (`rcs.WaySlip`), and what it tells of the ground.

use rcs_msg::Stamp;
use rcs_msg::rcs::WaySlip;
use serde::{Deserialize, Serialize};

/// Slip over some metres from which on the ground is slippery: firm ground and growth have less than 0.2 in truth, flat mud
/// 0.5.
pub const SLIPPERY: f64 = 0.35;

/// Greatest slip by position fixes that tells anything of the ground: with more, the vehicle hardly moves, and without images
/// the local frame moves on over ground that its wheels have not touched.
const MOST_BY_FIXES: f64 = 0.7;

/// Greatest way of a report by images, m: those by fixes are about 5 m long.
const BY_IMAGES_M: f64 = 2.0;

/// A report of slip holds no longer than this, s: where the vehicle moves, the next one by fixes comes sooner.
const HOLDS_S: f64 = 10.0;

/// Whether images tell the slip, and not position fixes.
pub fn is_by_images(report: &WaySlip) -> bool {
    report.rolled_m <= BY_IMAGES_M
}

/// Whether the ground in the middle of the way of a report is slippery.
pub fn is_slippery(report: &WaySlip) -> bool {
    report.slip >= SLIPPERY && (is_by_images(report) || report.slip <= MOST_BY_FIXES)
}

/// Whether the wheels slipped over the last metres.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LastSlip {
    /// When that was told last, unless a later report says that they gripped.
    told: Option<Stamp>,
}

impl LastSlip {
    /// Takes a report that comes at this time.
    pub fn take(&mut self, report: &WaySlip, now: Stamp) {
        self.told = (report.slip >= SLIPPERY).then_some(now);
    }

    /// Whether they slipped, as far as is known.
    pub fn is_on(&self, now: Stamp) -> bool {
        self.told.is_some_and(|told| now.seconds_since(told) <= HOLDS_S)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ground_is_slippery_by_images_at_any_slip_and_by_fixes_where_the_vehicle_gets_on() {
        let of = |slip: f64, rolled_m: f64| is_slippery(&WaySlip { slip, rolled_m, ..WaySlip::default() });
        assert_eq!([0.2, 0.5, 0.9].map(|slip| of(slip, 1.0)), [false, true, true]);
        assert_eq!([0.2, 0.5, 0.9].map(|slip| of(slip, 5.0)), [false, true, false]);
    }

    #[test]
    fn wheels_slip_until_they_grip_or_nothing_is_told_any_more() {
        let report = |slip: f64| WaySlip { slip, ..WaySlip::default() };
        let mut last = LastSlip::default();
        assert!(!last.is_on(Stamp(0)));
        last.take(&report(0.9), Stamp(1_000_000_000));
        assert!(last.is_on(Stamp(10_000_000_000)) && !last.is_on(Stamp(12_000_000_000)));
        last.take(&report(0.1), Stamp(2_000_000_000));
        assert!(!last.is_on(Stamp(2_000_000_000)));
    }
}
