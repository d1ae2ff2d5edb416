//! How fast the simulation is: a step of the vehicle, its process in a stack, a stereo pair, each on one thread.
//! `cargo run --release -p rcs-sim --example speed`
//! Arguments: a world file, and a vehicle file.

#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "a program for developers")]
#![allow(clippy::disallowed_methods, reason = "it reads files and a clock, and is no plugin")]

use glam::DVec2;
use rcs_msg::Stamp;
use rcs_runtime::{Asset, Assets, Plan, PlanOptions, ProcessType, RunOptions, StackFile, Stepped};
use rcs_sim::drive::Drive;
use rcs_sim::scene::Scenery;
use rcs_sim::spec::VehicleSpec;
use rcs_sim::vehicle::{Vehicle, Wish};
use rcs_sim::{SimCameras, SimVehicle};
use std::sync::Arc;

/// Time that this thread has had a core, s: on a busy machine a clock would say more. Linux only.
fn busy_s() -> f64 {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap();
    text.split_whitespace().next().unwrap().parse::<f64>().unwrap() * 1e-9
}

struct Files([String; 2]);

impl Assets for Files {
    fn read(&self, kind: &str, name: &str, _beside: &str) -> Result<Asset, String> {
        let text = if kind == "world" { &self.0[0] } else { &self.0[1] };
        Ok(Asset { file: name.to_owned(), text: text.clone() })
    }
}

/// Runs a stack for simulated seconds; seconds of a core for each.
fn run(files: &Files, processes: &str, seconds: u64) -> f64 {
    let text = format!("format = 1\nname = \"speed\"\n{processes}");
    let plugins = &[ProcessType::of::<SimCameras>(), ProcessType::of::<SimVehicle>()];
    let options = PlanOptions { overrides: &[], course: None, assets: files };
    let plan = Plan::with(StackFile::parse("speed", &text).unwrap(), plugins, &options).unwrap();
    let mut run = Stepped::new(Arc::new(plan), None, RunOptions::default()).unwrap();
    run.begin().unwrap();
    // The first second makes the world and the map.
    run.run_until(Stamp(1_000_000_000)).unwrap();
    let from = busy_s();
    run.run_until(Stamp((1 + seconds) * 1_000_000_000)).unwrap();
    (busy_s() - from) / seconds as f64
}

const VEHICLE: &str = r#"
[[process]]
name = "vehicle"
plugin = "sim_vehicle"
supervisor = "viewer"
params = { world = "w", vehicle = "v", start_east_m = 10.0, start_north_m = 45.0, map_period_s = 0.0 }
"#;

fn eyes(pair: &str, noise: bool, truth: bool) -> String {
    format!(
        r#"
[[process]]
name = "eyes_{pair}"
plugin = "sim_cameras"
supervisor = "viewer"
inputs = {{ truth_state = "/vehicle/truth_state" }}
params = {{ world = "w", vehicle = "v", pair = "{pair}", noise = {noise}, truth = {truth} }}
"#
    )
}

fn main() {
    let args: Vec<String> = std::env::args().collect();
    let path = |index: usize, default: &str| args.get(index).cloned().unwrap_or_else(|| default.to_owned());
    let world = std::fs::read_to_string(path(1, "assets/worlds/meadow.toml")).unwrap();
    let vehicle = std::fs::read_to_string(path(2, "assets/vehicles/lagr.toml")).unwrap();

    let from = busy_s();
    let scenery = Scenery::from_toml(&world).unwrap();
    println!("world: {:.0} ms to make", (busy_s() - from) * 1e3);
    let spec = VehicleSpec::from_toml(&vehicle).unwrap();
    let mut driven = Vehicle::new(&spec, &scenery, DVec2::new(10.0, 45.0), 0.0);
    let wish = Wish { drive: Drive::Speeds([0.9, 1.0]), curvature_per_m: 0.05 };
    let steps = 100_000;
    let from = busy_s();
    for _ in 0..steps {
        driven.step(&spec, &scenery, wish, 1.0);
    }
    println!("vehicle: {:.2} us a step of 10 ms", (busy_s() - from) * 1e6 / f64::from(steps));

    let files = Files([world, vehicle]);
    let alone = run(&files, VEHICLE, 100);
    println!("sim_vehicle in a stack: {:.1} times real time", 1.0 / alone);
    for (noise, truth) in [(true, true), (false, true), (true, false)] {
        let both = format!("{VEHICLE}{}{}", eyes("left", noise, truth), eyes("right", noise, truth));
        let cost = run(&files, &both, 5) - alone;
        println!("four eyes (noise {noise}, truth {truth}): {cost:.3} of a core");
    }
}
