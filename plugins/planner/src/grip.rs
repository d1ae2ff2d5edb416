//! How far the wheels have gripped, as images tell it. Position fixes that put a vehicle back on its own track say that its
//! wheels have turned on the spot; where images have seen it move, the fixes have jumped.

use rcs_geom::DVec2;
use rcs_msg::rcs::WaySlip;
use rcs_sense::{SLIPPERY, is_by_images};
use serde::{Deserialize, Serialize};

/// Way that reports lag behind and that is between two of them, m.
const LAG_M: f64 = 1.5;

/// The way over which the wheels have gripped without a break.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Gripped {
    /// Where the last report that says so was, local frame, m.
    last: Option<(f64, f64)>,
    /// Length of the way up to there, m.
    length_m: f64,
}

impl Gripped {
    /// Takes a report, the middle of which is here in the local frame, m.
    pub fn take(&mut self, report: &WaySlip, middle: DVec2) {
        if !is_by_images(report) || report.slip >= SLIPPERY {
            *self = Self::default();
            return;
        }
        let step_m = self.last.map(|last| middle.distance(DVec2::from(last)));
        // What lies before a gap is not known any more.
        self.length_m = step_m.filter(|&step_m| step_m <= LAG_M).map_or(0.0, |step_m| self.length_m + step_m);
        self.last = Some((middle.x, middle.y));
    }

    /// Whether the wheels have gripped over the last metres.
    pub fn covers(&self, way_m: f64) -> bool {
        self.length_m + LAG_M >= way_m
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn report(rolled_m: f64, slip: f64) -> WaySlip {
        WaySlip { rolled_m, slip, ..WaySlip::default() }
    }

    fn driven(to_m: f64) -> Gripped {
        let mut gripped = Gripped::default();
        for step in 0..=(to_m / 0.4) as u32 {
            gripped.take(&report(1.0, 0.05), DVec2::new(f64::from(step) * 0.4, 0.0));
        }
        gripped
    }

    #[test]
    fn wheels_grip_over_as_much_as_images_have_seen_without_a_break() {
        assert!(!Gripped::default().covers(2.5), "nothing is known");
        let gripped = driven(8.0);
        assert!(gripped.covers(9.0) && !gripped.covers(10.0));
        let after = |rolled_m, slip, x_m| {
            let mut gripped = driven(8.0);
            gripped.take(&report(rolled_m, slip), DVec2::new(x_m, 0.0));
            gripped
        };
        assert!(after(1.0, 0.1, 8.4).covers(9.8));
        for broken in [after(1.0, 0.5, 8.4), after(5.0, 0.0, 8.4), after(1.0, 0.0, 12.0)] {
            assert!(!broken.covers(2.5), "{broken:?}");
        }
    }
}
