//! Whole cycles of the waypoint generator with its children: a goal and a map in, drive commands out.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use rcs_geom::{DVec2, Pose};
use rcs_msg::foxglove::packed_element_field::NumericType;
use rcs_msg::foxglove::{
    FrameTransform, FrameTransforms, Grid, Odometry, PackedElementField, PosesInFrame, Quaternion, Vector2,
    Vector3,
};
use rcs_msg::rcs::ProcessState;
use rcs_msg::{Stamp, rcs};
use rcs_planner::proto::{ArcChoice, UtmGoal};
use rcs_planner::{AStarPlanner, WaypointFollower, WaypointGenerator, WaypointGeneratorCommand};
use rcs_runtime::{CommandSet, ProcessType};
use rcs_sense::pose_message;
use rcs_testkit::bench::{Bench, Setup};

const STACK: &str = r#"
format = 1
name = "driver"

[[process]]
name = "generator"
plugin = "waypoint_generator"
supervisor = "viewer"
inputs = { path = "/planner/path", transforms = "/operator/transforms" }

[[process]]
name = "planner"
plugin = "planner"
supervisor = "generator"
inputs = { map = "/operator/map", odometry = "/operator/odometry" }

[[process]]
name = "follower"
plugin = "waypoint_follower"
supervisor = "generator"

[process.inputs]
waypoints = "/generator/waypoints"
map = "/operator/map"
bumper = "/operator/bumper"
odometry = "/operator/odometry"
"#;

const WORLD: &str = "[origin]\nzone = 18\neasting_m = 300000.0\nnorthing_m = 4000000.0\n";
const GOAL: &str = "goal = { zone = 18, easting = 300012.0, northing = 4000003.0 }\n";

/// The files that the stack names.
struct Files;

impl rcs_runtime::Assets for Files {
    fn read(&self, kind: &str, name: &str, _beside: &str) -> Result<rcs_runtime::Asset, String> {
        let text = match (kind, name) {
            ("world", _) => WORLD.to_owned(),
            (_, "far.toml") => GOAL.replace("18", "17"),
            _ => GOAL.to_owned(),
        };
        Ok(rcs_runtime::Asset { file: name.to_owned(), text })
    }
}

fn plugins() -> [ProcessType; 3] {
    [
        ProcessType::of::<WaypointGenerator>(),
        ProcessType::of::<AStarPlanner>(),
        ProcessType::of::<WaypointFollower>(),
    ]
}

/// A bench with cycles of 50 ms; the local frame is the global one, moved by (2, 3) m.
fn start(params: &[(&str, &str)]) -> Bench {
    let mut bench = Setup::new(STACK, &plugins()).params(params).assets(&Files).bench();
    let transform = FrameTransform {
        timestamp: Some(Stamp(1).to_proto()),
        parent_frame_id: "global".to_owned(),
        child_frame_id: "local".to_owned(),
        translation: Some(Vector3 { x: 2.0, y: 3.0, z: 0.0 }),
        rotation: Some(Quaternion { w: 1.0, ..Quaternion::default() }),
    };
    bench.write("/operator/transforms", FrameTransforms { transforms: vec![transform] });
    bench
}

const FILES: [(&str, &str); 2] = [("generator.world", "w"), ("generator.goal", "g")];

/// Cycles at a pose with a fresh map.
fn cycle(bench: &mut Bench, x_m: f64, yaw_rad: f64, cost: impl Fn(DVec2) -> u8, count: usize) {
    for _ in 0..count {
        let pose = Some(pose_message(&Pose::from_xy_yaw(x_m, 0.0, yaw_rad)));
        bench.write(
            "/operator/odometry",
            Odometry { frame_id: "local".to_owned(), pose, ..Odometry::default() },
        );
        bench.write("/operator/map", map(&cost));
        bench.cycles(50, 1);
    }
}

fn map(cost: impl Fn(DVec2) -> u8) -> Grid {
    let centre = |at: usize| (at as f64 - 100.0) * 0.2 + 0.1;
    let cells = (0..201 * 201).map(|at| cost(DVec2::new(centre(at % 201), centre(at / 201))));
    let position = Some(Vector3 { x: -20.0, y: -20.0, z: 0.0 });
    Grid {
        frame_id: "local".to_owned(),
        pose: Some(rcs_msg::foxglove::Pose { position, orientation: None }),
        column_count: 201,
        cell_size: Some(Vector2 { x: 0.2, y: 0.2 }),
        row_stride: 201,
        cell_stride: 1,
        fields: vec![PackedElementField {
            name: "cost".to_owned(),
            offset: 0,
            r#type: NumericType::Uint8.into(),
        }],
        data: cells.collect::<Vec<_>>().into(),
        ..Grid::default()
    }
}

fn drive(bench: &Bench) -> (f64, f64) {
    let command: rcs::DriveCommand = bench.latest("/follower/drive");
    (command.speed_mps, command.yaw_rate_radps.unwrap())
}

fn status(bench: &Bench, process: &str) -> (ProcessState, String) {
    let status: rcs::Status = bench.latest(&format!("/{process}/status"));
    (status.state(), status.state_text)
}

/// Statuses and the last drive command, for the message of a failed assertion.
fn story(bench: &Bench) -> String {
    let told =
        ["generator", "planner", "follower"].map(|process| format!("{process} {:?}", status(bench, process)));
    format!("drive {:?}; {}", drive(bench), told.join("; "))
}

fn free(_: DVec2) -> u8 {
    0
}

#[test]
fn it_drives_to_the_goal_of_the_file_and_stands_there() {
    let mut bench = start(&FILES);
    cycle(&mut bench, 0.0, 0.0, free, 12);
    // The goal is 12 m east and 3 m north of the origin: (10, 0) m in the local frame.
    let (speed_mps, yaw_rate) = drive(&bench);
    assert!(speed_mps > 0.9 && yaw_rate.abs() < 0.1, "{speed_mps} {yaw_rate}");
    let waypoints: PosesInFrame = bench.latest("/generator/waypoints");
    let last = waypoints.poses.last().unwrap().position.unwrap();
    assert!((last.x - 10.0).abs() < 0.2 && last.y.abs() < 0.2, "{last:?}");
    assert!((16..20).contains(&waypoints.poses.len()), "10 m at 0.6 m: {}", waypoints.poses.len());
    let choice: ArcChoice = bench.latest("/follower/arcs");
    assert!(choice.arcs.len() > 20 && choice.chosen == Some(0), "{choice:?}");
    cycle(&mut bench, 9.8, 0.0, free, 6);
    assert_eq!(drive(&bench), (0.0, 0.0));
    assert_eq!(status(&bench, "generator"), (ProcessState::Done, "at the goal".to_owned()));
}

#[test]
fn it_bends_around_an_obstacle_and_turns_to_a_goal_behind_it() {
    let mut bench = start(&FILES);
    let wall = |at: DVec2| if (at.x - 3.0).abs() < 0.3 && at.y < 0.4 { 250 } else { 0 };
    cycle(&mut bench, 0.0, 0.0, wall, 12);
    assert!(drive(&bench).1 > 0.05, "{}", story(&bench));
    cycle(&mut bench, 0.0, 3.0, free, 6);
    assert!(drive(&bench).1.abs() > 0.3, "{}", story(&bench));
}

#[test]
fn without_map_pose_or_path_it_stands_and_says_why() {
    let mut bench = start(&FILES);
    cycle(&mut bench, 0.0, 0.0, free, 12);
    assert!(drive(&bench).0 > 0.5);
    bench.cycles(50, 30);
    assert_eq!(drive(&bench), (0.0, 0.0));
    let (state, text) = status(&bench, "follower");
    assert!(state == ProcessState::Error && text.starts_with("pose: "), "{text}");
    let (state, text) = status(&bench, "generator");
    assert!(state == ProcessState::Error && text.contains(" is in ERROR: "), "{text}");
    cycle(&mut bench, 0.0, 0.0, |_| 250, 6);
    assert_eq!(drive(&bench), (0.0, 0.0));
    cycle(&mut bench, 0.0, 0.0, free, 6);
    assert!(drive(&bench).0 > 0.5, "it goes on when it knows again");
}

#[test]
fn after_a_bumper_hit_it_backs_up_and_goes_on() {
    let mut bench = start(&FILES);
    cycle(&mut bench, 0.0, 0.0, free, 12);
    bench.write("/operator/bumper", rcs::Bumper { left: true, ..rcs::Bumper::default() });
    cycle(&mut bench, 0.0, 0.0, free, 2);
    assert!(drive(&bench).0 < 0.0, "{}", story(&bench));
    cycle(&mut bench, -0.6, 0.0, free, 2);
    assert!(drive(&bench).0 > 0.5, "{}", story(&bench));
}

#[test]
fn no_goal_and_a_goal_in_another_zone_are_told_and_a_command_gives_another() {
    let mut bench = start(&[("generator.world", "w")]);
    cycle(&mut bench, 0.0, 0.0, free, 6);
    let (state, text) = status(&bench, "generator");
    assert!(state == ProcessState::Error && text.starts_with("there is no goal"), "{text}");
    assert_eq!(drive(&bench), (0.0, 0.0));
    let encoded =
        WaypointGeneratorCommand::GoTo(UtmGoal { zone: 18, easting_m: 300_012.0, northing_m: 4_000_003.0 })
            .encode();
    let (parameters_schema, parameters) = encoded.parameters;
    let (name, parameters) = (encoded.name.to_owned(), parameters.into());
    let command = rcs::Command { serial: 100, name, parameters_schema, parameters, timestamp: None };
    bench.write("/generator/command", command);
    cycle(&mut bench, 0.0, 0.0, free, 12);
    assert!(drive(&bench).0 > 0.9);

    let mut bench = start(&[("generator.world", "w"), ("generator.goal", "far.toml")]);
    cycle(&mut bench, 0.0, 0.0, free, 6);
    let (state, text) = status(&bench, "generator");
    assert!(state == ProcessState::Error && text.contains("UTM zone 17, expected zone 18"), "{text}");
}
