//! What the localization takes from the sensors: attitude from inertial readings, distance from wheels, images and reports
//! of slip, and the global position from fixes.

use super::Localization;
use super::clocks::{ENCODERS, INERTIAL};
use crate::attitude::{Attitude, AttitudeSettings};
use crate::compass::{compass_rad, start_heading};
use crate::fixes::{GateSettings, GlobalEstimate, Position as Fixed, Verdict, fastest_mps};
use crate::planar::{MotionNoise, Planar};
use crate::proto::LocalizationParams;
use crate::way_slip::Slipped;
use crate::wheels::{FASTEST_MPS, Rolled, Wheels};
use glam::{DQuat, DVec2, DVec3};
use rcs_geom::{Geodetic, Pose, wrap_angle};
use rcs_msg::Stamp;
use rcs_msg::foxglove::{LocationFix, Vector3, location_fix};
use rcs_msg::rcs::{Imu, SlipReport, VisualMotion, WheelEncoders};
use rcs_runtime::{Cycle, Msg};
use rcs_sense::{FASTEST_RADPS, HARDEST_MPS2, Origin, SensorTime, text_above};

/// Wheel slip depends on the ground, so its error is correlated along the way: over this length it is one error, m.
const SLIP_LENGTH_M: f64 = 20.0;
/// Share of the wheels' motion from which on they are taken to slip: less may be an error of the inertial speed.
const SLIPS: f64 = 0.3;
/// Share from which on the global estimate follows the fixes: in mud the inertial speed soon tells a part of the slip only.
const SLIPS_A_LITTLE: f64 = 0.2;
/// A report of slip counts for this time, s.
const SLIP_TIMEOUT_S: f64 = 0.25;
/// Largest variance of a fix that says anything, m². Some receivers state the largest number for an unknown one.
const WIDEST_M2: f64 = 1e8;

/// Time for which nothing may have followed the vehicle before `INIT`, s: so long it moves by no more than its position is off
/// anyway.
const MOST_MISSED_S: f64 = 1.0;
/// Standard deviation of a motion that nothing has followed for longer, m, as of a vehicle that was driven by hand while this
/// process had failed: without fixes, a vehicle whose position is known no better stands (`max_error_m` of
/// `waypoint_generator`).
const MOVED_M: f64 = 5.0;

const REPEATED: &str = "it has the time of the reading before";

impl Localization {
    pub(super) fn feel(
        &mut self,
        imu: &Msg<Imu>,
        params: &LocalizationParams,
        cx: &mut Cycle<'_>,
    ) -> Result<(), String> {
        let gyro = vector(imu.angular_velocity.as_ref()).ok_or("no turn rates")?;
        let force = vector(imu.linear_acceleration.as_ref()).ok_or("no accelerations")?;
        // Also where they are no numbers.
        if !(gyro.length() <= FASTEST_RADPS && force.length() <= HARDEST_MPS2) {
            return Err(format!(
                "turn rates {gyro} rad/s and accelerations {force} m/s², expected at most {FASTEST_RADPS} and {HARDEST_MPS2}"
            ));
        }
        if self.repeats[INERTIAL].take(imu.timestamp.as_ref().and_then(Stamp::from_proto)) {
            return Err(REPEATED.to_owned());
        }
        let time = imu.acq_time_on_arrival();
        self.take_time(INERTIAL, time, cx);
        let slips = self.slipping_mps(time).is_some();
        let has_compass = params.compass_time_s > 0.0;
        let was_lost = self.was_lost(time);
        let is_asked = has_compass || self.felt.is_none() || self.awaits_compass || was_lost;
        let compass_rad = if is_asked { self.compass_rad(imu, cx) } else { None };
        // Estimates that began without inertial sensors, or without their heading, begin again, unless the vehicle has moved
        // since.
        let begins = self.felt.is_none() || (self.awaits_compass && compass_rad.is_some());
        let is_first = begins && self.wheels.is_none_or(|wheels| !wheels.has_moved());
        let Some(attitude) = self.attitude.as_mut().filter(|_| !is_first && !was_lost) else {
            let before = self.attitude.filter(|_| self.awaits_compass || was_lost);
            let heading = start_heading(imu, compass_rad, self.unstated_heading_rad(params), params);
            self.begin(force, heading, if was_lost { MOVED_M } else { 0.0 }, params);
            if let Some((attitude, before)) = self.attitude.as_mut().zip(before) {
                attitude.keep_bias(&before);
            }
            (self.felt, self.awaits_compass) = (Some(time), self.refuses_compass);
            return Ok(());
        };
        let settings = AttitudeSettings {
            tilt_time_s: params.tilt_time_s,
            tilt_gate_mps2: params.tilt_gate_mps2,
            bias_time_s: params.bias_time_s,
        };
        let elapsed_s = self.felt.map_or(0.0, |felt| time.seconds_since(felt));
        if elapsed_s < 0.0 {
            return Err(format!("reading is {:.3} s older than the one before", -elapsed_s));
        }
        let standing = self.wheels.is_none_or(|wheels| wheels.stand());
        // Accelerations from the vehicle's own motion, by speeding up or by turning at a speed, are not a tilt.
        let gain = self.gain.filter(|(_, at)| time.seconds_since(*at) < params.input_timeout_s);
        let own = gain.map_or(DVec3::ZERO, |(gain_mps2, _)| {
            DVec3::new(gain_mps2, self.speed_mps * attitude.turn_radps.z, 0.0)
        });
        // The acceleration of a vehicle whose wheels slip is not known: for that time the gyros alone turn it.
        let felt = (!slips).then_some(force - own);
        attitude.update(&settings, gyro, felt, elapsed_s, standing);
        if let Some(heading_rad) = compass_rad.filter(|_| has_compass) {
            attitude.follow_compass(heading_rad, params.compass_time_s, elapsed_s);
        }
        self.felt = Some(time);
        Ok(())
    }

    /// Heading that the inertial sensor states, rad. An orientation that cannot be used counts as none, and is a fault once:
    /// turn rates and accelerations are good without it.
    fn compass_rad(&mut self, imu: &Imu, cx: &mut Cycle<'_>) -> Option<f64> {
        let heading_rad = compass_rad(imu);
        let was_refused = std::mem::replace(&mut self.refuses_compass, heading_rad.is_err());
        match heading_rad {
            Ok(heading_rad) => heading_rad,
            Err(error) => {
                if !was_refused {
                    cx.fault(format!("imu: orientation: {error}; not used"));
                }
                None
            }
        }
    }

    /// Whether nothing followed the vehicle for too long before this time, that of the first reading since `INIT`. A time far
    /// before is of another clock.
    fn was_lost(&mut self, time: Stamp) -> bool {
        let missed_s = self.followed_until.take().map_or(0.0, |until| time.seconds_since(until));
        missed_s.abs() > MOST_MISSED_S
    }

    /// Heading of a vehicle whose sensors state none, rad: the one before `INIT`, or that of the parameters.
    fn unstated_heading_rad(&self, params: &LocalizationParams) -> f64 {
        let before = self.local.filter(|_| self.goes_on);
        before.map_or_else(|| params.start_heading_deg.to_radians(), |local| local.yaw_rad)
    }

    /// Begins the estimates with a heading and its variance, rad and rad². Those of before `INIT` stay where they are, and turn
    /// to that heading; the vehicle may have moved since by a distance with this standard deviation, m.
    fn begin(
        &mut self,
        force_mps2: DVec3,
        (yaw_rad, yaw_variance): (f64, f64),
        moved_m: f64,
        params: &LocalizationParams,
    ) {
        match &mut self.local {
            Some(local) if self.goes_on => {
                self.global.lose(moved_m, wrap_angle(yaw_rad - local.yaw_rad), yaw_variance);
                local.yaw_rad = yaw_rad;
            }
            _ => {
                // In its own frame the starting position is known exactly.
                self.local = Some(Planar::new(DVec2::ZERO, yaw_rad, 0.0, 0.0));
                self.global = GlobalEstimate::new(yaw_rad, yaw_variance);
            }
        }
        self.attitude = Some(Attitude::at_rest(force_mps2, yaw_rad));
        self.start_heading_deg = params.start_heading_deg;
    }

    /// Notes whether the wheels slip, and how fast the vehicle moves then.
    pub(super) fn take_slip(&mut self, report: &Msg<SlipReport>) -> Result<(), String> {
        let (slip, speed_mps) = (report.slip, report.inertial_speed_mps);
        if !(slip.is_finite() && speed_mps.abs() < FASTEST_MPS) {
            return Err(format!(
                "slip {slip} at {speed_mps} m/s, expected finite numbers and at most {FASTEST_MPS} m/s"
            ));
        }
        // Where images tell the motion, the estimate needs no fixes for it.
        let time = report.acq_time_on_arrival();
        if slip >= SLIPS_A_LITTLE && !self.grip.is_known(time) {
            self.global.follow();
        }
        self.slipping = (slip >= SLIPS).then_some((speed_mps, time));
        Ok(())
    }

    pub(super) fn take_visual(&mut self, motion: &Msg<VisualMotion>) -> Result<(), String> {
        let (since, until) = (motion.since.as_ref().and_then(Stamp::from_proto), motion.acq_time());
        let Some(since) = since.filter(|&since| since < until) else {
            return Err("it does not begin before it ends".to_owned());
        };
        let moved_m = motion.forward_m;
        if moved_m.is_nan() || moved_m.abs() > FASTEST_MPS * until.seconds_since(since) {
            return Err(format!("the vehicle moved {moved_m} m in {:.3} s", until.seconds_since(since)));
        }
        self.grip.take(since, until, moved_m);
        Ok(())
    }

    /// Speed of the vehicle while its wheels slip, m/s; `None` while they grip, and where nothing reports slip.
    fn slipping_mps(&self, time: Stamp) -> Option<f64> {
        let recent = self.slipping.filter(|(_, at)| time.seconds_since(*at) < SLIP_TIMEOUT_S);
        recent.map(|(speed_mps, _)| speed_mps)
    }

    /// Advances both estimates by what the wheels have rolled. Says how much of the last metres was slip, now and then.
    pub(super) fn roll(
        &mut self,
        encoders: &Msg<WheelEncoders>,
        params: &LocalizationParams,
        cx: &mut Cycle<'_>,
    ) -> Result<Option<Slipped>, String> {
        let distance_m = [encoders.left_m, encoders.right_m];
        if self.repeats[ENCODERS].take(encoders.timestamp.as_ref().and_then(Stamp::from_proto)) {
            return Err(REPEATED.to_owned());
        }
        let time = encoders.acq_time_on_arrival();
        self.take_time(ENCODERS, time, cx);
        let Some(wheels) = &mut self.wheels else {
            if !distance_m.iter().all(|distance| distance.is_finite()) {
                return Err(format!("distances are {distance_m:?} m, expected finite ones"));
            }
            self.wheels = Some(Wheels::new(SensorTime::of(encoders), distance_m));
            return Ok(None);
        };
        let Rolled { rolled_m: wheels_m, elapsed_s } = wheels.roll(SensorTime::of(encoders), distance_m)?;
        let has_gyro = self.felt.is_some_and(|felt| time.seconds_since(felt) < params.input_timeout_s);
        // Inertial sensors may be about to report the heading.
        let (since, deviation) = (wheels.since, params.start_heading_noise_deg.to_radians());
        let waits = time.seconds_since(since) < params.input_timeout_s;
        if self.attitude.is_none() {
            if waits {
                return Ok(None);
            }
            // A vehicle without inertial sensors is assumed level, and turns as its wheels report.
            let heading = (self.unstated_heading_rad(params), deviation * deviation);
            self.begin(DVec3::Z, heading, 0.0, params);
        } else if !waits && self.was_lost(since) {
            self.global.lose(MOVED_M, 0.0, deviation * deviation);
        }
        let rolled_m = 0.5 * (wheels_m[0] + wheels_m[1]);
        let seen_share = self.grip.share(time, rolled_m);
        let slipping_mps = self.slipping_mps(time).filter(|_| seen_share.is_none());
        let (Some(attitude), Some(local)) = (&mut self.attitude, &mut self.local) else { return Ok(None) };
        if !has_gyro {
            attitude.turn_by((wheels_m[1] - wheels_m[0]) / params.track_m);
        }
        let turn_rad = wrap_angle(attitude.yaw_rad() - local.yaw_rad);
        let radar = self.ground_speed.filter(|(_, at)| time.seconds_since(*at) < params.input_timeout_s);
        let known_mps = radar.map(|(speed_mps, _)| speed_mps).or(slipping_mps);
        let way_of_rolled = 1.0 - params.rolling_slip;
        let by_wheels_m = rolled_m * way_of_rolled * seen_share.unwrap_or(1.0);
        let step_m = known_mps.map_or(by_wheels_m, |speed_mps| speed_mps * elapsed_s);
        self.grip.roll(time, rolled_m, step_m / way_of_rolled);
        let owed_m = way_of_rolled * self.grip.owed_m();
        // A radar needs nothing to be made up for.
        let owed_m = if radar.is_none() { owed_m } else { 0.0 };
        let forward = attitude.level_from_vehicle * DVec3::X;
        let level_m = (step_m + owed_m) * forward.truncate().length();
        let noise = MotionNoise {
            distance: params.distance_noise * SLIP_LENGTH_M.sqrt(),
            heading_rad: params.heading_noise_deg.to_radians(),
        };
        // Not backwards: what lies behind the vehicle is remembered, and not seen again.
        let share = match seen_share {
            None if step_m > 0.0 => self.way_slip.share_of(level_m),
            _ => 1.0,
        };
        local.advance(&noise, share * level_m, turn_rad, elapsed_s);
        self.global.advance(&noise, level_m, turn_rad, elapsed_s);
        self.height_m += share * (step_m + owed_m) * forward.z;
        // Encoder ticks are quantised, so the speed is smoothed over a few readings.
        let faster_mps = 0.3 * (step_m / elapsed_s - self.speed_mps);
        self.speed_mps += faster_mps;
        let gain = self.gain.map_or(0.0, |(gain, _)| gain);
        self.gain = Some((gain + 0.3 * (faster_mps / elapsed_s - gain), time));
        let local_from_vehicle = Pose::new(attitude.level_from_vehicle, local.at.extend(self.height_m));
        let seen = self.grip.slipped(&local_from_vehicle);
        let has_fixes = self.global.age_s(time).is_some_and(|age_s| age_s <= params.gps_dropout_s);
        let Some(global) = self.global.planar().filter(|_| has_fixes) else {
            self.way_slip.clear();
            return Ok(seen);
        };
        let by_fixes = self.way_slip.take(time, rolled_m, level_m, global, local_from_vehicle);
        Ok(if self.grip.is_known(time) { seen } else { by_fixes })
    }

    pub(super) fn fix(
        &mut self,
        fix: &Msg<LocationFix>,
        params: &LocalizationParams,
        now: Stamp,
    ) -> Result<(), String> {
        let Some(attitude) = &self.attitude else { return Ok(()) };
        if fix.is_without_position() {
            return Err("the receiver has no position fix".to_owned());
        }
        // A fix is compared with where the vehicle is now.
        let time = fix.acq_time_on_arrival();
        let age_s = now.seconds_since(time);
        if age_s > params.gps_dropout_s {
            let limit_s = params.gps_dropout_s;
            let age_s = text_above(age_s, limit_s);
            return Err(format!("position fix is {age_s} s old, expected at most {limit_s} s"));
        }
        // By its stamp, a fix from the future that is repeated is told from a new one.
        let is_repeated = self.fix_stamp == Some(fix.acq_time());
        if is_repeated || self.global.last_fix().is_some_and(|before| before >= time) {
            return Err("position fix is not newer than the one before".to_owned());
        }
        self.fix_stamp = Some(fix.acq_time());
        // A receiver that measures no height says NaN.
        let has_height = !fix.altitude.is_nan();
        let altitude_m = if has_height { fix.altitude } else { 0.0 };
        let place =
            Geodetic::new(fix.latitude, fix.longitude, altitude_m).map_err(|error| error.to_string())?;
        let stated = |index: usize| fix.position_covariance.get(index).copied();
        let known = fix.position_covariance_type() != location_fix::PositionCovarianceType::Unknown;
        let default = params.gps_noise_m * params.gps_noise_m;
        let variance_of = |index: usize, default: f64| match stated(index).filter(|_| known) {
            Some(variance) if (0.0..=WIDEST_M2).contains(&variance) => Ok(variance.max(0.01 * default)),
            Some(variance) => Err(format!("variance is {variance} m², expected 0 to {WIDEST_M2}")),
            None => Ok(default),
        };
        let variance = 0.5 * (variance_of(0, default)? + variance_of(4, default)?);
        let height_variance = if has_height { variance_of(8, 4.0 * default)? } else { WIDEST_M2 };
        let here = Origin::at(&place).map_err(|error| error.to_string())?;
        let of_waiting = self.waiting_origin.filter(|origin| origin.global_from_geodetic(&place).is_ok());
        if self.origin.is_none() && of_waiting.is_none() {
            // From another zone, no fix agrees with the one that waits.
            self.global.move_waiting(DVec2::INFINITY);
        }
        let origin = self.origin.or(of_waiting).unwrap_or(here);
        let p = origin.global_from_geodetic(&place).map_err(|error| error.to_string())?;
        // Position of the antenna, rotated by roll and pitch only.
        let antenna = DVec3::new(params.antenna_x_m, params.antenna_y_m, params.antenna_z_m);
        let level = DQuat::from_rotation_z(-attitude.yaw_rad()) * attitude.level_from_vehicle * antenna;
        let settings = GateSettings {
            gate: params.gps_gate,
            correlation_s: params.gps_correlation_s,
            reset_after: params.gps_reset_after,
            fastest_mps: fastest_mps(self.speed_mps),
        };
        let local_height_m = self.height_m + level.z;
        // Without a height, the one that is known: the estimate of the height does not change.
        let height_m = if has_height { p.z } else { local_height_m + self.global.lift()[0] };
        let fixed = Fixed { time, at: p.truncate(), height_m, variance, height_variance };
        let verdict = self.global.take(&settings, fixed, level.truncate(), local_height_m);
        if self.origin.is_none() && verdict == Verdict::Waits {
            // It agrees with no fix before it: the global frame begins here if the next one agrees with it.
            self.waiting_origin = Some(here);
            self.global.move_waiting(DVec2::ZERO);
        } else {
            self.origin = Some(origin);
        }
        match verdict {
            Verdict::Refused { surprise } => Err(format!(
                "position fix is an outlier: squared error {surprise:.1}, expected at most {}",
                params.gps_gate
            )),
            Verdict::Began => {
                self.way_slip.clear();
                Ok(())
            }
            Verdict::Used | Verdict::Waits => Ok(()),
        }
    }
}

fn vector(v: Option<&Vector3>) -> Option<DVec3> {
    v.map(|v| DVec3::new(v.x, v.y, v.z))
}
