//! Conditions that a person writes.

use super::{Shown, harness};
use crate::samples;
use crate::views::view_type;
use egui::{Theme, Vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable as _;

#[test]
fn a_formula_is_shown_whole_in_a_narrow_view() {
    let formula = "/planner/status.faults > 12345";
    let mut shown = Shown::new("conditions", samples::full());
    let condition = serde_json::json!({ "formula": formula, "stops": true });
    shown.view.load(&serde_json::json!({ "conditions": [condition] })).unwrap();
    let mut harness = harness(shown, Vec2::new(200.0, 300.0), Theme::Dark);
    harness.run();
    let remove = harness.get_by_label(&format!("Remove {formula}")).rect();
    assert!((0.0..=200.0).contains(&remove.right()), "{remove:?}");
    assert!(is_whole(&harness, formula));
}

#[test]
fn in_a_narrow_view_the_button_that_removes_a_condition_is_in_one_line_with_it() {
    let mut shown = Shown::new("conditions", samples::full());
    let condition = serde_json::json!({ "formula": "/a.b > 0", "stops": true });
    shown.view.load(&serde_json::json!({ "conditions": [condition] })).unwrap();
    let mut harness = harness(shown, Vec2::new(200.0, 300.0), Theme::Dark);
    harness.run();
    let (remove, formula) =
        (harness.get_by_label("Remove /a.b > 0").rect(), harness.get_by_label("/a.b > 0").rect());
    let lower_by = remove.center().y - formula.center().y;
    assert!(lower_by.abs() < 1.5, "{remove:?} {formula:?}");
}

/// Whether a text is painted, nothing of it is cut off, and it lies within what is seen.
fn is_whole(harness: &Harness<'_, Shown>, whole: &str) -> bool {
    harness.output().shapes.iter().any(|clipped| match &clipped.shape {
        egui::Shape::Text(text) => {
            let place = clipped.shape.visual_bounding_rect();
            let is_seen = !text.galley.elided && clipped.clip_rect.contains_rect(place);
            text.galley.text() == whole && is_seen
        }
        _ => false,
    })
}

#[test]
fn the_reason_why_a_condition_has_no_value_is_shown_whole_in_a_narrow_view() {
    let mut shown = Shown::new("conditions", samples::full());
    let condition = serde_json::json!({ "formula": "/a/buffer/of/nobody.faults > 0", "stops": true });
    shown.view.load(&serde_json::json!({ "conditions": [condition] })).unwrap();
    let mut harness = harness(shown, Vec2::new(200.0, 300.0), Theme::Dark);
    harness.run();
    assert!(is_whole(&harness, "there is no buffer /a/buffer/of/nobody"));
}

#[test]
fn a_condition_that_was_not_added_is_there_again_after_another_layout() {
    let formula = "/planner/status.faults > 0";
    let shown = Shown::new("conditions", samples::full());
    let mut harness = harness(shown, Vec2::new(600.0, 300.0), Theme::Dark);
    harness.run();
    harness.get_by_label("New condition").click();
    harness.run();
    harness.get_by_label("New condition").type_text(formula);
    harness.run();
    for kind in ["timing", "conditions"] {
        harness.state_mut().view = (view_type(kind).unwrap().make)();
        harness.run();
    }
    let written = |harness: &Harness<'_, Shown>| harness.get_by_label("New condition").value();
    assert_eq!(written(&harness).as_deref(), Some(formula));
    harness.get_by_label("Add").click();
    harness.run();
    assert_eq!(written(&harness).unwrap_or_default(), "");
    assert_eq!(harness.state().view.save()["conditions"][0]["formula"], formula);
}

#[test]
fn after_a_condition_is_entered_the_next_one_can_be_typed() {
    let shown = Shown::new("conditions", samples::full());
    let mut harness = harness(shown, Vec2::new(600.0, 300.0), Theme::Dark);
    harness.run();
    harness.get_by_label("New condition").click();
    harness.run();
    for formula in ["/planner/status.faults > 0", "/planner/status.faults > 1"] {
        let entry = harness.get_by_label("New condition");
        assert!(entry.is_focused());
        entry.type_text(formula);
        harness.run();
        harness.key_press(egui::Key::Enter);
        harness.run();
    }
    let conditions = harness.state().view.save()["conditions"].as_array().map(Vec::len);
    assert_eq!(conditions, Some(2));
}
