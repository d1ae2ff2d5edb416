//! Guarantees of sources, and of the thread that drives them, to a window.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

mod common;

use common::{ON_LOG, PAIR, plan, seconds, write_log};
use rcs_log::{LogWriter, WriteHeader, WriterOptions};
use rcs_msg::{AnyMessage, Stamp, foxglove, rcs, schema_of};
use rcs_runtime::source::{
    Control, Driver, Frame, LogSource, RunTag, Source, SourceKind, StackSource, Step, Task, finish_idle,
};
use rcs_runtime::{
    Cycle, In, NoCommands, Out, Plan, PortBuilder, Process, ProcessDef, ProcessType, RunOptions, StackFile,
};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

const ANY: Step = Step::Message { topic: None, back: false };
const ANY_BACK: Step = Step::Message { topic: None, back: true };

fn log_source(messages: &[(f64, &str, f64)]) -> (LogSource, tempfile::TempDir) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("log.mcap");
    write_log(&path, messages);
    (LogSource::open(&path).unwrap(), folder)
}

fn x_of(frame: &Frame, topic: &str) -> Option<f64> {
    frame.topic(topic)?.get::<foxglove::Vector3>().map(|vector| vector.x)
}

/// Two topics, whose messages are numbered in one count, some at the same time.
const EQUAL_TIMES: [(f64, &str, f64); 5] =
    [(0.0, "/a", 1.0), (1.0, "/a", 2.0), (1.0, "/b", 3.0), (1.0, "/a", 4.0), (5.0, "/b", 5.0)];

#[test]
fn a_log_steps_message_by_message_through_equal_times_and_back() {
    let (mut source, _folder) = log_source(&EQUAL_TIMES);
    let task = Task::default();
    let mut state = |step: Option<&Step>| {
        let moved = step.is_none_or(|step| source.step(step, &task).unwrap());
        let frame = source.frame();
        (moved, x_of(&frame, "/a"), x_of(&frame, "/b"))
    };
    assert_eq!(state(None), (true, Some(1.0), None));
    assert_eq!(state(Some(&ANY)), (true, Some(2.0), None));
    assert_eq!(state(Some(&ANY)), (true, Some(2.0), Some(3.0)));
    assert_eq!(state(Some(&ANY)), (true, Some(4.0), Some(3.0)));
    assert_eq!(state(Some(&ANY)), (true, Some(4.0), Some(5.0)));
    assert_eq!(state(Some(&ANY)), (false, Some(4.0), Some(5.0)));
    assert_eq!(state(Some(&ANY_BACK)), (true, Some(4.0), Some(3.0)));
    assert_eq!(state(Some(&ANY_BACK)), (true, Some(2.0), Some(3.0)));
    assert_eq!(state(Some(&ANY_BACK)), (true, Some(2.0), None));
    assert_eq!(state(Some(&ANY_BACK)), (true, Some(1.0), None));
    let back = Step::Message { topic: Some("/b".to_owned()), back: false };
    assert_eq!(state(Some(&back)), (true, Some(2.0), Some(3.0)));
}

#[test]
fn a_log_goes_back_to_a_message_by_its_number() {
    let (mut source, _folder) = log_source(&EQUAL_TIMES);
    let task = Task::default();
    for (topic, sequence, x) in
        [("/a", 4, 4.0), ("/a", 2, 2.0), ("/a", 1, 1.0), ("/b", 3, 3.0), ("/b", 5, 5.0)]
    {
        source.seek(seconds(5.0), &task).unwrap();
        assert!(source.step(&Step::BackTo { topic: topic.to_owned(), sequence }, &task).unwrap());
        assert_eq!(x_of(&source.frame(), topic), Some(x));
    }
    source.seek(seconds(2.0), &task).unwrap();
    for (topic, sequence) in [("/a", 3), ("/b", 5), ("/c", 1)] {
        let back_to = Step::BackTo { topic: topic.to_owned(), sequence };
        let error = source.step(&back_to, &task).unwrap_err().to_string();
        assert!(error.contains(&format!("message {sequence} of {topic}")), "{error}");
        assert_eq!(source.now(), seconds(2.0), "it stays");
    }
}

#[test]
fn a_seek_shows_the_newest_message_of_every_topic_whichever_way_it_came() {
    let messages: Vec<_> = (0..400)
        .map(|i| (f64::from(i) * 0.1, if i % 7 == 0 { "/slow" } else { "/fast" }, f64::from(i)))
        .collect();
    let (mut source, _folder) = log_source(&messages);
    let task = Task::default();
    for to in [3.05, 3.35, 39.0, 12.34, 0.0, 12.34, 39.9] {
        source.seek(seconds(to), &task).unwrap();
        let frame = source.frame();
        for topic in ["/slow", "/fast"] {
            let reference = messages.iter().rev().find(|(t, name, _)| *t <= to + 1e-9 && name == &topic);
            assert_eq!(x_of(&frame, topic), reference.map(|(_, _, x)| *x), "{topic} at {to} s");
        }
    }
}

/// A log with an entity of its own in each message, once a second; those of even seconds live for one and a half.
fn log_with_entities() -> rcs_log::Log {
    let messages: Vec<(Stamp, &str, AnyMessage)> = (0..30_u32)
        .map(|second| {
            let lifetime = second
                .is_multiple_of(2)
                .then_some(rcs_msg::prost_types::Duration { seconds: 1, nanos: 500_000_000 });
            let id = (second % 10).to_string();
            let entities = vec![foxglove::SceneEntity { id, lifetime, ..Default::default() }];
            let update = foxglove::SceneUpdate { deletions: Vec::new(), entities };
            (seconds(f64::from(second)), "/scene", AnyMessage::new(update))
        })
        .collect();
    let messages = messages.iter().map(|(time, topic, message)| (*time, *topic, message));
    rcs_testkit::logs::hand_made(&[("/scene", schema_of::<foxglove::SceneUpdate>())], messages)
}

#[test]
fn the_entities_of_a_moment_do_not_depend_on_the_way_there() {
    let mut source = LogSource::new(&log_with_entities()).unwrap();
    let task = Task::default();
    let ids = |to: f64, source: &mut LogSource| {
        source.seek(seconds(to), &task).unwrap();
        let frame = source.frame();
        let entities = frame.entities(frame.topic("/scene").unwrap());
        let alive = entities.iter().filter(|entity| entity.is_alive(frame.now));
        alive.map(|entity| entity.content.id.clone()).collect::<Vec<_>>()
    };
    assert_eq!(ids(20.0, &mut source), ["0"], "what has not been read: those of the newest message");
    finish_idle(&mut source);
    for to in [20.0, 3.0, 20.0, 21.0, 0.0, 3.0] {
        let expect: &[&str] = match to as u32 {
            0 => &["0"],
            3 => &["1", "2", "3"],
            20 => &["1", "3", "5", "7", "9", "0"],
            _ => &["3", "5", "7", "9", "0", "1"],
        };
        assert_eq!(ids(to, &mut source), expect, "at {to} s");
    }
    assert_eq!(ids(3.6, &mut source), ["1", "3"], "the lifetime of 2 has passed");
}

#[test]
fn entities_are_read_after_all_poses_and_a_frame_says_so() {
    let update = AnyMessage::new(foxglove::SceneUpdate::default());
    let pose = |x: f64| {
        let position = Some(foxglove::Vector3 { x, y: 0.0, z: 0.0 });
        let orientation = Some(foxglove::Quaternion { x: 0.0, y: 0.0, z: 0.0, w: 1.0 });
        let pose = Some(foxglove::Pose { position, orientation });
        AnyMessage::new(foxglove::PoseInFrame { timestamp: None, frame_id: "map".into(), pose })
    };
    let messages: Vec<(Stamp, &str, AnyMessage)> = (0..30_u32)
        .flat_map(|second| {
            let (at, x) = (seconds(f64::from(second)), f64::from(second));
            [(at, "/scene", update.clone()), (at, "/pose", pose(x))]
        })
        .collect();
    let messages = messages.iter().map(|(time, topic, message)| (*time, *topic, message));
    let schemas =
        [("/scene", schema_of::<foxglove::SceneUpdate>()), ("/pose", schema_of::<foxglove::PoseInFrame>())];
    let log = rcs_testkit::logs::hand_made(&schemas, messages);
    let mut source = LogSource::new(&log).unwrap();
    source.seek(seconds(20.0), &Task::default()).unwrap();
    let poses = |frame: &Frame| frame.tracks.first().map_or(0, |track| track.points.len());
    while poses(&source.frame()) < 30 {
        assert!(source.idle(), "all poses are read");
    }
    let has_all = |frame: &Frame| frame.has_all_entities(frame.topic("/scene").unwrap());
    assert_eq!(has_all(&source.frame()), Some(false), "nothing of them has been read yet");
    finish_idle(&mut source);
    assert_eq!(has_all(&source.frame()), Some(true));
}

#[test]
fn channels_with_one_name_that_are_read_alike_are_one_topic_with_the_newest_message_of_all() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("log.mcap");
    let mut writer = LogWriter::create(&path, WriterOptions::default()).unwrap();
    let channels = ["/silent", "/a", "/b"].map(|node| {
        let metadata = BTreeMap::from([("callerid".to_owned(), node.to_owned())]);
        writer.add_channel("/points", schema_of::<foxglove::Vector3>(), &metadata).unwrap()
    });
    let messages = [(2, 0.0, 1.0), (1, 1.0, 2.0), (2, 2.0, 3.0), (1, 3.0, 4.0), (1, 9.0, 5.0)];
    for (channel, time_s, x) in messages {
        let header = WriteHeader { sequence: 1, log_time: seconds(time_s), publish_time: seconds(time_s) };
        let message = AnyMessage::new(foxglove::Vector3 { x, y: 0.0, z: 0.0 });
        writer.write(channels[channel], header, &message.bytes()).unwrap();
    }
    writer.finish().unwrap();
    let mut source = LogSource::open(&path).unwrap();
    // By jumps and by reading on.
    for (to_s, x) in [(9.5, 5.0), (1.5, 2.0), (2.5, 3.0), (0.5, 1.0), (3.5, 4.0), (2.5, 3.0), (3.0, 4.0)] {
        source.seek(seconds(to_s), &Task::default()).unwrap();
        let frame = source.frame();
        assert_eq!(frame.topics.len(), 1);
        let topic = &frame.topics[0];
        assert_eq!(x_of(&frame, "/points"), Some(x), "at {to_s} s");
        assert_eq!(topic.messages, 5);
        assert_eq!(topic.metadata["callerid"], "/a, /b", "of the channels with messages");
    }
}

#[test]
fn transforms_are_shared_while_the_log_is_still_being_read() {
    const COUNT: u64 = 50_000;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("log.mcap");
    let mut writer = LogWriter::create(&path, WriterOptions::default()).unwrap();
    // No topic with positions.
    let channel =
        writer.add_channel("/tf", schema_of::<foxglove::FrameTransforms>(), &BTreeMap::new()).unwrap();
    for i in 1..=COUNT {
        let time = Stamp(i * 1_000_000);
        let transform = foxglove::FrameTransform {
            timestamp: Some(time.to_proto()),
            parent_frame_id: "odom".into(),
            child_frame_id: "base".into(),
            translation: Some(foxglove::Vector3::default()),
            rotation: Some(foxglove::Quaternion { x: 0.0, y: 0.0, z: 0.0, w: 1.0 }),
        };
        let header = WriteHeader { sequence: i as u32, log_time: time, publish_time: time };
        let message = AnyMessage::new(foxglove::FrameTransforms { transforms: vec![transform] });
        writer.write(channel, header, &message.bytes()).unwrap();
    }
    writer.finish().unwrap();
    let mut source = LogSource::open(&path).unwrap();
    let mut is_early = false;
    while source.idle() {
        is_early |= source.frame().transforms.contains("base");
    }
    assert!(is_early, "shared at the end only");
}

#[test]
fn a_log_opens_at_its_first_picture_where_that_comes_within_a_second() {
    let open = |picture_s: f64| {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("log.mcap");
        let mut writer = LogWriter::create(&path, WriterOptions::default()).unwrap();
        let mut write = |topic: &str, time_s: f64, message: &AnyMessage| {
            let channel = writer.add_channel(topic, &message.schema(), &BTreeMap::new()).unwrap();
            let header =
                WriteHeader { sequence: 1, log_time: seconds(time_s), publish_time: seconds(time_s) };
            writer.write(channel, header, &message.bytes()).unwrap();
        };
        write("/a", 1.0, &AnyMessage::new(foxglove::Vector3::default()));
        write("/image", picture_s, &AnyMessage::new(foxglove::RawImage::default()));
        writer.finish().unwrap();
        LogSource::open(&path).unwrap().now()
    };
    assert_eq!(open(1.4), seconds(1.4));
    assert_eq!(open(1.0), seconds(1.0));
    assert_eq!(open(9.0), seconds(1.0));
}

#[test]
fn a_log_says_why_it_cannot_step_by_cycle_or_be_written_to() {
    let (mut source, _folder) = log_source(&[(0.0, "/a", 1.0)]);
    let cycle = Step::Cycle { process: None, back: false };
    let error = source.step(&cycle, &Task::default()).unwrap_err().to_string();
    assert!(error.contains("no processes"), "{error}");
    let write = source.write("/a", AnyMessage::new(foxglove::Vector3::default()));
    assert!(write.unwrap_err().to_string().contains("cannot be written to"));
}

#[test]
fn recorded_topics_and_those_made_now_stand_side_by_side() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("log.mcap");
    write_log(&path, &[(0.0, "/a", 1.0), (0.5, "/a", 2.0), (1.0, "/a", 3.0), (1.0, "/adder/sum", -1.0)]);
    let stack = "
format = 1
name = \"again\"
[[input]]
buffer = \"/in\"
topic = \"/a\"
[[process]]
name = \"adder\"
plugin = \"adder\"
supervisor = \"viewer\"
inputs = { input = \"/in\" }
";
    let log = rcs_log::Log::open(&path).unwrap();
    let mut source = StackSource::new(plan(stack).unwrap(), Some(&log), RunOptions::default()).unwrap();
    source.seek(seconds(1.0), &Task::default()).unwrap();
    finish_idle(&mut source);
    let frame = source.frame();
    assert_eq!(frame.info.kind, SourceKind::Replay);
    let of =
        |run| frame.topic_of("/adder/sum", run).and_then(|topic| topic.get::<foxglove::Vector3>()).copied();
    assert_eq!(of(RunTag::Recorded).unwrap().x, -1.0);
    assert_eq!(of(RunTag::FIRST).unwrap().y, 3.0);
    assert_eq!(x_of(&frame, "/adder/sum"), of(RunTag::FIRST).map(|v| v.x), "the one made now comes first");
    let inputs: Vec<_> = frame.topics.iter().filter(|topic| &*topic.name == "/in").collect();
    assert!(frame.topic("/a").is_none());
    assert_eq!(inputs.len(), 1, "a topic that fills a buffer is shown once, as that buffer");
    assert_eq!(inputs[0].run, RunTag::FIRST);
    let adder = &frame.processes[0];
    assert_eq!(frame.status(adder).unwrap().state(), rcs::ProcessState::Exec);
}

/// Waits until a frame fulfils a condition; there are new frames only when something has changed.
fn wait(driver: &Driver, wakes: &Receiver<()>, what: &str, is: impl Fn(&Frame) -> bool) -> Arc<Frame> {
    let deadline = Instant::now() + Duration::from_mins(1);
    loop {
        let frame = driver.frame();
        if is(&frame) {
            return frame;
        }
        assert!(Instant::now() < deadline, "waited a minute for {what}");
        // The source may have been woken before this call, so the frame is checked in any case.
        let _ = wakes.recv_timeout(Duration::from_millis(20));
    }
}

fn drive(source: impl Source + 'static) -> (Driver, Receiver<()>) {
    let (wake, wakes) = channel();
    let driver = Driver::spawn(Box::new(source), move || _ = wake.send(())).unwrap();
    (driver, wakes)
}

#[test]
fn a_driver_plays_to_the_end_and_starts_again_from_there() {
    let (source, _folder) = log_source(&[(0.0, "/a", 1.0), (0.1, "/a", 2.0), (2.0, "/a", 3.0)]);
    let (driver, wakes) = drive(source);
    driver.send(Control::Speed(50.0));
    driver.send(Control::Play);
    let end = wait(&driver, &wakes, "the end", |frame| frame.now == seconds(2.0) && !frame.playback.playing);
    assert_eq!(x_of(&end, "/a"), Some(3.0));
    driver.send(Control::Speed(0.01));
    driver.send(Control::Play);
    wait(&driver, &wakes, "the start", |frame| frame.playback.playing && frame.now < seconds(1.0));
    driver.send(Control::Pause);
    wait(&driver, &wakes, "a pause", |frame| !frame.playback.playing);
}

#[test]
fn playing_jumps_over_a_gap_of_decades_to_the_message_after_it() {
    const LATE_S: f64 = 1.7e9;
    // At the speed of this test, the message after the gap is the newest one for a hundred seconds.
    const END_S: f64 = LATE_S + 500.0;
    let (source, _folder) =
        log_source(&[(0.0, "/a", 1.0), (0.5, "/a", 2.0), (LATE_S, "/b", 3.0), (END_S, "/a", 4.0)]);
    let (driver, wakes) = drive(source);
    driver.send(Control::Speed(5.0));
    driver.send(Control::Play);
    let jumped = wait(&driver, &wakes, "the jump", |frame| {
        // Playing goes a little into the gap, and no further.
        assert!(frame.now < seconds(60.0) || frame.now >= seconds(LATE_S), "{:?}", frame.now);
        frame.now >= seconds(LATE_S)
    });
    assert_eq!((x_of(&jumped, "/a"), x_of(&jumped, "/b")), (Some(2.0), Some(3.0)));
    assert!(jumped.playback.playing);
    driver.send(Control::Speed(f64::INFINITY));
    let end =
        wait(&driver, &wakes, "the end", |frame| frame.now == seconds(END_S) && !frame.playback.playing);
    assert_eq!((x_of(&end, "/a"), x_of(&end, "/b")), (Some(4.0), Some(3.0)));
    assert_eq!(end.playback.error, None);
}

#[test]
fn a_driver_that_is_paused_makes_no_frames() {
    let (source, _folder) = log_source(&[(0.0, "/a", 1.0), (1.0, "/a", 2.0)]);
    let (driver, wakes) = drive(source);
    driver.send(Control::Seek(seconds(1.0)));
    wait(&driver, &wakes, "the seek", |frame| frame.now == seconds(1.0));
    while wakes.recv_timeout(Duration::from_millis(500)).is_ok() {}
    let generation = driver.frame().generation;
    assert!(wakes.recv_timeout(Duration::from_millis(100)).is_err());
    assert_eq!(driver.frame().generation, generation);
}

#[test]
fn long_work_can_be_stopped_and_the_source_goes_on_from_where_it_stands() {
    let source = StackSource::new(plan(PAIR).unwrap(), None, RunOptions::default()).unwrap();
    let (driver, wakes) = drive(source);
    driver.send(Control::Seek(seconds(1e7)));
    wait(&driver, &wakes, "busy work", |_| driver.busy().is_some());
    driver.send(Control::Cancel);
    let stopped = wait(&driver, &wakes, "the stop", |frame| frame.playback.error.is_some());
    assert_eq!(stopped.playback.error.as_deref(), Some("stopped on request"));
    assert!(stopped.now < seconds(1e7));
    driver.send(Control::Step(Step::Cycle { process: Some("adder".to_owned()), back: true }));
    wait(&driver, &wakes, "a step back", |frame| frame.now < stopped.now && frame.playback.error.is_none());
}

#[test]
fn a_stack_on_a_log_of_one_message_shows_what_its_processes_make_of_it() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("log.mcap");
    write_log(&path, &[(3.0, "/a", 2.0)]);
    let stack = &ON_LOG.replace("inputs", "latency_ms = 15\ninputs");
    let log = rcs_log::Log::open(&path).unwrap();
    let mut source = StackSource::new(plan(stack).unwrap(), Some(&log), RunOptions::default()).unwrap();
    let end = source.info().end.unwrap();
    assert!(end > seconds(3.0), "time goes on past the log's end");
    assert_eq!(x_of(&source.frame(), "/adder/sum"), Some(0.2));
    source.seek(seconds(3.0), &Task::default()).unwrap();
    assert_eq!(x_of(&source.frame(), "/adder/sum"), None);
    let step = Step::Cycle { process: None, back: false };
    while source.step(&step, &Task::default()).unwrap() {}
    assert_eq!(x_of(&source.frame(), "/adder/sum"), Some(0.2));
    assert!(source.now() <= end);
}

/// Says where the vehicle is in the frame `local`: at the x that it reads.
#[derive(Clone, Serialize, Deserialize)]
struct Mover;

struct MoverPorts {
    input: In<foxglove::Vector3>,
    pose: Out<foxglove::Odometry>,
}

impl Process for Mover {
    type Params = rcs::NoParams;
    type Ports = MoverPorts;
    type Command = NoCommands;
    const DEF: ProcessDef = ProcessDef {
        plugin: "mover",
        summary: "Moves.",
        period_ms: 20.0,
        latency_ms: 0.0,
        reads_ground_truth: false,
    };

    fn ports(b: &mut PortBuilder) -> Self::Ports {
        MoverPorts {
            input: b.input("input", "Where the vehicle is."),
            pose: b.output("pose", "Pose of the vehicle.").build(),
        }
    }

    fn new(_params: &Self::Params) -> Self {
        Self
    }

    fn cycle(&mut self, ports: &Self::Ports, _params: &Self::Params, cx: &mut Cycle<'_>) {
        if let Some(message) = cx.read_newest(&ports.input) {
            let (time, position) = (message.acq_time(), foxglove::Vector3 { x: message.x, y: 0.0, z: 0.0 });
            let pose = foxglove::Pose { position: Some(position), orientation: Some(UPRIGHT) };
            let odometry = foxglove::Odometry {
                timestamp: Some(time.to_proto()),
                frame_id: "local".to_owned(),
                body_frame_id: "vehicle".to_owned(),
                pose: Some(pose),
                ..foxglove::Odometry::default()
            };
            cx.write(&ports.pose, time, odometry);
        }
        cx.exec("moving");
    }
}

const UPRIGHT: foxglove::Quaternion = foxglove::Quaternion { x: 0.0, y: 0.0, z: 0.0, w: 1.0 };

/// A log of `/a`, which a `Mover` reads, and of transforms along x: a mount on a topic with the role of static transforms,
/// and the recorded place of the vehicle.
fn log_with_transforms() -> rcs_log::Log {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("log.mcap");
    let mut writer = LogWriter::create(&path, WriterOptions::default()).unwrap();
    let role = BTreeMap::from([("rcs.role".to_owned(), "static_transforms".to_owned())]);
    let transforms = schema_of::<foxglove::FrameTransforms>();
    let vectors = writer.add_channel("/a", schema_of::<foxglove::Vector3>(), &BTreeMap::new()).unwrap();
    let mounts = writer.add_channel("/mounts", transforms, &role).unwrap();
    let tf = writer.add_channel("/tf", transforms, &BTreeMap::new()).unwrap();
    let transform = |time: Stamp, parent: &str, child: &str, x: f64| {
        let transform = foxglove::FrameTransform {
            timestamp: Some(time.to_proto()),
            parent_frame_id: parent.to_owned(),
            child_frame_id: child.to_owned(),
            translation: Some(foxglove::Vector3 { x, y: 0.0, z: 0.0 }),
            rotation: Some(UPRIGHT),
        };
        AnyMessage::new(foxglove::FrameTransforms { transforms: vec![transform] })
    };
    for (sequence, (time_s, x)) in (1..).zip([(0.0, 1.0), (0.5, 2.0), (1.0, 3.0)]) {
        let time = seconds(time_s);
        let header = WriteHeader { sequence, log_time: time, publish_time: time };
        let vector = AnyMessage::new(foxglove::Vector3 { x, y: 0.0, z: 0.0 });
        writer.write(vectors, header, &vector.bytes()).unwrap();
        writer.write(mounts, header, &transform(time, "vehicle", "lidar", 0.5).bytes()).unwrap();
        writer.write(tf, header, &transform(time, "odom", "vehicle", 10.0 * x).bytes()).unwrap();
    }
    writer.finish().unwrap();
    rcs_log::Log::from_bytes(std::fs::read(&path).unwrap().into()).unwrap()
}

#[test]
fn transforms_of_a_channel_with_the_role_of_static_ones_hold_at_all_times() {
    let mut source = LogSource::new(&log_with_transforms()).unwrap();
    finish_idle(&mut source);
    let tree = source.frame().transforms;
    assert_eq!(tree.newest("vehicle", "lidar"), Ok(None));
    assert_eq!(tree.newest("odom", "vehicle"), Ok(Some(seconds(1.0).0)));
}

#[test]
fn a_stack_on_a_recording_shows_its_own_transforms_beside_the_recorded_ones() {
    let stack = "
format = 1
name = \"moving\"
[[input]]
buffer = \"/in\"
topic = \"/a\"
[[process]]
name = \"mover\"
plugin = \"mover\"
supervisor = \"viewer\"
inputs = { input = \"/in\" }
";
    let file = StackFile::parse("test.toml", stack).unwrap();
    let plan = Arc::new(Plan::new(file, &[ProcessType::of::<Mover>()], &[]).unwrap());
    let mut source = StackSource::new(plan, Some(&log_with_transforms()), RunOptions::default()).unwrap();
    source.seek(seconds(1.0), &Task::default()).unwrap();
    finish_idle(&mut source);
    let frame = source.frame();
    let x = |target: &str, source: &str| {
        let pose = frame.transforms.lookup_nearest(target, source, frame.now.0);
        pose.map(|pose| pose.translation.x)
    };
    assert_eq!(x("local", "lidar"), Ok(3.5), "computed, and the recorded mount");
    assert_eq!(x("odom", "lidar"), Ok(30.5), "recorded");
    assert_eq!(x("odom", "local"), Ok(27.0));
    assert!(Arc::ptr_eq(&frame.transforms, &source.frame().transforms), "shared while nothing changes");
}

#[test]
fn a_place_in_a_log_whose_clock_begins_again_shows_its_own_run_of_it_however_it_is_reached() {
    // 20 s ahead, then 20 s back with the same stamps.
    let odometry = |second: u32| {
        let x = f64::from(second % 20) * if second < 20 { 1.0 } else { -1.0 };
        let position = Some(foxglove::Vector3 { x, y: 0.0, z: 0.0 });
        let orientation = Some(foxglove::Quaternion { x: 0.0, y: 0.0, z: 0.0, w: 1.0 });
        AnyMessage::new(foxglove::Odometry {
            timestamp: Some(seconds(1.0 + x.abs()).to_proto()),
            frame_id: "odom".into(),
            body_frame_id: "base".into(),
            pose: Some(foxglove::Pose { position, orientation }),
            ..foxglove::Odometry::default()
        })
    };
    let messages: Vec<_> = (0..40).map(|i| (seconds(100.0 + f64::from(i)), odometry(i))).collect();
    let messages = messages.iter().map(|(time, message)| (*time, "/odom", message));
    let log = rcs_testkit::logs::hand_made(&[("/odom", schema_of::<foxglove::Odometry>())], messages);
    let mut source = LogSource::new(&log).unwrap();
    finish_idle(&mut source);
    for (to_s, x) in [(105.0, 5.0), (125.0, -5.0), (105.0, 5.0), (106.0, 6.0), (139.0, -19.0)] {
        source.seek(seconds(to_s), &Task::default()).unwrap();
        let frame = source.frame();
        let stamp = frame.transform_time(frame.now);
        let pose = frame.transforms.lookup_nearest("odom", "base", stamp.0).unwrap();
        assert_eq!(pose.translation.x, x, "{to_s} s");
        assert_eq!(frame.track("/odom", RunTag::Recorded).unwrap().points.len(), 20);
    }
    let info = source.info();
    assert_eq!(info.problems.len(), 1);
    assert!(info.problems[0].contains("goes back by 19.0 s at 20.0 s"), "{:?}", info.problems);
}
