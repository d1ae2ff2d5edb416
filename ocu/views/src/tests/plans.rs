//! The links between the view of plans and the map.

use super::{Shown, harness};
use crate::samples;
use crate::view::{Hover, HoverPoint, TopicKey};
use egui::{Theme, Vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;

fn shown(kind: &str) -> Harness<'static, Shown> {
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
