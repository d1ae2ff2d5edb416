//! The complete window on the whole stack, click by click, without a clock: a cell is inspected, a weight is changed and
//! sent, the past is branched twice, and a kept run goes on; a goal is sent, and the vehicle is stopped. Each step looks
//! as in its picture.

#![allow(clippy::unwrap_used, reason = "a test may fail")]

mod common;

use common::window::{State, frame, open, type_number, wait_until};
use egui::accesskit::Role;
use egui::{Event, Key, Modifiers, PointerButton, Pos2, Vec2};
use egui_kittest::kittest::Queryable;
use egui_kittest::{Harness, SnapshotOptions, SnapshotResults};
use ocu_app::layout::Layout;
use ocu_app::open::Request;
use ocu_app::window::Options;
use rcs_msg::rcs::Mission;
use rcs_runtime::source::Frame;

/// A robot before a course, three seconds after its first pictures, with the layout of whom tunes a map.
fn three_seconds() -> Harness<'static, State> {
    let (stack, course) = (Some("lagr".to_owned()), Some("mulch_path".to_owned()));
    let layout = Some(Layout::named("world_model").unwrap());
    let request = Request { stack, course, ..Request::default() };
    let mut harness = open(Options { request, layout, ..Options::default() });
    // A stack that waits shows its first pictures.
    wait_until(&mut harness, "the first pictures", |frame| frame.time_s() > 0.0);
    for _ in 0..3 {
        step(&mut harness, Key::Period, 1.0);
    }
    // On a computer that other work slows down, the message has gone by itself.
    harness.query_all_by_label("Dismiss").for_each(|dismiss| dismiss.click());
    harness.run_steps(2);
    harness
}

/// Steps by a key, and waits until the time has changed by so much.
fn step(harness: &mut Harness<'_, State>, key: Key, by_s: f64) {
    let to_s = frame(harness).unwrap().time_s() + by_s;
    harness.key_press(key);
    wait_until(harness, "the step", |frame| (frame.time_s() - to_s).abs() < 1e-6);
    harness.run_steps(3);
}

/// The place of the map, a little beside its middle.
fn on_map(harness: &Harness<'_, State>) -> Pos2 {
    harness.get_by_role_and_label(Role::Image, "Map").rect().center() + Vec2::new(60.0, -70.0)
}

/// Compares the window with a picture, once what the source computes again is there, and without messages that go by
/// themselves. Pictures within it are made in the pass that shows them, because no threads are started for them.
fn compare(harness: &mut Harness<'_, State>, results: &mut SnapshotResults, name: &str) {
    harness.query_all_by_label("Dismiss").for_each(|dismiss| dismiss.click());
    wait_until(harness, "the past", |frame| {
        frame.runs.filling.is_none() && frame.topics.iter().all(|topic| !topic.pending)
    });
    harness.run_steps(16);
    harness.snapshot_options(name, &SnapshotOptions::new().threshold(1.6).max_failed_pixels(200_usize));
    results.extend(harness.take_snapshot_results());
}

/// The weight of stereo with which the map is made.
fn weight(frame: &Frame) -> f64 {
    let params = frame.topic("/wm1/params").unwrap().canonical().unwrap().value().unwrap();
    let stereo = params.field("sources").unwrap().item(0).unwrap().into_owned();
    stereo.field("weight").unwrap().as_f64().unwrap()
}

#[test]
fn a_cell_leads_to_its_message_and_a_weight_is_changed_in_two_branches() {
    let mut results = SnapshotResults::new();
    let mut harness = three_seconds();
    let end = frame(&harness).unwrap().now;

    // A cell in the past, and the message of stereo that made it.
    step(&mut harness, Key::Comma, -1.0);
    let place = on_map(&harness);
    harness.hover_at(place);
    harness.run_steps(3);
    harness.drag_at(place);
    harness.drop_at(place);
    harness.run_steps(3);
    compare(&mut harness, &mut results, "walk_1_cell");
    let from = frame(&harness).unwrap().now;
    harness.get_by_label_contains("of stereo, which made this cell").click();
    wait_until(&mut harness, "that message", |frame| frame.now < from);
    harness.run_steps(3);
    compare(&mut harness, &mut results, "walk_2_message_of_the_cell");
    harness.get_by_label("Close the cell").click();
    harness.run_steps(3);

    // A weight, seen before it is sent.
    harness.key_press(Key::End);
    wait_until(&mut harness, "the end", |frame| frame.now == end);
    step(&mut harness, Key::Comma, -1.0);
    type_number(&mut harness, "sources[0].weight", "0");
    compare(&mut harness, &mut results, "walk_3_weight_previewed");
    assert_eq!(weight(&frame(&harness).unwrap()), 1.0, "it is not sent");

    // Sent in the past it begins another run, and a second one.
    for (count, text) in [(2, "0"), (3, "0.5")] {
        if count == 3 {
            step(&mut harness, Key::Comma, -1.0);
            type_number(&mut harness, "sources[0].weight", text);
        }
        harness.get_by_label_contains("Send 1").click();
        wait_until(&mut harness, "another run", |frame| frame.runs.all.len() == count);
        harness.run_steps(2);
        let said = format!("run {} begins at 00:00:02.600", count - 1);
        assert!(harness.query_by_label_contains(&said).is_some());
        step(&mut harness, Key::Period, 1.0);
        assert_eq!(weight(&frame(&harness).unwrap()), text.parse::<f64>().unwrap());
        compare(&mut harness, &mut results, &format!("walk_{}_run_{}", count + 2, count - 1));
    }

    // The first run is as it was, and goes on.
    harness.get_by_label("run 2").click();
    harness.run_steps(3);
    harness.get_by_label_contains("run 0, up to").click();
    wait_until(&mut harness, "the first run", |frame| weight(frame) == 1.0);
    step(&mut harness, Key::Comma, -1.0);
    harness.key_press(Key::Space);
    wait_until(&mut harness, "more than was driven", |frame| frame.now > end.after_ns(300_000_000));
    harness.key_press(Key::Space);
    wait_until(&mut harness, "the pause", |frame| !frame.playback.playing);
    let frame = frame(&harness).unwrap();
    assert_eq!((weight(&frame), frame.runs.all.len()), (1.0, 3), "no run was begun or lost");
}

#[test]
fn a_goal_is_sent_from_the_map_and_the_stop_has_three_looks() {
    let mut results = SnapshotResults::new();
    let mut harness = three_seconds();
    let place = on_map(&harness);
    harness.hover_at(place);
    harness.run_steps(2);
    for pressed in [true, false] {
        let (button, modifiers) = (PointerButton::Secondary, Modifiers::NONE);
        harness.event(Event::PointerButton { pos: place, button, pressed, modifiers });
        harness.run_steps(2);
    }
    compare(&mut harness, &mut results, "walk_6_menu_of_the_map");
    harness.get_by_label_contains("Drive here").click();
    harness.run_steps(2);
    step(&mut harness, Key::Period, 1.0);
    let mission = frame(&harness).unwrap();
    let mission = mission.topic("/operator/mission").unwrap().get::<Mission>().unwrap().clone();
    assert_eq!((mission.goals.len(), mission.keep_out.len()), (1, 0));
    compare(&mut harness, &mut results, "walk_7_goal");

    // While time stands, the vehicle confirms nothing.
    harness.key_press(Key::Escape);
    harness.run_steps(4);
    assert!(harness.query_by_label("Emergency stop: STOPPING…").is_some());
    compare(&mut harness, &mut results, "walk_8_stop_pressed");
    step(&mut harness, Key::Period, 1.0);
    assert!(harness.query_by_label("Emergency stop: STOPPED").is_some());
    compare(&mut harness, &mut results, "walk_9_stopped");
}
