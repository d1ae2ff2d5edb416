//! Whether the local frame has jumped in the global one, as after a jump of the position fixes: a map that is saved then lies
//! beside its place by as much, and the next run does not find it.

use crate::register::at;
use rcs_geom::{DVec2, Pose};
use rcs_msg::Stamp;
use serde::{Deserialize, Serialize};

/// Time after which a vehicle that has driven on, so far at least, m, is believed to be where the local frame has jumped to, s:
/// the operator has seen it.
const ACCEPTED_S: f64 = 30.0;
const DROVE_ON_M: f64 = 2.0;

/// Follows where the local frame lies in the global one, from the first map on that is saved.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct JumpWatch {
    /// Where it lay last, before it jumped.
    before: Option<Pose>,
    /// Where the vehicle was when it jumped, local frame, m, and since when it has driven on from there.
    jumped: Option<(DVec2, Stamp)>,
}

impl JumpWatch {
    /// A map is saved with the local frame here: jumps from there count.
    pub(super) fn begin(&mut self, global_from_local: &Pose) {
        self.before.get_or_insert(*global_from_local);
    }

    /// Takes where the local frame lies in the global one, and the vehicle in the local one, m. Returns how far the
    /// frame has jumped where the vehicle is, m, if that is farther than `limit_m`, unless it is back, or the vehicle
    /// has driven on for long enough.
    pub(super) fn jumped_m(
        &mut self,
        global_from_local: &Pose,
        vehicle: DVec2,
        limit_m: f64,
        now: Stamp,
    ) -> Option<f64> {
        let by_m = at(global_from_local, vehicle).distance(at(&self.before?, vehicle));
        if by_m > limit_m {
            let (from, since) = self.jumped.get_or_insert((vehicle, now));
            if from.distance(vehicle) < DROVE_ON_M {
                *since = now;
            }
            if now.seconds_since(*since) < ACCEPTED_S {
                return Some(by_m);
            }
        }
        (self.before, self.jumped) = (Some(*global_from_local), None);
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_jump_lasts_until_the_frame_is_back_or_the_vehicle_has_driven_on_for_half_a_minute() {
        let mut watch = JumpWatch::default();
        let mut jumped_m = |frame_x_m: f64, vehicle_x_m: f64, second: u64| {
            let frame = Pose::from_xy_yaw(frame_x_m, 0.0, 0.0);
            let vehicle = DVec2::new(vehicle_x_m, 0.0);
            let by_m = watch.jumped_m(&frame, vehicle, 5.0, Stamp(second * 1_000_000_000));
            watch.begin(&frame);
            by_m
        };
        assert_eq!(
            [(0.0, 0), (4.0, 1), (8.0, 2)].map(|(x_m, s)| jumped_m(x_m, 0.0, s)),
            [None; 3],
            "it drifts"
        );
        assert_eq!([(28.0, 3), (27.0, 90)].map(|(x_m, s)| jumped_m(x_m, 1.0, s)), [Some(20.0), Some(19.0)]);
        assert_eq!(jumped_m(9.0, 1.0, 91), None, "it is back");
        assert_eq!([92, 150].map(|s| jumped_m(29.0, 1.0, s)), [Some(20.0); 2], "the vehicle stands");
        assert_eq!([151, 179].map(|s| jumped_m(29.0, 5.0, s)), [Some(20.0); 2]);
        assert_eq!([180, 181].map(|s| jumped_m(29.0, 9.0, s)), [None; 2]);
        assert_eq!(jumped_m(9.0, 9.0, 182), Some(20.0), "and back is a jump again");
    }

    #[test]
    fn a_jump_is_farther_than_the_limit() {
        for (limit_m, expected_m) in [(5.0, None), (4.9, Some(5.0)), (20.0, None)] {
            let mut watch = JumpWatch::default();
            watch.begin(&Pose::IDENTITY);
            let frame = Pose::from_xy_yaw(5.0, 0.0, 0.0);
            assert_eq!(watch.jumped_m(&frame, DVec2::ZERO, limit_m, Stamp(0)), expected_m, "{limit_m} m");
        }
    }
}
