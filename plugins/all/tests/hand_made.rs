//! Hand-made messages: unusable ones are reported, counted and skipped without output; usable ones give the expected
//! output.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use rcs_geom::DVec2;
use rcs_msg::foxglove::{CameraCalibration, Grid, PointCloud, PoseInFrame, RawImage};
use rcs_msg::{AnyMessage, Payload, Stamp, rcs, schema_of};
use rcs_plugins::all;
use rcs_runtime::{Session, Stepped};
use rcs_testkit::bench::{Bench, Setup, faults, newest, sent};
use rcs_testkit::logs::hand_made;
use rcs_world::{Map, MapOptions, Source, VoteRule, Weights};

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

/// The messages written to one buffer, one per second.
struct Given {
    buffer: &'static str,
    message: AnyMessage,
}

fn given<T: Payload>(buffer: &'static str, value: T) -> Given {
    Given { buffer, message: AnyMessage::new(value) }
}

/// Runs the stack on a log of these messages and stops after each of them.
struct Replay(Stepped);

impl Replay {
    fn new(messages: &[&Given], params: &[(&str, &str)]) -> Replay {
        // The log must have every topic that the stack reads.
        let topics = [
            ("/depth", schema_of::<RawImage>()),
            ("/cloud", schema_of::<PointCloud>()),
            ("/calibration", schema_of::<CameraCalibration>()),
            ("/pose", schema_of::<PoseInFrame>()),
            ("/cost", schema_of::<Grid>()),
        ];
        let timed = (0..).zip(messages).map(|(second, given)| {
            (Stamp(second * 1_000_000_000 + 50_000_000), given.buffer, &given.message)
        });
        Replay(Setup::new(STACK, all()).params(params).stepped(Some(&hand_made(&topics, timed))))
    }

    /// Runs until just before the message with this number.
    fn run_before(&mut self, second: u64) {
        self.0.run_until(Stamp(second * 1_000_000_000 + 40_000_000)).unwrap();
    }

    fn latest<T: Payload>(&self, buffer: &str) -> T {
        newest(&self.0, buffer).unwrap()
    }

    fn faults(&self, process: &str) -> (u64, String) {
        faults(&self.0, process)
    }

    /// Number of messages that `obstacles` has sent.
    fn outputs(&self) -> u64 {
        let buffers = ["/obstacles/labels", "/obstacles/cost", "/obstacles/stats", "/obstacles/points"];
        buffers.iter().map(|name| sent(&self.0, name)).sum()
    }
}

/// Gives messages to `obstacles`, each with the expected fault (`None`: it is used) and the expected number of outputs.
fn check(steps: &[(Given, Option<&str>, u64)]) -> Replay {
    let mut replay = Replay::new(&steps.iter().map(|step| &step.0).collect::<Vec<_>>(), &[]);
    for (second, (_, why, sent)) in (0..).zip(steps) {
        replay.run_before(second);
        let (before, outputs) = (replay.faults("obstacles").0, replay.outputs());
        replay.run_before(second + 1);
        let (faults, last) = replay.faults("obstacles");
        assert_eq!(faults - before, u64::from(why.is_some()), "message {second}: {last}");
        if let Some(why) = why {
            assert!(last.contains(why), "message {second}: got {last:?}, expected {why:?}");
        }
        assert_eq!(replay.outputs() - outputs, *sent, "messages that went out for message {second}");
    }
    replay
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
    let replay = check(&[
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
        // The labels alone: by them others know that the process works.
        (given("/depth", depth("16UC1", [64, 48], vec![0; 64 * 48 * 2])), Some("has a range"), 1),
        (given("/depth", depth("32FC1", [64, 48], nan)), Some("has a range"), 1),
        (given("/depth", good_depth()), None, 3),
    ]);
    let stats: rcs_obstacles::proto::ObstacleStats = replay.latest("/obstacles/stats");
    assert_eq!(stats.invalid + stats.ground + stats.obstacle + stats.short_obstacle + stats.cover, 64 * 48);
}

#[test]
fn clouds_and_poses_that_cannot_be_used_are_skipped() {
    let pose = PoseInFrame { frame_id: "local".to_owned(), ..PoseInFrame::default() };
    check(&[
        (
            given(
                "/cloud",
                PointCloud { point_stride: 12, data: vec![0; 12].into(), ..PointCloud::default() },
            ),
            Some("no field"),
            0,
        ),
        (given("/pose", pose), Some("no pose"), 0),
    ]);
}

#[test]
fn a_cost_map_of_another_frame_or_without_costs_changes_nothing() {
    let elsewhere = given("/cost", Grid { frame_id: "elsewhere".to_owned(), ..Grid::default() });
    let empty = given("/cost", Grid { frame_id: "local".to_owned(), ..Grid::default() });
    let mut replay = Replay::new(&[&elsewhere, &empty], &[]);
    for second in 1..=2 {
        replay.run_before(second);
        let (faults, last) = replay.faults("wm1");
        assert_eq!(faults, second, "{last}");
        assert!(last.starts_with("stereo: "), "{last}");
    }
    let stats: rcs_world_model::proto::WorldModelStats = replay.latest("/wm1/stats");
    assert_eq!((stats.known, stats.votes), (0, 0));
}

/// A cost map with one obstacle at this x, m.
fn obstacle_at(x_m: f64) -> Given {
    let mut map = Map::new(0.2).unwrap();
    let cell = map.grid().cell_at(DVec2::new(x_m, 0.1)).unwrap();
    map.vote(cell, Source::STEREO, 250, 1, Stamp(1), VoteRule::default());
    let sources = [Source::STEREO].into_iter().collect();
    let options = MapOptions { sources, heights: false, weights: Weights::default() };
    let mut grid = map.to_grid("local", Stamp(1), &options);
    // A sensor's cost map states no confidence.
    grid.fields.retain(|field| field.name.starts_with("cost"));
    given("/cost", grid)
}

#[test]
fn the_map_gathers_frames_unless_it_is_told_to_forget_each() {
    for (clear, known) in [("false", 2), ("true", 1)] {
        let (first, second) = (obstacle_at(3.1), obstacle_at(5.1));
        let mut replay = Replay::new(&[&first, &second], &[("wm1.clear_each_frame", clear)]);
        replay.run_before(2);
        let stats: rcs_world_model::proto::WorldModelStats = replay.latest("/wm1/stats");
        assert_eq!((stats.known, stats.obstacle), (known, known), "clear_each_frame = {clear}");
    }
}

#[test]
fn the_command_clear_forgets_the_map() {
    let (first, second) = (obstacle_at(3.1), obstacle_at(5.1));
    let Replay(run) = Replay::new(&[&first, &second], &[]);
    let mut bench = Bench { session: Session::new(run).unwrap(), now_ms: 0 };
    let known_after = |bench: &mut Bench, ms: u64| {
        bench.advance(ms - bench.now_ms);
        bench.latest::<rcs_world_model::proto::WorldModelStats>("/wm1/stats").known
    };
    assert_eq!(known_after(&mut bench, 540), 1);
    bench.write("/wm1/command", rcs::Command { serial: 7, name: "CLEAR".to_owned(), ..Default::default() });
    assert_eq!(known_after(&mut bench, 1_040), 0);
    assert_eq!(bench.latest::<rcs::Status>("/wm1/status").echo_serial, 7);
    assert_eq!(known_after(&mut bench, 2_040), 1);
}
