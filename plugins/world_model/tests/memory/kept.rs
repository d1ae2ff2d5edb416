//! What is kept and saved of a run: after `INIT`, without a way to the goal, and while the fixes have jumped.

use super::{STACK, cost_at, first_run, go, ground_truth, locate, look, order, start, start_with, text};
use glam::DVec2;
use rcs_geom::Utm;
use rcs_msg::Stamp;
use rcs_msg::rcs::{Plan, PlanState};
use rcs_testkit::bench::Bench;
use rcs_world_model::memory::Rectangle;
use rcs_world_model::proto::MapMemory;

/// Where the local frame lies in the global one, m.
const LOCAL_FRAME: DVec2 = DVec2::new(2.0, 3.0);

/// Cost at a place of the local frame in the map that was saved last, m, if the local frame lies here in the global one, m;
/// 255 for unknown.
fn saved_at(bench: &Bench, at: DVec2, local_frame: DVec2) -> u8 {
    let origin = Utm::new(18, true, 300_000.0, 4_000_000.0).unwrap();
    let saved: MapMemory = bench.latest("/memory/memory");
    Rectangle::of_memory(&saved, &origin).unwrap().at(at + local_frame)
}

/// States where the local frame lies in the global one from now on, m.
fn place(bench: &mut Bench, local_frame: DVec2) {
    let now = Stamp(bench.now_ms * 1_000_000 + 1);
    locate(bench, now, local_frame);
}

#[test]
fn a_remembered_map_that_leaves_no_way_is_saved_all_the_same_and_used_again_with_another_goal() {
    let mut bench = start(&first_run());
    let (here, behind) = (DVec2::new(4.0, -1.5), DVec2::new(7.4, -2.8));
    look(&mut bench, here, 2.5, ground_truth, 40);
    assert!(text(&bench).starts_with("remembers: "), "{}", text(&bench));
    let plan = |state: PlanState, goal_x_m: f64| Plan { state: state.into(), goal_x_m, ..Plan::default() };
    // The cells of the saved map lie half a cell beside those of the local frame.
    let is_wall_saved = |bench: &Bench| {
        let costs = [-0.4, 0.0, 0.4].map(|y| saved_at(bench, behind + DVec2::new(0.0, y), LOCAL_FRAME));
        costs.contains(&250)
    };
    bench.write("/operator/plan", plan(PlanState::PlanNoWay, 30.0));
    look(&mut bench, here, 2.5, ground_truth, 80);
    let dropped = "the remembered map leaves no way to the goal: not used";
    assert_eq!((text(&bench).as_str(), cost_at(&bench, behind)), (dropped, 255));
    assert!(is_wall_saved(&bench), "remembered, and not sensed");
    // A plan without a goal, and one to nearly the same goal, tell of no other one.
    for (state, goal_x_m) in [(PlanState::PlanUnusable, 0.0), (PlanState::PlanPath, 33.0)] {
        bench.write("/operator/plan", plan(state, goal_x_m));
        look(&mut bench, here, 2.5, ground_truth, 40);
        assert_eq!(text(&bench), dropped);
    }
    // Nor does a jump of the fixes.
    for local_frame in [LOCAL_FRAME + DVec2::new(20.0, 0.0), LOCAL_FRAME] {
        place(&mut bench, local_frame);
        look(&mut bench, here, 2.5, ground_truth, 40);
        assert!(text(&bench).starts_with(dropped), "{}", text(&bench));
    }
    bench.write("/operator/plan", plan(PlanState::PlanPath, 60.0));
    look(&mut bench, here, 2.5, ground_truth, 40);
    assert!(text(&bench).starts_with("remembers: "), "{}", text(&bench));
    assert!(cost_at(&bench, behind) == 250 && is_wall_saved(&bench));
}

#[test]
fn what_was_seen_before_init_is_saved_after_it() {
    let mut bench = start("");
    let end = DVec2::new(0.0, 20.0);
    look(&mut bench, DVec2::ZERO, 4.0, ground_truth, 40);
    go(&mut bench, DVec2::ZERO, end);
    order(&mut bench, "memory", "INIT");
    look(&mut bench, end, 0.5, |_| 0, 6);
    order(&mut bench, "memory", "RUN");
    look(&mut bench, end, 0.5, |_| 0, 20);
    assert_eq!(text(&bench), "nothing is remembered; saves the map");
    let at = |y: f64| saved_at(&bench, DVec2::new(0.1, y), LOCAL_FRAME);
    assert_eq!((at(1.0), at(20.1)), (0, 0), "where it began, and where it is now");
}

#[test]
fn while_the_fixes_have_jumped_the_map_is_not_saved_until_they_are_back_or_the_vehicle_has_driven_on() {
    let mut bench = start("");
    let (jumped, saves) = (LOCAL_FRAME + DVec2::new(20.0, 0.0), "nothing is remembered; saves the map");
    let held = "nothing is remembered; the map is not saved: \
        the local frame has jumped by 20.0 m in the global one";
    look(&mut bench, DVec2::ZERO, 4.0, ground_truth, 40);
    place(&mut bench, jumped);
    look(&mut bench, DVec2::ZERO, 4.0, ground_truth, 20);
    assert_eq!(text(&bench), held);
    let sent = bench.sent("/memory/memory");
    // The vehicle stands.
    bench.cycles(50, 800);
    look(&mut bench, DVec2::ZERO, 4.0, ground_truth, 20);
    assert_eq!((text(&bench).as_str(), bench.sent("/memory/memory")), (held, sent));
    place(&mut bench, LOCAL_FRAME);
    look(&mut bench, DVec2::ZERO, 4.0, ground_truth, 20);
    assert_eq!(text(&bench), saves);
    assert!(bench.sent("/memory/memory") > sent, "they are back");

    place(&mut bench, jumped);
    let ahead = DVec2::new(0.0, 10.0);
    go(&mut bench, DVec2::ZERO, ahead);
    assert_eq!(text(&bench), held);
    bench.cycles(50, 640);
    look(&mut bench, ahead, 4.0, ground_truth, 20);
    assert_eq!((text(&bench).as_str(), saved_at(&bench, DVec2::new(1.0, 1.0), jumped)), (saves, 0));
}

#[test]
fn a_jump_that_the_parameter_allows_does_not_keep_the_map_from_being_saved() {
    let mut bench = start_with(STACK, &[("memory.jump_m", "30")]);
    look(&mut bench, DVec2::ZERO, 4.0, ground_truth, 40);
    place(&mut bench, LOCAL_FRAME + DVec2::new(20.0, 0.0));
    look(&mut bench, DVec2::ZERO, 4.0, ground_truth, 20);
    assert_eq!(text(&bench), "nothing is remembered; saves the map");
}

#[test]
fn after_clear_nothing_of_before_is_saved_also_while_the_fixes_have_jumped() {
    let mut bench = start("");
    let (end, jumped) = (DVec2::new(0.0, 20.0), LOCAL_FRAME + DVec2::new(20.0, 0.0));
    look(&mut bench, DVec2::ZERO, 4.0, ground_truth, 40);
    go(&mut bench, DVec2::ZERO, end);
    place(&mut bench, jumped);
    look(&mut bench, end, 0.5, |_| 0, 20);
    order(&mut bench, "memory", "CLEAR");
    look(&mut bench, end, 0.5, |_| 0, 20);
    let at = |y: f64| saved_at(&bench, DVec2::new(0.1, y), jumped);
    assert_eq!((at(1.0), at(20.1)), (255, 0), "where it began, and where it is now");
}
