//! Orders from above the waypoint generator, and those that the operator gives to its children.

use super::modes::mode;
use super::{FILES, cycle, drive, free, point, start, status, story};
use rcs_msg::rcs;
use rcs_msg::rcs::{Mission, Plan, ProcessState};
use rcs_testkit::bench::Bench;

fn order(bench: &mut Bench, process: &str, serial: u64, name: &str) {
    let command = rcs::Command { serial, name: name.to_owned(), ..rcs::Command::default() };
    bench.write(&format!("/{process}/command"), command);
}

#[test]
fn init_and_run_within_a_period_both_reach_the_planner_and_the_follower() {
    let mut bench = start(&FILES);
    let plans = |bench: &Bench| bench.latest::<Plan>("/planner/plan").plans;
    cycle(&mut bench, 0.0, 0.0, free, 20);
    bench.write("/operator/bumper", rcs::Bumper { left: true, ..rcs::Bumper::default() });
    cycle(&mut bench, 0.0, 0.0, free, 2);
    assert_eq!(mode(&bench).0, "REVERSE_FROM_BUMPER", "{}", story(&bench));
    bench.write("/operator/bumper", rcs::Bumper::default());
    let before = plans(&bench);
    order(&mut bench, "generator", 100, "INIT");
    order(&mut bench, "generator", 101, "RUN");
    cycle(&mut bench, 0.0, 0.0, free, 12);
    assert!((1..before).contains(&plans(&bench)), "{before} plans, then {}", plans(&bench));
    assert_eq!(mode(&bench), (String::new(), "initialized".to_owned()), "{}", story(&bench));
    assert!(drive(&bench).0 > 0.5, "{}", story(&bench));
}

#[test]
fn a_planner_that_the_operator_has_halted_has_not_arrived() {
    let mut bench = start(&FILES[..2]);
    let goals = vec![point(4.0, 0.0), point(8.0, 4.0)];
    bench.write("/operator/mission", Mission { frame_id: "local".to_owned(), goals, ..Mission::default() });
    cycle(&mut bench, 0.0, 0.0, free, 12);
    order(&mut bench, "planner", 100, "HALT");
    cycle(&mut bench, 0.0, 0.0, free, 12);
    assert_eq!(bench.latest::<Mission>("/generator/driven").reached, 0);
    let (state, text) = status(&bench, "generator");
    assert!(state == ProcessState::Exec && text.starts_with("planner obeys "), "{text}");
}

#[test]
fn a_follower_that_the_operator_has_halted_is_named_until_the_vehicle_is_at_the_goal() {
    let mut bench = start(&FILES[..2]);
    cycle(&mut bench, 0.0, 0.0, free, 12);
    order(&mut bench, "follower", 100, "HALT");
    cycle(&mut bench, 0.0, 0.0, free, 12);
    assert_eq!(drive(&bench), (0.0, 0.0), "{}", story(&bench));
    let (state, text) = status(&bench, "generator");
    assert!(state == ProcessState::Exec && text.starts_with("follower obeys "), "{text}");
    cycle(&mut bench, 9.8, 0.0, free, 6);
    assert_eq!(status(&bench, "generator"), (ProcessState::Done, "at the goal".to_owned()));
}
