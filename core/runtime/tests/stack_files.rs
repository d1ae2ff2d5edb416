//! Every mistake in a stack file is refused before anything runs, with file, line, and what was expected.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

mod common;

use common::{PAIR, PLUGINS, plan};
use proptest::prelude::*;
use rcs_msg::{foxglove, rcs};
use rcs_runtime::{
    Class, Cycle, NoCommands, Out, Plan, PortBuilder, Process, ProcessDef, ProcessType, Role, StackFile,
};

/// Changes `PAIR` and expects this error.
fn check(from: &str, to: &str, expected: &str) {
    assert!(PAIR.contains(from), "{from:?} is not in the stack");
    let error = plan(&PAIR.replacen(from, to, 1)).unwrap_err().to_string();
    assert!(error.contains(expected), "expected {expected:?} in {error:?}");
}

#[test]
fn a_good_stack_is_accepted() {
    let plan = plan(PAIR).unwrap();
    assert_eq!(plan.processes.len(), 2);
    let infos = plan.process_infos();
    assert_eq!(infos[1].inputs[0].buffer, "/counter/count");
    assert_eq!(infos[0].outputs[0].buffer, "/counter/count");
    assert_eq!(infos[0].supervisor, "viewer");
}

#[test]
fn mistakes_name_file_line_and_what_was_expected() {
    check("format = 1", "format = 9", "test.toml:2: format 9 is not known; expected 1");
    check("name = \"pair\"", "name = 3", "test.toml:3: invalid type: integer `3`, expected a string");
    check(
        "plugin = \"counter\"",
        "plugin = \"countr\"",
        "test.toml:7: there is no plugin \"countr\"; expected counter, adder or fragile",
    );
    check("latency_ms = 3", "latencyms = 3", "test.toml:9: unknown field `latencyms`");
    check("latency_ms = 3", "latency_ms = nan", "test.toml:9: NaN ms is out of range; expected 0 to");
    check("period_ms = 25", "period_ms = 0", "0 ms is out of range; expected 0.1 to");
    check(
        "supervisor = \"viewer\"\n",
        "",
        "process counter has no supervisor; expected supervisor = viewer or adder",
    );
    check(
        "supervisor = \"viewer\"",
        "supervisor = \"boss\"",
        "there is no process \"boss\" to supervise counter; expected viewer or adder",
    );
    check("name = \"adder\"", "name = \"counter\"", "there are two processes named counter");
    check(
        "name = \"adder\"",
        "name = \"an adder\"",
        "cannot name a process; expected letters, digits and underscores",
    );
    check(
        "input = \"/counter/count\"",
        "inptu = \"/counter/count\"",
        "there is no input \"inptu\"; expected input",
    );
    check("inputs = { input = \"/counter/count\" }", "", "process adder has no buffer for its input input");
    check("input = \"/counter/count\"", "input = \"/other\"", "nothing writes /other");
    check(
        "input = \"/counter/count\"",
        "input = \"/adder/status\"",
        "test.toml:16: /adder/status holds rcs.Status elsewhere in this stack; expected it to hold foxglove.Vector3",
    );
    check(
        "input = \"/counter/count\"",
        "input = \"count\"",
        "cannot name a buffer; expected a name like /wm1/map",
    );
    check("input = \"/counter/count\"", "input = \"/runtime/log\"", "is the runtime's own");
    check(
        "[buffers.\"/counter/count\"]",
        "[buffers.\"/conuter/count\"]",
        "there is no buffer /conuter/count; expected",
    );
    check("queue = 16", "queue = 0", "a queue of 0 is not possible; expected 1 to 100000");
    check("queue = 16", "overflow = \"refuse\"", "overflow is for a queue; expected queue = <depth>");
    check("queue = 16", "record_hz = -1.0", "-1 is no rate; expected a number above 0");
    check("queue = 16", "queue = ", "test.toml:19:");
}

#[test]
fn a_parameter_is_checked_against_its_range_and_type() {
    let with = |param: &str| format!("latency_ms = 3\nparams = {{ {param} }}");
    check("latency_ms = 3", &with("publish_hz = nan"), "test.toml:10: parameter counter.publish_hz");
    check("latency_ms = 3", &with("publish_hz = 5000.0"), "100");
    check("latency_ms = 3", &with("publish_hz = \"fast\""), "counter.publish_hz");
    check("latency_ms = 3", &with("publsh_hz = 5.0"), "expected one of");
    check("latency_ms = 3", &with("publish_hz = { a = 1 }"), "got a message, expected a number from");
    check("latency_ms = 3", &with("publish_hz = 1979-05-27"), "test.toml:10:");
}

#[test]
fn a_parameter_of_the_command_line_overrides_the_file_and_is_checked() {
    let file = || StackFile::parse("test.toml", PAIR).unwrap();
    let with = |path: &str, value: &str| Plan::new(file(), PLUGINS, &[(path.to_owned(), value.to_owned())]);
    let plan = with("counter.publish_hz", "7.5").unwrap();
    let params: rcs_testkit::proto::CounterParams = plan.processes[0].params.to().unwrap();
    assert_eq!(params.publish_hz, 7.5);
    let error = |path, value| with(path, value).unwrap_err().to_string();
    assert!(error("counter.publish_hz", "NaN").contains("publish_hz"));
    assert!(error("nobody.publish_hz", "1").contains("with process counter or adder"));
    assert!(error("publish_hz", "1").contains("expected <process>.<field>=<value>"));
}

#[test]
fn parameters_nest_and_repeat_and_what_is_wrong_in_them_has_its_own_line() {
    let with = |text: &str| {
        let params = format!("latency_ms = 3\n\n[process.params]\npublish_hz = 2.0\n\n{text}");
        let stack = PAIR.replacen("latency_ms = 3", &params, 1);
        Plan::new(StackFile::parse("test.toml", &stack).unwrap(), PLUGINS, &[])
    };
    let plan = with(
        "[process.params.mount]\nx_m = 3.0\nfixed = true\n\n[[process.params.steps]]\nname = \"a\"\n\n\
         [[process.params.steps]]\nweight = 0.25\n",
    );
    let params: rcs_testkit::proto::CounterParams = plan.unwrap().processes[0].params.to().unwrap();
    let mount = params.mount.unwrap();
    // Fields that are not named have their defaults: the group's own, or the field's.
    assert_eq!((mount.x_m, mount.yaw_deg, mount.height_m, mount.fixed), (3.0, 90.0, 1.0, true));
    let steps: Vec<_> = params.steps.iter().map(|step| (step.name.as_str(), step.weight)).collect();
    assert_eq!(steps, [("a", 0.5), ("one", 0.25)]);
    for (text, expected) in [
        ("[process.params.mount]\nx_m = 3.0\ny_m = 11\n", "test.toml:16: parameter counter.mount.y_m: "),
        ("[process.params.mount]\nz_m = 3.0\n", "test.toml:15: parameter counter.mount.z_m: no parameter"),
        (
            "[[process.params.steps]]\nname = \"a\"\n\n[[process.params.steps]]\nweight = 2.0\n",
            "test.toml:18: parameter counter.steps[1].weight: ",
        ),
    ] {
        let error = with(text).unwrap_err();
        assert!(error.to_string().starts_with(expected), "{error}");
    }
    let given = [("counter.mount.x_m", "-2"), ("counter.steps", "[{}]"), ("counter.steps[0].weight", "1")];
    let given = given.map(|(path, value)| (path.to_owned(), value.to_owned()));
    let plan = Plan::new(StackFile::parse("test.toml", PAIR).unwrap(), PLUGINS, &given).unwrap();
    let params: rcs_testkit::proto::CounterParams = plan.processes[0].params.to().unwrap();
    assert_eq!((params.mount.unwrap().x_m, params.steps[0].weight), (-2.0, 1.0));
}

#[test]
fn processes_that_supervise_each_other_are_refused() {
    let ring = PAIR.replacen("supervisor = \"viewer\"", "supervisor = \"adder\"", 1).replacen(
        "supervisor = \"viewer\"",
        "supervisor = \"counter\"",
        1,
    );
    let error = plan(&ring).unwrap_err().to_string();
    assert!(error.contains("supervises itself; expected a chain that ends at viewer"), "{error}");
}

#[test]
fn a_process_on_another_computer_is_refused_until_there_are_hosts() {
    check(
        "latency_ms = 3",
        "host = \"robot\"",
        "test.toml:9: \"robot\" is no host that a process can run on; expected \"local\"",
    );
    plan(&PAIR.replace("latency_ms = 3", "host = \"local\"")).unwrap();
}

#[test]
fn a_scheduling_class_and_a_pool_are_checked() {
    check(
        "latency_ms = 3",
        "class = \"fast\"",
        "test.toml:9: unknown variant `fast`, expected one of `realtime`, `normal`, `background`",
    );
    check(
        "latency_ms = 3",
        "pool = \"a pool\"",
        "test.toml:9: \"a pool\" cannot name a pool; expected letters",
    );
    let mixed = PAIR
        .replace("latency_ms = 3", "class = \"realtime\"\npool = \"fast\"")
        .replace("period_ms = 25", "pool = \"fast\"");
    let error = plan(&mixed).unwrap_err().to_string();
    let expected = "test.toml:16: pool fast serves counter of class realtime and adder of class normal";
    assert!(error.contains(expected), "{error}");
    let plan = plan(&PAIR.replace("latency_ms = 3", "class = \"background\"\npool = \"slow\"")).unwrap();
    assert_eq!((plan.processes[0].class, plan.processes[1].class), (Class::Background, Class::Normal));
    assert_eq!(plan.processes[0].pool.as_deref(), Some("slow"));
}

#[test]
fn two_writers_of_one_buffer_are_declared_or_refused() {
    let second = "inputs = { input = \"/counter/count\" }\noutputs = { sum = \"/counter/count\" }";
    check(
        "inputs = { input = \"/counter/count\" }",
        second,
        "test.toml:17: /counter/count is written by process counter and by process adder; expected one writer, or \
         writers = \"many\" in [buffers.\"/counter/count\"]",
    );
    let shared = PAIR
        .replace("inputs = { input = \"/counter/count\" }", second)
        .replace("queue = 16", "queue = 16\nwriters = \"many\"");
    plan(&shared).unwrap();
    check("queue = 16", "writers = \"two\"", "test.toml:19: unknown variant `two`, expected `one` or `many`");
    let recorded = format!("{PAIR}\n[[input]]\nbuffer = \"/counter/count\"\ntopic = \"/recorded\"\n");
    let error = plan(&recorded).unwrap_err().to_string();
    assert!(error.contains("/counter/count is written by topic /recorded and by process counter"), "{error}");
}

#[test]
fn a_queue_for_orders_is_not_for_a_stack_to_say() {
    check(
        "[buffers.\"/counter/count\"]",
        "[buffers.\"/counter/command\"]",
        "test.toml:19: /counter/command holds commands: always a queue of 32",
    );
}

proptest! {
    /// No text causes a panic of the parser.
    #[test]
    fn any_text_is_read_or_refused(start in 0..PAIR.len(), length in 0..40_usize, new in ".{0,12}") {
        let end = (start + length).min(PAIR.len());
        let text = format!("{}{new}{}", &PAIR[..start], &PAIR[end..]);
        let _ = plan(&text);
    }
}

/// Publishes a vector as a map.
#[derive(Clone, serde::Serialize, serde::Deserialize)]
struct Mislabelled;

impl Process for Mislabelled {
    type Params = rcs::NoParams;
    type Ports = Out<foxglove::Vector3>;
    type Command = NoCommands;
    const DEF: ProcessDef = ProcessDef {
        plugin: "mislabelled",
        summary: "Mislabels.",
        period_ms: 10.0,
        latency_ms: 0.0,
        reads_ground_truth: false,
    };

    fn ports(b: &mut PortBuilder) -> Self::Ports {
        b.output("map", "A vector.").role(Role::Map).build()
    }

    fn new(_params: &Self::Params) -> Self {
        Self
    }

    fn cycle(&mut self, _: &Self::Ports, _: &Self::Params, _: &mut Cycle<'_>) {}
}

#[test]
fn a_role_that_a_type_cannot_play_is_refused() {
    const ONE: &str = "format = 1\nname = \"one\"\n[[process]]\nname = \"wm\"\nplugin = \"mislabelled\"\n\
         supervisor = \"viewer\"\n";
    let file = StackFile::parse("test.toml", ONE).unwrap();
    let plugins = [ProcessType::of::<Mislabelled>()];
    let error = Plan::new(file, &plugins, &[]).unwrap_err().to_string();
    let expected = "output wm.map has the role map and the type foxglove.Vector3; expected foxglove.Grid";
    assert!(error.contains(expected), "{error}");
}
