//! The process `proximity`: reads bumper, infrared sensors and wheels, and sends cost maps and slip. Its port table
//! is in the crate's documentation.

use crate::near::{Body, Ray, RayRules, bumper_costs, infrared_costs, slippery_costs};
use crate::proto::ProximityParams;
use crate::traction::{Inertial, Rules, State, Traction};
use rcs_geom::Pose;
use rcs_msg::foxglove::Grid;
use rcs_msg::rcs::{
    Bumper, Imu, MotorCurrents, RangeReading, RangeReadings, SlipReport, TractionState, WaySlip,
    WheelEncoders,
};
use rcs_msg::{Payload, Stamp};
use rcs_runtime::{Cycle, In, Msg, NoCommands, Out, PortBuilder, Process, ProcessDef, Role};
use rcs_sense::{
    Axes, Extrinsics, FASTEST_RADPS, FASTEST_WHEEL_MPS, HARDEST_MPS2, LastSlip, Localizer, PosePorts,
    SensorTime, is_slippery, pose_of, text_above,
};
use rcs_world::Source;
use serde::{Deserialize, Serialize};

/// Period of slip reports, ns.
const REPORT_NS: u64 = 100_000_000;
/// Readings of encoders and motors count for this time, s.
const COUNTS_S: f64 = 0.5;

/// State: the poses of the last seconds, the last bumper reading, and the traction estimate.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Proximity {
    localizer: Localizer,
    traction: Traction,
    /// Switches of the last bumper map, and its time, at most that of its arrival.
    bumper: Option<([bool; 2], Stamp)>,
    /// When encoders and motors were read last. No slip report is sent before the first encoder reading.
    encoders_at: Option<Stamp>,
    motors_at: Option<Stamp>,
    reported: Option<Stamp>,
    last_slip: LastSlip,
}

/// Ports of [`Proximity`].
#[derive(Debug)]
pub struct Ports {
    bumper: In<Bumper>,
    infrared: In<RangeReadings>,
    motors: In<MotorCurrents>,
    encoders: In<WheelEncoders>,
    imu: In<Imu>,
    way_slip: In<WaySlip>,
    poses: PosePorts,
    bumper_cost: Out<Grid>,
    infrared_cost: Out<Grid>,
    slip_cost: Out<Grid>,
    slip: Out<SlipReport>,
}

impl Process for Proximity {
    type Params = ProximityParams;
    type Ports = Ports;
    type Command = NoCommands;
    const DEF: ProcessDef = ProcessDef {
        plugin: "proximity",
        summary: "Maps the cost of bumper hits and infrared ranges; detects wheel slip and stalled motors",
        period_ms: 50.0,
        latency_ms: 0.0,
        reads_ground_truth: false,
    };

    fn ports(b: &mut PortBuilder) -> Ports {
        Ports {
            bumper: b.optional_input("bumper", "switches of the bumper"),
            infrared: b
                .optional_input("infrared", "readings of range sensors that look along x of their frames, m"),
            motors: b.optional_input("motors", "currents of the drive motors, A"),
            encoders: b.optional_input("encoders", "speeds of the wheels, m/s"),
            imu: b.optional_input("imu", "accelerations and turn rates; its axes are the vehicle's"),
            way_slip: b.optional_input("way_slip", "slip over the last metres"),
            poses: PosePorts::declare(b),
            bumper_cost: b
                .output(
                    "bumper_cost",
                    "field cost.bumper: 250 where the bumper hit, 0 under the vehicle unless its wheels slip, local frame",
                )
                .role(Role::Cost)
                .palette("cost")
                .build(),
            infrared_cost: b
                .output("infrared_cost", "field cost.infrared: cones of the infrared sensors, local frame")
                .role(Role::Cost)
                .palette("cost")
                .build(),
            slip_cost: b
                .output(
                    "slip_cost",
                    "field cost.slip: 100 where the wheels slipped over some metres, local frame",
                )
                .role(Role::Cost)
                .palette("cost")
                .build(),
            slip: b
                .output("slip", "slip of the wheels, 0 to 1, and load of the motors")
                .role(Role::Stats)
                .build(),
        }
    }

    fn new(_params: &ProximityParams) -> Self {
        Self::default()
    }

    fn cycle(&mut self, ports: &Ports, params: &ProximityParams, cx: &mut Cycle<'_>) {
        ports.poses.read(&mut self.localizer, extrinsics(params).frames, cx);
        while let Some(bumper) = cx.read(&ports.bumper) {
            self.take_bumper(&bumper, ports, params, cx);
        }
        while let Some(readings) = cx.read(&ports.infrared) {
            self.take_infrared(&readings, ports, params, cx);
        }
        while let Some(report) = cx.read(&ports.way_slip) {
            self.last_slip.take(&report, cx.now());
            take_way_slip(&report, ports, params, cx);
        }
        self.take_wheels(ports, cx);
        let rules = rules(params);
        while let Some(imu) = cx.read(&ports.imu) {
            self.take_imu(&imu, params, &rules, cx);
        }
        if let Some(encoders_at) = self.encoders_at {
            let is_old = |at: Stamp| cx.now().seconds_since(at) > COUNTS_S;
            let without_wheels = is_old(encoders_at);
            if without_wheels {
                // Without wheels there is nothing to compare.
                self.traction.lose_inertial();
            }
            if without_wheels || self.motors_at.is_none_or(is_old) {
                self.traction.motors_a = [0.0; 2];
            }
            self.traction.look(cx.now(), params.inertial_timeout_s, &rules);
            self.report(ports, &rules, cx);
        }
        let felt = match self.traction.state {
            State::Unknown => "senses",
            State::Grips => "senses; the wheels grip",
            State::Spins => "senses; the wheels spin",
            State::Stalled => "senses; a motor is stalled",
        };
        match silent(ports, params.sensor_timeout_s, cx) {
            Some(silent) => cx.exec(format!("warning: {silent}; {felt}")),
            None => cx.exec(felt),
        }
    }
}

impl Proximity {
    /// Pose of the vehicle at a time. An unknown pose is not a fault here: there is none before the first message.
    fn vehicle_at(&self, time: SensorTime, params: &ProximityParams) -> Option<Pose> {
        extrinsics(params).local_from_vehicle(&self.localizer, time).ok()
    }

    fn take_bumper(
        &mut self,
        bumper: &Msg<Bumper>,
        ports: &Ports,
        params: &ProximityParams,
        cx: &mut Cycle<'_>,
    ) {
        let time = bumper.acq_time();
        let switches = [bumper.left, bumper.right];
        // A time from the future would end the maps until the clock is there.
        let taken_at = bumper.acq_time_on_arrival();
        let is_due = self.bumper.is_none_or(|(last, at)| {
            let since_s = taken_at.seconds_since(at);
            last != switches || since_s < 0.0 || since_s >= params.bumper_period_s - 1e-6
        });
        if !is_due {
            return;
        }
        let Some(pose) = self.vehicle_at(SensorTime::of(bumper), params) else {
            if bumper.left || bumper.right {
                cx.fault("bumper: hit where the vehicle's pose is not known; skipped");
            }
            return;
        };
        self.bumper = Some((switches, taken_at));
        // Where the wheels slip, the vehicle is not where odometry says, and what is under it says nothing.
        let slips =
            matches!(self.traction.state, State::Spins | State::Stalled) || self.last_slip.is_on(cx.now());
        let costs = bumper_costs(&pose, &body(params), bumper.left, bumper.right, !slips);
        let grid = costs.into_message(Source::BUMPER, extrinsics(params).frames.local, time);
        cx.write(&ports.bumper_cost, time, grid);
    }

    fn take_infrared(
        &mut self,
        readings: &Msg<RangeReadings>,
        ports: &Ports,
        params: &ProximityParams,
        cx: &mut Cycle<'_>,
    ) {
        let (time, taken) = (readings.acq_time(), SensorTime::of(readings));
        let Some(pose) = self.vehicle_at(taken, params) else { return };
        let mut rays = Vec::with_capacity(readings.readings.len());
        for reading in &readings.readings {
            match self.ray(&pose, reading, taken, params) {
                Ok(ray) => rays.push(ray),
                Err(fault) => cx.fault(format!("infrared: {fault}; reading skipped")),
            }
        }
        if rays.is_empty() {
            return;
        }
        let rules = RayRules {
            cost: params.infrared_max_cost as u8,
            free_fraction: params.infrared_free_fraction,
            noise_m: params.range_noise_m,
        };
        let costs = infrared_costs(pose.translation.truncate(), &rays, &rules);
        let grid = costs.into_message(Source::INFRARED, extrinsics(params).frames.local, time);
        cx.write(&ports.infrared_cost, time, grid);
    }

    fn ray(
        &self,
        local_from_vehicle: &Pose,
        reading: &RangeReading,
        time: SensorTime,
        params: &ProximityParams,
    ) -> Result<Ray, String> {
        let vehicle_from_sensor = extrinsics(params)
            .vehicle_from_sensor(&self.localizer, &reading.frame_id, Axes::Body, time)
            .map_err(|error| error.to_string())?;
        let (max_range_m, cone_rad) = (reading.max_range_m, reading.cone_rad);
        if !(max_range_m > 0.0 && max_range_m.is_finite() && (0.0..=std::f64::consts::PI).contains(&cone_rad))
        {
            return Err(format!(
                "greatest range is {max_range_m} m and cone {cone_rad} rad, expected a positive length and an angle"
            ));
        }
        if reading.seen && !(0.0..=max_range_m).contains(&reading.range_m) {
            return Err(format!("range is {} m, expected 0 to {max_range_m} m", reading.range_m));
        }
        Ok(Ray {
            map_from_sensor: *local_from_vehicle * vehicle_from_sensor,
            range_m: reading.seen.then_some(reading.range_m),
            max_range_m,
            cone_rad,
        })
    }

    fn take_wheels(&mut self, ports: &Ports, cx: &mut Cycle<'_>) {
        if let Some(encoders) = cx.read_newest(&ports.encoders) {
            let speeds = [encoders.left_mps, encoders.right_mps];
            if speeds.iter().all(|speed| speed.abs() <= FASTEST_WHEEL_MPS) {
                self.traction.wheels_mps = speeds;
                self.encoders_at = Some(cx.now());
            } else {
                cx.fault(format!(
                    "encoders: speeds are {speeds:?} m/s, expected at most {FASTEST_WHEEL_MPS}; skipped"
                ));
            }
        }
        if let Some(motors) = cx.read_newest(&ports.motors) {
            let currents = [motors.left_a, motors.right_a];
            if currents.iter().all(|current| current.is_finite()) {
                self.traction.motors_a = currents;
                self.motors_at = Some(cx.now());
            } else {
                cx.fault(format!("motors: currents are {currents:?} A, expected finite numbers; skipped"));
            }
        }
    }

    fn take_imu(&mut self, imu: &Msg<Imu>, params: &ProximityParams, rules: &Rules, cx: &mut Cycle<'_>) {
        let (Some(acceleration), Some(rate)) = (&imu.linear_acceleration, &imu.angular_velocity) else {
            cx.fault("imu: expected accelerations and turn rates, got only one of them; skipped");
            return;
        };
        if !(acceleration.x.abs() <= HARDEST_MPS2 && rate.z.abs() <= FASTEST_RADPS) {
            cx.fault(format!(
                "imu: acceleration is {} m/s² and turn rate {} rad/s, expected at most {HARDEST_MPS2} and {FASTEST_RADPS}; skipped",
                acceleration.x, rate.z
            ));
            return;
        }
        // The pitch comes from the localization, because an inertial sensor alone confuses acceleration with tilt.
        let Some(pose) = self.vehicle_at(SensorTime::of(imu), params) else {
            self.traction.lose_inertial();
            return;
        };
        let reading = Inertial {
            time: imu.acq_time(),
            arrived: imu.header().log_time,
            acceleration_mps2: acceleration.x,
            yaw_rate_radps: rate.z,
            pitch_rad: pose.rpy()[1],
        };
        if self.traction.take_inertial(&reading, rules) {
            cx.fault("imu: its clock has begun again");
        }
    }

    fn report(&mut self, ports: &Ports, rules: &Rules, cx: &mut Cycle<'_>) {
        let now = cx.now();
        if self.reported.is_some_and(|last| now < last.after_ns(REPORT_NS)) {
            return;
        }
        self.reported = Some(now);
        let traction = &self.traction;
        let state = match traction.state {
            State::Unknown => TractionState::TractionUnknown,
            State::Grips => TractionState::TractionGrips,
            State::Spins => TractionState::TractionSpins,
            State::Stalled => TractionState::TractionStalled,
        };
        let report = SlipReport {
            timestamp: Some(now.to_proto()),
            state: state.into(),
            slip: traction.slip,
            wheel_speed_mps: traction.wheel_speed_mps(),
            inertial_speed_mps: traction.inertial_mps,
            wheel_yaw_rate_radps: traction.wheel_yaw_rate_radps(rules),
            gyro_yaw_rate_radps: traction.yaw_rate_radps,
            left_a: traction.motors_a[0],
            right_a: traction.motors_a[1],
            spin_count: traction.spin.count,
            stall_count: traction.stall.count,
            spin_time_s: traction.spin.time_s,
            stall_time_s: traction.stall.time_s,
        };
        cx.write(&ports.slip, now, report);
    }
}

/// Sensors that have spoken and are silent now. The inputs know that they spoke, after `INIT`, too.
fn silent(ports: &Ports, timeout_s: f64, cx: &Cycle<'_>) -> Option<String> {
    let sensors = [("infrared", silent_s(&ports.infrared, cx)), ("motors", silent_s(&ports.motors, cx))];
    let silent = sensors.into_iter().filter(|&(_, silent_s)| timeout_s > 0.0 && silent_s > timeout_s);
    let told =
        |(name, silent_s): (&str, f64)| format!("{name} silent for {} s", text_above(silent_s, timeout_s));
    let told = silent.map(told).collect::<Vec<_>>().join(", ");
    (!told.is_empty()).then(|| format!("{told}, expected at most {timeout_s} s"))
}

/// Time since the newest message of an input came, s; 0 before the first one.
fn silent_s<T: Payload>(port: &In<T>, cx: &Cycle<'_>) -> f64 {
    cx.latest(port).map_or(0.0, |message| cx.now().seconds_since(message.header().log_time))
}

/// Says where the wheels slipped over some metres: what was driven over there is not free.
fn take_way_slip(report: &Msg<WaySlip>, ports: &Ports, params: &ProximityParams, cx: &mut Cycle<'_>) {
    if !is_slippery(report) {
        return;
    }
    let local = extrinsics(params).frames.local;
    match pose_of(report.middle.as_ref(), local) {
        Ok(pose) => {
            let time = report.acq_time();
            let costs = slippery_costs(&pose, &body(params)).into_message(Source::SLIP, local, time);
            cx.write(&ports.slip_cost, time, costs);
        }
        Err(error) => cx.fault(format!("way_slip: {error}; skipped")),
    }
}

fn body(params: &ProximityParams) -> Body {
    let known_m = params.vehicle_width_m - params.side_margin_m - params.side_margin_m;
    Body {
        bumper_x_m: params.bumper_x_m,
        bumper_width_m: params.bumper_width_m,
        bumper_depth_m: params.bumper_depth_m,
        rear_x_m: -params.rear_m,
        width_m: known_m.max(0.0).min(params.bumper_width_m),
    }
}

fn rules(params: &ProximityParams) -> Rules {
    Rules {
        track_m: params.track_m,
        memory_s: params.inertial_memory_s,
        spin_slip: params.spin_slip,
        min_speed_mps: params.min_speed_mps,
        stall_current_a: params.stall_current_a,
        stall_speed_mps: params.stall_speed_mps,
        settle_s: params.stall_time_s,
    }
}

fn extrinsics(params: &ProximityParams) -> Extrinsics<'_> {
    Extrinsics::new(params.pose.as_ref(), None)
}
