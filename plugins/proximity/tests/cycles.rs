//! Whole cycles: what the sensors say, and what goes out for it.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use rcs_geom::{DVec2, DVec3, Pose};
use rcs_msg::foxglove::{self, FrameTransform, FrameTransforms, Grid, Odometry, Quaternion, Vector3};
use rcs_msg::{AnyMessage, Payload, Stamp, rcs};
use rcs_proximity::Proximity;
use rcs_runtime::source::Task;
use rcs_runtime::{ExternalEvent, Plan, ProcessType, RunOptions, Session, StackFile, Stepped};
use rcs_sense::pose_message;
use rcs_world::GridView;
use std::sync::Arc;

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
static_transforms = "/operator/static_transforms"
"#;

/// A run of `proximity` alone, of cycles of 50 ms.
struct Bench {
    session: Session,
    now_ms: u64,
}

impl Bench {
    fn new() -> Bench {
        let plugins = &[ProcessType::of::<Proximity>()];
        let plan = Plan::new(StackFile::parse("proximity.toml", STACK).unwrap(), plugins, &[]).unwrap();
        let run = Stepped::new(Arc::new(plan), None, RunOptions::default()).unwrap();
        let mut bench = Bench { session: Session::new(run).unwrap(), now_ms: 0 };
        bench.cycle();
        bench
    }

    /// At (3, 4) m, looking east, with one infrared sensor in front.
    fn placed() -> Bench {
        let mut bench = Bench::new();
        let transform = FrameTransform {
            parent_frame_id: "vehicle".to_owned(),
            child_frame_id: "infrared_left".to_owned(),
            translation: Some(Vector3 { x: 0.3, y: 0.0, z: 0.3 }),
            rotation: Some(Quaternion { w: 1.0, ..Quaternion::default() }),
            ..FrameTransform::default()
        };
        bench.write("static_transforms", FrameTransforms { transforms: vec![transform] });
        bench.odometry();
        bench
    }

    fn odometry(&mut self) {
        let pose: foxglove::Pose = pose_message(&Pose::from_translation(DVec3::new(3.0, 4.0, 0.0)));
        self.write(
            "odometry",
            Odometry { frame_id: "local".to_owned(), pose: Some(pose), ..Odometry::default() },
        );
    }

    fn write<T: Payload>(&mut self, port: &str, message: T) {
        let write = ExternalEvent::operator(format!("/operator/{port}"), AnyMessage::new(message));
        self.session.write(write).unwrap();
    }

    fn cycle(&mut self) {
        self.now_ms += 50;
        let until = Stamp(self.now_ms * 1_000_000 - 25_000_000);
        self.session.forward_until(until, &Task::default()).unwrap();
    }

    fn sent(&self, port: &str) -> u64 {
        self.session.run().bus().get(&format!("/proximity/{port}")).unwrap().newest()
    }

    fn latest<T: Payload>(&self, port: &str) -> T {
        let buffer = format!("/proximity/{port}");
        self.session.run().bus().get(&buffer).unwrap().latest().unwrap().message.to().unwrap()
    }

    fn faults(&self) -> (u64, String) {
        let status: rcs::Status = self.latest("status");
        (status.faults, status.last_fault)
    }

    fn infrared(&mut self, reading: rcs::RangeReading) {
        let readings = vec![reading];
        self.write("infrared", rcs::RangeReadings { readings, ..Default::default() });
        self.odometry();
        self.cycle();
    }
}

/// The cost that a grid gives for a place in its frame.
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
    bench.write("bumper", rcs::Bumper::default());
    bench.cycle();
    assert_eq!(bench.sent("bumper_cost"), 1);
    bench.odometry();
    bench.write("bumper", rcs::Bumper { left: true, ..Default::default() });
    bench.cycle();
    assert_eq!(bench.sent("bumper_cost"), 2);
    let grid: Grid = bench.latest("bumper_cost");
    assert_eq!(grid.frame_id, "local");
    assert_eq!(cost_at(&grid, "cost.bumper", 3.85, 4.1), 250.0);
    assert_eq!(cost_at(&grid, "cost.bumper", 3.3, 4.1), 0.0);
    assert_eq!(cost_at(&grid, "cost.bumper", 3.85, 3.5), 255.0);
}

#[test]
fn unchanged_bumper_readings_go_out_ten_times_a_second() {
    let mut bench = Bench::placed();
    for _ in 0..20 {
        bench.odometry();
        bench.write("bumper", rcs::Bumper::default());
        bench.cycle();
    }
    assert_eq!(bench.sent("bumper_cost"), 10);
}

#[test]
fn an_infrared_reading_becomes_free_cells_and_an_obstacle() {
    let mut bench = Bench::placed();
    bench.infrared(reading(1.0));
    let grid: Grid = bench.latest("infrared_cost");
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
        let (faults, last) = bench.faults();
        assert_eq!((faults, bench.sent("infrared_cost")), (count, 0), "{last}");
        assert!(last.contains(why), "got {last:?}, expected {why:?}");
    }
    bench.infrared(reading(1.0));
    assert_eq!(bench.sent("infrared_cost"), 1);
}

#[test]
fn a_hit_without_a_pose_is_a_fault_and_one_that_is_none_is_not() {
    let mut bench = Bench::new();
    bench.write("bumper", rcs::Bumper::default());
    bench.cycle();
    assert_eq!(bench.faults().0, 0);
    bench.write("bumper", rcs::Bumper { right: true, ..Default::default() });
    bench.cycle();
    assert_eq!((bench.faults().0, bench.sent("bumper_cost")), (1, 0));
}

#[test]
fn spinning_wheels_are_reported_from_encoders_and_inertial_readings() {
    let mut bench = Bench::placed();
    let level = |x| Some(Vector3 { x, y: 0.0, z: 9.81 });
    for cycle in 0..60 {
        // The wheels spin up within a second while the vehicle stands.
        let speed = (f64::from(cycle) * 0.05 - 0.5).clamp(0.0, 1.0);
        bench.write(
            "encoders",
            rcs::WheelEncoders { left_mps: speed, right_mps: speed, ..Default::default() },
        );
        bench.write("motors", rcs::MotorCurrents { left_a: 4.0, right_a: 5.0, ..Default::default() });
        let imu = rcs::Imu {
            linear_acceleration: level(0.0),
            angular_velocity: Some(Vector3::default()),
            ..Default::default()
        };
        bench.write("imu", imu);
        bench.odometry();
        bench.cycle();
    }
    let report: rcs_proximity::proto::SlipReport = bench.latest("slip");
    assert_eq!(report.state(), rcs_proximity::proto::TractionState::TractionSpins);
    assert!(report.slip > 0.5 && report.wheel_speed_mps == 1.0, "{report:?}");
    assert_eq!((report.spin_count, report.left_a, report.right_a), (1, 4.0, 5.0));
    let imu = rcs::Imu {
        linear_acceleration: level(f64::NAN),
        angular_velocity: Some(Vector3::default()),
        ..Default::default()
    };
    bench.write("imu", imu);
    bench.write("encoders", rcs::WheelEncoders { left_mps: f64::INFINITY, ..Default::default() });
    bench.cycle();
    assert_eq!(bench.faults().0, 2);
}
