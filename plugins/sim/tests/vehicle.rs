//! Motion of the vehicle: compared with its file, and as golden traces.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

mod common;

use common::{Plane, lagr, tractor};
use glam::DVec2;
use rcs_sim::drive::Drive;
use rcs_sim::spec::VehicleSpec;
use rcs_sim::vehicle::{DriveCommand, GRAVITY_MPS2, STEP_S, Vehicle};
use rcs_testkit::golden::Trace;

/// A vehicle on a plane.
struct Drives {
    spec: VehicleSpec,
    plane: Plane,
    vehicle: Vehicle,
}

impl Drives {
    fn new(spec: VehicleSpec, plane: Plane, yaw_rad: f64) -> Drives {
        let vehicle = Vehicle::new(&spec, &plane, DVec2::ZERO, yaw_rad);
        Drives { spec, plane, vehicle }
    }

    fn run(&mut self, drive: Drive, seconds: f64) {
        self.run_watched(drive, seconds, |_, _| {});
    }

    fn run_watched(&mut self, drive: Drive, seconds: f64, mut watch: impl FnMut(f64, &Vehicle)) {
        for step in 1..=(seconds / STEP_S).round() as usize {
            self.vehicle.step(&self.spec, &self.plane, DriveCommand { drive, curvature_per_m: 0.0 }, 1.0);
            watch(step as f64 * STEP_S, &self.vehicle);
        }
    }

    fn speed(&self) -> f64 {
        self.vehicle.motion.speed_mps
    }
}

const COLUMNS: [&str; 12] = [
    "t_s",
    "x_m",
    "y_m",
    "z_m",
    "roll_rad",
    "pitch_rad",
    "speed_mps",
    "yaw_rate_radps",
    "rim_left_mps",
    "slip_left",
    "motor_left_n",
    "pressed",
];

fn record(trace: &mut Trace, t: f64, vehicle: &Vehicle) {
    // Ten rows per second suffice to show a change.
    if ((t / STEP_S).round() as usize).is_multiple_of(10) {
        let [roll, pitch, _] = vehicle.pose.rpy();
        let p = vehicle.pose.translation;
        let motion = &vehicle.motion;
        let [left, right] = vehicle.contacts.pressed().map(f64::from);
        trace.row(&[
            t,
            p.x,
            p.y,
            p.z,
            roll,
            pitch,
            motion.speed_mps,
            motion.yaw_rate_radps,
            motion.rim_mps[0],
            vehicle.slip[0],
            motion.motor_n[0],
            left + 2.0 * right,
        ]);
    }
}

fn golden(name: &str, drives: &mut Drives, parts: &[(Drive, f64)]) {
    let mut trace = Trace::new(&COLUMNS);
    let mut start = 0.0;
    for &(drive, seconds) in parts {
        drives.run_watched(drive, seconds, |t, vehicle| record(&mut trace, start + t, vehicle));
        start += seconds;
    }
    trace.check(env!("CARGO_MANIFEST_DIR"), name);
}

#[test]
fn coasting_down_takes_the_way_that_resistance_and_mass_say() {
    let mut drives = Drives::new(lagr(), Plane::default(), 0.0);
    drives.run(Drive::Speeds([1.3; 2]), 5.0);
    let (speed, from) = (drives.speed(), drives.vehicle.at().x);
    assert!((speed - 1.3).abs() < 0.02, "{speed}");
    golden("coast_down.csv", &mut drives, &[(Drive::Coast, 5.0)]);
    assert_eq!(drives.speed(), 0.0);
    let spec = lagr();
    let weight = spec.body.mass_kg * GRAVITY_MPS2;
    let resistance = weight * (Plane::default().rolling_resistance + spec.wheels.rolling_resistance)
        + 2.0 * spec.motors.idle_current_a * spec.motors.newton_per_amp;
    let mass = spec.body.mass_kg + 2.0 * spec.wheels.rim_mass_kg;
    let expected = 0.5 * mass * speed * speed / resistance;
    let way = drives.vehicle.at().x - from;
    assert!((way / expected - 1.0).abs() < 0.02, "got {way} m, expected {expected} m");
}

#[test]
fn on_a_slope_that_grips_slip_is_in_proportion_to_the_force() {
    let plane = Plane { slope_x: 0.2, ..Plane::default() };
    let mut drives = Drives::new(lagr(), plane, 0.0);
    golden("slope_with_grip.csv", &mut drives, &[(Drive::Speeds([0.8; 2]), 5.0), (Drive::Brake, 3.0)]);
    assert!(drives.speed().abs() < 1e-4, "the brake holds: {}", drives.speed());
    let stands_at = drives.vehicle.at().x;
    drives.run(Drive::Brake, 60.0);
    assert!((drives.vehicle.at().x - stands_at).abs() < 0.01, "it does not creep");

    drives.run(Drive::Speeds([0.8; 2]), 4.0);
    let spec = lagr();
    let slope = libm::atan(0.2);
    let weight = spec.body.mass_kg * GRAVITY_MPS2;
    let pull = weight * libm::sin(slope)
        + weight * libm::cos(slope) * (drives.plane.rolling_resistance + spec.wheels.rolling_resistance);
    let limit = weight * libm::cos(slope) * spec.wheels.driven_load * drives.plane.traction;
    let expected = spec.wheels.slip_at_limit * pull / limit;
    let slip = drives.vehicle.slip[0];
    assert!((slip / expected - 1.0).abs() < 0.1, "got {slip}, expected {expected}");
    assert!((drives.speed() - 0.8 * (1.0 - expected)).abs() < 0.01, "{}", drives.speed());
}

#[test]
fn on_a_slope_that_does_not_grip_the_wheels_spin_and_the_vehicle_slides_back() {
    let plane = Plane { slope_x: 0.2, traction: 0.2, ..Plane::default() };
    let mut drives = Drives::new(lagr(), plane, 0.0);
    golden("slope_without_grip.csv", &mut drives, &[(Drive::Speeds([0.8; 2]), 4.0)]);
    assert!(drives.speed() < -0.05, "{}", drives.speed());
    assert!(drives.vehicle.slip.iter().all(|&slip| slip > 0.9), "{:?}", drives.vehicle.slip);
    assert!((drives.vehicle.motion.rim_mps[0] - 0.8).abs() < 0.05);
}

#[test]
fn the_bumper_stops_the_vehicle_and_switches() {
    let plane = Plane { posts: vec![(DVec2::new(1.5, 0.0), 0.1)], ..Plane::default() };
    let mut drives = Drives::new(lagr(), plane, 0.0);
    golden("bumper_hit.csv", &mut drives, &[(Drive::Speeds([0.25; 2]), 8.0)]);
    assert_eq!(drives.vehicle.contacts.pressed(), [true; 2]);
    assert!(drives.speed().abs() < 1e-3, "{}", drives.speed());
    let reach = drives.vehicle.at().x + drives.spec.body.front_m;
    assert!((1.4 - drives.spec.bumper.travel_m..=1.4 + 1e-6).contains(&reach), "front is at {reach}");
    let contacts = drives.vehicle.contacts.list();
    assert_eq!(contacts.len(), 1);
    assert!(contacts[0].on_bumper && !contacts[0].collision, "{contacts:?}");
    assert!((contacts[0].speed_mps - 0.25).abs() < 0.02, "{contacts:?}");
}

#[test]
fn one_side_of_the_bumper_presses_its_own_switch() {
    for (y, expected) in [(0.2, [true, false]), (-0.2, [false, true])] {
        let plane = Plane { posts: vec![(DVec2::new(1.5, y), 0.05)], ..Plane::default() };
        let mut drives = Drives::new(lagr(), plane, 0.0);
        let mut seen = [false; 2];
        drives.run_watched(Drive::Speeds([0.25; 2]), 8.0, |_, vehicle| {
            let pressed = vehicle.contacts.pressed();
            seen = [seen[0] | pressed[0], seen[1] | pressed[1]];
        });
        assert_eq!(seen, expected, "post at y = {y}");
    }
}

/// Drives into a post; returns whether that is a collision.
fn collides(post: DVec2, drive: [f64; 2], person: bool) -> bool {
    let plane = Plane { posts: vec![(post, 0.06)], person, ..Plane::default() };
    let mut drives = Drives::new(lagr(), plane, 0.0);
    let mut contacts = 0;
    let mut collisions = 0;
    drives.run_watched(Drive::Speeds(drive), 6.0, |_, vehicle| {
        contacts += vehicle.contacts.list().len();
        collisions += vehicle.contacts.list().iter().filter(|contact| contact.collided).count();
    });
    assert!(contacts > 0, "never touched");
    collisions > 0
}

#[test]
fn a_collision_is_fast_or_off_the_bumper_or_with_a_person() {
    let ahead = DVec2::new(1.2, 0.0);
    assert!(!collides(ahead, [0.25; 2], false), "slow and on the bumper");
    assert!(collides(ahead, [0.6; 2], false), "fast");
    assert!(collides(ahead, [0.25; 2], true), "a person");
    let beside_the_tail = DVec2::new(-0.6, 0.5);
    assert!(collides(beside_the_tail, [0.15, -0.15], false), "off the bumper");
}

#[test]
fn nothing_is_driven_through() {
    for speed in [0.3, 1.3] {
        let plane = Plane { posts: vec![(DVec2::new(2.0, 0.03), 0.02)], ..Plane::default() };
        let mut drives = Drives::new(lagr(), plane, 0.0);
        let front = drives.spec.body.front_m;
        drives.run_watched(Drive::Speeds([speed; 2]), 10.0, |t, vehicle| {
            let reach = vehicle.at().x + front;
            assert!(reach < 2.0, "{t} s: front is at {reach} m");
        });
    }
}

#[test]
fn a_turn_on_the_spot_is_that_of_the_wheels_less_their_slip() {
    let mut drives = Drives::new(lagr(), Plane::default(), 0.0);
    golden("turn_on_the_spot.csv", &mut drives, &[(Drive::Speeds([-0.2, 0.2]), 3.0)]);
    let kinematic = 0.4 / drives.spec.wheels.track_m;
    let got = drives.vehicle.motion.yaw_rate_radps;
    assert!(got < kinematic && got > 0.97 * kinematic, "got {got}, without slip {kinematic}");
    assert!(drives.vehicle.at().length() < 0.01);
}

#[test]
fn a_side_slope_makes_it_drift_and_lean() {
    let plane = Plane { slope_y: 0.25, ..Plane::default() };
    let mut drives = Drives::new(lagr(), plane, 0.0);
    drives.run(Drive::Speeds([1.0; 2]), 10.0);
    let [roll, pitch, _] = drives.vehicle.pose.rpy();
    assert!((roll - libm::atan(0.25)).abs() < 0.02 && pitch.abs() < 0.02, "{roll} {pitch}");
    let share = libm::tan(roll) / drives.plane.traction;
    let expected = -drives.spec.wheels.side_slip_at_limit * share * drives.speed();
    let got = drives.vehicle.side_mps;
    assert!((got / expected - 1.0).abs() < 0.1, "got {got}, expected {expected}");
}

#[test]
fn a_low_ledge_is_climbed_and_a_high_one_stops_it() {
    for (ledge_m, climbs) in [(0.06, true), (0.2, false)] {
        let plane = Plane { ledge_m, ledge_x_m: 1.5, ..Plane::default() };
        let mut drives = Drives::new(lagr(), plane, 0.0);
        drives.run(Drive::Speeds([0.8; 2]), 6.0);
        assert_eq!(drives.vehicle.at().x > 2.5, climbs, "{ledge_m} m: at {}", drives.vehicle.at().x);
        let collided = drives.vehicle.contacts.list().iter().any(|contact| contact.collision);
        assert_eq!(collided, !climbs);
    }
}

#[test]
fn it_turns_over_where_the_slope_is_too_steep_and_then_only_coasts() {
    let plane = Plane { slope_y: 1.2, ..Plane::default() };
    let mut drives = Drives::new(lagr(), plane, 0.0);
    drives.run(Drive::Speeds([1.0; 2]), 1.0);
    assert!(drives.vehicle.turned_over);
    assert!(drives.vehicle.motion.rim_mps[0].abs() < 0.05);
}

#[test]
fn at_rest_the_inertial_sensors_feel_gravity_alone() {
    let plane = Plane { slope_x: 0.1, slope_y: -0.2, ..Plane::default() };
    let mut drives = Drives::new(lagr(), plane, 0.7);
    drives.run(Drive::Brake, 2.0);
    let expected = drives.vehicle.pose.rotation.conjugate() * (glam::DVec3::Z * GRAVITY_MPS2);
    assert!(drives.vehicle.force_mps2.abs_diff_eq(expected, 1e-3), "{}", drives.vehicle.force_mps2);
    assert!(drives.vehicle.turn_radps.length() < 1e-6);
}

#[test]
fn gyros_add_up_to_the_turn() {
    let mut drives = Drives::new(lagr(), Plane { slope_x: 0.1, ..Plane::default() }, 0.0);
    let mut attitude = drives.vehicle.pose.rotation;
    drives.run_watched(Drive::Speeds([0.1, 0.4]), 5.0, |_, vehicle| {
        attitude *= glam::DQuat::from_scaled_axis(vehicle.turn_radps * STEP_S);
    });
    let error = attitude.angle_between(drives.vehicle.pose.rotation);
    assert!(error < 1e-3, "{error} rad");
}

#[test]
fn the_tractor_steers_after_its_delay_and_no_sharper_than_it_can() {
    let mut drives = Drives::new(tractor(), Plane::default(), 0.0);
    drives.run(Drive::Speeds([3.0; 2]), 10.0);
    let mut trace = Trace::new(&["t_s", "curvature_per_m", "speed_mps", "yaw_rate_radps"]);
    let command = DriveCommand { drive: Drive::Speeds([3.0; 2]), curvature_per_m: 0.5 };
    let steering = drives.spec.steering.unwrap();
    for step in 1..=300 {
        drives.vehicle.step(&drives.spec, &drives.plane, command, 1.0);
        let t = f64::from(step) * STEP_S;
        let curvature = drives.vehicle.curvature_per_m;
        if t < steering.delay_s - 0.5 * STEP_S {
            assert_eq!(curvature, 0.0, "{t} s");
        }
        assert!(curvature <= steering.max_curvature_per_m);
        if step % 10 == 0 {
            trace.row(&[t, curvature, drives.speed(), drives.vehicle.motion.yaw_rate_radps]);
        }
    }
    trace.check(env!("CARGO_MANIFEST_DIR"), "tractor_steering.csv");
    let after = steering.delay_s + steering.time_constant_s;
    assert!(drives.vehicle.curvature_per_m > 0.99 * steering.max_curvature_per_m, "settled after {after} s");
}
