//! Comparisons in the background: of branches, of a run and a recording, and of two recordings.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

mod common;

use common::{PAIR, plan, seconds, stepped, write_log};
use rcs_log::{LogWriter, WriteHeader, WriterOptions};
use rcs_msg::{AnyMessage, Stamp, foxglove, schema_of};
use rcs_runtime::source::{Compared, Comparison, LogSource, Source, StackSource, Task, finish_idle};
use rcs_runtime::{
    NotCompared, PastOptions, RecordOptions, Recording, RunId, RunOptions, diff, diff_each, diff_lengths,
    diff_starts, not_compared,
};
use std::collections::BTreeMap;
use std::path::Path;

const RUNS: [Compared; 2] = [Compared::Run(RunId(0)), Compared::Run(RunId(1))];

/// Where the parameter of the counter shows; the adder does not use the field that differs.
const SPREAD: [&str; 3] = ["/counter/params", "/runtime/journal", "/counter/count"];

fn source(past: PastOptions) -> StackSource {
    let options = RunOptions { seed: 7, past, ..RunOptions::default() };
    StackSource::new(plan(PAIR).unwrap(), None, options).unwrap()
}

fn set_parameter(source: &mut StackSource, publish_hz: f64) {
    let params = rcs_testkit::proto::CounterParams { publish_hz, ..rcs_msg::params::default() };
    source.write("/counter/params", AnyMessage::new(params)).unwrap();
}

fn go(source: &mut dyn Source, to_s: f64) {
    source.seek(seconds(to_s), &Task::default()).unwrap();
}

/// The comparison of a pair, once everything that is known was compared.
fn compared(source: &mut dyn Source, sides: [Compared; 2]) -> Comparison {
    source.compare(&[sides]);
    finish_idle(source);
    let comparison = source.frame().comparison(sides).unwrap().clone();
    assert_eq!(comparison.progress, None);
    comparison
}

fn buffers(comparison: &Comparison) -> Vec<&str> {
    comparison.differences.iter().map(|difference| difference.buffer.as_str()).collect()
}

/// Three seconds, and a branch at the first of them in which a parameter is another.
fn branched(past: PastOptions) -> StackSource {
    let mut source = source(past);
    go(&mut source, 3.0);
    go(&mut source, 1.0);
    set_parameter(&mut source, 3.0);
    go(&mut source, 2.0);
    source
}

#[test]
fn a_difference_spreads_from_the_act_of_the_operator_to_the_outputs_in_order_of_time() {
    let mut source = branched(PastOptions::default());
    let comparison = compared(&mut source, RUNS);
    // The journal says first that a branch begins.
    assert_eq!(buffers(&comparison), ["/runtime/journal", "/counter/params", "/counter/count"]);
    let [_, params, count] = &comparison.differences[..] else { panic!() };
    assert_eq!((params.time, params.field.as_str()), (seconds(1.0), "message"));
    assert_eq!(params.values, ["", "a message"]);
    // The cycle at 1 s had begun, and becomes visible 3 ms later: the next one is the first with the parameter.
    assert_eq!((count.field.as_str(), count.time), (".z", seconds(1.013)));
    assert_eq!(count.values, ["5", "3"]);
    assert_eq!(comparison.until, Some(seconds(2.0)), "as far as both go");
    assert!(comparison.gaps.is_empty() && comparison.problem.is_none());
}

#[test]
fn a_comparison_follows_runs_that_go_on_and_equal_runs_stay_equal() {
    let mut source = branched(PastOptions::default());
    source.switch_run(RunId(0)).unwrap();
    go(&mut source, 1.0);
    set_parameter(&mut source, 3.0);
    let sides = [Compared::Run(RunId(1)), Compared::Run(RunId(2))];
    for to_s in [1.2, 1.7, 2.0] {
        go(&mut source, to_s);
        let comparison = compared(&mut source, sides);
        assert_eq!(buffers(&comparison), Vec::<&str>::new());
        assert_eq!(comparison.until, Some(seconds(to_s)));
    }
    set_parameter(&mut source, 4.0);
    go(&mut source, 3.0);
    assert_eq!(compared(&mut source, sides).differences.len(), 0, "the other run ends here");
    source.switch_run(RunId(1)).unwrap();
    go(&mut source, 3.0);
    assert_eq!(buffers(&compared(&mut source, sides)), SPREAD);
    source.compare(&[]);
    assert!(source.frame().comparisons.is_empty());
}

#[test]
fn runs_are_compared_from_disk_and_what_was_not_kept_is_named() {
    let reference = buffers(&compared(&mut branched(PastOptions::default()), RUNS)).join(" ");
    let folder = tempfile::tempdir().unwrap();
    let past = |disk_bytes| PastOptions { memory_bytes: 1, disk_bytes, folder: folder.path().to_owned() };
    let from_disk = compared(&mut branched(past(1 << 30)), RUNS);
    assert_eq!(buffers(&from_disk).join(" "), reference);
    assert!(from_disk.gaps.is_empty());
    let lost = compared(&mut branched(past(0)), RUNS);
    assert_eq!(lost.differences.is_empty(), !lost.gaps.is_empty());
}

fn record(path: &Path, publish_hz: Option<f64>) {
    record_stack(PAIR, path, publish_hz);
}

fn record_stack(stack: &str, path: &Path, publish_hz: Option<f64>) {
    let mut run = stepped(stack, RunOptions { seed: 7, ..RunOptions::default() });
    let options = RecordOptions { lossless: true, ..RecordOptions::default() };
    let recording = Recording::start(path, run.plan(), run.buffers(), &options).unwrap();
    run.begin().unwrap();
    run.run_until(seconds(1.0)).unwrap();
    if let Some(publish_hz) = publish_hz {
        let params = rcs_testkit::proto::CounterParams { publish_hz, ..rcs_msg::params::default() };
        run.take(rcs_runtime::ExternalEvent::operator("/counter/params", AnyMessage::new(params))).unwrap();
    }
    run.run_until(seconds(2.0)).unwrap();
    recording.finish_at(run.now()).unwrap();
}

#[test]
fn two_recordings_are_compared_to_their_ends_and_the_first_difference_is_that_of_diff() {
    let folder = tempfile::tempdir().unwrap();
    let [plain, same, other] = ["plain", "same", "other"].map(|name| folder.path().join(name));
    record(&plain, None);
    record(&same, None);
    record(&other, Some(3.0));
    let mut source = LogSource::open(&plain).unwrap();
    let sides = [Compared::Recorded, Compared::Other];
    let problem = compared(&mut source, sides).problem.unwrap();
    assert!(problem.contains("no other recording"), "{problem}");
    source.against(std::slice::from_ref(&same));
    let comparison = compared(&mut source, sides);
    assert_eq!((buffers(&comparison).len(), comparison.left_out), (0, [0, 0]));
    assert_eq!(comparison.until, source.info().end);
    // A recording that was split is one.
    let parts = [folder.path().join("same_0"), folder.path().join("same_1")];
    let whole = rcs_log::Log::open(&same).unwrap();
    rcs_testkit::logs::split(&whole, seconds(1.3), [&parts[0], &parts[1]]).unwrap();
    source.against(&parts);
    assert_eq!(source.frame().against.as_deref(), Some("same_0 (2 files)"));
    let comparison = compared(&mut source, sides);
    assert_eq!((buffers(&comparison).len(), comparison.left_out), (0, [0, 0]));
    assert_eq!(comparison.until, source.info().end);
    source.against(std::slice::from_ref(&other));
    assert_eq!(source.frame().against.as_deref(), Some("other"));
    let comparison = compared(&mut source, sides);
    assert_eq!(buffers(&comparison), SPREAD);
    let [plain, other] = [&plain, &other].map(|path| rcs_log::Log::open(path).unwrap());
    assert_eq!(diff(&plain, &other).unwrap().as_ref(), comparison.differences.first());
    source.against(&[folder.path().join("absent")]);
    let problem = compared(&mut source, sides).problem.unwrap();
    assert!(problem.contains("absent"), "{problem}");
}

#[test]
fn of_two_recordings_of_one_run_nothing_differs_up_to_the_end_of_the_shorter_one() {
    let folder = tempfile::tempdir().unwrap();
    let [short, long] = ["short", "long"].map(|name| folder.path().join(name));
    for (path, to_s) in [(&short, 1.2), (&long, 2.0)] {
        let mut run = stepped(PAIR, RunOptions { seed: 7, ..RunOptions::default() });
        let options = RecordOptions { lossless: true, ..RecordOptions::default() };
        let recording = Recording::start(path, run.plan(), run.buffers(), &options).unwrap();
        run.begin().unwrap();
        run.run_until(seconds(to_s)).unwrap();
        recording.finish_at(run.now()).unwrap();
    }
    let ends = [&short, &long].map(|path| rcs_log::Log::open(path).unwrap().info().end);
    for (one, other, is_first) in [(&short, &long, true), (&long, &short, false)] {
        let [a, b] = [one, other].map(|path| rcs_log::Log::open(path).unwrap());
        assert!(diff_each(&a, &b).unwrap().is_empty());
        let shorter = diff_lengths(&a, &b).unwrap().unwrap();
        assert_eq!((shorter.is_first, shorter.end), (is_first, ends[0]));
        assert_eq!(diff_lengths(&a, &a).unwrap(), None);
        let mut source = LogSource::open(one).unwrap();
        source.against(std::slice::from_ref(other));
        let comparison = compared(&mut source, [Compared::Recorded, Compared::Other]);
        assert_eq!((buffers(&comparison), comparison.until), (vec![], Some(ends[0])));
        let expected = if is_first { ends } else { [ends[1], ends[0]] };
        assert_eq!(comparison.recording_ends, expected.map(Some));
    }
}

/// A recording of a pose every 0.1 s for two seconds: at x = 0, from 1 s on at `x_m`.
fn write_poses(path: &Path, x_m: f64) {
    let mut writer = LogWriter::create(path, WriterOptions::default()).unwrap();
    let schema = schema_of::<foxglove::PoseInFrame>();
    let channel = writer.add_channel("/pose", schema, &BTreeMap::new()).unwrap();
    for index in 0..=20_u32 {
        let log_time = seconds(f64::from(index) * 0.1);
        let x = if index < 10 { 0.0 } else { x_m };
        let position = Some(foxglove::Vector3 { x, y: 0.0, z: 0.0 });
        let pose = Some(foxglove::Pose { position, orientation: None });
        let pose = AnyMessage::new(foxglove::PoseInFrame { pose, ..foxglove::PoseInFrame::default() });
        let header = WriteHeader { sequence: index, log_time, publish_time: log_time };
        writer.write(channel, header, &pose.bytes()).unwrap();
    }
    writer.finish().unwrap();
}

#[test]
fn the_viewed_moment_of_the_other_recording_is_in_the_frame_while_it_is_compared() {
    let folder = tempfile::tempdir().unwrap();
    let [plain, moved] = ["plain", "moved"].map(|name| folder.path().join(name));
    write_poses(&plain, 0.0);
    write_poses(&moved, 1.0);
    let mut source = LogSource::open(&plain).unwrap();
    let sides = [Compared::Recorded, Compared::Other];
    source.against(std::slice::from_ref(&moved));
    source.compare(&[sides]);
    // There is no time for background work while the source plays and is behind.
    while source.frame().comparison(sides).unwrap().progress.is_some() {
        std::thread::yield_now();
    }
    for (to_s, is_equal) in [(0.55, true), (1.55, false), (0.75, true)] {
        go(&mut source, to_s);
        let frame = source.frame();
        let pose = |frame: &rcs_runtime::source::Frame| {
            frame.topic("/pose").unwrap().latest.as_ref().unwrap().message.bytes()
        };
        assert_eq!(pose(&frame) == pose(frame.other.as_ref().unwrap()), is_equal, "{to_s} s");
    }
    source.show_other(false);
    assert!(source.frame().other.is_none(), "nothing is read that nobody shows");
    source.show_other(true);
    assert!(source.frame().other.is_some());
    source.compare(&[]);
    assert!(source.frame().other.is_none());
}

#[test]
fn recordings_without_a_common_buffer_are_not_compared() {
    let folder = tempfile::tempdir().unwrap();
    let [one, other] = ["one", "other"].map(|name| folder.path().join(name));
    write_log(&one, &[(0.0, "/a", 1.0), (1.0, "/a", 2.0)]);
    write_log(&other, &[(0.0, "/b", 1.0), (1.0, "/b", 2.0)]);
    let mut source = LogSource::open(&one).unwrap();
    source.against(std::slice::from_ref(&other));
    let comparison = compared(&mut source, [Compared::Recorded, Compared::Other]);
    let problem = comparison.problem.unwrap();
    assert!(problem.contains("no buffer in common"), "{problem}");
    assert_eq!((comparison.until, comparison.left_out), (None, [1, 1]));
    let [one, other] = [&one, &other].map(|path| rcs_log::Log::open(path).unwrap());
    assert_eq!(not_compared(&one, &other), Some(NotCompared::NoCommonBuffer));
}

#[test]
fn recordings_without_a_common_time_are_not_compared() {
    let folder = tempfile::tempdir().unwrap();
    let [one, other] = ["one", "other"].map(|name| folder.path().join(name));
    write_log(&one, &[(0.0, "/a", 1.0), (1.0, "/a", 2.0)]);
    write_log(&other, &[(2.0, "/a", 1.0), (3.0, "/a", 2.0)]);
    let mut source = LogSource::open(&one).unwrap();
    source.against(std::slice::from_ref(&other));
    let comparison = compared(&mut source, [Compared::Recorded, Compared::Other]);
    let problem = comparison.problem.unwrap();
    assert!(problem.contains("no common time"), "{problem}");
    assert!(comparison.until.is_none() && comparison.differences.is_empty());
    let [one, other] = [&one, &other].map(|path| rcs_log::Log::open(path).unwrap());
    assert_eq!(not_compared(&one, &other), Some(NotCompared::NoCommonTime));
    assert_eq!(not_compared(&one, &one), None);
}

#[test]
fn two_recordings_are_compared_from_the_later_start_which_is_told_apart_from_messages_that_differ() {
    let folder = tempfile::tempdir().unwrap();
    let [whole, part] = ["whole", "part"].map(|name| folder.path().join(name));
    record(&whole, None);
    let whole = rcs_log::Log::open(&whole).unwrap();
    let at = seconds(1.3);
    rcs_testkit::logs::split(&whole, at, [&folder.path().join("before"), &part]).unwrap();
    let part = rcs_log::Log::open(&part).unwrap();
    for (one, other, is_first) in [(&whole, &part, false), (&part, &whole, true)] {
        assert_eq!((not_compared(one, other), diff_each(one, other).unwrap()), (None, vec![]));
        let later = diff_starts(one, other).unwrap().unwrap();
        assert_eq!((later.is_first, later.start), (is_first, part.info().start));
    }
    assert_eq!(diff_starts(&part, &part).unwrap(), None);
}

#[test]
fn a_recording_that_begins_later_is_compared_from_its_start_with_another_one_and_with_a_run() {
    let folder = tempfile::tempdir().unwrap();
    let [whole, before, part] = ["whole", "before", "part"].map(|name| folder.path().join(name));
    record(&whole, None);
    let log = rcs_log::Log::open(&whole).unwrap();
    rcs_testkit::logs::split(&log, seconds(1.3), [&before, &part]).unwrap();
    let start = rcs_log::Log::open(&part).unwrap().info().start;
    let check = |source: &mut dyn Source, other: &Path, sides: [Compared; 2]| {
        source.against(&[other.to_owned()]);
        let comparison = compared(source, sides);
        assert_eq!((buffers(&comparison), comparison.problem.as_deref()), (vec![], None));
        assert_eq!(comparison.gaps[..], [(Stamp(0), start.before_ns(1))]);
        assert!(comparison.until > Some(start), "{:?}", comparison.until);
    };
    for (one, other) in [(&whole, &part), (&part, &whole)] {
        check(&mut LogSource::open(one).unwrap(), other, [Compared::Recorded, Compared::Other]);
    }
    let mut run = source(PastOptions::default());
    go(&mut run, 3.0);
    check(&mut run, &part, [Compared::Run(RunId(0)), Compared::Other]);
}

#[test]
fn a_run_that_goes_past_the_end_of_an_equal_recording_has_no_difference() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    record(&path, None);
    let end = rcs_log::Log::open(&path).unwrap().info().end;
    let mut source = source(PastOptions::default());
    source.against(std::slice::from_ref(&path));
    go(&mut source, 3.0);
    for sides in [[Compared::Run(RunId(0)), Compared::Other], [Compared::Other, Compared::Run(RunId(0))]] {
        let comparison = compared(&mut source, sides);
        assert_eq!(buffers(&comparison), Vec::<&str>::new());
        let ends: Vec<_> = comparison.recording_ends.into_iter().flatten().collect();
        assert_eq!((comparison.until, ends), (Some(end), vec![end]));
    }
}

#[test]
fn the_initial_parameters_of_a_run_are_compared_with_those_of_a_recording() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    let other = PAIR.replace("latency_ms = 3", "latency_ms = 3\nparams = { publish_hz = 3.0 }");
    record_stack(&other, &path, None);
    let mut source = source(PastOptions::default());
    source.against(std::slice::from_ref(&path));
    go(&mut source, 1.0);
    let comparison = compared(&mut source, [Compared::Run(RunId(0)), Compared::Other]);
    let first = comparison.differences.first().unwrap();
    assert_eq!((first.buffer.as_str(), first.field.as_str()), ("/counter/params", ".publish_hz"));
    assert_eq!((&first.values, first.time), (&["5", "3"].map(str::to_owned), source.info().start));
}

#[test]
fn a_run_is_compared_with_a_recording_of_an_earlier_one() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    record(&path, None);
    let mut source = source(PastOptions::default());
    source.against(std::slice::from_ref(&path));
    let sides = [Compared::Run(RunId(0)), Compared::Other];
    go(&mut source, 1.5);
    assert_eq!(buffers(&compared(&mut source, sides)), Vec::<&str>::new());
    set_parameter(&mut source, 3.0);
    go(&mut source, 2.0);
    let comparison = compared(&mut source, sides);
    assert_eq!(buffers(&comparison), SPREAD);
    assert_eq!(comparison.differences[0].values, ["a message", ""]);
}
