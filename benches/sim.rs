//! The simulation: a step of the vehicle, a second of its process in a stack, a second of four cameras in each bundled
//! world, a sweep of a ladar.
//!
//! The bars: 0.35 s for a second of four cameras (0.35 of a core), and 20 ms for a second of the vehicle (50 times real
//! time). Rays: 4 cameras, 5 images, 320×240.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use glam::{DVec2, DVec3};
use rcs_msg::Stamp;
use rcs_runtime::{Asset, Assets, Plan, PlanOptions, ProcessType, RunOptions, StackFile, Stepped};
use rcs_sim::drive::Drive;
use rcs_sim::scene::Scenery;
use rcs_sim::spec::VehicleSpec;
use rcs_sim::vehicle::{DriveCommand, Vehicle};
use rcs_sim::{SimCameras, SimVehicle};
use std::path::Path;
use std::sync::Arc;

const WORLDS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../assets/worlds");
const MEADOW: &str = include_str!("../assets/worlds/meadow.toml");
const LAGR: &str = include_str!("../assets/vehicles/lagr.toml");
const TRACTOR: &str = include_str!("../assets/vehicles/tractor.toml");
/// The start that each bundled world suggests.
const START: DVec2 = DVec2::new(10.0, 45.0);

struct Files;

impl Assets for Files {
    fn read(&self, kind: &str, name: &str, _beside: &str) -> Result<Asset, String> {
        let text = match kind {
            "world" => {
                let path = Path::new(WORLDS).join(format!("{name}.toml"));
                std::fs::read_to_string(&path).map_err(|error| format!("{error}: {}", path.display()))?
            }
            _ => LAGR.to_owned(),
        };
        Ok(Asset { file: name.to_owned(), text })
    }
}

/// Names of the bundled worlds.
fn worlds() -> Vec<String> {
    let files = std::fs::read_dir(WORLDS).expect("the folder of the worlds");
    let paths = files.map(|file| file.expect("a file").path());
    let names = paths.filter_map(|path| path.file_name()?.to_str()?.strip_suffix(".toml").map(str::to_owned));
    let mut names: Vec<String> = names.collect();
    names.sort();
    names
}

/// A run that has begun; the first second computes the world and the map.
fn begun(processes: &str) -> Stepped {
    let text = format!("format = 1\nname = \"speed\"\n{processes}");
    let plugins = &[ProcessType::of::<SimCameras>(), ProcessType::of::<SimVehicle>()];
    let options = PlanOptions { overrides: &[], course: None, assets: &Files };
    let file = StackFile::parse("speed", &text).expect("a sound stack");
    let plan = Plan::with(file, plugins, &options).expect("a stack that can run");
    let mut run = Stepped::new(Arc::new(plan), None, RunOptions::default()).expect("a run");
    run.begin().expect("a beginning");
    run.run_until(Stamp(1_000_000_000)).expect("a second");
    run
}

fn driven(world: &str) -> String {
    format!(
        "[[process]]\nname = \"vehicle\"\nplugin = \"sim_vehicle\"\nsupervisor = \"viewer\"\n\
         params = {{ world = \"{world}\", vehicle = \"v\", start_east_m = {:?}, start_north_m = {:?}, map_period_s = 0.0 }}\n",
        START.x, START.y
    )
}

fn cameras(world: &str, pair: &str) -> String {
    format!(
        "[[process]]\nname = \"front_{pair}\"\nplugin = \"sim_cameras\"\nsupervisor = \"viewer\"\n\
         inputs = {{ ground_truth_state = \"/vehicle/ground_truth_state\" }}\n\
         params = {{ world = \"{world}\", vehicle = \"v\", pair = \"front_{pair}\" }}\n"
    )
}

fn seconds(criterion: &mut Criterion, name: &str, elements: u64, processes: &str) {
    let mut group = criterion.benchmark_group("sim/second");
    group.sample_size(10).throughput(Throughput::Elements(elements));
    // Begun only where the bench is asked for.
    let mut run = None;
    let mut second = 1;
    group.bench_function(name, |bench| {
        let run = run.get_or_insert_with(|| begun(processes));
        bench.iter(|| {
            second += 1;
            run.run_until(Stamp(second * 1_000_000_000)).expect("a second");
        });
    });
}

fn simulation(criterion: &mut Criterion) {
    let scenery = Scenery::from_toml(MEADOW).expect("a sound world");
    let spec = VehicleSpec::from_toml(LAGR).expect("a sound vehicle");
    let mut vehicle = Vehicle::new(&spec, &scenery, START, 0.0);
    let command = DriveCommand { drive: Drive::Speeds([0.9, 1.0]), curvature_per_m: 0.0 };
    criterion.bench_function("sim/vehicle_step/10ms", |bench| {
        bench.iter(|| vehicle.step(&spec, &scenery, command, 1.0));
    });

    seconds(criterion, "vehicle", 100, &driven("meadow"));
    let rays = 4 * 5 * 320 * 240;
    for world in worlds() {
        let processes = [driven(&world), cameras(&world, "left"), cameras(&world, "right")].concat();
        seconds(criterion, &format!("cameras/{world}"), rays, &processes);
    }

    let tractor = VehicleSpec::from_toml(TRACTOR).expect("a sound vehicle");
    let ladar = tractor.ladar("ladar_roof").expect("a ladar");
    let origin = START.extend(scenery.world.height_m(START)) + DVec3::Z * ladar.mount.position.z;
    let directions: Vec<DVec3> = (0..ladar.lines).flat_map(|line| ladar.directions(line)).collect();
    let mut group = criterion.benchmark_group("sim/ladar_sweep");
    group.throughput(Throughput::Elements(directions.len() as u64));
    group.bench_function(format!("{}x{}", ladar.rays, ladar.lines), |bench| {
        bench.iter(|| {
            let hits =
                directions.iter().filter_map(|ray| scenery.world.cast(origin, *ray, ladar.max_range_m));
            hits.map(|hit| hit.range_m).sum::<f64>()
        });
    });
}

criterion_group!(benches, simulation);
criterion_main!(benches);
