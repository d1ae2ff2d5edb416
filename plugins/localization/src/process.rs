//! The process `localization`: reads the sensors, and sends the local and the global estimate. Its port table is in
//! the crate's documentation.

mod clocks;
mod inputs;
mod output;

use self::clocks::SensorClock;
use self::output::way_slip;
use crate::attitude::Attitude;
use crate::fixes::GlobalEstimate;
use crate::grip::Grip;
use crate::planar::Planar;
use crate::proto::LocalizationParams;
use crate::way_slip::WaySlip;
use crate::wheels::{FASTEST_MPS, Wheels};
use rcs_msg::Stamp;
use rcs_msg::foxglove::{FrameTransforms, LocationFix, Odometry};
use rcs_msg::rcs::{self, GroundSpeed, Imu, SlipReport, VisualMotion, WheelEncoders};
use rcs_runtime::{Cycle, In, NoCommands, Out, PortBuilder, Process, ProcessDef, Role};
use rcs_sense::{Origin, Repeats};
use serde::{Deserialize, Serialize};

/// State: attitude, both estimates, and the last readings of the sensors.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Localization {
    attitude: Option<Attitude>,
    /// Position, heading and height of the local estimate.
    local: Option<Planar>,
    height_m: f64,
    global: GlobalEstimate,
    /// Whether the estimates are those of before `INIT`: another heading turns them where they are.
    goes_on: bool,
    /// Until when they followed the vehicle before `INIT`; `None` once they go on.
    followed_until: Option<Stamp>,
    /// Heading of the parameters when the estimates began, degrees.
    start_heading_deg: f64,
    /// Origin of the global frame: of the world file, or the first of the fixes with which the global estimate began.
    origin: Option<Origin>,
    /// Place of a fix that waits for a second one.
    waiting_origin: Option<Origin>,
    /// Of inertial sensor and encoders: one that repeats its last message measures nothing.
    repeats: [Repeats; 2],
    /// Of inertial sensor and encoders.
    clocks: [SensorClock; 2],
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

    /// The estimates go on where they were, because other processes know places in both frames: of a local frame that began
    /// anew, nobody would know where it lies in the global one until two fixes have agreed. With another world file or another
    /// heading at the start they begin anew, and so they do where they have numbers that cannot be: after a panic, these may
    /// be its cause.
    fn renew(&self, params: &LocalizationParams) -> Self {
        let new = Self::new(params);
        let is_same_frame = new.origin.is_none() || new.origin == self.origin;
        let is_same_start = self.start_heading_deg == params.start_heading_deg;
        if !(is_same_frame && is_same_start && self.is_sound()) {
            return new;
        }
        Self {
            goes_on: true,
            followed_until: self.wheels.map(|wheels| wheels.time).or(self.followed_until).or(self.felt),
            start_heading_deg: self.start_heading_deg,
            attitude: self.attitude,
            local: self.local,
            height_m: self.height_m,
            global: self.global.clone(),
            origin: self.origin,
            speed_mps: self.speed_mps,
            gain: self.gain,
            felt: self.felt,
            ..new
        }
    }

    /// The vehicle may still roll out: the estimates follow it, and are sent from `RUN` on.
    fn init(&mut self, ports: &Ports, params: &LocalizationParams, cx: &mut Cycle<'_>) {
        self.read_sensors(ports, params, cx);
        cx.done("initialized");
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
            (_, _, true) if self.global.planar().is_none() => {
                "warning: no good position fix yet, the global position is unknown"
            }
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

impl Localization {
    /// Whether the estimates have begun, and are numbers that can be.
    fn is_sound(&self) -> bool {
        let is_placed = self.local.is_some_and(|local| local.is_sound()) && self.height_m.is_finite();
        is_placed && self.global.is_sound() && self.attitude.is_some_and(|attitude| attitude.is_finite())
    }

    /// Reads all sensors, and sends both estimates. Returns whether the position stands still for want of encoders; then
    /// nothing is sent, so that readers see its age.
    fn estimate(&mut self, ports: &Ports, params: &LocalizationParams, cx: &mut Cycle<'_>) -> bool {
        let newest = self.read_sensors(ports, params, cx);
        // Every way is counted at a reading of the encoders, also that of a radar.
        let is_frozen = self.counted.is_some_and(|at| cx.now().seconds_since(at) > params.input_timeout_s);
        if let Some(time) = newest.filter(|_| !is_frozen) {
            self.publish(time, ports, params, cx);
        }
        is_frozen
    }

    /// Reads all sensors. Returns the time of the newest reading of inertial sensor and encoders.
    fn read_sensors(
        &mut self,
        ports: &Ports,
        params: &LocalizationParams,
        cx: &mut Cycle<'_>,
    ) -> Option<Stamp> {
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
            match self.roll(&encoders, params, cx) {
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
        newest
    }
}
