//! Executors: the result does not depend on how it was reached.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

mod common;

use common::{ON_LOG, PAIR, PLUGINS, newest, plan, seconds, stepped, write_log, write_published};
use rcs_log::{CursorOptions, Log};
use rcs_msg::{AnyMessage, Stamp, foxglove, rcs};
use rcs_runtime::source::{Source, StackSource, Step, Task};
use rcs_runtime::{
    Cycle, ExternalEvent, In, Live, LiveOptions, Out, Plan, PortBuilder, Process, ProcessDef, ProcessType,
    RecordOptions, RecordedRun, Recording, Role, RunOptions, Session, Snapshot, Stepped,
};
use std::time::{Duration, Instant};

fn hashing(threads: usize) -> RunOptions {
    RunOptions { hash: true, threads, seed: 7, ..RunOptions::default() }
}

fn hash_of(run: &Stepped) -> String {
    run.summary().hash.unwrap()
}

#[test]
fn two_runs_give_the_same_bytes_on_any_number_of_threads() {
    let run = |threads, seed| {
        let mut run = stepped(PAIR, RunOptions { seed, ..hashing(threads) });
        run.begin().unwrap();
        run.run_until(seconds(2.0)).unwrap();
        hash_of(&run)
    };
    assert_eq!(run(1, 7), run(1, 7));
    assert_eq!(run(1, 7), run(2, 7));
    assert_ne!(run(1, 7), run(1, 8), "the seed matters");
}

#[test]
fn a_run_resumed_from_a_snapshot_ends_like_one_that_went_through() {
    let mut whole = stepped(PAIR, hashing(1));
    whole.begin().unwrap();
    whole.run_until(seconds(1.0)).unwrap();
    // Between a cycle and its output becoming visible, so that output is outstanding.
    whole.run_until(seconds(1.001)).unwrap();
    let snapshot = whole.snapshot();
    let bytes = snapshot.to_bytes().unwrap();
    whole.run_until(seconds(2.0)).unwrap();

    let mut again = stepped(PAIR, hashing(2));
    again.restore(&Snapshot::from_bytes(&bytes).unwrap()).unwrap();
    again.run_until(seconds(2.0)).unwrap();
    assert_eq!(hash_of(&again), hash_of(&whole));

    whole.restore(&snapshot).unwrap();
    whole.run_until(seconds(2.0)).unwrap();
    assert_eq!(hash_of(&again), hash_of(&whole));
}

#[test]
fn a_snapshot_of_another_stack_or_of_damaged_bytes_is_refused() {
    let run = stepped(PAIR, hashing(1));
    let bytes = run.snapshot().to_bytes().unwrap();
    let mut other = stepped(&PAIR.replace("period_ms = 25", "period_ms = 30"), hashing(1));
    let error = other.restore(&Snapshot::from_bytes(&bytes).unwrap()).unwrap_err().to_string();
    assert!(error.contains("expected"), "{error}");
    for cut in [0, 1, bytes.len() / 2, bytes.len() - 1] {
        assert!(Snapshot::from_bytes(&bytes[..cut]).is_err());
    }
}

#[test]
fn output_becomes_visible_after_its_latency() {
    let mut run = stepped(PAIR, RunOptions::default());
    run.begin().unwrap();
    run.run_until(seconds(0.0)).unwrap();
    assert_eq!(run.bus().get("/counter/count").unwrap().newest(), 0);
    run.run_until(seconds(0.003)).unwrap();
    let sample = run.bus().get("/counter/count").unwrap().latest().unwrap();
    assert_eq!((sample.header.log_time, sample.header.acq_time), (seconds(0.003), Stamp(0)));
}

#[test]
fn a_message_whose_time_leaps_ahead_of_the_clock_is_refused_and_a_clock_that_is_ahead_is_not() {
    let given = |ahead_s: [f64; 4]| {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("log.mcap");
        let times = [10.0, 10.01, 10.02, 10.03];
        let messages: Vec<_> =
            std::iter::zip(times, ahead_s).map(|(time_s, by_s)| (time_s, time_s + by_s, "/a", 1.0)).collect();
        write_published(&path, &messages);
        let log = Log::open(&path).unwrap();
        let mut run = Stepped::new(plan(ON_LOG).unwrap(), Some(&log), RunOptions::default()).unwrap();
        run.begin().unwrap();
        run.run_until(seconds(10.05)).unwrap();
        let told = run.bus().get("/runtime/log").unwrap().latest();
        let told = told.map(|sample| sample.message.to::<foxglove::Log>().unwrap().message);
        (newest::<foxglove::Vector3>(&run, "/adder/sum").y, told)
    };
    assert_eq!(given([0.0, 0.9, -5.0, 0.0]), (4.0, None));
    assert_eq!(given([18.0; 4]), (4.0, None), "a clock that differs from the log's");
    let refused =
        "/a: message at 10.010 s has a time 3600.000 s ahead of that, expected at most 1.000 s; skipped";
    assert_eq!(given([0.0, 3600.0, 0.0, 0.0]), (3.0, Some(refused.to_owned())));
}

#[test]
fn at_one_instant_the_log_comes_in_file_order_before_any_cycle() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("log.mcap");
    write_log(&path, &[(0.0, "/a", 1.0), (0.02, "/a", 2.0), (0.02, "/a", 3.0), (0.03, "/a", 4.0)]);
    let log = Log::open(&path).unwrap();
    let mut run = Stepped::new(plan(ON_LOG).unwrap(), Some(&log), RunOptions::default()).unwrap();
    run.begin().unwrap();
    run.run_until(seconds(0.02)).unwrap();
    let sum: foxglove::Vector3 = newest(&run, "/adder/sum");
    assert_eq!(sum.y, 3.0, "both messages of 0.02 s had been given before the cycle of 0.02 s");
    let horizon = run.horizon().unwrap();
    run.run_until(horizon).unwrap();
    assert_eq!(newest::<foxglove::Vector3>(&run, "/adder/sum").y, 4.0, "the last message is worked on");
}

#[test]
fn the_summary_of_a_run_on_a_log_has_the_states_at_its_end() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("log.mcap");
    write_log(&path, &[(0.0, "/a", 1.0), (0.02, "/a", 2.0)]);
    let log = Log::open(&path).unwrap();
    let mut run = Stepped::new(plan(ON_LOG).unwrap(), Some(&log), RunOptions::default()).unwrap();
    run.begin().unwrap();
    let horizon = run.horizon().unwrap();
    run.run_until(horizon).unwrap();
    let status: rcs::Status = newest(&run, "/adder/status");
    assert_eq!(status.state_text, "nothing new");
    let adder = run.summary().processes.into_iter().find(|process| process.name == "adder").unwrap();
    assert_eq!((adder.state_text.as_str(), adder.cycles), ("2 numbers", status.cycle));
}

#[test]
fn going_back_and_forward_again_ends_where_going_through_does() {
    let mut through = stepped(PAIR, hashing(1));
    through.begin().unwrap();
    through.run_until(seconds(3.0)).unwrap();

    let task = Task::default();
    let mut session = Session::new(stepped(PAIR, hashing(1))).unwrap();
    session.forward_until(seconds(3.0), &task).unwrap();
    for to in [2.99, 2.5, 0.013, 1.7, 0.0] {
        session.go_to_time(seconds(to), &task).unwrap();
        let mut straight = stepped(PAIR, hashing(1));
        straight.begin().unwrap();
        straight.run_until(seconds(to)).unwrap();
        assert_eq!(hash_of(session.run()), hash_of(&straight), "at {to} s");
    }
    session.forward_until(seconds(3.0), &task).unwrap();
    assert_eq!(hash_of(session.run()), hash_of(&through));
}

#[test]
fn a_long_run_keeps_old_snapshots_on_disk_and_goes_back_through_them() {
    let task = Task::default();
    let mut session = Session::new(stepped(PAIR, hashing(1))).unwrap();
    session.forward_until(seconds(80.0), &task).unwrap();
    for to in [5.5, 60.25, 1.0] {
        session.go_to_time(seconds(to), &task).unwrap();
        let mut straight = stepped(PAIR, hashing(1));
        straight.begin().unwrap();
        straight.run_until(seconds(to)).unwrap();
        assert_eq!(hash_of(session.run()), hash_of(&straight), "at {to} s");
    }
}

#[test]
fn what_the_operator_did_is_done_again_until_a_new_write_begins_a_branch() {
    let params = |publish_hz| {
        ExternalEvent::operator(
            "/counter/params",
            AnyMessage::new(rcs_testkit::proto::CounterParams {
                publish_hz,
                ..rcs_msg::params::default::<rcs_testkit::proto::CounterParams>()
            }),
        )
    };
    let z = |session: &Session| newest::<foxglove::Vector3>(session.run(), "/counter/count").z;
    let task = Task::default();
    let mut session = Session::new(stepped(PAIR, hashing(1))).unwrap();
    session.forward_until(seconds(1.0), &task).unwrap();
    assert_eq!(z(&session), 5.0, "the default");
    session.write(params(9.0)).unwrap();
    session.forward_until(seconds(2.0), &task).unwrap();
    assert_eq!(z(&session), 9.0);
    let hash = hash_of(session.run());

    session.go_to_time(seconds(0.9), &task).unwrap();
    assert_eq!(z(&session), 5.0);
    session.forward_until(seconds(2.0), &task).unwrap();
    assert_eq!(hash_of(session.run()), hash);
    assert_eq!(session.runs().len(), 1);

    session.go_to_time(seconds(0.5), &task).unwrap();
    session.write(params(3.0)).unwrap();
    assert_eq!(session.runs().len(), 2, "a branch");
    session.forward_until(seconds(2.0), &task).unwrap();
    assert_eq!(z(&session), 3.0, "the write at 1.0 s belongs to the other branch");
}

#[test]
fn a_parameter_that_is_nan_or_out_of_range_is_refused_and_changes_nothing() {
    let mut session = Session::new(stepped(PAIR, hashing(1))).unwrap();
    for bad in [f64::NAN, 1000.0] {
        let message = AnyMessage::new(rcs_testkit::proto::CounterParams {
            publish_hz: bad,
            ..rcs_msg::params::default::<rcs_testkit::proto::CounterParams>()
        });
        let write = ExternalEvent::operator("/counter/params", message);
        let error = session.write(write).unwrap_err().to_string();
        assert!(error.contains("publish_hz") && error.contains("0.1") && error.contains("100"), "{error}");
    }
    assert_eq!(session.run().bus().get("/counter/params").unwrap().newest(), 1);
}

#[test]
fn a_process_that_panics_becomes_error_and_the_others_go_on() {
    let stack =
        format!("{PAIR}\n[[process]]\nname = \"fragile\"\nplugin = \"fragile\"\nsupervisor = \"viewer\"\n");
    let mut run = stepped(&stack, RunOptions::default());
    run.begin().unwrap();
    run.run_until(seconds(1.0)).unwrap();
    let status: rcs::Status = newest(&run, "/fragile/status");
    assert_eq!(status.state(), rcs::ProcessState::Error);
    assert_eq!(status.state_text, "panicked: worn out");
    assert_eq!(
        run.bus().get("/fragile/out").unwrap().newest(),
        2,
        "what it wrote in that cycle is not sent on"
    );
    assert_eq!(newest::<rcs::Status>(&run, "/counter/status").state(), rcs::ProcessState::Exec);
    assert!(run.bus().get("/counter/count").unwrap().newest() > 90);
}

#[test]
fn an_override_is_recorded_and_held_through_going_back() {
    let task = Task::default();
    let mut session = Session::new(stepped(PAIR, hashing(1))).unwrap();
    session.forward_until(seconds(0.5), &task).unwrap();
    let message = AnyMessage::new(rcs::Override {
        buffer: "/counter/count".to_owned(),
        mode: rcs::r#override::Mode::Hold.into(),
        path: ".z".to_owned(),
        value_json: "42.0".to_owned(),
        ..Default::default()
    });
    session.write(ExternalEvent::operator("/runtime/override", message)).unwrap();
    session.forward_until(seconds(1.0), &task).unwrap();
    assert_eq!(newest::<foxglove::Vector3>(session.run(), "/counter/count").z, 42.0);
    assert_eq!(session.run().bus().get("/runtime/override").unwrap().newest(), 1);
    session.go_to_time(seconds(0.2), &task).unwrap();
    assert_eq!(newest::<foxglove::Vector3>(session.run(), "/counter/count").z, 5.0);
    session.forward_until(seconds(1.0), &task).unwrap();
    assert_eq!(newest::<foxglove::Vector3>(session.run(), "/counter/count").z, 42.0);
}

#[test]
fn a_recorded_run_opens_with_its_stack_its_processes_and_every_message() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    let mut run = stepped(PAIR, hashing(1));
    let options = RecordOptions { lossless: true, build: "test".to_owned(), ..RecordOptions::default() };
    let recording = Recording::start(&path, run.plan(), run.buffers(), &options).unwrap();
    run.begin().unwrap();
    run.run_until(seconds(1.0)).unwrap();
    recording.finish().unwrap();
    let log = Log::open(&path).unwrap();
    let info = log.info();
    assert!(!info.recovered && info.problems.is_empty(), "{:?}", info.problems);
    for buffer in run.buffers() {
        let recorded: u64 = info.topics_named(buffer.name()).map(|topic| topic.messages).sum();
        assert_eq!(recorded, buffer.newest(), "{}", buffer.name());
    }
    let stack = log.attachment("stack.toml").unwrap().unwrap();
    assert_eq!(stack.data, PAIR.as_bytes());
    let source = &mut rcs_runtime::source::LogSource::new(&log).unwrap();
    let names: Vec<_> = source.frame().processes.iter().map(|info| info.name.clone()).collect();
    assert_eq!(names, ["counter", "adder"]);
    assert_eq!(source.frame().topic("/counter/count").unwrap().role(), Some(Role::Pose));
    assert_eq!(&*source.frame().topic("/counter/count").unwrap().writer, "counter");
}

#[test]
fn a_live_run_on_its_recorded_schedule_gives_the_same_buffers() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("live.mcap");
    let plan = plan(PAIR).unwrap();
    let options = LiveOptions { run: hashing(2), record: Some(path.clone()), ..LiveOptions::default() };
    let live = Live::start(plan.clone(), &options).unwrap();
    let deadline = Instant::now() + Duration::from_mins(1);
    let newest = |live: &Live, buffer: &str| live.bus().get(buffer).unwrap().newest();
    let wait = |live: &Live, count: u64| {
        while newest(live, "/adder/sum") < count {
            assert!(Instant::now() < deadline, "a live run of small processes stands still");
            std::thread::yield_now();
        }
    };
    wait(&live, 5);
    let params = |publish_hz| {
        ExternalEvent::operator(
            "/counter/params",
            AnyMessage::new(rcs_testkit::proto::CounterParams { publish_hz, ..rcs_msg::params::default() }),
        )
    };
    live.take(params(8.0)).unwrap();
    let refused = live.take(params(f64::NAN)).unwrap_err().to_string();
    assert!(refused.contains("publish_hz"), "{refused}");
    wait(&live, 10);
    let hold = rcs::Override {
        buffer: "/counter/count".to_owned(),
        mode: rcs::r#override::Mode::Hold.into(),
        path: ".z".to_owned(),
        value_json: "42.0".to_owned(),
        ..Default::default()
    };
    let hold = ExternalEvent::operator("/runtime/override", AnyMessage::new(hold));
    live.take(hold).unwrap();
    wait(&live, 15);
    let status = live.stop().recording.unwrap().unwrap();
    assert_eq!((status.dropped, status.error), (0, None));

    let log = Log::open(&path).unwrap();
    let recorded = RecordedRun::read(&log, PLUGINS).unwrap();
    let mut again = recorded.stepped(&plan, None, hashing(1)).unwrap();
    let seen = std::sync::Arc::new(std::sync::Mutex::new(Vec::new()));
    let names = [
        "/counter/count",
        "/adder/sum",
        "/counter/status",
        "/adder/status",
        "/counter/params",
        "/runtime/override",
    ];
    for name in names {
        let seen = seen.clone();
        again.bus().get(name).unwrap().tap(Box::new(move |sample| {
            let header = &sample.header;
            let entry = (name.to_owned(), header.sequence, header.log_time, sample.message.bytes());
            seen.lock().unwrap().push(entry);
        }));
    }
    again.begin().unwrap();
    while again.advance().unwrap().is_some() {}
    let mut recorded = Vec::new();
    for message in log.cursor(CursorOptions::default()) {
        let message = message.unwrap();
        let topic = log.info().topic(message.topic).unwrap();
        if names.contains(&topic.name.as_str()) {
            recorded.push((topic.name.clone(), u64::from(message.sequence), message.log_time, message.data));
        }
    }
    let mut seen = seen.lock().unwrap().clone();
    seen.sort();
    recorded.sort();
    assert!(recorded.len() > 50);
    assert_eq!(seen.len(), recorded.len());
    assert!(seen == recorded, "the buffers differ");
}

#[test]
fn a_stack_source_goes_back_to_a_message_by_its_number() {
    let mut source = StackSource::new(plan(PAIR).unwrap(), None, RunOptions::default()).unwrap();
    let task = Task::default();
    source.seek(seconds(3.0), &task).unwrap();
    let newest = |source: &mut StackSource| {
        source.frame().topic("/counter/count").unwrap().latest.as_ref().unwrap().header.sequence
    };
    let last = newest(&mut source);
    let back_to = |sequence| Step::BackTo { topic: "/counter/count".to_owned(), sequence };
    for sequence in [last, last - 1, 2, 1] {
        source.seek(seconds(3.0), &task).unwrap();
        assert!(source.step(&back_to(sequence), &task).unwrap());
        assert_eq!(newest(&mut source), sequence);
        assert!(!source.step(&back_to(sequence), &task).unwrap(), "it is there");
        assert_eq!(newest(&mut source), sequence);
    }
    source.seek(seconds(1.0), &task).unwrap();
    for wrong in [0, last] {
        let error = source.step(&back_to(wrong), &task).unwrap_err().to_string();
        assert!(error.contains(&format!("message {wrong} of /counter/count")), "{error}");
        assert_eq!(source.now(), seconds(1.0), "it stays");
    }
}

#[test]
fn a_stack_source_steps_both_ways_by_message_and_by_cycle() {
    let mut source = StackSource::new(plan(PAIR).unwrap(), None, RunOptions::default()).unwrap();
    let task = Task::default();
    source.seek(seconds(0.5), &task).unwrap();
    let cycle = |process: &str, back| Step::Cycle { process: Some(process.to_owned()), back };
    let message = |topic: &str, back| Step::Message { topic: Some(topic.to_owned()), back };
    let cycles = |source: &mut StackSource| {
        source.frame().topic("/adder/status").unwrap().get::<rcs::Status>().unwrap().cycle
    };
    let start = cycles(&mut source);
    assert!(source.step(&cycle("adder", false), &task).unwrap());
    assert_eq!((cycles(&mut source), source.now()), (start + 1, seconds(0.525)));
    assert!(source.step(&cycle("adder", true), &task).unwrap());
    assert_eq!((cycles(&mut source), source.now()), (start, seconds(0.5)));
    let count = |source: &mut StackSource| source.frame().topic("/counter/count").unwrap().messages;
    let before = count(&mut source);
    assert!(source.step(&message("/counter/count", false), &task).unwrap());
    assert_eq!(count(&mut source), before + 1);
    for _ in 0..5 {
        assert!(source.step(&message("/counter/count", true), &task).unwrap());
    }
    assert_eq!(count(&mut source), before - 4);
    assert!(source.step(&cycle("nobody", false), &task).is_err());
    source.seek(seconds(0.0), &task).unwrap();
    assert!(!source.step(&message("/counter/count", true), &task).unwrap(), "nothing lies before the start");
}

/// Counts emergency stops.
#[derive(Clone, serde::Serialize, serde::Deserialize)]
struct Stops {
    read: u64,
    missed: u64,
}

impl Process for Stops {
    type Params = rcs::NoParams;
    type Ports = (In<rcs::EmergencyStop>, Out<foxglove::Vector3>);
    type Command = rcs_runtime::NoCommands;
    const DEF: ProcessDef = ProcessDef {
        plugin: "stops",
        summary: "Counts emergency stops.",
        period_ms: 1000.0,
        latency_ms: 0.0,
        reads_ground_truth: false,
    };

    fn ports(b: &mut PortBuilder) -> Self::Ports {
        (b.input("stop", "Counted."), b.output("count", "Read, missed.").build())
    }

    fn new(_params: &Self::Params) -> Self {
        Self { read: 0, missed: 0 }
    }

    fn cycle(&mut self, (stop, count): &Self::Ports, _params: &Self::Params, cx: &mut Cycle<'_>) {
        self.missed += cx.missed(stop);
        while cx.read(stop).is_some() {
            self.read += 1;
        }
        let (x, y) = (self.read as f64, self.missed as f64);
        cx.write(count, cx.now(), foxglove::Vector3 { x, y, z: 0.0 });
    }
}

#[test]
fn no_emergency_stop_is_dropped_however_many_come_in_a_cycle() {
    let text = r#"
format = 1
name = "stops"

[[process]]
name = "stops"
plugin = "stops"
supervisor = "viewer"
inputs = { stop = "/operator/emergency_stop" }
"#;
    let file = rcs_runtime::StackFile::parse("test.toml", text).unwrap();
    let plan = Plan::new(file, &[ProcessType::of::<Stops>()], &[]).unwrap();
    let run = Stepped::new(std::sync::Arc::new(plan), None, RunOptions::default()).unwrap();
    let mut session = Session::new(run).unwrap();
    let task = Task::default();
    session.forward_until(seconds(0.5), &task).unwrap();
    let buffer = "/operator/emergency_stop".to_owned();
    for index in 0..1000 {
        let message = AnyMessage::new(rcs::EmergencyStop { active: index % 2 == 0, ..Default::default() });
        session.write(ExternalEvent::operator(buffer.as_str(), message)).unwrap();
    }
    session.forward_until(seconds(1.0), &task).unwrap();
    let count = newest::<foxglove::Vector3>(session.run(), "/stops/count");
    assert_eq!((count.x, count.y), (1000.0, 0.0));
}

#[test]
fn a_topic_that_falls_silent_keeps_the_rate_of_its_last_seconds_and_one_message_has_none() {
    let mut source = StackSource::new(plan(PAIR).unwrap(), None, RunOptions::default()).unwrap();
    let task = Task::default();
    source.seek(seconds(1.0), &task).unwrap();
    let halt = rcs::Command { serial: 2, name: "HALT".to_owned(), ..Default::default() };
    source.write("/counter/command", AnyMessage::new(halt)).unwrap();
    source.seek(seconds(60.0), &task).unwrap();
    let frame = source.frame();
    let count = frame.topic("/counter/count").unwrap();
    assert!(count.hz.is_some_and(|hz| (hz - 100.0).abs() < 2.0), "{:?}", count.hz);
    assert!(count.age_s(frame.now).unwrap() > 58.0, "so it is known to be old");
    assert_eq!(
        (frame.topic("/runtime/run").unwrap().messages, frame.topic("/runtime/run").unwrap().hz),
        (1, None)
    );
    source.seek(seconds(0.5), &task).unwrap();
    let frame = source.frame();
    let sum = frame.topic("/adder/sum").unwrap();
    assert!(sum.hz.is_some_and(|hz| (hz - 40.0).abs() < 1.0), "{:?}", sum.hz);
}
