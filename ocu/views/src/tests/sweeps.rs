//! The sweep view: its form, its table, and what they ask of the window.

use super::pictures::compare_picture;
use super::{Shown, harness, press_at};
use crate::samples;
use crate::sweep::{SweepRequest, SweepRow, SweepState};
use crate::view::Wish;
use egui::{Theme, Vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable as _;
use std::sync::Arc;

/// Seven of nine runs ended: some reached their goal.
fn running() -> SweepState {
    let row = |index: u32, reached: bool, errors: &str| SweepRow {
        params: format!("planner.clearance_m={}", ["0.2", "0.4", "0.6"][index as usize / 3]),
        seed: u64::from(index % 3),
        outcome: if reached { "reached" } else { "time_limit" }.to_owned(),
        reached: Some(reached),
        time_s: if reached { 41.5 + f64::from(index) } else { 300.0 },
        course: Some((if reached { 0.42 } else { 11.7 }, index % 2, index / 2)),
        errors: errors.to_owned(),
        recording: Some(format!("/sweeps/run-{index:04}.mcap").into()),
    };
    let rows = (0..7)
        .map(|index| row(index, index != 2 && index != 5, if index == 5 { "wm1: no pose" } else { "" }));
    SweepState {
        what: "lagr on dead_end".to_owned(),
        ran: "lagr on dead_end".to_owned(),
        rows: rows.collect(),
        total: 9,
        is_running: true,
        problem: None,
    }
}

fn shown(state: SweepState, size: Vec2, theme: Theme) -> Harness<'static, Shown> {
    let mut shown = Shown::new("sweep", samples::driving());
    shown.selection.sweep = Arc::new(state);
    let saved =
        serde_json::json!({"process": "planner", "field": "clearance_m", "values": "0.2..0.6:3", "runs": 3});
    shown.view.load(&saved).unwrap();
    let mut harness = harness(shown, size, theme);
    harness.run();
    harness
}

#[test]
fn sweep_dark() {
    compare_picture(shown(running(), Vec2::new(760.0, 300.0), Theme::Dark), "sweep_dark");
}

#[test]
fn sweep_light() {
    let ended = SweepState { is_running: false, total: 7, ..running() };
    compare_picture(shown(ended, Vec2::new(760.0, 300.0), Theme::Light), "sweep_light");
}

#[test]
fn sweep_in_a_narrow_place_dark() {
    compare_picture(shown(running(), Vec2::new(300.0, 320.0), Theme::Dark), "sweep_narrow_dark");
}

#[test]
fn run_asks_for_the_sweep_of_the_form_and_cancel_ends_it() {
    let idle = SweepState { what: "lagr".to_owned(), ..SweepState::default() };
    let mut harness = shown(idle, Vec2::new(760.0, 300.0), Theme::Dark);
    harness.get_by_label_contains("Run").click();
    harness.run();
    let Some(Wish::Sweep(request)) = harness.state_mut().wishes.pop() else { panic!("no sweep") };
    let params = vec!["planner.clearance_m=0.2..0.6:3".to_owned()];
    assert_eq!(request, SweepRequest { params, runs: 3, ..SweepRequest::default() });
    harness.state_mut().selection.sweep = Arc::new(running());
    harness.run();
    harness.get_by_label_contains("Cancel").click();
    harness.run();
    assert!(matches!(harness.state_mut().wishes.pop(), Some(Wish::CancelSweep)));
}

#[test]
fn a_sweep_that_was_cancelled_says_after_how_many_of_its_runs() {
    let said = |state: SweepState| {
        let harness = shown(SweepState { is_running: false, ..state }, Vec2::new(760.0, 300.0), Theme::Dark);
        let is_told = |text: &str| harness.query_by_label_contains(text).is_some();
        assert!(is_told("5 of 7 runs of lagr on dead_end reached the goal"));
        is_told("cancelled after 7 of 9")
    };
    assert!(said(running()));
    assert!(!said(SweepState { total: 7, ..running() }));
}

#[test]
fn the_runs_of_a_sweep_are_named_after_what_ran_and_run_after_what_is_open_now() {
    let state = SweepState { what: "lagr on hill".to_owned(), ..running() };
    let harness = shown(state.clone(), Vec2::new(760.0, 300.0), Theme::Dark);
    assert!(harness.query_by_label("lagr on dead_end").is_some(), "beside the progress");
    let ended = SweepState { is_running: false, total: 7, ..state };
    let harness = shown(ended, Vec2::new(760.0, 300.0), Theme::Dark);
    assert!(harness.query_by_label("lagr on hill").is_some(), "beside Run");
    assert!(harness.query_by_label("5 of 7 runs of lagr on dead_end reached the goal").is_some());
}

#[test]
fn the_field_of_a_fault_stays_in_one_line_with_its_name() {
    for width in (200..520_u16).step_by(40) {
        let harness = shown(running(), Vec2::new(f32::from(width), 320.0), Theme::Dark);
        let name = harness.get_by_label("Fault").rect();
        let field = harness.get_by_label("Fault on demand in every run").rect();
        let is_beside = name.y_range().contains(field.center().y) && name.right() < field.left();
        assert!(is_beside, "{width}: {name:?} {field:?}");
    }
}

#[test]
fn a_sweep_that_is_being_checked_counts_no_runs_of_the_one_before() {
    let harness = shown(SweepState { total: 0, ..running() }, Vec2::new(760.0, 300.0), Theme::Dark);
    assert!(harness.query_by_label_contains("7 of").is_none());
    assert!(harness.query_by_label("Run with seed 2 planner.clearance_m=0.2: time_limit").is_some());
}

#[test]
fn every_line_of_a_problem_begins_below_the_form() {
    let problem = "truth_driver.vehicle_width_m: got 9, expected a number from 0.1 to 5 m";
    let refused = SweepState { is_running: false, problem: Some(problem.to_owned()), ..running() };
    let harness = shown(refused, Vec2::new(300.0, 420.0), Theme::Dark);
    let painted = harness.output().shapes.iter().find_map(|clipped| match &clipped.shape {
        egui::Shape::Text(text) if text.galley.text() == problem => {
            assert!(text.galley.rows.len() > 1, "it is wrapped");
            Some(clipped.shape.visual_bounding_rect())
        }
        _ => None,
    });
    let (left, of_form) = (painted.unwrap().left(), harness.get_by_label("Parameter").rect().left());
    assert!((left - of_form).abs() < 2.0, "{left} {of_form}");
}

#[test]
fn a_click_on_a_run_opens_its_recording() {
    let mut harness = shown(running(), Vec2::new(760.0, 300.0), Theme::Dark);
    harness.get_by_label("Run with seed 2 planner.clearance_m=0.2: time_limit").click();
    harness.run();
    let Some(Wish::OpenRun { path, title }) = harness.state_mut().wishes.pop() else {
        panic!("nothing is opened")
    };
    assert_eq!(title, "planner.clearance_m=0.2, seed 2");
    assert_eq!(path.to_str(), Some("/sweeps/run-0002.mcap"));
}

#[test]
fn a_press_on_cancel_begins_no_sweep_where_the_last_run_ends_before_the_release() {
    let mut harness = shown(running(), Vec2::new(760.0, 300.0), Theme::Dark);
    let at = harness.get_by_label_contains("Cancel").rect().center();
    let ended = SweepState { is_running: false, total: 7, ..running() };
    press_at(&mut harness, at, |shown| shown.selection.sweep = Arc::new(ended));
    assert!(harness.state().wishes.is_empty());
}

#[test]
fn a_press_on_a_run_opens_no_other_one_that_takes_its_place() {
    let mut harness = shown(running(), Vec2::new(760.0, 300.0), Theme::Dark);
    let at = harness.get_by_label("Run with seed 2 planner.clearance_m=0.2: time_limit").rect().center();
    let mut other = running();
    other.rows.remove(0);
    press_at(&mut harness, at, |shown| shown.selection.sweep = Arc::new(other));
    let Some(Wish::OpenRun { title, .. }) = harness.state_mut().wishes.pop() else {
        panic!("nothing is opened")
    };
    assert_eq!(title, "planner.clearance_m=0.2, seed 2");
}
