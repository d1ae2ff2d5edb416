//! RCS's contract of commands: which commands are accepted or refused, from whom, and how a supervisor sees its
//! children.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

mod common;

use common::{Counter, CounterCommand, Fragile, newest, seconds};
use rcs_msg::{AnyMessage, foxglove, rcs};
use rcs_runtime::source::Task;
use rcs_runtime::{
    Child, ChildState, CommandSet, Cycle, ExternalEvent, NoCommands, Order, Out, Plan, PortBuilder, Process,
    ProcessDef, ProcessType, RunOptions, Session, Snapshot, StackError, StackFile, Stepped,
};
use rcs_testkit::proto::CounterParams;
use serde::{Deserialize, Serialize};
use std::sync::{Arc, Mutex};

/// Sends its counter `RUN`, then `ADD` in every cycle; writes (state of the child, whether it obeys another commander).
#[derive(Clone, Serialize, Deserialize)]
struct Boss;

struct BossPorts {
    counter: Child<CounterCommand>,
    seen: Out<foxglove::Vector3>,
}

const STATES: [ChildState; 5] =
    [ChildState::Uninitialized, ChildState::Exec, ChildState::Done, ChildState::Error, ChildState::Silent];

fn add() -> CounterParams {
    rcs_msg::params::default()
}

impl Process for Boss {
    type Params = rcs::NoParams;
    type Ports = BossPorts;
    type Command = NoCommands;
    const DEF: ProcessDef = ProcessDef {
        plugin: "boss",
        summary: "Commands.",
        period_ms: 10.0,
        latency_ms: 0.0,
        reads_ground_truth: false,
    };

    fn ports(b: &mut PortBuilder) -> Self::Ports {
        BossPorts {
            counter: b.child("counter", "Counts."),
            seen: b.output("seen", "State of the child, and whether it obeys another.").build(),
        }
    }

    fn new(_params: &Self::Params) -> Self {
        Self
    }

    fn cycle(&mut self, ports: &Self::Ports, _params: &Self::Params, cx: &mut Cycle<'_>) {
        let report = cx.child(&ports.counter).unwrap();
        let x = STATES.iter().position(|state| *state == report.state).unwrap() as f64;
        let y = f64::from(u8::from(report.obeys_another.is_some()));
        cx.write(&ports.seen, cx.now(), foxglove::Vector3 { x, y, z: 0.0 });
        if cx.is_new_command() {
            cx.send(&ports.counter, Order::Run);
        } else {
            cx.send(&ports.counter, CounterCommand::Add(add()));
        }
        cx.exec(report.text);
    }

    fn halt(&mut self, ports: &Self::Ports, _params: &Self::Params, cx: &mut Cycle<'_>) {
        if cx.is_new_command() {
            cx.send(&ports.counter, Order::Halt);
        }
        match cx.child_state(&ports.counter) {
            Some(ChildState::Done) => cx.done("halted"),
            _ => cx.exec("halts"),
        }
    }
}

/// Sends commands to the process to which its output is wired.
#[derive(Clone, Serialize, Deserialize)]
struct Meddler;

impl Process for Meddler {
    type Params = rcs::NoParams;
    type Ports = Out<rcs::Command>;
    type Command = NoCommands;
    const DEF: ProcessDef = ProcessDef {
        plugin: "meddler",
        summary: "Meddles.",
        period_ms: 10.0,
        latency_ms: 0.0,
        reads_ground_truth: false,
    };

    fn ports(b: &mut PortBuilder) -> Self::Ports {
        b.output("orders", "Not its business.").build()
    }

    fn new(_params: &Self::Params) -> Self {
        Self
    }

    fn cycle(&mut self, out: &Self::Ports, _params: &Self::Params, cx: &mut Cycle<'_>) {
        cx.write(out, cx.now(), rcs::Command { serial: 1000, name: "HALT".to_owned(), ..Default::default() });
    }
}

/// Sets its status to done in its first cycle, and never changes it.
#[derive(Clone, Serialize, Deserialize)]
struct Quiet {
    said: bool,
}

impl Process for Quiet {
    type Params = rcs::NoParams;
    type Ports = ();
    type Command = CounterCommand;
    const DEF: ProcessDef = ProcessDef {
        plugin: "quiet",
        summary: "Says little.",
        period_ms: 10.0,
        latency_ms: 0.0,
        reads_ground_truth: false,
    };

    fn ports(_: &mut PortBuilder) -> Self::Ports {}

    fn new(_params: &Self::Params) -> Self {
        Self { said: false }
    }

    fn cycle(&mut self, (): &Self::Ports, _params: &Self::Params, cx: &mut Cycle<'_>) {
        if !self.said {
            self.said = true;
            cx.done("said all");
        }
    }
}

const PLUGINS: &[ProcessType] = &[
    ProcessType::of::<Boss>(),
    ProcessType::of::<Counter>(),
    ProcessType::of::<Fragile>(),
    ProcessType::of::<Meddler>(),
    ProcessType::of::<Quiet>(),
];

fn plan(text: &str) -> Result<Arc<Plan>, StackError> {
    Plan::new(StackFile::parse("test.toml", text)?, PLUGINS, &[]).map(Arc::new)
}

const BOSS: &str = r#"
format = 1
name = "boss"
authority_s = 1.0

[[process]]
name = "boss"
plugin = "boss"
supervisor = "viewer"

[[process]]
name = "counter"
plugin = "counter"
supervisor = "boss"
period_ms = 50
"#;

fn alone(plugin: &str) -> String {
    format!(
        "format = 1\nname = \"x\"\n[[process]]\nname = \"x\"\nplugin = \"{plugin}\"\nsupervisor = \"viewer\"\n"
    )
}

fn stepped(stack: &str) -> Stepped {
    let options = RunOptions { hash: true, ..RunOptions::default() };
    Stepped::new(plan(stack).unwrap(), None, options).unwrap()
}

/// A run whose commands come from the test.
struct Bench {
    session: Session,
    now_s: f64,
    serial: u64,
}

impl Bench {
    fn new(stack: &str) -> Self {
        Self { session: Session::new(stepped(stack)).unwrap(), now_s: 0.0, serial: 1 }
    }

    fn forward(&mut self, by_s: f64) {
        self.now_s += by_s;
        self.session.forward_until(seconds(self.now_s), &Task::default()).unwrap();
    }

    fn write(&mut self, process: &str, command: rcs::Command) {
        let write = ExternalEvent::operator(format!("/{process}/command"), AnyMessage::new(command));
        self.session.write(write).unwrap();
    }

    /// Sends a command of the operator, and returns the status a tenth of a second later.
    fn send(&mut self, process: &str, command: rcs::Command) -> rcs::Status {
        self.serial += 1;
        self.write(process, rcs::Command { serial: self.serial, ..command });
        self.forward(0.1);
        self.status(process)
    }

    fn say(&mut self, process: &str, name: &str) -> rcs::Status {
        self.send(process, rcs::Command { name: name.to_owned(), ..Default::default() })
    }

    fn status(&self, process: &str) -> rcs::Status {
        newest(self.session.run(), &format!("/{process}/status"))
    }

    fn messages(&self, buffer: &str) -> u64 {
        self.session.run().bus().get(buffer).unwrap().newest()
    }
}

fn add_with(parameters_schema: &str, params: &CounterParams) -> rcs::Command {
    rcs::Command {
        name: "ADD".to_owned(),
        parameters_schema: parameters_schema.to_owned(),
        parameters: prost::Message::encode_to_vec(params).into(),
        ..Default::default()
    }
}

use rcs::ProcessState::{Done, Error, Exec};

#[test]
fn no_status_shows_a_new_echo_beside_an_old_done() {
    let run = stepped(&alone("quiet"));
    let seen = Arc::new(Mutex::new(Vec::new()));
    let tap = Arc::clone(&seen);
    run.bus().get("/x/status").unwrap().tap(Box::new(move |sample| {
        let status: rcs::Status = sample.message.to().unwrap();
        tap.lock().unwrap().push((status.echo_serial, status.state()));
    }));
    let mut session = Session::new(run).unwrap();
    session.forward_until(seconds(0.1), &Task::default()).unwrap();
    let command = rcs::Command { serial: 2, name: "CLEAR".to_owned(), ..Default::default() };
    let message = AnyMessage::new(command);
    session.write(ExternalEvent::operator("/x/command", message)).unwrap();
    session.forward_until(seconds(0.2), &Task::default()).unwrap();
    let mut seen = seen.lock().unwrap().clone();
    seen.dedup();
    assert_eq!(seen, [(1, Done), (2, Exec)]);
}

#[test]
fn a_session_of_a_run_that_has_begun_goes_on_with_its_serials() {
    let begun = || {
        let mut run = stepped(&alone("counter"));
        run.begin().unwrap();
        run.run_until(seconds(0.5)).unwrap();
        run
    };
    let mut restored = stepped(&alone("counter"));
    restored.restore(&begun().snapshot()).unwrap();
    for run in [begun(), restored] {
        let mut bench = Bench { session: Session::new(run).unwrap(), now_s: 0.5, serial: 1 };
        bench.forward(0.1);
        let status = bench.status("x");
        assert_eq!(
            (status.faults, status.refused, status.echo_serial),
            (0, None, 1),
            "RUN is not written twice"
        );
        assert_eq!((bench.say("x", "HALT").echo_serial, bench.say("x", "RUN").echo_serial), (2, 3));
        assert_eq!(bench.status("x").refused, None);
        bench.session.go_to_time(seconds(0.55), &Task::default()).unwrap();
        assert_eq!(bench.status("x").echo_serial, 1);
    }
}

#[test]
fn a_command_is_echoed_with_its_serial_and_a_refused_one_is_an_error_until_the_next() {
    let mut bench = Bench::new(&alone("counter"));
    bench.forward(0.1);
    let count = |bench: &Bench| bench.messages("/x/count");
    let before = count(&bench);
    let status = bench.say("x", "JUMP");
    assert_eq!((status.state(), status.echo_serial, status.command.as_str()), (Error, 2, "JUMP"));
    let reason = "unknown command JUMP; expected INIT, RUN, HALT, TAKE, RELEASE, CLEAR, ADD";
    assert_eq!(status.state_text, reason);
    assert_eq!(status.refused.as_ref().unwrap().reason, reason);
    assert!(status.source_line.contains("register.rs"), "{}", status.source_line);
    assert!(count(&bench) > before, "what it was told before still holds: it counts");
    let status = bench.say("x", "CLEAR");
    assert_eq!((status.state(), status.echo_serial), (Exec, 3));
    let status = bench.say("x", "HALT");
    assert_eq!((status.state(), status.echo_serial, status.state_text.as_str()), (Done, 4, "halted"));
    assert!(status.source_line.contains("process.rs"), "{}", status.source_line);
    let halted_at = count(&bench);
    let status = bench.say("x", "CLEAR");
    assert_eq!(status.state(), Error);
    assert_eq!(status.state_text, "CLEAR needs a process that runs; expected RUN before it");
    assert_eq!(bench.say("x", "JUMP").state(), Error);
    assert_eq!(count(&bench), halted_at, "no cycle for what it cannot do");
    let status = bench.say("x", "RUN");
    assert_eq!((status.state(), status.command.as_str(), status.faults), (Exec, "RUN", 0));
    assert!(count(&bench) > halted_at);
}

#[test]
fn parameters_of_a_command_are_of_its_type_and_within_their_ranges() {
    let name = "testkit.CounterParams";
    let mut bench = Bench::new(&alone("counter"));
    bench.forward(0.1);
    let mut check = |command: rcs::Command, reason: &str| {
        let status = bench.send("x", command);
        assert_eq!(status.state(), Error, "{reason}");
        assert!(status.state_text.contains(reason), "expected {reason:?} in {:?}", status.state_text);
    };
    let without = rcs::Command { name: "ADD".to_owned(), ..Default::default() };
    check(without, "ADD needs parameters of type testkit.CounterParams; got none");
    check(add_with("rcs.DriveCommand", &add()), "got rcs.DriveCommand");
    for publish_hz in [f64::NAN, f64::INFINITY, 1e6] {
        let params = CounterParams { publish_hz, ..add() };
        check(add_with(name, &params), "ADD: parameter publish_hz");
    }
    let broken = rcs::Command { parameters: vec![0xff; 3].into(), ..add_with(name, &add()) };
    check(broken, "do not decode as testkit.CounterParams");
    let too_much = rcs::Command { name: "CLEAR".to_owned(), ..add_with(name, &add()) };
    check(too_much, "CLEAR has no parameters; got testkit.CounterParams");
    let too_much = rcs::Command { name: "HALT".to_owned(), ..add_with(name, &add()) };
    check(too_much, "HALT has no parameters");
    let status = bench.send("x", add_with(name, &CounterParams { publish_hz: 50.0, ..add() }));
    assert_eq!((status.state(), status.state_text.as_str()), (Exec, "counting"));
    let count = newest::<foxglove::Vector3>(bench.session.run(), "/x/count").x;
    assert!((90.0..200.0).contains(&count), "about a hundred cycles and 50: {count}");
}

#[test]
fn a_message_that_is_no_command_is_refused_where_it_is_written() {
    let mut session = Session::new(stepped(&alone("counter"))).unwrap();
    let message = AnyMessage::new(foxglove::Vector3::default());
    let error = session.write(ExternalEvent::operator("/x/command", message)).unwrap_err();
    assert!(error.to_string().contains("which holds rcs.Command"), "{error}");
}

#[test]
fn a_stranger_is_refused_by_name_and_changes_nothing() {
    let stack = format!(
        "{BOSS}\n[[process]]\nname = \"meddler\"\nplugin = \"meddler\"\nsupervisor = \"viewer\"\noutputs = {{ orders = \
         \"/counter/command\" }}\n"
    );
    let mut bench = Bench::new(&stack);
    bench.forward(1.0);
    let status = bench.status("counter");
    assert_eq!((status.state(), status.commander.as_str()), (Exec, "boss"));
    assert!(status.faults > 50);
    assert!(
        status.last_fault.ends_with("meddler may not command this process; expected operator or boss"),
        "{}",
        status.last_fault
    );
}

#[test]
fn an_old_serial_is_refused_and_changes_nothing() {
    let mut bench = Bench::new(&alone("counter"));
    bench.say("x", "RUN");
    for serial in [0, 1, 2] {
        bench.write("x", rcs::Command { serial, name: "HALT".to_owned(), ..Default::default() });
        bench.forward(0.1);
        let status = bench.status("x");
        assert_eq!((status.state(), status.echo_serial), (Exec, 2));
        let refused = status.refused.unwrap();
        assert_eq!(refused.reason, format!("serial {serial} is old; expected more than 2"));
        assert_eq!((refused.writer.as_str(), refused.command.as_str()), ("operator", "HALT"));
    }
    assert_eq!(bench.status("x").faults, 3);
}

#[test]
fn the_operators_halt_does_not_vanish_under_the_orders_of_a_supervisor() {
    // The supervisor sends its child five commands in every one of its cycles.
    for at_s in [0.5, 0.501, 0.519, 0.549] {
        let mut bench = Bench::new(BOSS);
        bench.forward(at_s);
        assert_eq!(bench.status("counter").owner, "boss");
        let status = bench.say("counter", "HALT");
        assert_eq!((status.state(), status.command.as_str()), (Done, "HALT"), "at {at_s} s");
        assert_eq!((status.owner.as_str(), status.commander.as_str()), ("operator", "operator"));
        let refused = status.refused.unwrap();
        assert_eq!((refused.writer.as_str(), refused.no_authority), ("boss", true));
        assert_eq!(refused.reason, "operator has the authority over this process");
        let seen: foxglove::Vector3 = newest(bench.session.run(), "/boss/seen");
        let state = STATES[seen.x as usize];
        assert_eq!((state, seen.y), (ChildState::Done, 1.0), "its supervisor knows whom it obeys");
    }
}

#[test]
fn the_authority_is_handed_back_by_release_and_lost_on_silence() {
    let mut bench = Bench::new(BOSS);
    bench.forward(0.5);
    assert_eq!(bench.status("counter").operator_serial, 0);
    bench.say("counter", "TAKE");
    let status = bench.status("counter");
    assert_eq!(
        (status.owner.as_str(), status.commander.as_str()),
        ("operator", "boss"),
        "what it does stays"
    );
    assert_eq!(status.state(), Exec);
    let status = bench.say("counter", "RELEASE");
    assert_eq!((status.owner.as_str(), status.operator_serial), ("boss", 3));
    assert_eq!(bench.status("boss").operator_serial, 0, "it has no other commander");

    bench.say("counter", "HALT");
    bench.forward(0.8);
    assert_eq!(bench.status("counter").owner, "operator", "0.9 s after its last word");
    bench.say("counter", "TAKE");
    bench.forward(0.8);
    assert_eq!(bench.status("counter").owner, "operator", "it has said something");
    bench.forward(0.3);
    let status = bench.status("counter");
    assert_eq!(status.owner, "boss", "the operator has been silent for more than 1 s");
    assert_eq!(status.state(), Error, "ADD needs a process that runs, and it is halted");
    assert_eq!(status.commander, "boss");
}

#[test]
fn init_brings_back_a_process_that_panicked() {
    let mut bench = Bench::new(&alone("fragile"));
    bench.forward(0.1);
    let status = bench.status("x");
    assert_eq!((status.state(), status.state_text.as_str()), (Error, "panicked: worn out"));
    let written = bench.messages("/x/out");
    let status = bench.say("x", "RUN");
    assert_eq!(status.state(), Error);
    assert_eq!(
        status.state_text,
        "RUN needs a process that works; this one panicked: worn out; expected INIT"
    );
    let status = bench.say("x", "INIT");
    assert_eq!((status.state(), status.state_text.as_str()), (Done, "initialized"));
    assert_eq!(bench.messages("/x/out"), written, "it does not work before RUN");
    let status = bench.say("x", "RUN");
    assert_eq!(status.state_text, "panicked: worn out", "with a new state it lasts as long as at first");
    assert_eq!(bench.messages("/x/out"), written + 2);
}

#[test]
fn init_makes_the_state_anew() {
    let mut bench = Bench::new(&alone("counter"));
    bench.forward(1.0);
    bench.say("x", "INIT");
    bench.say("x", "RUN");
    let count = newest::<foxglove::Vector3>(bench.session.run(), "/x/count").x;
    assert!(count < 15.0, "{count}");
}

#[test]
fn a_supervisor_passes_halt_down_and_is_done_when_its_child_is() {
    let mut bench = Bench::new(BOSS);
    bench.forward(0.52);
    bench.say("boss", "HALT");
    assert_eq!((bench.status("boss").state(), bench.status("counter").state()), (Done, Done));
    assert_eq!(bench.status("counter").commander, "boss");
    bench.say("boss", "RUN");
    assert_eq!((bench.status("boss").state(), bench.status("counter").state()), (Exec, Exec));
}

#[test]
fn after_init_a_process_does_what_it_did_at_the_start_of_the_run() {
    let mut bench = Bench::new(&alone("counter"));
    let written: Arc<Mutex<Vec<(f64, f64)>>> = Arc::default();
    let taken = Arc::clone(&written);
    bench.session.run().bus().get("/x/count").unwrap().tap(Box::new(move |sample| {
        let count = sample.message.get::<foxglove::Vector3>().unwrap();
        taken.lock().unwrap().push((count.x, count.y));
    }));
    bench.forward(0.1);
    let first = std::mem::take(&mut *written.lock().unwrap());
    assert_eq!(bench.say("x", "INIT").state(), rcs::ProcessState::Done);
    written.lock().unwrap().clear();
    bench.say("x", "RUN");
    let again = written.lock().unwrap().clone();
    let both = first.len().min(again.len()) - 1;
    assert!(both > 5 && again[..both] == first[..both], "{first:?} and {again:?}");
}

#[test]
fn what_was_told_survives_in_memory_and_on_disk() {
    let hash = |run: &Stepped| run.summary().hash.unwrap();
    let through = |halt: bool| {
        let mut bench = Bench::new(BOSS);
        bench.forward(0.505);
        // The operator's command is still unread, or it has been accepted and the supervisor's command refused.
        bench.write("counter", rcs::Command { serial: 1, name: "JUMP".to_owned(), ..Default::default() });
        if halt {
            bench.forward(0.2);
        }
        bench
    };
    for taken in [false, true] {
        let mut whole = through(taken);
        let snapshot = whole.session.run().snapshot();
        let bytes = snapshot.to_bytes().unwrap();
        whole.forward(3.0);
        assert_eq!(whole.status("counter").refused.unwrap().writer, "boss");
        for snapshot in [snapshot, Snapshot::from_bytes(&bytes).unwrap()] {
            let mut again = stepped(BOSS);
            again.restore(&snapshot).unwrap();
            assert_eq!(again.snapshot().to_bytes().unwrap(), bytes, "saved again it is the same");
            again.run_until(seconds(whole.now_s)).unwrap();
            assert_eq!(hash(&again), hash(whole.session.run()));
        }
    }
}

#[test]
fn commands_are_encoded_as_they_are_decoded() {
    for command in [CounterCommand::Clear, CounterCommand::Add(add())] {
        let encoded = command.encode();
        let (parameters_schema, parameters) = encoded.parameters;
        let parameters = parameters.into();
        let name = encoded.name.to_owned();
        let message = rcs::Command { name, parameters_schema, parameters, ..Default::default() };
        assert_eq!(CounterCommand::decode(&message), Ok(command));
    }
}

#[test]
fn a_window_is_told_of_every_command_and_child() {
    let infos = plan(BOSS).unwrap().process_infos();
    let names: Vec<_> = infos[1].commands.iter().map(|command| command.name.as_str()).collect();
    assert_eq!(names, ["INIT", "RUN", "HALT", "TAKE", "RELEASE", "CLEAR", "ADD"]);
    assert_eq!(infos[1].commands[6].parameters_schema, "testkit.CounterParams");
    assert_eq!((infos[1].supervisor.as_str(), infos[1].child.as_str()), ("boss", "counter"));
}

#[test]
fn a_child_that_its_supervisor_does_not_serve_is_refused_with_its_line() {
    let check = |from: &str, to: &str, expected: &str| {
        assert!(BOSS.contains(from));
        let error = plan(&BOSS.replacen(from, to, 1)).unwrap_err().to_string();
        assert!(error.contains(expected), "expected {expected:?} in {error:?}");
    };
    let below = |supervisor: &str| {
        format!(
            "period_ms = 50\n[[process]]\nname = \"c\"\nplugin = \"counter\"\nsupervisor = \"{supervisor}\""
        )
    };
    check(
        "period_ms = 50",
        &below("counter"),
        "counter (counter) supervises no one, so it cannot be the supervisor of c; expected viewer or boss",
    );
    check(
        "period_ms = 50",
        "as = \"helper\"",
        "test.toml:15: boss has no child \"helper\"; expected as = counter",
    );
    check(
        "name = \"counter\"\nplugin = \"counter\"",
        "name = \"x\"\nplugin = \"fragile\"",
        "test.toml:14: boss has no child \"x\"; expected as = counter",
    );
    check(
        "plugin = \"counter\"",
        "plugin = \"fragile\"",
        "test.toml:14: counter (fragile) does not obey CLEAR, which boss sends to its child counter",
    );
    check(
        "supervisor = \"boss\"",
        "supervisor = \"viewer\"",
        "test.toml:6: process boss has no child counter; expected a process with supervisor = \"boss\" and as = \
         \"counter\" (Counts.)",
    );
    check(
        "period_ms = 50",
        &below("boss"),
        "boss has one child counter, which is counter; c cannot be it, too",
    );
    check("authority_s = 1.0", "authority_s = nan", "NaN s is out of range; expected 0.1 to 3600");
    let queue = "period_ms = 50\n[buffers.\"/counter/command\"]\nqueue = 1";
    check("period_ms = 50", queue, "/counter/command holds commands: always a queue of 32");
}
