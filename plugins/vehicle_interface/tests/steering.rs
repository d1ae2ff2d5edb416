//! A vehicle with steering: `INIT` while it drives, where it keeps its angle and brakes, and turns on the spot, which it
//! cannot make; beside one that steers by its wheels' speeds.

use rcs_msg::{Stamp, rcs};
use rcs_runtime::ProcessType;
use rcs_sense::stop_reason;
use rcs_testkit::bench::{Bench, Setup};
use rcs_vehicle_interface::VehicleInterface;

const STACK: &str = r#"
format = 1
name = "vehicle_interface"

[[process]]
name = "vehicle_interface"
plugin = "vehicle_interface"
supervisor = "viewer"
inputs = { drive = "/operator/drive" }
"#;

const PERIOD_MS: u64 = 20;

fn start(steering: &str) -> Bench {
    let types = [ProcessType::of::<VehicleInterface>()];
    let params = [("vehicle_interface.steering", steering)];
    let mut bench = Setup::new(STACK, &types).params(&params).bench();
    bench.cycles(PERIOD_MS, 1);
    bench
}

/// Tells the vehicle a speed, m/s, and a turn rate, rad/s, for one cycle.
fn tell(bench: &mut Bench, speed_mps: f64, yaw_rate_radps: f64) {
    let command = rcs::DriveCommand {
        timestamp: Some(Stamp(bench.now_ms * 1_000_000).to_proto()),
        heading_rad: 0.0,
        speed_mps,
        yaw_rate_radps: Some(yaw_rate_radps),
    };
    bench.write("/operator/drive", command);
    bench.cycles(PERIOD_MS, 1);
}

/// Drives for 1.2 s at 1 m/s, with this turn rate, rad/s.
fn drive(bench: &mut Bench, yaw_rate_radps: f64) {
    for _ in 0..60 {
        tell(bench, 1.0, yaw_rate_radps);
    }
}

fn say(bench: &mut Bench, serial: u64, name: &str) {
    let command = rcs::Command { serial, name: name.to_owned(), ..rcs::Command::default() };
    bench.write("/vehicle_interface/command", command);
}

fn wheels(bench: &Bench) -> rcs::WheelCommand {
    bench.latest("/vehicle_interface/wheels")
}

#[test]
fn it_brakes_with_the_deceleration_of_a_stop() {
    let mut bench = start("STEERING_DIFFERENTIAL");
    drive(&mut bench, 0.0);
    say(&mut bench, 2, "INIT");
    let mut before_mps = wheels(&bench).left_mps;
    assert_eq!(before_mps, 1.0);
    for cycle in 0..40 {
        bench.cycles(PERIOD_MS, 1);
        let rcs::WheelCommand { left_mps, right_mps, .. } = wheels(&bench);
        // 4 m/s² in cycles of 20 ms.
        let slower_mps = before_mps - left_mps;
        assert!((-1e-9..0.08 + 1e-9).contains(&slower_mps), "cycle {cycle}: slower by {slower_mps} m/s");
        assert_eq!(left_mps, right_mps, "cycle {cycle}");
        before_mps = left_mps;
    }
    let status: rcs::Status = bench.latest("/vehicle_interface/status");
    assert_eq!((before_mps, status.state()), (0.0, rcs::ProcessState::Done));
    say(&mut bench, 3, "RUN");
    drive(&mut bench, 0.0);
    assert_eq!(wheels(&bench).left_mps, 1.0);
}

#[test]
fn a_vehicle_with_steering_keeps_its_steering_angle_while_it_brakes() {
    let mut bench = start("STEERING_ACKERMANN");
    drive(&mut bench, 0.1);
    let before_per_m = wheels(&bench).curvature_per_m;
    assert!((before_per_m - 0.1).abs() < 1e-9, "{before_per_m}");
    say(&mut bench, 2, "INIT");
    for cycle in 0..40 {
        bench.cycles(PERIOD_MS, 1);
        assert_eq!(wheels(&bench).curvature_per_m, before_per_m, "cycle {cycle}");
    }
    assert_eq!(wheels(&bench).left_mps, 0.0);
}

/// Why the vehicle is held when it is told a speed, m/s, and a turn rate, rad/s; empty where it is not.
fn held(bench: &mut Bench, speed_mps: f64, yaw_rate_radps: f64) -> String {
    tell(bench, speed_mps, yaw_rate_radps);
    let vehicle: rcs::VehicleStatus = bench.latest("/vehicle_interface/vehicle");
    vehicle.stop_reason
}

#[test]
fn a_turn_on_the_spot_holds_a_vehicle_with_steering_and_says_why() {
    let mut bench = start("STEERING_ACKERMANN");
    assert_eq!(held(&mut bench, 0.0, 1.0), stop_reason::ON_THE_SPOT);
    let status: rcs::Status = bench.latest("/vehicle_interface/status");
    assert_eq!(status.state_text, "held: a vehicle with steering cannot turn on the spot");
    for (speed_mps, yaw_rate_radps) in [(0.0, 0.0), (0.5, 0.1), (-0.5, 0.1)] {
        let told = held(&mut bench, speed_mps, yaw_rate_radps);
        assert_eq!(told, "", "{speed_mps} m/s, {yaw_rate_radps} rad/s");
    }
    assert_eq!(held(&mut start("STEERING_DIFFERENTIAL"), 0.0, 1.0), "");
}
