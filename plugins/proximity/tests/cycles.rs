//! Whole cycles: sensor readings and the resulting outputs.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use rcs_geom::{DVec2, DVec3, Pose};
use rcs_msg::foxglove::{self, FrameTransform, FrameTransforms, Grid, Odometry, Quaternion, Vector3};
use rcs_msg::rcs;
use rcs_msg::{AnyMessage, Stamp};
use rcs_proximity::Proximity;
use rcs_proximity::proto::ProximityParams;
use rcs_runtime::{ExternalEvent, ProcessType};
use rcs_sense::pose_message;
use rcs_testkit::bench::{Bench, Setup};
use rcs_world::GridView;

const STACK: &str = r#"
format = 1
name = "proximity"

[[process]]
name = "proximity"
plugin = "proximity"
supervisor = "viewer"

[process.inputs]
bumper = "/operator/bumper"
infrared = "/operator/infrared"
motors = "/operator/motors"
encoders = "/operator/encoders"
imu = "/operator/imu"
odometry = "/operator/odometry"
way_slip = "/operator/way_slip"
static_transforms = "/operator/static_transforms"
"#;

/// A bench with the process `proximity` alone and cycles of 50 ms.
trait ProximityBench: Sized {
    fn start() -> Self;
    fn placed() -> Self;
    fn odometry(&mut self);
    fn cycle(&mut self);
    fn infrared(&mut self, reading: rcs::RangeReading);
    fn say(&mut self, serial: u64, name: &str);
    fn told(&self) -> String;
}

impl ProximityBench for Bench {
    fn start() -> Bench {
        let mut bench = Setup::new(STACK, &[ProcessType::of::<Proximity>()]).bench();
        bench.cycle();
        bench
    }

    /// A bench at (3, 4) m, facing east, with one infrared sensor in front.
    fn placed() -> Bench {
        let mut bench = Bench::start();
        let transform = FrameTransform {
            parent_frame_id: "vehicle".to_owned(),
            child_frame_id: "infrared_left".to_owned(),
            translation: Some(Vector3 { x: 0.3, y: 0.0, z: 0.3 }),
            rotation: Some(Quaternion { w: 1.0, ..Quaternion::default() }),
            ..FrameTransform::default()
        };
        bench.write("/operator/static_transforms", FrameTransforms { transforms: vec![transform] });
        bench.odometry();
        bench
    }

    fn odometry(&mut self) {
        let pose: foxglove::Pose = pose_message(&Pose::from_translation(DVec3::new(3.0, 4.0, 0.0)));
        let odometry = Odometry { frame_id: "local".to_owned(), pose: Some(pose), ..Odometry::default() };
        self.write("/operator/odometry", odometry);
    }

    fn cycle(&mut self) {
        self.cycles(50, 1);
    }

    fn infrared(&mut self, reading: rcs::RangeReading) {
        let readings = vec![reading];
        self.write("/operator/infrared", rcs::RangeReadings { readings, ..Default::default() });
        self.odometry();
        self.cycle();
    }

    fn say(&mut self, serial: u64, name: &str) {
        let name = name.to_owned();
        self.write("/proximity/command", rcs::Command { serial, name, ..Default::default() });
        self.cycle();
    }

    /// The text of the status, which is that of a process that runs.
    fn told(&self) -> String {
        let status: rcs::Status = self.latest("/proximity/status");
        assert_eq!(status.state(), rcs::ProcessState::Exec, "{}", status.state_text);
        status.state_text
    }
}

/// The cost of a grid at a position in its frame.
fn cost_at(grid: &Grid, field: &str, x_m: f64, y_m: f64) -> f64 {
    let view = GridView::new(grid).unwrap();
    let corner = view.frame_from_grid().translation.truncate();
    let cell = ((DVec2::new(x_m, y_m) - corner) / view.cell_size_m()).floor();
    view.field(field).unwrap().get(cell.x as usize, cell.y as usize).unwrap()
}

fn reading(range_m: f64) -> rcs::RangeReading {
    rcs::RangeReading {
        frame_id: "infrared_left".to_owned(),
        range_m,
        seen: true,
        max_range_m: 1.5,
        cone_rad: 0.2,
    }
}

#[test]
fn a_bumper_hit_goes_out_at_once_as_cost_250_before_the_bumper() {
    let mut bench = Bench::placed();
    bench.write("/operator/bumper", rcs::Bumper::default());
    bench.cycle();
    assert_eq!(bench.sent("/proximity/bumper_cost"), 1);
    bench.odometry();
    bench.write("/operator/bumper", rcs::Bumper { left: true, ..Default::default() });
    bench.cycle();
    assert_eq!(bench.sent("/proximity/bumper_cost"), 2);
    let grid: Grid = bench.latest("/proximity/bumper_cost");
    assert_eq!(grid.frame_id, "local");
    assert_eq!(cost_at(&grid, "cost.bumper", 3.85, 4.1), 250.0);
    assert_eq!(cost_at(&grid, "cost.bumper", 3.3, 4.1), 0.0);
    assert_eq!(cost_at(&grid, "cost.bumper", 3.85, 3.5), 255.0);
}

#[test]
fn no_wider_ground_is_called_free_than_the_bumper_has_touched() {
    let mut bench = Bench::placed();
    let params: ProximityParams = bench.latest("/proximity/params");
    let params = ProximityParams { vehicle_width_m: 0.8, bumper_width_m: 0.4, ..params };
    bench.write("/proximity/params", params);
    bench.write("/operator/bumper", rcs::Bumper::default());
    bench.cycle();
    let grid: Grid = bench.latest("/proximity/bumper_cost");
    let costs = [3.5, 3.7, 3.9, 4.1, 4.3].map(|y_m| cost_at(&grid, "cost.bumper", 3.3, y_m));
    assert_eq!(costs, [255.0, 255.0, 0.0, 0.0, 255.0]);
}

#[test]
fn the_ground_that_is_called_free_ends_with_the_vehicle() {
    let free_behind = |rear_m: f64, vehicle_width_m: f64| {
        let mut bench = Bench::placed();
        let params: ProximityParams = bench.latest("/proximity/params");
        bench.write("/proximity/params", ProximityParams { rear_m, vehicle_width_m, ..params });
        bench.write("/operator/bumper", rcs::Bumper::default());
        bench.cycle();
        let grid: Grid = bench.latest("/proximity/bumper_cost");
        let places = [(2.9, 4.1), (2.5, 4.1), (2.3, 4.1), (2.9, 4.3)];
        places.map(|(x_m, y_m)| cost_at(&grid, "cost.bumper", x_m, y_m))
    };
    assert_eq!(free_behind(0.25, 0.35), [0.0, 255.0, 255.0, 255.0]);
    // At each side a margin of 0.03 m is not called free: the cells there have their middle 0.3 m beside the vehicle's.
    assert_eq!(free_behind(0.72, 0.62), [0.0, 0.0, 0.0, 255.0]);
    assert_eq!(free_behind(0.72, 0.7), [0.0; 4]);
    assert_eq!(free_behind(0.72, 0.05), [255.0; 4], "narrower than the margins");
}

#[test]
fn what_is_under_a_vehicle_whose_wheels_have_slipped_over_the_last_metre_is_not_called_free() {
    let mut bench = Bench::placed();
    let mut under = |slip: f64| {
        let middle = Some(pose_message(&Pose::from_translation(DVec3::new(3.0, 4.0, 0.0))));
        let report = rcs::WaySlip { slip, rolled_m: 1.0, middle, ..Default::default() };
        bench.write("/operator/way_slip", report);
        bench.odometry();
        bench.cycle();
        bench.write("/operator/bumper", rcs::Bumper::default());
        bench.odometry();
        bench.cycle();
        cost_at(&bench.latest("/proximity/bumper_cost"), "cost.bumper", 3.3, 4.1)
    };
    assert_eq!([0.1, 0.5, 0.9, 0.1].map(&mut under), [0.0, 255.0, 255.0, 0.0]);
}

#[test]
fn unchanged_bumper_readings_go_out_ten_times_a_second() {
    let mut bench = Bench::placed();
    for _ in 0..20 {
        bench.odometry();
        bench.write("/operator/bumper", rcs::Bumper::default());
        bench.cycle();
    }
    assert_eq!(bench.sent("/proximity/bumper_cost"), 10);
}

#[test]
fn a_bumper_reading_from_the_future_does_not_end_the_maps_of_those_after_it() {
    let mut bench = Bench::placed();
    let ahead = Stamp((bench.now_ms + 3_600_000) * 1_000_000);
    let message = AnyMessage::new(rcs::Bumper::default());
    bench.session.write(ExternalEvent::sensed("/operator/bumper", ahead, message)).unwrap();
    bench.cycle();
    for _ in 0..20 {
        bench.odometry();
        bench.write("/operator/bumper", rcs::Bumper::default());
        bench.cycle();
    }
    let sent = bench.sent("/proximity/bumper_cost");
    assert!((10..=11).contains(&sent), "{sent}");
}

#[test]
fn an_infrared_reading_becomes_free_cells_and_an_obstacle() {
    let mut bench = Bench::placed();
    bench.infrared(reading(1.0));
    let grid: Grid = bench.latest("/proximity/infrared_cost");
    assert_eq!(cost_at(&grid, "cost.infrared", 3.7, 4.0), 0.0);
    assert_eq!(cost_at(&grid, "cost.infrared", 4.3, 4.0), 250.0);
    assert_eq!(cost_at(&grid, "cost.infrared", 4.7, 4.0), 255.0);
}

#[test]
fn readings_that_cannot_be_used_are_faults_and_nothing_goes_out() {
    let bad = [
        (rcs::RangeReading { range_m: f64::NAN, ..reading(1.0) }, "range is NaN"),
        (reading(1.6), "range is 1.6 m"),
        (rcs::RangeReading { max_range_m: f64::INFINITY, ..reading(1.0) }, "greatest range"),
        (rcs::RangeReading { cone_rad: -1.0, ..reading(1.0) }, "cone -1"),
        (rcs::RangeReading { frame_id: "elsewhere".to_owned(), ..reading(1.0) }, "elsewhere"),
    ];
    let mut bench = Bench::placed();
    for (count, (reading, why)) in (1..).zip(bad) {
        bench.infrared(reading);
        let (faults, last) = bench.faults("proximity");
        assert_eq!((faults, bench.sent("/proximity/infrared_cost")), (count, 0), "{last}");
        assert!(last.contains(why), "got {last:?}, expected {why:?}");
    }
    bench.infrared(reading(1.0));
    assert_eq!(bench.sent("/proximity/infrared_cost"), 1);
}

#[test]
fn a_hit_without_a_pose_is_a_fault_and_one_that_is_none_is_not() {
    let mut bench = Bench::start();
    bench.write("/operator/bumper", rcs::Bumper::default());
    bench.cycle();
    assert_eq!(bench.faults("proximity").0, 0);
    bench.write("/operator/bumper", rcs::Bumper { right: true, ..Default::default() });
    bench.cycle();
    assert_eq!((bench.faults("proximity").0, bench.sent("/proximity/bumper_cost")), (1, 0));
}

#[test]
fn spinning_wheels_are_reported_from_encoders_and_inertial_readings() {
    let mut bench = Bench::placed();
    let level = |x| Some(Vector3 { x, y: 0.0, z: 9.81 });
    for cycle in 0..60 {
        // The wheels spin up within a second while the vehicle stands.
        let speed = (f64::from(cycle) * 0.05 - 0.5).clamp(0.0, 1.0);
        bench.write(
            "/operator/encoders",
            rcs::WheelEncoders { left_mps: speed, right_mps: speed, ..Default::default() },
        );
        bench.write(
            "/operator/motors",
            rcs::MotorCurrents { left_a: 4.0, right_a: 5.0, ..Default::default() },
        );
        let imu = rcs::Imu {
            linear_acceleration: level(0.0),
            angular_velocity: Some(Vector3::default()),
            ..Default::default()
        };
        bench.write("/operator/imu", imu);
        bench.odometry();
        bench.cycle();
    }
    let report: rcs_msg::rcs::SlipReport = bench.latest("/proximity/slip");
    assert_eq!(report.state(), rcs_msg::rcs::TractionState::TractionSpins);
    assert!(report.slip > 0.5 && report.wheel_speed_mps == 1.0, "{report:?}");
    assert_eq!((report.spin_count, report.left_a, report.right_a), (1, 4.0, 5.0));
    let imu = rcs::Imu {
        linear_acceleration: level(f64::NAN),
        angular_velocity: Some(Vector3::default()),
        ..Default::default()
    };
    bench.write("/operator/imu", imu);
    bench.write("/operator/encoders", rcs::WheelEncoders { left_mps: f64::INFINITY, ..Default::default() });
    bench.cycle();
    assert_eq!(bench.faults("proximity").0, 2);
}

#[test]
fn a_stalled_motor_whose_sensor_falls_silent_and_wheels_that_do_are_not_known_any_more() {
    let mut bench = Bench::placed();
    let mut sense = |motors: bool, encoders: bool| {
        for _ in 0..20 {
            if motors {
                bench.write(
                    "/operator/motors",
                    rcs::MotorCurrents { left_a: 40.0, right_a: 40.0, ..Default::default() },
                );
            }
            if encoders {
                bench.write("/operator/encoders", rcs::WheelEncoders::default());
            }
            let imu = rcs::Imu {
                linear_acceleration: Some(Vector3 { x: 0.0, y: 0.0, z: 9.81 }),
                angular_velocity: Some(Vector3::default()),
                ..Default::default()
            };
            bench.write("/operator/imu", imu);
            bench.odometry();
            bench.cycle();
        }
        let report: rcs::SlipReport = bench.latest("/proximity/slip");
        (report.state(), report.left_a)
    };
    assert_eq!(sense(true, true), (rcs::TractionState::TractionStalled, 40.0));
    assert_eq!(sense(false, true), (rcs::TractionState::TractionUnknown, 0.0));
    assert_eq!(sense(true, true), (rcs::TractionState::TractionStalled, 40.0));
    assert_eq!(sense(true, false), (rcs::TractionState::TractionUnknown, 0.0));
}

#[test]
fn a_sensor_that_falls_silent_is_told_until_it_is_back_and_one_that_never_spoke_is_not_missed() {
    let speak = |bench: &mut Bench, sensor: &str| {
        if sensor == "infrared" {
            bench.infrared(reading(1.0));
        } else {
            bench.write("/operator/motors", rcs::MotorCurrents::default());
            bench.cycle();
        }
    };
    for sensor in ["infrared", "motors"] {
        let mut bench = Bench::placed();
        bench.cycles(50, 40);
        assert_eq!(bench.told(), "senses", "{sensor}: it never spoke");
        speak(&mut bench, sensor);
        bench.cycles(50, 9);
        assert_eq!(bench.told(), "senses", "{sensor}: silent for less than 0.5 s");
        bench.cycles(50, 9);
        let expected = format!("warning: {sensor} silent for 1.0 s, expected at most 0.5 s; senses");
        assert_eq!(bench.told(), expected);
        bench.say(2, "INIT");
        bench.say(3, "RUN");
        let silent = format!("warning: {sensor} silent for 1.");
        assert!(bench.told().starts_with(&silent), "after INIT, too: {}", bench.told());
        speak(&mut bench, sensor);
        assert_eq!(bench.told(), "senses", "{sensor}: it is back");
    }
}

#[test]
fn sensors_that_are_silent_together_are_both_told() {
    let mut bench = Bench::placed();
    bench.write("/operator/motors", rcs::MotorCurrents::default());
    bench.infrared(reading(1.0));
    bench.cycles(50, 18);
    let both = "warning: infrared silent for 1.0 s, motors silent for 1.0 s, expected at most 0.5 s; senses";
    assert_eq!(bench.told(), both);
}
