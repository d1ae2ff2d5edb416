//! Whether the local frame of a vehicle has begun again, as after a restart of its odometry: what was known at places of the
//! frame before lies elsewhere then.

use rcs_geom::DVec2;
use rcs_msg::Stamp;
use serde::{Deserialize, Serialize};

/// A vehicle that is farther from where it was than this and what it drives at [`FASTEST_MPS`] has not driven there: its
/// local frame has begun again, m.
const LEAP_M: f64 = 5.0;
/// Faster than vehicles drive off roads, m/s.
const FASTEST_MPS: f64 = 10.0;

/// Poses come at least so often, ns: a vehicle whose pose did not change for longer stood.
const POSE_PERIOD_NS: u64 = 1_000_000_000;

/// Follows the position of a vehicle in its local frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct FrameWatch {
    /// Where the vehicle was last: time of its pose, and position in the local frame, m.
    was_at: Option<(Stamp, [f64; 2])>,
}

impl FrameWatch {
    /// Takes the position in the local frame at a time, m. Returns the length of the leap from the one before, m, if it is one.
    pub fn leap_m(&mut self, at: DVec2, now: Stamp) -> Option<f64> {
        let (then, was_at) = self.was_at.replace((now, at.to_array()))?;
        if at.to_array() == was_at {
            // It may be the pose of before, since when the vehicle has driven.
            self.was_at = Some((then.max(now.before_ns(POSE_PERIOD_NS)), was_at));
            return None;
        }
        let leap_m = at.distance(was_at.into());
        (leap_m > LEAP_M + FASTEST_MPS * now.seconds_since(then).abs()).then_some(leap_m)
    }

    /// Why the local frame has begun again, if it has: the clock of the poses has ([`crate::PosePorts::read`]), or the
    /// position leapt. `at`: where the vehicle is at this time, local frame, m, if that is known.
    pub fn begins_again(
        &mut self,
        has_clock_begun_again: bool,
        at: Option<DVec2>,
        now: Stamp,
    ) -> Option<String> {
        if has_clock_begun_again {
            self.was_at = at.map(|at| (now, at.to_array()));
            return Some("the clock of the poses has begun again".to_owned());
        }
        let leap_m = self.leap_m(at?, now)?;
        Some(format!("the pose in the local frame leapt by {leap_m:.1} m"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_position_leaps_if_the_vehicle_cannot_have_driven_there_and_is_then_where_it_goes_on() {
        let at = |s: u64| Stamp(s * 1_000_000_000);
        let mut watch = FrameWatch::default();
        let mut leap_m = |x_m: f64, s: u64| watch.leap_m(DVec2::new(x_m, 0.0), at(s));
        assert_eq!([(90.0, 0), (95.0, 0), (110.0, 1)].map(|(x_m, s)| leap_m(x_m, s)), [None; 3]);
        assert_eq!([leap_m(94.5, 2), leap_m(94.5, 3)], [Some(15.5), None]);
        assert_eq!(leap_m(-5.5, 13), None, "100 m in 10 s");
    }

    #[test]
    fn a_fast_vehicle_whose_poses_come_seldom_does_not_leap_and_one_that_stood_does() {
        let ms = |ms: u64| Stamp(ms * 1_000_000);
        let mut watch = FrameWatch::default();
        let mut leap_m = |x_m: f64, now_ms: u64| watch.leap_m(DVec2::new(x_m, 0.0), ms(now_ms));
        for now_ms in (0..3000).step_by(50) {
            let x_m = 8.0 * (now_ms / 500) as f64;
            assert_eq!(leap_m(x_m, now_ms), None, "16 m/s at 2 Hz, {now_ms} ms");
        }
        let stood = (3000..9000).step_by(50).map(|now_ms| leap_m(48.0, now_ms));
        assert_eq!(stood.flatten().count(), 0);
        assert_eq!(leap_m(64.0, 9000), Some(16.0));
    }

    #[test]
    fn a_frame_whose_clock_has_begun_again_is_not_said_to_leap_as_well() {
        let mut watch = FrameWatch::default();
        let mut why = |has_clock_begun_again: bool, x_m: Option<f64>| {
            watch.begins_again(has_clock_begun_again, x_m.map(|x_m| DVec2::new(x_m, 0.0)), Stamp(1))
        };
        assert_eq!(why(false, Some(50.0)), None);
        assert_eq!(why(true, None).as_deref(), Some("the clock of the poses has begun again"));
        assert_eq!([why(false, None), why(false, Some(0.0)), why(false, Some(0.1))], [None, None, None]);
        let leapt = "the pose in the local frame leapt by 49.9 m";
        assert_eq!(why(false, Some(50.0)).as_deref(), Some(leapt));
    }
}
