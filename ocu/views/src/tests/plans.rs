//! The links between the view of plans and the map, and missions and examples that are drawn on the map.

use super::{Shown, harness};
use crate::samples;
use crate::view::{Hover, HoverPoint, TopicKey, View, ViewContext, show};
use crate::views::view_type;
use egui::{Pos2, Theme, Vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::{NodeT, Queryable};
use rcs_bus::Sample;
use rcs_geom::{Pose, TransformTree};
use rcs_msg::AnyMessage;
use rcs_msg::rcs::{
    ExampleKind, Mission, Plan, PlanCandidate, PlanTerms, PlanePoint, PlanePolygon, TrainingExample,
};
use rcs_runtime::source::{Control, Frame, RunTag, Topic, WGS84};
use std::sync::Arc;

pub(super) fn shown(kind: &str) -> Harness<'static, Shown> {
    let mut harness = harness(Shown::new(kind, samples::driving()), Vec2::new(900.0, 760.0), Theme::Dark);
    harness.run();
    harness
}

#[test]
fn a_step_under_the_pointer_is_a_place_on_the_map_and_the_other_way_around() {
    let mut harness = shown("plan");
    let chart = harness.get_by_label_contains("Cost along the chosen path").rect();
    harness.hover_at(chart.center());
    harness.run();
    let hover = harness.state().selection.hovered.get().clone();
    assert_eq!(hover.topic, Some(TopicKey::shown("/planner/plan")));
    let field = hover.field.unwrap();
    assert!(field.starts_with(".chosen.steps["), "{field}");
    let point = hover.point.unwrap();
    assert_eq!(point.frame_id, "local");
    assert!((-3.0..9.0).contains(&point.position_m[0]), "{point:?}");

    // What the map says of the same place marks the same step: another picture than without.
    let plain = shown("plan").render().unwrap();
    let mut marked = shown("plan");
    let point = HoverPoint { position_m: [2.5, -0.9, f64::NAN], ..point };
    marked.state_mut().selection.hovered.set(Hover { point: Some(point.clone()), ..Hover::default() });
    marked.state_mut().selection.hovered.turn();
    marked.step();
    assert_ne!(marked.render().unwrap(), plain);
    let mut far = shown("plan");
    let point = HoverPoint { position_m: [2.5, -6.0, f64::NAN], ..point };
    far.state_mut().selection.hovered.set(Hover { point: Some(point), ..Hover::default() });
    far.state_mut().selection.hovered.turn();
    far.step();
    assert_eq!(far.render().unwrap(), plain, "5 m beside the path means none of its steps");
}

#[test]
fn an_arc_under_the_pointer_is_marked_in_both_views() {
    let mut list = shown("plan");
    let row = list.get_by_label_contains("straight: chosen").rect().center();
    list.hover_at(row);
    list.run();
    let hover = list.state().selection.hovered.get().clone();
    assert_eq!(hover.topic, Some(TopicKey::shown("/follower/arcs")));
    assert_eq!(hover.field.as_deref(), Some(".arcs[3]"));

    let mut map = shown("map");
    let plain = map.render().unwrap();
    map.state_mut().selection.hovered.set(Hover { field: Some(".arcs[5]".into()), ..hover });
    map.state_mut().selection.hovered.turn();
    map.step();
    assert_ne!(map.render().unwrap(), plain);
}

#[test]
fn every_term_of_both_paths_is_told_with_the_difference() {
    let harness = shown("plan");
    assert!(harness.query_by_label_contains("chosen, length, m 12.0").is_some());
    assert!(harness.query_by_label_contains("difference, length, m +").is_some());
    assert!(harness.query_by_label_contains("the other way costs 216 more").is_some());
}

/// The view of plans of a drive with a plan that was changed.
fn with_plan(change: impl Fn(&mut Plan)) -> Harness<'static, Shown> {
    let mut frame = samples::driving();
    let changed = |topic: &Topic| match topic.get::<Plan>() {
        Some(plan) => {
            let mut plan = plan.clone();
            change(&mut plan);
            let sample = topic.latest.clone().unwrap();
            topic.clone().with_latest(Sample { message: AnyMessage::new(plan), ..sample })
        }
        None => topic.clone(),
    };
    frame.topics = frame.topics.iter().map(changed).collect();
    let mut harness = harness(Shown::new("plan", frame), Vec2::new(900.0, 760.0), Theme::Dark);
    harness.run();
    harness
}

fn candidate(cost: f64, terms: PlanTerms) -> PlanCandidate {
    PlanCandidate { cost, terms: Some(terms), ..PlanCandidate::default() }
}

#[test]
fn the_terms_that_are_shown_add_up_to_the_cost_that_is_shown() {
    let harness = with_plan(|plan| {
        plan.chosen =
            Some(candidate(20.8, PlanTerms { terrain: 10.4, clearance: 10.4, ..PlanTerms::default() }));
        plan.rejected =
            Some(candidate(31.2, PlanTerms { terrain: 10.6, clearance: 20.6, ..PlanTerms::default() }));
    });
    for row in [
        "cost 21, terrain 10, clearance 10, rounding 1",
        "cost 31, terrain 11, clearance 21, rounding -1",
        "cost +10, terrain +0, clearance +10, rounding +0",
    ] {
        assert!(harness.query_by_label_contains(row).is_some(), "{row}");
    }
}

#[test]
fn a_term_differs_by_as_much_as_the_reason_of_the_plan_says() {
    let harness = with_plan(|plan| {
        plan.chosen =
            Some(candidate(71.4, PlanTerms { terrain: 100.0, heading: -28.6, ..PlanTerms::default() }));
        plan.rejected =
            Some(candidate(76.6, PlanTerms { terrain: 100.0, heading: -23.4, ..PlanTerms::default() }));
        // As a planner writes it.
        let more = -23.4_f32 - -28.6;
        plan.reason = format!("the other way costs 5 more: heading {more:+.0}");
    });
    for text in ["costs 5 more: heading +5", "heading -29", "heading -23", "cost +5, terrain +0, heading +5"]
    {
        assert!(harness.query_by_label_contains(text).is_some(), "{text}");
    }
}

#[test]
fn what_the_terms_lack_of_the_cost_is_told_as_rounding() {
    assert!(shown("plan").query_by_label_contains("rounding").is_none(), "they sum to it");
    let harness = with_plan(|plan| plan.rejected.as_mut().unwrap().cost -= 2.0);
    let rows = |text: &str| harness.query_all_by_label_contains(text).count();
    // The chosen path; the rejected one and the difference.
    assert_eq!((rows("rounding 0"), rows("rounding -2")), (1, 2));
}

/// The missions that were sent.
pub(super) fn sent(harness: &mut Harness<'static, Shown>) -> Vec<Mission> {
    let controls = std::mem::take(&mut harness.state_mut().controls);
    let write = |control| match control {
        Control::Write { buffer, message } if buffer == "/operator/mission" => message.to::<Mission>(),
        _ => None,
    };
    controls.into_iter().filter_map(write).collect()
}

pub(super) fn click(harness: &mut Harness<'static, Shown>, at: Pos2, button: egui::PointerButton) {
    harness.hover_at(at);
    for pressed in [true, false] {
        harness.event(egui::Event::PointerButton {
            pos: at,
            button,
            pressed,
            modifiers: egui::Modifiers::NONE,
        });
    }
    harness.run();
}

#[test]
fn a_mission_is_drawn_and_sent_and_a_click_sends_the_vehicle_to_one_goal() {
    let mut map = shown("map");
    let canvas = map.get_by_label("Map").rect();
    map.get_by_label_contains("Draw a mission").click();
    map.run();
    let primary = egui::PointerButton::Primary;
    click(&mut map, canvas.center() + Vec2::new(40.0, 60.0), primary);
    map.get_by_label("Keep-out zones").click();
    map.run();
    let corners = [Vec2::new(-60.0, 120.0), Vec2::new(-140.0, 120.0), Vec2::new(-140.0, 200.0)];
    for corner in corners {
        click(&mut map, canvas.center() + corner, primary);
    }
    assert!(map.query_by_label_contains("click on the first corner").is_some());
    click(&mut map, canvas.center() + corners[0] + Vec2::new(3.0, 3.0), primary);
    map.snapshot("mission_draft_dark");
    assert!(sent(&mut map).is_empty());
    map.get_by_label_contains("Send").click();
    map.run();
    let missions = sent(&mut map);
    let [mission] = missions.as_slice() else { panic!("{missions:?}") };
    // One goal of the earlier mission has not been reached.
    assert_eq!((mission.goals.len(), mission.keep_out.len(), mission.keeps_goals), (2, 1, false));
    assert_eq!((mission.frame_id.as_str(), mission.keep_out[0].points.len()), ("local", 3));
    assert!(map.query_by_label_contains("as sent").is_some());

    let mut map = shown("map");
    click(&mut map, canvas.center(), egui::PointerButton::Secondary);
    map.get_by_label_contains("Drive here").click();
    map.run();
    assert_eq!(sent(&mut map)[0].goals.len(), 1);
}

#[test]
fn the_panel_of_a_mission_lies_within_a_narrow_map() {
    let mut map = harness(Shown::new("map", samples::driving()), Vec2::new(576.0, 560.0), Theme::Dark);
    map.run();
    map.get_by_label_contains("Draw a mission").click();
    map.run();
    map.get_by_label("Keep-out zones").click();
    map.run();
    let canvas = map.get_by_label("Map").rect();
    assert!(canvas.width() < 400.0, "the list of layers is beside it");
    click(&mut map, canvas.center(), egui::PointerButton::Primary);
    for text in ["Goals", "Keep-out zones", "Send", "Close", "click on the first corner"] {
        let place = map.get_by_label_contains(text).rect();
        assert!(canvas.contains_rect(place), "{text}: {place:?} in {canvas:?}");
    }
}

#[test]
fn a_goal_of_a_mission_is_dragged_while_the_map_stays_and_deleted_in_its_menu() {
    use egui::{CursorIcon, PointerButton};
    let mut map = shown("map");
    let middle = map.get_by_label("Map").rect().center();
    map.get_by_label_contains("Draw a mission").click();
    map.run();
    let (from, to) = (middle + Vec2::new(40.0, 60.0), middle + Vec2::new(-80.0, 100.0));
    for at in [from, from + Vec2::splat(5.0)] {
        click(&mut map, at, PointerButton::Primary);
        assert!(map.query_by_label_contains("2 goals, 0 keep-out zones: not sent").is_some(), "{at}");
        assert_eq!(map.output().platform_output.cursor_icon, CursorIcon::Grab);
    }
    map.hover_at(to);
    map.run();
    let [x_m, y_m, _] = map.state().selection.hovered.get().point.clone().unwrap().position_m;

    map.hover_at(from);
    map.drag_at(from);
    map.hover_at(to);
    map.run();
    assert_eq!(map.output().platform_output.cursor_icon, CursorIcon::Grabbing);
    map.drop_at(to);
    map.run();
    assert!(map.state().view.save()["viewport"].is_null(), "the map has not moved");
    map.get_by_label_contains("Send").click();
    map.run();
    let goal = sent(&mut map)[0].goals[1];
    assert!((goal.x_m - x_m).hypot(goal.y_m - y_m) < 1e-3, "{goal:?}, and not {x_m} {y_m}");

    click(&mut map, to, PointerButton::Secondary);
    map.get_by_label_contains("Delete goal 2").click();
    map.run();
    assert!(map.query_by_label_contains("1 goal, 0 keep-out zones: not sent").is_some());
    click(&mut map, to, PointerButton::Secondary);
    assert!(map.query_by_label_contains("Delete goal").is_none(), "there is none any more");
    click(&mut map, middle - Vec2::new(200.0, 100.0), PointerButton::Primary);
    assert!(map.query_by_label_contains("Drive here").is_none(), "a click beside the menu closes it");
    assert!(map.query_by_label_contains("1 goal, 0 keep-out zones: not sent").is_some(), "and adds no goal");
}

#[test]
fn a_mission_that_was_not_sent_is_there_again_after_another_layout_and_after_measuring() {
    let mut map = shown("map");
    let middle = map.get_by_label("Map").rect().center();
    map.get_by_label_contains("Draw a mission").click();
    map.run();
    for y in [60.0, 100.0, 140.0] {
        click(&mut map, middle + Vec2::new(40.0, y), egui::PointerButton::Primary);
    }
    let drawn = "4 goals, 0 keep-out zones: not sent";
    assert!(map.query_by_label_contains(drawn).is_some());
    for kind in ["timing", "map"] {
        map.state_mut().view = (view_type(kind).unwrap().make)();
        map.run();
    }
    assert!(map.query_by_label_contains(drawn).is_some());
    for is_drawn in [false, true] {
        map.get_by_label("Measure a distance").click();
        map.run();
        assert_eq!(map.query_by_label_contains(drawn).is_some(), is_drawn);
    }
    map.get_by_label_contains("Draw a mission").click();
    map.run();
    assert!(map.query_by_label_contains(drawn).is_none(), "it was closed");
}

#[test]
fn a_mission_that_another_one_has_replaced_is_not_as_sent_and_is_sent_with_its_goals() {
    let mut tree = TransformTree::new();
    tree.set_static("local", "odom", Pose::IDENTITY).unwrap();
    let frame = Frame { transforms: Arc::new(tree), ..samples::driving() };
    let mut map = harness(Shown::new("map", frame), Vec2::new(900.0, 760.0), Theme::Dark);
    map.run();
    let middle = map.get_by_label("Map").rect().center();
    let look_in = |map: &mut Harness<'static, Shown>, frame_id: &str| {
        map.state_mut().view.load(&serde_json::json!({ "frame": frame_id })).unwrap();
        map.run();
    };
    let send = |map: &mut Harness<'static, Shown>| {
        map.get_by_label_contains("Send").click();
        map.run();
        assert!(map.query_by_label_contains("2 goals, 0 keep-out zones: as sent").is_some());
    };
    for (frame_id, y) in [("local", 60.0), ("odom", 120.0)] {
        look_in(&mut map, frame_id);
        map.get_by_label_contains("Draw a mission").click();
        map.run();
        click(&mut map, middle + Vec2::new(40.0, y), egui::PointerButton::Primary);
        send(&mut map);
    }
    look_in(&mut map, "local");
    let not_sent = "2 goals, 0 keep-out zones: not sent";
    assert!(map.query_by_label_contains(not_sent).is_some());
    send(&mut map);
    let missions = sent(&mut map);
    let [first, other, last] = missions.as_slice() else { panic!("{missions:?}") };
    assert!(!last.keeps_goals && last.goals == first.goals && last.goals != other.goals);
    // A run that begins again has none of it.
    let drafts = std::mem::take(&mut map.state_mut().selection.drafts);
    map.state_mut().selection.drafts = drafts.after_restart();
    map.run();
    assert!(map.query_by_label_contains(not_sent).is_some());
}

#[test]
fn a_goal_is_dragged_on_one_of_two_maps_that_show_the_same_mission() {
    let views = ["map", "map"].map(|kind| (view_type(kind).unwrap().make)());
    let mut maps = Harness::builder()
        .with_size(Vec2::new(1000.0, 500.0))
        .with_render_cursor(false)
        .with_context_setup(ocu_ui::install)
        .build_ui_state(
            |ui, (views, shown): &mut ([Box<dyn View>; 2], Shown)| {
                let Shown { frame, selection, controls, wishes, .. } = shown;
                ui.columns(2, |columns| {
                    for (index, (ui, view)) in columns.iter_mut().zip(views).enumerate() {
                        ui.push_id(index, |ui| {
                            show(view.as_mut(), ui, &mut ViewContext { frame, controls, selection, wishes });
                        });
                    }
                });
                selection.hovered.turn();
            },
            (views, Shown::new("map", samples::driving())),
        );
    maps.run_steps(4);
    maps.query_all_by_label_contains("Draw a mission").next().unwrap().click();
    maps.run_steps(4);
    let middle = maps.query_all_by_label("Map").next().unwrap().rect().center();
    let (from, to) = (middle + Vec2::new(40.0, 60.0), middle + Vec2::new(-40.0, 80.0));
    maps.hover_at(from);
    maps.run_steps(2);
    maps.drag_at(from);
    maps.drop_at(from);
    maps.run_steps(3);
    maps.hover_at(to);
    maps.run_steps(3);
    let [x_m, y_m, _] = maps.state().1.selection.hovered.get().point.clone().unwrap().position_m;

    maps.hover_at(from);
    maps.run_steps(2);
    maps.drag_at(from);
    maps.run_steps(2);
    maps.hover_at(to);
    maps.run_steps(2);
    maps.drop_at(to);
    maps.run_steps(3);
    maps.query_all_by_label_contains("Send").next().unwrap().click();
    maps.run_steps(3);
    let mut missions = maps.state().1.controls.iter().filter_map(|control| match control {
        Control::Write { message, .. } => message.to::<Mission>(),
        _ => None,
    });
    let goal = missions.next_back().unwrap().goals[1];
    assert!((goal.x_m - x_m).hypot(goal.y_m - y_m) < 1e-3, "{goal:?}, and not {x_m} {y_m}");
}

#[test]
fn a_click_on_the_panel_of_a_mission_does_not_reach_the_map() {
    let mut map = shown("map");
    map.get_by_label_contains("Draw a mission").click();
    map.run();
    let send = map.get_by_label_contains("Send").rect();
    let note = map.get_by_label_contains("1 goal, 0 keep-out zones: as sent").rect();
    for at in [send.center(), note.right_center() + Vec2::new(20.0, 0.0)] {
        click(&mut map, at, egui::PointerButton::Primary);
        assert!(map.query_by_label_contains("1 goal, 0 keep-out zones: as sent").is_some(), "{at:?}");
    }
    let zones = map.get_by_label("Keep-out zones").rect().center();
    click(&mut map, zones, egui::PointerButton::Primary);
    click(&mut map, send.center(), egui::PointerButton::Primary);
    assert!(map.query_by_label_contains("1 goal, 0 keep-out zones: as sent").is_some());
}

/// A map after a zone, and an area of the same size, were sent in a frame.
pub(super) fn map_after_a_zone_in(frame_id: &str) -> Harness<'static, Shown> {
    let corner = |x_m, y_m| PlanePoint { x_m, y_m };
    let zone = PlanePolygon { points: vec![corner(0.0, 0.0), corner(1.0, 0.0), corner(0.0, 1.0)] };
    let area = Some(zone.clone());
    let mission = Mission { frame_id: frame_id.to_owned(), area, keep_out: vec![zone], ..Mission::default() };
    let mut frame = samples::driving();
    let topics = frame.topics.iter().cloned().chain([samples::topic("/operator/mission", 0.1, 1.0, mission)]);
    frame.topics = topics.collect();
    let mut map = harness(Shown::new("map", frame), Vec2::new(900.0, 760.0), Theme::Dark);
    map.run();
    map
}

/// What the map sends for *Drive here* after a zone was sent in a frame.
fn driven_after_a_zone_in(frame_id: &str) -> Vec<Mission> {
    let mut map = map_after_a_zone_in(frame_id);
    let canvas = map.get_by_label("Map").rect();
    click(&mut map, canvas.center(), egui::PointerButton::Secondary);
    map.get_by_label_contains("Drive here").click();
    map.run();
    sent(&mut map)
}

#[test]
fn a_goal_by_a_click_keeps_area_and_zones_and_is_not_sent_where_they_would_be_lost() {
    let missions = driven_after_a_zone_in("local");
    let sent = &missions[0];
    assert_eq!((sent.keep_out.len(), sent.area.as_ref()), (1, Some(&sent.keep_out[0])));
    assert_eq!(driven_after_a_zone_in("elsewhere").len(), 0);
}

#[test]
fn a_mission_is_not_drawn_where_the_zones_that_were_sent_cannot_be_placed() {
    for (frame_id, is_refused) in [("local", false), ("elsewhere", true)] {
        let mut map = map_after_a_zone_in(frame_id);
        let tool = map.get_by_label_contains("Draw a mission");
        assert_eq!(tool.accesskit_node().is_disabled(), is_refused);
        let canvas = map.get_by_label("Map").rect();
        click(&mut map, canvas.center(), egui::PointerButton::Secondary);
        let edit = map.get_by_label_contains("Edit the mission");
        assert_eq!(edit.accesskit_node().is_disabled(), is_refused);
    }
}

#[test]
fn a_mission_is_not_drawn_on_a_geodetic_map() {
    let mut frame = samples::driving();
    let is_kept = |name: &str| !["/wm1/map", "/generator/driven"].contains(&name);
    frame.topics = frame.topics.iter().filter(|topic| is_kept(&topic.name)).cloned().collect();
    let tracks = samples::full().tracks;
    frame.tracks = frame.tracks.iter().chain(tracks.iter()).cloned().collect();
    for (map, is_refused) in [("local", false), (WGS84, true)] {
        let mut shown = Shown::new("map", frame.clone());
        shown.view.load(&serde_json::json!({ "frame": map })).unwrap();
        let mut map = harness(shown, Vec2::new(900.0, 760.0), Theme::Dark);
        map.run();
        assert_eq!(map.get_by_label_contains("Draw a mission").accesskit_node().is_disabled(), is_refused);
        let middle = map.get_by_label("Map").rect().center();
        click(&mut map, middle, egui::PointerButton::Secondary);
        assert_eq!(map.get_by_label_contains("Drive here").accesskit_node().is_disabled(), is_refused);
    }
}

#[test]
fn the_area_and_the_zones_that_are_obeyed_are_seen_while_a_mission_is_drawn() {
    let picture = |has_bounds: bool| {
        let mut frame = samples::driving();
        let edit = |topic: &Topic| match topic.get::<Mission>() {
            Some(mission) if !has_bounds => {
                let mission = Mission { area: None, keep_out: Vec::new(), ..mission.clone() };
                let sample = topic.latest.clone().unwrap();
                topic.clone().with_latest(Sample { message: AnyMessage::new(mission), ..sample })
            }
            _ => topic.clone(),
        };
        frame.topics = frame.topics.iter().map(edit).collect();
        let mut map = harness(Shown::new("map", frame), Vec2::new(900.0, 760.0), Theme::Dark);
        map.run();
        map.get_by_label_contains("Draw a mission").click();
        map.run();
        assert!(map.query_by_label_contains("1 goal, 0 keep-out zones: as sent").is_some());
        map.render().unwrap()
    };
    assert_ne!(picture(true), picture(false));
}

#[test]
fn an_obstacle_is_drawn_and_sent_to_the_processes_that_learn() {
    let mut map = shown("map");
    let canvas = map.get_by_label("Map").rect();
    map.get_by_label_contains("Draw an obstacle or ground").click();
    map.run();
    let corners = [Vec2::new(-60.0, 120.0), Vec2::new(-140.0, 120.0), Vec2::new(-140.0, 200.0)];
    for corner in corners.into_iter().chain([corners[0]]) {
        click(&mut map, canvas.center() + corner, egui::PointerButton::Primary);
    }
    map.snapshot("example_draft_dark");
    assert!(map.query_by_label_contains("not sent").is_some());
    assert!(map.state().controls.is_empty());
    map.get_by_label_contains("Teach").click();
    map.run();
    let controls = std::mem::take(&mut map.state_mut().controls);
    let [Control::Write { buffer, message }] = controls.as_slice() else { panic!("one message is sent") };
    let example = message.to::<TrainingExample>().unwrap();
    assert_eq!((buffer.as_str(), example.frame_id.as_str()), ("/operator/training", "local"));
    assert_eq!((example.kind(), example.outline.unwrap().points.len()), (ExampleKind::ExampleObstacle, 3));
    assert!(map.query_by_label_contains("1 example sent").is_some());
}

#[test]
fn an_outline_that_was_not_sent_is_there_again_after_another_layout_and_in_its_frame() {
    let mut tree = TransformTree::new();
    tree.set_static("local", "odom", Pose::IDENTITY).unwrap();
    let frame = Frame { transforms: Arc::new(tree), ..samples::driving() };
    let mut map = harness(Shown::new("map", frame), Vec2::new(900.0, 760.0), Theme::Dark);
    let look_in = |map: &mut Harness<'static, Shown>, frame_id: &str| {
        map.state_mut().view.load(&serde_json::json!({ "frame": frame_id })).unwrap();
        map.run();
    };
    look_in(&mut map, "local");
    let middle = map.get_by_label("Map").rect().center();
    map.get_by_label_contains("Draw an obstacle or ground").click();
    map.run();
    click(&mut map, middle + Vec2::new(-60.0, 120.0), egui::PointerButton::Primary);
    let drawn = "click on the first corner to close the outline";
    assert!(map.query_by_label_contains(drawn).is_some());
    for kind in ["timing", "map"] {
        map.state_mut().view = (view_type(kind).unwrap().make)();
        map.run();
    }
    for (frame_id, is_drawn) in [("odom", false), ("local", true)] {
        look_in(&mut map, frame_id);
        assert_eq!(map.query_by_label_contains(drawn).is_some(), is_drawn, "{frame_id}");
    }
    map.get_by_label_contains("Draw an obstacle or ground").click();
    map.run();
    assert!(map.query_by_label_contains(drawn).is_none(), "it was closed");
}

#[test]
fn an_old_plan_and_old_arcs_look_old_and_tell_their_age() {
    let at = |seconds: u64| {
        let mut frame = samples::driving();
        let is_planned = |name: &str| ["/planner/plan", "/follower/arcs"].contains(&name);
        frame.topics = frame.topics.iter().filter(|topic| is_planned(&topic.name)).cloned().collect();
        frame.now = samples::NOW.after_ns(seconds * 1_000_000_000);
        let mut map = harness(Shown::new("map", frame), Vec2::new(900.0, 760.0), Theme::Dark);
        map.run();
        map.query_all_by_label_contains("old: ").count()
    };
    assert_eq!((at(0), at(9)), (0, 2));
}

#[test]
fn the_mission_of_the_run_counts_and_not_a_recorded_one() {
    let mut frame = samples::driving();
    let driven = frame.topic("/generator/driven").unwrap().clone();
    let mut recorded = driven.clone();
    recorded.run = RunTag::Recorded;
    let sample = recorded.latest.clone().unwrap();
    let mission = Mission { frame_id: "local".to_owned(), ..Mission::default() };
    let message = AnyMessage::new(mission);
    let recorded = recorded.with_latest(Sample { message, ..sample });
    frame.topics = std::iter::once(recorded).chain(frame.topics.iter().cloned()).collect();
    let mut map = harness(Shown::new("map", frame), Vec2::new(900.0, 760.0), Theme::Dark);
    map.run();
    map.get_by_label_contains("Draw a mission").click();
    map.run();
    assert!(map.query_by_label_contains("1 goal, 0 keep-out zones").is_some(), "what is left of the run's");
}
