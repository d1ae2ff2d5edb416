//! The determinism gate: every plugin and every bundled stack gives the same bytes on one thread and on two, and
//! continues with the same bytes from snapshots in memory and on disk.

use crate::bundled;
use rcs_log::Log;
use rcs_msg::rcs::CourseRun;
use rcs_msg::{AnyMessage, Stamp, rcs};
use rcs_planner::PlannerCommand;
use rcs_planner::proto::PlannerGoal;
use rcs_runtime::{
    CommandSet as _, ExternalEvent, Plan, ProcessPlan, RecordOptions, RecordWhat, Recording, RunOptions,
    Snapshot, Stepped,
};
use rcs_testkit::bench;
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
    /// Names of the processes that need not write anything within that time.
    silent: &'a [Silent],
}

/// The name of a process that writes nothing, and why.
type Silent = (&'static str, &'static str);

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
        let silent = self.wrote_nothing(&through);
        assert!(silent.is_empty(), "{name}: wrote nothing, so their outputs are not compared: {silent:#?}");
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

    /// The processes with outputs that have written into none of their own, with what they say of it; without those
    /// that need not write. An output that several processes share is nobody's own.
    fn wrote_nothing(&self, run: &Stepped) -> Vec<String> {
        let plan = &self.plan;
        let name = |buffer: usize| plan.buffers[buffer].spec.name.as_str();
        let writers =
            |buffer: usize| plan.processes.iter().filter(|process| process.outputs.contains(&buffer)).count();
        let is_silent = |process: &&ProcessPlan| {
            let has_sent = |&output: &usize| writers(output) == 1 && bench::sent(run, name(output)) > 0;
            !process.outputs.is_empty() && !process.outputs.iter().any(has_sent)
        };
        let needs_not = |process: &ProcessPlan| self.silent.iter().any(|(name, _)| *name == &*process.name);
        let told = |process: &ProcessPlan| {
            let status: Option<rcs::Status> = bench::newest(run, name(process.status_buffer));
            format!("{}: {}", process.name, status.map(|status| status.state_text).unwrap_or_default())
        };
        plan.processes.iter().filter(is_silent).filter(|process| !needs_not(process)).map(told).collect()
    }
}

/// Number of snapshots per run.
const MOMENTS: usize = 2;

/// What a bundled stack runs on.
#[derive(Clone, Copy)]
enum On {
    /// A bundled course.
    Course(&'static str),
    /// A recording of the public datasets; nothing is tested if they are absent.
    Log(&'static str),
    /// A recording of what this stack drives, of the topics that the other one reads.
    Drive(fn() -> Arc<Plan>),
}

/// How a bundled stack goes through the gate: what it runs on, the range of times of the snapshots, s, and the seed of
/// their moments.
#[derive(Clone, Copy)]
struct Gate {
    stack: &'static str,
    on: On,
    times_s: [f64; 2],
    seed: u64,
    silent: &'static [Silent],
}

impl Gate {
    const fn new(stack: &'static str, on: On, times_s: [f64; 2], seed: u64) -> Gate {
        Gate { stack, on, times_s, seed, silent: &[] }
    }

    const fn silent(self, silent: &'static [Silent]) -> Gate {
        Gate { silent, ..self }
    }

    fn check(&self) {
        match self.on {
            On::Course(course) => self.check_on(bundled::plan(self.stack, course, &[]), None),
            On::Log(log) => {
                let Some(folder) = rcs_testkit::data_dir() else { return };
                let log = Log::open(folder.join("real-logs").join(log)).unwrap();
                self.check_on(bundled::plan_of(self.stack), Some(&log));
            }
            On::Drive(drive) => {
                let folder = tempfile::tempdir().unwrap();
                let plan = bundled::plan_of(self.stack);
                let log = recorded_drive(&plan, &drive(), self.times_s[1], &folder.path().join("drive.mcap"));
                self.check_on(plan, Some(&log));
            }
        }
    }

    fn check_on(&self, plan: Arc<Plan>, log: Option<&Log>) {
        let &Gate { times_s: [from_s, until_s], silent, .. } = self;
        Case { plan, log, from_s, until_s, silent }.check(self.seed);
    }
}

/// A recording of what a stack drives, of the topics that the other one reads.
fn recorded_drive(stack: &Plan, drive: &Arc<Plan>, until_s: f64, path: &Path) -> Log {
    let mut run = Stepped::new(Arc::clone(drive), None, RunOptions::default()).unwrap();
    let topics = stack.inputs.iter().map(|input| input.topic.clone()).collect();
    let options =
        RecordOptions { lossless: true, what: RecordWhat::Buffers(topics), ..RecordOptions::default() };
    let recording = Recording::start(path, drive, run.buffers(), &options).unwrap();
    run.begin().unwrap();
    run.run_until(Stamp((until_s * 1e9) as u64)).unwrap();
    recording.finish().unwrap();
    Log::open(path).unwrap()
}

/// The drive of `ocu sample`.
fn sample_drive() -> Arc<Plan> {
    bundled::plan_from_text("sample_drive.toml", include_str!("../../ocu/app/src/sample_drive.toml"))
}

/// A simulated robot that nobody drives.
fn standing() -> Arc<Plan> {
    bundled::plan("simulation", "meadow", &[])
}

/// Makes a test of each bundled stack, and the list of them all.
macro_rules! gate {
    ($($test:ident: $gate:expr;)+) => {
        const GATE: &[Gate] = &[$($gate),+];
        $(#[test]
        fn $test() {
            let gate: Gate = $gate;
            gate.check();
        })+
    };
}

gate! {
    the_truth_driver_goes_on_from_any_moment:
        Gate::new("truth_driver", On::Course("corridor"), [0.0, 8.0], 1);
    the_simulation_goes_on_from_any_moment:
        Gate::new("simulation", On::Course("meadow"), [0.0, 1.5], 2);
    a_robot_that_drives_by_what_it_sees_goes_on_from_any_moment:
        Gate::new("lagr_stereo_only", On::Course("meadow"), [0.5, 3.0], 10);
    a_robot_that_learns_while_it_drives_goes_on_from_any_moment:
        Gate::new("lagr", On::Course("mulch_path"), [0.5, 3.0], 11);
    a_robot_without_stereo_goes_on_from_any_moment:
        Gate::new("lagr_no_stereo", On::Course("mulch_path"), [0.5, 3.0], 12).silent(&[
            ("classifier_left", "no earlier run has learned models for it"),
            ("classifier_right", "no earlier run has learned models for it"),
        ]);
    learning_goes_on_from_any_moment:
        Gate::new("learning", On::Course("mulch_path"), [0.5, 3.0], 3);
    a_range_camera_goes_on_from_any_moment:
        Gate::new("range_camera", On::Log("orfd_y0613_1242_ros2.mcap"), [0.0, 0.9], 4);
    a_terrain_camera_goes_on_from_any_moment:
        Gate::new("terrain_camera", On::Log("orfd_y0613_1242_ros2.mcap"), [0.0, 0.9], 5);
    // Its scan comes after 23.6 s.
    the_forest_robot_goes_on_from_any_moment:
        Gate::new("forest_robot", On::Log("monoforce_tradr_ros2.mcap"), [23.5, 24.8], 6);
    the_sample_goes_on_from_any_moment:
        Gate::new("sample", On::Drive(sample_drive), [0.2, 1.5], 9);
    a_replay_of_the_sensors_goes_on_from_any_moment:
        Gate::new("replay", On::Drive(standing), [0.2, 1.5], 13).silent(&[
            ("classifier_left", "the recorded vehicle stands, from which no models are learned"),
            ("classifier_right", "the recorded vehicle stands, from which no models are learned"),
        ]);
    a_log_without_processes_goes_on_from_any_moment:
        Gate::new("husky", On::Log("husky_outdoor_ros2.mcap"), [0.0, 5.0], 7);
}

#[test]
fn every_bundled_stack_goes_through_the_gate() {
    let checked: BTreeSet<_> = GATE.iter().map(|gate| gate.stack.to_owned()).collect();
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets/stacks");
    let names: BTreeSet<_> = std::fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.is_file())
        .map(|path| path.file_stem().unwrap().to_str().unwrap().to_owned())
        .collect();
    assert_eq!(names, checked, "a new stack belongs into this gate");
}

#[test]
fn a_process_that_writes_nothing_is_found() {
    let plan = bundled::plan("truth_driver", "corridor", &[]);
    let case = Case { plan, log: None, from_s: 0.0, until_s: 0.0, silent: &[("vehicle", "a test")] };
    let found = case.wrote_nothing(&case.fresh(1));
    assert!(found.iter().any(|told| told.starts_with("truth_driver: ")), "{found:?}");
    assert!(!found.iter().any(|told| told.starts_with("vehicle: ")), "it need not write: {found:?}");
    assert!(!found.iter().any(|told| told.starts_with("robot: ")), "it has no outputs: {found:?}");
}

#[test]
fn a_world_that_changes_restarts_a_run_from_disk_as_it_does_one_that_went_through() {
    let plan = bundled::plan("truth_driver", "corridor", &[]);
    let case = Case { plan, log: None, from_s: 0.0, until_s: 4.0, silent: &[] };
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
    Case { plan, log: None, from_s: 0.0, until_s: 1.5, silent: &[] }.check(8);
}

#[test]
fn every_plugin_goes_through_the_gate_without_a_recording() {
    let mut run = run_elsewhere();
    run.extend(plugins_of(&bundled::plan_from_text("rest.toml", &rest())));
    let all: BTreeSet<_> = rcs_plugins::all().iter().map(|kind| kind.def().plugin).collect();
    assert_eq!(run, all, "a new plugin belongs into a stack of this gate");
}

pub(crate) fn plugins_of(plan: &Plan) -> impl Iterator<Item = &'static str> {
    plan.processes.iter().map(|process| process.kind.def().plugin)
}

/// Plugins of the bundled stacks that run on a course.
fn run_elsewhere() -> BTreeSet<&'static str> {
    let plan = |gate: &Gate| match gate.on {
        On::Course(course) => Some(bundled::plan(gate.stack, course, &[])),
        On::Log(_) | On::Drive(_) => None,
    };
    let plans: Vec<_> = GATE.iter().filter_map(plan).collect();
    plans.iter().flat_map(|plan| plugins_of(plan)).collect()
}

/// [`REST`], and every plugin that is in no stack yet: each required input reads a buffer of its type, or waits for an
/// operator. A new plugin is therefore in the gate from its first day; a stack of its own makes it do more there.
pub(crate) fn rest() -> String {
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
