//! Manual driving, the emergency stop and alarms in the complete window, without a display.

#![allow(clippy::unwrap_used, reason = "a test may fail")]

mod common;

use common::window::{State, frame, open, running, wait_for, wait_until, writes};
use egui::Key;
use egui_kittest::Harness;
use egui_kittest::kittest::{NodeT, Queryable};
use ocu_app::layout::Layout;
use ocu_app::open::Request;
use ocu_app::window::Options;
use rcs_msg::rcs;
use rcs_runtime::source::Frame;
use std::path::Path;

/// The last drive command: speed and turn rate.
fn command(frame: &Frame) -> Option<[f64; 2]> {
    let command: &rcs::DriveCommand = frame.topic("/operator/teleop")?.get()?;
    Some([command.speed_mps, command.yaw_rate_radps?])
}

fn vehicle(frame: &Frame) -> Option<&rcs::VehicleStatus> {
    frame.topic("/vehicle_interface/vehicle")?.get()
}

#[test]
fn keys_drive_while_they_are_held_and_the_vehicle_stands_when_they_are_let_go() {
    let dir = tempfile::tempdir().unwrap();
    let mut harness = running(dir.path());
    harness.key_down(Key::W);
    wait_until(&mut harness, "forward", |frame| command(frame) == Some([1.0, 0.0]));
    wait_until(&mut harness, "the vehicle to obey", |frame| {
        vehicle(frame).is_some_and(|vehicle| vehicle.wanted_speed_mps == 1.0 && !vehicle.stopped)
    });
    harness.key_down(Key::A);
    wait_until(&mut harness, "a turn to the left", |frame| {
        command(frame).is_some_and(|[_, turn]| turn > 0.5)
    });
    harness.key_up(Key::A);
    harness.key_up(Key::W);
    wait_until(&mut harness, "a last command", |frame| command(frame) == Some([0.0, 0.0]));
    wait_until(&mut harness, "the vehicle to stand", |frame| {
        vehicle(frame).is_some_and(|vehicle| vehicle.left_command_mps == 0.0 && vehicle.refused == 0)
    });
    assert!(frame(&harness).unwrap().playback.playing);
}

#[test]
fn an_arrow_steps_and_never_drives() {
    let dir = tempfile::tempdir().unwrap();
    let mut harness = running(dir.path());
    harness.key_down(Key::ArrowUp);
    harness.key_press(Key::ArrowRight);
    wait_until(&mut harness, "the step, which pauses", |frame| !frame.playback.playing);
    harness.run_steps(5);
    assert_eq!(command(&frame(&harness).unwrap()), None);
}

#[test]
fn looking_back_with_a_drive_key_held_writes_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let mut harness = running(dir.path());
    wait_until(&mut harness, "some time", |frame| frame.time_s() > 3.0);
    harness.key_down(Key::W);
    wait_until(&mut harness, "forward", |frame| command(frame) == Some([1.0, 0.0]));
    let end = frame(&harness).unwrap().now;
    harness.key_press(Key::ArrowLeft);
    wait_until(&mut harness, "the step, which pauses", |frame| !frame.playback.playing);
    harness.run_steps(5);
    look_back(&mut harness);
    assert_eq!(frame(&harness).unwrap().runs.all.len(), 1, "a step back");

    // Nor does playing the past with the key still held. Pressed again, it drives from there.
    harness.key_press(Key::Space);
    wait_until(&mut harness, "time to run", |frame| frame.playback.playing && frame.time_s() > 0.5);
    assert_eq!(frame(&harness).unwrap().runs.all.len(), 1, "the past plays");
    harness.key_up(Key::W);
    harness.run_steps(3);
    harness.key_down(Key::W);
    wait_until(&mut harness, "another run", |frame| frame.runs.all.len() == 2);
    assert!(frame(&harness).unwrap().runs.all[1].branched_from.unwrap().1 < end);

    wait_until(&mut harness, "a second of it", |frame| frame.runs.is_at_end && frame.time_s() > 1.5);
    harness.key_press(Key::Home);
    wait_until(&mut harness, "the past", |frame| frame.time_s() < 1.0);
    harness.run_steps(5);
    harness.key_up(Key::W);
    harness.run_steps(5);
    harness.key_press(Key::Space);
    wait_until(&mut harness, "the pause", |frame| !frame.playback.playing);
    look_back(&mut harness);
    assert_eq!(frame(&harness).unwrap().runs.all.len(), 2, "a jump back while it plays");
}

#[test]
fn a_condition_that_stops_while_a_drive_key_is_held_shows_the_run_that_was_driven() {
    let dir = tempfile::tempdir().unwrap();
    let state = r#"{ "conditions": [{ "formula": "/operator/teleop.speed_mps > 0.5", "stops": true }] }"#;
    let view = format!("View(kind: \"conditions\", state: {state})");
    let text = format!("Layout(version: 1, name: \"stop\", buffers: false, root: Row([(1.0, {view})]))");
    let layout = Some(Layout::parse("stop.ron", &text).unwrap());
    let request = common::window::stack(dir.path());
    let mut harness = open(Options { request, layout, ..Options::default() });
    wait_until(&mut harness, "time to run", |frame| frame.playback.playing && frame.time_s() > 0.2);
    harness.key_down(Key::W);
    wait_until(&mut harness, "the stop", |frame| !frame.playback.playing);
    harness.run_steps(5);
    harness.key_up(Key::W);
    harness.run_steps(5);
    look_back(&mut harness);
    assert_eq!(frame(&harness).unwrap().runs.all.len(), 1);
}

#[test]
fn a_release_starts_no_motion_while_a_key_is_held() {
    let dir = tempfile::tempdir().unwrap();
    let mut harness = running(dir.path());
    harness.key_down(Key::W);
    wait_until(&mut harness, "forward", |frame| command(frame) == Some([1.0, 0.0]));
    harness.key_press(Key::Escape);
    wait_until(&mut harness, "the vehicle's word", |frame| {
        vehicle(frame).is_some_and(|vehicle| vehicle.emergency_stopped)
    });
    wait_until(&mut harness, "a last command", |frame| command(frame) == Some([0.0, 0.0]));
    harness.run_steps(3);
    // W is still held: the button says why it does nothing.
    let release = harness.get_by_label("Release");
    assert!(release.accesskit_node().is_disabled());
    release.click();
    harness.run_steps(5);
    assert!(vehicle(&frame(&harness).unwrap()).unwrap().emergency_stopped);
    harness.key_up(Key::W);
    harness.run_steps(3);
    harness.get_by_label("Release").click();
    // Pressed again before the vehicle confirms: it must be let go once more.
    harness.key_down(Key::W);
    wait_until(&mut harness, "the release", |frame| {
        vehicle(frame).is_some_and(|vehicle| !vehicle.emergency_stopped)
    });
    let released_s = frame(&harness).unwrap().time_s();
    wait_until(&mut harness, "a while", |frame| frame.time_s() > released_s + 0.5);
    assert_eq!(command(&frame(&harness).unwrap()), Some([0.0, 0.0]), "a held key drives nothing");
    harness.key_up(Key::W);
    harness.run_steps(3);
    harness.key_down(Key::W);
    wait_until(&mut harness, "forward again", |frame| command(frame) == Some([1.0, 0.0]));
}

#[test]
fn escape_stops_and_cancels_nothing_where_a_vehicle_can_be_stopped() {
    let dir = tempfile::tempdir().unwrap();
    let mut harness = running(dir.path());
    harness.get_by_label("Buffers").click();
    harness.step();
    harness.get_by_label("Search buffers").focus();
    harness.step();
    harness.get_by_label("Search buffers").type_text("vehicle");
    harness.run_steps(3);
    harness.key_press(Key::Escape);
    wait_until(&mut harness, "the vehicle's word", |frame| {
        vehicle(frame).is_some_and(|vehicle| vehicle.emergency_stopped)
    });
    harness.run_steps(2);
    let field = harness.get_by_label("Search buffers");
    assert_eq!(field.accesskit_node().value().as_deref(), Some("vehicle"), "the search is as it was");
    assert!(field.accesskit_node().is_focused());
    // The palette opens, and Escape does not close it; its own key does.
    harness.key_press_modifiers(egui::Modifiers::COMMAND, Key::K);
    harness.run_steps(2);
    harness.key_press(Key::Escape);
    harness.run_steps(2);
    assert!(harness.query_by_label("Find a command").is_some());
    harness.key_press_modifiers(egui::Modifiers::COMMAND, Key::Period);
    harness.run_steps(2);
    assert!(harness.query_by_label("Find a command").is_none());
}

#[test]
fn the_place_of_the_stop_does_not_change_with_its_state() {
    let dir = tempfile::tempdir().unwrap();
    let mut harness = running(dir.path());
    let clear = harness.get_by_label("Emergency stop: STOP").rect();
    harness.key_press(Key::Escape);
    wait_until(&mut harness, "the vehicle's word", |frame| {
        vehicle(frame).is_some_and(|vehicle| vehicle.emergency_stopped)
    });
    harness.run_steps(2);
    assert_eq!(harness.get_by_label("Emergency stop: STOPPED").rect(), clear);
}

#[test]
fn keys_drive_nothing_while_a_text_is_typed_or_time_stands() {
    let dir = tempfile::tempdir().unwrap();
    let mut harness = running(dir.path());
    harness.get_by_label("Buffers").click();
    harness.step();
    harness.get_by_label("Search buffers").focus();
    harness.step();
    harness.key_down(Key::W);
    wait_until(&mut harness, "a while", |frame| frame.time_s() > 1.0);
    assert_eq!(command(&frame(&harness).unwrap()), None);
    harness.key_up(Key::W);

    harness.get_by_label("Search buffers").type_text("vehicle_interface");
    harness.key_press(Key::Tab);
    harness.get_by_label("Pause").click();
    wait_until(&mut harness, "the pause", |frame| !frame.playback.playing);
    harness.key_down(Key::S);
    for _ in 0..20 {
        harness.step();
    }
    assert_eq!(command(&frame(&harness).unwrap()), None);
}

#[test]
fn keys_drive_and_step_nothing_while_a_menu_or_a_dialog_with_a_text_field_is_open() {
    let dir = tempfile::tempdir().unwrap();
    let mut harness = running(dir.path());
    let palette = (Some(Key::K), "Find a command", "xyzzy");
    let dialog = (Some(Key::O), "Path", " ");
    for (key, label, refused) in [palette, dialog, (None, "Name of the layout", "recording")] {
        match key {
            Some(key) => harness.key_press_modifiers(egui::Modifiers::COMMAND, key),
            None => harness.get_by_label("Layout").click(),
        }
        harness.run_steps(3);
        keys_do_nothing(&mut harness, &format!("{label}, just opened"));
        common::window::type_text(&mut harness, label, refused);
        harness.key_press(Key::Enter);
        harness.run_steps(3);
        let field = harness.get_by_label(label);
        assert!(field.accesskit_node().is_focused(), "{label}");
        assert_eq!(field.value().as_deref(), Some(refused), "{label}");
        keys_do_nothing(&mut harness, label);
        harness.key_press_modifiers(egui::Modifiers::COMMAND, Key::Period);
        harness.run_steps(3);
        assert!(harness.query_by_label(label).is_none(), "{label} is closed");
    }
    harness.key_down(Key::A);
    wait_until(&mut harness, "a turn to the left", |frame| {
        command(frame).is_some_and(|[_, turn]| turn > 0.0)
    });
}

/// Holds a key that drives, presses one that steps, and looks whether they did anything.
fn keys_do_nothing(harness: &mut Harness<'_, State>, when: &str) {
    harness.key_down(Key::A);
    harness.key_press(Key::Period);
    harness.run_steps(2);
    let from_s = frame(harness).unwrap().time_s();
    wait_until(harness, "a while", |frame| !frame.playback.playing || frame.time_s() > from_s + 0.3);
    let now = frame(harness).unwrap();
    assert!(now.playback.playing, "{when}: it steps, which pauses");
    assert_eq!(command(&now), None, "{when}");
    harness.key_up(Key::A);
    harness.run_steps(2);
}

#[test]
fn a_key_that_is_still_down_when_a_text_or_a_modifier_is_left_drives_only_after_it_was_let_go() {
    let dir = tempfile::tempdir().unwrap();
    let mut harness = running(dir.path());
    harness.get_by_label("Buffers").click();
    harness.step();
    harness.get_by_label("Search buffers").focus();
    harness.run_steps(2);
    harness.key_down(Key::D);
    harness.run_steps(2);
    harness.key_press(Key::Enter);
    harness.run_steps(2);
    assert!(!harness.get_by_label("Search buffers").accesskit_node().is_focused());
    let left_s = frame(&harness).unwrap().time_s();
    wait_until(&mut harness, "a while", |frame| frame.time_s() > left_s + 0.5);
    assert_eq!(command(&frame(&harness).unwrap()), None, "after a text");
    harness.key_up(Key::D);

    harness.event(egui::Event::ModifiersChanged(egui::Modifiers::COMMAND));
    harness.key_down(Key::A);
    harness.event(egui::Event::ModifiersChanged(egui::Modifiers::NONE));
    harness.run_steps(2);
    let left_s = frame(&harness).unwrap().time_s();
    wait_until(&mut harness, "a while", |frame| frame.time_s() > left_s + 0.5);
    assert_eq!(command(&frame(&harness).unwrap()), None, "after a modifier");
    harness.key_up(Key::A);
    harness.run_steps(2);
    harness.key_down(Key::D);
    wait_until(&mut harness, "a turn to the right", |frame| {
        command(frame).is_some_and(|[_, turn]| turn < 0.0)
    });
}

#[test]
fn an_emergency_stop_is_confirmed_by_the_vehicle_and_released_by_a_second_action() {
    let dir = tempfile::tempdir().unwrap();
    let mut harness = running(dir.path());
    assert!(harness.query_by_label("Emergency stop: STOP").is_some());
    harness.key_press(Key::Escape);
    wait_until(&mut harness, "the vehicle's word", |frame| {
        vehicle(frame).is_some_and(|vehicle| vehicle.emergency_stopped)
    });
    harness.step();
    assert!(harness.query_by_label("Emergency stop: STOPPED").is_some());
    harness.key_press(Key::Escape);
    harness.get_by_label("Emergency stop: STOPPED").click();
    wait_until(&mut harness, "a while", |frame| frame.time_s() > 1.5);
    assert!(
        vehicle(&frame(&harness).unwrap()).unwrap().emergency_stopped,
        "the same action releases nothing"
    );
    harness.get_by_label("Release").click();
    wait_until(&mut harness, "the release", |frame| {
        vehicle(frame).is_some_and(|vehicle| !vehicle.emergency_stopped)
    });
    harness.step();
    assert!(harness.query_by_label("Emergency stop: STOP").is_some());
}

#[test]
fn a_stop_that_is_not_confirmed_is_never_shown_as_one() {
    let dir = tempfile::tempdir().unwrap();
    let mut harness = running(dir.path());
    harness.get_by_label("Pause").click();
    wait_until(&mut harness, "the pause", |frame| !frame.playback.playing);
    harness.get_by_label("Emergency stop: STOP").click();
    harness.run_steps(10);
    let at = harness.get_by_label("Emergency stop: STOPPING…").rect().center();
    harness.hover_at(at);
    harness.run_steps(10);
    assert!(harness.query_by_label_contains("takes effect when time goes on (space)").is_some());
    harness.get_by_label("Play").click();
    wait_until(&mut harness, "the vehicle's word", |frame| {
        vehicle(frame).is_some_and(|vehicle| vehicle.emergency_stopped)
    });
}

#[test]
fn a_stop_while_a_release_is_under_way_is_confirmed_by_no_report_of_before() {
    let dir = tempfile::tempdir().unwrap();
    let mut harness = running(dir.path());
    harness.key_press(Key::Escape);
    wait_until(&mut harness, "the vehicle's word", |frame| {
        vehicle(frame).is_some_and(|vehicle| vehicle.emergency_stopped)
    });
    harness.get_by_label("Pause").click();
    wait_until(&mut harness, "the pause", |frame| !frame.playback.playing);
    harness.run_steps(2);
    harness.get_by_label("Release").click();
    harness.run_steps(3);
    harness.key_press(Key::Escape);
    harness.run_steps(3);
    assert!(harness.query_by_label("Emergency stop: STOPPING…").is_some(), "the last report is an old one");
    harness.get_by_label("Play").click();
    wait_for(&mut harness, "a newer report", |harness| {
        harness.query_by_label("Emergency stop: STOPPED").is_some()
    });
}

/// The window on a run of two seconds, which is paused at its end.
fn paused_at_two_seconds(dir: &Path) -> Harness<'static, State> {
    let mut harness = running(dir);
    wait_until(&mut harness, "two seconds", |frame| frame.time_s() > 2.0);
    harness.key_press(Key::Space);
    wait_until(&mut harness, "the pause", |frame| !frame.playback.playing);
    harness.run_steps(2);
    harness
}

/// Goes to the start.
fn look_back(harness: &mut Harness<'_, State>) {
    harness.key_press(Key::Home);
    wait_until(harness, "the start", |frame| frame.time_s() < 0.1);
    harness.run_steps(2);
}

fn is_stopped(frame: &Frame) -> bool {
    vehicle(frame).is_some_and(|vehicle| vehicle.emergency_stopped)
}

#[test]
fn a_stop_at_the_end_belongs_to_its_moment_and_looking_back_writes_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let mut harness = paused_at_two_seconds(dir.path());
    let pressed = frame(&harness).unwrap().now;
    harness.key_press(Key::Escape);
    wait_until(&mut harness, "the stop in the run", |frame| writes(frame) == 1);
    harness.run_steps(2);
    assert!(harness.query_by_label("Emergency stop: STOPPING…").is_some());

    look_back(&mut harness);
    assert!(harness.query_by_label("Emergency stop: STOP").is_some(), "nothing was pressed at this moment");
    harness.key_press(Key::End);
    wait_until(&mut harness, "the end", |frame| frame.runs.is_at_end);
    harness.run_steps(2);
    assert!(harness.query_by_label("Emergency stop: STOPPING…").is_some());

    look_back(&mut harness);
    harness.key_press(Key::Space);
    wait_until(&mut harness, "a second of the past", |frame| frame.time_s() > 1.0);
    let past = frame(&harness).unwrap();
    assert_eq!((past.runs.all.len(), writes(&past)), (1, 1));
    wait_until(&mut harness, "the vehicle's word", is_stopped);
    let stopped = frame(&harness).unwrap();
    assert!(stopped.now >= pressed, "stopped at {}, before the press at {pressed}", stopped.now);
    assert_eq!(stopped.runs.all.len(), 1, "no run was begun");
    harness.step();
    assert!(harness.query_by_label("Emergency stop: STOPPED").is_some());
}

#[test]
fn a_stop_while_the_past_plays_begins_another_run_in_which_it_is_confirmed() {
    let dir = tempfile::tempdir().unwrap();
    let mut harness = paused_at_two_seconds(dir.path());
    look_back(&mut harness);
    harness.key_press(Key::Space);
    wait_until(&mut harness, "time to run", |frame| frame.playback.playing);
    harness.key_press(Key::Escape);
    wait_until(&mut harness, "another run", |frame| frame.runs.all.len() == 2);
    wait_until(&mut harness, "the vehicle's word", is_stopped);
    let stopped = frame(&harness).unwrap();
    assert_eq!((stopped.runs.current().0, stopped.runs.all.len()), (1, 2));
    harness.step();
    assert!(harness.query_by_label("Emergency stop: STOPPED").is_some());
}

#[test]
fn a_stop_that_is_taken_back_before_it_takes_effect_is_not_sent_again() {
    let dir = tempfile::tempdir().unwrap();
    let mut harness = paused_at_two_seconds(dir.path());
    harness.key_press(Key::Escape);
    wait_until(&mut harness, "the stop in the run", |frame| writes(frame) == 1);
    harness.run_steps(2);
    harness.get_by_label("run 0").click();
    harness.run_steps(3);
    harness.get_by_label("Take the last write back").click();
    wait_until(&mut harness, "the run without it", |frame| frame.runs.all.len() == 2);
    harness.run_steps(2);
    assert!(harness.query_by_label("Emergency stop: STOP").is_some());
    let from_s = frame(&harness).unwrap().time_s();
    harness.get_by_label("Play").click();
    wait_until(&mut harness, "more than the time until it is repeated", |frame| {
        frame.time_s() > from_s + 1.0
    });
    let moved_on = frame(&harness).unwrap();
    assert!(!is_stopped(&moved_on));
    assert_eq!(moved_on.runs.all.len(), 2);
}

/// A stack in which one process fails soon after the start: no way is wide enough for it.
const FAILING: &str = r#"
format = 1
name = "failing"
description = "A driver that is too wide for its course, beside a vehicle interface that waits for an operator."
course = "corridor"

[[process]]
name = "vehicle_interface"
plugin = "vehicle_interface"
supervisor = "viewer"
inputs = { teleop = "/operator/teleop", emergency_stop = "/operator/emergency_stop" }

# Before the simulator, so that it has no inputs in its first cycle.
[[process]]
name = "truth_driver"
plugin = "truth_driver"
supervisor = "viewer"
inputs = { ground_truth_pose = "/vehicle/ground_truth_pose", ground_truth_map = "/vehicle/ground_truth_map", goal = "/vehicle/goal" }
params = { vehicle_width_m = 5.0 }

[[process]]
name = "vehicle"
plugin = "sim_vehicle"
supervisor = "viewer"
"#;

#[test]
fn an_alarm_of_another_run_is_shown_after_that_of_the_first_one_was_acknowledged() {
    let dir = tempfile::tempdir().unwrap();
    let stack = dir.path().join("failing.toml");
    std::fs::write(&stack, FAILING).unwrap();
    let request = Request { stack: Some(stack.display().to_string()), ..Request::default() };
    let mut harness = open(Options { request, layout: Some(Layout::empty()), ..Options::default() });
    let has_alarm = |harness: &Harness<'_, State>| harness.query_by_label("1 alarm").is_some();
    wait_for(&mut harness, "the alarm", has_alarm);
    wait_until(&mut harness, "some time", |frame| frame.time_s() > 0.5);
    harness.key_press(Key::Space);
    wait_until(&mut harness, "the pause", |frame| !frame.playback.playing);
    harness.run_steps(2);
    harness.get_by_label("1 alarm").click();
    harness.run_steps(3);
    harness.get_by_label("Acknowledge all").click();
    harness.run_steps(3);
    assert!(!has_alarm(&harness));

    look_back(&mut harness);
    harness.key_press(Key::Escape);
    wait_until(&mut harness, "another run", |frame| frame.runs.all.len() == 2);
    assert!(!has_alarm(&harness), "it has not failed yet");
    harness.key_press(Key::Space);
    wait_for(&mut harness, "the alarm of this run", has_alarm);
}

#[test]
fn a_run_can_be_started_again_slowed_and_gone_back_in() {
    let dir = tempfile::tempdir().unwrap();
    let mut harness = running(dir.path());
    wait_until(&mut harness, "some time", |frame| frame.time_s() > 2.0);
    harness.get_by_label("Pause").click();
    wait_until(&mut harness, "the pause", |frame| !frame.playback.playing);
    harness.key_press(Key::Comma);
    let paused_s = frame(&harness).unwrap().time_s();
    wait_until(&mut harness, "a second back", |frame| frame.time_s() < paused_s - 0.9);
    harness.get_by_label("Start again from the beginning").click();
    // The paused one would have gone on from where it stands.
    wait_until(&mut harness, "a new run", |frame| frame.playback.playing);
    let frame = frame(&harness).unwrap();
    assert!(frame.playback.from.seconds_since(frame.info.start) < 0.5, "{:?}", frame.playback);
}

/// A vehicle interface below a supervisor, which commands it with serials of its own.
const SUPERVISED: &str = r#"
format = 1
name = "supervised"
description = "A vehicle interface that waits for an operator, below a supervisor."

[[process]]
name = "robot"
plugin = "supervisor"
supervisor = "viewer"

[[process]]
name = "vehicle_interface"
plugin = "vehicle_interface"
supervisor = "robot"
as = "vehicle_interface"
inputs = { teleop = "/operator/teleop", emergency_stop = "/operator/emergency_stop" }
"#;

/// The window on a stack, with nothing but its hierarchy.
fn hierarchy_of(request: Request) -> Harness<'static, State> {
    let text =
        r#"Layout(version: 1, name: "own", buffers: false, root: Row([(1.0, View(kind: "hierarchy"))]))"#;
    let layout = Some(Layout::parse("own.ron", text).unwrap());
    open(Options { request, layout, ..Options::default() })
}

/// Opens the menu of the vehicle interface's box.
fn open_menu(harness: &mut Harness<'_, State>) {
    harness.get_by_label_contains("Process vehicle_interface").click_secondary();
    harness.run_steps(6);
}

/// Waits until the vehicle interface obeys this command of this commander.
#[track_caller]
fn wait_until_it_obeys(harness: &mut Harness<'_, State>, command: &str, commander: &str) {
    wait_until(harness, command, |frame| {
        let process = frame.processes.iter().find(|process| process.name == "vehicle_interface");
        let status = process.and_then(|process| frame.status(process));
        status.is_some_and(|status| (&*status.command, &*status.commander) == (command, commander))
    });
}

#[test]
fn a_halt_from_the_menu_is_obeyed_again_after_a_release() {
    let dir = tempfile::tempdir().unwrap();
    let stack = dir.path().join("supervised.toml");
    std::fs::write(&stack, SUPERVISED).unwrap();
    let request = Request { stack: Some(stack.display().to_string()), ..Request::default() };
    let mut harness = hierarchy_of(request);
    for _ in 0..2 {
        wait_until_it_obeys(&mut harness, "RUN", "robot");
        open_menu(&mut harness);
        harness.get_by_role_and_label(egui::accesskit::Role::Button, "HALT").click();
        wait_until_it_obeys(&mut harness, "HALT", "operator");
        open_menu(&mut harness);
        harness.get_by_role_and_label(egui::accesskit::Role::Button, "RELEASE").click();
    }
}

#[test]
fn a_process_that_posts_no_status_any_more_is_counted_in_the_bar_at_the_top() {
    let dir = tempfile::tempdir().unwrap();
    let mut harness = hierarchy_of(common::window::stack(dir.path()));
    // Beside other items the bar has a short form.
    let says = |harness: &Harness<'_, State>, word: &str| {
        ["1 of 1", "1/1"].iter().any(|count| harness.query_by_label(&format!("{count} {word}")).is_some())
    };
    wait_for(&mut harness, "the start", |harness| says(harness, "EXEC"));
    open_menu(&mut harness);
    harness.get_by_label_contains("Fault on demand").click();
    harness.run_steps(6);
    harness.get_by_label("Stopped").click();
    wait_for(&mut harness, "the silence", |harness| says(harness, "NO STATUS"));
    assert!(!says(&harness, "EXEC"));
}
