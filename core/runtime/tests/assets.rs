//! Files that a stack names, the course that provides them, and the ground truth, which only some processes may read.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

use rcs_msg::{foxglove, rcs};
use rcs_runtime::{
    Asset, Assets, Cycle, In, NoCommands, Out, Plan, PlanOptions, PortBuilder, Process, ProcessDef,
    ProcessType, RunOptions, StackFile, Stepped,
};
use rcs_testkit::proto::FileParams;
use serde::{Deserialize, Serialize};

/// A process whose parameters are files, and that writes ground truth.
#[derive(Clone, Serialize, Deserialize)]
struct World;

impl Process for World {
    type Params = FileParams;
    type Ports = Out<foxglove::Vector3>;
    type Command = NoCommands;
    const DEF: ProcessDef = ProcessDef {
        plugin: "world",
        summary: "Knows.",
        period_ms: 10.0,
        latency_ms: 0.0,
        reads_ground_truth: true,
    };

    fn ports(b: &mut PortBuilder) -> Self::Ports {
        b.output("pose", "Where it really is.").truth().build()
    }

    fn check(params: &Self::Params) -> Result<(), String> {
        if params.world.is_empty() && params.course.contains("needs") {
            return Err("world: got no text, expected that of a world".to_owned());
        }
        if params.world.contains("wet") {
            return Err("world: got a sea, expected land".to_owned());
        }
        let line = params.world.lines().position(|line| line.contains("bad"));
        line.map_or(Ok(()), |line| Err(format!("world: line {}, hills: got bad, expected good", line + 1)))
    }

    fn new(_params: &Self::Params) -> Self {
        Self
    }

    fn cycle(&mut self, _ports: &Self::Ports, _params: &Self::Params, _cx: &mut Cycle<'_>) {}
}

/// A process of the robot.
#[derive(Clone, Serialize, Deserialize)]
struct Robot;

impl Process for Robot {
    type Params = rcs::NoParams;
    type Ports = In<foxglove::Vector3>;
    type Command = NoCommands;
    const DEF: ProcessDef = ProcessDef {
        plugin: "robot",
        summary: "Guesses.",
        period_ms: 10.0,
        latency_ms: 0.0,
        reads_ground_truth: false,
    };

    fn ports(b: &mut PortBuilder) -> Self::Ports {
        b.optional_input("pose", "Where it is believed to be.")
    }

    fn new(_params: &Self::Params) -> Self {
        Self
    }

    fn cycle(&mut self, _ports: &Self::Ports, _params: &Self::Params, _cx: &mut Cycle<'_>) {}
}

const PLUGINS: &[ProcessType] = &[ProcessType::of::<World>(), ProcessType::of::<Robot>()];

/// Files in memory, by `kind/name`.
struct Shelf;

impl Assets for Shelf {
    fn read(&self, kind: &str, name: &str, beside: &str) -> Result<Asset, String> {
        let text = match (kind, name) {
            ("course", "easy") => "name = \"easy\"\nworld = \"flat\"\n",
            ("course", "lost") => "name = \"lost\"\nworld = \"atlantis\"\n",
            ("course", "broken") => "name = \n",
            ("course", "bare") => "name = \"needs a world\"\n",
            ("course", "blank") => "name = \"needs a world\"\nworld = \"empty\"\n",
            ("world", "flat") => "hills = 0\n",
            ("world", "steep") => "hills = 9\n",
            ("world", "empty") => "",
            ("world", "wet") => "name = \"wet\"\n",
            ("world", "spoiled") => "name = \"spoiled\"\nhills = bad\n",
            _ => return Err(format!("no {kind} {name:?} beside {beside:?}")),
        };
        Ok(Asset { file: format!("{kind}s/{name}.toml"), text: text.to_owned() })
    }
}

fn plan(course: Option<&str>, text: &str, overrides: &[(String, String)]) -> Result<Plan, String> {
    let file = StackFile::parse("test.toml", text).map_err(|error| error.to_string())?;
    let options = PlanOptions { overrides, course, assets: &Shelf };
    Plan::with(file, PLUGINS, &options).map_err(|error| error.to_string())
}

/// The parameters as the process reads them.
fn params_of(plan: &Plan) -> FileParams {
    plan.files.resolve(&plan.processes[0].params).unwrap().to().unwrap()
}

fn world_of(plan: &Plan) -> String {
    params_of(plan).world
}

fn stack(head: &str, params: &str, robot: &str) -> String {
    format!(
        "format = 1\nname = \"t\"\n{head}\n[[process]]\nname = \"vehicle\"\nplugin = \"world\"\nsupervisor = \
         \"viewer\"\nparams = {{ {params} }}\n{robot}"
    )
}

fn robot(pose: &str) -> String {
    format!(
        "[[process]]\nname = \"robot\"\nplugin = \"robot\"\nsupervisor = \"viewer\"\ninputs = {{ pose = \"{pose}\" }}\n"
    )
}

#[test]
fn a_parameter_names_a_file_by_its_content_and_its_process_reads_the_text() {
    let plan = plan(None, &stack("", "world = \"steep\"", ""), &[]).unwrap();
    let named = plan.processes[0].params.to::<FileParams>().unwrap().world;
    assert_eq!(named, format!("blake3:{}", blake3::hash(b"hills = 9\n").to_hex()));
    assert_eq!(plan.files.get(&named).unwrap().file, "worlds/steep.toml");
    assert_eq!(world_of(&plan), "hills = 9\n");
}

#[test]
fn a_recorded_run_has_each_file_once_and_a_changed_text_is_missed() {
    let world = "[[process]]\nname = \"other\"\nplugin = \"world\"\nsupervisor = \"viewer\"\nparams = { world = \"flat\" }\n";
    let plan = plan(None, &stack("", "world = \"flat\"", world), &[]).unwrap();
    let mut run = Stepped::new(std::sync::Arc::new(plan.clone()), None, RunOptions::default()).unwrap();
    run.begin().unwrap();
    let info = run.bus().get("/runtime/run").unwrap().latest().unwrap().message.to::<rcs::RunInfo>().unwrap();
    assert_eq!(info.files, [rcs::RunFile { kind: "world".to_owned(), text: "hills = 0\n".to_owned() }]);

    let options = PlanOptions { overrides: &[], course: None, assets: &rcs_runtime::NoAssets };
    let again = Plan::of_run(&info, PLUGINS, &options).unwrap();
    assert_eq!((world_of(&again), again.hash), (world_of(&plan), plan.hash));

    let mut changed = info;
    changed.files[0].text.push(' ');
    let error = Plan::of_run(&changed, PLUGINS, &options).unwrap_err().to_string();
    assert!(error.contains("recorded parameters of vehicle: world: the run has no file blake3:"), "{error}");
}

#[test]
fn a_course_brings_its_world_and_the_command_line_counts_most() {
    let text = stack("course = \"easy\"", "world = \"steep\"", "");
    let own = plan(None, &text, &[]).unwrap();
    assert_eq!(world_of(&own), "hills = 0\n");
    assert_eq!(params_of(&own).course, "name = \"easy\"\nworld = \"flat\"\n");
    let param = [("vehicle.world".to_owned(), "steep".to_owned())];
    assert_eq!(world_of(&plan(Some("easy"), &text, &param).unwrap()), "hills = 9\n");
}

#[test]
fn other_files_make_another_hash() {
    let with = |world: &str| plan(None, &stack("", &format!("world = {world:?}"), ""), &[]).unwrap().hash;
    assert_ne!(with("flat"), with("steep"));
    let param = [("vehicle.world".to_owned(), "steep".to_owned())];
    assert_ne!(plan(None, &stack("", "", ""), &param).unwrap().hash, with("flat"));
}

#[test]
fn what_is_wrong_with_a_file_is_said_of_that_file() {
    let error = |course, params| plan(course, &stack("", params, ""), &[]).unwrap_err();
    assert_eq!(
        error(None, "world = \"moon\""),
        "test.toml:8: parameter vehicle.world: no world \"moon\" beside \"test.toml\""
    );
    assert_eq!(error(Some("nowhere"), ""), "--course: no course \"nowhere\" beside \"\"");
    assert_eq!(
        error(Some("lost"), ""),
        "courses/lost.toml:2: no world \"atlantis\" beside \"courses/lost.toml\""
    );
    assert!(error(Some("broken"), "").starts_with("courses/broken.toml:1: "));
    assert_eq!(error(None, "world = \"spoiled\""), "worlds/spoiled.toml:2: hills: got bad, expected good");
    assert_eq!(error(None, "world = \"wet\""), "worlds/wet.toml:1: got a sea, expected land");
}

#[test]
fn a_file_that_a_course_lacks_is_said_of_the_course_and_an_empty_one_of_that_file() {
    let error = |course, params| plan(Some(course), &stack("", params, ""), &[]).unwrap_err();
    let expected = "got no text, expected that of a world";
    let missing = "key \"world\" is missing, expected the name of a world or the path of its file";
    assert_eq!(error("bare", ""), format!("courses/bare.toml: {missing}"));
    assert_eq!(error("blank", ""), format!("worlds/empty.toml:1: {expected}"));
    // The course is not to blame for the file of the stack.
    assert_eq!(error("bare", "world = \"empty\""), format!("test.toml:5: world: {expected}"));
}

#[test]
fn a_file_of_the_course_that_no_process_takes_is_read_too() {
    let on = |course: &str| {
        let text = format!("format = 1\nname = \"t\"\ncourse = {course:?}\n{}", robot("/operator/pose"));
        plan(None, &text, &[]).map(drop)
    };
    assert_eq!(on("easy"), Ok(()));
    let error = on("lost").unwrap_err();
    assert_eq!(error, "courses/lost.toml:2: no world \"atlantis\" beside \"courses/lost.toml\"");
}

#[test]
fn a_course_that_is_given_to_a_stack_without_use_for_it_is_told() {
    let warnings = |text: &str| plan(Some("easy"), text, &[]).unwrap().warnings;
    let text = format!("format = 1\nname = \"t\"\n{}", robot("/operator/pose"));
    let told = "the stack t uses nothing of the course easy; expected a stack that uses it, or no course";
    assert_eq!(warnings(&text), [told]);
    assert_eq!(warnings(&stack("", "", "")), [""; 0]);
}

#[test]
fn the_truth_is_wired_only_to_those_who_may_know_it() {
    let error = plan(None, &stack("", "", &robot("/vehicle/pose")), &[]).unwrap_err();
    assert!(
        error
            .starts_with("test.toml:13: /vehicle/pose holds the ground truth of the simulation, which robot"),
        "{error}"
    );
}

#[test]
fn what_the_operator_writes_needs_no_process_that_writes_it() {
    let plan_ = plan(None, &stack("", "", &robot("/operator/pose")), &[]).unwrap();
    assert!(plan_.buffers.iter().any(|buffer| buffer.spec.name == "/operator/pose"));
    let error = plan(None, &stack("", "", &robot("/somebody/pose")), &[]).unwrap_err();
    assert!(error.contains("nothing writes /somebody/pose"), "{error}");
}

#[test]
fn parameters_that_a_process_refuses_are_refused_while_it_runs() {
    let plan = std::sync::Arc::new(plan(None, &stack("", "world = \"flat\"", ""), &[]).unwrap());
    let params = FileParams { world: "bad".to_owned(), ..rcs_msg::params::default() };
    let run = Stepped::new(plan, None, RunOptions::default()).unwrap();
    let mut session = rcs_runtime::Session::new(run).unwrap();
    let write = rcs_runtime::ExternalEvent::operator("/vehicle/params", rcs_msg::AnyMessage::new(params));
    let error = session.write(write).unwrap_err().to_string();
    assert!(error.contains("got bad, expected good"), "{error}");

    let params = FileParams { world: "blake3:0".to_owned(), ..rcs_msg::params::default() };
    let write = rcs_runtime::ExternalEvent::operator("/vehicle/params", rcs_msg::AnyMessage::new(params));
    let error = session.write(write).unwrap_err().to_string();
    assert!(error.contains("/vehicle/params: world: the run has no file blake3:0"), "{error}");
}
