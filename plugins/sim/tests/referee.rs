//! Results of the referee, and when a run ends.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

mod common;

use common::{Plane, lagr};
use glam::DVec2;
use rcs_msg::rcs::CourseOutcome;
use rcs_sim::drive::Drive;
use rcs_sim::referee::{Goal, Referee};
use rcs_sim::terrain::Terrain;
use rcs_sim::vehicle::{DriveCommand, STEP_S, Vehicle};

const GOAL: Goal = Goal { at: DVec2::new(5.0, 0.0), radius_m: 1.0, time_limit_s: 20.0 };

fn run(plane: &Plane, speeds: &[([f64; 2], f64)]) -> Referee {
    let spec = lagr();
    let mut vehicle = Vehicle::new(&spec, plane, DVec2::ZERO, 0.0);
    let mut referee = Referee::new(DVec2::ZERO, Some(&GOAL));
    for &(speeds, seconds) in speeds {
        for _ in 0..(seconds / STEP_S).round() as usize {
            vehicle.step(
                &spec,
                plane,
                DriveCommand { drive: Drive::Speeds(speeds), curvature_per_m: 0.0 },
                1.0,
            );
            referee.watch(&vehicle, Some(&GOAL), plane.contains(vehicle.at()));
        }
    }
    referee
}

#[test]
fn a_run_ends_inside_the_goals_radius_and_its_count_stands_still() {
    let short = run(&Plane::default(), &[([1.0; 2], 6.0)]);
    assert_eq!(short.outcome(), CourseOutcome::CourseReached);
    assert!(short.remaining_m <= 1.0 && short.remaining_m > 0.95, "{short:?}");
    assert!((4.0..4.5).contains(&short.time_s), "{short:?}");
    assert_eq!(run(&Plane::default(), &[([1.0; 2], 30.0)]), short);
}

#[test]
fn a_run_ends_when_its_time_is_over() {
    let run = run(&Plane::default(), &[([0.1; 2], 25.0)]);
    assert_eq!(run.outcome(), CourseOutcome::CourseTimeOut);
    assert!((run.time_s - 20.0).abs() < 0.02);
}

#[test]
fn a_vehicle_that_lies_is_lost() {
    let plane = Plane { slope_y: 1.2, ..Plane::default() };
    assert_eq!(run(&plane, &[([0.1; 2], 1.0)]).outcome(), CourseOutcome::CourseLost);
}

#[test]
fn each_hit_of_the_bumper_and_each_collision_counts_once() {
    let plane = Plane { posts: vec![(DVec2::new(2.0, 0.0), 0.1)], ..Plane::default() };
    let fast = run(&plane, &[([1.0; 2], 6.0)]);
    assert_eq!((fast.collisions, fast.bumper_hits), (1, 1), "{fast:?}");
    let slow = run(&plane, &[([0.25; 2], 9.0)]);
    assert_eq!((slow.collisions, slow.bumper_hits), (0, 1), "{slow:?}");
    let twice = run(&plane, &[([0.25; 2], 8.0), ([-0.25; 2], 3.0), ([0.25; 2], 5.0)]);
    assert_eq!((twice.collisions, twice.bumper_hits), (0, 2), "{twice:?}");
}

#[test]
fn spinning_wheels_are_time_with_slip() {
    let plane = Plane { slope_x: 0.2, traction: 0.2, ..Plane::default() };
    let spins = run(&plane, &[([0.8; 2], 3.0)]);
    assert!(spins.slip_s > 2.9, "{spins:?}");
    let grips = run(&Plane::default(), &[([0.8; 2], 3.0)]);
    assert!(grips.slip_s < 0.1, "{grips:?}");
}
