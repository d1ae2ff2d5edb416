//! Runs every course of the simulation with the driver that knows the ground truth: the goal is reached in time and
//! without a collision, and runs with the same seed are identical to the last byte.

use crate::bundled;
use rcs_msg::rcs::{CourseOutcome, CourseRun, DriveCommand, GroundTruthState, VehicleStatus};
use rcs_msg::{AnyMessage, Payload, Stamp};
use rcs_runtime::source::Task;
use rcs_runtime::{ExternalEvent, Plan, RunOptions, Session, Stepped};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

/// The driver's stack on a course, with other parameter values.
fn plan(course: &str, overrides: &[(&str, &str)]) -> Arc<Plan> {
    bundled::plan("truth_driver", course, overrides)
}

fn latest<T: Payload>(run: &Stepped, buffer: &str) -> T {
    run.bus().get(buffer).unwrap().latest().unwrap().message.to().unwrap()
}

/// Drives a course until the referee decides; returns its verdict and the hash of all messages.
fn decide(plan: &Arc<Plan>, seed: u64) -> (CourseRun, String) {
    let options = RunOptions { seed, hash: true, ..RunOptions::default() };
    let mut run = Stepped::new(Arc::clone(plan), None, options).unwrap();
    run.begin().unwrap();
    // The time limits of all courses are below four minutes.
    for second in 1..=250 {
        run.run_until(Stamp(second * 1_000_000_000)).unwrap();
        let verdict: CourseRun = latest(&run, "/vehicle/run");
        if verdict.outcome() != CourseOutcome::CourseRunning {
            let hash = run.summary().hash.unwrap();
            return (verdict, hash);
        }
    }
    panic!("the referee has not decided after 250 s");
}

/// Drives a course with two seeds, and with the first one again.
fn check(course: &str) {
    let plan = plan(course, &[]);
    let mut hashes = Vec::new();
    for seed in [0, 1, 0] {
        let (run, hash) = decide(&plan, seed);
        let told = format!("{course} with seed {seed}: {run:?}");
        assert_eq!(run.outcome(), CourseOutcome::CourseReached, "{told}");
        assert_eq!((run.collisions, run.bumper_hits), (0, 0), "{told}");
        assert!(run.time_s < run.time_limit_s && run.time_limit_s <= 240.0, "{told}");
        assert!(run.distance_m > 60.0, "a course is about 100 m long: {told}");
        hashes.push(hash);
    }
    assert_eq!(hashes[0], hashes[2], "{course}: two runs of a seed are the same");
    assert_ne!(hashes[0], hashes[1], "{course}: the sensors' noise follows the seed");
}

#[test]
fn every_course_can_be_driven() {
    let courses = bundled::courses();
    assert!(courses.len() >= 20, "{courses:?}");
    // Two at a time.
    let next = AtomicUsize::new(0);
    std::thread::scope(|scope| {
        for _ in 0..2 {
            scope.spawn(|| {
                while let Some(course) = courses.get(next.fetch_add(1, Ordering::Relaxed)) {
                    check(course);
                }
            });
        }
    });
}

/// Courses of the tests that are no way from start to goal: each is for one test, which drives by its own rules.
const FOR_ONE_TEST: [(&str, &str); 3] = [
    ("bushes_in_grass", "a bush that must be hit stands on the straight way"),
    ("ditch", "its goal is at the edge of a ditch"),
    ("low_boulders", "boulders are everywhere"),
];

/// Courses on which nothing was tuned: docs/autonomy.md says how `lagr` drives them.
fn others() -> Vec<String> {
    let others = bundled::courses_in("assets/courses");
    for (name, why) in FOR_ONE_TEST {
        assert!(others.iter().any(|other| other == name), "there is no course {name} ({why})");
    }
    others.into_iter().filter(|other| FOR_ONE_TEST.iter().all(|(name, _)| name != other)).collect()
}

#[test]
fn the_other_courses_can_be_driven() {
    let others = others();
    assert!(others.len() >= 8, "{others:?}");
    for course in others {
        let (run, _) = decide(&plan(&course, &[]), 0);
        assert_eq!((run.outcome(), run.collisions), (CourseOutcome::CourseReached, 0), "{course}: {run:?}");
    }
}

/// Time until the goal is reached, s; `None` if it is not.
fn time_s(course: &str, weights: &[(&str, &str)]) -> Option<f64> {
    let (run, _) = decide(&plan(course, weights), 0);
    println!("{course} with {weights:?}: {run:?}");
    assert_eq!(run.collisions, 0, "{run:?}");
    (run.outcome() == CourseOutcome::CourseReached).then_some(run.time_s)
}

#[test]
fn on_soft_ground_following_the_path_pays() {
    for course in ["soft_ground", "soft_ground_2"] {
        let on = time_s(course, &[("truth_driver.vegetation_weight", "3")]).expect("the path is firm");
        let beside =
            time_s(course, &[("truth_driver.vegetation_weight", "0"), ("truth_driver.slip_weight", "0")]);
        assert!(beside.is_none_or(|beside| on < 0.75 * beside), "{course}: {on} s, beside {beside:?} s");
    }
}

#[test]
fn through_grass_that_gives_way_it_is_shorter_than_around_it() {
    for course in ["thickets", "thickets_2"] {
        let through = time_s(course, &[]).expect("grass gives way");
        let around =
            time_s(course, &[("truth_driver.vegetation_weight", "50")]).expect("there is a way around");
        assert!(through < 0.8 * around, "{course}: {through} s, around {around} s");
    }
}

#[test]
fn the_straight_way_up_the_hill_is_too_slippery() {
    // A driver that avoids neither mud nor slopes.
    let reckless = [
        ("truth_driver.slip_weight", "0"),
        ("truth_driver.slope_weight", "0"),
        ("truth_driver.max_slope_deg", "35"),
    ];
    let (run, _) = decide(&plan("hill", &reckless), 0);
    assert_eq!(run.outcome(), CourseOutcome::CourseTimeOut, "{run:?}");
    assert!(run.slip_s > 60.0 && run.remaining_m > 50.0, "it has spun its wheels in the mud: {run:?}");
}

#[test]
fn the_straight_way_of_the_dead_end_ends_at_the_fence_which_the_bumper_feels() {
    let mut session =
        Session::new(Stepped::new(plan("dead_end", &[]), None, RunOptions::default()).unwrap()).unwrap();
    for cycle in 1..=54 * 10 {
        let timestamp = Some(session.run().now().to_proto());
        let straight =
            DriveCommand { timestamp, speed_mps: 1.0, yaw_rate_radps: Some(0.0), heading_rad: 0.0 };
        let message = AnyMessage::new(straight);
        session.write(ExternalEvent::operator("/operator/teleop", message)).unwrap();
        session.forward_until(Stamp(cycle * 100_000_000), &Task::default()).unwrap();
    }
    let run: CourseRun = latest(session.run(), "/vehicle/run");
    assert!((52.0..53.0).contains(&run.remaining_m), "the fence is 58 m east of the origin: {run:?}");
    assert_eq!((run.bumper_hits, run.outcome()), (1, CourseOutcome::CourseRunning), "{run:?}");
    assert!(run.collisions >= 1, "1 m/s is no gentle touch: {run:?}");
    let vehicle: VehicleStatus = latest(session.run(), "/vehicle_interface/vehicle");
    assert_eq!(vehicle.stop_reason, "bumper is pressed");
    assert!(vehicle.bumper_left && vehicle.bumper_right);
}

#[test]
fn a_simulation_that_is_taken_back_goes_on_as_before() {
    let plan = plan("meadow", &[]);
    let run = Stepped::new(plan, None, RunOptions::default()).unwrap();
    let mut session = Session::new(run).unwrap();
    let at = |seconds: u64| Stamp(seconds * 1_000_000_000);
    session.forward_until(at(20), &Task::default()).unwrap();
    let there: GroundTruthState = latest(session.run(), "/vehicle/ground_truth_state");
    session.go_to_time(at(7), &Task::default()).unwrap();
    let back: GroundTruthState = latest(session.run(), "/vehicle/ground_truth_state");
    assert!(back.distance_m < there.distance_m, "{back:?}");
    session.forward_until(at(20), &Task::default()).unwrap();
    assert_eq!(latest::<GroundTruthState>(session.run(), "/vehicle/ground_truth_state"), there);
}
