//! What must not keep the emergency stop from stopping the vehicle, and keys that are held when the window gets the focus.

#![allow(clippy::unwrap_used, reason = "a test may fail")]

mod common;

use common::window::{frame, open, running, stack, wait_for, wait_until};
use egui::Key;
use egui_kittest::kittest::Queryable;
use ocu_app::layout::Layout;
use ocu_app::window::Options;
use rcs_msg::rcs;
use rcs_runtime::source::Frame;

/// The speed of the last drive command.
fn commanded_mps(frame: &Frame) -> Option<f64> {
    let command: &rcs::DriveCommand = frame.topic("/operator/teleop")?.get()?;
    Some(command.speed_mps)
}

fn is_stopped(frame: &Frame) -> bool {
    let topic = frame.topic("/vehicle_interface/vehicle");
    let status = topic.and_then(|topic| topic.get::<rcs::VehicleStatus>());
    status.is_some_and(|status| status.emergency_stopped)
}

#[test]
fn an_emergency_stop_releases_what_is_held_and_says_so() {
    let dir = tempfile::tempdir().unwrap();
    let text =
        r#"Layout(version: 1, name: "own", buffers: false, root: Row([(1.0, View(kind: "hierarchy"))]))"#;
    let layout = Some(Layout::parse("own.ron", text).unwrap());
    let mut harness = open(Options { request: stack(dir.path()), layout, ..Options::default() });
    wait_until(&mut harness, "time to run", |frame| frame.playback.playing && frame.time_s() > 0.2);
    harness.get_by_label_contains("Process vehicle_interface").click_secondary();
    harness.run_steps(6);
    harness.get_by_label_contains("Fault on demand").click();
    harness.run_steps(6);
    harness.get_by_label("Frozen").click();
    wait_until(&mut harness, "the fault", |frame| !ocu_views::edit::held(frame).is_empty());
    harness.key_press(Key::Escape);
    wait_until(&mut harness, "the vehicle's word", is_stopped);
    assert!(ocu_views::edit::held(&frame(&harness).unwrap()).is_empty());
    wait_for(&mut harness, "the message", |harness| {
        harness
            .query_by_label_contains("the emergency stop releases what is held: vehicle_interface")
            .is_some()
    });
}

#[test]
fn a_drive_key_that_is_held_when_the_window_gets_the_focus_drives_only_after_it_was_let_go() {
    let dir = tempfile::tempdir().unwrap();
    let mut harness = running(dir.path());
    harness.event(egui::Event::WindowFocused(false));
    harness.event(egui::Event::WindowFocused(true));
    // The first repeat that this window is told.
    harness.key_down(Key::W);
    harness.run_steps(2);
    let from_s = frame(&harness).unwrap().time_s();
    wait_until(&mut harness, "a while", |frame| frame.time_s() > from_s + 0.5);
    assert_eq!(commanded_mps(&frame(&harness).unwrap()), None);
    harness.key_up(Key::W);
    harness.run_steps(4);
    harness.key_down(Key::W);
    wait_until(&mut harness, "forward", |frame| commanded_mps(frame) == Some(1.0));
}
