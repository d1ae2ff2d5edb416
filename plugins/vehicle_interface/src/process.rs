//! The process `vehicle_interface`: reads commands and sensors, and sends wheel speeds. Its port table is in the
//! crate's documentation.

mod sensors;

use self::sensors::{SENSED_S, Sensed};
use crate::control::{Aim, Drive, Ramps, Slip, Wheels};
use crate::gate::{DriveRequest, Gate, LastRequest, Limits, Turn};
use crate::proto::{SteeringKind, VehicleInterfaceParams};
use rcs_geom::wrap_angle;
use rcs_msg::Stamp;
use rcs_msg::foxglove::Odometry;
use rcs_msg::rcs::{
    Bumper, DriveCommand, EmergencyStop, Imu, MotorCurrents, ProcessState, SpeedLimit, Status, VehicleStatus,
    WheelCommand, WheelEncoders,
};
use rcs_runtime::{Cycle, In, InputRole, Msg, Out, PortBuilder, Process, ProcessDef, Role};
use rcs_sense::{ClockWatch, stop_reason};
use serde::{Deserialize, Serialize};

/// A vehicle slower than this stands, m/s.
const STANDS_MPS: f64 = 0.05;

rcs_runtime::commands! {
    /// Commands of [`VehicleInterface`].
    pub enum VehicleInterfaceCommand {
        LimitSpeed(SpeedLimit) = "LIMIT_SPEED": "Drive no faster than this, whoever drives, until RUN or another limit.",
    }
}

/// State: the last command of each input, the emergency stop, the ramps, and the last sensor readings.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct VehicleInterface {
    drive: Gate,
    teleop: Gate,
    /// Reason and time of the active emergency stop.
    emergency: Option<(String, Stamp)>,
    ramps: Ramps,
    slip: Slip,
    /// `None` before the first cycle after `INIT`.
    last_cycle: Option<Stamp>,
    /// When it last sent a command to the vehicle, also before `INIT`.
    commanded: Option<Stamp>,
    /// Yaw of the local estimate, and its time.
    yaw: Option<(f64, Stamp)>,
    /// The clock of the local estimate.
    local_clock: ClockWatch,
    sensed: Sensed,
    refused: u64,
    last_refusal: String,
}

/// Ports of [`VehicleInterface`].
#[derive(Debug)]
pub struct Ports {
    drive: In<DriveCommand>,
    teleop: In<DriveCommand>,
    emergency_stop: In<EmergencyStop>,
    above: In<Status>,
    local: In<Odometry>,
    imu: In<Imu>,
    encoders: In<WheelEncoders>,
    motors: In<MotorCurrents>,
    bumper: In<Bumper>,
    wheels: Out<WheelCommand>,
    vehicle: Out<VehicleStatus>,
}

/// The action of this cycle, and its reason.
struct Decision {
    aim: Aim,
    wanted_speed_mps: f64,
    /// Why the vehicle is being stopped; empty where it is not.
    stop_reason: String,
    /// The limit of `LIMIT_SPEED`, m/s; infinite without one.
    limit_mps: f64,
    /// Whether it obeys the operator's drive command.
    teleoperated: bool,
}

impl Decision {
    /// Stops the vehicle at once.
    fn halt(reason: &str) -> Decision {
        let stop_reason = format!("emergency stop: {reason}");
        Decision { aim: Aim::Halt, stop_reason, ..Decision::stop("") }
    }

    fn stop(reason: impl Into<String>) -> Decision {
        let (stop_reason, limit_mps) = (reason.into(), f64::INFINITY);
        Decision { aim: Aim::Stop, wanted_speed_mps: 0.0, stop_reason, limit_mps, teleoperated: false }
    }

    /// The same with a limit of the speed, m/s; one of 0 holds the vehicle.
    fn limited_to(mut self, limit_mps: f64) -> Decision {
        (self.aim, self.limit_mps) = (self.aim.limited_to(limit_mps), limit_mps);
        if limit_mps == 0.0 && ["", stop_reason::BUMPER].contains(&self.stop_reason.as_str()) {
            "the speed limit is 0 m/s".clone_into(&mut self.stop_reason);
        }
        self
    }
}

impl Process for VehicleInterface {
    type Params = VehicleInterfaceParams;
    type Ports = Ports;
    type Command = VehicleInterfaceCommand;
    const DEF: ProcessDef = ProcessDef {
        plugin: "vehicle_interface",
        summary: "Vehicle interface: turns heading and speed into wheel speeds, and stops the vehicle when in doubt",
        period_ms: 20.0,
        latency_ms: 0.0,
        reads_ground_truth: false,
    };

    fn ports(b: &mut PortBuilder) -> Ports {
        Ports {
            drive: b.optional_input("drive", "heading (local frame) and speed from the driver"),
            teleop: b.operator_input(
                InputRole::Teleoperation,
                "teleop",
                "the same from the operator, with priority while it is recent",
            ),
            emergency_stop: b.operator_input(
                InputRole::EmergencyStop,
                "emergency_stop",
                "stops the vehicle until a message releases it",
            ),
            above: b.optional_input("above", "status of the driver; it is not obeyed while in ERROR"),
            local: b.optional_input("local", "pose of the vehicle in the local frame; headings need it"),
            imu: b.optional_input(
                "imu",
                "turn rate, and attitude where `local` has none; its axes are the vehicle's",
            ),
            encoders: b.optional_input("encoders", "speeds of the wheels, m/s"),
            motors: b.optional_input("motors", "currents of the drive motors, A"),
            bumper: b.optional_input("bumper", "switches of the bumper"),
            wheels: b
                .output("wheels", "speeds of the wheels, m/s, and curvature, 1/m")
                .role(Role::Command)
                .build(),
            vehicle: b.output("vehicle", "state of the vehicle").role(Role::Stats).build(),
        }
    }

    fn new(_params: &VehicleInterfaceParams) -> Self {
        Self::default()
    }

    /// The ramps are kept, so that a vehicle that drives brakes, and keeps its steering angle meanwhile.
    fn renew(&self, _params: &VehicleInterfaceParams) -> Self {
        Self {
            emergency: self.emergency.clone(),
            ramps: self.ramps,
            commanded: self.commanded,
            ..Self::default()
        }
    }

    fn cycle(&mut self, ports: &Ports, params: &VehicleInterfaceParams, cx: &mut Cycle<'_>) {
        let limit =
            cx.command::<Self>().map(|VehicleInterfaceCommand::LimitSpeed(limit)| limit.max_speed_mps);
        let decision = |vehicle_interface: &Self, cx: &Cycle<'_>| {
            let decision = vehicle_interface.decide(ports, params, cx);
            match limit {
                Some(limit_mps) => decision.limited_to(limit_mps),
                None => decision,
            }
        };
        self.step(ports, params, cx, decision);
    }

    fn init(&mut self, ports: &Ports, params: &VehicleInterfaceParams, cx: &mut Cycle<'_>) {
        self.hold("initialized, waits for RUN", ports, params, cx);
    }

    fn halt(&mut self, ports: &Ports, params: &VehicleInterfaceParams, cx: &mut Cycle<'_>) {
        self.hold("halted", ports, params, cx);
    }
}

impl VehicleInterface {
    /// Brakes; done when the vehicle stands. Earlier requests are not resumed after `RUN`.
    fn hold(
        &mut self,
        reason: &'static str,
        ports: &Ports,
        params: &VehicleInterfaceParams,
        cx: &mut Cycle<'_>,
    ) {
        let wheels =
            self.step(ports, params, cx, |vehicle_interface, _| match &vehicle_interface.emergency {
                Some((reason, _)) => Decision::halt(reason),
                None => Decision::stop(reason),
            });
        self.drive.forget();
        self.teleop.forget();
        let is_told_to_stand = wheels.left_mps == 0.0 && wheels.right_mps == 0.0;
        // A speed that is not known does not keep it braking.
        let rolls = self.speed_mps(ports, params, cx).abs() >= STANDS_MPS;
        if is_told_to_stand && !rolls {
            cx.done(reason);
        } else {
            cx.exec(format!("{reason}, brakes"));
        }
    }

    /// Reads all inputs, decides, and sends the command to the vehicle.
    fn step(
        &mut self,
        ports: &Ports,
        params: &VehicleInterfaceParams,
        cx: &mut Cycle<'_>,
        decide: impl FnOnce(&Self, &Cycle<'_>) -> Decision,
    ) -> Wheels {
        if self.last_cycle.is_none() {
            self.sensed.since = Some(cx.now());
            self.remember(ports, cx);
            // A vehicle that got no commands meanwhile, as after a panic of this process, does not drive any more.
            let is_recent = |at: Stamp| cx.now().seconds_since(at) <= SENSED_S;
            self.ramps = if self.commanded.is_some_and(is_recent) { self.ramps } else { Ramps::default() };
        }
        self.sense(ports, cx);
        let limits = Limits {
            speed_mps: params.max_speed_mps,
            yaw_rate_radps: params.max_yaw_rate_radps,
            timeout_s: params.command_timeout_s,
        };
        while let Some(command) = cx.read(&ports.drive) {
            let result = take(&mut self.drive, &command, cx.now(), &limits);
            self.report("drive", result, cx);
        }
        while let Some(command) = cx.read(&ports.teleop) {
            let result = take(&mut self.teleop, &command, cx.now(), &limits);
            self.report("teleop", result, cx);
        }
        while let Some(message) = cx.read(&ports.emergency_stop) {
            self.take_emergency(&message, cx.now());
        }
        let decision = decide(self, cx);
        let dt_s = self.last_cycle.map_or(0.0, |last| cx.now().seconds_since(last).clamp(0.0, 0.1));
        (self.last_cycle, self.commanded) = (Some(cx.now()), Some(cx.now()));
        let drive = drive(params);
        match drive.track_m.zip(self.sensed.turn(cx.now())) {
            Some((track_m, (wheels_mps, rate_radps))) => {
                self.slip.take(wheels_mps, rate_radps, track_m, dt_s);
            }
            None => self.slip = Slip::default(),
        }
        let wheels = self.ramps.step(decision.aim, &drive, &self.slip, dt_s);
        self.send(ports, params, &decision, wheels, cx);
        wheels
    }

    fn report(&mut self, input: &str, result: Result<(), String>, cx: &mut Cycle<'_>) {
        if let Err(refusal) = result {
            self.refused += 1;
            self.last_refusal = format!("{input}: {refusal}");
            cx.fault(format!("{input}: {refusal}; refused, the vehicle is held"));
        }
    }

    /// A stop takes effect at once, whatever its time; a release counts only if it is not older than any stop. A stop from
    /// the future was given when it came.
    fn take_emergency(&mut self, message: &Msg<EmergencyStop>, now: Stamp) {
        let given = message.timestamp.as_ref().and_then(Stamp::from_proto).unwrap_or(message.acq_time());
        if message.active {
            let reason = if message.reason.is_empty() { "no reason given" } else { &message.reason };
            let given = given.min(now);
            let newest = self.emergency.as_ref().map_or(given, |&(_, before)| before.max(given));
            self.emergency = Some((reason.to_owned(), newest));
        } else if self.emergency.as_ref().is_some_and(|&(_, stopped)| given >= stopped) {
            self.emergency = None;
            // Earlier requests are not resumed automatically.
            self.drive.forget();
            self.teleop.forget();
        }
    }

    /// Priority: emergency stop, then operator, then driver.
    fn decide(&self, ports: &Ports, params: &VehicleInterfaceParams, cx: &Cycle<'_>) -> Decision {
        if let Some((reason, _)) = &self.emergency {
            return Decision::halt(reason);
        }
        let now = cx.now();
        match self.teleop.last_request(now, params.command_timeout_s) {
            LastRequest::Drive(request) => {
                return Decision { teleoperated: true, ..self.obey(request, params, now) };
            }
            LastRequest::Refused => return Decision::stop("the operator's last command was refused"),
            LastRequest::Nothing => {}
        }
        if let Some(above) = cx.latest(&ports.above).filter(|above| above.state() == ProcessState::Error) {
            return Decision::stop(format!("{} is in ERROR: {}", above.process, above.state_text));
        }
        if let Some(silent) = self.sensed.silent(params.sensor_timeout_s, now) {
            return Decision::stop(silent);
        }
        match self.drive.last_request(now, params.command_timeout_s) {
            LastRequest::Drive(request) => self.obey(request, params, now),
            LastRequest::Refused => Decision::stop(stop_reason::REFUSED),
            LastRequest::Nothing => Decision::stop(stop_reason::NO_COMMAND),
        }
    }

    fn obey(&self, request: DriveRequest, params: &VehicleInterfaceParams, now: Stamp) -> Decision {
        let is_held = params.bumper_holds && (self.sensed.bumper_left || self.sensed.bumper_right);
        let speed_mps = if is_held { request.speed_mps.min(0.0) } else { request.speed_mps };
        let is_on_the_spot =
            request.speed_mps == 0.0 && matches!(request.turn, Turn::Rate(rate_radps) if rate_radps != 0.0);
        let stop_reason = if is_held && request.speed_mps > 0.0 {
            stop_reason::BUMPER
        } else if is_on_the_spot && params.steering() == SteeringKind::SteeringAckermann {
            stop_reason::ON_THE_SPOT
        } else {
            ""
        };
        let aim = match request.turn {
            Turn::Rate(yaw_rate_radps) => Aim::Rate { speed_mps, yaw_rate_radps },
            Turn::Heading(heading_rad) => match self.yaw {
                Some((yaw_rad, at)) if now.seconds_since(at) <= params.pose_timeout_s => {
                    Aim::Heading { speed_mps, error_rad: wrap_angle(heading_rad - yaw_rad) }
                }
                Some(_) => return Decision::stop("local position is too old to steer for a heading"),
                None => return Decision::stop("local position is not known: no heading can be steered for"),
            },
        };
        let (wanted_speed_mps, limit_mps) = (request.speed_mps, f64::INFINITY);
        let stop_reason = stop_reason.to_owned();
        Decision { aim, wanted_speed_mps, stop_reason, limit_mps, teleoperated: false }
    }

    fn send(
        &self,
        ports: &Ports,
        params: &VehicleInterfaceParams,
        decision: &Decision,
        wheels: Wheels,
        cx: &mut Cycle<'_>,
    ) {
        let now = cx.now();
        let command = WheelCommand {
            timestamp: Some(now.to_proto()),
            left_mps: wheels.left_mps,
            right_mps: wheels.right_mps,
            curvature_per_m: wheels.curvature_per_m,
        };
        cx.write(&ports.wheels, now, command);
        let sensed = &self.sensed;
        let [roll_rad, pitch_rad] = self.attitude_rad(ports, params, cx);
        let status = VehicleStatus {
            timestamp: Some(now.to_proto()),
            speed_mps: self.speed_mps(ports, params, cx),
            yaw_rate_radps: self.yaw_rate_radps(ports, params, cx),
            roll_rad,
            pitch_rad,
            wanted_speed_mps: decision.wanted_speed_mps,
            left_command_mps: wheels.left_mps,
            right_command_mps: wheels.right_mps,
            stopped: !decision.stop_reason.is_empty(),
            stop_reason: decision.stop_reason.clone(),
            emergency_stopped: self.emergency.is_some(),
            refused: self.refused,
            last_refusal: self.last_refusal.clone(),
            left_a: sensed.left_a,
            right_a: sensed.right_a,
            bumper_left: sensed.bumper_left,
            bumper_right: sensed.bumper_right,
            max_speed_mps: params.max_speed_mps.min(decision.limit_mps),
            max_yaw_rate_radps: params.max_yaw_rate_radps,
            teleoperated: decision.teleoperated,
        };
        cx.write(&ports.vehicle, now, status);
        if decision.stop_reason.is_empty() {
            cx.exec("obeys");
        } else {
            cx.exec(format!("held: {}", decision.stop_reason));
        }
    }
}

fn take(gate: &mut Gate, command: &Msg<DriveCommand>, now: Stamp, limits: &Limits) -> Result<(), String> {
    let turn = command.yaw_rate_radps.map_or(Turn::Heading(command.heading_rad), Turn::Rate);
    let request = DriveRequest { speed_mps: command.speed_mps, turn };
    // A command without a timestamp has the time of its arrival.
    let given = command.timestamp.as_ref().and_then(Stamp::from_proto).unwrap_or(command.acq_time());
    gate.take(request, given, now, limits).map_err(|refusal| refusal.to_string())
}

fn drive(params: &VehicleInterfaceParams) -> Drive {
    let is_differential = params.steering() == SteeringKind::SteeringDifferential;
    Drive {
        track_m: is_differential.then_some(params.track_m),
        max_curvature_per_m: params.max_curvature_per_m,
        max_speed_mps: params.max_speed_mps,
        max_wheel_speed_mps: params.max_wheel_speed_mps.max(params.max_speed_mps),
        max_acceleration_mps2: params.max_acceleration_mps2,
        max_deceleration_mps2: params.max_deceleration_mps2,
        stop_deceleration_mps2: params.stop_deceleration_mps2,
        max_yaw_rate_radps: params.max_yaw_rate_radps,
        max_yaw_acceleration_radps2: params.max_yaw_acceleration_radps2,
        max_turn_correction_radps: params.max_turn_correction_radps,
        heading_gain_per_s: params.heading_gain_per_s,
        heading_dead_band_rad: params.heading_dead_band_rad,
        turn_in_place_rad: params.turn_in_place_rad,
    }
}
