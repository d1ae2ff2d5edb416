//! Interaction with the compare view.

use super::{Shown, harness, press_at};
use crate::samples::{self, SIDES};
use egui::accesskit::Role;
use egui::{Shape, Theme, Vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable as _;
use rcs_msg::Stamp;
use rcs_runtime::RunId;
use rcs_runtime::source::{Compared, Comparison, Control, Frame, RunTag, Runs, Topic};
use std::sync::Arc;

fn shown(frame: Frame) -> Harness<'static, Shown> {
    let mut harness = harness(Shown::new("compare", frame), Vec2::new(1100.0, 420.0), Theme::Dark);
    harness.run();
    harness
}

fn with(change: impl FnOnce(&mut Comparison)) -> Frame {
    let frame = samples::compared();
    let mut comparison = frame.comparisons[0].clone();
    change(&mut comparison);
    Frame { comparisons: Arc::new([comparison]), ..frame }
}

#[test]
fn a_branch_is_compared_with_the_run_that_it_left_and_both_are_asked_for() {
    let harness = shown(samples::compared());
    assert_eq!(harness.state().view.compares(), Some(SIDES));
    assert_eq!(harness.state().view.runs(), [RunId(0), RunId(1)]);
    assert!(harness.query_by_label("105 of 1600 cells differ").is_some());
}

#[test]
fn both_sides_can_be_chosen_in_a_view_of_200_points() {
    let shown = Shown::new("compare", samples::compared());
    let mut harness = harness(shown, Vec2::new(216.0, 420.0), Theme::Dark);
    harness.run();
    let choice = |name: &str| harness.get_by_role_and_label(Role::ComboBox, name).rect();
    let (first, second) = (choice("First of the two"), choice("Second of the two"));
    let more = harness.get_by_label("More of this bar").rect();
    assert!(first.right() < second.left() && second.right() < more.left(), "{first:?} {second:?} {more:?}");
    assert!(second.width() > 60.0, "{second:?}");
}

#[test]
fn the_line_that_says_since_when_both_differ_ends_within_a_narrow_view() {
    let shown = Shown::new("compare", samples::compared());
    let mut harness = harness(shown, Vec2::new(260.0, 420.0), Theme::Dark);
    harness.run();
    let first = harness.state().frame.comparisons[0].differences[0].buffer.clone();
    let mut is_named = false;
    for clipped in &harness.output().shapes {
        let Shape::Text(text) = &clipped.shape else { continue };
        if text.galley.text() == first {
            is_named = true;
            assert!(text.pos.x + text.galley.size().x <= clipped.clip_rect.right(), "{}", text.pos.x);
        }
    }
    assert!(is_named, "{first}");
}

#[test]
fn a_click_on_a_difference_goes_to_its_time_and_selects_its_buffer_and_process() {
    let mut harness = shown(samples::compared());
    harness.get_by_label_contains("/vehicle_interface/vehicle .steering_rad").click();
    harness.run();
    let first = harness.state().frame.comparisons[0].differences[4].time;
    let controls = &harness.state().controls;
    assert!(matches!(controls[..], [Control::Pause, Control::Seek(to)] if to == first), "{controls:?}");
    let topic = harness.state().selection.topic.as_ref().map(|topic| topic.name.as_str());
    assert_eq!(topic, Some("/vehicle_interface/vehicle"));
}

#[test]
fn a_press_on_a_difference_goes_to_no_other_one_that_takes_its_place() {
    let mut harness = shown(samples::compared());
    let place = harness.get_by_label_contains("/vehicle_interface/vehicle .steering_rad").rect();
    let found = with(|comparison| {
        let mut all = comparison.differences.to_vec();
        let mut earlier = all[0].clone();
        earlier.buffer = "/found/later".to_owned();
        all.insert(0, earlier);
        comparison.differences = all.into();
    });
    press_at(&mut harness, place.center(), |shown| shown.frame = found);
    let pressed = harness.state().frame.comparisons[0].differences[5].time;
    let controls = &harness.state().controls;
    assert!(matches!(controls[..], [Control::Pause, Control::Seek(to)] if to == pressed), "{controls:?}");
}

#[test]
fn the_badge_says_bit_equal_only_where_everything_was_compared() {
    let check = |change: &dyn Fn(&mut Comparison), word: &str| {
        let frame = with(|comparison| {
            comparison.differences = Arc::new([]);
            change(comparison);
        });
        let harness = shown(frame);
        assert!(harness.query_by_label(word).is_some(), "{word}");
    };
    check(&|_| (), "bit-equal");
    check(&|comparison| comparison.until = None, "comparing");
    check(&|comparison| comparison.gaps = Arc::new([(samples::NOW, samples::NOW)]), "equal where kept");
    check(&|comparison| comparison.problem = Some("a chunk is damaged".into()), "equal so far");
    let nothing = |comparison: &mut Comparison| {
        (comparison.until, comparison.problem) = (None, Some("no such file".into()));
    };
    check(&nothing, "not compared");
    check(&nothing, "The line above says why.");
    let harness = shown(samples::compared());
    assert!(harness.query_by_label("differ").is_some() && harness.query_by_label("bit-equal").is_none());
}

/// When a run that ends early ends.
const EARLY: Stamp = samples::NOW.before_ns(5_000_000_000);

/// Two runs without a difference, of which the first ended early.
fn equal_until_early(change: impl FnOnce(&mut Comparison)) -> Harness<'static, Shown> {
    let mut frame = with(|comparison| {
        comparison.differences = Arc::new([]);
        change(comparison);
    });
    let mut runs = frame.runs.all.to_vec();
    runs[0].end = EARLY;
    frame.runs.all = runs.into();
    shown(frame)
}

#[test]
fn a_run_that_ended_before_the_viewed_time_is_told_and_no_cell_is_coloured() {
    let harness = equal_until_early(|_| ());
    assert!(harness.query_by_label("run 0 ended at 7.50 s").is_some());
    assert!(harness.query_by_label_contains("cells differ").is_none());
    assert!(harness.query_by_label("No difference up to 7.50 s, where run 0 ends").is_some());
}

#[test]
fn the_end_of_a_recording_is_told_where_the_run_beside_it_goes_on() {
    let frame = with(|comparison| {
        comparison.sides = [SIDES[1], Compared::Other];
        comparison.differences = Arc::new([]);
        (comparison.until, comparison.recording_ends) = (Some(EARLY), [None, Some(EARLY)]);
    });
    let harness = shown(Frame { against: Some("drive.mcap".into()), ..frame });
    assert!(harness.query_by_label("No difference up to 7.50 s, where drive.mcap ends").is_some());
}

#[test]
fn of_two_recordings_the_end_of_the_shorter_one_is_told() {
    let frame = with(|comparison| {
        comparison.sides = [Compared::Recorded, Compared::Other];
        comparison.differences = Arc::new([]);
        (comparison.until, comparison.recording_ends) = (Some(EARLY), [Some(samples::NOW), Some(EARLY)]);
    });
    let recorded = frame.topics.iter().cloned().map(|mut topic: Topic| {
        topic.run = RunTag::Recorded;
        topic
    });
    let (topics, runs) = (recorded.collect(), Runs::default());
    let harness = shown(Frame { against: Some("short.mcap".into()), topics, runs, ..frame });
    assert!(harness.query_by_label("bit-equal").is_some());
    assert!(harness.query_by_label("No difference up to 7.50 s, where short.mcap ends").is_some());
}

#[test]
fn another_recording_has_a_map_beside_that_of_the_run() {
    let frame = with(|comparison| comparison.sides = [SIDES[1], Compared::Other]);
    let other = frame.beside.first().cloned();
    let mut harness = shown(Frame { against: Some("drive.mcap".into()), other, ..frame });
    assert!(harness.query_by_label("105 of 1600 cells differ").is_some());
    assert!(harness.state().view.shows_other());
    harness.get_by_label("Show how the maps differ").click();
    harness.run();
    assert!(!harness.state().view.shows_other(), "nobody looks at it");
}

#[test]
fn no_end_of_a_run_is_told_where_not_everything_up_to_there_was_compared() {
    let check = |change: fn(&mut Comparison), is_told: bool| {
        let harness = equal_until_early(change);
        let has = |text: &str| harness.query_by_label_contains(text).is_some();
        assert_eq!([has("where run 0 ends"), has("Every message")], [is_told; 2]);
        assert_eq!(has("No difference in what was compared"), !is_told);
    };
    check(|comparison| comparison.until = Some(EARLY), true);
    check(|comparison| comparison.until = Some(EARLY.before_ns(1)), false);
    check(|comparison| comparison.gaps = Arc::new([(EARLY, samples::NOW)]), false);
    check(|comparison| comparison.problem = Some("a chunk is damaged".into()), false);
}

#[test]
fn sides_that_were_chosen_are_kept_and_change_places() {
    let mut harness = shown(samples::compared());
    harness.get_by_label("First of the two").click();
    harness.run();
    harness.query_all_by_label("run 1").last().expect("it can be chosen").click();
    harness.run();
    assert_eq!(harness.state().view.compares(), Some([SIDES[1], SIDES[0]]));
    assert!(harness.state().view.save()["sides"].is_array());
}
