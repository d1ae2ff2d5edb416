//! Guarantees of a stack as a source: steps beyond what was executed, recordings, and rates.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

mod common;

use common::{ON_LOG, PAIR, plan, seconds, write_log};
use rcs_formula::FieldRef;
use rcs_log::{CursorOptions, Log};
use rcs_msg::{AnyMessage, Stamp, foxglove, rcs, schema_of};
use rcs_runtime::source::{
    Control, Driver, Frame, LogSource, RecordingEnd, RunTag, Source, SourceError, StackSource, Step, Task,
    finish_idle,
};
use rcs_runtime::{RecordOptions, RunId, RunOptions};
use rcs_testkit::proto::CounterParams;
use std::path::Path;
use std::time::{Duration, Instant};

fn on_log(messages: &[(f64, &str, f64)]) -> (StackSource, tempfile::TempDir) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("log.mcap");
    write_log(&path, messages);
    let log = Log::open(&path).unwrap();
    let source = StackSource::new(plan(ON_LOG).unwrap(), Some(&log), RunOptions::default()).unwrap();
    (source, folder)
}

fn pair() -> StackSource {
    StackSource::new(plan(PAIR).unwrap(), None, RunOptions::default()).unwrap()
}

fn message(topic: &str, back: bool) -> Step {
    Step::Message { topic: Some(topic.to_owned()), back }
}

fn x_of(frame: &Frame, topic: &str) -> Option<f64> {
    frame.topic(topic)?.get::<foxglove::Vector3>().map(|vector| vector.x)
}

#[test]
fn after_a_step_that_finds_nothing_or_is_cancelled_time_is_where_the_run_is() {
    let (mut source, _folder) = on_log(&[(0.0, "/a", 1.0), (1.0, "/a", 2.0), (2.0, "/a", 3.0)]);
    let task = Task::default();
    // Nothing is written there after the start.
    let step = message("/adder/params", false);
    assert!(!source.step(&step, &task).unwrap());
    let end = source.now();
    assert!(end >= seconds(2.0), "{end:?}");
    assert_eq!(end, source.session().now());
    assert_eq!((source.frame().now, x_of(&source.frame(), "/in")), (end, Some(3.0)));
    source.seek(seconds(0.5), &task).unwrap();
    task.cancel();
    assert!(matches!(source.step(&step, &task), Err(SourceError::Cancelled)));
    assert_eq!(source.now(), source.session().now());
    assert_eq!((source.frame().now, x_of(&source.frame(), "/in")), (end, Some(3.0)));
}

#[test]
fn a_step_shows_each_message_of_a_recorded_topic_that_the_stack_does_not_read() {
    let (mut source, _folder) = on_log(&[
        (0.0, "/a", 1.0),
        (0.503, "/b", 2.0),
        (1.0, "/a", 3.0),
        (1.507, "/b", 4.0),
        (2.0, "/a", 5.0),
    ]);
    let mut step = |back: bool| {
        let moved = source.step(&message("/b", back), &Task::default()).unwrap();
        let frame = source.frame();
        (moved, frame.now, x_of(&frame, "/b"))
    };
    assert_eq!(step(false), (true, seconds(0.503), Some(2.0)));
    assert_eq!(step(false), (true, seconds(1.507), Some(4.0)));
    assert_eq!(step(false), (false, seconds(1.507), Some(4.0)));
    assert_eq!(step(true), (true, seconds(0.503), Some(2.0)));
    assert_eq!(step(false), (true, seconds(1.507), Some(4.0)));
}

#[test]
fn a_recording_goes_on_after_a_refused_write_and_where_nothing_can_be_taken_back() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    let mut source = pair();
    let task = Task::default();
    let params =
        |publish_hz: f64| AnyMessage::new(CounterParams { publish_hz, ..rcs_msg::params::default() });
    source.seek(seconds(1.0), &task).unwrap();
    let options = RecordOptions { lossless: true, build: "test".to_owned(), ..RecordOptions::default() };
    source.record(&path, &options).unwrap();
    source.seek(seconds(2.0), &task).unwrap();
    source.seek(seconds(1.5), &task).unwrap();
    assert!(source.write("/counter/params", params(f64::NAN)).is_err());
    assert!(!source.undo().unwrap());
    source.seek(seconds(3.0), &task).unwrap();
    let recording = source.frame().recording.unwrap();
    assert_eq!((recording.ended, recording.to), (None, seconds(3.0)));

    // A write that is not refused begins another run.
    source.seek(seconds(1.5), &task).unwrap();
    source.write("/counter/params", params(9.0)).unwrap();
    let recording = source.frame().recording.unwrap();
    assert_eq!((recording.ended, recording.to), (Some(RecordingEnd::OtherRun), seconds(3.0)));
    let log = Log::open(&path).unwrap();
    let ids = log.info().topics_named("/counter/count").map(|topic| topic.id).collect();
    let cursor = log.cursor(CursorOptions { topics: Some(ids), ..CursorOptions::default() });
    let sequences: Vec<u32> = cursor.map(|message| message.unwrap().sequence).collect();
    assert_eq!(sequences, (100..=300).collect::<Vec<u32>>(), "what held at 1 s, and every message once");
}

/// A run, and the recording of it from 10 to 11 s.
fn recorded_from_10_s(folder: &Path) -> (StackSource, Log) {
    let path = folder.join("run.mcap");
    let mut source = pair();
    let task = Task::default();
    let options = RecordOptions { lossless: true, build: "test".to_owned(), ..RecordOptions::default() };
    source.seek(seconds(10.0), &task).unwrap();
    source.record(&path, &options).unwrap();
    source.seek(seconds(11.0), &task).unwrap();
    source.stop_recording();
    (source, Log::open(&path).unwrap())
}

#[test]
fn a_recording_from_the_middle_of_a_run_knows_every_process() {
    let folder = tempfile::tempdir().unwrap();
    let (mut source, log) = recorded_from_10_s(folder.path());
    let frame = LogSource::new(&log).unwrap().frame();
    assert_eq!((frame.processes.len(), &frame.processes), (2, &source.frame().processes));
}

#[test]
fn a_recording_from_the_middle_of_a_run_is_shown_and_its_rates_are_counted_from_where_it_is_complete() {
    let folder = tempfile::tempdir().unwrap();
    let (_source, log) = recorded_from_10_s(folder.path());
    assert_eq!((log.info().start, log.info().complete_from), (Stamp(0), Some(seconds(10.0))));
    let mut opened = LogSource::new(&log).unwrap();
    let frame = opened.frame();
    assert_eq!((opened.now(), x_of(&frame, "/counter/count").is_some()), (seconds(10.0), true));
    assert_eq!((frame.info.complete_from, frame.is_before_recording()), (Some(seconds(10.0)), false));
    opened.seek(seconds(5.0), &Task::default()).unwrap();
    assert!(opened.frame().is_before_recording());
    let topic = log.info().topics_named("/counter/count").next().unwrap();
    assert!((95.0..=105.0).contains(&topic.hz), "{}", topic.hz);
}

#[test]
fn a_recording_goes_on_where_there_is_no_other_run_to_show_and_ends_where_its_own_has_come_to() {
    let folder = tempfile::tempdir().unwrap();
    let mut source = pair();
    let task = Task::default();
    let params = AnyMessage::new(CounterParams { publish_hz: 9.0, ..rcs_msg::params::default() });
    let options = RecordOptions { lossless: true, build: "test".to_owned(), ..RecordOptions::default() };
    source.seek(seconds(3.0), &task).unwrap();
    source.seek(seconds(1.0), &task).unwrap();
    source.write("/counter/params", params).unwrap();
    for is_undone in [false, true] {
        source.switch_run(RunId(1)).unwrap();
        source.seek(seconds(2.0), &task).unwrap();
        source.record(&folder.path().join(format!("{is_undone}.mcap")), &options).unwrap();
        assert!(source.switch_run(RunId(7)).is_err());
        source.switch_run(RunId(1)).unwrap();
        assert_eq!(source.frame().recording.unwrap().ended, None);
        // Both show the first run, which has come to 3 s.
        if is_undone {
            assert!(source.undo().unwrap());
        } else {
            source.switch_run(RunId(0)).unwrap();
        }
        let frame = source.frame();
        assert_eq!((frame.runs.current(), frame.runs.all.len()), (RunId(0), 2));
        let recording = frame.recording.unwrap();
        assert_eq!((recording.ended, recording.to), (Some(RecordingEnd::OtherRun), seconds(2.0)));
    }
}

#[test]
fn who_takes_a_write_back_where_nothing_was_written_is_told_so() {
    let driver = Driver::spawn(Box::new(pair()), || {}).unwrap();
    driver.send(Control::Undo);
    let deadline = Instant::now() + Duration::from_mins(1);
    let error = loop {
        if let Some(error) = driver.frame().playback.error.clone() {
            break error;
        }
        assert!(Instant::now() < deadline, "waited a minute for the error");
        std::thread::yield_now();
    };
    assert!(error.contains("nothing was written"), "{error}");
}

#[test]
fn rates_and_times_are_right_after_the_clock_of_a_log_was_set() {
    let set = (0..40).map(|i| 1.7e9 + f64::from(i) * 0.1);
    let messages: Vec<_> = std::iter::once(0.1).chain(set).map(|time_s| (time_s, "/a", 1.0)).collect();
    let (mut source, _folder) = on_log(&messages);
    source.seek(Stamp::MAX, &Task::default()).unwrap();
    let frame = source.frame();
    for name in ["/in", "/adder/sum"] {
        let hz = frame.topic(name).unwrap().hz;
        assert!(hz.is_some_and(|hz| (hz - 10.0).abs() < 0.5), "{name}: {hz:?}");
    }
    // A message as a whole has nothing but its time.
    let field = FieldRef { topic: "/in".to_owned(), path: "".parse().unwrap() };
    source.gather(std::slice::from_ref(&field), &|| false);
    let frame = source.frame();
    let points = &frame.field(&field, RunTag::FIRST).unwrap().points;
    let mut times = Vec::new();
    points.each(0..points.len(), |point| times.push(point.stamp));
    assert_eq!(times, messages.iter().map(|(time_s, ..)| seconds(*time_s)).collect::<Vec<_>>());
}

#[test]
fn a_run_beside_the_viewed_one_has_the_tracks_of_the_clock_of_its_own_moment() {
    // 20 s of poses ahead, then 20 s of poses back with the same stamps.
    let messages: Vec<_> = (0..40)
        .flat_map(|second: u32| {
            let x = f64::from(second % 20) * if second < 20 { 1.0 } else { -1.0 };
            let position = Some(foxglove::Vector3 { x, y: 0.0, z: 0.0 });
            let orientation = Some(foxglove::Quaternion { x: 0.0, y: 0.0, z: 0.0, w: 1.0 });
            let odometry = AnyMessage::new(foxglove::Odometry {
                timestamp: Some(seconds(1.0 + x.abs()).to_proto()),
                frame_id: "odom".to_owned(),
                body_frame_id: "base".to_owned(),
                pose: Some(foxglove::Pose { position, orientation }),
                ..foxglove::Odometry::default()
            });
            let time = seconds(100.0 + f64::from(second));
            [(time, "/a", AnyMessage::new(foxglove::Vector3::default())), (time, "/odom", odometry)]
        })
        .collect();
    let topics = [("/a", schema_of::<foxglove::Vector3>()), ("/odom", schema_of::<foxglove::Odometry>())];
    let messages = messages.iter().map(|(time, topic, message)| (*time, *topic, message));
    let log = rcs_testkit::logs::hand_made(&topics, messages);
    let mut source = StackSource::new(plan(ON_LOG).unwrap(), Some(&log), RunOptions::default()).unwrap();
    let task = Task::default();
    source.seek(seconds(110.0), &task).unwrap();
    source.seek(seconds(105.0), &task).unwrap();
    let halt = rcs::Command { serial: 2, name: "HALT".to_owned(), ..rcs::Command::default() };
    source.write("/adder/command", AnyMessage::new(halt)).unwrap();
    source.seek(seconds(130.0), &task).unwrap();
    source.watch(&[RunId(0)]);
    finish_idle(&mut source);
    let frame = source.frame();
    let beside = &frame.beside[0];
    assert_eq!((frame.now, beside.now), (seconds(130.0), seconds(110.0)));
    let last_x = |frame: &Frame| {
        let track = frame.track("/odom", RunTag::Recorded).unwrap();
        track.points.last().unwrap().position_m[0]
    };
    assert_eq!((last_x(&frame), last_x(beside)), (-19.0, 19.0));
}
