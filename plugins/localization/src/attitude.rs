//! Roll, pitch and yaw from gyros and accelerometers by a complementary filter.
//!
//! The gyros are integrated. While the magnitude of the measured acceleration is close to gravity, its direction slowly
//! corrects roll and pitch; accelerations from the vehicle's own motion, as measured by the wheels, are subtracted
//! before. Yaw drifts with the bias of its gyro, which is estimated while the vehicle stands, and, where the inertial
//! sensor has a compass that is to be used, while it drives.
//!
//! Whether the vehicle stands, the wheels and the gyros tell together. A bias of 0.03 rad/s or more looks like a turn.
//! While no smaller one is known, it is learned where the wheels stand and the gyros tell the same turn for
//! two seconds, up to 0.1 rad/s; what the heading has turned meanwhile is taken back. A vehicle that is turned
//! that slowly and steadily at the start of a run without its wheels, as on a turntable, is taken for one that stands;
//! after that turn, the bias is learned again in the same way. Once a smaller bias is known, such turns are followed.

use glam::{DQuat, DVec3};
use rcs_geom::wrap_angle;
use serde::{Deserialize, Serialize};

/// m/s².
const GRAVITY_MPS2: f64 = 9.81;
/// A vehicle that turns faster than this is not at rest, whatever the encoders report, rad/s.
const STANDING_RADPS: f64 = 0.03;
/// Shortest rest from which a bias is estimated, s: the vehicle may be about to turn, and the first readings of that
/// turn must not be taken for a bias.
const LEAST_REST_S: f64 = 0.5;
/// Greatest bias, rad/s, and time over which the turn rates must be steady to be taken for a bias of [`STANDING_RADPS`] or
/// more, s.
const LARGEST_BIAS_RADPS: f64 = 0.1;
const LEAST_STEADY_S: f64 = 2.0;
/// Longest gap between readings that is integrated over, s.
const MAX_STEP_S: f64 = 0.5;

/// Settings of the filter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AttitudeSettings {
    /// Time constant with which the accelerometers correct roll and pitch, s.
    pub tilt_time_s: f64,
    /// Accelerations that differ from gravity by more than this are ignored, m/s².
    pub tilt_gate_mps2: f64,
    /// Averaging time of the biases, s.
    pub bias_time_s: f64,
}

/// State of the filter.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Attitude {
    /// Rotation from vehicle axes to level axes, x to the east.
    pub level_from_vehicle: DQuat,
    /// Turn rates with the biases removed, rad/s, vehicle axes.
    pub turn_radps: DVec3,
    bias: DVec3,
    /// Total time at rest over which the bias has been averaged, s.
    rested_s: f64,
    /// Duration of the current rest, s, and the mean turn rate in its first [`LEAST_REST_S`], rad/s.
    rest_s: f64,
    rest_mean: DVec3,
    /// Since when the wheels have stood while the gyros told a steady turn.
    steady: Steady,
}

/// A steady turn that the gyros tell while the wheels stand.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Steady {
    /// Its duration, s.
    duration_s: f64,
    /// Its mean rate, rad/s.
    mean: DVec3,
    /// By how much the heading was turned because of it, rad.
    yaw_rad: f64,
}

impl Attitude {
    /// Attitude of a vehicle at rest with this heading; roll and pitch follow from the accelerometers.
    pub fn at_rest(force_mps2: DVec3, yaw_rad: f64) -> Attitude {
        let yawless = DQuat::from_rotation_arc(force_mps2.normalize_or(DVec3::Z), DVec3::Z);
        let forward = yawless * DVec3::X;
        let turn = yaw_rad - libm::atan2(forward.y, forward.x);
        Attitude {
            level_from_vehicle: (DQuat::from_rotation_z(turn) * yawless).normalize(),
            turn_radps: DVec3::ZERO,
            bias: DVec3::ZERO,
            rested_s: 0.0,
            rest_s: 0.0,
            rest_mean: DVec3::ZERO,
            steady: Steady::default(),
        }
    }

    /// Whether the attitude and the biases are finite.
    pub fn is_finite(&self) -> bool {
        self.level_from_vehicle.is_finite() && self.bias.is_finite()
    }

    /// Takes a reading `elapsed_s` after the previous one: turn rates, rad/s, and accelerations, m/s², including
    /// gravity but with the known motion of the vehicle subtracted, in vehicle axes; `None` where its motion is not known.
    pub fn update(
        &mut self,
        settings: &AttitudeSettings,
        gyro_radps: DVec3,
        force_mps2: Option<DVec3>,
        elapsed_s: f64,
        standing: bool,
    ) {
        let elapsed_s = elapsed_s.clamp(0.0, MAX_STEP_S);
        let turn = gyro_radps - self.bias;
        let at_rest = standing && turn.length() < STANDING_RADPS;
        if at_rest {
            self.rest(settings, gyro_radps, elapsed_s);
            self.turn_radps = DVec3::ZERO;
        } else {
            self.turn_radps = turn;
            (self.rest_s, self.rest_mean) = (0.0, DVec3::ZERO);
        }
        // Noise around 0.03 rad/s is now a rest and now none: without any bias, both tell of one.
        if standing && (!at_rest || self.rested_s == 0.0) {
            self.take_steady(settings, gyro_radps, elapsed_s);
        } else {
            self.steady = Steady::default();
        }
        let mut attitude = self.level_from_vehicle * DQuat::from_scaled_axis(self.turn_radps * elapsed_s);
        let is_gravity = |force: &DVec3| (force.length() - GRAVITY_MPS2).abs() < settings.tilt_gate_mps2;
        if let Some(force_mps2) = force_mps2.filter(is_gravity) {
            let felt_up = force_mps2.normalize();
            let believed_up = attitude.conjugate() * DVec3::Z;
            let part = elapsed_s / (settings.tilt_time_s + elapsed_s);
            // The rotation axis is perpendicular to up, so yaw does not change.
            attitude *= DQuat::from_scaled_axis(felt_up.cross(believed_up) * part);
        }
        self.level_from_vehicle = attitude.normalize();
    }

    /// Estimates the biases from a reading at rest: first by the plain mean over all time at rest, later by a mean that
    /// forgets.
    fn rest(&mut self, settings: &AttitudeSettings, gyro_radps: DVec3, elapsed_s: f64) {
        if elapsed_s <= 0.0 {
            return;
        }
        let before_s = self.rest_s;
        self.rest_s += elapsed_s;
        let (value, weight_s) = if self.rest_s < LEAST_REST_S {
            self.rest_mean += (gyro_radps - self.rest_mean) * (elapsed_s / self.rest_s);
            return;
        } else if before_s < LEAST_REST_S {
            (self.rest_mean, self.rest_s)
        } else {
            (gyro_radps, elapsed_s)
        };
        self.rested_s = (self.rested_s + weight_s).min(settings.bias_time_s.max(weight_s));
        self.bias += (value - self.bias) * (weight_s / self.rested_s);
    }

    /// Takes a steady turn that the gyros tell while the wheels stand for a large bias, while no small one is known.
    fn take_steady(&mut self, settings: &AttitudeSettings, gyro_radps: DVec3, elapsed_s: f64) {
        let may_be_bias = (self.rested_s == 0.0 || self.bias.length() >= STANDING_RADPS)
            && gyro_radps.length() < LARGEST_BIAS_RADPS;
        let steady = &mut self.steady;
        let is_steady = steady.duration_s == 0.0 || (gyro_radps - steady.mean).length() < STANDING_RADPS;
        if !(may_be_bias && is_steady) {
            *steady = Steady::default();
            return;
        }
        if elapsed_s <= 0.0 {
            return;
        }
        steady.duration_s += elapsed_s;
        steady.mean += (gyro_radps - steady.mean) * (elapsed_s / steady.duration_s);
        if steady.duration_s < LEAST_STEADY_S {
            let up = self.level_from_vehicle.conjugate() * DVec3::Z;
            steady.yaw_rad += elapsed_s * self.turn_radps.dot(up);
            return;
        }
        // The vehicle has not turned since then.
        let Steady { duration_s, mean, yaw_rad } = std::mem::take(steady);
        self.turn_by(-yaw_rad);
        self.bias = mean;
        self.rested_s = duration_s.min(settings.bias_time_s);
        self.turn_radps = DVec3::ZERO;
    }

    /// Keeps the bias that an earlier estimate of the same sensors has learned.
    pub fn keep_bias(&mut self, before: &Attitude) {
        (self.bias, self.rested_s) = (before.bias, before.rested_s);
    }

    /// Corrects heading and bias by the heading of a compass, counter-clockwise from east, rad, `elapsed_s` after the
    /// reading before: a critically damped observer with the time constant `compass_time_s`. At rest nothing changes.
    pub fn follow_compass(&mut self, compass_yaw_rad: f64, compass_time_s: f64, elapsed_s: f64) {
        if self.turn_radps == DVec3::ZERO {
            return;
        }
        let error_rad = wrap_angle(compass_yaw_rad - self.yaw_rad());
        let part = elapsed_s.clamp(0.0, MAX_STEP_S) / compass_time_s.max(MAX_STEP_S);
        self.turn_by(2.0 * error_rad * part);
        self.bias.z -= error_rad * part / compass_time_s.max(MAX_STEP_S);
    }

    /// Heading counter-clockwise from east, rad.
    pub fn yaw_rad(&self) -> f64 {
        let forward = self.level_from_vehicle * DVec3::X;
        libm::atan2(forward.y, forward.x)
    }

    /// Adds a rotation about the vertical from a source other than the gyros, rad.
    pub fn turn_by(&mut self, yaw_rad: f64) {
        self.level_from_vehicle = (DQuat::from_rotation_z(yaw_rad) * self.level_from_vehicle).normalize();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SETTINGS: AttitudeSettings =
        AttitudeSettings { tilt_time_s: 2.0, tilt_gate_mps2: 1.0, bias_time_s: 3.0 };

    fn tilt_error(a: DQuat, b: DQuat) -> f64 {
        (a.conjugate() * DVec3::Z).angle_between(b.conjugate() * DVec3::Z)
    }

    #[test]
    fn at_rest_it_has_the_roll_and_pitch_that_gravity_tells_and_the_heading_that_is_given() {
        let truth = DQuat::from_rotation_z(1.0) * DQuat::from_rotation_y(0.2) * DQuat::from_rotation_x(-0.1);
        let attitude = Attitude::at_rest(truth.conjugate() * (DVec3::Z * 9.81), 1.0);
        assert!(attitude.level_from_vehicle.angle_between(truth) < 1e-9);
        assert!((attitude.yaw_rad() - 1.0).abs() < 1e-9);
    }

    #[test]
    fn roll_and_pitch_come_back_from_an_error_and_yaw_does_not_move() {
        let mut attitude = Attitude::at_rest(DVec3::Z * 9.81, 0.5);
        attitude.level_from_vehicle *= DQuat::from_rotation_x(0.2);
        for _ in 0..1000 {
            attitude.update(&SETTINGS, DVec3::ZERO, Some(DVec3::Z * 9.81), 0.01, false);
        }
        let truth = DQuat::from_rotation_z(0.5);
        let error = tilt_error(attitude.level_from_vehicle, truth);
        assert!(error < 0.2 * 0.01, "after five time constants: {error}");
        assert!((attitude.yaw_rad() - 0.5).abs() < 1e-6);
    }

    #[test]
    fn a_push_does_not_tilt_it() {
        let mut attitude = Attitude::at_rest(DVec3::Z * 9.81, 0.0);
        for _ in 0..100 {
            attitude.update(&SETTINGS, DVec3::ZERO, Some(DVec3::new(8.0, 0.0, 9.81)), 0.01, false);
        }
        assert!(tilt_error(attitude.level_from_vehicle, DQuat::IDENTITY) < 1e-9);
    }

    #[test]
    fn the_gyros_bias_is_learned_at_rest_and_taken_off_when_it_turns() {
        let bias = DVec3::new(0.004, -0.003, 0.005);
        let mut attitude = Attitude::at_rest(DVec3::Z * 9.81, 0.0);
        for _ in 0..2000 {
            attitude.update(&SETTINGS, bias, Some(DVec3::Z * 9.81), 0.01, true);
        }
        assert!(attitude.yaw_rad().abs() < 1e-9, "it does not turn at rest");
        for _ in 0..100 {
            let gyro = bias + DVec3::Z * 0.5;
            attitude.update(&SETTINGS, gyro, Some(DVec3::Z * 9.81), 0.01, false);
        }
        assert!((attitude.yaw_rad() - 0.5).abs() < 1e-4, "{}", attitude.yaw_rad());
    }

    #[test]
    fn a_vehicle_that_turns_off_at_once_teaches_no_bias() {
        let mut attitude = Attitude::at_rest(DVec3::Z * 9.81, 0.0);
        for step in 0..100 {
            // The encoders report the turn only after a moment.
            let (gyro, standing) = (DVec3::Z * 0.001 * f64::from(step), step < 20);
            attitude.update(&SETTINGS, gyro, Some(DVec3::Z * 9.81), 0.01, standing);
        }
        assert_eq!(attitude.bias, DVec3::ZERO);
    }

    /// Stands on its wheels for some readings of 0.01 s, with this turn rate by the gyros, rad/s.
    fn stand(attitude: &mut Attitude, gyro: DVec3, readings: usize) {
        for _ in 0..readings {
            attitude.update(&SETTINGS, gyro, Some(DVec3::Z * 9.81), 0.01, true);
        }
    }

    #[test]
    fn a_large_bias_is_learned_from_steady_turn_rates_while_the_wheels_stand() {
        let bias = DVec3::new(0.02, -0.03, 0.06);
        let mut attitude = Attitude::at_rest(DVec3::Z * 9.81, 1.0);
        for step in 0..1000 {
            // A plain sequence that has no trend.
            let noise = (f64::from(step * 7919 % 1000) / 999.0 - 0.5) * 0.01;
            stand(&mut attitude, bias + DVec3::Z * noise, 1);
        }
        assert!((attitude.bias - bias).length() < 0.001, "{}", attitude.bias);
        assert!((attitude.yaw_rad() - 1.0).abs() < 0.01, "it has not turned: {}", attitude.yaw_rad());
        for _ in 0..100 {
            let gyro = bias + DVec3::Z * 0.5;
            attitude.update(&SETTINGS, gyro, Some(DVec3::Z * 9.81), 0.01, false);
        }
        assert!((attitude.yaw_rad() - 1.5).abs() < 0.01, "{}", attitude.yaw_rad());
    }

    #[test]
    fn a_bias_at_the_border_of_what_counts_as_rest_is_learned_through_the_noise() {
        for rate in [0.026, 0.029, 0.03, 0.031, 0.034] {
            let mut attitude = Attitude::at_rest(DVec3::Z * 9.81, 1.0);
            for step in 0..1000 {
                let noise = (f64::from(step * 7919 % 1000) / 999.0 - 0.5) * 0.01;
                stand(&mut attitude, DVec3::Z * (rate + noise), 1);
            }
            assert!((attitude.bias.z - rate).abs() < 0.001, "{rate}: {}", attitude.bias);
            assert!(
                (attitude.yaw_rad() - 1.0).abs() < 0.01,
                "{rate}: it has not turned: {}",
                attitude.yaw_rad()
            );
        }
    }

    #[test]
    fn a_slow_turn_on_standing_wheels_is_no_bias_once_a_small_one_is_known_or_not_for_long() {
        let turn = DVec3::Z * 0.05;
        let mut attitude = Attitude::at_rest(DVec3::Z * 9.81, 0.0);
        stand(&mut attitude, DVec3::Z * 0.001, 100);
        stand(&mut attitude, turn + DVec3::Z * 0.001, 1000);
        assert!((attitude.yaw_rad() - 0.5).abs() < 1e-3, "{}", attitude.yaw_rad());
        // At the start of a run it is taken for one, and not any more when it ends.
        let mut attitude = Attitude::at_rest(DVec3::Z * 9.81, 0.0);
        stand(&mut attitude, turn, 1000);
        assert!((attitude.bias - turn).length() < 1e-9, "{}", attitude.bias);
        stand(&mut attitude, DVec3::ZERO, 300);
        assert!(attitude.bias.length() < 1e-9, "{}", attitude.bias);
        // A faster or an unsteady turn is none.
        let mut attitude = Attitude::at_rest(DVec3::Z * 9.81, 0.0);
        stand(&mut attitude, DVec3::Z * 0.11, 1000);
        for _ in 0..10 {
            stand(&mut attitude, turn, 150);
            stand(&mut attitude, -turn, 150);
        }
        assert_eq!(attitude.bias, DVec3::ZERO);
    }

    #[test]
    fn a_compass_takes_the_drift_from_the_heading_and_its_noise_does_not_show() {
        let drive = |compass_time_s: Option<f64>| {
            let mut attitude = Attitude::at_rest(DVec3::Z * 9.81, 3.0);
            let mut truth: f64 = 3.0;
            let mut worst = 0.0_f64;
            for step in 0..20_000_i32 {
                let turn_radps = 0.3 * libm::sin(f64::from(step) * 0.002);
                truth += turn_radps * 0.01;
                let gyro = DVec3::Z * (turn_radps + 0.001);
                attitude.update(&SETTINGS, gyro, Some(DVec3::Z * 9.81), 0.01, false);
                // Its noise is 1 degree; a plain sequence that has no trend.
                let noise = (f64::from(step * 7919 % 1000) / 999.0 - 0.5) * 0.06;
                if let Some(compass_time_s) = compass_time_s {
                    attitude.follow_compass(wrap_angle(truth + noise), compass_time_s, 0.01);
                }
                if step > 10_000 {
                    worst = worst.max(wrap_angle(attitude.yaw_rad() - truth).abs());
                }
            }
            worst
        };
        assert!(drive(None) > 0.19);
        assert!(drive(Some(20.0)) < 0.002, "{}", drive(Some(20.0)));
    }

    #[test]
    fn yaw_is_the_integral_of_the_gyro_on_a_slope_too() {
        let tilt = DQuat::from_rotation_y(0.3);
        let mut truth = tilt;
        let mut attitude = Attitude::at_rest(truth.conjugate() * (DVec3::Z * 9.81), truth_yaw(truth));
        for _ in 0..500 {
            let gyro = DVec3::Z * 0.4;
            truth = (truth * DQuat::from_scaled_axis(gyro * 0.01)).normalize();
            attitude.update(&SETTINGS, gyro, Some(truth.conjugate() * (DVec3::Z * 9.81)), 0.01, false);
        }
        assert!(attitude.level_from_vehicle.angle_between(truth) < 1e-3);
    }

    fn truth_yaw(q: DQuat) -> f64 {
        let forward = q * DVec3::X;
        libm::atan2(forward.y, forward.x)
    }
}
