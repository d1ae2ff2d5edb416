//! Sensors that tell no speed, turn rate or attitude any more, or never did: what the status says, and what `HALT` waits for.

use rcs_geom::{DVec3, Pose};
use rcs_msg::foxglove::{Odometry, Quaternion, Vector3};
use rcs_msg::rcs;
use rcs_runtime::ProcessType;
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
inputs = { encoders = "/operator/encoders", imu = "/operator/imu" }
"#;

/// A bench with `vehicle_interface` alone and cycles of 20 ms; a sensor counts for this time, s.
fn start(stack: &str, sensor_timeout_s: &str) -> Bench {
    let types = [ProcessType::of::<VehicleInterface>()];
    let params = [("vehicle_interface.sensor_timeout_s", sensor_timeout_s)];
    let mut bench = Setup::new(stack, &types).params(&params).bench();
    run(&mut bench, 1);
    bench
}

fn run(bench: &mut Bench, cycles: u64) {
    bench.cycles(20, cycles);
}

/// Encoders and inertial sensor send once: 1 m/s and 0.5 rad/s.
fn sense(bench: &mut Bench) {
    let wheels = rcs::WheelEncoders { left_mps: 1.0, right_mps: 1.0, ..Default::default() };
    bench.write("/operator/encoders", wheels);
    let angular_velocity = Some(Vector3 { z: 0.5, ..Vector3::default() });
    bench.write("/operator/imu", rcs::Imu { angular_velocity, ..Default::default() });
}

/// Speed and turn rate of the status, m/s and rad/s.
fn motion(bench: &Bench) -> [f64; 2] {
    let status: rcs::VehicleStatus = bench.latest("/vehicle_interface/vehicle");
    [status.speed_mps, status.yaw_rate_radps]
}

fn is_unknown(bench: &Bench) -> bool {
    motion(bench).iter().all(|value| value.is_nan())
}

#[test]
fn a_speed_of_sensors_that_fell_silent_is_not_known_and_halt_does_not_wait_for_it() {
    let mut bench = start(STACK, "0.5");
    sense(&mut bench);
    run(&mut bench, 20);
    assert_eq!(motion(&bench), [1.0, 0.5], "silent for 0.4 s");
    let halt = rcs::Command { serial: 2, name: "HALT".to_owned(), ..Default::default() };
    bench.write("/vehicle_interface/command", halt);
    run(&mut bench, 2);
    let state = |bench: &Bench| bench.latest::<rcs::Status>("/vehicle_interface/status").state();
    assert_eq!(state(&bench), rcs::ProcessState::Exec, "it rolls");
    run(&mut bench, 30);
    assert!(is_unknown(&bench), "{:?}", motion(&bench));
    assert_eq!(state(&bench), rcs::ProcessState::Done);
    sense(&mut bench);
    run(&mut bench, 1);
    assert_eq!(motion(&bench), [1.0, 0.5], "they are back");
}

#[test]
fn sensors_that_speak_only_on_a_change_are_believed_for_ever() {
    let mut bench = start(STACK, "0");
    assert_eq!(motion(&bench), [0.0; 2]);
    sense(&mut bench);
    run(&mut bench, 100);
    assert_eq!(motion(&bench), [1.0, 0.5]);
}

#[test]
fn sensors_that_are_not_wired_or_never_speak_tell_no_speed() {
    let without = STACK.lines().filter(|line| !line.starts_with("inputs")).collect::<Vec<_>>().join("\n");
    for timeout_s in ["0", "0.5"] {
        assert!(is_unknown(&start(&without, timeout_s)), "not wired");
    }
    let mut bench = start(STACK, "0.5");
    assert_eq!(motion(&bench), [0.0; 2], "they may speak yet");
    run(&mut bench, 30);
    assert!(is_unknown(&bench));
}

#[test]
fn an_attitude_that_neither_the_local_estimate_nor_the_inertial_sensor_tells_is_not_known() {
    let attitude = |bench: &Bench| {
        let status: rcs::VehicleStatus = bench.latest("/vehicle_interface/vehicle");
        [status.roll_rad, status.pitch_rad]
    };
    let is_unknown = |bench: &Bench| attitude(bench).iter().all(|angle_rad| angle_rad.is_nan());
    let is_tilted = |bench: &Bench| {
        let [roll_rad, pitch_rad] = attitude(bench);
        (roll_rad - 0.1).abs() < 1e-9 && (pitch_rad + 0.2).abs() < 1e-9
    };
    let tilted = Pose::from_rpy(DVec3::ZERO, 0.1, -0.2, 0.0);
    let q = tilted.rotation;
    let orientation = Some(Quaternion { x: q.x, y: q.y, z: q.z, w: q.w });
    let imu = rcs::Imu { orientation, ..Default::default() };
    let pose = Some(pose_message(&tilted));
    let local = Odometry { frame_id: "local".to_owned(), pose, ..Odometry::default() };
    let stack = STACK.replace("inputs = {", "inputs = { local = \"/operator/local\",");
    for says_local in [false, true] {
        let mut bench = start(&stack, "0.5");
        assert_eq!(attitude(&bench), [0.0; 2], "they may speak yet");
        if says_local {
            bench.write("/operator/local", local.clone());
        } else {
            bench.write("/operator/imu", imu.clone());
        }
        run(&mut bench, 20);
        assert!(is_tilted(&bench), "{:?}", attitude(&bench));
        run(&mut bench, 10);
        assert!(is_unknown(&bench), "{:?}", attitude(&bench));
        bench.write("/operator/imu", imu.clone());
        run(&mut bench, 1);
        assert!(is_tilted(&bench), "it is back: {:?}", attitude(&bench));
    }
    let mut bench = start(&stack, "0");
    bench.write("/operator/local", local);
    run(&mut bench, 1);
    let init = rcs::Command { serial: 2, name: "INIT".to_owned(), ..Default::default() };
    bench.write("/vehicle_interface/command", init);
    run(&mut bench, 2);
    assert!(is_tilted(&bench), "after INIT: {:?}", attitude(&bench));
    let without = STACK.lines().filter(|line| !line.starts_with("inputs")).collect::<Vec<_>>().join("\n");
    assert!(is_unknown(&start(&without, "0")), "not wired");
}
