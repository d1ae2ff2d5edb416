//! Whole cycles: ground truth in, commands out.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use rcs_geom::{DVec3, Pose};
use rcs_msg::foxglove::packed_element_field::NumericType;
use rcs_msg::foxglove::{Grid, Odometry, PackedElementField, PoseInFrame, PosesInFrame, Vector2};
use rcs_msg::rcs;
use rcs_runtime::ProcessType;
use rcs_sense::pose_message;
use rcs_testkit::bench::{Bench, Setup};
use rcs_truth_driver::TruthDriver;

const STACK: &str = r#"
format = 1
name = "driver"

[[process]]
name = "driver"
plugin = "truth_driver"
supervisor = "viewer"
inputs = { ground_truth_pose = "/operator/pose", ground_truth_map = "/operator/map", goal = "/operator/goal" }
"#;

/// A bench with the driver alone and cycles of 50 ms.
trait DriverBench: Sized {
    fn start() -> Self;
    fn on_a_meadow() -> Self;
    fn at(&mut self, x_m: f64, y_m: f64, yaw_rad: f64);
    fn cycle(&mut self);
    fn command(&self) -> (f64, f64);
    fn status(&self) -> rcs::Status;
}

impl DriverBench for Bench {
    fn start() -> Bench {
        let mut bench = Setup::new(STACK, &[ProcessType::of::<TruthDriver>()]).bench();
        bench.cycle();
        bench
    }

    /// A bench on a flat meadow of 16 m by 8 m, with a goal at (14, 4) m.
    fn on_a_meadow() -> Bench {
        let mut bench = Bench::start();
        bench.write("/operator/map", map(|_| 1));
        bench.write("/operator/goal", goal(14.0));
        bench
    }

    /// Runs a cycle at a position, m, with a heading, rad.
    fn at(&mut self, x_m: f64, y_m: f64, yaw_rad: f64) {
        self.write("/operator/pose", odometry("global", Pose::from_xy_yaw(x_m, y_m, yaw_rad)));
        self.cycle();
    }

    fn cycle(&mut self) {
        self.cycles(50, 1);
    }

    fn command(&self) -> (f64, f64) {
        let command: rcs::DriveCommand = self.latest("/driver/drive");
        (command.speed_mps, command.yaw_rate_radps.unwrap())
    }

    fn status(&self) -> rcs::Status {
        self.latest("/driver/status")
    }
}

fn odometry(frame: &str, pose: Pose) -> Odometry {
    Odometry { frame_id: frame.to_owned(), pose: Some(pose_message(&pose)), ..Odometry::default() }
}

fn goal(x_m: f64) -> PoseInFrame {
    let pose = Some(pose_message(&Pose::from_translation(DVec3::new(x_m, 4.0, 0.0))));
    PoseInFrame { frame_id: "global".to_owned(), pose, ..PoseInFrame::default() }
}

/// 80×40 level cells of 0.2 m whose class depends on the column.
fn map(class: impl Fn(usize) -> u8) -> Grid {
    let cell = |column: usize| [[0; 8].as_slice(), &[class(column)]].concat();
    let row: Vec<u8> = (0..80).flat_map(cell).collect();
    let field = |name: &str, offset, kind: NumericType| PackedElementField {
        name: name.to_owned(),
        offset,
        r#type: kind.into(),
    };
    let fields = vec![
        field("height", 0, NumericType::Float32),
        field("vegetation", 4, NumericType::Float32),
        field("class", 8, NumericType::Uint8),
    ];
    Grid {
        frame_id: "global".to_owned(),
        column_count: 80,
        cell_size: Some(Vector2 { x: 0.2, y: 0.2 }),
        row_stride: 720,
        cell_stride: 9,
        fields,
        data: row.repeat(40).into(),
        ..Grid::default()
    }
}

#[test]
fn without_the_truth_nothing_is_commanded() {
    let mut bench = Bench::start();
    bench.at(2.0, 4.0, 0.0);
    assert_eq!(bench.sent("/driver/drive"), 0);
    bench.write("/operator/map", map(|_| 1));
    bench.write("/operator/goal", goal(14.0));
    bench.at(2.0, 4.0, 0.0);
    assert_eq!(bench.sent("/driver/drive"), 1);
    for _ in 0..20 {
        bench.cycle();
    }
    let sent = bench.sent("/driver/drive");
    assert!((10..13).contains(&sent), "a pose counts for half a second: {sent}");
}

#[test]
fn it_drives_along_its_path_and_stands_at_the_goal() {
    let mut bench = Bench::on_a_meadow();
    bench.at(2.0, 4.0, 0.0);
    let (speed, rate) = bench.command();
    assert!(speed > 0.8 && rate.abs() < 0.3, "{speed} {rate}");
    let path: PosesInFrame = bench.latest("/driver/path");
    assert!(path.poses.len() > 55 && path.frame_id == "global");
    bench.at(13.5, 4.0, 0.0);
    assert_eq!(bench.command(), (0.0, 0.0));
    assert_eq!(bench.status().state(), rcs::ProcessState::Done);
}

#[test]
fn it_commands_no_speed_that_the_vehicle_refuses() {
    let types = [ProcessType::of::<TruthDriver>()];
    let mut bench = Setup::new(STACK, &types).params(&[("driver.vehicle_speed_mps", "0.3")]).bench();
    bench.cycle();
    bench.write("/operator/map", map(|_| 1));
    bench.write("/operator/goal", goal(14.0));
    bench.at(2.0, 4.0, 0.0);
    assert_eq!(bench.command().0, 0.3);
}

#[test]
fn it_turns_on_the_spot_to_a_path_behind_it() {
    let mut bench = Bench::on_a_meadow();
    bench.at(2.0, 4.0, 3.0);
    assert_eq!(bench.command(), (0.0, -1.0));
}

#[test]
fn a_new_path_is_searched_for_when_the_map_or_the_goal_changes_or_it_has_strayed() {
    let mut bench = Bench::on_a_meadow();
    let plans = |bench: &Bench| {
        let stats: rcs_truth_driver::proto::TruthDriverStats = bench.latest("/driver/stats");
        (stats.plans, stats.last_reason)
    };
    bench.at(2.0, 4.0, 0.0);
    assert_eq!(plans(&bench).0, 1);
    bench.write("/operator/map", map(|_| 1));
    bench.write("/operator/goal", goal(14.0));
    for _ in 0..12 {
        bench.at(2.2, 4.0, 0.0);
    }
    assert_eq!(plans(&bench).0, 1, "what comes again unchanged is no change");
    bench.write("/operator/map", map(|column| if column < 20 { 2 } else { 1 }));
    bench.at(2.2, 4.0, 0.0);
    assert_eq!(plans(&bench), (2, "the map has changed".to_owned()));
    bench.write("/operator/goal", goal(13.0));
    bench.at(2.2, 4.0, 0.0);
    assert_eq!(plans(&bench), (3, "the goal has changed".to_owned()));
    bench.at(3.0, 5.5, 0.0);
    assert_eq!(plans(&bench).0, 4);
    assert!(plans(&bench).1.contains("off its path"));
}

#[test]
fn a_goal_behind_a_wall_is_an_error_and_nothing_is_commanded_until_it_opens() {
    let mut bench = Bench::on_a_meadow();
    bench.write("/operator/map", map(|column| if column == 40 { 24 } else { 1 }));
    bench.at(2.0, 4.0, 0.0);
    assert_eq!(bench.status().state(), rcs::ProcessState::Error);
    assert_eq!(bench.sent("/driver/drive"), 0);
    bench.write("/operator/map", map(|_| 1));
    bench.at(2.0, 4.0, 0.0);
    assert_eq!((bench.status().state(), bench.sent("/driver/drive")), (rcs::ProcessState::Exec, 1));
}

#[test]
fn a_vehicle_that_is_driven_by_hand_to_where_there_is_a_way_goes_on_from_there() {
    let mut bench = Bench::on_a_meadow();
    bench.write("/operator/map", map(|column| if column == 40 { 24 } else { 1 }));
    for x_m in [2.0, 2.5, 5.0] {
        bench.at(x_m, 4.0, 0.0);
        assert_eq!(bench.status().state(), rcs::ProcessState::Error, "before the wall, at {x_m} m");
    }
    assert_eq!(bench.sent("/driver/drive"), 0);
    bench.at(11.0, 4.0, 0.0);
    assert_eq!((bench.status().state(), bench.sent("/driver/drive")), (rcs::ProcessState::Exec, 1));
}

#[test]
fn what_is_no_pose_or_of_another_frame_is_a_fault_and_is_skipped() {
    let mut bench = Bench::on_a_meadow();
    bench.write("/operator/pose", odometry("local", Pose::IDENTITY));
    bench.cycle();
    assert!(bench.status().last_fault.contains("\"local\""), "{}", bench.status().last_fault);
    bench.write("/operator/pose", odometry("global", Pose::from_xy_yaw(f64::NAN, 0.0, 0.0)));
    bench.cycle();
    assert!(bench.status().last_fault.contains("not finite"), "{}", bench.status().last_fault);
    bench.write("/operator/goal", PoseInFrame { frame_id: "global".to_owned(), ..PoseInFrame::default() });
    bench.cycle();
    bench.write("/operator/map", Grid { frame_id: "local".to_owned(), ..Grid::default() });
    bench.cycle();
    assert_eq!((bench.status().faults, bench.sent("/driver/drive")), (4, 0));
}
