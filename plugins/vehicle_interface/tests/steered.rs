//! A vehicle with steering, which cannot turn on the spot.

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

/// Why the vehicle is held when it is told a speed, m/s, and a turn rate, rad/s; empty where it is not.
fn held(bench: &mut Bench, speed_mps: f64, yaw_rate_radps: f64) -> String {
    let command = rcs::DriveCommand {
        timestamp: Some(Stamp(bench.now_ms * 1_000_000).to_proto()),
        heading_rad: 0.0,
        speed_mps,
        yaw_rate_radps: Some(yaw_rate_radps),
    };
    bench.write("/operator/drive", command);
    bench.cycles(PERIOD_MS, 1);
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
