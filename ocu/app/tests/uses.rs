//! What a user does with the window beyond playing and driving: looking at buffers and events, bookmarks, branches.

#![allow(clippy::unwrap_used, reason = "a test may fail")]

use egui::{Key, Modifiers};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use ocu_app::layout::Layout;
use ocu_app::open::Request;
use ocu_app::window::{Options, Window};
use rcs_runtime::source::{EventKind, Frame};
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Timeout, longer than any step of these tests takes.
const PATIENCE: Duration = Duration::from_mins(1);

/// A stack that expects commands of an operator and needs no other input.
const STACK: &str = r#"
format = 1
name = "hand"
description = "A vehicle interface that waits for an operator."

[[process]]
name = "vehicle_interface"
plugin = "vehicle_interface"
supervisor = "viewer"
inputs = { teleop = "/operator/teleop", emergency_stop = "/operator/emergency_stop" }
"#;

type State = Option<Window>;

fn open<'a>(options: Options) -> Harness<'a, State> {
    let mut options = Some(options);
    let mut harness = Harness::builder().with_size([1280.0, 800.0]).build_ui_state(
        move |ui, state: &mut State| {
            if let Some(window) = state {
                window.ui(ui);
            } else {
                // Fonts are available from the next pass on.
                ocu_ui::install(ui.ctx());
                *state = Some(Window::new(ui.ctx(), options.take().unwrap_or_default()));
                ui.ctx().request_repaint();
            }
        },
        None,
    );
    wait_until(&mut harness, "a frame", |_| true);
    harness
}

fn recording<'a>(dir: &Path, layout: Layout) -> Harness<'a, State> {
    let path = dir.join("drive.mcap");
    ocu_app::sample::write(&path, 3.0, true).unwrap();
    let request = Request { log: Some(path), ..Request::default() };
    open(Options { request, layout: Some(layout), ..Options::default() })
}

fn named(layout: &str) -> Layout {
    Layout::named(layout).unwrap()
}

fn running<'a>(dir: &Path) -> Harness<'a, State> {
    let stack = dir.join("hand.toml");
    std::fs::write(&stack, STACK).unwrap();
    let request = Request { stack: Some(stack.display().to_string()), ..Request::default() };
    let mut harness = open(Options { request, ..Options::default() });
    wait_until(&mut harness, "time to run", |frame| frame.playback.playing && frame.time_s() > 0.2);
    harness
}

fn frame(harness: &Harness<'_, State>) -> Option<Arc<Frame>> {
    harness.state().as_ref()?.frame()
}

/// Runs passes until the frame satisfies a condition, because the source's thread has its own clock.
#[track_caller]
fn wait_until(harness: &mut Harness<'_, State>, what: &str, is: impl Fn(&Frame) -> bool) {
    let start = Instant::now();
    loop {
        harness.step();
        if frame(harness).is_some_and(|frame| is(&frame)) {
            return;
        }
        assert!(start.elapsed() < PATIENCE, "waited in vain for {what}");
        std::thread::yield_now();
    }
}

#[test]
fn a_click_on_a_buffer_shows_its_fields_even_if_no_view_lists_any() {
    let dir = tempfile::tempdir().unwrap();
    for layout in [named("tracks"), Layout::empty()] {
        let mut harness = recording(dir.path(), layout);
        harness.run_steps(3);
        harness.get_by_label("/vehicle/imu").click();
        harness.run_steps(4);
        assert!(harness.query_all_by_label_contains("angular_velocity").next().is_some());
    }
}

#[test]
fn a_branch_is_announced_and_leaving_it_is_asked() {
    let dir = tempfile::tempdir().unwrap();
    let mut harness = running(dir.path());
    harness.key_down(Key::W);
    wait_until(&mut harness, "a write", |frame| frame.runs.all.iter().any(|run| run.writes > 0));
    harness.key_up(Key::W);
    wait_until(&mut harness, "some time", |frame| frame.time_s() > 1.0);
    harness.key_press(Key::Space);
    wait_until(&mut harness, "the pause", |frame| !frame.playback.playing);
    harness.run_steps(2);
    let moment = frame(&harness).unwrap();
    let events = moment.events().unwrap();
    assert!(events.counts()[EventKind::Operator as usize] >= 1, "{:?}", events.counts());
    // To the event before: the start of driving, or the last change of a mode.
    harness.key_press_modifiers(Modifiers::SHIFT, Key::N);
    let from = moment.now;
    wait_until(&mut harness, "an event before", |frame| frame.now < from);
    harness.run_steps(2);
    assert!(harness.query_by_label("PAST").is_some());
    harness.key_press(Key::Space);
    harness.key_down(Key::W);
    wait_until(&mut harness, "another run", |frame| frame.runs.all.len() == 2);
    harness.key_up(Key::W);
    harness.run_steps(3);
    assert!(harness.query_by_label_contains(" begins at 00:00:0").is_some());

    harness.get_by_label("Start again from the beginning").click();
    harness.run_steps(3);
    harness.get_by_label("Stay").click();
    harness.run_steps(3);
    assert!(harness.query_by_label("Stay").is_none());
    assert_eq!(frame(&harness).unwrap().runs.all.len(), 2, "nothing was left");
    harness.get_by_label("Start again from the beginning").click();
    harness.run_steps(3);
    harness.get_by_label_contains("Leave it").click();
    wait_until(&mut harness, "a new run", |frame| frame.runs.all.len() == 1 && frame.playback.playing);
}

#[test]
fn a_bookmark_is_set_by_key_and_kept_beside_the_recording() {
    let dir = tempfile::tempdir().unwrap();
    let mut harness = recording(dir.path(), named("recording"));
    harness.key_press(Key::End);
    wait_until(&mut harness, "the end", |frame| Some(frame.now) == frame.info.end);
    harness.key_press(Key::M);
    harness.run_steps(2);
    let text = std::fs::read_to_string(dir.path().join("drive.mcap.marks.json")).unwrap();
    let end = frame(&harness).unwrap().now.0;
    assert!(text.contains(&end.to_string()), "{text}");
    harness.get_by_label("Bookmarks").click();
    harness.run_steps(3);
    assert!(harness.query_by_label_contains("Remove the bookmark at").is_some());
}

#[test]
fn the_wheel_zooms_the_timeline_and_a_button_shows_the_whole_again() {
    let dir = tempfile::tempdir().unwrap();
    let mut harness = recording(dir.path(), named("recording"));
    harness.run_steps(3);
    assert!(harness.query_by_label("Show the whole time").is_none());
    let bar = harness.get_by_label("Time").rect();
    harness.hover_at(bar.center());
    harness.run_steps(2);
    harness.input_mut().events.push(egui::Event::MouseWheel {
        unit: egui::MouseWheelUnit::Point,
        delta: egui::vec2(0.0, 400.0),
        modifiers: Modifiers::NONE,
        phase: egui::TouchPhase::Move,
        source: egui::MouseWheelSource::Unknown,
    });
    harness.run_steps(12);
    harness.get_by_label("Show the whole time").click();
    harness.run_steps(3);
    assert!(harness.query_by_label("Show the whole time").is_none());
}
