//! The second vehicle in a whole run: steering, ladars, thermal camera, Doppler radar.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

mod common;

use common::TRACTOR;
use common::bench::{Bench, Files, VehicleBench, WORLD};
use rcs_msg::foxglove::{PointCloud, RawImage};
use rcs_msg::rcs;
use rcs_scene::Class;

const STACK: &str = r#"
format = 1
name = "tractor"

[[process]]
name = "vehicle"
plugin = "sim_vehicle"
supervisor = "viewer"
inputs = { wheels = "/operator/wheels" }
params = { world = "yard", vehicle = "tractor", start_east_m = 8.0, start_north_m = 8.0 }

[[process]]
name = "ladar_roof"
plugin = "sim_ladar"
supervisor = "viewer"
inputs = { ground_truth_state = "/vehicle/ground_truth_state" }
params = { world = "yard", vehicle = "tractor", ladar = "ladar_roof", noise = false }

[[process]]
name = "infrared"
plugin = "sim_cameras"
supervisor = "viewer"
inputs = { ground_truth_state = "/vehicle/ground_truth_state" }
params = { world = "yard", vehicle = "tractor", pair = "infrared" }

[buffers."/operator/wheels"]
queue = 16
"#;

fn bench(threads: usize) -> Bench {
    let files = Files {
        vehicle: TRACTOR.to_owned(),
        world: WORLD.replace("at = [20, 8]", "at = [25, 9]"),
        ..Files::default()
    };
    Bench::with_threads(STACK, &files, &[], threads)
}

#[test]
fn it_drives_an_arc_and_its_radar_and_steering_say_so() {
    let mut bench = bench(1);
    for _ in 0..40 {
        bench.command_with_curvature(1.5, 0.1);
        bench.advance(50);
    }
    let state = bench.state();
    assert!((state.yaw_rate_radps / state.speed_mps - 0.1).abs() < 0.01, "{state:?}");
    let speed: rcs::GroundSpeed = bench.latest("/vehicle/ground_speed");
    assert!((speed.speed_mps - state.speed_mps).abs() < 0.2 && speed.variance > 0.0);
    let steering: rcs::Steering = bench.latest("/vehicle/steering");
    assert!((steering.curvature_per_m - 0.1).abs() < 0.005, "{steering:?}");
    assert_eq!(bench.faults("vehicle").0, 0);
}

#[test]
fn a_turn_by_wheel_speeds_alone_is_refused_and_counted() {
    let mut bench = bench(1);
    bench.command(1.0, 1.05);
    bench.advance(50);
    assert_eq!(bench.faults("vehicle").0, 0, "it drives straight");
    bench.command(-0.85, 0.85);
    bench.advance(50);
    let (faults, why) = bench.faults("vehicle");
    let expected = "wheels at -0.85 and 0.85 m/s without curvature, expected one: the vehicle has steering";
    assert!(faults == 1 && why.contains(expected), "{faults}: {why}");
}

#[test]
fn the_ladars_points_lie_where_the_world_is() {
    let bench = bench(1);
    let cloud: PointCloud = bench.latest("/ladar_roof/cloud");
    let classes: PointCloud = bench.latest("/ladar_roof/ground_truth_class");
    let points = rcs_msg::points(&cloud).unwrap();
    let world = rcs_scene::World::from_toml(&WORLD.replace("at = [20, 8]", "at = [25, 9]")).unwrap();
    let [low, high] = world.bounds_m();
    let state = bench.state();
    let global_from_vehicle = rcs_sense::pose_of(state.pose.as_ref(), "vehicle").unwrap();
    let spec = common::tractor();
    let global_from_ladar =
        global_from_vehicle * spec.ladar("ladar_roof").unwrap().mount.vehicle_from_sensor();
    let (mut count, mut ground) = (0, 0);
    for (point, data) in points.iter().zip(classes.data.chunks_exact(16)) {
        let p = global_from_ladar * point.position;
        count += 1;
        if data[12] == Class::Dirt.code() && p.truncate().cmpge(low).all() && p.truncate().cmple(high).all() {
            ground += 1;
            assert!((p.z - world.height_m(p.truncate())).abs() < 0.02, "{p}");
        }
    }
    assert!(count > 1500 && ground > 500, "{count} points, {ground} on the ground");
}

#[test]
fn a_person_is_the_warmest_thing_in_the_thermal_image() {
    let mut bench = bench(1);
    bench.advance(50);
    let image: RawImage = bench.latest("/infrared/left");
    let classes: RawImage = bench.latest("/infrared/ground_truth_class");
    assert_eq!((image.encoding.as_str(), image.width, image.height), ("mono8", 320, 240));
    let of = |class: Class| {
        let grey = image.data.iter().zip(classes.data.iter()).filter(|(_, code)| **code == class.code());
        grey.map(|(grey, _)| *grey).collect::<Vec<u8>>()
    };
    let (person, dirt) = (of(Class::Person), of(Class::Dirt));
    assert!(person.len() > 20 && dirt.len() > 1000, "{} {}", person.len(), dirt.len());
    assert!(person.iter().min().unwrap() > dirt.iter().max().unwrap());
    assert!(bench.session.run().bus().get("/infrared/right").unwrap().latest().is_none());
}

#[test]
fn two_threads_give_the_bits_of_one() {
    let hash = |threads| {
        let mut bench = bench(threads);
        bench.command_with_curvature(1.0, -0.1);
        bench.advance(300);
        bench.session.run().summary().hash
    };
    assert!(hash(1).is_some());
    assert_eq!(hash(1), hash(2));
}
