//! The mission that is drawn on the map, compared with what was sent and with the viewed moment.

use super::behaviour::map_of_a_vehicle_at;
use super::plans::{click, map_after_a_zone_in, sent, shown};
use super::{Shown, harness};
use crate::samples;
use egui::PointerButton::{Primary, Secondary};
use egui::{Pos2, Rect, Shape, Theme, Vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::{NodeT as _, Queryable as _};
use ocu_ui::icons;
use rcs_msg::foxglove::{Pose, PoseInFrame, Vector3};
use rcs_msg::rcs::{Mission, PlanePoint};
use rcs_runtime::source::Topic;
use std::sync::Arc;

fn middle(map: &Harness<'static, Shown>) -> Pos2 {
    map.get_by_label("Map").rect().center()
}

/// Presses a button with this text.
fn press(map: &mut Harness<'static, Shown>, text: &str) {
    map.get_by_label_contains(text).click();
    map.run();
}

/// Whether the panel of the mission says this.
fn says(map: &Harness<'static, Shown>, text: &str) -> bool {
    map.query_by_label_contains(text).is_some()
}

/// A map with the goal that the vehicle has left, and another one that was drawn.
fn with_a_goal_drawn() -> Harness<'static, Shown> {
    let mut map = shown("map");
    press(&mut map, "Draw a mission");
    let at = middle(&map) + Vec2::new(40.0, 60.0);
    click(&mut map, at, Primary);
    assert!(says(&map, "2 goals, 0 keep-out zones: not sent"));
    map
}

#[test]
fn a_mission_whose_sending_was_taken_back_is_not_sent_and_can_be_sent_again() {
    let mut map = with_a_goal_drawn();
    press(&mut map, "Send");
    let before = map.state().frame.clone();
    let mission = sent(&mut map).remove(0);
    let newest = samples::topic("/operator/mission", 0.1, 0.0, mission);
    map.state_mut().frame.topics = before.topics.iter().cloned().chain([newest]).collect();
    map.run();
    assert!(says(&map, "2 goals, 0 keep-out zones: as sent"));
    map.state_mut().frame = before;
    map.run();
    assert!(says(&map, "2 goals, 0 keep-out zones: not sent"));
    press(&mut map, "Send");
    let missions = sent(&mut map);
    assert_eq!((missions[0].goals.len(), missions[0].keeps_goals), (2, false));
}

#[test]
fn a_goal_by_a_click_sends_nothing_of_the_mission_that_is_being_drawn_and_leaves_it() {
    let mut map = map_after_a_zone_in("local");
    press(&mut map, "Draw a mission");
    press(&mut map, icons::ICON_DELETE.codepoint);
    let middle = middle(&map);
    click(&mut map, middle + Vec2::new(40.0, 60.0), Primary);
    click(&mut map, middle + Vec2::new(-80.0, 100.0), Secondary);
    press(&mut map, "Drive here");
    let missions = sent(&mut map);
    let [mission] = missions.as_slice() else { panic!("{missions:?}") };
    assert_eq!((mission.goals.len(), mission.keep_out.len(), mission.keeps_goals), (1, 1, false));
    assert!(says(&map, "1 goal, 0 keep-out zones: not sent"), "the zone was deleted in the drawing alone");
}

#[test]
fn a_mission_that_was_closed_with_changes_is_opened_again_until_another_one_is_closed() {
    let mut map = with_a_goal_drawn();
    let drawn = "2 goals, 0 keep-out zones: not sent";
    for closes in ["Close", "Draw a mission"] {
        press(&mut map, closes);
        assert!(!says(&map, drawn), "{closes}");
        press(&mut map, "Draw a mission");
        assert!(says(&map, drawn), "{closes}");
    }
    // The menu begins with what was sent.
    press(&mut map, "Close");
    let at = middle(&map);
    click(&mut map, at, Secondary);
    press(&mut map, "Edit the mission");
    let as_sent = "1 goal, 0 keep-out zones: as sent";
    assert!(says(&map, as_sent));
    press(&mut map, "Close");
    press(&mut map, "Draw a mission");
    assert!(says(&map, as_sent));
}

#[test]
fn a_mission_that_was_closed_on_its_way_is_awaited_and_is_opened_again_where_it_is_lost() {
    let mut map = with_a_goal_drawn();
    press(&mut map, "Send");
    press(&mut map, "Close");
    let at = middle(&map);
    click(&mut map, at, Secondary);
    let is_refused =
        |map: &Harness<'_, Shown>| map.get_by_label_contains("Drive here").accesskit_node().is_disabled();
    assert!(is_refused(&map), "the zones that were sent are not known yet");
    // Passes are a quarter of a second apart.
    map.run_steps(24);
    assert!(!is_refused(&map), "it counts as lost");
    press(&mut map, "Draw a mission");
    assert!(says(&map, "2 goals, 0 keep-out zones: not sent"));
}

#[test]
fn where_no_goals_were_sent_the_panel_says_what_the_vehicle_does_and_deleting_all_makes_it_stand() {
    let mut frame = samples::driving();
    let is_kept = |name: &str| name != "/generator/driven";
    frame.topics = frame.topics.iter().filter(|topic| is_kept(&topic.name)).cloned().collect();
    let mut map = harness(Shown::new("map", frame), Vec2::new(900.0, 760.0), Theme::Dark);
    map.run();
    press(&mut map, "Draw a mission");
    assert!(says(&map, "0 goals, 0 keep-out zones: nothing sent, the vehicle keeps its goal"));
    press(&mut map, icons::ICON_DELETE.codepoint);
    assert!(says(&map, "0 goals, 0 keep-out zones: not sent, without goals the vehicle stands"));
    press(&mut map, "Send");
    let missions = sent(&mut map);
    assert!(missions[0].goals.is_empty() && !missions[0].keeps_goals);
}

#[test]
fn the_keys_of_undo_and_redo_are_for_the_mission_under_the_pointer() {
    let undo = |map: &mut Harness<'static, Shown>| {
        let is_done = map.state_mut().selection.undo_under_pointer();
        map.run();
        is_done
    };
    let mut map = with_a_goal_drawn();
    assert!(undo(&mut map) && says(&map, "1 goal, 0 keep-out zones: as sent"));
    assert!(!undo(&mut map), "there is no other change");
    assert!(map.state_mut().selection.redo_under_pointer());
    map.run();
    assert!(says(&map, "2 goals, 0 keep-out zones: not sent"));
    assert!(!map.state_mut().selection.redo_under_pointer(), "all was done again");
    assert!(undo(&mut map));
    let at = middle(&map) + Vec2::new(40.0, 60.0);
    click(&mut map, at, Primary);
    map.hover_at(Pos2::new(at.x, 4.0));
    map.run();
    assert!(!undo(&mut map) && says(&map, "2 goals, 0 keep-out zones: not sent"), "the pointer is elsewhere");
}

/// A topic with a role.
fn with_role(mut topic: Topic, role: &str) -> Topic {
    topic.metadata = Arc::new([("rcs.role".to_owned(), role.to_owned())].into());
    topic
}

/// The middle of a circle of this radius.
fn circle(shape: &Shape, radius: f32) -> Option<Pos2> {
    match shape {
        Shape::Circle(circle) if circle.radius == radius => Some(circle.center),
        _ => None,
    }
}

#[test]
fn a_vehicle_on_a_goal_is_seen_and_the_number_of_the_goal_is_beside_it() {
    for (reached, draws, radius) in [(0, false, 9.0), (1, false, 5.0), (0, true, 9.0)] {
        let mut map = map_of_a_vehicle_at([1.0, 2.0], 0.5);
        let goals = vec![PlanePoint { x_m: 1.0, y_m: 2.0 }];
        let mission = Mission { frame_id: "local".to_owned(), goals, reached, ..Mission::default() };
        let mission = with_role(samples::topic("/generator/driven", 0.1, 5.0, mission), "mission");
        let topics = map.state().frame.topics.clone();
        let others = topics.iter().filter(|topic| topic.name != mission.name).cloned();
        map.state_mut().frame.topics = others.chain([mission.clone()]).collect();
        map.run();
        if draws {
            press(&mut map, "Draw a mission");
        }
        let shapes = &map.output().shapes;
        let disc = shapes.iter().rposition(|painted| circle(&painted.shape, radius).is_some()).unwrap();
        let center = circle(&shapes[disc].shape, radius).unwrap();
        // The edge of its arrow.
        let mark = |shape: &Shape| match shape {
            Shape::Path(path) if path.closed && path.points.len() == 4 => {
                let place = Rect::from_points(&path.points);
                (place.width() < 30.0 && place.contains(center)).then_some(place)
            }
            _ => None,
        };
        let vehicle = shapes.iter().rposition(|painted| mark(&painted.shape).is_some()).unwrap();
        assert!(disc < vehicle, "{disc} {vehicle}");
        let place = mark(&shapes[vehicle].shape).unwrap();
        let number = |shape: &Shape| match shape {
            Shape::Text(text) if text.galley.text() == "1" => Some(shape.visual_bounding_rect()),
            _ => None,
        };
        let number = shapes.iter().find_map(|painted| number(&painted.shape)).unwrap();
        assert!(!number.intersects(place) && number.distance_to_pos(center) < 80.0, "{number} {place}");
    }
}

#[test]
fn the_disc_of_a_goal_with_its_number_lies_above_the_flag_at_its_place() {
    let mut frame = samples::driving();
    let goals = vec![PlanePoint { x_m: 1.0, y_m: 1.0 }];
    let mission = Mission { frame_id: "local".to_owned(), goals, ..Mission::default() };
    let position = Some(Vector3 { x: 1.0, y: 1.0, z: 0.0 });
    let pose = Some(Pose { position, orientation: None });
    let goal = PoseInFrame { frame_id: "local".to_owned(), pose, ..PoseInFrame::default() };
    let is_other = |topic: &&Topic| !["/generator/driven", "/vehicle/goal"].contains(&&*topic.name);
    let others = frame.topics.iter().filter(is_other).cloned();
    let mission = with_role(samples::topic("/generator/driven", 0.1, 5.0, mission), "mission");
    let goal = with_role(samples::topic("/vehicle/goal", 1.0, 0.3, goal), "goal");
    frame.topics = others.chain([mission, goal]).collect();
    let mut map = harness(Shown::new("map", frame), Vec2::new(900.0, 760.0), Theme::Dark);
    map.run();
    let shapes = &map.output().shapes;
    let disc = shapes.iter().rposition(|painted| circle(&painted.shape, 9.0).is_some()).unwrap();
    let center = circle(&shapes[disc].shape, 9.0).unwrap();
    let is_foot = |shape: &Shape| circle(shape, 3.0).is_some_and(|foot| foot.distance(center) < 0.5);
    let foot = shapes.iter().rposition(|painted| is_foot(&painted.shape)).unwrap();
    assert!(foot < disc, "{foot} {disc}");
}

#[test]
fn the_panel_says_that_a_drawn_zone_encloses_the_vehicle() {
    let mut map = map_of_a_vehicle_at([1.0, 2.0], 0.5);
    // It is in the middle of the map.
    press(&mut map, "Follow the vehicle");
    press(&mut map, "Draw a mission");
    press(&mut map, "Keep-out zones");
    let warning = "the vehicle stands in a keep-out zone";
    assert!(!says(&map, warning));
    let vehicle = middle(&map);
    for corner in [[-60.0, -60.0], [60.0, -60.0], [0.0, 60.0], [-60.0, -60.0]] {
        click(&mut map, vehicle + Vec2::from(corner), Primary);
    }
    assert!(says(&map, warning));
}

#[test]
fn the_legend_of_a_map_is_folded_and_unfolded() {
    let mut map = shown("map");
    let is_unfolded = |map: &Harness<'_, Shown>| map.query_by_label("Fold the legend").is_some();
    assert!(is_unfolded(&map));
    map.get_by_label("Fold the legend").click();
    map.run();
    assert!(!is_unfolded(&map));
    assert_eq!(map.state().view.save()["legend"], false);
    map.get_by_label("Unfold the legend").click();
    map.run();
    assert!(is_unfolded(&map));
}
