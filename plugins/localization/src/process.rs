//! The process `localization`: reads the sensors, and sends the local and the global estimate. Its port table is in
//! the crate's documentation.

use crate::attitude::{Attitude, AttitudeSettings};
use crate::compass::{compass_rad, start_heading};
use crate::fixes::{GateSettings, GlobalEstimate, Position as Fixed, Verdict};
use crate::grip::Grip;
use crate::planar::{MotionNoise, Planar};
use crate::proto::LocalizationParams;
use crate::way_slip::{Slipped, WaySlip};
use crate::wheels::{FASTEST_MPS, Rolled, Wheels};
use glam::{DQuat, DVec2, DVec3};
use rcs_geom::{Geodetic, Pose, wrap_angle};
use rcs_msg::Stamp;
use rcs_msg::foxglove::{
    FrameTransform, FrameTransforms, LocationFix, Odometry, Quaternion, Vector3, location_fix,
};
use rcs_msg::rcs::{self, GroundSpeed, Imu, SlipReport, VisualMotion, WheelEncoders};
use rcs_runtime::{Cycle, In, Msg, NoCommands, Out, PortBuilder, Process, ProcessDef, Role};
use rcs_sense::{FASTEST_RADPS, HARDEST_MPS2, Origin, Repeats, SensorTime, pose_message};
use serde::{Deserialize, Serialize};

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
/// Time between two global estimates that are sent, ns.
const GLOBAL_PERIOD_NS: u64 = 100_000_000;
/// Stated variance of roll and pitch: that of the filter on rough ground, rad².
const TILT_VARIANCE: f64 = 0.0012;
/// Child frame of the global estimate. The frame `vehicle` itself is a child of the local frame.
const GLOBAL_BODY: &str = "vehicle_global";

const REPEATED: &str = "it has the time of the reading before";

/// State: attitude, both estimates, and the last readings of the sensors.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Localization {
    attitude: Option<Attitude>,
    /// Position, heading and height of the local estimate.
    local: Option<Planar>,
    height_m: f64,
    global: GlobalEstimate,
    /// Origin of the global frame: of the world file, or the first of the fixes with which the global estimate began.
    origin: Option<Origin>,
    /// Place of a fix that waits for a second one.
    waiting_origin: Option<Origin>,
    /// Of inertial sensor and encoders: one that repeats its last message measures nothing.
    repeats: [Repeats; 2],
    /// Stamp of the last fix.
    fix_stamp: Option<Stamp>,
    speed_mps: f64,
    /// Acceleration by the wheels, m/s², and its time.
    gain: Option<(f64, Stamp)>,
    /// When a usable reading of the encoders last came; before the first one, when inertial readings began.
    counted: Option<Stamp>,
    /// Time of the last inertial reading.
    felt: Option<Stamp>,
    /// Whether the last orientation of the inertial sensor could not be used.
    refuses_compass: bool,
    /// Whether the estimates began with the heading of the parameters because of that: until the vehicle moves, the first
    /// orientation that can be used gives the heading.
    awaits_compass: bool,
    wheels: Option<Wheels>,
    /// Speed over ground and when it was measured.
    ground_speed: Option<(f64, Stamp)>,
    /// Speed by the inertial sensors while the wheels slip, m/s, and its time.
    slipping: Option<(f64, Stamp)>,
    /// Slip by the images of a camera.
    grip: Grip,
    /// Slip over the last metres, by the fixes, where images tell nothing.
    way_slip: WaySlip,
    sent_global: Option<Stamp>,
}

/// Ports of [`Localization`].
#[derive(Debug)]
pub struct Ports {
    encoders: In<WheelEncoders>,
    imu: In<Imu>,
    gps: In<LocationFix>,
    ground_speed: In<GroundSpeed>,
    slip: In<SlipReport>,
    visual_motion: In<VisualMotion>,
    local: Out<Odometry>,
    global: Out<Odometry>,
    transforms: Out<FrameTransforms>,
    way_slip: Out<rcs::WaySlip>,
}

impl Process for Localization {
    type Params = LocalizationParams;
    type Ports = Ports;
    type Command = NoCommands;
    const DEF: ProcessDef = ProcessDef {
        plugin: "localization",
        summary: "Estimates the local and the global pose of the vehicle",
        period_ms: 20.0,
        latency_ms: 0.0,
        reads_ground_truth: false,
    };

    fn ports(b: &mut PortBuilder) -> Ports {
        Ports {
            encoders: b.input("encoders", "distances of the driven wheels, m"),
            imu: b.optional_input("imu", "turn rates, accelerations and heading, vehicle axes"),
            gps: b.optional_input("gps", "position fixes of the antenna with their variances"),
            ground_speed: b.optional_input(
                "ground_speed",
                "speed over ground, unaffected by slip, used instead of that of the encoders",
            ),
            slip: b.optional_input(
                "slip",
                "slip of the wheels, and the speed by the inertial sensors, which counts while they slip",
            ),
            visual_motion: b.optional_input(
                "visual_motion",
                "motion by the images of a camera, which counts where the wheels slip",
            ),
            local: b
                .output("local", "pose of the vehicle in the local frame with covariance: smooth, drifts")
                .role(Role::Pose)
                .build(),
            global: b
                .output(
                    "global",
                    "pose of the vehicle in the global frame with covariance: noisy, does not drift",
                )
                .role(Role::Pose)
                .build(),
            transforms: b
                .output("transforms", "the local frame in the global frame")
                .role(Role::Transforms)
                .build(),
            way_slip: b
                .output(
                    "way_slip",
                    "slip of the wheels over the last metre that they have rolled, by images; over 5 m, by fixes, without them",
                )
                .role(Role::Stats)
                .build(),
        }
    }

    fn check(params: &LocalizationParams) -> Result<(), String> {
        if params.world.is_empty() {
            return Ok(());
        }
        Origin::from_toml(&params.world).map(|_| ()).map_err(|error| format!("world: {error}"))
    }

    fn new(params: &LocalizationParams) -> Self {
        // The runtime has called `check`; with an invalid world file the first fix sets the origin.
        Self { origin: Origin::from_toml(&params.world).ok(), ..Self::default() }
    }

    fn cycle(&mut self, ports: &Ports, params: &LocalizationParams, cx: &mut Cycle<'_>) {
        let is_frozen = self.estimate(ports, params, cx);
        let now = cx.now();
        let silent =
            |time: Option<Stamp>| time.is_none_or(|time| now.seconds_since(time) > params.input_timeout_s);
        let lost = self.global.age_s(now).is_none_or(|age_s| age_s > params.gps_dropout_s);
        cx.exec(match (silent(self.wheels.map(|wheels| wheels.time)), silent(self.felt), lost) {
            _ if is_frozen => "warning: no encoders, the positions stand still and are not sent",
            (true, ..) => "warning: no encoders, the estimates stand still",
            (_, true, _) => "warning: no inertial readings, turns come from the wheels",
            (_, _, true) => "warning: no good position fix, the global estimate is dead reckoning",
            _ => "estimates both positions",
        });
    }

    /// A halted vehicle may roll out, or be pushed: the estimates follow it.
    fn halt(&mut self, ports: &Ports, params: &LocalizationParams, cx: &mut Cycle<'_>) {
        self.estimate(ports, params, cx);
        cx.done("halted");
    }
}

fn vector(v: Option<&Vector3>) -> Option<DVec3> {
    v.map(|v| DVec3::new(v.x, v.y, v.z))
}

impl Localization {
    /// Reads all sensors, and sends both estimates. Returns whether the position stands still for want of encoders; then
    /// nothing is sent, so that readers see its age.
    fn estimate(&mut self, ports: &Ports, params: &LocalizationParams, cx: &mut Cycle<'_>) -> bool {
        let now = cx.now();
        let mut newest = None;
        while let Some(imu) = cx.read(&ports.imu) {
            match self.feel(&imu, params, cx) {
                Ok(()) => {
                    newest = newest.max(Some(imu.acq_time_on_arrival()));
                    self.counted.get_or_insert(now);
                }
                Err(error) => cx.fault(format!("imu: {error}; reading skipped")),
            }
        }
        while let Some(speed) = cx.read(&ports.ground_speed) {
            if speed.speed_mps.is_finite() && speed.speed_mps.abs() < FASTEST_MPS {
                self.ground_speed = Some((speed.speed_mps, speed.acq_time_on_arrival()));
            } else {
                cx.fault(format!("ground speed is {} m/s; reading skipped", speed.speed_mps));
            }
        }
        if let Some(report) = cx.read_newest(&ports.slip)
            && let Err(error) = self.take_slip(&report)
        {
            cx.fault(format!("slip: {error}; report skipped"));
        }
        while let Some(motion) = cx.read(&ports.visual_motion) {
            if let Err(error) = self.take_visual(&motion) {
                cx.fault(format!("visual motion: {error}; skipped"));
            }
        }
        while let Some(encoders) = cx.read(&ports.encoders) {
            match self.roll(&encoders, params) {
                Ok(slipped) => {
                    let time = encoders.acq_time_on_arrival();
                    newest = newest.max(Some(time));
                    self.counted = Some(now);
                    if let Some(slipped) = slipped {
                        cx.write(&ports.way_slip, time, way_slip(&slipped, time));
                    }
                }
                Err(error) => cx.fault(format!("encoders: {error}; reading skipped")),
            }
        }
        while let Some(fix) = cx.read(&ports.gps) {
            if let Err(error) = self.fix(&fix, params, now) {
                cx.fault(format!("{error}; fix skipped"));
            }
        }
        // Every way is counted at a reading of the encoders, also that of a radar.
        let is_frozen = self.counted.is_some_and(|at| now.seconds_since(at) > params.input_timeout_s);
        if let Some(time) = newest.filter(|_| !is_frozen) {
            self.publish(time, ports, params, cx);
        }
        is_frozen
    }

    fn feel(
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
        if self.repeats[0].take(imu.timestamp.as_ref().and_then(Stamp::from_proto)) {
            return Err(REPEATED.to_owned());
        }
        let time = imu.acq_time_on_arrival();
        let slips = self.slipping_mps(time).is_some();
        let has_compass = params.compass_time_s > 0.0;
        let is_asked = has_compass || self.felt.is_none() || self.awaits_compass;
        let compass_rad = if is_asked { self.compass_rad(imu, cx) } else { None };
        // Estimates that began without inertial sensors, or without their heading, begin again, unless the vehicle has moved
        // since.
        let begins = self.felt.is_none() || (self.awaits_compass && compass_rad.is_some());
        let is_first = begins && self.wheels.is_none_or(|wheels| !wheels.has_moved());
        let Some(attitude) = self.attitude.as_mut().filter(|_| !is_first) else {
            let (yaw_rad, variance) = start_heading(imu, compass_rad, params);
            let before = self.attitude.take().filter(|_| self.awaits_compass);
            self.begin(force, yaw_rad, variance);
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

    fn begin(&mut self, force_mps2: DVec3, yaw_rad: f64, yaw_variance: f64) {
        self.attitude = Some(Attitude::at_rest(force_mps2, yaw_rad));
        // In its own frame the starting position is known exactly.
        self.local = Some(Planar::new(DVec2::ZERO, yaw_rad, 0.0, 0.0));
        self.global = GlobalEstimate::new(yaw_rad, yaw_variance);
    }

    /// Notes whether the wheels slip, and how fast the vehicle moves then.
    fn take_slip(&mut self, report: &Msg<SlipReport>) -> Result<(), String> {
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

    fn take_visual(&mut self, motion: &Msg<VisualMotion>) -> Result<(), String> {
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
    fn roll(
        &mut self,
        encoders: &Msg<WheelEncoders>,
        params: &LocalizationParams,
    ) -> Result<Option<Slipped>, String> {
        let distance_m = [encoders.left_m, encoders.right_m];
        if self.repeats[1].take(encoders.timestamp.as_ref().and_then(Stamp::from_proto)) {
            return Err(REPEATED.to_owned());
        }
        let time = encoders.acq_time_on_arrival();
        let Some(wheels) = &mut self.wheels else {
            if !distance_m.iter().all(|distance| distance.is_finite()) {
                return Err(format!("distances are {distance_m:?} m, expected finite ones"));
            }
            self.wheels = Some(Wheels::new(SensorTime::of(encoders), distance_m));
            return Ok(None);
        };
        let Rolled { rolled_m: wheels_m, elapsed_s } = wheels.roll(SensorTime::of(encoders), distance_m)?;
        let has_gyro = self.felt.is_some_and(|felt| time.seconds_since(felt) < params.input_timeout_s);
        if self.attitude.is_none() {
            if time.seconds_since(wheels.since) < params.input_timeout_s {
                // Inertial sensors may be about to report the heading.
                return Ok(None);
            }
            // A vehicle without inertial sensors is assumed level, and turns as its wheels report.
            let deviation = params.start_heading_noise_deg.to_radians();
            self.begin(DVec3::Z, params.start_heading_deg.to_radians(), deviation * deviation);
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

    fn fix(&mut self, fix: &Msg<LocationFix>, params: &LocalizationParams, now: Stamp) -> Result<(), String> {
        let Some(attitude) = &self.attitude else { return Ok(()) };
        if fix.is_without_position() {
            return Err("the receiver has no position fix".to_owned());
        }
        // A fix is compared with where the vehicle is now.
        let time = fix.acq_time_on_arrival();
        let age_s = now.seconds_since(time);
        if age_s > params.gps_dropout_s {
            let limit_s = params.gps_dropout_s;
            return Err(format!("position fix is {age_s:.1} s old, expected at most {limit_s} s"));
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

    fn publish(&mut self, time: Stamp, ports: &Ports, params: &LocalizationParams, cx: &mut Cycle<'_>) {
        let (Some(attitude), Some(local)) = (&self.attitude, &self.local) else { return };
        let velocity = Some(Vector3 { x: self.speed_mps, y: 0.0, z: 0.0 });
        let w = attitude.turn_radps;
        let turning = Some(Vector3 { x: w.x, y: w.y, z: w.z });
        let odometry = |frame: &str, body: &str, pose: &Pose, covariance: Vec<f64>| Odometry {
            timestamp: Some(time.to_proto()),
            frame_id: frame.to_owned(),
            body_frame_id: body.to_owned(),
            pose: Some(pose_message(pose)),
            linear_velocity: velocity,
            angular_velocity: turning,
            pose_covariance: covariance,
            ..Odometry::default()
        };
        let local_from_vehicle = Pose::new(attitude.level_from_vehicle, local.at.extend(self.height_m));
        let height_variance = local.covariance.x_axis.x;
        let message = odometry(
            &params.local_frame,
            &params.vehicle_frame,
            &local_from_vehicle,
            covariance_of(local, height_variance),
        );
        cx.write(&ports.local, time, message);
        let due = self.sent_global.is_none_or(|sent| time >= sent.after_ns(GLOBAL_PERIOD_NS));
        let (Some(global), true) = (self.global.planar(), due) else { return };
        self.sent_global = Some(time);
        // Both estimates share roll and pitch, so the transform between their frames rotates about the vertical only.
        let turn = wrap_angle(global.yaw_rad - attitude.yaw_rad());
        let [lift_m, lift_variance] = self.global.lift();
        let rotation = DQuat::from_rotation_z(turn);
        let height_m = self.height_m + lift_m;
        let shift = global.at.extend(height_m) - rotation * local_from_vehicle.translation;
        let global_from_local = Pose::new(rotation, shift);
        let message = odometry(
            &params.global_frame,
            GLOBAL_BODY,
            &(global_from_local * local_from_vehicle),
            covariance_of(global, lift_variance),
        );
        cx.write(&ports.global, time, message);
        let q = global_from_local.rotation;
        let transform = FrameTransform {
            timestamp: Some(time.to_proto()),
            parent_frame_id: params.global_frame.clone(),
            child_frame_id: params.local_frame.clone(),
            translation: Some(Vector3 { x: shift.x, y: shift.y, z: shift.z }),
            rotation: Some(Quaternion { x: q.x, y: q.y, z: q.z, w: q.w }),
        };
        cx.write(&ports.transforms, time, FrameTransforms { transforms: vec![transform] });
    }
}

fn way_slip(slipped: &Slipped, time: Stamp) -> rcs::WaySlip {
    rcs::WaySlip {
        timestamp: Some(time.to_proto()),
        since: Some(slipped.since.to_proto()),
        rolled_m: slipped.rolled_m,
        moved_m: slipped.moved_m,
        slip: slipped.slip(),
        middle: Some(pose_message(&slipped.middle)),
    }
}

/// Row-major 6×6 covariance of x, y, z, roll, pitch, yaw: m² and rad².
fn covariance_of(planar: &Planar, height_variance: f64) -> Vec<f64> {
    let mut covariance = vec![0.0; 36];
    let places = [0, 1, 5];
    for (row, &to_row) in places.iter().enumerate() {
        for (column, &to_column) in places.iter().enumerate() {
            covariance[6 * to_row + to_column] = planar.covariance.col(column)[row];
        }
    }
    covariance[14] = height_variance;
    covariance[21] = TILT_VARIANCE;
    covariance[28] = TILT_VARIANCE;
    covariance
}
