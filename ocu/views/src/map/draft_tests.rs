//! Tests of the draft of a mission.

use super::*;

/// Length of a screen point: a goal has a radius of 0.45 m, and a corner is meant within 0.5 m.
const M_PER_POINT: f64 = 0.05;
const A: [f64; 2] = [1.0, 0.0];
const B: [f64; 2] = [2.0, 0.0];
const C: [f64; 2] = [3.0, 0.0];

fn mission(goals: &[[f64; 2]], reached: u32) -> Mission {
    let goals = goals.iter().map(|&[x_m, y_m]| PlanePoint { x_m, y_m }).collect();
    Mission { frame_id: "local".to_owned(), goals, reached, ..Mission::default() }
}

/// A draft of what a vehicle has left of a mission.
fn draft_of(mission: &Mission) -> Draft {
    Draft::new(Bounds::default(), None, Some((mission, Pose::IDENTITY)))
}

/// A draft where nothing was sent.
fn draft_of_nothing() -> Draft {
    Draft::new(Bounds::default(), None, None)
}

fn goals(draft: &Draft) -> Vec<[f64; 2]> {
    draft.goals().map(|goal| goal.at).collect()
}

fn sent(draft: &mut Draft) -> Mission {
    let sent = draft.message("local", &Pose::IDENTITY);
    draft.sent(&sent, 0.0);
    sent
}

/// A moment at which what was sent is the operator's newest mission, and the vehicle obeys this one.
fn follow(draft: &mut Draft, obeyed: &Mission) {
    let newest = draft.sent.message.clone();
    draft.follow(newest.as_ref(), Some(obeyed), 0.0);
}

fn drag(draft: &mut Draft, from: [f64; 2], to: [f64; 2]) {
    draft.grab(from, M_PER_POINT);
    draft.drag_to(to);
    draft.release();
}

/// Deletes the goal at a place.
fn delete(draft: &mut Draft, at: [f64; 2]) {
    let (id, _) = draft.goal_at(at, M_PER_POINT).unwrap();
    draft.delete_goal(id);
}

/// A draft with one goal and a closed square of 4 m.
fn with_a_zone() -> Draft {
    let mut draft = draft_of(&mission(&[[9.0, 0.0]], 0));
    draft.adds = Adds::Zone;
    for corner in [[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0], [0.0, 0.0]] {
        draft.click(corner, M_PER_POINT);
    }
    assert_eq!(draft.summary(), "1 goal, 1 keep-out zone");
    draft
}

#[test]
fn clicks_add_goals_and_corners_and_the_first_corner_closes_the_zone() {
    let mut draft = Draft::default();
    draft.click([1.0, 2.0], M_PER_POINT);
    draft.adds = Adds::Zone;
    for corner in [[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [9.0, 9.0]] {
        draft.click(corner, M_PER_POINT);
    }
    assert!(draft.undo());
    draft.click([0.2, 0.2], M_PER_POINT);
    assert_eq!((draft.summary().as_str(), draft.corners().len()), ("1 goal, 1 keep-out zone", 0));
    let pose = Pose::from_xy_yaw(10.0, 0.0, 0.0);
    let message = draft.message("global", &pose);
    assert_eq!((message.goals[0].x_m, message.keep_out[0].points.len()), (11.0, 3));
}

#[test]
fn a_goal_in_a_zone_or_outside_of_the_area_is_told_with_its_number() {
    let mut draft = with_a_zone();
    let nothing = Bounds::default();
    assert_eq!(draft.goal_warning(&nothing), None);
    let zone = vec![[8.0, -1.0], [10.0, -1.0], [10.0, 1.0], [8.0, 1.0]];
    let standing = Bounds { area: None, keep_out: vec![zone] };
    assert_eq!(draft.goal_warning(&standing).as_deref(), Some("goal 1 lies in a keep-out zone"));
    draft.adds = Adds::Goal;
    draft.click([2.0, 2.0], M_PER_POINT);
    assert_eq!(draft.goal_warning(&nothing).as_deref(), Some("goal 2 lies in a keep-out zone"));
    let area = Some(vec![[-1.0, -1.0], [6.0, -1.0], [6.0, 6.0], [-1.0, 6.0]]);
    let told = Some("goal 1 lies outside of the area");
    let standing = Bounds { area: area.clone(), keep_out: Vec::new() };
    assert_eq!(draft.goal_warning(&standing).as_deref(), told);
    draft.area = area;
    assert_eq!(draft.goal_warning(&nothing).as_deref(), told);
}

#[test]
fn a_click_on_a_goal_adds_nothing_and_the_first_corner_closes_a_zone_also_beside_a_goal() {
    let mut draft = draft_of(&mission(&[A], 0));
    draft.click([1.4, 0.0], M_PER_POINT);
    assert!(goals(&draft) == [A] && draft.is_as_sent());
    draft.adds = Adds::Zone;
    draft.click(A, M_PER_POINT);
    assert!(draft.corners().is_empty() && draft.is_as_sent());
    for corner in [[1.5, 0.0], [4.0, 0.0], [4.0, 4.0], [1.4, 0.0]] {
        draft.click(corner, M_PER_POINT);
    }
    assert_eq!(draft.summary(), "1 goal, 1 keep-out zone");
    draft.click([1.5, 0.6], M_PER_POINT);
    draft.click([1.5, 0.6], M_PER_POINT);
    assert!(draft.corners().len() == 1 && draft.undo() && draft.corners().is_empty(), "one change");
}

#[test]
fn a_click_on_the_first_corner_closes_a_zone_also_while_clicks_add_goals() {
    let mut draft = draft_of_nothing();
    draft.adds = Adds::Zone;
    for corner in [[0.0, 0.0], [4.0, 0.0], [4.0, 4.0]] {
        draft.click(corner, M_PER_POINT);
    }
    draft.adds = Adds::Goal;
    draft.click([0.2, 0.2], M_PER_POINT);
    assert_eq!((draft.summary().as_str(), draft.corners().len()), ("0 goals, 1 keep-out zone", 0));
    draft.click([0.2, 0.2], M_PER_POINT);
    assert_eq!(draft.summary(), "1 goal, 1 keep-out zone");
}

#[test]
fn goals_that_are_as_they_were_leave_the_vehicle_its_own() {
    let mut none = draft_of_nothing();
    none.click([1.0, 2.0], M_PER_POINT);
    assert!(!none.keeps_goals() && none.undo() && none.keeps_goals(), "a goal was taken back");
    assert!(sent(&mut none).keeps_goals);
    let mut draft = draft_of(&mission(&[A], 0));
    draft.clear();
    assert!(!sent(&mut draft).keeps_goals, "the goal was deleted");
    draft.click([4.0, 4.0], M_PER_POINT);
    assert!(!sent(&mut draft).keeps_goals && sent(&mut draft).keeps_goals);
    drag(&mut draft, [4.0, 4.0], [5.0, 4.0]);
    assert!(!draft.keeps_goals() && draft.undo() && draft.keeps_goals(), "a goal was moved and moved back");
    assert!(!sent(&mut draft.with_only_goal([4.0, 4.0])).keeps_goals);
}

#[test]
fn where_all_was_deleted_the_vehicle_is_told_to_stand_also_if_it_drives_to_a_goal_of_its_own() {
    let mut draft = draft_of_nothing();
    assert_eq!((draft.status(), draft.without_goals()), ("nothing sent", Some("the vehicle keeps its goal")));
    draft.click(A, M_PER_POINT);
    draft.clear();
    let stands = ("not sent", Some("without goals the vehicle stands"));
    assert_eq!((draft.status(), draft.without_goals()), stands);
    let message = sent(&mut draft);
    assert!(message.goals.is_empty() && !message.keeps_goals);
    assert_eq!((draft.status(), draft.without_goals()), ("as sent", stands.1));
    // It stands also after a zone was sent, and a draft that begins then says so.
    draft.adds = Adds::Zone;
    for corner in [[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 0.0]] {
        draft.click(corner, M_PER_POINT);
    }
    let message = sent(&mut draft);
    assert_eq!((message.keep_out.len(), message.keeps_goals), (1, false));
    let begun = Draft::new(Bounds::default(), Some(&message), Some((&mission(&[], 0), Pose::IDENTITY)));
    assert_eq!((begun.status(), begun.without_goals()), ("as sent", stands.1));
}

#[test]
fn a_draft_that_was_replaced_states_its_goals_once() {
    let mut draft = draft_of(&mission(&[A], 0));
    let other = mission(&[B], 0);
    draft.follow(Some(&other), Some(&other), 0.0);
    assert!(!draft.is_as_sent() && !sent(&mut draft).keeps_goals);
    assert!(draft.is_as_sent() && draft.keeps_goals());
}

#[test]
fn what_was_reached_stays_reached_when_another_mission_takes_the_place_of_a_draft() {
    let at = |second: u64, mission: Mission| {
        let timestamp = Some(Stamp(second * 1_000_000_000).to_proto());
        Mission { timestamp, ..mission }
    };
    let [ours, other] = [at(1, mission(&[A, B], 0)), at(9, mission(&[[90.0, 0.0]], 0))];
    let mut draft = Draft::new(Bounds::default(), Some(&ours), Some((&ours, Pose::IDENTITY)));
    draft.follow(Some(&ours), Some(&mission(&[A, B], 1)), 0.0);
    draft.click([50.0, 0.0], M_PER_POINT);
    draft.follow(Some(&other), Some(&other), 0.0);
    assert_eq!(goals(&draft), [B, [50.0, 0.0]]);
    draft.follow(Some(&ours), Some(&ours), 0.0);
    assert_eq!(goals(&draft), [A, B, [50.0, 0.0]], "at a moment before it was reached");
}

#[test]
fn a_draft_is_as_sent_only_at_a_moment_that_has_its_message_or_awaits_it() {
    let mut draft = draft_of_nothing();
    draft.click(A, M_PER_POINT);
    let message = sent(&mut draft);
    // On its way.
    draft.follow(None, None, ON_ITS_WAY_S);
    assert!(draft.is_as_sent() && draft.is_on_its_way());
    draft.follow(Some(&message), None, ON_ITS_WAY_S);
    assert!(draft.is_as_sent() && !draft.is_on_its_way() && draft.keeps_goals());
    // Before it was sent, or in a run without it.
    draft.follow(None, None, ON_ITS_WAY_S);
    assert!(!draft.is_as_sent() && !draft.keeps_goals() && goals(&draft) == [A]);
    draft.follow(Some(&message), Some(&message), ON_ITS_WAY_S);
    assert!(draft.is_as_sent() && draft.keeps_goals(), "looked at again");
    // One that is lost.
    draft.click(B, M_PER_POINT);
    sent(&mut draft);
    draft.follow(Some(&message), Some(&message), ON_ITS_WAY_S + 1.0);
    assert!(!draft.is_as_sent() && !draft.is_on_its_way() && goals(&draft) == [A, B]);
}

#[test]
fn at_a_moment_before_a_goal_was_reached_it_is_left() {
    let all = |reached| mission(&[A, B], reached);
    let mut draft = draft_of_nothing();
    draft.click(A, M_PER_POINT);
    draft.click(B, M_PER_POINT);
    sent(&mut draft);
    let moments: [(u32, &[[f64; 2]]); 5] = [(0, &[A, B]), (1, &[B]), (0, &[A, B]), (2, &[]), (1, &[B])];
    for (reached, left) in moments {
        follow(&mut draft, &all(reached));
        assert_eq!(goals(&draft), left, "{reached} reached");
        assert!(draft.is_as_sent() && draft.keeps_goals(), "{reached} reached");
    }
    drag(&mut draft, B, C);
    follow(&mut draft, &all(0));
    assert!(goals(&draft) == [A, C] && draft.undo() && draft.is_as_sent() && goals(&draft) == [A, B]);
    // One that began after the first goal was reached.
    let mut begun = draft_of(&all(1));
    follow(&mut begun, &all(0));
    assert!(goals(&begun) == [A, B] && begun.is_as_sent() && begun.keeps_goals());
}

#[test]
fn a_change_that_is_taken_back_leaves_the_draft_as_sent() {
    let mut draft = draft_of_nothing();
    draft.click(A, M_PER_POINT);
    draft.click(B, M_PER_POINT);
    sent(&mut draft);
    drag(&mut draft, A, C);
    assert!(!draft.is_as_sent() && draft.undo() && draft.is_as_sent());
    assert!(draft.undo() && !draft.is_as_sent(), "a goal that was sent is not drawn");
}

#[test]
fn a_goal_that_was_reached_is_not_sent_again() {
    let old = mission(&[[8.0, 8.0], [9.0, 9.0]], 0);
    let mut draft = draft_of(&old);
    draft.clear();
    draft.click(A, M_PER_POINT);
    draft.click(B, M_PER_POINT);
    sent(&mut draft);
    follow(&mut draft, &Mission { reached: 1, ..old });
    assert_eq!(goals(&draft), [A, B], "a goal of the mission before was reached");
    follow(&mut draft, &mission(&[[1.001, 0.0], B], 1));
    assert!(goals(&draft) == [B] && draft.keeps_goals());
    follow(&mut draft, &mission(&[A, B], 1));
    draft.click(C, M_PER_POINT);
    assert_eq!(goals(&draft), [B, C], "it is left out once");
    assert_eq!(sent(&mut draft).goals.len(), 2);
    // What the operator has drawn in place of the goals stays.
    draft.clear();
    draft.click(C, M_PER_POINT);
    follow(&mut draft, &mission(&[B, C], 1));
    assert_eq!((goals(&draft), draft.reached().len()), (vec![C], 1));
}

#[test]
fn a_goal_keeps_its_number_when_another_one_is_reached_as_the_vehicle_counts() {
    let all = |reached| mission(&[A, B, C], reached);
    let numbers = |draft: &Draft| -> Vec<usize> { draft.numbers().map(|(number, _)| number).collect() };
    let mut draft = draft_of(&all(1));
    assert_eq!(numbers(&draft), [2, 3]);
    draft.click([50.0, 0.0], M_PER_POINT);
    follow(&mut draft, &all(2));
    assert_eq!(numbers(&draft), [3, 4]);
    assert_eq!(draft.goal_at(C, M_PER_POINT).map(|(_, number)| number), Some(3));
    let standing = Bounds { keep_out: vec![vec![[49.0, -1.0], [51.0, -1.0], [50.0, 2.0]]], area: None };
    assert_eq!(draft.goal_warning(&standing).as_deref(), Some("goal 4 lies in a keep-out zone"));
    // The vehicle counts the goals of another mission anew.
    sent(&mut draft);
    assert_eq!(numbers(&draft), [1, 2]);
}

#[test]
fn a_drag_moves_the_goal_under_the_pointer_by_as_much_as_the_pointer() {
    let mut draft = draft_of(&mission(&[A, B, C], 0));
    draft.grab([2.25, 0.25], M_PER_POINT);
    assert_eq!(draft.dragged(), draft.handle_at(B, M_PER_POINT));
    draft.drag_to([2.25, 0.25]);
    assert!(draft.is_as_sent() && draft.keeps_goals(), "it was not moved yet");
    draft.drag_to([2.25, 3.25]);
    draft.drag_to([5.25, 1.25]);
    draft.release();
    draft.drag_to([7.0, 7.0]);
    assert!(goals(&draft) == [A, [5.0, 1.0], C] && !draft.is_as_sent() && !draft.keeps_goals());
    assert!(draft.undo() && goals(&draft) == [A, B, C] && !draft.undo(), "a drag is one change");
    draft.grab([2.0, 3.0], M_PER_POINT);
    assert_eq!(draft.dragged(), None);
}

#[test]
fn of_two_points_the_nearest_is_dragged_and_at_one_place_the_upper_one() {
    let mut draft = draft_of(&mission(&[A, A, [1.5, 0.0]], 0));
    assert_eq!(draft.handle_at([1.2, 0.0], M_PER_POINT), Some(Handle::Goal(1)));
    assert_eq!(draft.handle_at([1.3, 0.0], M_PER_POINT), Some(Handle::Goal(2)));
    assert_eq!(draft.goal_at([1.2, 0.0], M_PER_POINT), Some((1, 2)));
    drag(&mut draft, [1.2, 0.0], [1.2, 5.0]);
    assert_eq!(goals(&draft), [A, [1.0, 5.0], [1.5, 0.0]]);
}

#[test]
fn corners_of_a_zone_that_is_closed_and_of_one_that_is_drawn_can_be_dragged() {
    let mut draft = with_a_zone();
    drag(&mut draft, [4.25, 4.0], [6.25, 5.0]);
    assert_eq!(draft.drawn.keep_out[0], [[0.0, 0.0], [4.0, 0.0], [6.0, 5.0], [0.0, 4.0]]);
    draft.click([7.0, 7.0], M_PER_POINT);
    drag(&mut draft, [7.0, 7.25], [8.0, 7.25]);
    assert_eq!(draft.corners(), [[8.0, 7.0]]);
    assert!(draft.undo() && draft.corners() == [[7.0, 7.0]]);
    assert!(draft.undo() && draft.corners().is_empty());
    assert!(draft.undo() && draft.drawn.keep_out[0][2] == [4.0, 4.0] && draft.keeps_goals());
}

#[test]
fn one_goal_or_one_zone_is_deleted_and_the_others_stay() {
    let mut draft = draft_of(&mission(&[A, B, C], 0));
    delete(&mut draft, B);
    assert_eq!(goals(&draft), [A, C]);
    assert!(!draft.keeps_goals() && draft.undo() && draft.keeps_goals());
    assert_eq!(draft.goal_at([2.0, 0.5], M_PER_POINT), None);

    let mut draft = with_a_zone();
    for corner in [[6.0, 6.0], [8.0, 6.0], [6.0, 8.0], [6.0, 6.0]] {
        draft.click(corner, M_PER_POINT);
    }
    let zone = |at| draft.zone_at(at, M_PER_POINT);
    assert_eq!([[2.0, 2.0], [4.4, 2.0], [4.6, 2.0]].map(zone), [Some(0), Some(0), None]);
    assert_eq!([[6.5, 6.5], [8.4, 6.0], [7.9, 7.9]].map(zone), [Some(1), Some(1), None]);
    draft.delete_zone(0);
    assert_eq!(
        (draft.summary().as_str(), draft.drawn.keep_out[0][1]),
        ("1 goal, 1 keep-out zone", [8.0, 6.0])
    );
    assert!(draft.undo() && draft.drawn.keep_out.len() == 2);
}

#[test]
fn every_change_is_taken_back_the_last_one_first() {
    let mut draft = with_a_zone();
    let mut states = vec![draft.drawn.clone()];
    let changes: [fn(&mut Draft); 6] = [
        |draft| draft.click([5.0, 9.0], M_PER_POINT),
        |draft| draft.adds = Adds::Goal,
        |draft| draft.click([12.0, 0.0], M_PER_POINT),
        |draft| drag(draft, [12.0, 0.0], [12.0, 3.0]),
        |draft| delete(draft, [9.0, 0.0]),
        Draft::clear,
    ];
    for change in changes {
        change(&mut draft);
        states.push(draft.drawn.clone());
    }
    states.dedup();
    assert_eq!(states.len(), 6, "to choose what a click adds is no change");
    for state in states.into_iter().rev().skip(1) {
        sent(&mut draft);
        assert!(draft.undo() && draft.drawn == state && !draft.is_as_sent());
    }
    for at in 0..2 * MOST_CHANGES {
        draft.click([at as f64, 20.0], M_PER_POINT);
    }
    assert_eq!((0..2 * MOST_CHANGES).filter(|_| draft.undo()).count(), MOST_CHANGES);
}

#[test]
fn changes_that_were_taken_back_are_done_again_until_there_is_another_one() {
    let mut draft = draft_of_nothing();
    for goal in [A, B, C] {
        draft.click(goal, M_PER_POINT);
    }
    assert!(!draft.redo());
    assert!(draft.undo() && draft.undo());
    assert_eq!(goals(&draft), [A]);
    assert!(draft.redo() && draft.redo() && !draft.redo());
    assert_eq!(goals(&draft), [A, B, C]);
    assert!(draft.undo() && draft.redo() && draft.undo());
    draft.click([9.0, 9.0], M_PER_POINT);
    assert!(!draft.redo(), "something else was drawn instead");
    assert_eq!(goals(&draft), [A, B, [9.0, 9.0]]);
    assert!(draft.undo() && draft.undo() && draft.undo() && !draft.undo());
    assert!(draft.can_undo_or_redo());
}

#[test]
fn a_zone_that_encloses_the_vehicle_is_told() {
    let draft = with_a_zone();
    let told = |vehicle| draft.warnings(&Bounds::default(), vehicle).collect::<Vec<_>>();
    assert_eq!(told(Some([2.0, 2.0])), ["the vehicle stands in a keep-out zone"]);
    assert!(told(Some([5.0, 2.0])).is_empty() && told(None).is_empty());
}

fn square(x_m: f64) -> Vec<[f64; 2]> {
    [[x_m, 0.0], [x_m + 4.0, 0.0], [x_m + 4.0, 4.0], [x_m, 4.0]].into()
}

/// A square, in a frame whose origin is at x = 100 m on the map.
fn stated(x_m: f64) -> PlanePolygon {
    let corner = |[x_m, y_m]: [f64; 2]| PlanePoint { x_m: x_m - 100.0, y_m };
    PlanePolygon { points: square(x_m).into_iter().map(corner).collect() }
}

#[test]
fn an_area_that_was_sent_is_sent_again() {
    let bounds = Bounds { area: Some(square(50.0)), keep_out: vec![square(0.0)] };
    let mut draft = Draft::new(bounds, None, None);
    draft.clear();
    draft.click(A, M_PER_POINT);
    let sent = draft.message("global", &Pose::from_xy_yaw(-100.0, 0.0, 0.0));
    assert_eq!((sent.area, sent.keep_out.len()), (Some(stated(50.0)), 0));
    assert_eq!(Draft::default().message("global", &Pose::IDENTITY).area, None, "that of a file is not sent");
}

#[test]
fn what_is_obeyed_and_not_drawn_holds_beside_the_draft() {
    let keep_out = vec![stated(0.0), stated(20.0)];
    let obeyed = Mission { area: Some(stated(50.0)), keep_out, ..mission(&[A], 0) };
    let map_from_obeyed = Pose::from_xy_yaw(100.0, 0.0, 0.0);
    let held = |draft: &Draft| {
        let held = draft.not_drawn(&obeyed, map_from_obeyed);
        assert!(held.goals.is_empty());
        (held.area, held.keep_out)
    };
    let bounds = Bounds { area: None, keep_out: vec![square(20.001)] };
    let mut draft = Draft::new(bounds, None, None);
    assert_eq!(held(&draft), (Some(stated(50.0)), vec![stated(0.0)]));
    drag(&mut draft, [20.0, 0.0], [19.0, 0.0]);
    assert_eq!(held(&draft).1.len(), 2, "the zone holds where it was until the draft is sent");
    let bounds = Bounds { area: Some(square(60.0)), keep_out: Vec::new() };
    assert_eq!(held(&Draft::new(bounds, None, None)).0, None, "the draft has an area of its own");
}

#[test]
fn a_drag_keeps_its_goal_when_another_one_is_reached() {
    let mut draft = draft_of(&mission(&[A, B, C], 0));
    draft.grab(C, M_PER_POINT);
    draft.drag_to([3.0, 1.0]);
    follow(&mut draft, &mission(&[A, B, C], 1));
    draft.drag_to([3.0, 2.0]);
    follow(&mut draft, &mission(&[A, B, C], 2));
    draft.drag_to([3.0, 3.0]);
    assert_eq!(goals(&draft), [[3.0, 3.0]]);
    draft.release();
    assert!(draft.undo() && goals(&draft) == [C] && draft.keeps_goals() && !draft.undo());
    // It is reached before it has been moved.
    draft.grab(C, M_PER_POINT);
    follow(&mut draft, &mission(&[A, B, C], 3));
    draft.drag_to([3.0, 3.0]);
    assert!(goals(&draft).is_empty() && draft.keeps_goals());
}

#[test]
fn a_goal_that_was_reached_is_left_out_whatever_was_changed_before_it() {
    let all = |reached| mission(&[A, B, A, C], reached);
    let mut draft = draft_of(&all(0));
    drag(&mut draft, A, [1.0, 5.0]);
    // The third goal is at the place of the first one, and lies above it.
    assert_eq!(goals(&draft), [A, B, [1.0, 5.0], C]);
    delete(&mut draft, A);
    follow(&mut draft, &all(2));
    assert_eq!(goals(&draft), [[1.0, 5.0], C], "the second one was reached");
    follow(&mut draft, &all(3));
    assert_eq!(goals(&draft), [[1.0, 5.0], C], "the operator has moved the third one");
    sent(&mut draft);
    follow(&mut draft, &mission(&[[1.0, 5.0], C], 1));
    assert!(goals(&draft) == [C] && draft.keeps_goals());
}

#[test]
fn undo_does_not_bring_back_what_was_reached() {
    let all = |reached| mission(&[A, B, C], reached);
    let mut draft = draft_of(&all(0));
    delete(&mut draft, A);
    follow(&mut draft, &all(1));
    assert!(draft.keeps_goals() && !draft.undo(), "the deleted goal was reached");
    drag(&mut draft, B, [2.0, 5.0]);
    follow(&mut draft, &all(2));
    assert_eq!(goals(&draft), [[2.0, 5.0], C]);
    assert!(draft.undo() && goals(&draft) == [C], "its place before was reached");
    drag(&mut draft, C, [3.0, 5.0]);
    draft.clear();
    assert!(draft.undo());
    sent(&mut draft);
    follow(&mut draft, &mission(&[[3.0, 5.0]], 1));
    assert!(goals(&draft).is_empty() && draft.undo() && goals(&draft) == [C], "it was moved from there");
}
