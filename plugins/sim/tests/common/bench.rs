//! Stacks for tests: files from memory, and a driver controlled by the test.

#![allow(dead_code, unreachable_pub, clippy::unwrap_used, reason = "each test takes what it needs")]

use rcs_msg::{Stamp, rcs};
use rcs_runtime::{Asset, Assets, Plan, ProcessType, RunOptions};
use rcs_sim::{SimCameras, SimLadar, SimVehicle};
use rcs_testkit::bench::Setup;
use std::sync::Arc;

pub use rcs_testkit::bench::Bench;

/// A small world: slightly rising dirt, with a tree ahead of the start, a boulder, tall grass and a person.
pub const WORLD: &str = r#"
name = "yard"
seed = 5
bounds_m = [[0, 0], [40, 30]]
base = "dirt"

[origin]
zone = 32
north = true
easting_m = 500000.0
northing_m = 5400000.0

[[undulation]]
wavelength_m = 9
amplitude_m = 0.15

[[paint]]
surface = "tall_grass"
polygon = [[20, 20], [38, 20], [38, 28], [20, 28]]

[[thing]]
kind = "tree"
at = [12, 15.2]
radius_m = 0.2
height_m = 6
crown_radius_m = 1.5

[[thing]]
kind = "boulder"
at = [9, 12]
radius_m = 0.4
height_m = 0.5

[[thing]]
kind = "person"
at = [20, 8]
"#;

/// A course whose goal is ten metres to the east of the start.
pub const COURSE: &str = r#"
format = 1
name = "yard"
description = "across the yard"
world = "yard"
vehicle = "lagr"
time_limit_s = 60
goal_radius_m = 1.0
start = { easting = 500005.0, northing = 5400010.0, heading_deg = 0.0 }
goal = { easting = 500015.0, northing = 5400010.0 }
"#;

pub const STACK: &str = r#"
format = 1
name = "yard"
course = "yard"

[[process]]
name = "vehicle"
plugin = "sim_vehicle"
supervisor = "viewer"
inputs = { wheels = "/operator/wheels" }

[[process]]
name = "front_left"
plugin = "sim_cameras"
supervisor = "viewer"
inputs = { ground_truth_state = "/vehicle/ground_truth_state", image = "/front_left/left" }
params = { pair = "front_left" }

[buffers."/operator/wheels"]
queue = 16

[buffers."/vehicle/gps"]
queue = 256
"#;

/// The files of a test, by kind.
#[derive(Clone, Debug)]
pub struct Files {
    pub world: String,
    pub vehicle: String,
    pub course: String,
}

impl Default for Files {
    fn default() -> Files {
        Files { world: WORLD.to_owned(), vehicle: super::LAGR.to_owned(), course: COURSE.to_owned() }
    }
}

impl Assets for Files {
    fn read(&self, kind: &str, name: &str, _beside: &str) -> Result<Asset, String> {
        let text = match kind {
            "world" => &self.world,
            "vehicle" => &self.vehicle,
            "course" => &self.course,
            _ => return Err(format!("no {kind} here")),
        };
        Ok(Asset { file: format!("{kind}s/{name}.toml"), text: text.clone() })
    }
}

const PLUGINS: &[ProcessType] =
    &[ProcessType::of::<SimCameras>(), ProcessType::of::<SimLadar>(), ProcessType::of::<SimVehicle>()];

/// Plans the stack with these files and parameters; returns the error of an invalid one.
pub fn plan(stack: &str, files: &Files, params: &[(&str, &str)]) -> Result<Arc<Plan>, String> {
    Setup::new(stack, PLUGINS).params(params).assets(files).plan().map_err(|error| error.to_string())
}

/// A bench with a vehicle that the test drives.
pub trait VehicleBench: Sized {
    fn start(stack: &str, files: &Files, params: &[(&str, &str)]) -> Self {
        Self::with_threads(stack, files, params, 1)
    }

    fn with_threads(stack: &str, files: &Files, params: &[(&str, &str)], threads: usize) -> Self;

    /// Sends a command with the current time.
    fn command(&mut self, left_mps: f64, right_mps: f64);

    /// Sends a command with this time.
    fn command_of(&mut self, ms: f64, left_mps: f64, right_mps: f64) {
        self.send(ms, [left_mps, right_mps], 0.0);
    }

    /// Sends a command with the current time to a vehicle with steering.
    fn command_with_curvature(&mut self, speed_mps: f64, curvature_per_m: f64);

    fn send(&mut self, ms: f64, wheels_mps: [f64; 2], curvature_per_m: f64);

    /// Drives for a time with repeated commands.
    fn drive(&mut self, left_mps: f64, right_mps: f64, ms: u64);

    fn state(&self) -> rcs::GroundTruthState;
}

impl VehicleBench for Bench {
    fn with_threads(stack: &str, files: &Files, params: &[(&str, &str)], threads: usize) -> Bench {
        let options = RunOptions { threads, hash: true, ..RunOptions::default() };
        let mut bench = Setup::new(stack, PLUGINS).params(params).assets(files).options(options).bench();
        bench.advance(0);
        bench
    }

    fn command(&mut self, left_mps: f64, right_mps: f64) {
        self.command_of(self.now_ms as f64, left_mps, right_mps);
    }

    fn command_with_curvature(&mut self, speed_mps: f64, curvature_per_m: f64) {
        self.send(self.now_ms as f64, [speed_mps; 2], curvature_per_m);
    }

    fn send(&mut self, ms: f64, [left_mps, right_mps]: [f64; 2], curvature_per_m: f64) {
        let timestamp = Some(Stamp((ms * 1e6) as u64).to_proto());
        let command = rcs::WheelCommand { timestamp, left_mps, right_mps, curvature_per_m };
        self.write("/operator/wheels", command);
    }

    fn drive(&mut self, left_mps: f64, right_mps: f64, ms: u64) {
        for _ in 0..ms / 50 {
            self.command(left_mps, right_mps);
            self.advance(50);
        }
    }

    fn state(&self) -> rcs::GroundTruthState {
        self.latest("/vehicle/ground_truth_state")
    }
}
