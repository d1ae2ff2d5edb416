//! The list of topics in the bar of a view.

use super::{Shown, harness};
use crate::samples;
use egui::accesskit::Role;
use egui::{Key, Theme, Vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable as _;

/// The view *Fields* with its list of buffers open.
fn open_list() -> Harness<'static, Shown> {
    let mut harness = harness(Shown::new("fields", samples::driving()), Vec2::new(900.0, 560.0), Theme::Dark);
    harness.run();
    harness.get_by_role_and_label(Role::ComboBox, "Buffer").click();
    harness.run();
    harness
}

#[test]
fn a_long_list_is_searched_and_its_field_takes_the_keys() {
    let mut harness = open_list();
    assert!(ocu_ui::typing::takes_keys(&harness.ctx));
    harness.get_by_label("Search this list").focus();
    harness.run();
    harness.get_by_label("Search this list").type_text("map wm1");
    harness.run();
    assert!(harness.query_by_label("/vehicle/ground_truth_map").is_none());
    harness.key_press(Key::Enter);
    harness.run();
    let chosen = harness.state().selection.topic.clone().unwrap();
    assert_eq!(chosen.name, "/wm1/map");
    assert!(harness.query_by_label("Search this list").is_none(), "the list is closed");
}

#[test]
fn only_the_ground_truth_is_below_its_heading() {
    let harness = open_list();
    let heading = harness.get_by_label("Truth of the simulation").rect();
    let top_of = |name: &str| harness.get_by_label(name).rect().top();
    for name in ["/camera/ground_truth_labels", "/vehicle/ground_truth_map"] {
        assert!(top_of(name) > heading.top(), "{name}");
    }
    for name in ["/camera/points", "/vehicle/goal", "/wm1/map"] {
        assert!(top_of(name) < heading.top(), "{name}");
    }
}
