//! The process `sim_vehicle`. Its port table is in the crate's documentation.

use crate::commands::Commands;
use crate::drive::Drive;
use crate::proto::SimVehicleParams;
use crate::referee::Referee;
use crate::scene::{Scenery, Stage};
use crate::sensors::{Encoders, Gps, GpsSwitches, Inertial, is_due, measure_infrared, normal};
use crate::spec::VehicleSpec;
use crate::terrain::Terrain;
use crate::truth;
use crate::vehicle::{STEP_NS, Vehicle};
use bytes::Bytes;
use glam::DVec3;
use rcs_geom::Pose;
use rcs_msg::Stamp;
use rcs_msg::foxglove::{
    FrameTransform, FrameTransforms, Grid, LocationFix, Odometry, PoseInFrame, Quaternion, Vector3,
    location_fix,
};
use rcs_msg::rcs::{
    Bumper, CourseOutcome, CourseRun, GroundSpeed, GroundTruthObjects, GroundTruthState, Imu, MotorCurrents,
    RangeReading, RangeReadings, Steering, WheelCommand, WheelEncoders,
};
use rcs_runtime::{Cycle, In, NoCommands, Out, PortBuilder, Process, ProcessDef, Role};
use rcs_sense::pose_message;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Rate of static transforms and goal, 1/s.
const STATIC_HZ: f64 = 1.0;
/// Rate of the referee's message, 1/s.
const RUN_HZ: f64 = 5.0;
/// Maximum number of steps to catch up in one cycle; if more are missing, the time is skipped.
const MOST_STEPS: u64 = 100;

/// State: the vehicle, the errors of its sensors, the active command, and the referee's results.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct SimVehicle {
    /// Created in the first cycle.
    run: Option<Run>,
    /// Fingerprint of the texts from which the run was created. Saved with it, so that a run restored from disk also
    /// restarts when its world changes.
    texts: Option<u64>,
    /// Derived from the parameters' texts; computed again where it is missing or they have changed.
    #[serde(skip)]
    stage: Option<Arc<Stage>>,
    /// Cells of the true map.
    #[serde(skip)]
    map: Option<Bytes>,
}

/// State of a run.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct Run {
    start: Stamp,
    /// Number of steps since the start.
    steps: u64,
    vehicle: Vehicle,
    commands: Commands,
    encoders: Encoders,
    inertial: Inertial,
    gps: Gps,
    referee: Referee,
}

/// Ports of [`SimVehicle`].
#[derive(Debug)]
pub struct Ports {
    wheels: In<WheelCommand>,
    encoders: Out<WheelEncoders>,
    imu: Out<Imu>,
    motors: Out<MotorCurrents>,
    bumper: Out<Bumper>,
    infrared: Out<RangeReadings>,
    gps: Out<LocationFix>,
    ground_speed: Out<GroundSpeed>,
    steering: Out<Steering>,
    static_transforms: Out<FrameTransforms>,
    goal: Out<PoseInFrame>,
    run: Out<CourseRun>,
    ground_truth_state: Out<GroundTruthState>,
    ground_truth_pose: Out<Odometry>,
    ground_truth_map: Out<Grid>,
    ground_truth_objects: Out<GroundTruthObjects>,
}

impl Process for SimVehicle {
    type Params = SimVehicleParams;
    type Ports = Ports;
    type Command = NoCommands;
    const DEF: ProcessDef = ProcessDef {
        plugin: "sim_vehicle",
        summary: "Simulates a vehicle in a world: motion, simple sensors, ground truth, and the referee of a course",
        period_ms: 10.0,
        latency_ms: 0.0,
        reads_ground_truth: true,
    };

    fn ports(b: &mut PortBuilder) -> Ports {
        Ports {
            wheels: b.optional_input("wheels", "speeds of the driven wheels, m/s, and curvature, 1/m"),
            encoders: b
                .output("encoders", "distances and speeds of the driven wheels, m and m/s")
                .role(Role::Sensor)
                .build(),
            imu: b
                .output("imu", "turn rates, accelerations and heading, vehicle axes")
                .role(Role::Sensor)
                .build(),
            motors: b.output("motors", "currents of the drive motors, A").role(Role::Sensor).build(),
            bumper: b.output("bumper", "switches of the bumper in front").role(Role::Sensor).build(),
            infrared: b.output("infrared", "ranges of the infrared sensors, m").role(Role::Sensor).build(),
            gps: b
                .output("gps", "position fixes of the antenna with their variances")
                .role(Role::Sensor)
                .build(),
            ground_speed: b
                .output("ground_speed", "speed over ground by Doppler radar, m/s")
                .role(Role::Sensor)
                .build(),
            steering: b.output("steering", "curvature of the steered wheels, 1/m").role(Role::Sensor).build(),
            static_transforms: b
                .output("static_transforms", "mounts of the sensors on the vehicle, once a second")
                .role(Role::StaticTransforms)
                .build(),
            goal: b
                .output("goal", "the goal of the course, frame global, once a second")
                .role(Role::Goal)
                .build(),
            // Distance to the goal, collisions and slip are known to nobody in the field.
            run: b.output("run", "progress of the course").role(Role::Stats).truth().build(),
            ground_truth_state: b
                .output("ground_truth_state", "true pose in the frame global, speed, slip, contacts")
                .role(Role::Stats)
                .truth()
                .build(),
            ground_truth_pose: b
                .output("ground_truth_pose", "true pose of the vehicle in the frame global")
                .role(Role::Pose)
                .truth()
                .build(),
            ground_truth_map: b
                .output(
                    "ground_truth_map",
                    "ground height, height of its cover (m), class and blocked of the whole world",
                )
                .role(Role::Map)
                .truth()
                .build(),
            ground_truth_objects: b
                .output("ground_truth_objects", "all objects of the world, frame global")
                .role(Role::Stats)
                .truth()
                .build(),
        }
    }

    fn check(params: &SimVehicleParams) -> Result<(), String> {
        Stage::check(params)
    }

    fn new(_params: &SimVehicleParams) -> Self {
        Self::default()
    }

    fn cycle(&mut self, ports: &Ports, params: &SimVehicleParams, cx: &mut Cycle<'_>) {
        let stage = match self.stage(params) {
            Ok(stage) => stage,
            Err(error) => {
                cx.error(error);
                return;
            }
        };
        let now = cx.now();
        let is_first = self.run.is_none();
        if is_first && let Some(kind) = stage.object_at_start() {
            cx.fault(format!("start: the vehicle stands in an object of kind {kind}, expected a free place"));
        }
        let run = self.run.get_or_insert_with(|| Run::new(&stage, now, cx));
        let before = run.steps;
        run.catch_up(&stage, params, now, cx);
        run.read_commands(&stage, params, now, ports, cx);
        let times = Times { before_ns: before * STEP_NS, now_ns: run.steps * STEP_NS, is_first };
        run.sense(&stage, params, &times, ports, cx);
        run.tell(&stage, &times, ports, cx);
        if times.due_every(params.map_period_s) {
            let cells = self.map.get_or_insert_with(|| truth::map_cells(&stage.scenery, cx.pool()));
            let time = run.time();
            cx.write(&ports.ground_truth_map, time, truth::map_message(&stage.scenery, cells, time));
            cx.write(&ports.ground_truth_objects, time, truth::things_message(&stage.scenery, time));
        }
        // How it ended follows from the true position: see `/vehicle/run`.
        cx.exec(match run.referee.outcome() {
            CourseOutcome::CourseRunning => "simulates the vehicle",
            _ => "the run is over",
        });
    }
}

impl SimVehicle {
    /// Derives the stage from the texts. A change of world, vehicle or course restarts the run.
    fn stage(&mut self, params: &SimVehicleParams) -> Result<Arc<Stage>, String> {
        if let Some(stage) = self.stage.as_ref().filter(|stage| stage.is_of(params)) {
            return Ok(Arc::clone(stage));
        }
        let texts = Some(Stage::fingerprint(params));
        if self.texts != texts {
            self.run = None;
        }
        self.map = None;
        let stage = Arc::new(Stage::new(params)?);
        self.stage = Some(Arc::clone(&stage));
        self.texts = texts;
        Ok(stage)
    }
}

/// Times of the previous cycle and of this one, ns since the start.
struct Times {
    before_ns: u64,
    now_ns: u64,
    is_first: bool,
}

impl Times {
    fn due(&self, rate_hz: f64) -> bool {
        self.is_first || is_due(self.before_ns, self.now_ns, rate_hz)
    }

    /// Whether a period, s, is due; a period of 0 is due only in the first cycle.
    fn due_every(&self, period_s: f64) -> bool {
        self.is_first || period_s > 0.0 && is_due(self.before_ns, self.now_ns, 1.0 / period_s)
    }
}

impl Run {
    fn new(stage: &Stage, now: Stamp, cx: &mut Cycle<'_>) -> Run {
        let spec = &stage.spec;
        Run {
            start: now,
            steps: 0,
            vehicle: Vehicle::new(spec, &stage.scenery, stage.route.start, stage.route.start_yaw_rad),
            commands: Commands::default(),
            encoders: Encoders::new(&spec.encoders, cx.rng()),
            inertial: Inertial::new(&spec.inertial, cx.rng()),
            gps: Gps::new(&spec.gps, cx.rng()),
            referee: Referee::new(stage.route.start, stage.route.goal.as_ref()),
        }
    }

    /// Time of the state.
    fn time(&self) -> Stamp {
        self.start.after_ns(self.steps * STEP_NS)
    }

    /// Advances the vehicle up to a time with the commands received so far.
    fn catch_up(&mut self, stage: &Stage, params: &SimVehicleParams, now: Stamp, cx: &mut Cycle<'_>) {
        let wanted = now.0.saturating_sub(self.start.0) / STEP_NS;
        let mut missing = wanted.saturating_sub(self.steps);
        if missing > MOST_STEPS {
            cx.fault(format!("{missing} steps behind, expected at most {MOST_STEPS}; the time is skipped"));
            self.steps = wanted - MOST_STEPS;
            missing = MOST_STEPS;
        }
        for _ in 0..missing {
            let command = self.commands.command(&stage.spec, self.time(), params.command_timeout_s);
            self.vehicle.step(&stage.spec, &stage.scenery, command, params.traction_scale);
            let in_world = stage.scenery.contains(self.vehicle.at());
            self.referee.watch(&self.vehicle, stage.route.goal.as_ref(), in_world);
            self.steps += 1;
        }
    }

    fn read_commands(
        &mut self,
        stage: &Stage,
        params: &SimVehicleParams,
        now: Stamp,
        ports: &Ports,
        cx: &mut Cycle<'_>,
    ) {
        while let Some(command) = cx.read(&ports.wheels) {
            let taken = self.commands.take(&stage.spec, &command, now, params.command_timeout_s);
            if let Err(refusal) = taken {
                cx.fault(format!("wheels: {refusal}; command refused"));
            }
        }
    }

    /// Simulates the simple sensors.
    fn sense(
        &mut self,
        stage: &Stage,
        params: &SimVehicleParams,
        times: &Times,
        ports: &Ports,
        cx: &mut Cycle<'_>,
    ) {
        let Stage { spec, scenery, .. } = stage;
        let time = self.time();
        let timestamp = Some(time.to_proto());
        let noise = params.sensor_noise;
        if times.due(spec.encoders.rate_hz) {
            let reading = self.encoders.measure(&spec.encoders, self.vehicle.rolled_m, self.steps, noise);
            let [left_m, right_m] = reading.distance_m;
            let [left_mps, right_mps] = reading.speed_mps;
            cx.write(
                &ports.encoders,
                time,
                WheelEncoders { timestamp, left_m, right_m, left_mps, right_mps },
            );
        }
        if times.due(spec.inertial.rate_hz) {
            let message = self.feel(spec, noise, time, cx);
            cx.write(&ports.imu, time, message);
        }
        if times.due(spec.rates.motors_hz) {
            let brakes = self.commands.command(spec, time, params.command_timeout_s).drive == Drive::Brake;
            let [left_a, right_a] = self.currents(spec, brakes, noise, cx);
            cx.write(&ports.motors, time, MotorCurrents { timestamp, left_a, right_a });
            if let Some(steering) = &spec.steering {
                let drawn = if noise { steering.noise_per_m * normal(cx.rng()) } else { 0.0 };
                let curvature_per_m = self.vehicle.curvature_per_m + drawn;
                cx.write(&ports.steering, time, Steering { timestamp, curvature_per_m });
            }
        }
        if times.due(spec.rates.bumper_hz) {
            let [left, right] = self.vehicle.contacts.pressed();
            cx.write(&ports.bumper, time, Bumper { timestamp, left, right });
        }
        if times.due(spec.rates.infrared_hz) && !spec.infrared.is_empty() {
            let message = self.look_ahead(spec, scenery, noise, time, cx);
            cx.write(&ports.infrared, time, message);
        }
        if let Some(doppler) = spec.doppler.as_ref().filter(|doppler| times.due(doppler.rate_hz)) {
            let drawn = if noise { doppler.noise_mps * normal(cx.rng()) } else { 0.0 };
            let speed_mps = self.vehicle.motion.speed_mps + drawn;
            let variance = doppler.noise_mps * doppler.noise_mps;
            cx.write(&ports.ground_speed, time, GroundSpeed { timestamp, speed_mps, variance });
        }
        if times.due(spec.gps.rate_hz) {
            self.locate(stage, params, time, ports, cx);
        }
    }

    fn feel(&mut self, spec: &VehicleSpec, noise: bool, time: Stamp, cx: &mut Cycle<'_>) -> Imu {
        let Vehicle { turn_radps, force_mps2, pose, .. } = &self.vehicle;
        let (turn, force, yaw) = (*turn_radps, *force_mps2, pose.yaw());
        let reading = self.inertial.measure(&spec.inertial, turn, force, yaw, noise, cx.rng());
        let vector = |v: DVec3| Some(Vector3 { x: v.x, y: v.y, z: v.z });
        let diagonal = |v: DVec3| vec![v.x, 0.0, 0.0, 0.0, v.y, 0.0, 0.0, 0.0, v.z];
        let q = reading.orientation.rotation;
        let [attitude, gyro, accelerometer] = reading.variances;
        Imu {
            timestamp: Some(time.to_proto()),
            frame_id: "imu".to_owned(),
            orientation: Some(Quaternion { x: q.x, y: q.y, z: q.z, w: q.w }),
            angular_velocity: vector(reading.turn_radps),
            linear_acceleration: vector(reading.force_mps2),
            orientation_covariance: diagonal(attitude),
            angular_velocity_covariance: diagonal(gyro),
            linear_acceleration_covariance: diagonal(accelerometer),
        }
    }

    /// Motor currents: for the force at the rim, plus the no-load current of a turning motor.
    fn currents(&self, spec: &VehicleSpec, brakes: bool, noise: bool, cx: &mut Cycle<'_>) -> [f64; 2] {
        let motion = &self.vehicle.motion;
        [0, 1].map(|side: usize| {
            let drawn = if noise { spec.motors.noise_a * normal(cx.rng()) } else { 0.0 };
            if brakes {
                // Brakes hold without motor current.
                return drawn;
            }
            let idle = if motion.rim_mps[side].abs() > 0.01 { spec.motors.idle_current_a } else { 0.0 };
            (motion.motor_n[side] / spec.motors.newton_per_amp).abs() + idle + drawn
        })
    }

    fn look_ahead(
        &self,
        spec: &VehicleSpec,
        scenery: &Scenery,
        noise: bool,
        time: Stamp,
        cx: &mut Cycle<'_>,
    ) -> RangeReadings {
        let readings = spec.infrared.iter().map(|sensor| {
            let reading = measure_infrared(sensor, scenery, &self.vehicle.pose, noise, cx.rng());
            RangeReading {
                frame_id: sensor.name.clone(),
                range_m: reading.range_m,
                seen: reading.seen,
                max_range_m: sensor.range_m[1],
                cone_rad: sensor.cone_rad,
            }
        });
        RangeReadings { timestamp: Some(time.to_proto()), readings: readings.collect() }
    }

    fn locate(
        &mut self,
        stage: &Stage,
        params: &SimVehicleParams,
        time: Stamp,
        ports: &Ports,
        cx: &mut Cycle<'_>,
    ) {
        let spec = &stage.spec.gps;
        let antenna = self.vehicle.pose * spec.antenna;
        let trees = stage.scenery.trees_near(antenna.truncate(), spec.tree_radius_m);
        let switches = GpsSwitches {
            noise: params.gps_noise,
            outliers: params.gps_outliers,
            dropouts: params.gps_dropouts,
        };
        let fix = self.gps.measure(spec, antenna, trees, switches, cx.rng());
        let Some(fix) = fix.filter(|_| !params.gps_off) else { return };
        // A position without geodetic coordinates gives no fix, as with a real receiver.
        let Ok(place) = stage.scenery.geodetic(fix.position) else { return };
        let v = fix.variances;
        let message = LocationFix {
            timestamp: Some(time.to_proto()),
            frame_id: "gps".to_owned(),
            latitude: place.latitude_deg,
            longitude: place.longitude_deg,
            altitude: place.altitude_m,
            position_covariance: vec![v.x, 0.0, 0.0, 0.0, v.y, 0.0, 0.0, 0.0, v.z],
            position_covariance_type: location_fix::PositionCovarianceType::DiagonalKnown.into(),
            ..LocationFix::default()
        };
        cx.write(&ports.gps, time, message);
    }

    /// Sends the outputs of the simulation itself: sensor poses, goal, referee, ground truth.
    fn tell(&self, stage: &Stage, times: &Times, ports: &Ports, cx: &mut Cycle<'_>) {
        let time = self.time();
        if times.due(STATIC_HZ) {
            cx.write(&ports.static_transforms, time, sensor_transforms(&stage.spec, time));
            if let Some(goal) = &stage.route.goal {
                let height_m = stage.scenery.height_m(goal.at);
                let pose = Some(pose_message(&Pose::from_translation(goal.at.extend(height_m))));
                let message =
                    PoseInFrame { timestamp: Some(time.to_proto()), frame_id: "global".to_owned(), pose };
                cx.write(&ports.goal, time, message);
            }
        }
        if times.due(RUN_HZ) {
            cx.write(
                &ports.run,
                time,
                self.referee.message(&stage.route.course, stage.route.goal.as_ref(), time),
            );
        }
        if times.due(stage.spec.rates.ground_truth_hz) {
            let remaining_m = self.referee.remaining_m;
            let state = truth::state_message(&self.vehicle, &stage.scenery, remaining_m, time);
            let vehicle = &self.vehicle;
            let turn = vehicle.turn_radps;
            let pose = Odometry {
                timestamp: Some(time.to_proto()),
                frame_id: "global".to_owned(),
                body_frame_id: "vehicle_truth".to_owned(),
                pose: state.pose,
                linear_velocity: Some(Vector3 { x: vehicle.motion.speed_mps, y: vehicle.side_mps, z: 0.0 }),
                angular_velocity: Some(Vector3 { x: turn.x, y: turn.y, z: turn.z }),
                ..Odometry::default()
            };
            cx.write(&ports.ground_truth_state, time, state);
            cx.write(&ports.ground_truth_pose, time, pose);
        }
    }
}

/// The pose of every sensor in the frame `vehicle`.
fn sensor_transforms(spec: &VehicleSpec, time: Stamp) -> FrameTransforms {
    let transform = |child: String, pose: Pose| {
        let (p, q) = (pose.translation, pose.rotation);
        FrameTransform {
            timestamp: Some(time.to_proto()),
            parent_frame_id: "vehicle".to_owned(),
            child_frame_id: child,
            translation: Some(Vector3 { x: p.x, y: p.y, z: p.z }),
            rotation: Some(Quaternion { x: q.x, y: q.y, z: q.z, w: q.w }),
        }
    };
    let fixed = [("imu", Pose::IDENTITY), ("gps", Pose::from_translation(spec.gps.antenna))];
    let fixed = fixed.map(|(name, pose)| transform(name.to_owned(), pose));
    let infrared =
        spec.infrared.iter().map(|sensor| transform(sensor.name.clone(), sensor.mount.vehicle_from_sensor()));
    let ladars =
        spec.ladars.iter().map(|sensor| transform(sensor.name.clone(), sensor.mount.vehicle_from_sensor()));
    let cameras = spec.cameras.iter().flat_map(|camera| {
        (0..camera.cameras()).map(move |side| transform(camera.frame(side), camera.vehicle_from_camera(side)))
    });
    FrameTransforms { transforms: fixed.into_iter().chain(infrared).chain(ladars).chain(cameras).collect() }
}
