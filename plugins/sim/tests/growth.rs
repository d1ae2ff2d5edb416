//! Vegetation and soft ground: what stops a vehicle, what gives way, and what costs speed.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

mod common;

use common::lagr;
use glam::DVec2;
use rcs_sim::drive::Drive;
use rcs_sim::scene::Scenery;
use rcs_sim::spec::VehicleSpec;
use rcs_sim::terrain::Terrain;
use rcs_sim::vehicle::{DriveCommand, STEP_S, Vehicle};

const FIELD: &str = r#"
name = "field"
bounds_m = [[0, 0], [40, 30]]
base = "short_grass"
origin = { zone = 18, easting_m = 308000, northing_m = 4333000 }
surface = { mud = { traction = 0.34, rolling_resistance = 0.16, slip_at_limit = 0.7 } }
paint = [
    { surface = "thicket", polygon = [[20, 4], [24, 4], [24, 16], [20, 16]], edge_m = 0 },
    { surface = "tall_grass", polygon = [[10, 20], [30, 20], [30, 24], [10, 24]], edge_m = 0 },
    { surface = "mud", polygon = [[10, 25], [30, 25], [30, 29], [10, 29]], edge_m = 0 },
]
"#;

struct Drives {
    spec: VehicleSpec,
    field: Scenery,
    vehicle: Vehicle,
}

impl Drives {
    fn from(x: f64, y: f64, yaw_deg: f64) -> Drives {
        let (spec, field) = (lagr(), Scenery::from_toml(FIELD).unwrap());
        let vehicle = Vehicle::new(&spec, &field, DVec2::new(x, y), yaw_deg.to_radians());
        Drives { spec, field, vehicle }
    }

    /// Drives with these wheel speeds; returns the number of new collisions and the greatest speed.
    fn drive(&mut self, wheels_mps: [f64; 2], seconds: f64) -> (usize, f64) {
        let (mut collisions, mut fastest) = (0, 0.0_f64);
        for _ in 0..(seconds / STEP_S).round() as usize {
            let command = DriveCommand { drive: Drive::Speeds(wheels_mps), curvature_per_m: 0.0 };
            self.vehicle.step(&self.spec, &self.field, command, 1.0);
            collisions += self.vehicle.contacts.list().iter().filter(|contact| contact.collided).count();
            fastest = fastest.max(self.vehicle.motion.speed_mps);
        }
        (collisions, fastest)
    }

    fn front(&self) -> f64 {
        self.vehicle.at().x + self.spec.body.front_m + self.spec.bumper.travel_m
    }
}

#[test]
fn a_thicket_stops_a_vehicle_at_its_edge_and_the_bumper_feels_it() {
    let mut drives = Drives::from(16.0, 10.0, 0.0);
    let (collisions, _) = drives.drive([0.25; 2], 18.0);
    assert!((drives.front() - 20.0).abs() < 0.12, "stopped at {}", drives.front());
    assert_eq!(drives.vehicle.contacts.pressed(), [true; 2]);
    assert_eq!(collisions, 0, "a touch at 0.25 m/s is none");
    assert_eq!(drives.field.kind(drives.vehicle.contacts.list()[0].thing), "thicket");
    let before = drives.vehicle.at().x;
    drives.drive([-0.5; 2], 2.0);
    assert!(drives.vehicle.at().x < before - 0.7, "it comes out backwards");
    assert_eq!(drives.vehicle.contacts.pressed(), [false; 2]);
}

#[test]
fn a_fast_touch_of_a_thicket_is_a_collision_and_does_not_lead_into_it() {
    for (yaw_deg, x) in [(0.0, 16.0), (30.0, 15.0), (-20.0, 16.0)] {
        let mut drives = Drives::from(x, 10.0, yaw_deg);
        let (collisions, _) = drives.drive([1.2; 2], 8.0);
        assert!(collisions >= 1, "at {yaw_deg}°");
        let inside = drives.field.world.ground(drives.vehicle.at());
        assert!(inside.passable && drives.front() < 21.0, "at {yaw_deg}°: {}", drives.front());
    }
}

#[test]
fn a_vehicle_beside_a_thicket_is_not_held() {
    // Its left side is 10 cm from the southern border.
    let mut drives = Drives::from(17.0, 4.0 - 0.05 - 0.33 - 0.1, 0.0);
    let (collisions, _) = drives.drive([1.0; 2], 8.0);
    assert!(collisions == 0 && drives.vehicle.at().x > 24.0, "{}", drives.vehicle.at());
}

#[test]
fn tall_grass_gives_way_and_soft_ground_costs_speed() {
    let speed = |y: f64| {
        let mut drives = Drives::from(12.0, y, 0.0);
        drives.drive([1.2; 2], 6.0);
        assert_eq!(drives.vehicle.contacts.list(), [], "nothing is touched");
        (drives.vehicle.motion.speed_mps, drives.vehicle.slip[0])
    };
    let ((meadow, _), (grass, _), (mud, slip)) = (speed(18.0), speed(22.0), speed(27.0));
    assert!(meadow > 1.15 && grass > 1.1, "{meadow} {grass}");
    // Force 150 N of at most 216 N at a slip of 0.7.
    assert!((0.5..0.75).contains(&mud) && (slip - 0.49).abs() < 0.05, "{mud} {slip}");
}
