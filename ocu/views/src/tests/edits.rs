//! Editing the fields of several buffers, in several views, and who wrote them.

use super::{Shown, harness};
use crate::samples::{self, NOW};
use crate::view::{RunChoice, TopicKey};
use crate::views::view_type;
use egui::{Theme, Vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::{NodeT as _, Queryable as _};
use rcs_formula::{FieldRef, Points};
use rcs_runtime::source::{Control, FieldSeries, Frame, RunTag, SourceInfo, SourceKind, series_of};
use std::sync::Arc;

/// The fields of a topic of this frame, as one of a stack, which can be written to.
fn fields(frame: Frame, topic: TopicKey) -> Harness<'static, Shown> {
    let info = SourceInfo { kind: SourceKind::Stack, ..(*frame.info).clone() };
    let mut shown = Shown::new("fields", Frame { info: Arc::new(info), ..frame });
    shown.selection.topic = Some(topic);
    let mut harness = harness(shown, Vec2::new(900.0, 560.0), Theme::Dark);
    harness.run();
    harness
}

/// Chooses an item of the menu of a field.
fn choose(harness: &mut Harness<'_, Shown>, field: &str, item: &str) {
    harness.get_by_label(field).click_secondary();
    harness.run();
    harness.get_by_label(item).click();
    harness.run();
}

#[test]
fn changes_that_were_not_written_are_shown_with_their_buffer_only_and_come_back_with_it() {
    let mut harness = fields(samples::full(), TopicKey::shown("/planner/status"));
    let select = |harness: &mut Harness<'_, Shown>, name: &str| {
        harness.state_mut().selection.topic = Some(TopicKey::shown(name));
        harness.run();
    };
    choose(&mut harness, "cycle 321", "Edit…");
    assert!(harness.query_by_label("New value of .cycle").is_some());

    select(&mut harness, "/obstacles/status");
    for name in ["New value of .cycle", "Write now", "Hold"] {
        assert!(harness.query_by_label(name).is_none(), "{name}: it would be written to another buffer");
    }
    choose(&mut harness, "echo_serial 3", "Edit…");
    assert!(harness.query_by_label("New value of .echo_serial").is_some());

    select(&mut harness, "/planner/status");
    assert!(harness.query_by_label("New value of .cycle").is_some());
    assert!(harness.query_by_label("New value of .echo_serial").is_none());
    harness.get_by_label("Write now").click();
    harness.run();
    let controls = &harness.state().controls;
    let [Control::Write { buffer, .. }] = controls.as_slice() else { panic!("{controls:?}") };
    assert_eq!(buffer, "/planner/status");
}

#[test]
fn no_field_moves_where_one_is_edited_and_while_it_can_be_taken_back() {
    let mut harness = fields(samples::full(), TopicKey::shown("/planner/status"));
    let place = |harness: &Harness<'_, Shown>| harness.get_by_label("cycle 321").rect().left_top();
    let before = place(&harness);
    choose(&mut harness, "cycle 321", "Edit…");
    assert_eq!(place(&harness), before, "it is edited");
    let edit = harness.get_by_label("New value of .cycle").rect();
    assert!(before.y < edit.top() && edit.bottom() < 560.0, "{edit:?}");
    harness.get_by_label("Write now").click();
    harness.run();
    assert_eq!(place(&harness), before, "it was written");
}

#[test]
fn a_value_that_was_refused_is_told_until_its_text_changes() {
    let mut harness = fields(samples::full(), TopicKey::shown("/planner/status"));
    choose(&mut harness, "cycle 321", "Edit…");
    let type_text = |harness: &mut Harness<'_, Shown>, text: &str| {
        harness.get_by_label("New value of .cycle").focus();
        harness.run();
        harness.event(egui::Event::Text(text.to_owned()));
        harness.run();
    };
    let tells =
        |harness: &Harness<'_, Shown>, text: &str| harness.query_all_by_label_contains(text).next().is_some();
    type_text(&mut harness, "abc");
    harness.key_press(egui::Key::Enter);
    harness.run();
    assert!(tells(&harness, "expected a whole number") && !tells(&harness, "in the past"));
    let is_focused = harness.get_by_label("New value of .cycle").is_focused();
    assert!(is_focused, "what is typed next is no key of the window");
    type_text(&mut harness, "d");
    assert!(!tells(&harness, "expected a whole number") && tells(&harness, "in the past"));
}

#[test]
fn changes_and_undo_are_there_again_after_another_layout_in_each_view_of_their_buffer() {
    let mut harness = fields(samples::full(), TopicKey::shown("/planner/status"));
    harness.state_mut().selection.process = Some("planner".into());
    let open = |harness: &mut Harness<'_, Shown>, kind: &str| {
        harness.state_mut().view = (view_type(kind).unwrap().make)();
        harness.run();
    };
    choose(&mut harness, "cycle 321", "Edit…");
    for (kind, is_shown) in [("timing", false), ("fields", true), ("details", true)] {
        open(&mut harness, kind);
        assert_eq!(harness.query_by_label("New value of .cycle").is_some(), is_shown, "{kind}");
    }
    harness.get_by_label("Write now").click();
    harness.run();
    open(&mut harness, "fields");
    let can_undo =
        |harness: &Harness<'_, Shown>| !harness.get_by_label_contains("Undo").accesskit_node().is_disabled();
    assert!(can_undo(&harness));
    choose(&mut harness, "echo_serial 3", "Edit…");
    // A run that begins again has none of what was written.
    let drafts = std::mem::take(&mut harness.state_mut().selection.drafts);
    harness.state_mut().selection.drafts = drafts.after_restart();
    harness.run();
    assert!(harness.query_by_label("New value of .echo_serial").is_some() && !can_undo(&harness));
}

#[test]
fn who_wrote_a_recorded_field_is_found_in_the_recording_and_a_computed_one_in_the_run() {
    let before = |ms: u64| NOW.before_ns(ms * 1_000_000);
    let changed = |run: RunTag, age_ms: u64| FieldSeries {
        field: FieldRef { topic: "/planner/status".to_owned(), path: ".cycle".parse().unwrap() },
        run,
        points: series_of(&Points::new([9_000, age_ms].map(before), [320.0, 321.0])),
        names: Arc::default(),
        states: Arc::default(),
        reading: None,
        problem: None,
    };
    let mut frame = samples::full();
    let mut recorded = frame.topic("/planner/status").unwrap().clone();
    recorded.run = RunTag::Recorded;
    frame.topics = frame.topics.iter().cloned().chain([recorded]).collect();
    frame.fields = Arc::new([changed(RunTag::Recorded, 4_000), changed(RunTag::FIRST, 1_000)]);
    for (run, age_ms) in [(RunChoice::Recorded, 4_000), (RunChoice::Shown, 1_000)] {
        let key = TopicKey { name: "/planner/status".to_owned(), run };
        let mut harness = fields(frame.clone(), key);
        choose(&mut harness, "cycle 321", "Who wrote this");
        let controls = &harness.state().controls;
        let [Control::Pause, Control::Seek(at)] = controls.as_slice() else {
            panic!("{run:?}: {controls:?}")
        };
        assert_eq!(*at, before(age_ms), "{run:?}");
    }
}
