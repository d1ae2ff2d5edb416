//! The global estimate: when a position fix is accepted, and what happens without fixes.
//!
//! A fix is compared with the estimate using the variance stated by the receiver. If its normalised error is too large,
//! it is an outlier and is refused. Errors of fixes are correlated over tens of seconds, so the variance of an accepted
//! fix is enlarged: otherwise the filter would treat sixty fixes within a minute as sixty independent measurements and
//! follow their common error. After the start, or after a long time without a fix, the first fixes must agree with each
//! other. When several consecutive fixes are refused but agree with each other, the wheels may have slipped since the last
//! accepted one, by up to all that they have rolled: the position is then that uncertain along the heading, so that fixes
//! behind the estimate pull it back, and for the next metres the estimate follows the fixes rather than the wheels. When
//! many are refused nevertheless, the estimate is wrong, and restarts from them.

use crate::planar::{Fix, MotionNoise, Planar};
use glam::{DMat3, DVec2, DVec3};
use rcs_geom::wrap_angle;
use rcs_msg::Stamp;
use serde::{Deserialize, Serialize};

/// Settings of the gate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GateSettings {
    /// Largest accepted squared, normalised error.
    pub gate: f64,
    /// Correlation time of the errors of fixes, s.
    pub correlation_s: f64,
    /// Number of consecutive refused fixes that agree with each other after which the estimate restarts.
    pub reset_after: u32,
    /// Fastest motion of the vehicle between two fixes that agree, m/s; see [`fastest_mps`].
    pub fastest_mps: f64,
}

/// A position fix in the global frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Position {
    /// When it was taken.
    pub time: Stamp,
    /// East and north, m.
    pub at: DVec2,
    /// Height, m.
    pub height_m: f64,
    /// Variance of east and of north as stated by the receiver, m².
    pub variance: f64,
    /// Variance of the height as stated by the receiver, m².
    pub height_variance: f64,
}

/// What was done with a fix.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Verdict {
    /// It corrected the estimate.
    Used,
    /// It is kept until a second one agrees with it.
    Waits,
    /// The estimate started with it.
    Began,
    /// It is an outlier, with this squared, normalised error.
    Refused {
        /// Squared, normalised error; see [`GateSettings::gate`].
        surprise: f64,
    },
}

/// The global estimate.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct GlobalEstimate {
    planar: Option<Planar>,
    /// Global height minus local height, m, and its variance, m².
    lift_m: f64,
    lift_variance: f64,
    /// Heading and its variance while the position is unknown.
    heading: [f64; 2],
    last_fix: Option<Position>,
    last_used: Option<Stamp>,
    /// Number of consecutive refused or waiting fixes that agree with each other.
    chain: u32,
    /// Way since the last accepted fix, m, and the variance that it has added because the wheels may have slipped, m².
    rolled_m: f64,
    slipped: f64,
    /// Way for which the estimate still follows the fixes, m, and by how much they have pulled it back on it, m.
    follows_m: f64,
    pulled_m: f64,
}

/// Number of consecutive refused fixes that agree with each other after which the wheels may have slipped.
const SLIPPED_AFTER: u32 = 4;
/// Standard deviation of the slip, as a share of the way.
const SLIP: f64 = 0.5;
/// Way for which the estimate follows the fixes after the wheels have slipped, m, and time for which one fix then counts, s.
const FOLLOWS_M: f64 = 20.0;
const FOLLOWS_S: f64 = 1.0;
/// Share of that way by which fixes pull the estimate back where the wheels still slip.
const STILL_SLIPS: f64 = 0.2;

/// Fastest motion between two fixes that agree, m/s, of a vehicle that is taken to be slow, and by how much another one
/// may have been faster since the fix before than it is now, m/s.
const FASTEST_SLOW_MPS: f64 = 5.0;
const FASTER_BEFORE_MPS: f64 = 3.0;

/// Fastest motion between two fixes that agree, m/s, of a vehicle at this speed, m/s.
pub fn fastest_mps(speed_mps: f64) -> f64 {
    FASTEST_SLOW_MPS.max(speed_mps.abs() + FASTER_BEFORE_MPS)
}

impl GlobalEstimate {
    /// An estimate with known heading (rad, variance in rad²) and unknown position.
    pub fn new(yaw_rad: f64, yaw_variance: f64) -> GlobalEstimate {
        GlobalEstimate { heading: [yaw_rad, yaw_variance], ..GlobalEstimate::default() }
    }

    /// Position and heading; `None` before two fixes have agreed.
    pub fn planar(&self) -> Option<&Planar> {
        self.planar.as_ref()
    }

    /// Global height minus local height, m, and its variance, m².
    pub fn lift(&self) -> [f64; 2] {
        [self.lift_m, self.lift_variance]
    }

    /// Time of the last fix, accepted or not.
    pub fn last_fix(&self) -> Option<Stamp> {
        Some(self.last_fix?.time)
    }

    /// Moves the fix that waits for a second one, m: the origin of the global frame has moved.
    pub fn move_waiting(&mut self, at: DVec2) {
        if let (None, Some(fix)) = (&self.planar, &mut self.last_fix) {
            fix.at = at;
        }
    }

    /// Time since the last accepted fix, s.
    pub fn age_s(&self, now: Stamp) -> Option<f64> {
        Some(now.seconds_since(self.last_used?))
    }

    /// The wheels slip: for the next metres the estimate follows the fixes, and on, as long as they pull it back.
    pub fn follow(&mut self) {
        (self.follows_m, self.pulled_m) = (FOLLOWS_M, 0.0);
    }

    /// Whether these are numbers that can be: see [`Planar::is_sound`].
    pub fn is_sound(&self) -> bool {
        let lift = [self.lift_m, self.lift_variance];
        let ways = [self.rolled_m, self.slipped, self.follows_m, self.pulled_m];
        let is_finite = lift.iter().chain(&self.heading).chain(&ways).all(|number| number.is_finite());
        is_finite && self.planar.as_ref().is_none_or(Planar::is_sound)
    }

    /// Nothing has followed the vehicle for a while. It may have been moved by a distance with this standard deviation, m, and
    /// has turned by an angle, rad, that is known with this variance, rad².
    pub fn lose(&mut self, moved_m: f64, turn_rad: f64, turn_variance: f64) {
        let variance = moved_m * moved_m;
        if let Some(planar) = &mut self.planar {
            planar.yaw_rad = wrap_angle(planar.yaw_rad + turn_rad);
            planar.covariance += DMat3::from_diagonal(DVec3::new(variance, variance, turn_variance));
        }
        self.heading[0] += turn_rad;
        self.heading[1] += turn_variance;
        self.lift_variance += variance;
    }

    /// Advances the estimate by a step ahead, m, and a turn, rad, within a time, s.
    pub fn advance(&mut self, noise: &MotionNoise, step_m: f64, turn_rad: f64, elapsed_s: f64) {
        self.rolled_m += step_m.abs();
        let distance = if self.follows_m > 0.0 { noise.distance.max(SLIP) } else { noise.distance };
        let noise = &MotionNoise { distance, ..*noise };
        if self.follows_m > 0.0 {
            self.follows_m -= step_m.abs();
            if self.follows_m <= 0.0 && self.pulled_m > STILL_SLIPS * FOLLOWS_M {
                self.follow();
            }
        }
        if let Some(planar) = &mut self.planar {
            planar.advance(noise, step_m, turn_rad, elapsed_s);
        } else {
            self.heading[0] += turn_rad;
            self.heading[1] += noise.heading_rad * noise.heading_rad * elapsed_s;
        }
        self.lift_variance += noise.distance * noise.distance * step_m.abs();
    }

    /// Takes a fix. `arm` is the position of the antenna relative to the vehicle's origin (level axes, ahead and left,
    /// m); `local_height_m` is the height of the antenna in the local frame, m.
    pub fn take(
        &mut self,
        settings: &GateSettings,
        position: Position,
        arm: DVec2,
        local_height_m: f64,
    ) -> Verdict {
        let before = self.last_fix.replace(position);
        let gap_s = before.map_or(f64::INFINITY, |before| position.time.seconds_since(before.time));
        // Errors with correlation time τ contain one independent error per 2τ.
        let alike_s = if self.follows_m > 0.0 { FOLLOWS_S } else { 2.0 * settings.correlation_s };
        let alike = (alike_s / gap_s.max(1e-3)).max(1.0);
        let fix = Fix { at: position.at, arm, variance: position.variance, alike };
        let agrees = before.is_some_and(|before| {
            let spread = 3.0 * (before.variance + position.variance).sqrt();
            before.at.distance(position.at) < spread + settings.fastest_mps * gap_s
        });
        self.chain = if agrees { self.chain + 1 } else { 1 };
        let Some(planar) = &mut self.planar else {
            if self.chain < 2 {
                return Verdict::Waits;
            }
            self.begin(&fix, position, local_height_m);
            return Verdict::Began;
        };
        if self.chain > SLIPPED_AFTER {
            let slip_m = SLIP * self.rolled_m;
            let slipped = slip_m * slip_m;
            planar.widen(slipped - self.slipped);
            self.slipped = slipped;
            if slipped > 0.0 {
                (self.follows_m, self.pulled_m) = (FOLLOWS_M, 0.0);
            }
        }
        let surprise = planar.surprise(&fix);
        if surprise.is_nan() || surprise > settings.gate {
            if self.chain < settings.reset_after {
                return Verdict::Refused { surprise };
            }
            self.heading = [planar.yaw_rad, planar.covariance.z_axis.z];
            self.begin(&fix, position, local_height_m);
            return Verdict::Began;
        }
        let uncorrected = planar.at;
        planar.correct(&fix);
        self.pulled_m += (uncorrected - planar.at).dot(DVec2::from_angle(planar.yaw_rad));
        let gain = self.lift_variance / (self.lift_variance + position.height_variance * alike);
        self.lift_m += gain * (position.height_m - local_height_m - self.lift_m);
        self.lift_variance *= 1.0 - gain;
        self.count_from(position.time);
        Verdict::Used
    }

    fn begin(&mut self, fix: &Fix, position: Position, local_height_m: f64) {
        let [yaw_rad, yaw_variance] = self.heading;
        let (sin, cos) = libm::sincos(yaw_rad);
        let arm = DVec2::new(cos * fix.arm.x - sin * fix.arm.y, sin * fix.arm.x + cos * fix.arm.y);
        self.planar = Some(Planar::new(position.at - arm, yaw_rad, position.variance, yaw_variance));
        self.lift_m = position.height_m - local_height_m;
        self.lift_variance = position.height_variance;
        self.count_from(position.time);
    }

    /// A fix was accepted.
    fn count_from(&mut self, time: Stamp) {
        self.last_used = Some(time);
        self.chain = 0;
        (self.rolled_m, self.slipped) = (0.0, 0.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SETTINGS: GateSettings =
        GateSettings { gate: 11.8, correlation_s: 10.0, reset_after: 5, fastest_mps: FASTEST_SLOW_MPS };

    fn position(ms: u64, x: f64) -> Position {
        Position {
            time: Stamp(ms * 1_000_000),
            at: DVec2::new(x, 0.0),
            height_m: 0.0,
            variance: 1.0,
            height_variance: 4.0,
        }
    }

    fn take(estimate: &mut GlobalEstimate, ms: u64, x: f64) -> Verdict {
        estimate.take(&SETTINGS, position(ms, x), DVec2::ZERO, 0.0)
    }

    #[test]
    fn it_begins_when_two_fixes_agree_and_an_outlier_at_the_start_does_no_harm() {
        let mut estimate = GlobalEstimate::new(0.0, 0.01);
        assert_eq!(take(&mut estimate, 0, 50.0), Verdict::Waits);
        assert_eq!(take(&mut estimate, 250, 0.0), Verdict::Waits);
        assert!(estimate.planar().is_none());
        assert_eq!(take(&mut estimate, 500, 0.1), Verdict::Began);
        assert!(estimate.planar().unwrap().at.x < 0.2);
    }

    #[test]
    fn fixes_agree_that_lie_as_far_apart_as_the_vehicle_can_have_driven() {
        // Fixes of 2 cm, 8 m apart, each second.
        let begins = |speed_mps: f64| {
            let settings = GateSettings { fastest_mps: fastest_mps(speed_mps), ..SETTINGS };
            let mut estimate = GlobalEstimate::new(0.0, 0.01);
            (0..10_u64).any(|second| {
                let fix = Position { variance: 0.0004, ..position(1000 * second, 8.0 * second as f64) };
                estimate.take(&settings, fix, DVec2::ZERO, 0.0) == Verdict::Began
            })
        };
        assert_eq!([8.0, -8.0, 6.0, 4.0, 0.0].map(begins), [true, true, true, false, false]);
        // A slow one may have been moved otherwise.
        assert_eq!([0.0, 1.5, 2.0].map(fastest_mps), [5.0; 3]);
    }

    #[test]
    fn outliers_are_refused_and_change_nothing() {
        let mut estimate = GlobalEstimate::new(0.0, 0.01);
        for fix in 0..3 {
            take(&mut estimate, fix * 250, 0.0);
        }
        let before = *estimate.planar().unwrap();
        assert!(matches!(take(&mut estimate, 1000, 20.0), Verdict::Refused { surprise } if surprise > 100.0));
        assert_eq!(*estimate.planar().unwrap(), before);
        assert_eq!(take(&mut estimate, 1250, 0.2), Verdict::Used);
    }

    #[test]
    fn fixes_that_stay_elsewhere_begin_the_estimate_anew() {
        let mut estimate = GlobalEstimate::new(0.0, 0.01);
        for fix in 0..4 {
            take(&mut estimate, fix * 250, 0.0);
        }
        let verdicts: Vec<Verdict> = (4..9).map(|fix| take(&mut estimate, fix * 250, 30.0)).collect();
        assert!(
            verdicts[..4].iter().all(|verdict| matches!(verdict, Verdict::Refused { .. })),
            "{verdicts:?}"
        );
        assert_eq!(verdicts[4], Verdict::Began);
        assert_eq!(estimate.planar().unwrap().at.x, 30.0);
    }

    #[test]
    fn fixes_behind_an_estimate_whose_wheels_slip_pull_it_back_and_fixes_beside_it_do_not() {
        const NOISE: MotionNoise = MotionNoise { distance: 0.22, heading_rad: 0.01 };
        // Fixes that are refused never begin the estimate anew.
        let settings = GateSettings { reset_after: 1000, ..SETTINGS };
        // The wheels roll 0.25 m between two fixes; from the 40th on, half of it is slip.
        let drive = |truth: fn(f64, f64) -> DVec2| {
            let mut estimate = GlobalEstimate::new(0.0, 0.001);
            let mut most_m: f64 = 0.0;
            for fix in 0..200_u32 {
                let rolled_m = 0.25 * f64::from(fix);
                let at = truth(rolled_m, (rolled_m - 10.0).max(0.0));
                estimate.take(
                    &settings,
                    Position { at, ..position(u64::from(fix) * 250, 0.0) },
                    DVec2::ZERO,
                    0.0,
                );
                if let Some(planar) = estimate.planar() {
                    most_m = most_m.max(planar.at.distance(at));
                }
                estimate.advance(&NOISE, 0.25, 0.0, 0.25);
            }
            most_m
        };
        let most_m = drive(|rolled_m, since_m| DVec2::new(rolled_m - 0.5 * since_m, 0.0));
        assert!(most_m < 6.0, "{most_m}");
        let mut estimate = GlobalEstimate::new(0.0, 0.001);
        for fix in 0..40_u32 {
            let beside_m = if fix < 8 { 0.0 } else { 12.0 };
            let at = DVec2::new(0.25 * f64::from(fix), beside_m);
            estimate.take(
                &settings,
                Position { at, ..position(u64::from(fix) * 250, 0.0) },
                DVec2::ZERO,
                0.0,
            );
            estimate.advance(&NOISE, 0.25, 0.0, 0.25);
        }
        assert!(estimate.planar().unwrap().at.y.abs() < 0.5, "an error across the heading is no slip");
    }

    #[test]
    fn an_estimate_that_was_told_of_slip_follows_the_fixes_as_long_as_they_pull_it_back() {
        const NOISE: MotionNoise = MotionNoise { distance: 0.22, heading_rad: 0.01 };
        // Slip of a half for 30 m, then none; its beginning is told.
        let drive = |told: bool| {
            let mut estimate = GlobalEstimate::new(0.0, 0.001);
            let (mut at_m, mut most_m): (f64, f64) = (0.0, 0.0);
            for fix in 0..320_u32 {
                let slips = (40..160).contains(&fix);
                if told && fix == 40 {
                    estimate.follow();
                }
                take(&mut estimate, u64::from(fix) * 250, at_m);
                most_m = most_m.max(estimate.planar().map_or(0.0, |planar| (planar.at.x - at_m).abs()));
                estimate.advance(&NOISE, 0.25, 0.0, 0.25);
                at_m += if slips { 0.125 } else { 0.25 };
            }
            (most_m, estimate.follows_m > 0.0)
        };
        let (most_m, follows) = drive(true);
        assert!(most_m < 2.0 && !follows, "{most_m} {follows}");
        assert!(drive(false).0 > 1.5 * most_m);
    }

    #[test]
    fn fixes_that_err_alike_do_not_make_it_sure_of_itself() {
        let mut estimate = GlobalEstimate::new(0.0, 0.01);
        for fix in 0..40 {
            take(&mut estimate, fix * 250, 0.0);
        }
        // Twenty seconds of fixes are about one measurement: after ten the variance has fallen to two thirds, not to a
        // fortieth.
        let variance = estimate.planar().unwrap().covariance.x_axis.x;
        assert!((0.6..0.75).contains(&variance), "{variance}");
    }
}
