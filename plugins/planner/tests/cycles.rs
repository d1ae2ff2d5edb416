//! Whole cycles: a map and poses in, paths out.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use rcs_geom::{DVec2, Pose};
use rcs_msg::foxglove::packed_element_field::NumericType;
use rcs_msg::foxglove::{Grid, Odometry, PackedElementField, PosesInFrame, Vector2, Vector3};
use rcs_msg::rcs;
use rcs_msg::rcs::{Plan, ProcessState};
use rcs_planner::proto::{PlanPoint, PlanZone, PlannerGoal};
use rcs_planner::{AStarPlanner, PlannerCommand};
use rcs_runtime::{CommandSet, ProcessType};
use rcs_sense::pose_message;
use rcs_testkit::bench::{Bench, Setup};

const STACK: &str = r#"
format = 1
name = "planner"

[[process]]
name = "planner"
plugin = "planner"
supervisor = "viewer"
inputs = { map = "/operator/map", odometry = "/operator/odometry" }
"#;

/// A bench with the planner alone and cycles of 50 ms.
trait PlannerBench: Sized {
    fn start() -> Self;
    fn at(&mut self, x_m: f64, y_m: f64);
    fn map(&mut self, frame: &str, cost: impl Fn(DVec2) -> u8);
    fn plan_to(&mut self, x_m: f64, y_m: f64);
    fn plan(&mut self, goal: PlannerGoal);
    fn cycle(&mut self);
    fn status(&self) -> (ProcessState, String);
    fn path(&self) -> Vec<DVec2>;
}

impl PlannerBench for Bench {
    fn start() -> Bench {
        let mut bench = Setup::new(STACK, &[ProcessType::of::<AStarPlanner>()]).bench();
        bench.cycle();
        bench
    }

    fn at(&mut self, x_m: f64, y_m: f64) {
        let pose = Some(pose_message(&Pose::from_xy_yaw(x_m, y_m, 0.0)));
        self.write(
            "/operator/odometry",
            Odometry { frame_id: "local".to_owned(), pose, ..Odometry::default() },
        );
    }

    /// A map of 201×201 cells around (0.1, 0.1) m whose fused cost depends on the place.
    fn map(&mut self, frame: &str, cost: impl Fn(DVec2) -> u8) {
        let centre = |at: usize| (at as f64 - 100.0) * 0.2 + 0.1;
        let cells = (0..201 * 201).map(|at| cost(DVec2::new(centre(at % 201), centre(at / 201))));
        let cost =
            PackedElementField { name: "cost".to_owned(), offset: 0, r#type: NumericType::Uint8.into() };
        let position = Some(Vector3 { x: -20.0, y: -20.0, z: 0.0 });
        let grid = Grid {
            frame_id: frame.to_owned(),
            pose: Some(rcs_msg::foxglove::Pose { position, orientation: None }),
            column_count: 201,
            cell_size: Some(Vector2 { x: 0.2, y: 0.2 }),
            row_stride: 201,
            cell_stride: 1,
            fields: vec![cost],
            data: cells.collect::<Vec<_>>().into(),
            ..Grid::default()
        };
        self.write("/operator/map", grid);
    }

    fn plan_to(&mut self, x_m: f64, y_m: f64) {
        self.plan(PlannerGoal { x_m, y_m, ..PlannerGoal::default() });
    }

    fn plan(&mut self, goal: PlannerGoal) {
        let encoded = PlannerCommand::PlanTo(goal).encode();
        let (parameters_schema, parameters) = encoded.parameters;
        let serial = 1 + self.sent("/planner/command");
        let name = encoded.name.to_owned();
        let parameters = parameters.into();
        self.write(
            "/planner/command",
            rcs::Command { serial, name, parameters_schema, parameters, timestamp: None },
        );
    }

    fn cycle(&mut self) {
        self.cycles(50, 1);
    }

    fn status(&self) -> (ProcessState, String) {
        let status: rcs::Status = self.latest("/planner/status");
        (status.state(), status.state_text)
    }

    fn path(&self) -> Vec<DVec2> {
        let path: PosesInFrame = self.latest("/planner/path");
        let at = |pose: &rcs_msg::foxglove::Pose| {
            let position = pose.position.unwrap();
            DVec2::new(position.x, position.y)
        };
        path.poses.iter().map(at).collect()
    }
}

/// Free ground with a wall at x = 5 m that ends at y = 2 m.
fn wall(at: DVec2) -> u8 {
    if (at.x - 5.0).abs() < 0.15 && at.y < 2.0 { 250 } else { 0 }
}

#[test]
fn it_plans_around_a_wall_and_tells_why_there() {
    let mut bench = Bench::start();
    assert_eq!(bench.status(), (ProcessState::Exec, "waits for a goal".to_owned()));
    bench.plan_to(10.0, 0.0);
    bench.cycle();
    assert_eq!(bench.status().1, "waits for a map");
    bench.at(0.0, 0.0);
    bench.map("local", wall);
    bench.cycle();
    let (state, text) = bench.status();
    assert!(state == ProcessState::Exec && text.starts_with("path of 1"), "{text}");
    let path = bench.path();
    assert!(path.iter().any(|at| (at.x - 5.0).abs() < 0.3 && at.y > 2.4));
    assert!(path.last().unwrap().distance(DVec2::new(10.0, 0.0)) < 0.3);
    let plan: Plan = bench.latest("/planner/plan");
    let (chosen, rejected) = (plan.chosen.unwrap(), plan.rejected.unwrap());
    assert!(rejected.cost > chosen.cost && chosen.steps.len() == path.len());
    assert!(
        plan.reason.starts_with("the other way costs ") && plan.reason.contains("terrain +"),
        "{}",
        plan.reason
    );
    let terms = chosen.terms.unwrap();
    assert!(terms.terrain > 0.0 && terms.clearance > 0.0, "it passes the end of the wall: {terms:?}");
}

#[test]
fn each_map_and_each_goal_is_planned_on_once() {
    let mut bench = Bench::start();
    bench.at(0.0, 0.0);
    bench.map("local", wall);
    bench.plan_to(10.0, 0.0);
    bench.cycle();
    bench.cycle();
    assert_eq!(bench.sent("/planner/path"), 1);
    bench.map("local", wall);
    bench.cycle();
    assert_eq!(bench.sent("/planner/path"), 2);
    bench.plan_to(10.0, 4.0);
    bench.cycle();
    assert_eq!(bench.sent("/planner/path"), 3);
    assert!(bench.path().last().unwrap().y > 3.5);
}

#[test]
fn without_a_recent_map_or_pose_there_is_no_path() {
    let mut bench = Bench::start();
    bench.plan_to(10.0, 0.0);
    bench.map("local", wall);
    bench.cycle();
    let (state, text) = bench.status();
    assert!(state == ProcessState::Error && text.starts_with("pose: "), "{text}");
    bench.at(0.0, 0.0);
    bench.cycle();
    assert!(!bench.path().is_empty());
    for _ in 0..15 {
        bench.cycle();
    }
    let (state, text) = bench.status();
    assert!(state == ProcessState::Error && text.contains("s old, expected at most 0.5 s"), "{text}");
    assert!(bench.path().is_empty());
    for _ in 0..10 {
        bench.at(0.0, 0.0);
        bench.cycle();
    }
    let (state, text) = bench.status();
    assert!(state == ProcessState::Error && text.starts_with("the map is 1."), "{text}");
    bench.map("local", wall);
    bench.cycle();
    assert!(bench.status().0 == ProcessState::Exec && !bench.path().is_empty());
}

#[test]
fn what_was_planned_before_the_pose_leapt_is_forgotten_and_it_plans_on() {
    let mut bench = Bench::start();
    bench.at(0.0, 0.0);
    bench.map("local", wall);
    bench.plan_to(10.0, 0.0);
    bench.cycle();
    assert_eq!(bench.faults("planner"), (0, String::new()));
    bench.at(3.0, 8.0);
    bench.map("local", wall);
    bench.cycle();
    let why = "the pose in the local frame leapt by 8.5 m; the path and the track before are forgotten";
    assert_eq!(bench.faults("planner"), (1, why.to_owned()));
    assert!(bench.path().first().unwrap().distance(DVec2::new(3.0, 8.0)) < 0.5);
}

#[test]
fn a_goal_inside_of_an_obstacle_is_told_and_one_beside_it_is_planned_to() {
    let mut bench = Bench::start();
    bench.at(0.0, 0.0);
    bench.map("local", |at| if at.distance(DVec2::new(10.0, 0.0)) < 5.0 { 250 } else { 0 });
    bench.plan_to(10.0, 0.0);
    bench.cycle();
    let (state, text) = bench.status();
    assert!(state == ProcessState::Error && text.contains("is inside of an obstacle"), "{text}");
    assert!(bench.path().is_empty());
    bench.plan_to(4.9, 0.0);
    bench.cycle();
    let (state, text) = bench.status();
    assert!(state == ProcessState::Exec && text.starts_with("the goal is blocked, plans to 0."), "{text}");
    bench.plan_to(7.0, 0.0);
    bench.cycle();
    let (state, text) = bench.status();
    assert!(state == ProcessState::Exec && text.starts_with("the goal is blocked, plans to 2."), "{text}");
    bench.at(4.4, 0.0);
    bench.map("local", |at| if at.distance(DVec2::new(10.0, 0.0)) < 5.0 { 250 } else { 0 });
    bench.cycle();
    let (state, text) = bench.status();
    assert!(
        state == ProcessState::Error && text.contains("inside of an obstacle: stands 2.6 m beside it"),
        "{text}"
    );
}

#[test]
fn maps_that_cannot_be_used_are_faults_and_stop_the_vehicle() {
    let mut bench = Bench::start();
    bench.at(0.0, 0.0);
    bench.plan_to(10.0, 0.0);
    bench.map("global", wall);
    bench.cycle();
    assert_eq!(bench.faults("planner"), (1, "map: frame is \"global\", expected \"local\"".to_owned()));
    assert!(bench.status().0 == ProcessState::Error && bench.path().is_empty());
    bench.write("/operator/map", Grid { frame_id: "local".to_owned(), ..Grid::default() });
    bench.cycle();
    assert_eq!(bench.faults("planner").0, 2);
    bench.map("local", |_| 250);
    bench.cycle();
    let (state, text) = bench.status();
    assert!(state == ProcessState::Error && bench.path().is_empty(), "{text}");
}

#[test]
fn at_the_goal_it_is_done_and_sends_no_path() {
    let mut bench = Bench::start();
    bench.at(9.5, 0.0);
    bench.map("local", wall);
    bench.plan_to(10.0, 0.0);
    bench.cycle();
    assert_eq!(bench.status(), (ProcessState::Done, "at the goal".to_owned()));
    assert!(bench.path().is_empty());
}

#[test]
fn on_coarse_cells_the_path_ends_at_the_goal_if_the_middle_of_its_cell_is_too_far_away() {
    for (radius_m, appended) in [("0.3", true), ("0.6", false)] {
        let params = [("planner.goal_radius_m", radius_m)];
        let mut bench = Setup::new(STACK, &[ProcessType::of::<AStarPlanner>()]).params(&params).bench();
        bench.cycle();
        bench.at(0.0, 0.0);
        let position = Some(Vector3 { x: -10.25, y: -10.25, z: 0.0 });
        let cost =
            PackedElementField { name: "cost".to_owned(), offset: 0, r#type: NumericType::Uint8.into() };
        let grid = Grid {
            frame_id: "local".to_owned(),
            pose: Some(rcs_msg::foxglove::Pose { position, orientation: None }),
            column_count: 41,
            cell_size: Some(Vector2 { x: 0.5, y: 0.5 }),
            row_stride: 41,
            cell_stride: 1,
            fields: vec![cost],
            data: vec![0_u8; 41 * 41].into(),
            ..Grid::default()
        };
        bench.write("/operator/map", grid);
        // In the corner of the cell whose middle is (5, 0) m.
        let goal = DVec2::new(5.24, 0.24);
        bench.plan_to(goal.x, goal.y);
        bench.cycle();
        let (path, plan) = (bench.path(), bench.latest::<Plan>("/planner/plan"));
        let (end, steps) = (*path.last().unwrap(), plan.chosen.unwrap().steps.len());
        assert_eq!((end == goal, path.len() - steps), (appended, usize::from(appended)), "{end}");
    }
}

#[test]
fn zones_that_cannot_be_understood_are_told_until_a_goal_with_others_comes() {
    let mut bench = Bench::start();
    let zone = PlanZone { corners: vec![PlanPoint { x_m: 1.0, y_m: 2.0 }; 2] };
    bench.plan(PlannerGoal { x_m: 10.0, keep_out: vec![zone], ..PlannerGoal::default() });
    for _ in 0..3 {
        bench.at(0.0, 0.0);
        bench.map("local", wall);
        bench.cycle();
        let (state, text) = bench.status();
        assert!(
            state == ProcessState::Error && text.starts_with("PLAN_TO: keep_out: a polygon has 2"),
            "{text}"
        );
        assert!(bench.path().is_empty());
    }
    bench.plan_to(10.0, 0.0);
    bench.cycle();
    assert!(bench.status().0 == ProcessState::Exec && !bench.path().is_empty(), "{:?}", bench.status());
}
