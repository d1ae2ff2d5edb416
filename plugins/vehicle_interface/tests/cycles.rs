//! Whole cycles: input messages and the resulting wheel commands.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use rcs_geom::{DVec3, Pose};
use rcs_msg::foxglove::{Odometry, Quaternion, Vector3};
use rcs_msg::{AnyMessage, Stamp, rcs};
use rcs_runtime::{ExternalEvent, ProcessType};
use rcs_sense::pose_message;
use rcs_testkit::bench::{Bench, Setup};
use rcs_vehicle_interface::VehicleInterface;

const STACK: &str = r#"
format = 1
name = "vehicle_interface"

[[process]]
name = "vehicle_interface"
plugin = "vehicle_interface"
supervisor = "viewer"

[process.params]
max_turn_correction_radps = 1.0

[process.inputs]
drive = "/operator/drive"
teleop = "/operator/teleop"
emergency_stop = "/operator/emergency_stop"
above = "/operator/above"
local = "/operator/local"
imu = "/operator/imu"
encoders = "/operator/encoders"
motors = "/operator/motors"
bumper = "/operator/bumper"
"#;

/// A bench with `vehicle_interface` alone and cycles of 20 ms.
trait VehicleInterfaceBench: Sized {
    fn start() -> Self;
    fn run(&mut self, cycles: u64);
    fn drive(&mut self, port: &str, speed_mps: f64, yaw_rate_radps: Option<f64>);
    fn stop(&mut self, active: bool);
    fn local(&mut self, yaw_rad: f64);
    fn drive_for(&mut self, speed_mps: f64, cycles: u64);
    fn wheels(&self) -> [f64; 2];
    fn vehicle(&self) -> rcs::VehicleStatus;
    fn say(&mut self, serial: u64, name: &str);
    fn write_command(&mut self, command: rcs::Command);
    fn status(&self) -> rcs::Status;
}

impl VehicleInterfaceBench for Bench {
    fn start() -> Bench {
        let mut bench = Setup::new(STACK, &[ProcessType::of::<VehicleInterface>()]).bench();
        bench.run(1);
        bench
    }

    fn run(&mut self, cycles: u64) {
        self.cycles(20, cycles);
    }

    /// Sends a command with the current time, just before the next cycle.
    fn drive(&mut self, port: &str, speed_mps: f64, yaw_rate_radps: Option<f64>) {
        let timestamp = Some(Stamp(self.now_ms * 1_000_000).to_proto());
        let command = rcs::DriveCommand { timestamp, heading_rad: 0.0, speed_mps, yaw_rate_radps };
        self.write(&format!("/operator/{port}"), command);
    }

    fn stop(&mut self, active: bool) {
        let timestamp = Some(Stamp(self.now_ms * 1_000_000).to_proto());
        let stop = rcs::EmergencyStop { timestamp, active, reason: "button".to_owned() };
        self.write("/operator/emergency_stop", stop);
    }

    fn say(&mut self, serial: u64, name: &str) {
        self.write_command(rcs::Command { serial, name: name.to_owned(), ..Default::default() });
    }

    fn write_command(&mut self, command: rcs::Command) {
        self.write("/vehicle_interface/command", command);
    }

    fn status(&self) -> rcs::Status {
        self.latest("/vehicle_interface/status")
    }

    fn local(&mut self, yaw_rad: f64) {
        let pose = Some(pose_message(&Pose::from_yaw(yaw_rad)));
        let odometry = Odometry { frame_id: "local".to_owned(), pose, ..Odometry::default() };
        self.write("/operator/local", odometry);
    }

    /// Drives straight at this speed with a command in every cycle.
    fn drive_for(&mut self, speed_mps: f64, cycles: u64) {
        for _ in 0..cycles {
            self.drive("drive", speed_mps, Some(0.0));
            self.run(1);
        }
    }

    fn wheels(&self) -> [f64; 2] {
        let wheels: rcs::WheelCommand = self.latest("/vehicle_interface/wheels");
        [wheels.left_mps, wheels.right_mps]
    }

    fn vehicle(&self) -> rcs::VehicleStatus {
        self.latest("/vehicle_interface/vehicle")
    }
}

#[test]
fn it_drives_while_commands_come_and_stops_when_they_have_not_for_200_ms() {
    let mut bench = Bench::start();
    bench.drive_for(0.5, 60);
    assert_eq!(bench.wheels(), [0.5, 0.5]);
    assert!(!bench.vehicle().stopped);
    bench.run(9);
    assert_eq!(bench.wheels(), [0.5, 0.5], "the last command is 180 ms old");
    bench.run(2);
    assert!(bench.wheels()[0] < 0.5 && bench.vehicle().stop_reason == "no command");
    bench.run(20);
    assert_eq!(bench.wheels(), [0.0, 0.0]);
    assert_eq!(bench.faults("vehicle_interface").0, 0, "silence is no bad input");
}

#[test]
fn emergency_stop_beats_drive_in_the_same_cycle() {
    for stop_first in [true, false] {
        let mut bench = Bench::start();
        bench.drive_for(1.0, 60);
        if stop_first {
            bench.stop(true);
        }
        bench.drive("drive", 1.0, Some(0.0));
        bench.drive("teleop", 1.0, Some(0.0));
        if !stop_first {
            bench.stop(true);
        }
        bench.run(1);
        assert_eq!(bench.wheels(), [0.0, 0.0]);
        assert!(bench.vehicle().emergency_stopped);
        assert_eq!(bench.vehicle().stop_reason, "emergency stop: button");
    }
}

#[test]
fn an_emergency_stop_holds_until_a_later_message_releases_it() {
    let mut bench = Bench::start();
    bench.drive_for(1.0, 10);
    bench.stop(true);
    bench.drive_for(1.0, 100);
    assert_eq!(bench.wheels(), [0.0, 0.0]);
    let past = Some(Stamp(40_000_000).to_proto());
    bench.write("/operator/emergency_stop", rcs::EmergencyStop { timestamp: past, ..Default::default() });
    bench.drive_for(1.0, 10);
    assert_eq!(bench.wheels(), [0.0, 0.0], "a release from before the stop does not count");
    bench.drive("drive", 1.0, Some(0.0));
    bench.stop(false);
    bench.run(1);
    assert_eq!(bench.wheels(), [0.0, 0.0], "what was asked for before the release is not taken up");
    bench.drive_for(1.0, 10);
    assert!(bench.wheels()[0] > 0.1 && !bench.vehicle().emergency_stopped);
}

#[test]
fn an_older_stop_that_comes_late_does_not_shorten_a_newer_one() {
    let mut bench = Bench::start();
    bench.drive_for(1.0, 10);
    bench.stop(true);
    bench.run(1);
    for (at_ms, active) in [(50, true), (100, false)] {
        let timestamp = Some(Stamp(at_ms * 1_000_000).to_proto());
        bench.write(
            "/operator/emergency_stop",
            rcs::EmergencyStop { timestamp, active, ..Default::default() },
        );
        bench.drive_for(1.0, 10);
    }
    assert!(bench.vehicle().emergency_stopped);
    assert_eq!(bench.wheels(), [0.0, 0.0]);
}

#[test]
fn a_stop_from_the_future_can_be_released() {
    let mut bench = Bench::start();
    let hour = Some(Stamp(3_600_000_000_000).to_proto());
    let stop = rcs::EmergencyStop { timestamp: hour, active: true, ..Default::default() };
    bench.write("/operator/emergency_stop", stop);
    bench.run(2);
    assert!(bench.vehicle().emergency_stopped);
    bench.stop(false);
    bench.run(1);
    assert!(!bench.vehicle().emergency_stopped);
}

#[test]
fn absurd_readings_are_faults_and_the_vehicle_drives_on_by_the_others() {
    let mut bench = Bench::start();
    for cycle in 0..50 {
        let (right_mps, rate) = if cycle % 2 == 0 { (f64::MAX, 1e300) } else { (0.5, 0.0) };
        bench.write(
            "/operator/encoders",
            rcs::WheelEncoders { left_mps: 0.5, right_mps, ..Default::default() },
        );
        let angular_velocity = Some(Vector3 { z: rate, ..Vector3::default() });
        bench.write("/operator/imu", rcs::Imu { angular_velocity, ..Default::default() });
        bench.drive_for(0.5, 1);
    }
    assert_eq!(bench.faults("vehicle_interface").0, 50);
    assert_eq!(bench.wheels(), [0.5, 0.5]);
}

#[test]
fn a_local_position_from_the_future_is_not_fresh_for_longer_than_another() {
    let mut bench = Bench::start();
    let pose = Some(pose_message(&Pose::from_yaw(0.0)));
    let odometry = Odometry { frame_id: "local".to_owned(), pose, ..Odometry::default() };
    let hour = Stamp(3_600_000_000_000);
    bench.session.write(ExternalEvent::sensed("/operator/local", hour, AnyMessage::new(odometry))).unwrap();
    let steer = |bench: &mut Bench, cycles: u64| {
        for _ in 0..cycles {
            bench.drive("drive", 0.5, None);
            bench.run(1);
        }
        bench.vehicle().stop_reason
    };
    assert_eq!(steer(&mut bench, 2), "");
    assert_eq!(steer(&mut bench, 100), "local position is too old to steer for a heading");
    // The next one counts.
    bench.local(0.0);
    assert_eq!(steer(&mut bench, 2), "");
}

#[test]
fn the_operator_wins_while_fresh() {
    let mut bench = Bench::start();
    bench.drive_for(0.5, 60);
    for _ in 0..50 {
        bench.drive("drive", 0.5, Some(0.0));
        bench.drive("teleop", -0.3, Some(0.0));
        bench.run(1);
    }
    assert_eq!(bench.wheels(), [-0.3, -0.3]);
    assert!(bench.vehicle().teleoperated && !bench.vehicle().stopped);
    bench.drive_for(0.5, 80);
    assert_eq!(bench.wheels(), [0.5, 0.5], "the operator has let go");
    assert!(!bench.vehicle().teleoperated);
}

#[test]
fn an_error_above_stops_who_drives_but_not_the_operator() {
    let mut bench = Bench::start();
    bench.drive_for(0.5, 60);
    let state = rcs::ProcessState::Error.into();
    let above = rcs::Status {
        process: "follower".to_owned(),
        state,
        state_text: "no way".to_owned(),
        ..Default::default()
    };
    bench.write("/operator/above", above);
    bench.drive_for(0.5, 20);
    assert_eq!(bench.wheels(), [0.0, 0.0]);
    assert_eq!(bench.vehicle().stop_reason, "follower is in ERROR: no way");
    for _ in 0..20 {
        bench.drive("teleop", 0.2, Some(0.0));
        bench.run(1);
    }
    assert_eq!(bench.wheels(), [0.2, 0.2]);
    bench.write(
        "/operator/above",
        rcs::Status { state: rcs::ProcessState::Exec.into(), ..Default::default() },
    );
    bench.drive_for(0.5, 60);
    assert_eq!(bench.wheels(), [0.5, 0.5]);
}

#[test]
fn bad_commands_are_refused_counted_and_the_vehicle_is_safe() {
    let bad = [
        (f64::NAN, None, 0, "speed is NaN"),
        (10.0, None, 0, "speed is 10 m/s"),
        (0.5, Some(f64::NAN), 0, "turn rate is NaN"),
        (0.5, Some(0.0), 500, "older than the one before"),
    ];
    for (speed_mps, rate, age_ms, why) in bad {
        let mut bench = Bench::start();
        bench.drive_for(0.5, 60);
        let given = Stamp((bench.now_ms - age_ms) * 1_000_000);
        bench.write(
            "/operator/drive",
            rcs::DriveCommand {
                timestamp: Some(given.to_proto()),
                heading_rad: f64::NAN,
                speed_mps,
                yaw_rate_radps: rate,
            },
        );
        bench.run(1);
        let [left, right] = bench.wheels();
        assert!(left < 0.5 && left == right, "{why}: {left} {right}");
        let status = bench.vehicle();
        assert_eq!((status.refused, bench.faults("vehicle_interface").0), (1, 1), "{why}");
        assert!(status.last_refusal.contains(why), "{}", status.last_refusal);
        bench.run(15);
        assert_eq!(bench.wheels(), [0.0, 0.0], "{why}");
        bench.drive_for(0.5, 60);
        assert_eq!(bench.wheels(), [0.5, 0.5], "good commands are obeyed again after: {why}");
    }
}

#[test]
fn a_heading_is_steered_for_by_the_local_position_and_without_it_the_vehicle_stands() {
    let mut bench = Bench::start();
    for _ in 0..20 {
        bench.drive("drive", 0.5, None);
        bench.run(1);
    }
    assert_eq!(bench.wheels(), [0.0, 0.0]);
    assert!(bench.vehicle().stop_reason.contains("not known"));
    for _ in 0..60 {
        bench.local(-0.3);
        bench.drive("drive", 0.5, None);
        bench.run(1);
    }
    let [left, right] = bench.wheels();
    assert!((right - left - 0.6 * 0.6).abs() < 1e-9, "turns left at 2 · 0.3 rad/s: {left} {right}");
    for _ in 0..60 {
        bench.drive("drive", 0.5, None);
        bench.run(1);
    }
    assert_eq!(bench.wheels(), [0.0, 0.0]);
    assert!(bench.vehicle().stop_reason.contains("too old"));
}

#[test]
fn a_pressed_bumper_holds_the_way_forward_and_not_the_way_back() {
    let mut bench = Bench::start();
    let press = |bench: &mut Bench| {
        bench.write("/operator/bumper", rcs::Bumper { left: true, ..Default::default() });
    };
    press(&mut bench);
    bench.drive_for(0.5, 20);
    assert_eq!(bench.wheels(), [0.0, 0.0]);
    assert_eq!(bench.vehicle().stop_reason, "bumper is pressed");
    for _ in 0..3 {
        press(&mut bench);
        bench.drive_for(-0.5, 20);
    }
    assert_eq!(bench.wheels(), [-0.5, -0.5]);
    assert!(bench.vehicle().bumper_left && !bench.vehicle().stopped);
}

#[test]
fn the_vehicles_status_is_what_its_sensors_say() {
    let mut bench = Bench::start();
    bench.write(
        "/operator/encoders",
        rcs::WheelEncoders { left_mps: 0.4, right_mps: 0.6, ..Default::default() },
    );
    bench.write("/operator/motors", rcs::MotorCurrents { left_a: 3.0, right_a: 4.0, ..Default::default() });
    let angular_velocity = Some(Vector3 { z: 0.25, ..Vector3::default() });
    bench.write("/operator/imu", rcs::Imu { angular_velocity, ..Default::default() });
    bench.run(1);
    let status = bench.vehicle();
    assert_eq!((status.speed_mps, status.yaw_rate_radps), (0.5, 0.25));
    assert_eq!((status.left_a, status.right_a), (3.0, 4.0));
    bench.write("/operator/encoders", rcs::WheelEncoders { left_mps: f64::NAN, ..Default::default() });
    let angular_velocity = Some(Vector3 { z: f64::INFINITY, ..Vector3::default() });
    bench.write("/operator/imu", rcs::Imu { angular_velocity, ..Default::default() });
    bench.run(1);
    assert_eq!(bench.faults("vehicle_interface").0, 2);
    assert_eq!(bench.vehicle().speed_mps, 0.5, "what was known stays");
}

#[test]
fn with_one_side_in_mud_it_goes_straight_while_both_sensors_tell_it() {
    let mut bench = Bench::start();
    let mut slip_for = |cycles: u64, encoders: bool| {
        for _ in 0..cycles {
            if encoders {
                let wheels = rcs::WheelEncoders { left_mps: 0.9, right_mps: 0.6, ..Default::default() };
                bench.write("/operator/encoders", wheels);
            }
            let straight = Some(Vector3 { x: 0.0, y: 0.0, z: 0.0 });
            bench.write("/operator/imu", rcs::Imu { angular_velocity: straight, ..Default::default() });
            bench.drive_for(0.8, 1);
        }
        bench.wheels()
    };
    let [left_mps, right_mps] = slip_for(150, true);
    assert!((left_mps - right_mps - 0.3).abs() < 1e-3, "{left_mps} {right_mps}");
    assert_eq!(slip_for(15, false), [0.8; 2], "what the wheels did is not known any more");
}

#[test]
fn a_sensor_that_falls_silent_stops_the_driver_but_not_the_operator() {
    let speak = |bench: &mut Bench, sensor: &str| match sensor {
        "encoders" => bench.write("/operator/encoders", rcs::WheelEncoders::default()),
        "imu" => {
            let angular_velocity = Some(Vector3::default());
            bench.write("/operator/imu", rcs::Imu { angular_velocity, ..rcs::Imu::default() });
        }
        _ => bench.write("/operator/bumper", rcs::Bumper::default()),
    };
    for sensor in ["encoders", "imu", "bumper"] {
        let mut bench = Bench::start();
        bench.drive_for(1.0, 60);
        assert_eq!(bench.wheels(), [1.0, 1.0], "{sensor}: one that never spoke is not missed");
        speak(&mut bench, sensor);
        bench.drive_for(1.0, 25);
        assert_eq!(bench.wheels(), [1.0, 1.0], "{sensor}: silent for 0.5 s");
        for _ in 0..20 {
            bench.drive_for(1.0, 1);
            let told = bench.vehicle().stop_reason;
            assert!(!told.contains("silent for 0.5 s"), "the time is above the limit: {told}");
        }
        assert_eq!(bench.wheels(), [0.0, 0.0], "{sensor}");
        let held = bench.vehicle();
        let expected = format!("{sensor} silent for 0.9 s, expected at most 0.5 s");
        assert_eq!((held.stopped, held.stop_reason), (true, expected));
        bench.drive("teleop", 0.3, Some(0.0));
        bench.run(1);
        assert!(bench.wheels()[0] > 0.0, "{sensor}: the operator drives it home");
        // The operator's command expires.
        bench.run(15);
        speak(&mut bench, sensor);
        bench.drive_for(1.0, 20);
        assert!(bench.wheels()[0] > 0.3, "{sensor}: it is back");
    }
}

#[test]
fn a_sensor_that_repeats_its_last_message_is_silent() {
    for sensor in ["encoders", "imu", "bumper"] {
        let mut bench = Bench::start();
        for cycle in 0..60 {
            // A sensor that measures states another time in each message.
            let timestamp = Some(Stamp(20_000_000 * cycle.min(10)).to_proto());
            match sensor {
                "encoders" => {
                    bench.write("/operator/encoders", rcs::WheelEncoders { timestamp, ..Default::default() });
                }
                "imu" => {
                    let angular_velocity = Some(Vector3::default());
                    let imu = rcs::Imu { timestamp, angular_velocity, ..rcs::Imu::default() };
                    bench.write("/operator/imu", imu);
                }
                _ => bench.write("/operator/bumper", rcs::Bumper { timestamp, ..Default::default() }),
            }
            bench.drive_for(1.0, 1);
        }
        let held = bench.vehicle();
        assert!(held.stop_reason.starts_with(&format!("{sensor} silent for ")), "{}", held.stop_reason);
    }
}

#[test]
fn roll_and_pitch_are_the_position_estimates_and_without_it_the_inertial_sensors() {
    let mut bench = Bench::start();
    let tilted = |roll_rad, pitch_rad| Pose::from_rpy(DVec3::ZERO, roll_rad, pitch_rad, 0.0);
    let q = tilted(0.1, -0.2).rotation;
    let orientation = Some(Quaternion { x: q.x, y: q.y, z: q.z, w: q.w });
    bench.write("/operator/imu", rcs::Imu { orientation, ..Default::default() });
    bench.run(1);
    let status = bench.vehicle();
    assert!((status.roll_rad - 0.1).abs() < 1e-9 && (status.pitch_rad + 0.2).abs() < 1e-9, "{status:?}");
    let pose = Some(pose_message(&tilted(-0.05, 0.3)));
    bench.write("/operator/local", Odometry { frame_id: "local".to_owned(), pose, ..Odometry::default() });
    bench.write("/operator/imu", rcs::Imu { orientation, ..Default::default() });
    bench.run(1);
    let status = bench.vehicle();
    assert!((status.roll_rad + 0.05).abs() < 1e-9 && (status.pitch_rad - 0.3).abs() < 1e-9, "{status:?}");
}

#[test]
fn halt_brakes_and_is_done_when_the_vehicle_stands_and_old_wishes_are_not_taken_up_again() {
    let mut bench = Bench::start();
    bench.drive_for(1.0, 60);
    bench.say(2, "HALT");
    bench.drive_for(1.0, 2);
    assert_eq!((bench.status().state(), bench.status().echo_serial), (rcs::ProcessState::Exec, 2));
    assert!((0.1..1.0).contains(&bench.wheels()[0]), "{:?}", bench.wheels());
    assert_eq!(bench.vehicle().stop_reason, "halted");
    bench.drive_for(1.0, 60);
    assert_eq!((bench.status().state(), bench.wheels()), (rcs::ProcessState::Done, [0.0, 0.0]));
    bench.say(3, "RUN");
    bench.run(1);
    assert_eq!(bench.vehicle().stop_reason, "no command");
    bench.drive_for(1.0, 60);
    assert_eq!(bench.wheels(), [1.0, 1.0]);
}

#[test]
fn an_emergency_stop_outlives_init() {
    let mut bench = Bench::start();
    bench.drive_for(1.0, 10);
    bench.stop(true);
    bench.run(1);
    let past = Some(Stamp(40_000_000).to_proto());
    bench.write("/operator/emergency_stop", rcs::EmergencyStop { timestamp: past, ..Default::default() });
    bench.run(1);
    bench.say(2, "INIT");
    bench.run(2);
    assert!(bench.vehicle().emergency_stopped);
    bench.say(3, "RUN");
    bench.drive_for(1.0, 10);
    assert_eq!((bench.wheels(), bench.vehicle().emergency_stopped), ([0.0, 0.0], true));
    bench.stop(false);
    bench.drive_for(1.0, 60);
    assert_eq!(bench.wheels(), [1.0, 1.0]);
}

#[test]
fn a_speed_limit_holds_for_whoever_drives_until_run() {
    let mut bench = Bench::start();
    let limit = |serial, max_speed_mps| rcs::Command {
        serial,
        name: "LIMIT_SPEED".to_owned(),
        parameters_schema: "rcs.SpeedLimit".to_owned(),
        parameters: AnyMessage::new(rcs::SpeedLimit { max_speed_mps }).bytes(),
        ..Default::default()
    };
    assert_eq!(bench.vehicle().max_speed_mps, 1.3);
    bench.write_command(limit(2, 0.25));
    bench.drive_for(1.0, 60);
    assert_eq!((bench.wheels(), bench.vehicle().max_speed_mps), ([0.25, 0.25], 0.25));
    bench.write_command(limit(3, f64::NAN));
    bench.drive_for(1.0, 60);
    assert_eq!(bench.wheels(), [0.25, 0.25], "what is refused changes nothing");
    assert!(bench.status().state_text.contains("max_speed_mps"), "{}", bench.status().state_text);
    // Nothing moves, and nobody is told that the vehicle is free to.
    bench.write_command(limit(4, 0.0));
    for _ in 0..60 {
        bench.drive("drive", 0.0, Some(0.8));
        bench.run(1);
    }
    assert_eq!(bench.wheels(), [0.0, 0.0]);
    assert_eq!(bench.vehicle().stop_reason, "the speed limit is 0 m/s");
    bench.say(5, "RUN");
    bench.drive_for(1.0, 60);
    assert_eq!((bench.wheels(), bench.vehicle().max_speed_mps), ([1.0, 1.0], 1.3));
}

#[test]
fn a_sensor_that_is_silent_is_missed_after_init_too() {
    for sensor in ["encoders", "imu"] {
        let mut bench = Bench::start();
        if sensor == "encoders" {
            // The reading of a vehicle that moves does not keep it braking for ever.
            let moves = rcs::WheelEncoders { left_mps: 1.0, right_mps: 1.0, ..Default::default() };
            bench.write("/operator/encoders", moves);
        } else {
            let angular_velocity = Some(Vector3::default());
            bench.write("/operator/imu", rcs::Imu { angular_velocity, ..Default::default() });
        }
        bench.drive_for(1.0, 60);
        assert!(bench.vehicle().stop_reason.starts_with(sensor), "{}", bench.vehicle().stop_reason);
        bench.say(2, "INIT");
        bench.run(60);
        assert_eq!(bench.status().state(), rcs::ProcessState::Done);
        bench.say(3, "RUN");
        bench.drive_for(1.0, 20);
        assert_eq!(bench.wheels(), [0.0, 0.0], "{sensor}");
        assert!(bench.vehicle().stop_reason.starts_with(sensor), "{}", bench.vehicle().stop_reason);
    }
}

#[test]
fn a_pressed_bumper_that_speaks_only_on_a_change_holds_after_init_too() {
    let types = [ProcessType::of::<VehicleInterface>()];
    let setup = Setup::new(STACK, &types);
    let mut bench = setup.params(&[("vehicle_interface.sensor_timeout_s", "0")]).bench();
    bench.run(1);
    bench.write("/operator/bumper", rcs::Bumper { left: true, ..Default::default() });
    bench.run(1);
    bench.say(2, "INIT");
    bench.run(2);
    bench.say(3, "RUN");
    bench.drive_for(0.5, 20);
    assert_eq!((bench.wheels(), bench.vehicle().stop_reason.as_str()), ([0.0, 0.0], "bumper is pressed"));
    bench.write("/operator/bumper", rcs::Bumper::default());
    bench.drive_for(0.5, 60);
    assert_eq!(bench.wheels(), [0.5, 0.5]);
}
