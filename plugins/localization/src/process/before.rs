//! Both estimates after `INIT`: they go on where they were. Of a local frame that began anew, nobody would know where it
//! lies in the global one until two fixes have agreed, and by the transform of the frame before, the goal and the zones
//! would lie at wrong places.

use super::Localization;
use crate::fixes::GlobalEstimate;
use crate::planar::Planar;
use rcs_geom::wrap_angle;
use rcs_msg::Stamp;
use serde::{Deserialize, Serialize};

/// Time for which nothing may have followed the vehicle, s: so long it moves by no more than its position is off anyway.
const MOST_MISSED_S: f64 = 1.0;
/// Standard deviation of a motion that nothing has followed for longer, m, as of a vehicle that was driven by hand while this
/// process had failed: without fixes, a vehicle whose position is known no better stands (`max_error_m` of
/// `waypoint_generator`).
const MOVED_M: f64 = 5.0;

/// Both estimates as they were before `INIT`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Before {
    local: Planar,
    global: GlobalEstimate,
    /// Until when they followed the vehicle; `None` once they go on.
    until: Option<Stamp>,
}

impl Before {
    /// The estimates of a process; `None` without any, and where they have numbers that cannot be: after a panic, they may be
    /// its cause.
    pub(super) fn of(process: &Localization) -> Option<Before> {
        // `INIT` may come twice before there is a reading.
        let Some(local) = process.local else { return process.before.clone() };
        let global = process.global.clone();
        let until = process.wheels.map(|wheels| wheels.time).or(process.felt);
        let is_sound = local.is_sound() && global.is_sound() && process.height_m.is_finite();
        is_sound.then_some(Before { local, global, until })
    }

    /// Heading in the local frame, rad.
    pub(super) fn yaw_rad(&self) -> f64 {
        self.local.yaw_rad
    }

    /// Both estimates at the time of the first reading: as they were. Where nothing has followed the vehicle for too long
    /// before, it has this heading, rad, with this variance, rad², and may have been moved.
    pub(super) fn go_on(&mut self, yaw_rad: f64, yaw_variance: f64, time: Stamp) -> (Planar, GlobalEstimate) {
        let missed_s = self.until.take().map_or(0.0, |until| time.seconds_since(until));
        // A negative time is one of another clock.
        if !(0.0..=MOST_MISSED_S).contains(&missed_s) {
            let turn_rad = wrap_angle(yaw_rad - self.local.yaw_rad);
            self.local.yaw_rad = yaw_rad;
            self.global.lose(MOVED_M, turn_rad, yaw_variance);
        }
        (self.local, self.global.clone())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixes::{GateSettings, Position};
    use glam::DVec2;

    const SECOND: Stamp = Stamp(1_000_000_000);

    /// A process whose vehicle was at (20, 0) m of the local frame a second after the start, and at (25, 3) m of the global
    /// one, heading east.
    fn process() -> Localization {
        let mut global = GlobalEstimate::new(0.0, 0.01);
        let settings = GateSettings { gate: 11.8, correlation_s: 10.0, reset_after: 5 };
        let at = DVec2::new(25.0, 3.0);
        for time in [Stamp(0), SECOND] {
            let fix = Position { time, at, height_m: 0.0, variance: 1.0, height_variance: 4.0 };
            global.take(&settings, fix, DVec2::ZERO, 0.0);
        }
        let local = Some(Planar::new(DVec2::new(20.0, 0.0), 0.0, 0.0, 0.0));
        Localization { local, global, felt: Some(SECOND), ..Localization::default() }
    }

    #[test]
    fn what_was_followed_up_to_init_goes_on_and_what_was_not_is_hardly_known() {
        let before = Before::of(&process()).unwrap();
        let at = |second: f64| {
            let (local, global) = before.clone().go_on(0.3, 0.02, Stamp((second * 1e9) as u64));
            let global = *global.planar().unwrap();
            assert_eq!((local.at, global.at), (DVec2::new(20.0, 0.0), DVec2::new(25.0, 3.0)));
            assert_eq!(local.yaw_rad, global.yaw_rad, "both are turned by as much");
            (local.yaw_rad, global.covariance.x_axis.x.sqrt())
        };
        let is_kept = |(yaw_rad, deviation_m): (f64, f64)| yaw_rad == 0.0 && deviation_m < 1.5;
        let is_lost = |(yaw_rad, deviation_m): (f64, f64)| yaw_rad == 0.3 && deviation_m > 5.0;
        assert!(is_kept(at(1.0)) && is_kept(at(1.9)), "{:?}", at(1.9));
        assert!(is_lost(at(2.1)) && is_lost(at(60.0)), "{:?}", at(60.0));
        assert!(is_lost(at(0.5)), "of another clock");
    }

    #[test]
    fn numbers_that_cannot_be_are_not_kept_and_a_second_init_keeps_what_the_first_one_did() {
        let wrong = |at: DVec2| Localization { local: Some(Planar::new(at, 0.0, 0.0, 0.0)), ..process() };
        for at in [DVec2::new(f64::NAN, 0.0), DVec2::new(0.0, f64::INFINITY), DVec2::new(1e9, 0.0)] {
            assert_eq!(Before::of(&wrong(at)), None, "{at}");
        }
        assert_eq!(Before::of(&Localization { height_m: f64::NAN, ..process() }), None);
        assert_eq!(Before::of(&Localization::default()), None, "there is nothing to keep");
        let kept = Before::of(&process());
        let renewed = Localization { before: kept.clone(), ..Localization::default() };
        assert_eq!(Before::of(&renewed), kept);
    }
}
