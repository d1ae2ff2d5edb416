//! Wheel speeds from a desired heading and speed.
//!
//! The speed ramps towards its target: it grows by at most the acceleration, falls by at most the deceleration, and
//! stops at zero on the way from forward to backward. The turn rate is proportional to the heading error, with a dead
//! band and limits, and is ramped, too; a turn begins when the vehicle no longer rolls the other way. A differential
//! drive with track `b` turns at rate `w` with wheel speeds `v ∓ w·b/2`; where a wheel would exceed its limit, the
//! vehicle drives more slowly and keeps its turn rate. An Ackermann vehicle that is told speed and turn rate gets the
//! curvature of that arc, `w/v` of the two, whatever its own speed is. Towards a heading it gets the curvature of the
//! turn rate at its own speed. Both are ramped within the limits of the turn rate.
//!
//! Wheels that slip on one side turn the vehicle less than their speeds say, or the other way: with one side in mud, it is
//! drawn into it. What the turn lacks ([`Slip`]) is added to the turn rate of a differential drive.

use rcs_geom::wrap_angle;
use serde::{Deserialize, Serialize};

/// Geometry and limits of the vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Drive {
    /// Distance between the driven wheels, m; `None` for an Ackermann vehicle.
    pub track_m: Option<f64>,
    /// Largest curvature of an Ackermann vehicle, 1/m.
    pub max_curvature_per_m: f64,
    /// Maximum speed of the vehicle, m/s.
    pub max_speed_mps: f64,
    /// Maximum speed of each wheel of a differential drive, m/s.
    pub max_wheel_speed_mps: f64,
    /// Maximum acceleration, m/s².
    pub max_acceleration_mps2: f64,
    /// Maximum deceleration, m/s².
    pub max_deceleration_mps2: f64,
    /// Deceleration when the vehicle is being stopped, m/s².
    pub stop_deceleration_mps2: f64,
    /// Maximum turn rate in either direction, rad/s.
    pub max_yaw_rate_radps: f64,
    /// Maximum change of the turn rate, rad/s².
    pub max_yaw_acceleration_radps2: f64,
    /// Maximum turn rate that is added because the wheels slip, rad/s.
    pub max_turn_correction_radps: f64,
    /// Turn rate per radian of heading error, 1/s.
    pub heading_gain_per_s: f64,
    /// Heading errors below this are not corrected, rad.
    pub heading_dead_band_rad: f64,
    /// Heading error from which on a differential drive turns on the spot, rad.
    pub turn_in_place_rad: f64,
}

/// Target of the vehicle in this cycle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Aim {
    /// Drive at a speed (m/s) and turn the heading by an angle (rad, counter-clockwise).
    Heading {
        /// Speed, m/s.
        speed_mps: f64,
        /// Desired heading minus estimated heading, rad.
        error_rad: f64,
    },
    /// Drive at a speed (m/s) and turn at a rate (rad/s).
    Rate {
        /// Speed, m/s.
        speed_mps: f64,
        /// Turn rate, rad/s counter-clockwise.
        yaw_rate_radps: f64,
    },
    /// Brake to a stop.
    Stop,
    /// Stop at once, without a ramp.
    Halt,
}

impl Aim {
    /// The same target with its speed limited in both directions. A turn rate decreases with the speed, so that the vehicle
    /// drives along the same arc. With a limit of 0 it neither drives nor turns.
    #[must_use]
    pub fn limited_to(self, limit_mps: f64) -> Aim {
        let limited = |speed_mps: f64| speed_mps.clamp(-limit_mps, limit_mps);
        match self {
            Aim::Heading { .. } | Aim::Rate { .. } if limit_mps == 0.0 => Aim::Stop,
            Aim::Heading { speed_mps, error_rad } => {
                Aim::Heading { speed_mps: limited(speed_mps), error_rad }
            }
            Aim::Rate { speed_mps, yaw_rate_radps } if speed_mps.abs() > limit_mps => {
                let share = limit_mps / speed_mps.abs();
                Aim::Rate { speed_mps: limited(speed_mps), yaw_rate_radps: yaw_rate_radps * share }
            }
            Aim::Rate { .. } | Aim::Stop | Aim::Halt => self,
        }
    }
}

/// Output to the vehicle.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Wheels {
    /// Speed of the left wheel, m/s.
    pub left_mps: f64,
    /// Speed of the right wheel, m/s.
    pub right_mps: f64,
    /// Curvature, 1/m, positive to the left; 0 for a differential drive.
    pub curvature_per_m: f64,
}

/// Turn rate that slip has taken from a differential drive, averaged over the last 0.3 s.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Slip {
    lacking_radps: f64,
}

/// Time constant of the average, s: longer than a wheel needs to reach its speed.
const SLIP_S: f64 = 0.3;

impl Slip {
    /// Takes the speeds of the left and right wheel, m/s, and the turn rate of the vehicle, rad/s, of a cycle of `dt_s`.
    pub fn take(&mut self, wheels_mps: [f64; 2], yaw_rate_radps: f64, track_m: f64, dt_s: f64) {
        let lacking_radps = (wheels_mps[1] - wheels_mps[0]) / track_m - yaw_rate_radps;
        self.lacking_radps += (lacking_radps - self.lacking_radps) * (dt_s / SLIP_S).min(1.0);
    }
}

/// The last commanded speeds, from which the ramps continue.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Ramps {
    speed_mps: f64,
    yaw_rate_radps: f64,
    curvature_per_m: f64,
}

/// Lowest own speed for which a curvature is derived from a turn rate, m/s: vehicles that are slower do not steer more
/// sharply towards a heading, and do not steer more slowly.
const CURVATURE_SPEED_MPS: f64 = 0.3;

impl Ramps {
    /// Computes one cycle of `dt_s`.
    pub fn step(&mut self, aim: Aim, drive: &Drive, slip: &Slip, dt_s: f64) -> Wheels {
        let (speed_mps, yaw_rate_radps, deceleration) = match aim {
            Aim::Halt => {
                *self = Ramps { curvature_per_m: self.curvature_per_m, ..Ramps::default() };
                return Wheels { curvature_per_m: self.curvature_per_m, ..Wheels::default() };
            }
            Aim::Stop => (0.0, 0.0, drive.stop_deceleration_mps2),
            Aim::Rate { speed_mps, yaw_rate_radps } => {
                (speed_mps, yaw_rate_radps, drive.max_deceleration_mps2)
            }
            Aim::Heading { speed_mps, error_rad } => {
                let speed_mps = slowed_for(speed_mps, error_rad, drive);
                (speed_mps, turn_rate(error_rad, drive), drive.max_deceleration_mps2)
            }
        };
        let wanted = speed_mps.clamp(-drive.max_speed_mps, drive.max_speed_mps);
        self.speed_mps = ramp(self.speed_mps, wanted, drive.max_acceleration_mps2, deceleration, dt_s);
        let limit = drive.max_yaw_rate_radps;
        let change = drive.max_yaw_acceleration_radps2 * dt_s;
        let yaw_rate_radps = if self.rolls_against(wanted) { 0.0 } else { yaw_rate_radps };
        let wanted_radps = yaw_rate_radps.clamp(-limit, limit);
        let turn = wanted_radps - self.yaw_rate_radps;
        self.yaw_rate_radps += turn.clamp(-change, change);
        if let Some(track_m) = drive.track_m {
            let most = drive.max_turn_correction_radps;
            // A vehicle that is told to stand does so, also where its wheels have turned in vain.
            let stands = aim == Aim::Stop || (self.speed_mps, self.yaw_rate_radps) == (0.0, 0.0);
            let lacking_radps = if stands { 0.0 } else { slip.lacking_radps.clamp(-most, most) };
            return self.differential(lacking_radps, track_m, drive.max_wheel_speed_mps);
        }
        // A braking vehicle keeps its steering angle: steering while it rolls out would swing it aside.
        match aim {
            Aim::Stop => {}
            Aim::Rate { .. } if wanted != 0.0 => self.steer_arc(wanted_radps / wanted, drive, change),
            _ => self.steer_turn(drive),
        }
        let (speed_mps, curvature_per_m) = (self.speed_mps, self.curvature_per_m);
        Wheels { left_mps: speed_mps, right_mps: speed_mps, curvature_per_m }
    }

    /// Whether the vehicle still rolls against a wanted speed, m/s, so that it would turn along another arc than it is told
    /// to: one that backs would swing its tail into what it is backing past.
    fn rolls_against(&self, wanted_mps: f64) -> bool {
        if self.speed_mps < 0.0 { wanted_mps >= 0.0 } else { self.speed_mps > 0.0 && wanted_mps < 0.0 }
    }

    fn differential(&self, lacking_radps: f64, track_m: f64, limit_mps: f64) -> Wheels {
        let turn_radps = self.yaw_rate_radps + lacking_radps;
        let half = (turn_radps * track_m / 2.0).clamp(-limit_mps, limit_mps);
        let room = limit_mps - half.abs();
        let speed = self.speed_mps.clamp(-room, room);
        // The sums are rounded, and a vehicle refuses a wheel that is faster than its limit.
        let wheel = |speed_mps: f64| speed_mps.clamp(-limit_mps, limit_mps);
        Wheels { left_mps: wheel(speed - half), right_mps: wheel(speed + half), curvature_per_m: 0.0 }
    }

    /// Own speed by which a curvature is derived from a turn rate, m/s.
    fn curvature_speed_mps(&self) -> f64 {
        let along = if self.speed_mps < 0.0 { -1.0 } else { 1.0 };
        along * self.speed_mps.abs().max(CURVATURE_SPEED_MPS)
    }

    /// Steers for an arc of this curvature, 1/m. The turn rate changes by at most `change_radps`, and a vehicle that is
    /// still too fast for the arc turns at its greatest rate.
    fn steer_arc(&mut self, arc_per_m: f64, drive: &Drive, change_radps: f64) {
        let limit = drive.max_curvature_per_m.min(drive.max_yaw_rate_radps / self.speed_mps.abs());
        let speed_mps = self.curvature_speed_mps();
        let change = change_radps / speed_mps.abs();
        let missing = arc_per_m.clamp(-limit, limit) - self.curvature_per_m;
        self.curvature_per_m += missing.clamp(-change, change);
        // From here the ramp of a turn towards a heading goes on.
        self.yaw_rate_radps = self.curvature_per_m * speed_mps;
    }

    /// Steers for the turn rate.
    fn steer_turn(&mut self, drive: &Drive) {
        let limit = drive.max_curvature_per_m;
        self.curvature_per_m = (self.yaw_rate_radps / self.curvature_speed_mps()).clamp(-limit, limit);
    }
}

fn turn_rate(error_rad: f64, drive: &Drive) -> f64 {
    let error = wrap_angle(error_rad);
    if error.abs() < drive.heading_dead_band_rad { 0.0 } else { drive.heading_gain_per_s * error }
}

/// Speed at a heading error: lower with the error, and zero where a differential drive turns on the spot.
fn slowed_for(speed_mps: f64, error_rad: f64, drive: &Drive) -> f64 {
    if drive.track_m.is_none() {
        return speed_mps;
    }
    speed_mps * (1.0 - wrap_angle(error_rad).abs() / drive.turn_in_place_rad).max(0.0)
}

/// Moves `from` towards `to` by at most what one cycle allows; where the sign changes, it stops at zero first.
fn ramp(from: f64, to: f64, acceleration: f64, deceleration: f64, dt_s: f64) -> f64 {
    let slows = to.abs() < from.abs() || to * from < 0.0;
    if slows {
        let target = if to * from < 0.0 { 0.0 } else { to };
        let change = deceleration * dt_s;
        return from + (target - from).clamp(-change, change);
    }
    let change = acceleration * dt_s;
    from + (to - from).clamp(-change, change)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const DIFFERENTIAL: Drive = Drive {
        track_m: Some(0.6),
        max_curvature_per_m: 0.188,
        max_speed_mps: 1.3,
        max_wheel_speed_mps: 1.5,
        max_acceleration_mps2: 1.0,
        max_deceleration_mps2: 2.0,
        stop_deceleration_mps2: 4.0,
        max_yaw_rate_radps: 1.2,
        max_yaw_acceleration_radps2: 6.0,
        max_turn_correction_radps: 1.0,
        heading_gain_per_s: 2.0,
        heading_dead_band_rad: 0.01,
        turn_in_place_rad: 1.2,
    };
    const STEERED: Drive = Drive { track_m: None, ..DIFFERENTIAL };
    const DT_S: f64 = 0.02;

    fn run(ramps: &mut Ramps, aim: Aim, drive: &Drive, cycles: usize) -> Wheels {
        (0..cycles).map(|_| ramps.step(aim, drive, &Slip::default(), DT_S)).last().unwrap_or_default()
    }

    #[test]
    fn speed_grows_at_the_acceleration_and_shrinks_at_the_deceleration() {
        let mut ramps = Ramps::default();
        let straight = Aim::Heading { speed_mps: 1.0, error_rad: 0.0 };
        assert!((run(&mut ramps, straight, &DIFFERENTIAL, 25).left_mps - 0.5).abs() < 1e-9);
        assert_eq!(run(&mut ramps, straight, &DIFFERENTIAL, 30).right_mps, 1.0);
        let slower = Aim::Heading { speed_mps: 0.2, error_rad: 0.0 };
        assert!((run(&mut ramps, slower, &DIFFERENTIAL, 10).left_mps - 0.6).abs() < 1e-9);
        assert!((run(&mut ramps, Aim::Stop, &DIFFERENTIAL, 5).left_mps - 0.2).abs() < 1e-9);
        assert_eq!(run(&mut ramps, Aim::Stop, &DIFFERENTIAL, 5).left_mps, 0.0);
    }

    #[test]
    fn no_wheel_is_faster_than_its_limit_by_rounding() {
        for limit_mps in [1.5, 1.8] {
            for step in 0..1000 {
                let (speed_mps, yaw_rate_radps) = (limit_mps, 0.003 * f64::from(step));
                let ramps = Ramps { speed_mps, yaw_rate_radps, ..Ramps::default() };
                let Wheels { left_mps, right_mps, .. } = ramps.differential(0.0, 0.6, limit_mps);
                assert!(
                    left_mps.abs().max(right_mps) <= limit_mps,
                    "{yaw_rate_radps}: {left_mps}, {right_mps}"
                );
            }
        }
    }

    #[test]
    fn from_forward_to_backward_it_stops_on_the_way() {
        let mut ramps = Ramps { speed_mps: 0.03, ..Ramps::default() };
        let back = Aim::Rate { speed_mps: -1.0, yaw_rate_radps: 0.0 };
        assert_eq!(ramps.step(back, &DIFFERENTIAL, &Slip::default(), DT_S).left_mps, 0.0);
        assert!((ramps.step(back, &DIFFERENTIAL, &Slip::default(), DT_S).left_mps + 0.02).abs() < 1e-12);
    }

    #[test]
    fn it_does_not_turn_while_it_rolls_the_other_way() {
        for (speed_mps, wanted_mps) in [(-0.6, 0.8), (-0.6, 0.0), (0.6, -0.3)] {
            let mut ramps = Ramps { speed_mps, ..Ramps::default() };
            let aim = Aim::Rate { speed_mps: wanted_mps, yaw_rate_radps: 1.2 };
            let turn = |wheels: Wheels| wheels.right_mps - wheels.left_mps;
            // It brakes with 2 m/s².
            assert_eq!(turn(run(&mut ramps, aim, &DIFFERENTIAL, 14)), 0.0, "{speed_mps} to {wanted_mps} m/s");
            assert!(turn(run(&mut ramps, aim, &DIFFERENTIAL, 20)) > 0.7, "{speed_mps} to {wanted_mps} m/s");
        }
        let mut ramps = Ramps { speed_mps: 0.6, ..Ramps::default() };
        let wheels = ramps.step(
            Aim::Rate { speed_mps: 0.0, yaw_rate_radps: 1.2 },
            &DIFFERENTIAL,
            &Slip::default(),
            DT_S,
        );
        assert!(wheels.right_mps > wheels.left_mps, "rolling ahead to a turn on the spot, it turns at once");
    }

    #[test]
    fn a_limit_of_the_speed_leaves_the_arc_as_it_is_and_one_of_0_lets_nothing_move() {
        let rate = |speed_mps, yaw_rate_radps| Aim::Rate { speed_mps, yaw_rate_radps };
        let heading = |speed_mps| Aim::Heading { speed_mps, error_rad: 0.4 };
        for (aim, limit_mps, expected) in [
            (rate(1.0, 0.8), 0.25, rate(0.25, 0.2)),
            (rate(-1.0, 0.8), 0.25, rate(-0.25, 0.2)),
            (rate(0.2, 0.8), 0.25, rate(0.2, 0.8)),
            (rate(0.0, 0.8), 0.25, rate(0.0, 0.8)),
            (rate(0.0, 0.8), 0.0, Aim::Stop),
            (rate(1.0, 0.8), 0.0, Aim::Stop),
            (heading(1.0), 0.25, heading(0.25)),
            (heading(1.0), 0.0, Aim::Stop),
            (Aim::Halt, 0.0, Aim::Halt),
        ] {
            assert_eq!(aim.limited_to(limit_mps), expected, "{aim:?} limited to {limit_mps} m/s");
        }
    }

    #[test]
    fn a_halt_stands_at_once() {
        let mut ramps = Ramps::default();
        run(&mut ramps, Aim::Rate { speed_mps: 1.3, yaw_rate_radps: 1.0 }, &DIFFERENTIAL, 100);
        assert_eq!(ramps.step(Aim::Halt, &DIFFERENTIAL, &Slip::default(), DT_S), Wheels::default());
    }

    #[test]
    fn it_turns_left_for_a_positive_error_and_on_the_spot_for_a_large_one() {
        let mut ramps = Ramps::default();
        let aim = |error_rad| Aim::Heading { speed_mps: 1.0, error_rad };
        let wheels = run(&mut ramps, aim(0.1), &DIFFERENTIAL, 100);
        assert!((wheels.right_mps - wheels.left_mps - 0.2 * 0.6).abs() < 1e-9, "{wheels:?}");
        let wheels = run(&mut ramps, aim(-3.0), &DIFFERENTIAL, 200);
        assert!((wheels.left_mps + wheels.right_mps).abs() < 1e-12, "{wheels:?}");
        assert!((wheels.left_mps - 1.2 * 0.3).abs() < 1e-9, "{wheels:?}");
        // The shorter direction: 3.5 rad to the left are 2.78 rad to the right.
        let wheels = run(&mut Ramps::default(), aim(3.5), &DIFFERENTIAL, 200);
        assert!(wheels.left_mps > 0.0 && wheels.right_mps < 0.0, "{wheels:?}");
    }

    #[test]
    fn a_turn_at_full_speed_slows_the_vehicle_only_where_a_wheel_would_be_too_fast_and_keeps_the_turn() {
        let turn = |yaw_rate_radps| {
            let aim = Aim::Rate { speed_mps: 1.3, yaw_rate_radps };
            run(&mut Ramps::default(), aim, &DIFFERENTIAL, 200)
        };
        let wide = turn(0.5);
        assert!((wide.right_mps - 1.45).abs() < 1e-9 && (wide.left_mps - 1.15).abs() < 1e-9, "{wide:?}");
        let tight = turn(1.0);
        assert_eq!(tight.right_mps, 1.5);
        assert!((tight.right_mps - tight.left_mps - 0.6).abs() < 1e-9, "{tight:?}");
    }

    #[test]
    fn what_slip_takes_from_a_turn_is_added_to_it_up_to_the_limit_and_not_where_it_stands() {
        let mut slip = Slip::default();
        // The left wheel spins in mud: they should turn to the right, and the vehicle goes straight.
        (0..200).for_each(|_| slip.take([1.3, 1.0], 0.0, 0.6, DT_S));
        let straight = Aim::Rate { speed_mps: 1.0, yaw_rate_radps: 0.0 };
        let after = |slip: &Slip, aim: Aim| {
            let mut ramps = Ramps::default();
            (0..200).map(|_| ramps.step(aim, &DIFFERENTIAL, slip, DT_S)).last().unwrap_or_default()
        };
        let wheels = after(&slip, straight);
        assert!(
            (wheels.left_mps - 1.15).abs() < 1e-6 && (wheels.right_mps - 0.85).abs() < 1e-6,
            "{wheels:?}"
        );
        for stands in [Aim::Stop, Aim::Rate { speed_mps: 0.0, yaw_rate_radps: 0.0 }] {
            assert_eq!(after(&slip, stands), Wheels::default());
        }
        (0..200).for_each(|_| slip.take([1.5, 0.5], 0.0, 0.6, DT_S));
        let wheels = after(&slip, straight);
        assert!((wheels.left_mps - wheels.right_mps - 0.6).abs() < 1e-9, "at most 1 rad/s: {wheels:?}");
        let mut once = Slip::default();
        once.take([0.3, 0.6], 0.0, 0.6, DT_S);
        assert!((once.lacking_radps - 0.5 * DT_S / SLIP_S).abs() < 1e-12);
    }

    #[test]
    fn a_vehicle_that_steers_gets_a_curvature_within_its_limit() {
        let mut ramps = Ramps::default();
        let curve = Aim::Rate { speed_mps: 1.0, yaw_rate_radps: 0.1 };
        let wheels = run(&mut ramps, curve, &STEERED, 100);
        assert_eq!((wheels.left_mps, wheels.right_mps), (1.0, 1.0));
        assert!((wheels.curvature_per_m - 0.1).abs() < 1e-12);
        let tight = Aim::Rate { speed_mps: 1.0, yaw_rate_radps: -1.0 };
        assert_eq!(run(&mut ramps, tight, &STEERED, 10).curvature_per_m, -0.188);
        // Backward, the same turn rate needs the opposite curvature.
        let back = Aim::Rate { speed_mps: -1.0, yaw_rate_radps: 0.1 };
        assert!((run(&mut ramps, back, &STEERED, 200).curvature_per_m + 0.1).abs() < 1e-12);
        assert!((run(&mut ramps, Aim::Stop, &STEERED, 1).curvature_per_m + 0.1).abs() < 1e-12);
    }

    #[test]
    fn a_vehicle_that_steers_turns_no_faster_and_no_more_suddenly_than_its_limits() {
        let drive = Drive { max_yaw_rate_radps: 0.1, max_yaw_acceleration_radps2: 0.5, ..STEERED };
        let mut ramps = Ramps::default();
        run(&mut ramps, Aim::Rate { speed_mps: 1.0, yaw_rate_radps: 0.0 }, &drive, 100);
        let aim = Aim::Heading { speed_mps: 1.0, error_rad: 1.0 };
        let curvature_per_m = run(&mut ramps, aim, &drive, 1).curvature_per_m;
        assert!((curvature_per_m - 0.5 * DT_S).abs() < 1e-12, "{curvature_per_m}");
        let curvature_per_m = run(&mut ramps, aim, &drive, 100).curvature_per_m;
        assert!((curvature_per_m - 0.1).abs() < 1e-12, "{curvature_per_m}");
    }

    #[test]
    fn a_vehicle_that_steers_drives_the_arc_that_it_is_told_however_slowly() {
        // An arc of 0.15 1/m, also with the speed limited to 0.1 m/s and below, and backward.
        let curve = Aim::Rate { speed_mps: 1.0, yaw_rate_radps: 0.15 };
        let back = Aim::Rate { speed_mps: -0.1, yaw_rate_radps: 0.015 };
        for (aim, expected_per_m) in [
            (Aim::Rate { speed_mps: 0.1, yaw_rate_radps: 0.015 }, 0.15),
            (curve.limited_to(0.1), 0.15),
            (curve.limited_to(0.01), 0.15),
            (back, -0.15),
        ] {
            let curvature_per_m = run(&mut Ramps::default(), aim, &STEERED, 100).curvature_per_m;
            assert!((curvature_per_m - expected_per_m).abs() < 1e-9, "{aim:?}: {curvature_per_m}");
        }
        // It is on that arc already while it sets out, and does not leave it while it slows down.
        let mut ramps = Ramps::default();
        for aim in [curve, curve.limited_to(0.1)] {
            for _ in 0..100 {
                let wheels = ramps.step(aim, &STEERED, &Slip::default(), DT_S);
                assert!((wheels.curvature_per_m - 0.15).abs() < 1e-9, "{aim:?}: {wheels:?}");
            }
        }
    }

    #[test]
    fn a_vehicle_that_is_too_fast_for_an_arc_turns_at_its_greatest_rate_and_steers_on_as_it_slows_down() {
        let drive = Drive { max_yaw_rate_radps: 0.1, max_yaw_acceleration_radps2: 0.5, ..STEERED };
        let mut ramps = Ramps::default();
        run(&mut ramps, Aim::Rate { speed_mps: 1.3, yaw_rate_radps: 0.0 }, &drive, 100);
        let tight = Aim::Rate { speed_mps: 0.2, yaw_rate_radps: 0.03 };
        let mut before_per_m = 0.0;
        for _ in 0..100 {
            let Wheels { left_mps, curvature_per_m, .. } = ramps.step(tight, &drive, &Slip::default(), DT_S);
            let turn_radps = curvature_per_m * left_mps;
            assert!(turn_radps <= 0.1 + 1e-9, "{left_mps} m/s: {turn_radps} rad/s");
            let change_radps = (curvature_per_m - before_per_m) * left_mps;
            assert!(change_radps <= 0.5 * DT_S + 1e-9, "{left_mps} m/s: changes by {change_radps} rad/s");
            before_per_m = curvature_per_m;
        }
        assert!((before_per_m - 0.15).abs() < 1e-9, "{before_per_m}");
        // A turn towards a heading goes on from there.
        let heading = Aim::Heading { speed_mps: 0.2, error_rad: 0.0 };
        let curvature_per_m = run(&mut ramps, heading, &drive, 1).curvature_per_m;
        assert!((before_per_m - curvature_per_m - 0.5 * DT_S / 0.3).abs() < 1e-9, "{curvature_per_m}");
    }

    proptest! {
        #[test]
        fn no_wheel_is_ever_too_fast_and_no_change_too_quick(
            aims in prop::collection::vec((-2.0..2.0_f64, -4.0..4.0_f64, 0..4_u8), 1..80),
        ) {
            let mut ramps = Ramps::default();
            let mut before = 0.0;
            for (speed_mps, turn, kind) in aims {
                let aim = match kind {
                    0 => Aim::Heading { speed_mps, error_rad: turn },
                    1 | 2 => Aim::Rate { speed_mps, yaw_rate_radps: turn },
                    _ => Aim::Stop,
                };
                let wheels = ramps.step(aim, &DIFFERENTIAL, &Slip::default(), DT_S);
                let middle_mps = 0.5 * (wheels.left_mps + wheels.right_mps);
                prop_assert!(wheels.left_mps.abs() <= 1.5 + 1e-12 && wheels.right_mps.abs() <= 1.5 + 1e-12);
                prop_assert!(middle_mps.abs() <= 1.3 + 1e-12);
                let speed = ramps.speed_mps;
                prop_assert!((speed - before).abs() <= 4.0 * DT_S + 1e-12);
                prop_assert!(speed.abs() - f64::abs(before) <= DT_S + 1e-12, "faster than the acceleration");
                before = speed;
            }
        }
    }
}
