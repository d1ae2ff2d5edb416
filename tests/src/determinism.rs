//! The determinism gate: every plugin and every bundled stack gives the same bytes on one thread and on two, and
//! continues with the same bytes from snapshots in memory and on disk.

use crate::bundled;
use rcs_log::Log;
use rcs_msg::rcs::CourseRun;
use rcs_msg::{AnyMessage, Stamp, rcs};
use rcs_planner::PlannerCommand;
use rcs_planner::proto::PlannerGoal;
use rcs_runtime::{
    CommandSet as _, ExternalEvent, Plan, RecordOptions, RecordWhat, Recording, RunOptions, Snapshot, Stepped,
};
use std::collections::BTreeSet;
use std::path::Path;
use std::sync::Arc;

/// Deterministic pseudo-random numbers: splitmix64.
struct Numbers(u64);

impl Numbers {
    fn below(&mut self, end: u64) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        (z ^ (z >> 31)) % end
    }
}

/// A stack with or without a log, and the range of times in which snapshots are taken, s after its start.
struct Case<'a> {
    plan: Arc<Plan>,
    log: Option<&'a Log>,
    from_s: f64,
    until_s: f64,
}

impl Case<'_> {
    fn begun(&self, threads: usize) -> Stepped {
        let mut run = self.fresh(threads);
        run.begin().unwrap();
        let of_viewer = |process: &rcs_runtime::ProcessPlan| process.supervisor.is_none();
        if self.plan.processes.iter().any(|process| &*process.name == "planner" && of_viewer(process)) {
            let order =
                PlannerCommand::PlanTo(PlannerGoal { x_m: 9.0, y_m: 4.0, ..PlannerGoal::default() }).encode();
            let (parameters_schema, parameters) = order.parameters;
            let (name, parameters) = (order.name.to_owned(), parameters.into());
            let command =
                rcs::Command { serial: 100, name, parameters_schema, parameters, ..rcs::Command::default() };
            run.take(ExternalEvent::operator("/planner/command", AnyMessage::new(command))).unwrap();
        }
        run
    }

    fn fresh(&self, threads: usize) -> Stepped {
        let options = RunOptions { threads, hash: true, seed: 3, ..RunOptions::default() };
        Stepped::new(Arc::clone(&self.plan), self.log, options).unwrap()
    }

    fn end(&self, run: &Stepped) -> Stamp {
        run.start().after_ns((self.until_s * 1e9) as u64)
    }

    /// Runs to the end; returns the number of events and the hash of all messages.
    fn finish(&self, run: &mut Stepped) -> (u64, String) {
        run.run_until(self.end(run)).unwrap();
        (run.events(), run.summary().hash.unwrap())
    }

    /// Runs the stack, takes snapshots at random events, and continues from each.
    fn check(&self, seed: u64) {
        let name = self.plan.file.name();
        let mut through = self.begun(1);
        through.run_until(through.start().after_ns((self.from_s * 1e9) as u64)).unwrap();
        let first = through.events();
        let expected = self.finish(&mut through);
        drop(through);

        let mut numbers = Numbers(seed);
        let mut moments: Vec<u64> =
            (0..MOMENTS).map(|_| first + numbers.below((expected.0 - first).max(1))).collect();
        moments.sort_unstable();

        let mut run = self.begun(2);
        let mut kept = Vec::new();
        for &moment in &moments {
            while run.events() < moment {
                run.advance().unwrap();
            }
            let snapshot = run.snapshot();
            let bytes = snapshot.to_bytes().unwrap();
            let told = format!("{name} at event {moment}");
            assert!(snapshot.to_bytes().unwrap() == bytes, "{told}: one snapshot, twice as bytes");
            assert!(run.snapshot().to_bytes().unwrap() == bytes, "{told}: two snapshots of one moment");
            kept.push((told, snapshot, bytes));
        }
        assert_eq!(self.finish(&mut run), expected, "{name}: two threads, kept on the way");

        for (told, snapshot, bytes) in &kept {
            run.restore(snapshot).unwrap();
            assert!(run.snapshot().to_bytes().unwrap() == *bytes, "{told}: kept again after memory");
            assert_eq!(self.finish(&mut run), expected, "{told}: from memory");

            let mut run = self.fresh(1);
            run.restore(&Snapshot::from_bytes(bytes).unwrap()).unwrap();
            assert!(run.snapshot().to_bytes().unwrap() == *bytes, "{told}: kept again after disk");
            assert_eq!(self.finish(&mut run), expected, "{told}: from disk");
        }
    }
}

/// Number of snapshots per run.
const MOMENTS: usize = 2;

/// A bundled stack on a course.
fn check_course(stack: &str, course: &str, [from_s, until_s]: [f64; 2], seed: u64) {
    let plan = bundled::plan(stack, course, &[]);
    Case { plan, log: None, from_s, until_s }.check(seed);
}

/// A bundled stack on a recording; `None` if the recordings are absent.
fn check_log(stack: &str, log: &str, [from_s, until_s]: [f64; 2], seed: u64) {
    let Some(folder) = rcs_testkit::data_dir() else { return };
    let log = Log::open(folder.join("real-logs").join(log)).unwrap();
    Case { plan: bundled::plan_of(stack), log: Some(&log), from_s, until_s }.check(seed);
}

#[test]
fn the_truth_driver_goes_on_from_any_moment() {
    check_course("truth_driver", "corridor", [0.0, 8.0], 1);
}

#[test]
fn the_simulation_goes_on_from_any_moment() {
    check_course("simulation", "meadow", [0.0, 1.5], 2);
}

#[test]
fn a_robot_that_drives_by_what_it_sees_goes_on_from_any_moment() {
    check_course("lagr_stereo_only", "meadow", [0.5, 3.0], 10);
}

#[test]
fn a_robot_that_learns_while_it_drives_goes_on_from_any_moment() {
    check_course("lagr", "mulch_path", [0.5, 3.0], 11);
}

#[test]
fn a_robot_without_stereo_goes_on_from_any_moment() {
    check_course("lagr_no_stereo", "mulch_path", [0.5, 3.0], 12);
}

#[test]
fn learning_goes_on_from_any_moment() {
    check_course("learning", "mulch_path", [0.5, 3.0], 3);
}

#[test]
fn a_range_camera_goes_on_from_any_moment() {
    check_log("range_camera", "orfd_y0613_1242_ros2.mcap", [0.0, 0.9], 4);
}

#[test]
fn a_terrain_camera_goes_on_from_any_moment() {
    check_log("terrain_camera", "orfd_y0613_1242_ros2.mcap", [0.0, 0.9], 5);
}

#[test]
fn the_forest_robot_goes_on_from_any_moment() {
    // Its scan comes after 23.6 s.
    check_log("forest_robot", "monoforce_tradr_ros2.mcap", [23.5, 24.8], 6);
}

/// A stack on a recording of what another one drives: of the topics that it reads.
fn check_drive(stack: Arc<Plan>, drive: &Arc<Plan>, until_s: f64, seed: u64) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("drive.mcap");
    let mut run = Stepped::new(Arc::clone(drive), None, RunOptions::default()).unwrap();
    let topics = stack.inputs.iter().map(|input| input.topic.clone()).collect();
    let options =
        RecordOptions { lossless: true, what: RecordWhat::Buffers(topics), ..RecordOptions::default() };
    let recording = Recording::start(&path, drive, run.buffers(), &options).unwrap();
    run.begin().unwrap();
    run.run_until(Stamp((until_s * 1e9) as u64)).unwrap();
    recording.finish().unwrap();
    let log = Log::open(&path).unwrap();
    Case { plan: stack, log: Some(&log), from_s: 0.2, until_s }.check(seed);
}

#[test]
fn the_sample_goes_on_from_any_moment() {
    const DRIVE: &str = include_str!("../../ocu/app/src/sample_drive.toml");
    let drive = bundled::plan_from_text("sample_drive.toml", DRIVE);
    check_drive(bundled::plan_of("sample"), &drive, 1.5, 9);
}

#[test]
fn a_replay_of_the_sensors_goes_on_from_any_moment() {
    let drive = bundled::plan("simulation", "meadow", &[]);
    check_drive(bundled::plan("replay", "meadow", &[]), &drive, 1.5, 13);
}

#[test]
fn a_log_without_processes_goes_on_from_any_moment() {
    check_log("husky", "husky_outdoor_ros2.mcap", [0.0, 5.0], 7);
}

#[test]
fn a_world_that_changes_restarts_a_run_from_disk_as_it_does_one_that_went_through() {
    let case =
        Case { plan: bundled::plan("truth_driver", "corridor", &[]), log: None, from_s: 0.0, until_s: 4.0 };
    let mut through = case.begun(1);
    through.run_until(Stamp(2_000_000_000)).unwrap();
    let bytes = through.snapshot().to_bytes().unwrap();
    let mut from_disk = case.fresh(1);
    from_disk.restore(&Snapshot::from_bytes(&bytes).unwrap()).unwrap();

    let meadow = bundled::plan("truth_driver", "meadow", &[]);
    let vehicle = meadow.processes.iter().find(|process| &*process.name == "vehicle").unwrap();
    // The run has no file of the meadow, so the parameters contain its text.
    let params = meadow.files.resolve(&vehicle.params).unwrap();
    let ends = [&mut through, &mut from_disk].map(|run| {
        run.take(ExternalEvent::operator("/vehicle/params", params.clone())).unwrap();
        case.finish(run)
    });
    assert_eq!(ends[0], ends[1]);
    let verdict: CourseRun =
        from_disk.bus().get("/vehicle/run").unwrap().latest().unwrap().message.to().unwrap();
    assert!(verdict.time_s < 2.1, "the course begins when the world changes: {verdict:?}");
}

/// Plugins that no bundled stack runs without a recording.
const REST: &str = r#"
format = 1
name = "rest"

[[process]]
name = "vehicle"
plugin = "sim_vehicle"
supervisor = "viewer"
params = { world = "meadow", vehicle = "tractor", start_east_m = 10.0, start_north_m = 10.0 }

[[process]]
name = "ladar"
plugin = "sim_ladar"
supervisor = "viewer"
inputs = { ground_truth_state = "/vehicle/ground_truth_state" }
params = { world = "meadow", vehicle = "tractor", ladar = "ladar_roof" }

[[process]]
name = "obstacles"
plugin = "obstacles"
supervisor = "viewer"
inputs = { cloud = "/ladar/cloud", odometry = "/localization/local", static_transforms = "/vehicle/static_transforms" }

[[process]]
name = "localization"
plugin = "localization"
supervisor = "viewer"
inputs = { encoders = "/vehicle/encoders", imu = "/vehicle/imu", gps = "/vehicle/gps" }

[[process]]
name = "cameras"
plugin = "sim_cameras"
supervisor = "viewer"
inputs = { ground_truth_state = "/vehicle/ground_truth_state" }
params = { world = "meadow", vehicle = "tractor", pair = "infrared" }

[[process]]
name = "overlay"
plugin = "label_overlay"
supervisor = "viewer"

[process.inputs]
points = "/obstacles/points"
image = "/cameras/left"
calibration = "/cameras/left_calibration"
static_transforms = "/vehicle/static_transforms"

[[process]]
name = "wm1"
plugin = "world_model"
supervisor = "viewer"
inputs = { stereo = "/obstacles/cost", odometry = "/localization/local" }

[[process]]
name = "planner"
plugin = "planner"
supervisor = "viewer"
inputs = { map = "/wm1/map", odometry = "/localization/local" }
"#;

#[test]
fn a_ladar_and_an_overlay_go_on_from_any_moment() {
    let plan = bundled::plan_from_text("rest.toml", &rest());
    Case { plan, log: None, from_s: 0.0, until_s: 1.5 }.check(8);
}

#[test]
fn every_plugin_goes_through_the_gate_without_a_recording() {
    let mut run = run_elsewhere();
    run.extend(plugins_of(&bundled::plan_from_text("rest.toml", &rest())));
    let all: BTreeSet<_> = rcs_plugins::all().iter().map(|kind| kind.def().plugin).collect();
    assert_eq!(run, all, "a new plugin belongs into a stack of this gate");
}

fn plugins_of(plan: &Plan) -> impl Iterator<Item = &'static str> {
    plan.processes.iter().map(|process| process.kind.def().plugin)
}

/// Plugins of the bundled simulations.
fn run_elsewhere() -> BTreeSet<&'static str> {
    let plans = [
        bundled::plan("truth_driver", "corridor", &[]),
        bundled::plan("simulation", "meadow", &[]),
        bundled::plan("learning", "mulch_path", &[]),
        bundled::plan("lagr_stereo_only", "meadow", &[]),
    ];
    plans.iter().flat_map(|plan| plugins_of(plan)).collect()
}

/// [`REST`], and every plugin that is in no stack yet: each required input reads a buffer of its type, or waits for an
/// operator. A new plugin is therefore in the gate from its first day; a stack of its own makes it do more there.
fn rest() -> String {
    let plan = bundled::plan_from_text("rest.toml", REST);
    let mut known = run_elsewhere();
    known.extend(plugins_of(&plan));
    let mut text = REST.to_owned();
    for kind in rcs_plugins::all().iter().filter(|kind| !known.contains(kind.def().plugin)) {
        let name = kind.def().plugin;
        let wire = |port: &rcs_runtime::PortDef| {
            let of_type = |buffer: &&rcs_runtime::BufferPlan| {
                let is_truth = buffer.spec.metadata.contains_key("rcs.ground_truth");
                buffer.spec.schema.name() == port.schema.name()
                    && (!is_truth || kind.def().reads_ground_truth)
            };
            let waits = format!("/operator/{name}/{}", port.name);
            let buffer = plan.buffers.iter().find(of_type).map_or(waits, |buffer| buffer.spec.name.clone());
            format!("{} = \"{buffer}\"", port.name)
        };
        let wires: Vec<_> = kind.inputs().iter().filter(|port| port.required).map(wire).collect();
        let process = format!(
            "\n[[process]]\nname = \"{name}\"\nplugin = \"{name}\"\nsupervisor = \"viewer\"\ninputs = {{ {} }}\n",
            wires.join(", ")
        );
        text.push_str(&process);
    }
    text
}

#[test]
fn every_bundled_stack_goes_through_the_gate() {
    let checked: BTreeSet<_> = [
        "forest_robot",
        "husky",
        "lagr",
        "lagr_no_stereo",
        "lagr_stereo_only",
        "learning",
        "range_camera",
        "replay",
        "sample",
        "simulation",
        "terrain_camera",
        "truth_driver",
    ]
    .map(str::to_owned)
    .into();
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets/stacks");
    let names: BTreeSet<_> = std::fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.is_file())
        .map(|path| path.file_stem().unwrap().to_str().unwrap().to_owned())
        .collect();
    assert_eq!(names, checked, "a new stack belongs into this gate");
}
