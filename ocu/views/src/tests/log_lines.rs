//! The lines of the text log, as they are scrolled.

use super::{Shown, harness};
use crate::samples;
use egui::{Color32, Event, Shape, Theme, Vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable as _;
use rcs_msg::Stamp;
use rcs_runtime::source::{Control, Event as Line, EventKind, EventLevel, Events, Frame, RunTag};
use std::sync::Arc;

/// A line each second.
fn frame(lines: u64) -> Frame {
    let empty = samples::empty();
    let line = |second: u64| Line {
        stamp: at(&empty, second),
        kind: EventKind::Log,
        level: EventLevel::Info,
        source: "node".into(),
        text: format!("line {second}.").into(),
    };
    let events = Events::of(RunTag::FIRST, (0..lines).map(line));
    Frame { now: at(&empty, 50), events: Arc::new([events]), ..empty }
}

fn at(frame: &Frame, second: u64) -> Stamp {
    frame.info.start.after_ns(second * 1_000_000_000)
}

fn wheel(harness: &mut Harness<'_, Shown>, down: f32) {
    harness.hover_at(egui::Pos2::new(400.0, 300.0));
    harness.run();
    harness.event(Event::MouseWheel {
        unit: egui::MouseWheelUnit::Point,
        delta: Vec2::new(0.0, -down),
        phase: egui::TouchPhase::Move,
        source: egui::MouseWheelSource::Unknown,
        modifiers: egui::Modifiers::NONE,
    });
    harness.run();
}

#[test]
fn the_log_follows_the_viewed_time_until_it_is_scrolled_and_again_at_its_end() {
    let mut harness = harness(Shown::new("log", frame(100)), Vec2::new(900.0, 560.0), Theme::Dark);
    harness.run();
    let sees = |harness: &Harness<'_, Shown>, second: u64| {
        let label = format!("node: line {second}.");
        harness.query_all_by_label_contains(&label).next().is_some()
    };
    let goes_on = |harness: &mut Harness<'_, Shown>, second: u64| {
        let now = at(&harness.state().frame, second);
        harness.state_mut().frame.now = now;
        harness.run();
    };
    assert!(sees(&harness, 50));
    goes_on(&mut harness, 55);
    assert!(sees(&harness, 55), "it follows");
    wheel(&mut harness, -400.0);
    assert!(sees(&harness, 12) && !sees(&harness, 55));
    goes_on(&mut harness, 56);
    assert!(sees(&harness, 12) && !sees(&harness, 56), "it was scrolled");
    wheel(&mut harness, 10_000.0);
    assert!(sees(&harness, 99));
    goes_on(&mut harness, 57);
    assert!(sees(&harness, 57) && !sees(&harness, 99), "it was scrolled to its end");
}

#[test]
fn the_log_follows_the_newest_line_where_several_come_in_one_pass() {
    let whole = frame(100);
    let up_to = |lines: u32| Frame {
        now: at(&whole, lines.into()),
        events: Arc::new([whole.events[0].first(lines as usize)]),
        ..whole.clone()
    };
    let mut harness = harness(Shown::new("log", up_to(60)), Vec2::new(900.0, 560.0), Theme::Dark);
    harness.run();
    for lines in [66, 72, 78, 84, 90] {
        harness.state_mut().frame = up_to(lines);
        harness.step();
    }
    harness.run();
    for second in [89, 85] {
        let label = format!("node: line {second}.");
        assert!(harness.query_all_by_label_contains(&label).next().is_some(), "{label}");
    }
}

#[test]
fn a_click_on_a_line_goes_to_its_time_and_pauses_there() {
    let mut harness = harness(Shown::new("log", frame(100)), Vec2::new(900.0, 560.0), Theme::Dark);
    harness.run();
    harness.get_by_label("node: line 48.").click();
    harness.run();
    let line = at(&harness.state().frame, 48);
    let controls = &harness.state().controls;
    assert!(matches!(controls[..], [Control::Pause, Control::Seek(to)] if to == line), "{controls:?}");
}

#[test]
fn warnings_of_the_future_are_as_dim_as_its_other_lines() {
    let empty = samples::empty();
    let line = |second: u64, text: &str| Line {
        stamp: at(&empty, second),
        kind: EventKind::Log,
        level: EventLevel::Warning,
        source: "node".into(),
        text: text.into(),
    };
    let events = Events::of(RunTag::FIRST, [line(10, "earlier"), line(60, "later")]);
    let frame = Frame { now: at(&empty, 50), events: Arc::new([events]), ..empty };
    let mut harness = harness(Shown::new("log", frame), Vec2::new(900.0, 560.0), Theme::Dark);
    harness.run();
    // Each text with its place from above and its colour; icons are texts, too.
    let painted = harness.output().shapes.iter().filter_map(|painted| {
        let Shape::Text(text) = &painted.shape else { return None };
        let color = text.galley.job.sections.first()?.format.color;
        Some((text.galley.text().to_owned(), text.pos.y, color))
    });
    let painted: Vec<(String, f32, Color32)> = painted.collect();
    let tokens = ocu_ui::tokens_of(Theme::Dark);
    for (line, in_warning) in [("earlier", 2), ("later", 0)] {
        let y = painted.iter().find(|(text, ..)| text == line).unwrap().1;
        let is_warning =
            |(_, at, color): &&(String, f32, Color32)| (at - y).abs() < 9.0 && *color == tokens.warning;
        assert_eq!(painted.iter().filter(is_warning).count(), in_warning, "{line}: {painted:?}");
    }
}

#[test]
fn a_log_without_lines_to_show_names_only_what_was_chosen_or_searched() {
    for (saved, text) in [
        (serde_json::json!({ "alarms": true }), "None of 9 lines is a warning or an error."),
        (serde_json::json!({ "search": "absent" }), "None of 9 lines has the searched words."),
        (
            serde_json::json!({ "hidden": [EventKind::Log.name()], "search": "absent" }),
            "None of 9 lines is of the chosen kinds and has the searched words.",
        ),
    ] {
        let mut shown = Shown::new("log", frame(9));
        shown.view.load(&saved).unwrap();
        let mut harness = harness(shown, Vec2::new(900.0, 560.0), Theme::Dark);
        harness.run();
        assert!(harness.query_by_label(text).is_some(), "{text}");
    }
}
