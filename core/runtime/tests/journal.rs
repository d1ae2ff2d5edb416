//! Journal, replay and comparison: a recorded run can be repeated, and a difference is named.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

mod common;

use common::{PAIR, PLUGINS, newest, plan, seconds, stepped};
use rcs_log::{CursorOptions, Log, LogWriter, WriteHeader, WriterOptions};
use rcs_msg::{AnyMessage, DeferredSource as _, Stamp, foxglove, rcs};
use rcs_runtime::source::{Source, StackSource, Task, finish_idle};
use rcs_runtime::{
    Difference, EventPlace, ExternalEvent, Live, LiveOptions, NoAssets, PastOptions, Plan, RecordOptions,
    RecordWhat, RecordedRun, Recording, Replay, RunId, RunOptions, StackFile, Stepped, diff, diff_each,
    diff_runs,
};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

fn hashing() -> RunOptions {
    RunOptions { hash: true, seed: 7, ..RunOptions::default() }
}

fn hash_of(run: &Stepped) -> String {
    run.summary().hash.unwrap()
}

fn params(publish_hz: f64) -> ExternalEvent {
    let message = rcs_testkit::proto::CounterParams { publish_hz, ..rcs_msg::params::default() };
    ExternalEvent::operator("/counter/params", AnyMessage::new(message))
}

fn hold(path: &str, value: &str) -> ExternalEvent {
    let message = rcs::Override {
        buffer: "/counter/count".to_owned(),
        mode: rcs::r#override::Mode::Hold.into(),
        path: path.to_owned(),
        value_json: value.to_owned(),
        ..Default::default()
    };
    ExternalEvent::operator("/runtime/override", AnyMessage::new(message))
}

/// Two seconds of a counter and an adder in which an operator changes a parameter and overrides a field; returns the
/// hash.
fn record(path: &Path, what: RecordWhat) -> String {
    let mut run = stepped(PAIR, hashing());
    let options =
        RecordOptions { lossless: true, build: "test".to_owned(), what, ..RecordOptions::default() };
    let recording = Recording::start(path, run.plan(), run.buffers(), &options).unwrap();
    run.begin().unwrap();
    run.run_until(seconds(0.5)).unwrap();
    run.take(params(9.0)).unwrap();
    run.take(params(11.0)).unwrap();
    run.run_until(seconds(1.001)).unwrap();
    run.take(hold(".z", "42.0")).unwrap();
    run.run_until(seconds(2.0)).unwrap();
    recording.finish_at(run.now()).unwrap();
    hash_of(&run)
}

fn folder() -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    (folder, path)
}

/// Repeats a recording: returns the hash and the first difference.
fn repeat(log: &Log) -> (String, Option<Difference>) {
    let recorded = RecordedRun::read(log, PLUGINS).unwrap();
    let plan = recorded.plan(PLUGINS).unwrap();
    let run = recorded.stepped(&plan, None, hashing()).unwrap();
    let mut replay = Replay::new(recorded, run).unwrap();
    replay.run_until(rcs_msg::Stamp::MAX).unwrap();
    (hash_of(replay.run()), replay.first().cloned())
}

/// Copies a recording with some messages changed.
fn copy(from: &Log, to: &Path, change: impl FnMut(&str, u32, &mut Vec<u8>)) {
    rcs_testkit::logs::copy_changed(from, to, change).unwrap();
}

#[test]
fn a_recorded_run_with_an_operator_in_it_replays_to_the_same_hash() {
    let (_folder, path) = folder();
    let hash = record(&path, RecordWhat::All);
    let log = Log::open(&path).unwrap();
    let recorded = RecordedRun::read(&log, PLUGINS).unwrap();
    assert_eq!((recorded.journal().len(), recorded.problems()), (3, &[][..]));
    assert_eq!(repeat(&log), (hash, None));
}

#[test]
fn a_journal_alone_and_a_list_of_buffers_replay_to_the_hash_of_the_whole() {
    let (folder, path) = folder();
    let hash = record(&path, RecordWhat::All);
    let whole = std::fs::metadata(&path).unwrap().len();
    let path = folder.path().join("journal.mcap");
    assert_eq!(record(&path, RecordWhat::Journal), hash);
    let log = Log::open(&path).unwrap();
    assert!(RecordedRun::is_journal_alone(&log));
    assert!(log.info().topics.iter().all(|topic| topic.name.starts_with("/runtime/")));
    assert!(std::fs::metadata(&path).unwrap().len() < whole, "it is smaller than {whole} bytes");
    assert_eq!(repeat(&log), (hash.clone(), None));
    let path = folder.path().join("list.mcap");
    assert_eq!(record(&path, RecordWhat::Buffers(vec!["/adder/sum".to_owned()])), hash);
    let log = Log::open(&path).unwrap();
    assert!(log.info().topics.iter().any(|topic| topic.name == "/adder/sum"));
    assert!(!log.info().topics.iter().any(|topic| topic.name == "/counter/count"));
    assert_eq!(repeat(&log), (hash, None));
}

#[test]
fn a_list_with_a_buffer_that_is_not_there_is_refused_by_name() {
    let (_folder, path) = folder();
    let run = stepped(PAIR, hashing());
    let what = RecordWhat::Buffers(vec!["/nobody/nothing".to_owned()]);
    let options = RecordOptions { lossless: true, build: String::new(), what, ..RecordOptions::default() };
    let error = Recording::start(&path, run.plan(), run.buffers(), &options).err().unwrap().to_string();
    assert!(error.contains("/nobody/nothing"), "{error}");
}

#[test]
fn a_byte_changed_in_one_recorded_message_is_found_and_named() {
    let (folder, path) = folder();
    record(&path, RecordWhat::All);
    let (log, changed) = (Log::open(&path).unwrap(), folder.path().join("changed.mcap"));
    let same = folder.path().join("same.mcap");
    copy(&log, &same, |_, _, _| {});
    assert_eq!(diff(&log, &Log::open(&same).unwrap()).unwrap(), None, "a copy agrees");
    // Vector3: tags and doubles; bytes 1 to 8 are x.
    copy(&log, &changed, |topic, sequence, data| {
        if topic == "/counter/count" && sequence == 70 {
            data[4] ^= 1;
        }
    });
    let changed = Log::open(&changed).unwrap();
    let found = diff(&log, &changed).unwrap().unwrap();
    assert_eq!((found.buffer.as_str(), found.sequence, found.field.as_str()), ("/counter/count", 70, ".x"));
    assert!((found.time_s - 0.693).abs() < 1e-9, "{found:?}");
    let (_, first) = repeat(&changed);
    let first = first.unwrap();
    assert_eq!((first.buffer, first.sequence, first.field), (found.buffer, 70, found.field));
}

#[test]
fn two_recordings_of_runs_that_differ_are_told_apart_where_they_first_do() {
    let (folder, path) = folder();
    record(&path, RecordWhat::All);
    let other = folder.path().join("other.mcap");
    let mut run = stepped(PAIR, hashing());
    let options = RecordOptions { lossless: true, build: "test".to_owned(), ..RecordOptions::default() };
    let recording = Recording::start(&other, run.plan(), run.buffers(), &options).unwrap();
    run.begin().unwrap();
    run.run_until(seconds(0.5)).unwrap();
    run.take(params(9.5)).unwrap();
    run.run_until(seconds(2.0)).unwrap();
    recording.finish_at(run.now()).unwrap();
    let found = diff(&Log::open(&path).unwrap(), &Log::open(&other).unwrap()).unwrap().unwrap();
    assert_eq!((found.buffer.as_str(), found.time_s), ("/counter/params", 0.5), "{found:?}");
    assert_eq!(found.field, ".publish_hz");
}

#[test]
fn what_runs_say_of_themselves_is_told_apart_from_the_first_difference_of_each_buffer() {
    let folder = tempfile::tempdir().unwrap();
    let run = |name: &str, seed: u64, hz: &str| {
        let path = folder.path().join(name);
        let overrides = [("counter.publish_hz".to_owned(), hz.to_owned())];
        let file = StackFile::parse("test.toml", PAIR).unwrap();
        let plan = Arc::new(Plan::new(file, PLUGINS, &overrides).unwrap());
        let mut run = Stepped::new(plan, None, RunOptions { seed, ..RunOptions::default() }).unwrap();
        let options = RecordOptions { lossless: true, ..RecordOptions::default() };
        let recording = Recording::start(&path, run.plan(), run.buffers(), &options).unwrap();
        run.begin().unwrap();
        run.run_until(seconds(0.5)).unwrap();
        recording.finish_at(run.now()).unwrap();
        Log::open(&path).unwrap()
    };
    let told = |a: &Log, b: &Log| -> Vec<(String, [String; 2])> {
        diff_runs(a, b).unwrap().into_iter().map(|run| (run.field, run.values)).collect()
    };
    let values = |field: &str, values: [&str; 2]| (field.to_owned(), values.map(str::to_owned));
    let (plain, seeded, faster) = (run("plain", 7, "5"), run("seeded", 8, "5"), run("faster", 7, "6"));
    assert_eq!((told(&plain, &plain), diff_each(&plain, &plain).unwrap()), (vec![], vec![]));
    // The adder sums the random numbers of the counter.
    assert_eq!(told(&plain, &seeded), [values("seed", ["7", "8"])]);
    let first = diff(&plain, &seeded).unwrap().unwrap();
    assert_eq!((first.buffer.as_str(), first.field.as_str()), ("/counter/count", ".y"), "{first:?}");
    let each = diff_each(&plain, &seeded).unwrap();
    let buffers: Vec<&str> = each.iter().map(|difference| difference.buffer.as_str()).collect();
    assert_eq!((each.first(), buffers), (Some(&first), vec!["/counter/count", "/adder/sum"]));
    let params = ["counter.publish_hz = 5", "counter.publish_hz = 6"];
    assert_eq!(told(&plain, &faster), [values("params", params)]);
    let first = diff(&plain, &faster).unwrap().unwrap();
    assert_eq!((first.buffer.as_str(), first.field.as_str()), ("/counter/params", ".publish_hz"));
    assert_eq!(first.values, ["5", "6"]);
    // A log that is no run has nothing to say of one.
    let log = folder.path().join("log");
    common::write_log(&log, &[(0.0, "/a", 1.0)]);
    let log = Log::open(&log).unwrap();
    assert_eq!((told(&log, &log), told(&plain, &log)), (vec![], vec![values("run", ["a run", ""])]));
}

#[test]
fn another_stack_seed_or_parameter_is_refused_by_name() {
    let (_folder, path) = folder();
    record(&path, RecordWhat::Journal);
    let recorded = RecordedRun::read(&Log::open(&path).unwrap(), PLUGINS).unwrap();
    let plan_of = |text: &str| plan(text).unwrap();
    let check = |error: Result<(), rcs_runtime::RunError>, expected: &[&str]| {
        let error = error.unwrap_err().to_string();
        assert!(expected.iter().all(|part| error.contains(part)), "{error}");
    };
    assert!(recorded.check(&plan_of(PAIR), Some(7)).is_ok());
    check(recorded.check(&plan_of(PAIR), Some(8)), &["seed 7", "got 8"]);
    let other = PAIR.replace("period_ms = 25", "period_ms = 30");
    check(recorded.check(&plan_of(&other), None), &["another stack", "pair"]);
    let overrides = [("counter.publish_hz".to_owned(), "7.5".to_owned())];
    let changed = recorded.plan_with(PLUGINS, &overrides, &NoAssets).unwrap();
    check(recorded.check(&changed, None), &["counter.publish_hz", "got 7.5", "expected 5"]);
    let same = [("counter.publish_hz".to_owned(), "5".to_owned())];
    assert!(recorded.check(&recorded.plan_with(PLUGINS, &same, &NoAssets).unwrap(), None).is_ok());
}

#[test]
fn a_recording_cut_anywhere_is_repeated_as_far_as_it_goes_and_never_panics() {
    let (folder, path) = folder();
    record(&path, RecordWhat::All);
    let bytes = std::fs::read(&path).unwrap();
    let cut = folder.path().join("cut.mcap");
    let (mut refused, mut repeated, mut last_end) = (0, 0, Stamp(0));
    for part in 0..60 {
        let length = bytes.len() * part / 60;
        std::fs::write(&cut, &bytes[..length]).unwrap();
        let Ok(log) = Log::open(&cut) else {
            refused += 1;
            continue;
        };
        match RecordedRun::read(&log, PLUGINS) {
            Err(error) => {
                assert!(error.to_string().contains("/runtime/run"), "{error}");
                refused += 1;
            }
            Ok(recorded) => {
                assert!(!recorded.problems().is_empty(), "cut at {length} of {}", bytes.len());
                let end = recorded.end();
                assert!(end >= last_end, "cut at {length} of {}: {end:?} after {last_end:?}", bytes.len());
                last_end = end;
                let plan = recorded.plan(PLUGINS).unwrap();
                let run = recorded.stepped(&plan, None, hashing()).unwrap();
                let mut replay = Replay::new(recorded, run).unwrap();
                replay.run_until(rcs_msg::Stamp::MAX).unwrap();
                assert_eq!(replay.first(), None, "cut at {length} of {}", bytes.len());
                // Every recorded time is that of an event of the run.
                assert_eq!(replay.run().now(), end, "cut at {length} of {}", bytes.len());
                repeated += 1;
            }
        }
    }
    assert!(last_end > seconds(1.0), "of 2 s, the longest part has those up to {last_end:?}");
    assert!(refused > 0 && repeated > 10, "{refused} refused, {repeated} repeated");
}

#[test]
fn a_journal_with_a_gap_or_an_unreadable_event_is_said_and_repeated_up_to_there() {
    let (folder, path) = folder();
    record(&path, RecordWhat::All);
    let (log, bad) = (Log::open(&path).unwrap(), folder.path().join("bad.mcap"));
    copy(&log, &bad, |topic, sequence, data| {
        if topic == "/runtime/journal" && sequence == 3 {
            data.clear();
        }
    });
    let recorded = RecordedRun::read(&Log::open(&bad).unwrap(), PLUGINS).unwrap();
    assert_eq!(recorded.journal().len(), 2);
    assert_eq!(recorded.end(), seconds(0.5));
    assert!(
        recorded.problems().iter().any(|problem| problem.contains("journal")),
        "{:?}",
        recorded.problems()
    );
    assert_eq!(repeat(&Log::open(&bad).unwrap()).1, None);
}

#[test]
fn a_log_that_is_no_recording_of_a_run_is_refused() {
    let (_folder, path) = folder();
    common::write_log(&path, &[(0.0, "/a", 1.0)]);
    let error = RecordedRun::read(&Log::open(&path).unwrap(), PLUGINS).unwrap_err().to_string();
    assert!(error.contains("holds no run"), "{error}");
}

#[test]
fn a_live_run_with_a_sensor_an_edit_and_a_command_replays_to_its_own_hash() {
    let (folder, path) = folder();
    let stack = format!(
        "{PAIR}\n[[input]]\nbuffer = \"/in\"\ntopic = \"/sensor\"\n\n[[process]]\nname = \"second\"\n\
         plugin = \"adder\"\nsupervisor = \"viewer\"\ninputs = {{ input = \"/in\" }}\n"
    );
    // The tables of buffers are at the end of the file.
    let (buffers, rest) = (stack.find("[buffers").unwrap(), stack.find("[[input]]").unwrap());
    let stack = format!("{}{}{}", &stack[..buffers], &stack[rest..], &stack[buffers..rest]);
    let plan = plan(&stack).unwrap();
    let options = LiveOptions { run: hashing(), record: Some(path.clone()), ..LiveOptions::default() };
    let live = Live::start(plan, &options).unwrap();
    let deadline = Instant::now() + Duration::from_mins(1);
    let newest = |buffer: &str| live.bus().get(buffer).unwrap().newest();
    let wait = |count: u64| {
        while newest("/counter/count") < count {
            assert!(Instant::now() < deadline, "a live run of small processes stands still");
            std::thread::yield_now();
        }
    };
    let sense = |x: f64| {
        let message = AnyMessage::new(foxglove::Vector3 { x, ..Default::default() });
        live.take(ExternalEvent::sensed("/in", live.now(), message)).unwrap();
    };
    wait(5);
    sense(1.0);
    live.take(params(9.0)).unwrap();
    wait(10);
    sense(2.0);
    live.take(hold(".z", "42")).unwrap();
    let halt = rcs::Command { serial: 9, name: "HALT".to_owned(), ..Default::default() };
    live.take(ExternalEvent::operator("/second/command", AnyMessage::new(halt))).unwrap();
    wait(20);
    let stopped = live.stop();
    assert_eq!(stopped.recording.unwrap().unwrap().dropped, 0);
    let log = Log::open(&path).unwrap();
    assert_eq!(repeat(&log), (stopped.summary.hash.unwrap(), None));
    // Without one of its cycles the schedule has a gap, and the run is repeated only up to it.
    let bad = folder.path().join("bad.mcap");
    copy(&log, &bad, |topic, sequence, data| {
        if topic == "/runtime/schedule" && sequence == 30 {
            *data = vec![0xff];
        }
    });
    let bad = Log::open(&bad).unwrap();
    let recorded = RecordedRun::read(&bad, PLUGINS).unwrap();
    assert!(
        recorded.problems().iter().any(|problem| problem.contains("schedule")),
        "{:?}",
        recorded.problems()
    );
    assert!(recorded.end() < RecordedRun::read(&log, PLUGINS).unwrap().end());
    assert_eq!(repeat(&bad).1, None);
}

/// Copies the first messages of a recording, and no end: as of a run that was killed.
fn copy_first(from: &Log, to: &Path, count: usize) {
    let mut writer = LogWriter::create(to, WriterOptions::default()).unwrap();
    let mut channels = BTreeMap::new();
    for topic in &from.info().topics {
        let channel = writer.add_channel(&topic.name, &topic.schema, &topic.metadata).unwrap();
        channels.insert(topic.id, channel);
    }
    for message in from.cursor(CursorOptions::default()).take(count) {
        let message = message.unwrap();
        let header = WriteHeader {
            sequence: message.sequence,
            log_time: message.log_time,
            publish_time: message.publish_time,
        };
        writer.write(channels[&message.topic], header, &message.data).unwrap();
    }
    writer.finish().unwrap();
}

#[test]
fn a_live_recording_cut_after_any_message_replays_to_its_last_whole_cycle_and_a_finished_one_to_its_end() {
    let (folder, path) = folder();
    let options = LiveOptions { run: hashing(), record: Some(path.clone()), ..LiveOptions::default() };
    let live = Live::start(plan(PAIR).unwrap(), &options).unwrap();
    let deadline = Instant::now() + Duration::from_mins(1);
    let wait = |count: u64| {
        while live.bus().get("/counter/count").unwrap().newest() < count {
            assert!(Instant::now() < deadline, "a live run of small processes stands still");
            std::thread::yield_now();
        }
    };
    wait(4);
    live.take(params(9.0)).unwrap();
    wait(7);
    assert_eq!(live.stop().recording.unwrap().unwrap().dropped, 0);
    let log = Log::open(&path).unwrap();
    let topic_of = |id| log.info().topic(id).unwrap().name.as_str();
    let messages: Vec<_> = log.cursor(CursorOptions::default()).map(Result::unwrap).collect();
    let cut = folder.path().join("cut.mcap");
    let mut cycle = None;
    for (message, count) in messages.iter().zip(1..) {
        copy_first(&log, &cut, count);
        let part = Log::open(&cut).unwrap();
        assert_eq!(repeat(&part).1, None, "cut after message {count} of {}", messages.len());
        if ["/runtime/schedule", "/runtime/journal"].contains(&topic_of(message.topic)) {
            cycle = Some(message.log_time);
        }
        let end = RecordedRun::read(&part, PLUGINS).unwrap().end();
        assert_eq!(end, cycle.unwrap_or(log.info().start), "cut after message {count}");
        std::fs::remove_file(&cut).unwrap();
    }
    // The last message of the finished recording is compared.
    let counts = log.info().topics_named("/counter/count").map(|topic| topic.messages).sum::<u64>();
    let changed = folder.path().join("changed.mcap");
    copy(&log, &changed, |topic, sequence, data| {
        if topic == "/counter/count" && u64::from(sequence) == counts {
            data[4] ^= 1;
        }
    });
    let first = repeat(&Log::open(&changed).unwrap()).1.unwrap();
    assert_eq!((first.buffer.as_str(), first.sequence), ("/counter/count", counts));
}

/// The journal alone of a live run of a minute, in which the operator changes a parameter near the end.
fn record_live(path: &Path) {
    let ms = |ms: u64| Stamp(ms * 1_000_000);
    let mut run = stepped(PAIR, hashing());
    run.begin().unwrap();
    let info = rcs::RunInfo { live: true, ..newest(&run, "/runtime/run") };
    let event = params(9.0).at(EventPlace { events: 0, time: ms(59_005) });
    let mut messages = vec![
        (ms(1000), "/runtime/run", AnyMessage::new(info)),
        (ms(59_005), "/runtime/journal", AnyMessage::new(event.to_message())),
    ];
    // In a live run no two things happen at one time.
    for (process, first, period) in [("counter", 1010, 10), ("adder", 1012, 25)] {
        for start in (first..60_000).step_by(period) {
            let (start, end) = (ms(start), ms(start + 1));
            let process = process.to_owned();
            let cycle = rcs::CycleRecord { process, start_ns: start.0, end_ns: end.0, ..Default::default() };
            messages.push((end, "/runtime/schedule", AnyMessage::new(cycle)));
        }
    }
    messages.sort_by_key(|(time, ..)| *time);
    let mut writer = LogWriter::create(path, WriterOptions::default()).unwrap();
    let mut channels = BTreeMap::new();
    for (time, topic, message) in &messages {
        let (channel, sequence) = channels
            .entry(*topic)
            .or_insert_with(|| (writer.add_channel(topic, &message.schema(), &BTreeMap::new()).unwrap(), 0));
        *sequence += 1;
        let header = WriteHeader { sequence: *sequence, log_time: *time, publish_time: *time };
        writer.write(*channel, header, &message.bytes()).unwrap();
    }
    let end =
        [("time_ns", ms(60_100).0), ("dropped", 0)].map(|(key, value)| (key.to_owned(), value.to_string()));
    writer.metadata("run_end", end.into()).unwrap();
    writer.finish().unwrap();
}

#[test]
fn the_past_of_a_repeated_live_run_goes_to_disk_and_goes_on_from_there_with_what_is_still_to_come() {
    let (folder, path) = folder();
    record_live(&path);
    let recorded = RecordedRun::read(&Log::open(&path).unwrap(), PLUGINS).unwrap();
    let plan = recorded.plan(PLUGINS).unwrap();
    let past = PastOptions { memory_bytes: 4 << 20, disk_bytes: 1 << 30, folder: folder.path().join("past") };
    let options = RunOptions { past, ..RunOptions::default() };
    let mut source = StackSource::repeating(&recorded, &plan, None, options).unwrap();
    let task = Task::default();
    source.seek(Stamp::MAX, &task).unwrap();
    let frame = source.frame();
    assert!(frame.info.problems.is_empty(), "{:?}", frame.info.problems);
    let usage = source.session().past_use();
    assert!(usage.disk_bytes > 0 && usage.with_snapshot > 50, "{usage:?}");
    // Another run begins from a snapshot on disk.
    let parameter = |source: &mut StackSource, at: Stamp| {
        source.seek(at, &task).unwrap();
        finish_idle(source);
        source.frame().topic("/counter/count").unwrap().get::<foxglove::Vector3>().unwrap().z
    };
    assert_eq!((parameter(&mut source, seconds(59.0)), parameter(&mut source, Stamp::MAX)), (5.0, 9.0));
    source.seek(seconds(10.0), &task).unwrap();
    source.write("/counter/params", params(3.0).message).unwrap();
    assert_eq!((parameter(&mut source, seconds(59.0)), parameter(&mut source, Stamp::MAX)), (3.0, 9.0));
}

#[test]
fn a_repeated_run_goes_on_beyond_the_recorded_end_only_after_an_act_of_the_operator() {
    let (_folder, path) = folder();
    record(&path, RecordWhat::Journal);
    let recorded = RecordedRun::read(&Log::open(&path).unwrap(), PLUGINS).unwrap();
    let plan = recorded.plan(PLUGINS).unwrap();
    let mut source = StackSource::repeating(&recorded, &plan, None, RunOptions::default()).unwrap();
    let (task, end) = (Task::default(), recorded.end());
    let reaches = |source: &mut StackSource| {
        source.seek(seconds(3.0), &task).unwrap();
        (source.now(), source.frame().info.end)
    };
    assert_eq!(reaches(&mut source), (end, Some(end)));
    source.seek(seconds(1.5), &task).unwrap();
    source.write("/counter/params", params(3.0).message).unwrap();
    assert_eq!(reaches(&mut source), (seconds(3.0), None), "another run");
    source.switch_run(RunId(0)).unwrap();
    assert_eq!(reaches(&mut source), (end, Some(end)), "the recorded one");
    source.write("/counter/params", params(3.0).message).unwrap();
    assert_eq!(reaches(&mut source), (seconds(3.0), None), "an act at the recorded end");
}
