//! Whole cycles of the waypoint generator with its children: a goal and a map in, drive commands out.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

mod goal;
mod missions;
mod modes;
mod orders;
mod remembered;
mod slips;
mod stands;

use rcs_geom::{DVec2, Pose};
use rcs_msg::foxglove::packed_element_field::NumericType;
use rcs_msg::foxglove::{
    FrameTransform, FrameTransforms, Grid, Odometry, PackedElementField, PosesInFrame, Quaternion, RawImage,
    Vector2, Vector3,
};
use rcs_msg::rcs::{ArcChoice, Mission, PlanePoint, PlanePolygon, ProcessState};
use rcs_msg::{Stamp, rcs};
use rcs_planner::proto::UtmGoal;
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
inputs = { path = "/planner/path", far_path = "/operator/far_path", transforms = "/operator/transforms", global = "/operator/global", registration = "/operator/registration", way_slip = "/operator/way_slip", modes = "/follower/modes", plan = "/planner/plan", vehicle = "/operator/vehicle", mission = "/operator/mission" }

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
sensed = "/operator/sensed"
left_images = "/operator/left"
right_images = "/operator/right"
goal = "/generator/goal"
plan = "/planner/plan"
far_plan = "/operator/far_plan"
slip = "/operator/slip"
way_slip = "/operator/way_slip"
bumper = "/operator/bumper"
vehicle = "/operator/vehicle"
odometry = "/operator/odometry"
"#;

const WORLD: &str = "[origin]\nzone = 18\neasting_m = 300000.0\nnorthing_m = 4000000.0\n";
const GOAL: &str = "goal = { zone = 18, easting = 300012.0, northing = 4000003.0 }\n";

/// The files that the stack names.
struct Files;

impl rcs_runtime::Assets for Files {
    fn read(&self, kind: &str, name: &str, _beside: &str) -> Result<rcs_runtime::Asset, String> {
        let text = match (kind, name) {
            ("world", "bounded") => format!("bounds_m = [[-20, 1], [40, 40]]\n{WORLD}"),
            ("world", _) => WORLD.to_owned(),
            ("mode", _) => include_str!("../../../../assets/modes/lagr.toml").to_owned(),
            ("route", _) => goal::ROUTE.to_owned(),
            ("slips", text) => text.to_owned(),
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
    place_local_frame(&mut bench, 2.0);
    bench
}

/// The local frame is the global one, moved by (x, 3) m.
fn place_local_frame(bench: &mut Bench, x_m: f64) {
    let now = Some(Stamp(bench.now_ms * 1_000_000 + 1).to_proto());
    let transform = FrameTransform { timestamp: now, ..transform("global", "local", DVec2::new(x_m, 3.0)) };
    bench.write("/operator/transforms", FrameTransforms { transforms: vec![transform] });
}

fn transform(parent: &str, child: &str, moved: DVec2) -> FrameTransform {
    FrameTransform {
        timestamp: None,
        parent_frame_id: parent.to_owned(),
        child_frame_id: child.to_owned(),
        translation: Some(Vector3 { x: moved.x, y: moved.y, z: 0.0 }),
        rotation: Some(Quaternion { w: 1.0, ..Quaternion::default() }),
    }
}

const FILES: [(&str, &str); 3] = [("generator.world", "w"), ("generator.goal", "g"), ("follower.modes", "m")];

/// The vehicle is this far east of the origin of the global frame, m, and 3 m north of it.
fn global_at(x_m: f64) -> Odometry {
    let pose = Some(pose_message(&Pose::from_xy_yaw(x_m, 3.0, 0.0)));
    Odometry { frame_id: "global".to_owned(), pose, ..Odometry::default() }
}

/// Drives from the origin of the local frame straight ahead, m, by wheels and fixes.
fn drive_ahead(bench: &mut Bench, to_m: f64) {
    for half_metres in 0..=(2.0 * to_m) as u32 {
        let x_m = f64::from(half_metres) / 2.0;
        bench.write("/operator/global", global_at(x_m + 2.0));
        cycle(bench, x_m, 0.0, free, 2);
    }
}

/// Cycles at a pose with a fresh map.
fn cycle(bench: &mut Bench, x_m: f64, yaw_rad: f64, cost: impl Fn(DVec2) -> u8, count: usize) {
    cycle_at(bench, &Pose::from_xy_yaw(x_m, 0.0, yaw_rad), cost, count);
}

fn cycle_at(bench: &mut Bench, pose: &Pose, cost: impl Fn(DVec2) -> u8, count: usize) {
    sense(bench, &["sensed", "left", "right"], pose, cost, count);
}

/// Cycles in which of the sensors only these send something.
fn sense(bench: &mut Bench, senses: &[&str], pose: &Pose, cost: impl Fn(DVec2) -> u8, count: usize) {
    for _ in 0..count {
        for &sense in senses {
            let name = format!("/operator/{sense}");
            if sense == "sensed" {
                bench.write(&name, Grid::default());
            } else {
                bench.write(&name, RawImage::default());
            }
        }
        let pose = Some(pose_message(pose));
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

/// Sends the vehicle by command to a place 3 m north of the origin.
fn go_to(bench: &mut Bench, easting_m: f64) {
    let goal = UtmGoal { zone: 18, easting_m, northing_m: 4_000_003.0 };
    let encoded = WaypointGeneratorCommand::GoTo(goal).encode();
    let (parameters_schema, parameters) = encoded.parameters;
    let (name, parameters) = (encoded.name.to_owned(), parameters.into());
    let command = rcs::Command { serial: 100, name, parameters_schema, parameters, timestamp: None };
    bench.write("/generator/command", command);
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
fn no_goal_and_a_goal_in_another_zone_are_told_and_a_command_gives_another() {
    let mut bench = start(&[("generator.world", "w")]);
    cycle(&mut bench, 0.0, 0.0, free, 6);
    let (state, text) = status(&bench, "generator");
    assert!(state == ProcessState::Error && text.starts_with("there is no goal"), "{text}");
    assert_eq!(drive(&bench), (0.0, 0.0));
    go_to(&mut bench, 300_012.0);
    cycle(&mut bench, 0.0, 0.0, free, 12);
    assert!(drive(&bench).0 > 0.9);

    let mut bench = start(&[("generator.world", "w"), ("generator.goal", "far.toml")]);
    cycle(&mut bench, 0.0, 0.0, free, 6);
    let (state, text) = status(&bench, "generator");
    assert!(state == ProcessState::Error && text.contains("UTM zone 17, expected zone 18"), "{text}");
}

/// A ring of obstacles around the vehicle.
fn ring(at: DVec2) -> u8 {
    if (2.0..2.6).contains(&at.length()) { 250 } else { 0 }
}

#[test]
fn a_goal_inside_of_an_obstacle_is_approached_and_it_stops_beside_it() {
    let mut bench = start(&FILES);
    let around_goal = |at: DVec2| if at.distance(DVec2::new(10.0, 0.0)) < 1.5 { 250 } else { 0 };
    cycle(&mut bench, 0.0, 0.0, around_goal, 12);
    assert!(drive(&bench).0 > 0.5, "{}", story(&bench));
    assert!(status(&bench, "planner").1.starts_with("the goal is blocked, plans to "), "{}", story(&bench));
    cycle(&mut bench, 7.9, 0.0, around_goal, 200);
    assert_eq!(drive(&bench), (0.0, 0.0), "{}", story(&bench));
    let (state, text) = status(&bench, "generator");
    assert!(state == ProcessState::Error && text.contains("inside of an obstacle: stands"), "{text}");
    assert_eq!(modes::mode(&bench).0, "", "no mode drives into it");
}

#[test]
fn a_goal_inside_of_an_obstacle_of_which_only_the_outside_is_seen_is_approached_and_no_mode_drives_into_it() {
    let mut bench = start(&[FILES[0], FILES[1], ("planner.goal_radius_m", "0.3")]);
    let shed = |at: DVec2| match at.distance(DVec2::new(10.0, 0.0)) {
        inside if inside < 1.4 => 255,
        wall if wall < 2.0 => 250,
        _ => 0,
    };
    cycle(&mut bench, 0.0, 0.0, shed, 12);
    assert!(drive(&bench).0 > 0.5, "{}", story(&bench));
    assert!(status(&bench, "planner").1.starts_with("the goal is blocked, plans to "), "{}", story(&bench));
    let path: PosesInFrame = bench.latest("/planner/path");
    let end = path.poses.last().unwrap().position.unwrap();
    // It gets near the end of the path, and no nearer.
    cycle_at(&mut bench, &Pose::from_xy_yaw(end.x - 0.7, end.y, 0.0), shed, 40);
    assert_eq!(status(&bench, "generator").0, ProcessState::Exec, "{}", story(&bench));
    cycle_at(&mut bench, &Pose::from_xy_yaw(end.x - 0.7, end.y, 0.0), shed, 80);
    assert_eq!(drive(&bench), (0.0, 0.0), "{}", story(&bench));
    let (state, text) = status(&bench, "generator");
    assert!(state == ProcessState::Error && text.contains("inside of an obstacle: stands"), "{text}");
    assert_ne!(modes::mode(&bench).0, "AGGRESSIVE", "no mode drives into it");
}

#[test]
fn a_goal_that_jumps_stops_it_until_it_is_back() {
    let mut bench = start(&FILES);
    cycle(&mut bench, 0.0, 0.0, free, 12);
    place_local_frame(&mut bench, -18.0);
    cycle(&mut bench, 0.0, 0.0, free, 3);
    assert_eq!(drive(&bench), (0.0, 0.0), "{}", story(&bench));
    let (state, text) = status(&bench, "generator");
    assert!(state == ProcessState::Error && text.starts_with("the goal has jumped by 20.0 m"), "{text}");
    place_local_frame(&mut bench, 2.1);
    cycle(&mut bench, 0.0, 0.0, free, 12);
    assert!(drive(&bench).0 > 0.5, "{}", story(&bench));
}

#[test]
fn wheels_that_turned_on_the_spot_are_told_from_a_jump_and_the_place_is_barred() {
    let mut bench = start(&FILES);
    // By its wheels it is at 9 m, 11 m in the global frame; the fixes then put it to 5 m, where it was before.
    drive_ahead(&mut bench, 9.0);
    bench.write("/operator/global", global_at(5.0));
    place_local_frame(&mut bench, -4.0);
    cycle(&mut bench, 9.0, 0.0, free, 6);
    assert!(drive(&bench).0 > 0.2, "{}", story(&bench));
    let path: PosesInFrame = bench.latest("/planner/path");
    let barred = DVec2::new(9.0 + 0.5 + 3.0, 0.0);
    let nearest_m = path.poses.iter().map(|pose| {
        let at = pose.position.unwrap();
        DVec2::new(at.x, at.y).distance(barred)
    });
    let nearest_m = nearest_m.fold(f64::INFINITY, f64::min);
    assert!(
        nearest_m > 2.5 && path.poses.len() > 20,
        "{nearest_m} m from the barred place; {}",
        story(&bench)
    );
}

#[test]
fn a_place_of_the_far_path_to_which_the_near_map_has_no_way_is_barred() {
    let nearest_m = |closed_cycles: usize| {
        let mut bench = start(&[FILES[0], FILES[1], ("generator.no_way_bars_m", "1.2")]);
        bench.write("/operator/global", global_at(2.0));
        goal::lead(&mut bench, 10.0);
        cycle(&mut bench, 0.0, 0.0, ring, closed_cycles);
        cycle(&mut bench, 0.0, 0.0, free, 12);
        let barred = DVec2::new(2.5, 0.0);
        path(&bench).iter().map(|at| at.distance(barred)).fold(f64::INFINITY, f64::min)
    };
    assert!(nearest_m(14) < 0.3, "the map may be wrong for half a second");
    assert!(nearest_m(34) > 1.0);
}

#[test]
fn a_place_of_the_far_path_inside_of_an_obstacle_of_the_near_map_is_barred() {
    let nearest_m = |blocked_cycles: usize| {
        let bars = [("generator.no_way_bars_m", "1.2"), ("planner.approach_m", "2")];
        let mut bench = start(&[FILES[0], FILES[1], bars[0], bars[1]]);
        let led = DVec2::new(5.0, 0.0);
        bench.write("/operator/global", global_at(2.0));
        goal::lead(&mut bench, 10.0);
        let blocked = |at: DVec2| if at.distance(led) < 3.5 { 250 } else { 0 };
        cycle(&mut bench, 0.0, 0.0, blocked, blocked_cycles);
        assert!(status(&bench, "planner").1.contains("is inside of an obstacle"), "{}", story(&bench));
        // From 3 m on it is led to 8 m.
        bench.write("/operator/global", global_at(5.0));
        cycle(&mut bench, 3.0, 0.0, free, 12);
        path(&bench).iter().map(|at| at.distance(led)).fold(f64::INFINITY, f64::min)
    };
    assert!(nearest_m(14) < 0.3, "the map may be wrong for half a second");
    assert!(nearest_m(34) > 1.0);
}

#[test]
fn it_drives_on_without_fixes_while_its_position_is_known_well_enough() {
    // Without modes: it does not move, which they would find strange.
    let mut bench = start(&FILES[..2]);
    let global = |variance: f64| {
        let mut covariance = vec![0.0; 36];
        (covariance[0], covariance[7]) = (1.0, variance);
        Odometry { frame_id: "global".to_owned(), pose_covariance: covariance, ..Odometry::default() }
    };
    bench.write("/operator/global", global(9.0));
    // No transform comes for 30 s, as without fixes, but for those of the parts of the vehicle.
    let camera = transform("vehicle", "camera", DVec2::ZERO);
    cycle(&mut bench, 0.0, 0.0, free, 300);
    bench.write("/operator/transforms", FrameTransforms { transforms: vec![camera] });
    cycle(&mut bench, 0.0, 0.0, free, 300);
    assert!(drive(&bench).0 > 0.5, "{}", story(&bench));
    assert!(status(&bench, "generator").1.contains("is 29.9 s old, and the goal stays"), "{}", story(&bench));
    bench.write("/operator/global", global(25.0));
    cycle(&mut bench, 0.0, 0.0, free, 3);
    assert_eq!(drive(&bench), (0.0, 0.0));
    let (state, text) = status(&bench, "generator");
    let expected = "the position is known to 5.0 m, expected at most 4 m";
    assert!(state == ProcessState::Error && text.starts_with(expected), "{text}");
    for variance in [f64::NAN, f64::INFINITY, -1.0] {
        bench.write("/operator/global", global(1.0));
        cycle(&mut bench, 0.0, 0.0, free, 6);
        assert!(drive(&bench).0 > 0.5, "{}", story(&bench));
        bench.write("/operator/global", global(variance));
        cycle(&mut bench, 0.0, 0.0, free, 3);
        assert_eq!(drive(&bench), (0.0, 0.0));
        let (state, text) = status(&bench, "generator");
        assert!(
            state == ProcessState::Error && text.starts_with("the variance of the position is"),
            "{text}"
        );
    }
}

#[test]
fn when_its_sensor_stops_or_nothing_is_known_it_stands() {
    let mut bench = start(&FILES);
    cycle(&mut bench, 0.0, 0.0, free, 12);
    assert!(drive(&bench).0 > 0.5, "{}", story(&bench));
    sense(&mut bench, &["left", "right"], &Pose::IDENTITY, free, 24);
    assert_eq!(drive(&bench), (0.0, 0.0), "{}", story(&bench));
    let (state, text) = status(&bench, "follower");
    assert!(state == ProcessState::Error && text.starts_with("what is sensed is 1."), "{text}");

    let mut bench = start(&FILES);
    cycle(&mut bench, 0.0, 0.0, |_| 255, 12);
    assert_eq!(drive(&bench), (0.0, 0.0), "{}", story(&bench));
    let (state, text) = status(&bench, "planner");
    assert!(
        state == ProcessState::Error && text.starts_with("0.0 % of the map within 3 m is known"),
        "{text}"
    );
}

#[test]
fn when_one_of_two_cameras_stops_it_stands_until_that_is_back() {
    let mut bench = start(&FILES);
    let look = |bench: &mut Bench, sides: &[&str], count: usize| {
        sense(bench, &[&["sensed"], sides].concat(), &Pose::IDENTITY, free, count);
    };
    look(&mut bench, &["left", "right"], 12);
    assert!(drive(&bench).0 > 0.5, "{}", story(&bench));
    look(&mut bench, &["left"], 24);
    assert_eq!(drive(&bench), (0.0, 0.0), "{}", story(&bench));
    let (state, text) = status(&bench, "follower");
    assert!(
        state == ProcessState::Error && text.starts_with("what comes from the right side is 1."),
        "{text}"
    );
    look(&mut bench, &["left", "right"], 4);
    assert!(drive(&bench).0 > 0.5, "{}", story(&bench));
}

#[test]
fn before_its_sensors_have_sent_anything_it_stands() {
    for (senses, input) in [
        (["left", "right"], "sensed"),
        (["sensed", "right"], "left_images"),
        (["sensed", "left"], "right_images"),
    ] {
        let mut bench = start(&FILES);
        sense(&mut bench, &senses, &Pose::IDENTITY, free, 12);
        assert_eq!(drive(&bench), (0.0, 0.0), "{}", story(&bench));
        let expected = (ProcessState::Error, format!("nothing has come at the input {input}"));
        assert_eq!(status(&bench, "follower"), expected);
        cycle(&mut bench, 0.0, 0.0, free, 6);
        assert!(drive(&bench).0 > 0.5, "{}", story(&bench));
    }
}

#[test]
fn weights_with_which_no_arc_leads_anywhere_are_refused() {
    let params = [("follower.weight_goal", "0"), ("follower.weight_heading", "0")];
    let error = Setup::new(STACK, &plugins()).params(&params).assets(&Files).plan().unwrap_err().to_string();
    assert!(error.contains("weight_goal and weight_heading: both are 0"), "{error}");
}

fn point(x_m: f64, y_m: f64) -> PlanePoint {
    PlanePoint { x_m, y_m }
}

fn polygon(corners: &[(f64, f64)]) -> PlanePolygon {
    PlanePolygon { points: corners.iter().map(|&(x_m, y_m)| point(x_m, y_m)).collect() }
}

/// Positions of the planner's path, local frame, m.
fn path(bench: &Bench) -> Vec<DVec2> {
    let path: PosesInFrame = bench.latest("/planner/path");
    path.poses.iter().filter_map(|pose| pose.position).map(|at| DVec2::new(at.x, at.y)).collect()
}

#[test]
fn zones_are_driven_around_and_the_area_is_not_left() {
    let zone = [(4.0, -1.0), (6.0, -1.0), (6.0, 30.0), (4.0, 30.0)];
    let mission = Mission {
        frame_id: "local".to_owned(),
        keep_out: vec![polygon(&zone)],
        keeps_goals: true,
        ..Mission::default()
    };
    let enters = |path: &[DVec2]| path.iter().any(|at| (4.0..6.0).contains(&at.x) && at.y > -1.0);
    let mut bench = start(&FILES[..2]);
    cycle(&mut bench, 0.0, 0.0, free, 12);
    assert!(enters(&path(&bench)), "{}", story(&bench));
    bench.write("/operator/mission", mission.clone());
    cycle(&mut bench, 0.0, 0.0, free, 12);
    assert!(!enters(&path(&bench)) && path(&bench).len() > 50, "{}", story(&bench));

    // The world ends at 1 m north in the global frame, 2 m south in the local one, and 1 m is kept: no way is left.
    let files = [("generator.world", "bounded"), ("generator.goal", "g")];
    let mut bench = start(&files);
    bench.write("/operator/mission", mission);
    cycle(&mut bench, 0.0, 0.0, free, 12);
    assert_eq!(drive(&bench), (0.0, 0.0), "{}", story(&bench));
    let (state, text) = status(&bench, "planner");
    assert!(state == ProcessState::Error && text.starts_with("no way to the goal"), "{text}");
}

#[test]
fn a_goal_outside_of_the_area_is_refused_and_a_vehicle_outside_comes_back() {
    let mut bench = start(&FILES[..2]);
    let area = |to_x_m| Mission {
        frame_id: "local".to_owned(),
        area: Some(polygon(&[(3.0, -5.0), (to_x_m, -5.0), (to_x_m, 5.0), (3.0, 5.0)])),
        keeps_goals: true,
        ..Mission::default()
    };
    bench.write("/operator/mission", area(8.0));
    cycle(&mut bench, 5.0, 0.0, free, 12);
    assert_eq!(drive(&bench), (0.0, 0.0), "{}", story(&bench));
    let (state, text) = status(&bench, "generator");
    assert!(state == ProcessState::Error && text.starts_with("the goal lies 2.0 m outside"), "{text}");
    // The vehicle is 3 m outside of the area.
    bench.write("/operator/mission", area(20.0));
    cycle(&mut bench, 0.0, 0.0, free, 12);
    assert!(drive(&bench).0 > 0.5, "{}", story(&bench));
}
