//! Messages made by hand: what cannot be used is reported, counted and skipped, and nothing goes out for it; what can be
//! used does what it should.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use rcs_geom::DVec2;
use rcs_log::{Log, LogWriter, WriteHeader, WriterOptions};
use rcs_msg::foxglove::{CameraCalibration, Grid, PointCloud, PoseInFrame, RawImage};
use rcs_msg::{AnyMessage, Payload, Stamp, rcs, schema_of};
use rcs_plugins::all;
use rcs_runtime::source::Task;
use rcs_runtime::{ExternalEvent, Plan, RunOptions, Session, StackFile, Stepped};
use rcs_world::{Map, MapOptions, Source, VoteRule, Weights};
use std::collections::BTreeMap;
use std::sync::Arc;

const STACK: &str = r#"
format = 1
name = "hand_made"
input = [
    { buffer = "/depth", topic = "/depth" },
    { buffer = "/cloud", topic = "/cloud" },
    { buffer = "/calibration", topic = "/calibration" },
    { buffer = "/pose", topic = "/pose" },
    { buffer = "/cost", topic = "/cost" },
]

[[process]]
name = "obstacles"
plugin = "obstacles"
supervisor = "viewer"
period_ms = 100.0
inputs = { depth = "/depth", cloud = "/cloud", calibration = "/calibration", pose = "/pose" }
params = { pose = { source = "POSE_FIXED" }, mount = { fixed = true, height_m = 1.0, pitch_deg = 20.0 } }

[[process]]
name = "wm1"
plugin = "world_model"
supervisor = "viewer"
period_ms = 100.0
inputs = { stereo = "/cost" }
params = { pose = { source = "POSE_FIXED" } }
"#;

/// What is given to a buffer: one message a second.
struct Given {
    buffer: &'static str,
    message: AnyMessage,
}

fn given<T: Payload>(buffer: &'static str, value: T) -> Given {
    Given { buffer, message: AnyMessage::new(value) }
}

/// Runs the stack on a log of these messages, and stops after each of them.
struct Bench {
    run: Stepped,
    _folder: tempfile::TempDir,
}

impl Bench {
    fn new(messages: &[&Given], params: &[(&str, &str)]) -> Bench {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("hand_made.mcap");
        let mut writer = LogWriter::create(&path, WriterOptions::default()).unwrap();
        let metadata = BTreeMap::new();
        let mut channels = BTreeMap::new();
        // A log must have every topic that the stack reads.
        for (topic, schema) in [
            ("/depth", schema_of::<RawImage>()),
            ("/cloud", schema_of::<PointCloud>()),
            ("/calibration", schema_of::<CameraCalibration>()),
            ("/pose", schema_of::<PoseInFrame>()),
            ("/cost", schema_of::<Grid>()),
        ] {
            channels.insert(topic, writer.add_channel(topic, schema, &metadata).unwrap());
        }
        for (second, given) in (0..).zip(messages) {
            let time = Stamp(second * 1_000_000_000 + 50_000_000);
            let header = WriteHeader { sequence: second as u32, log_time: time, publish_time: time };
            writer.write(channels[given.buffer], header, &given.message.bytes()).unwrap();
        }
        writer.finish().unwrap();
        let params: Vec<(String, String)> =
            params.iter().map(|(name, value)| ((*name).to_owned(), (*value).to_owned())).collect();
        let plan = Plan::new(StackFile::parse("hand_made", STACK).unwrap(), all(), &params).unwrap();
        let log = Log::open(&path).unwrap();
        let mut run = Stepped::new(Arc::new(plan), Some(&log), RunOptions::default()).unwrap();
        run.begin().unwrap();
        Bench { run, _folder: folder }
    }

    /// Runs until just before the message of this number is given.
    fn run_before(&mut self, second: u64) {
        self.run.run_until(Stamp(second * 1_000_000_000 + 40_000_000)).unwrap();
    }

    fn latest<T: Payload>(&self, buffer: &str) -> Option<T> {
        self.run.bus().get(buffer).unwrap().latest()?.message.to()
    }

    /// Faults of a process, and the last one.
    fn faults(&self, process: &str) -> (u64, String) {
        let status: Option<rcs::Status> = self.latest(&format!("/{process}/status"));
        status.map_or((0, String::new()), |status| (status.faults, status.last_fault))
    }

    /// Messages that `obstacles` has sent.
    fn outputs(&self) -> u64 {
        let buffers = ["/obstacles/labels", "/obstacles/cost", "/obstacles/stats", "/obstacles/points"];
        buffers.iter().map(|name| self.run.bus().get(name).unwrap().newest()).sum()
    }
}

/// Gives messages to `obstacles`, each with what it says of it (`None`: nothing, it uses it) and how many messages go
/// out for it.
fn check(steps: &[(Given, Option<&str>, u64)]) -> Bench {
    let mut bench = Bench::new(&steps.iter().map(|step| &step.0).collect::<Vec<_>>(), &[]);
    for (second, (_, why, sent)) in (0..).zip(steps) {
        bench.run_before(second);
        let (before, outputs) = (bench.faults("obstacles").0, bench.outputs());
        bench.run_before(second + 1);
        let (faults, last) = bench.faults("obstacles");
        assert_eq!(faults - before, u64::from(why.is_some()), "message {second}: {last}");
        if let Some(why) = why {
            assert!(last.contains(why), "message {second}: got {last:?}, expected {why:?}");
        }
        assert_eq!(bench.outputs() - outputs, *sent, "messages that went out for message {second}");
    }
    bench
}

fn calibration() -> CameraCalibration {
    CameraCalibration {
        width: 64,
        height: 48,
        distortion_model: "plumb_bob".to_owned(),
        d: vec![0.0; 5],
        k: vec![50.0, 0.0, 31.5, 0.0, 50.0, 23.5, 0.0, 0.0, 1.0],
        ..CameraCalibration::default()
    }
}

fn depth(encoding: &str, size: [u32; 2], data: Vec<u8>) -> RawImage {
    let bytes = if encoding == "32FC1" { 4 } else { 2 };
    RawImage {
        width: size[0],
        height: size[1],
        encoding: encoding.to_owned(),
        step: size[0] * bytes,
        data: data.into(),
        ..RawImage::default()
    }
}

fn good_depth() -> RawImage {
    depth("16UC1", [64, 48], 3000_u16.to_le_bytes().repeat(64 * 48))
}

#[test]
fn depth_that_cannot_be_used_is_skipped_and_what_comes_after_it_is_used() {
    let nan = f32::NAN.to_le_bytes().repeat(64 * 48);
    let bench = check(&[
        (given("/depth", good_depth()), Some("without a calibration"), 0),
        (
            given("/calibration", CameraCalibration { k: vec![f64::NAN; 9], ..calibration() }),
            Some("calibration"),
            0,
        ),
        (given("/calibration", calibration()), None, 0),
        (given("/depth", depth("16UC1", [32, 48], vec![1; 32 * 48 * 2])), Some("calibration is for"), 0),
        (given("/depth", depth("rgb8", [64, 48], vec![1; 64 * 48 * 3])), Some("is no depth"), 0),
        (given("/depth", depth("16UC1", [64, 48], vec![1; 100])), Some("bytes"), 0),
        (given("/depth", depth("16UC1", [64, 48], vec![0; 64 * 48 * 2])), Some("has a range"), 0),
        (given("/depth", depth("32FC1", [64, 48], nan)), Some("has a range"), 0),
        (given("/depth", good_depth()), None, 3),
    ]);
    let stats: rcs_obstacles::proto::ObstacleStats = bench.latest("/obstacles/stats").unwrap();
    assert_eq!(stats.invalid + stats.ground + stats.obstacle + stats.short_obstacle + stats.cover, 64 * 48);
}

#[test]
fn clouds_and_poses_that_cannot_be_used_are_skipped() {
    let pose = PoseInFrame { frame_id: "local".to_owned(), ..PoseInFrame::default() };
    check(&[
        (given("/cloud", PointCloud { point_stride: 12, ..PointCloud::default() }), Some("no field"), 0),
        (given("/pose", pose), Some("no pose"), 0),
    ]);
}

#[test]
fn a_cost_map_of_another_frame_or_without_costs_changes_nothing() {
    let elsewhere = given("/cost", Grid { frame_id: "elsewhere".to_owned(), ..Grid::default() });
    let empty = given("/cost", Grid { frame_id: "local".to_owned(), ..Grid::default() });
    let mut bench = Bench::new(&[&elsewhere, &empty], &[]);
    for second in 1..=2 {
        bench.run_before(second);
        let (faults, last) = bench.faults("wm1");
        assert_eq!(faults, second, "{last}");
        assert!(last.starts_with("stereo: "), "{last}");
    }
    let stats: rcs_world_model::proto::WorldModelStats = bench.latest("/wm1/stats").unwrap();
    assert_eq!((stats.known, stats.votes), (0, 0));
}

/// A cost map with one obstacle at a place, m.
fn obstacle_at(x_m: f64) -> Given {
    let mut map = Map::new(0.2).unwrap();
    let cell = map.grid().cell_at(DVec2::new(x_m, 0.1)).unwrap();
    map.vote(cell, Source::STEREO, 250, 1, Stamp(1), VoteRule::default());
    let sources = [Source::STEREO].into_iter().collect();
    let options = MapOptions { sources, heights: false, weights: Weights::default() };
    given("/cost", map.to_grid("local", Stamp(1), &options))
}

#[test]
fn the_map_gathers_frames_unless_it_is_told_to_forget_each() {
    for (clear, known) in [("false", 2), ("true", 1)] {
        let (first, second) = (obstacle_at(3.1), obstacle_at(5.1));
        let mut bench = Bench::new(&[&first, &second], &[("wm1.clear_each_frame", clear)]);
        bench.run_before(2);
        let stats: rcs_world_model::proto::WorldModelStats = bench.latest("/wm1/stats").unwrap();
        assert_eq!((stats.known, stats.obstacle), (known, known), "clear_each_frame = {clear}");
    }
}

#[test]
fn the_command_clear_forgets_the_map() {
    let (first, second) = (obstacle_at(3.1), obstacle_at(5.1));
    let Bench { run, _folder: folder } = Bench::new(&[&first, &second], &[]);
    let mut session = Session::new(run).unwrap();
    let known_after = |session: &mut Session, ms: u64| {
        session.forward_until(Stamp(ms * 1_000_000), &Task::default()).unwrap();
        let stats = session.run().bus().get("/wm1/stats").unwrap().latest().unwrap();
        stats.message.to::<rcs_world_model::proto::WorldModelStats>().unwrap().known
    };
    assert_eq!(known_after(&mut session, 540), 1);
    let command = rcs::Command { serial: 7, name: "CLEAR".to_owned(), ..rcs::Command::default() };
    session.write(ExternalEvent::operator("/wm1/command", AnyMessage::new(command))).unwrap();
    assert_eq!(known_after(&mut session, 1_040), 0);
    let status = session.run().bus().get("/wm1/status").unwrap().latest().unwrap();
    assert_eq!(status.message.to::<rcs::Status>().unwrap().echo_serial, 7);
    assert_eq!(known_after(&mut session, 2_040), 1);
    drop(folder);
}
