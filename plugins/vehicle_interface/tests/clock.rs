//! A local position whose clock begins again: it is taken, and is too old to steer by.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use rcs_geom::Pose;
use rcs_msg::foxglove::Odometry;
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
inputs = { drive = "/operator/drive", local = "/operator/local" }
"#;

/// Gives a position of a time and a heading to steer for. Returns why the vehicle is held, and the number of faults.
fn steer(bench: &mut Bench, time_ms: u64) -> (String, u64) {
    let pose = Some(pose_message(&Pose::IDENTITY));
    let odometry = Odometry { frame_id: "local".to_owned(), pose, ..Odometry::default() };
    let (time, message) = (Stamp(time_ms * 1_000_000), AnyMessage::new(odometry));
    bench.session.write(ExternalEvent::sensed("/operator/local", time, message)).unwrap();
    let timestamp = Some(Stamp(bench.now_ms * 1_000_000).to_proto());
    let command = rcs::DriveCommand { timestamp, speed_mps: 0.5, ..rcs::DriveCommand::default() };
    bench.write("/operator/drive", command);
    bench.cycles(20, 1);
    let vehicle: rcs::VehicleStatus = bench.latest("/vehicle_interface/vehicle");
    (vehicle.stop_reason, bench.faults("vehicle_interface").0)
}

#[test]
fn a_local_position_whose_clock_has_begun_again_is_taken_and_the_vehicle_is_held() {
    let mut bench = Setup::new(STACK, &[ProcessType::of::<VehicleInterface>()]).bench();
    bench.cycles(20, 1_000);
    assert_eq!(steer(&mut bench, 20_000), (String::new(), 0));
    assert_eq!(steer(&mut bench, 1_000), (String::new(), 1), "it may be late");
    let held = "local position is too old to steer for a heading";
    assert_eq!(steer(&mut bench, 1_020), (held.to_owned(), 2));
    assert_eq!(bench.faults("vehicle_interface").1, "local: the clock of the poses has begun again");
    assert_eq!(steer(&mut bench, 1_040), (held.to_owned(), 2));
    // The clock is set.
    assert_eq!(steer(&mut bench, 20_080), (String::new(), 2));
}
