//! Choices on small maps.

use super::*;

const RULES: Rules = Rules {
    length_m: 3.0,
    max_curvature_per_m: 1.5,
    per_side: 10,
    least_free_m: 0.5,
    escape_m: 0.5,
    tail_m: 0.5,
    nose_m: 0.0,
    turns_on_the_spot: true,
    weights: Weights {
        goal: 1.0,
        heading: 0.5,
        cost: 3.0,
        turn: 0.1,
        not_forward: 1.5,
        change: 0.1,
        short: 4.0,
    },
};

/// 61×61 cells of 0.2 m around (0, 0).
fn scene(cost: impl Fn(DVec2) -> u8) -> (Sensed, CostGrid) {
    let mut sensed =
        Sensed { columns: 61, cell_size_m: 0.2, corner: DVec2::splat(-6.1), ..Sensed::default() };
    sensed.fused = vec![0; 61 * 61];
    let centre = |at: usize| (at as f64 - 30.0) * 0.2;
    let cells = (0..61 * 61).map(|at| cost(DVec2::new(centre(at % 61), centre(at / 61)))).collect();
    (sensed, CostGrid::new(61, 61, cells).unwrap())
}

fn chosen(cost: impl Fn(DVec2) -> u8, yaw_rad: f64, target: DVec2) -> Option<Scored> {
    chosen_by(&RULES, cost, yaw_rad, target)
}

fn chosen_by(rules: &Rules, cost: impl Fn(DVec2) -> u8, yaw_rad: f64, target: DVec2) -> Option<Scored> {
    let (sensed, costs) = scene(cost);
    let vehicle = Pose::from_xy_yaw(0.0, 0.0, yaw_rad);
    let scene =
        Scene { sensed: &sensed, costs: &costs, vehicle: &vehicle, target, before_per_m: 0.0, turning: None };
    let scored: Vec<Scored> = list(rules).into_iter().map(|arc| scene.score(arc, rules)).collect();
    best(&scored).map(|at| scored[at])
}

/// The score of an arc of a vehicle at (0, 0) that faces its target, 4 m away.
fn scored(cost: impl Fn(DVec2) -> u8, arc: Arc) -> Scored {
    scored_at(0.0, cost, arc)
}

/// The same of a vehicle at (0, y), m.
fn scored_at(y_m: f64, cost: impl Fn(DVec2) -> u8, arc: Arc) -> Scored {
    scored_by(&RULES, y_m, cost, arc)
}

fn scored_by(rules: &Rules, y_m: f64, cost: impl Fn(DVec2) -> u8, arc: Arc) -> Scored {
    let (sensed, costs) = scene(cost);
    let (vehicle, target) = (Pose::from_xy_yaw(0.0, y_m, 0.0), DVec2::new(4.0, y_m));
    let scene =
        Scene { sensed: &sensed, costs: &costs, vehicle: &vehicle, target, before_per_m: 0.0, turning: None };
    scene.score(arc, rules)
}

#[test]
fn on_free_ground_it_drives_straight_or_bends_to_the_target() {
    let free = |_| 10;
    assert_eq!(chosen(free, 0.0, DVec2::new(4.0, 0.0)).unwrap().arc.curvature_per_m, 0.0);
    let left = chosen(free, 0.0, DVec2::new(3.0, 1.5)).unwrap().arc;
    assert!(left.motion == Motion::Forward && left.curvature_per_m > 0.1, "{left:?}");
    let right = chosen(free, 1.0, DVec2::new(3.0, 1.5)).unwrap().arc;
    assert!(right.curvature_per_m < -0.1, "{right:?}");
}

#[test]
fn where_there_is_no_room_for_a_bend_it_turns_on_the_spot_to_a_target_behind_it() {
    let strip = |at: DVec2| if at.y.abs() > 0.8 { BLOCKED } else { 10 };
    let arc = chosen(strip, 0.0, DVec2::new(-4.0, 0.5)).unwrap().arc;
    assert_eq!(arc.motion, Motion::TurnLeft);
    let arc = chosen(|_| 10, 0.0, DVec2::new(-4.0, 0.5)).unwrap().arc;
    assert!(arc.motion == Motion::Forward && arc.curvature_per_m > 1.0, "{arc:?}");
}

#[test]
fn where_its_tail_cannot_swing_around_it_drives_back_and_does_not_begin_a_turn() {
    // Walls 0.5 m to either side.
    let strip = |at: DVec2| if at.y.abs() > 0.5 { BLOCKED } else { 10 };
    let motion = |tail_m: f64, cost: &dyn Fn(DVec2) -> u8| {
        chosen_by(&Rules { tail_m, ..RULES }, cost, 0.0, DVec2::new(-4.0, 0.1)).unwrap().arc.motion
    };
    assert_eq!(motion(0.65, &strip), Motion::Backward);
    assert_eq!(motion(0.45, &strip), Motion::TurnLeft);
    // Where it cannot drive back either, it turns as far as it can.
    let pocket = |at: DVec2| if at.x < -0.9 || at.x > 0.3 { BLOCKED } else { strip(at) };
    assert_eq!(motion(0.65, &pocket), Motion::TurnLeft);
}

#[test]
fn a_nose_stops_before_a_wall_and_does_not_swing_into_one() {
    let free_m = |nose_m: f64, arc: Arc, cost: &dyn Fn(DVec2) -> u8| {
        scored_by(&Rules { nose_m, ..RULES }, 0.0, cost, arc).free_m
    };
    let wall = |at: DVec2| if at.x > 2.0 { BLOCKED } else { 10 };
    let ahead = Arc { motion: Motion::Forward, curvature_per_m: 0.0 };
    let [middle_m, nose_m] = [0.0, 1.0].map(|nose_m| free_m(nose_m, ahead, &wall));
    assert!((middle_m - nose_m - 1.0).abs() < 0.11 && nose_m > 0.8, "{middle_m} {nose_m}");
    // Backward, a bend to the left swings the nose to the right.
    let beside = |at: DVec2| if at.x > -0.2 && at.y < -0.1 { BLOCKED } else { 10 };
    let back = Arc { motion: Motion::Backward, curvature_per_m: 0.75 };
    assert_eq!(free_m(0.0, back, &beside), 1.0);
    assert!(free_m(1.0, back, &beside) < 0.5, "{}", free_m(1.0, back, &beside));
    // Walls 0.5 m to either side, between which a turn on the spot does not fit.
    let strip = |at: DVec2| if at.y.abs() > 0.5 { BLOCKED } else { 10 };
    let motion = |nose_m: f64| {
        let rules = Rules { tail_m: 0.45, nose_m, ..RULES };
        chosen_by(&rules, strip, 0.0, DVec2::new(-4.0, 0.1)).unwrap().arc.motion
    };
    assert_eq!(
        [motion(0.0), motion(0.45), motion(0.65)],
        [Motion::TurnLeft, Motion::TurnLeft, Motion::Backward]
    );
}

#[test]
fn a_vehicle_that_steers_has_no_turn_on_the_spot_in_its_list() {
    let arcs = list(&Rules { turns_on_the_spot: false, ..RULES });
    assert_eq!(arcs.len() + 2, list(&RULES).len());
    assert!(arcs.iter().all(|arc| matches!(arc.motion, Motion::Forward | Motion::Backward)));
}

#[test]
fn it_bends_around_an_obstacle() {
    let ahead =
        |at: DVec2| if (at.x - 2.0).abs() < 0.4 && (-2.0..0.5).contains(&at.y) { BLOCKED } else { 10 };
    let arc = chosen(ahead, 0.0, DVec2::new(4.0, 0.0)).unwrap();
    assert!(arc.arc.curvature_per_m > 0.1, "{arc:?}");
    assert!(arc.mean_cost < 0.2 && arc.free_m > 1.9, "{arc:?}");
}

#[test]
fn of_two_ways_it_takes_the_cheaper_ground() {
    let right_is_dear = |at: DVec2| if at.y < 0.5 && at.x > 0.8 { 200 } else { 10 };
    let arc = chosen(right_is_dear, 0.3, DVec2::new(3.0, 0.9)).unwrap().arc;
    assert!(arc.motion == Motion::Forward && arc.curvature_per_m >= 0.0, "{arc:?}");
}

#[test]
fn before_a_wall_it_goes_back_and_without_any_way_nowhere() {
    let wall = |at: DVec2| if at.x > 0.3 || (at.x > -1.5 && at.y.abs() > 0.3) { BLOCKED } else { 10 };
    assert_eq!(chosen(wall, 0.0, DVec2::new(4.0, 0.0)).unwrap().arc.motion, Motion::Backward);
    assert_eq!(chosen(|_| BLOCKED, 0.0, DVec2::new(4.0, 0.0)).map(|arc| arc.open), None);
}

#[test]
fn before_a_wall_that_hides_its_target_it_goes_back_and_does_not_turn_past_it() {
    let wall = |at: DVec2| if (0.4..0.8).contains(&at.x) { BLOCKED } else { 10 };
    for yaw_rad in [0.0, 0.1, -0.1] {
        let arc = chosen(wall, yaw_rad, DVec2::new(4.0, 0.0)).unwrap().arc;
        assert_eq!(arc.motion, Motion::Backward, "{yaw_rad}");
    }
    let arc = chosen(wall, 0.5, DVec2::new(4.0, 0.0)).unwrap().arc;
    assert_eq!(arc.motion, Motion::TurnRight);
}

#[test]
fn driving_back_it_keeps_its_tail_free() {
    // The tail is 0.5 m behind the origin.
    let free_m = |wall_m: f64| {
        let back = Arc { motion: Motion::Backward, curvature_per_m: 0.0 };
        let scored = scored(|at| if at.x < -wall_m { BLOCKED } else { 10 }, back);
        (scored.free_m, scored.open)
    };
    assert_eq!(free_m(2.0), (1.0, true));
    let (free, open) = free_m(0.9);
    assert!((0.2..0.45).contains(&free) && !open, "{free} {open}");
}

#[test]
fn in_a_bend_back_it_keeps_a_cell_beside_its_tail_free_and_may_bend_away_from_a_wall() {
    let back = |curvature_per_m: f64| Arc { motion: Motion::Backward, curvature_per_m };
    // A wall on its left begins 0.2 m behind the tail. Backward, a curvature to the left leads the tail to the left.
    let free_m = |wall_m: f64, curvature_per_m: f64| {
        scored(|at| if at.x < -0.7 && at.y > wall_m { BLOCKED } else { 10 }, back(curvature_per_m)).free_m
    };
    assert_eq!(free_m(0.1, 0.0), 1.0, "straight, it follows the ground that it came over");
    assert_eq!(free_m(1.2, 0.75), 1.0, "the wall is far away");
    assert!(free_m(0.3, 0.75) < 0.5, "{}", free_m(0.3, 0.75));
    assert!(free_m(0.1, -0.75) < 0.5, "{}", free_m(0.1, -0.75));
    // Beside a wall that begins before the tail, it bends away.
    let beside = scored(|at| if at.y > 0.1 { BLOCKED } else { 10 }, back(-0.75));
    assert!(beside.open, "{beside:?}");
}

#[test]
fn in_a_bend_it_keeps_its_tail_free_and_one_that_is_in_a_wall_can_be_driven_out() {
    // A wall on its right, which its tail swings towards in a bend to the left.
    let free_m = |wall_m: f64, curvature_per_m: f64| {
        let bend = Arc { motion: Motion::Forward, curvature_per_m };
        scored(|at| if at.y < -wall_m { BLOCKED } else { 10 }, bend).free_m
    };
    assert!(free_m(0.5, 1.5) > 2.0, "far from the wall");
    assert!(free_m(0.05, 0.2) > 2.0, "a wide bend");
    assert!(free_m(0.05, 1.5) < 0.5, "a tight one");
    // Close to the wall, a bend of 2 m radius is tight enough: the tail swings by 0.06 m.
    let bend = |curvature_per_m: f64| Arc { motion: Motion::Forward, curvature_per_m };
    let beside = |bend: Arc| scored_at(-0.06, |at| if at.y < -0.05 { BLOCKED } else { 10 }, bend).free_m;
    assert!(beside(bend(0.5)) < 0.5, "{}", beside(bend(0.5)));
    assert!(beside(bend(0.2)) > 2.0, "a wide bend");
    let in_a_wall = |at: DVec2| if at.x < -0.3 { BLOCKED } else { 10 };
    assert!(chosen(in_a_wall, 0.0, DVec2::new(3.0, 1.5)).unwrap().free_m > 2.9);
}

#[test]
fn a_vehicle_in_a_blocked_cell_can_leave_it() {
    let arc = chosen(|at| if at.length() < 0.35 { BLOCKED } else { 10 }, 0.0, DVec2::new(4.0, 0.0)).unwrap();
    assert!(arc.arc.motion == Motion::Forward && arc.free_m > 2.9, "{arc:?}");
}

#[test]
fn poses_along_arcs_are_those_of_small_steps() {
    let start = (DVec2::new(1.0, 2.0), 0.7);
    for arc in list(&RULES) {
        let (mut position, mut yaw) = start;
        let (sign, turns) = match arc.motion {
            Motion::Forward => (1.0, 1.0),
            Motion::Backward => (-1.0, -1.0),
            Motion::TurnLeft | Motion::TurnRight => continue,
        };
        for _ in 0..20_000 {
            yaw += turns * arc.curvature_per_m * 0.5e-4;
            position += DVec2::new(libm::cos(yaw), libm::sin(yaw)) * sign * 1e-4;
            yaw += turns * arc.curvature_per_m * 0.5e-4;
        }
        let (end, heading) = pose_at(start, arc, 2.0);
        assert!(end.distance(position) < 1e-6 && wrap_angle(heading - yaw).abs() < 1e-6, "{arc:?}");
    }
}
