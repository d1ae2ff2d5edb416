//! Guarantees of a run's past: viewing does not execute anything, its budgets hold, it survives disk errors, and no run
//! is ever lost.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

mod common;

use common::{PAIR, content, seconds, stepped, tight, write_log};
use rcs_formula::FieldRef;
use rcs_log::Log;
use rcs_msg::{AnyMessage, Stamp, foxglove, rcs};
use rcs_runtime::source::{EventKind, Frame, RunTag, Source, StackSource, Step, Task, finish_idle};
use rcs_runtime::{
    Cycle, ExternalEvent, Out, PastOptions, Plan, PortBuilder, Process, ProcessDef, ProcessType,
    RecordOptions, Recording, RunId, RunOptions, Session, Snapshot, StackFile, Stepped,
};
use rcs_testkit::proto::CounterParams;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

/// Moves along x at the speed of its parameter, and publishes its position.
#[derive(Clone, Serialize, Deserialize)]
struct Walker {
    x: f64,
    /// A large value, so that a snapshot has a size.
    ballast: Arc<Vec<u8>>,
}

impl Process for Walker {
    type Params = CounterParams;
    type Ports = (Out<foxglove::Odometry>, Out<foxglove::RawImage>);
    type Command = rcs_runtime::NoCommands;
    const DEF: ProcessDef = ProcessDef {
        plugin: "walker",
        summary: "Walks.",
        period_ms: 50.0,
        latency_ms: 0.0,
        reads_ground_truth: false,
    };

    fn ports(b: &mut PortBuilder) -> Self::Ports {
        (b.output("odometry", "Where it is.").build(), b.output("image", "Noise.").build())
    }

    fn new(_params: &Self::Params) -> Self {
        Self { x: 0.0, ballast: Arc::new(vec![7; 10_000]) }
    }

    fn cycle(&mut self, (odometry, image): &Self::Ports, params: &Self::Params, cx: &mut Cycle<'_>) {
        use rand_core::RngCore as _;
        self.x += params.publish_hz * 0.05;
        cx.exec("walking");
        let pose = foxglove::Pose {
            position: Some(foxglove::Vector3 { x: self.x, y: 0.0, z: 0.0 }),
            orientation: Some(foxglove::Quaternion { x: 0.0, y: 0.0, z: 0.0, w: 1.0 }),
        };
        let message = foxglove::Odometry {
            timestamp: Some(cx.now().to_proto()),
            frame_id: "local".into(),
            body_frame_id: "walker".into(),
            pose: Some(pose),
            ..foxglove::Odometry::default()
        };
        cx.write(odometry, cx.now(), message);
        let mut data = vec![0; 60 * 60];
        cx.rng().fill_bytes(&mut data);
        let message =
            foxglove::RawImage { width: 60, height: 60, data: data.into(), ..foxglove::RawImage::default() };
        cx.write(image, cx.now(), message);
    }
}

const WALKER: &str = "
format = 1
name = \"walk\"
[[process]]
name = \"walker\"
plugin = \"walker\"
supervisor = \"viewer\"
";

fn walk_plan() -> Arc<Plan> {
    let file = StackFile::parse("walk.toml", WALKER).unwrap();
    Arc::new(Plan::new(file, &[ProcessType::of::<Walker>()], &[]).unwrap())
}

fn walk(past: PastOptions) -> StackSource {
    let options = RunOptions { seed: 3, past, ..RunOptions::default() };
    StackSource::new(walk_plan(), None, options).unwrap()
}

fn speed(mps: f64) -> (&'static str, AnyMessage) {
    let params = CounterParams { publish_hz: mps, ..rcs_msg::params::default() };
    ("/walker/params", AnyMessage::new(params))
}

fn set_speed(source: &mut StackSource, mps: f64) {
    let (buffer, message) = speed(mps);
    source.write(buffer, message).unwrap();
}

fn x_of(frame: &Frame) -> f64 {
    let topic = frame.topic("/walker/odometry").unwrap();
    topic.get::<foxglove::Odometry>().unwrap().pose.unwrap().position.unwrap().x
}

/// What a run shows after going directly to a time.
fn straight(to: Stamp) -> Vec<(String, u64, Option<Vec<u8>>)> {
    let mut source = walk(PastOptions::default());
    source.seek(to, &Task::default()).unwrap();
    content(&source.frame())
}

fn is_empty(folder: &Path) -> bool {
    std::fs::read_dir(folder).is_ok_and(|mut entries| entries.next().is_none())
}

/// The files without a name that a process (`self`, or its number) has open in a folder.
fn open_files(process: &str, folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(format!("/proc/{process}/fd")).unwrap().flatten();
    let is_in = |path: &PathBuf| std::fs::read_link(path).is_ok_and(|file| file.starts_with(folder));
    entries.map(|entry| entry.path()).filter(is_in).collect()
}

#[test]
fn looking_at_a_moment_that_was_executed_executes_nothing() {
    let mut source = walk(PastOptions::default());
    let task = Task::default();
    source.seek(seconds(20.0), &task).unwrap();
    let events = source.session().run().events();
    for to in [19.0, 3.21, 0.0, 11.7, 12.3] {
        source.seek(seconds(to), &task).unwrap();
        assert!(!source.idle(), "nothing is left to do");
        assert_eq!(content(&source.frame()), straight(seconds(to)), "at {to} s");
    }
    let back = Step::Cycle { process: None, back: true };
    for _ in 0..30 {
        assert!(source.step(&back, &task).unwrap());
    }
    assert_eq!(source.now(), seconds(10.8));
    assert_eq!(content(&source.frame()), straight(seconds(10.8)));
    assert_eq!(source.session().run().events(), events, "the machine stands where it stood");
    source.seek(seconds(21.0), &task).unwrap();
    assert_eq!(content(&source.frame()), straight(seconds(21.0)));
}

#[test]
fn what_does_not_fit_into_memory_is_read_back_from_disk_and_the_files_go_with_the_run() {
    let folder = tempfile::tempdir().unwrap();
    let mut source = walk(tight(folder.path(), 1 << 30));
    let task = Task::default();
    source.seek(seconds(120.0), &task).unwrap();
    let usage = source.session().past_use();
    assert!(usage.memory_bytes < 2 << 20 && usage.disk_bytes > 2 << 20, "{usage:?}");
    assert!(usage.with_messages > 110, "{usage:?}");
    for to in [1.5, 64.3, 119.0, 0.05] {
        source.seek(seconds(to), &task).unwrap();
        finish_idle(&mut source);
        assert_eq!(content(&source.frame()), straight(seconds(to)), "at {to} s");
    }
    assert!(source.info().problems.is_empty(), "{:?}", source.info().problems);
    assert!(!open_files("self", folder.path()).is_empty() && is_empty(folder.path()));
    drop(source);
    assert!(open_files("self", folder.path()).is_empty());
}

#[test]
fn what_others_take_of_the_memory_is_left_to_them() {
    let folder = tempfile::tempdir().unwrap();
    let options = PastOptions { memory_bytes: 4 << 20, ..tight(folder.path(), 1 << 30) };
    let mut source = walk(options);
    source.reserve(3 << 20);
    source.seek(seconds(120.0), &Task::default()).unwrap();
    let usage = source.session().past_use();
    assert!(usage.memory_bytes < 2 << 20, "{usage:?}");
}

#[test]
fn the_disk_keeps_its_budget_and_what_was_thinned_out_is_computed_again() {
    let folder = tempfile::tempdir().unwrap();
    let budget = 3 << 20;
    let mut source = walk(tight(folder.path(), budget));
    let task = Task::default();
    source.seek(seconds(180.0), &task).unwrap();
    let usage = source.session().past_use();
    assert!(usage.disk_bytes <= budget && usage.with_messages < 120, "{usage:?}");
    for to in [2.5, 90.0, 91.3, 40.0, 177.0] {
        source.seek(seconds(to), &task).unwrap();
        finish_idle(&mut source);
        assert_eq!(content(&source.frame()), straight(seconds(to)), "at {to} s");
    }
    source.seek(seconds(181.0), &task).unwrap();
    assert_eq!(content(&source.frame()), straight(seconds(181.0)));
}

#[test]
fn without_a_disk_the_past_keeps_its_memory_and_can_still_be_gone_back_to() {
    let folder = tempfile::tempdir().unwrap();
    let mut source = walk(tight(folder.path(), 0));
    let task = Task::default();
    source.seek(seconds(60.0), &task).unwrap();
    assert!(source.session().past_use().memory_bytes < 2 << 20);
    assert!(is_empty(folder.path()));
    source.seek(seconds(7.3), &task).unwrap();
    assert!(source.frame().topics.iter().any(|topic| topic.pending), "the frame says what is still to come");
    assert!(source.frame().runs.filling.is_some());
    finish_idle(&mut source);
    assert_eq!(content(&source.frame()), straight(seconds(7.3)));
}

/// What a run shows that has gone to 60 s and back to 7.3 s.
fn gone_back(past: PastOptions) -> Frame {
    let mut source = walk(past);
    source.seek(seconds(60.0), &Task::default()).unwrap();
    source.seek(seconds(7.3), &Task::default()).unwrap();
    finish_idle(&mut source);
    source.frame()
}

#[test]
fn a_folder_that_cannot_be_made_is_said_and_nothing_else_is_lost() {
    let file = tempfile::NamedTempFile::new().unwrap();
    let frame = gone_back(tight(file.path(), 1 << 30));
    let problems = &frame.info.problems;
    assert!(problems.iter().any(|text| text.contains("could not be written to disk")), "{problems:?}");
    assert_eq!(content(&frame), straight(seconds(7.3)));
}

#[test]
fn a_disk_budget_that_is_used_up_is_no_problem_and_nothing_is_lost() {
    let folder = tempfile::tempdir().unwrap();
    let frame = gone_back(tight(folder.path(), 20_000));
    assert!(frame.info.problems.is_empty(), "{:?}", frame.info.problems);
    assert_eq!(content(&frame), straight(seconds(7.3)));
}

#[test]
fn a_damaged_file_is_said_and_an_older_snapshot_serves() {
    let folder = tempfile::tempdir().unwrap();
    let mut source = walk(tight(folder.path(), 1 << 30));
    let task = Task::default();
    source.seek(seconds(60.0), &task).unwrap();
    let files = open_files("self", folder.path());
    assert!(!files.is_empty());
    for file in files {
        let length = std::fs::metadata(&file).unwrap().len() as usize;
        std::fs::write(file, vec![0xa5; length]).unwrap();
    }
    source.seek(seconds(20.0), &task).unwrap();
    finish_idle(&mut source);
    let frame = source.frame();
    assert_eq!(content(&frame), straight(seconds(20.0)));
    assert!(frame.info.problems.iter().any(|text| text.contains("could not be read back")));
    assert!(frame.info.problems.iter().any(|text| text.contains("an older one")));
}

#[test]
fn tracks_and_topics_follow_the_run_after_the_first_branch_and_after_the_second() {
    let mut source = walk(PastOptions::default());
    let task = Task::default();
    let track = |source: &mut StackSource| {
        let frame = source.frame();
        let shown = frame.runs.current();
        let track = &frame.track("/walker/odometry", RunTag::Run(shown)).unwrap().points;
        (track.len(), track.last().unwrap().position_m[0], x_of(&frame), shown)
    };
    source.seek(seconds(10.0), &task).unwrap();
    let first = track(&mut source);
    for (run, mps) in [(1, 10.0), (2, 20.0)] {
        source.seek(seconds(4.0), &task).unwrap();
        let at_branch = x_of(&source.frame());
        set_speed(&mut source, mps);
        source.seek(seconds(10.0), &task).unwrap();
        let (points, last, x, shown) = track(&mut source);
        assert_eq!((points, shown), (first.0, RunId(run)));
        assert_eq!(last, x, "the track ends where the walker is");
        assert!((x - (at_branch + 6.0 * mps)).abs() < 1e-6, "{x} after {at_branch}");
        let frame = source.frame();
        assert!(frame.topics.iter().all(|topic| topic.run == RunTag::Run(RunId(run))));
    }
    source.switch_run(RunId(0)).unwrap();
    assert_eq!(track(&mut source), first);
    let runs = source.frame().runs.all;
    let left: Vec<_> = runs.iter().map(|run| run.branched_from.map(|(from, at)| (from.run, at))).collect();
    // The second branch leaves the first branch's run, at a moment that the first run has, too.
    assert_eq!(left, [None, Some((RunId(0), seconds(4.0))), Some((RunId(1), seconds(4.0)))]);
}

#[test]
fn what_is_written_in_the_past_belongs_to_the_run_that_it_begins() {
    let mut source = walk(PastOptions::default());
    let task = Task::default();
    let field = FieldRef { topic: "/walker/params".to_owned(), path: "publish_hz".parse().unwrap() };
    source.gather(std::slice::from_ref(&field), &|| false);
    // The speeds that were written, and the acts of the operator, with their times.
    let written = |frame: &Frame, run: u32| {
        let points = &frame.field(&field, RunTag::Run(RunId(run))).unwrap().points;
        let later = points.sample(100).into_iter().filter(|point| point.stamp >= seconds(1.0));
        later.map(|point| (point.stamp, point.value)).collect::<Vec<_>>()
    };
    let acts = |frame: &Frame, run: u32| {
        let events = frame.events.iter().find(|events| events.run == RunTag::Run(RunId(run))).unwrap();
        let mut acts = Vec::new();
        events.each_from(0, |_, event| {
            if event.kind == EventKind::Operator {
                acts.push(event.stamp);
            }
        });
        acts
    };
    source.seek(seconds(6.0), &task).unwrap();
    set_speed(&mut source, 5.0);
    source.seek(seconds(4.0), &task).unwrap();
    set_speed(&mut source, 10.0);
    let frame = source.frame();
    assert_eq!(frame.runs.current(), RunId(1));
    assert_eq!(written(&frame, 0), [(seconds(6.0), 5.0)]);
    assert_eq!(written(&frame, 1), [(seconds(4.0), 10.0)]);
    assert_eq!((acts(&frame, 0), acts(&frame, 1)), (vec![seconds(6.0)], vec![seconds(4.0)]));
    // Of two writes at one moment, the first belongs to both runs and the undone one only to its own.
    set_speed(&mut source, 20.0);
    assert!(source.undo().unwrap());
    let frame = source.frame();
    assert_eq!(frame.runs.current(), RunId(2));
    assert_eq!(written(&frame, 1), [(seconds(4.0), 10.0), (seconds(4.0), 20.0)]);
    assert_eq!(written(&frame, 2), [(seconds(4.0), 10.0)]);
    assert_eq!((acts(&frame, 1), acts(&frame, 2)), (vec![seconds(4.0); 2], vec![seconds(4.0)]));
    set_speed(&mut source, 20.0);
    assert_eq!(acts(&source.frame(), 2), [seconds(4.0); 2], "written again, it is an act again");
}

#[test]
fn several_runs_are_shown_at_one_moment_and_writing_goes_to_the_viewed_one() {
    let mut source = walk(PastOptions::default());
    let task = Task::default();
    source.seek(seconds(10.0), &task).unwrap();
    source.seek(seconds(4.0), &task).unwrap();
    set_speed(&mut source, 10.0);
    source.seek(seconds(20.0), &task).unwrap();
    source.watch(&[RunId(0), RunId(1), RunId(7)]);
    for time in [20.0, 9.0, 5.0] {
        source.seek(seconds(time), &task).unwrap();
        finish_idle(&mut source);
        let frame = source.frame();
        assert_eq!(frame.beside.len(), 1, "the viewed run is not beside itself, and there is no run 7");
        let own = frame.of_run(Some(RunId(1))).unwrap();
        let left = frame.of_run(Some(RunId(0))).unwrap();
        assert!(!own.is_beside && left.is_beside);
        assert_eq!(left.now, seconds(time.min(10.0)), "the run that was left ended at 10 s");
        assert!(left.topics.iter().all(|topic| topic.run == RunTag::Run(RunId(0)) && !topic.pending));
        // The reference: going there.
        source.switch_run(RunId(0)).unwrap();
        source.seek(left.now, &task).unwrap();
        finish_idle(&mut source);
        let there = source.frame();
        assert_eq!(content(left), content(&there), "at {time} s");
        let rates = |frame: &Frame| frame.topics.iter().map(|topic| topic.hz).collect::<Vec<_>>();
        assert_eq!(rates(left), rates(&there), "at {time} s");
        for ago_ns in [0, 420_000_000] {
            let at_ns = left.now.before_ns(ago_ns).0;
            let place =
                |frame: &Frame| frame.transforms.lookup("local", "walker", at_ns).unwrap().translation.x;
            assert_eq!(place(left), place(&there), "{ago_ns} ns before {time} s");
        }
        source.switch_run(RunId(1)).unwrap();
    }
    // What was not kept is shown beside when it has been computed again, with the transforms of the moment.
    let folder = tempfile::tempdir().unwrap();
    let mut source = walk(tight(folder.path(), 0));
    source.seek(seconds(60.0), &task).unwrap();
    source.seek(seconds(4.0), &task).unwrap();
    set_speed(&mut source, 10.0);
    source.seek(seconds(20.0), &task).unwrap();
    source.watch(&[RunId(0)]);
    source.seek(seconds(4.3), &task).unwrap();
    finish_idle(&mut source);
    let frame = source.frame();
    assert!(frame.of_run(Some(RunId(0))).unwrap().topics.iter().any(|topic| topic.pending), "it was dropped");
    let mut seen = Vec::new();
    for run in [RunId(0), RunId(1)] {
        source.switch_run(run).unwrap();
        finish_idle(&mut source);
        let frame = source.frame();
        let left = frame.of_run(Some(RunId(0))).unwrap();
        let pose = left.transforms.lookup("local", "walker", seconds(4.3).0).unwrap();
        seen.push((content(left), pose.translation.x));
    }
    assert_eq!(seen[0], seen[1], "viewed, and beside");
}

#[test]
fn a_run_that_was_left_is_whole_and_goes_on_where_it_ended() {
    let folder = tempfile::tempdir().unwrap();
    let mut source = walk(tight(folder.path(), 1 << 30));
    let task = Task::default();
    source.seek(seconds(40.0), &task).unwrap();
    source.seek(seconds(12.3), &task).unwrap();
    set_speed(&mut source, 50.0);
    source.seek(seconds(60.0), &task).unwrap();
    let branch = x_of(&source.frame());
    source.switch_run(RunId(0)).unwrap();
    assert_eq!(source.now(), seconds(40.0), "the run that was left ended there");
    for to in [30.0, 12.3, 12.35, 39.0, 45.0] {
        source.seek(seconds(to), &task).unwrap();
        finish_idle(&mut source);
        assert_eq!(content(&source.frame()), straight(seconds(to)), "at {to} s");
    }
    source.switch_run(RunId(1)).unwrap();
    source.seek(seconds(60.0), &task).unwrap();
    finish_idle(&mut source);
    assert_eq!(x_of(&source.frame()), branch);
    assert!(source.switch_run(RunId(2)).unwrap_err().to_string().contains("expected 0 to 1"));
}

#[test]
fn the_moment_before_a_write_can_be_gone_to_and_undo_goes_on_without_it() {
    let mut session = Session::new(Stepped::new(walk_plan(), None, RunOptions::default()).unwrap()).unwrap();
    let task = Task::default();
    let write = |session: &mut Session, mps: f64| {
        let (buffer, message) = speed(mps);
        session.write(ExternalEvent::operator(buffer, message)).unwrap();
    };
    let params = |session: &Session| session.run().bus().get("/walker/params").unwrap().newest();
    session.forward_until(seconds(1.0), &task).unwrap();
    assert!(!session.undo().unwrap(), "nothing was written");
    write(&mut session, 10.0);
    write(&mut session, 20.0);
    let (moment, moment_ns) = (session.moment(), session.now().0);
    assert_eq!((moment.run, moment.write), (RunId(0), 2));
    session.forward_until(seconds(2.0), &task).unwrap();
    assert!(session.undo().unwrap());
    let before = session.moment();
    assert_eq!((before.run, before.event, before.write), (RunId(1), moment.event, 2));
    let said: rcs::RunInfo = common::newest(session.run(), "/runtime/run");
    assert_eq!((said.branched_from.as_str(), said.branch_time_ns), ("run 0", moment_ns));
    assert_eq!(params(&session), 2, "what every run begins with, and the first write");
    session.forward_until(seconds(2.0), &task).unwrap();
    assert_eq!((params(&session), session.now()), (2, seconds(2.0)));
    // The run with both writes still exists.
    session.switch_to(RunId(0)).unwrap();
    session.forward_until(seconds(2.5), &task).unwrap();
    assert_eq!(params(&session), 3);
    // A write in the past begins a run; undoing it returns to the run that it branched from.
    session.go_to_time(seconds(1.5), &task).unwrap();
    write(&mut session, 30.0);
    assert_eq!(session.moment().run, RunId(2));
    assert!(session.undo().unwrap());
    assert_eq!((session.moment().run, session.now()), (RunId(0), seconds(1.5)));
    assert_eq!(session.runs().len(), 3);
}

#[test]
fn the_timing_of_a_branched_run_counts_the_cycles_of_that_run_alone() {
    let task = Task::default();
    let mut session = Session::new(Stepped::new(walk_plan(), None, RunOptions::default()).unwrap()).unwrap();
    let cycles = |session: &Session| {
        let timing: rcs::Timing = common::newest(session.run(), "/runtime/timing");
        timing.processes[0].cycles
    };
    session.forward_until(seconds(3.5), &task).unwrap();
    let expected = cycles(&session);
    session.forward_until(seconds(9.0), &task).unwrap();
    session.go_to_time(seconds(1.5), &task).unwrap();
    let (buffer, message) = speed(10.0);
    session.write(ExternalEvent::operator(buffer, message)).unwrap();
    assert_eq!(session.moment().run, RunId(1));
    session.forward_until(seconds(3.5), &task).unwrap();
    assert_eq!(cycles(&session), expected);
}

#[test]
fn who_records_sees_every_message_once_however_often_the_past_is_run_again() {
    let mut session = Session::new(stepped(PAIR, RunOptions::default())).unwrap();
    let seen: Arc<Mutex<Vec<u64>>> = Arc::default();
    let theirs = Arc::clone(&seen);
    let buffer = Arc::clone(session.run().bus().get("/counter/count").unwrap());
    buffer.tap_once(Box::new(move |sample| theirs.lock().unwrap().push(sample.header.sequence)));
    let task = Task::default();
    for (to, back) in [(3.0, 0.5), (4.0, 2.0), (5.0, 4.9)] {
        session.forward_until(seconds(to), &task).unwrap();
        session.go_to_time(seconds(back), &task).unwrap();
    }
    let seen = seen.lock().unwrap();
    assert_eq!(*seen, (1..=seen.len() as u64).collect::<Vec<_>>());
    assert!(seen.len() > 490);
}

#[test]
fn saving_what_was_restored_gives_the_same_bytes_and_each_message_once() {
    let mut run = stepped(PAIR, RunOptions { hash: true, ..RunOptions::default() });
    run.begin().unwrap();
    run.run_until(seconds(1.001)).unwrap();
    let bytes = run.snapshot().to_bytes().unwrap();
    assert_eq!(run.snapshot().to_bytes().unwrap(), bytes);
    let mut other = stepped(PAIR, RunOptions { hash: true, ..RunOptions::default() });
    other.restore(&Snapshot::from_bytes(&bytes).unwrap()).unwrap();
    assert_eq!(other.snapshot().to_bytes().unwrap(), bytes);

    // Only its buffer refers to the image; a new reader does not duplicate it.
    let mut run = Stepped::new(walk_plan(), None, RunOptions::default()).unwrap();
    run.begin().unwrap();
    run.run_until(seconds(1.0)).unwrap();
    let length = run.snapshot().to_bytes().unwrap().len();
    assert!(length > 3600 + 10_000 && length < 2 * 3600 + 10_000, "{length} bytes");
}

#[test]
fn what_came_from_a_log_is_read_from_it_again_and_takes_no_disk() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("log.mcap");
    let messages: Vec<_> = (0..6000).map(|i| (f64::from(i) * 0.01, "/a", f64::from(i))).collect();
    write_log(&path, &messages);
    let stack = "
format = 1
name = \"on_log\"
[[input]]
buffer = \"/in\"
topic = \"/a\"
[[process]]
name = \"adder\"
plugin = \"adder\"
supervisor = \"viewer\"
inputs = { input = \"/in\" }
[buffers.\"/in\"]
queue = 8
";
    let log = Log::open(&path).unwrap();
    let past = PastOptions { memory_bytes: 300_000, ..tight(&folder.path().join("past"), 1 << 30) };
    let options = RunOptions { past, ..RunOptions::default() };
    let mut source = StackSource::new(common::plan(stack).unwrap(), Some(&log), options).unwrap();
    let task = Task::default();
    source.seek(seconds(59.0), &task).unwrap();
    for to in [10.0, 33.335, 1.0] {
        source.seek(seconds(to), &task).unwrap();
        finish_idle(&mut source);
        let frame = source.frame();
        let x = frame.topic("/in").unwrap().get::<foxglove::Vector3>().unwrap().x;
        assert_eq!(x, (to * 100.0).floor(), "at {to} s");
        assert!(frame.topics.iter().all(|topic| !topic.pending));
    }
    assert!(source.info().problems.is_empty(), "{:?}", source.info().problems);
}

/// Not a test by itself: the program that the next test kills. It runs, stores a past on disk, and records.
#[test]
fn a_program_that_is_killed() {
    let Some(folder) = std::env::var_os("OCU_TEST_KILLED_IN").map(PathBuf::from) else { return };
    let options = RunOptions { past: tight(&folder.join("past"), 1 << 30), ..RunOptions::default() };
    let run = Stepped::new(walk_plan(), None, options).unwrap();
    let record = RecordOptions { lossless: true, build: "test".to_owned(), ..RecordOptions::default() };
    let path = folder.join("run.mcap");
    let _recording = Recording::start(&path, run.plan(), run.buffers(), &record).unwrap();
    let mut session = Session::new(run).unwrap();
    let task = Task::default();
    // A minute at once, so that something is on disk; then at the pace of the clock.
    session.forward_until(seconds(60.0), &task).unwrap();
    let clock = std::time::Instant::now();
    loop {
        session.forward_until(seconds(60.0 + clock.elapsed().as_secs_f64()), &task).unwrap();
        std::thread::yield_now();
    }
}

#[test]
fn after_a_kill_the_recording_has_what_it_had_while_it_grew_and_nothing_is_left_of_the_past() {
    let folder = tempfile::tempdir().unwrap();
    let mut child = std::process::Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "a_program_that_is_killed"])
        .env("OCU_TEST_KILLED_IN", folder.path())
        .stdout(std::process::Stdio::null())
        .spawn()
        .unwrap();
    let deadline = std::time::Instant::now() + std::time::Duration::from_mins(2);
    // While the program runs, its recording grows on disk: chunks are closed by their age.
    let recorded = || Log::open(folder.path().join("run.mcap")).map_or(Stamp(0), |log| log.info().end);
    let mut before_kill = recorded();
    while before_kill < seconds(63.0) {
        assert!(std::time::Instant::now() < deadline, "recorded only up to {before_kill}");
        assert!(child.try_wait().unwrap().is_none(), "the program ended by itself");
        std::thread::yield_now();
        before_kill = recorded();
    }
    let past = folder.path().join("past");
    assert!(!open_files(&child.id().to_string(), &past).is_empty(), "it has a past on disk");
    child.kill().unwrap();
    child.wait().unwrap();
    assert!(recorded() >= before_kill, "recorded up to {} and before up to {before_kill}", recorded());
    assert!(is_empty(&past));
}
