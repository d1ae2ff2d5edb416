//! Snapshot images of the views, rendered by the software Vulkan driver.

use super::behaviour::map_of_a_vehicle_at;
use super::{Shown, harness};
use crate::samples;
use egui::{Theme, Vec2};
use egui_kittest::kittest::Queryable as _;
use egui_kittest::{Harness, SnapshotOptions};
use rcs_runtime::source::Frame;

/// Tolerates differences of anti-aliasing between drivers, but no moved shape.
const THRESHOLD: f32 = 1.6;

/// Compares what is shown with the stored picture of this name.
pub(super) fn compare_picture(mut harness: Harness<'static, Shown>, name: &str) {
    let options = SnapshotOptions::new().threshold(THRESHOLD).max_failed_pixels(24_usize);
    harness.snapshot_options(name, &options);
}

fn check(kind: &str, theme: Theme) {
    check_frame(kind, samples::full(), kind, theme);
}

fn check_frame(name: &str, frame: Frame, kind: &str, theme: Theme) {
    check_sized(name, frame, kind, theme, Vec2::new(480.0, 320.0));
}

fn check_sized(name: &str, frame: Frame, kind: &str, theme: Theme, size: Vec2) {
    let mut harness = harness(Shown::new(kind, frame), size, theme);
    harness.run();
    let options = SnapshotOptions::new().threshold(THRESHOLD).max_failed_pixels(24_usize);
    harness.snapshot_options(format!("{name}_{theme:?}").to_lowercase(), &options);
}

#[test]
fn drive_dark() {
    check_frame("drive", samples::driving(), "drive", Theme::Dark);
}

#[test]
fn drive_light() {
    check_frame("drive", samples::driving(), "drive", Theme::Light);
}

#[test]
fn camera_with_shapes_dark() {
    check_frame("camera_shapes", samples::driving(), "camera", Theme::Dark);
}

#[test]
fn map_of_a_drive_dark() {
    check_frame("map_drive", samples::driving(), "map", Theme::Dark);
}

#[test]
fn camera_dark() {
    check("camera", Theme::Dark);
}

#[test]
fn map_dark() {
    check("map", Theme::Dark);
}

#[test]
fn map_with_the_vehicle_up_dark() {
    let mut harness = map_of_a_vehicle_at([-2.0, 1.0], 0.5);
    harness.get_by_label("Turn the map: the vehicle heads up").click();
    harness.run();
    compare_picture(harness, "map_vehicle_up_dark");
}

#[test]
fn map_light() {
    check("map", Theme::Light);
}

#[test]
fn buffers_light() {
    check("buffers", Theme::Light);
}

#[test]
fn hierarchy_dark() {
    check("hierarchy", Theme::Dark);
}

#[test]
fn hierarchy_of_every_colour_and_light_dark() {
    check_sized("hierarchy_states", samples::states(), "hierarchy", Theme::Dark, Vec2::new(1100.0, 520.0));
}

#[test]
fn hierarchy_of_every_colour_and_light_light() {
    check_sized("hierarchy_states", samples::states(), "hierarchy", Theme::Light, Vec2::new(1100.0, 520.0));
}

#[test]
fn hierarchy_of_forty_processes() {
    check_sized("hierarchy_forty", samples::forty(), "hierarchy", Theme::Dark, Vec2::new(1100.0, 700.0));
}

fn commands_of_a_process(theme: Theme) {
    let mut shown = Shown::new("ladder", samples::commands());
    shown.selection.process = Some("executing".into());
    let mut harness = harness(shown, Vec2::new(600.0, 300.0), theme);
    harness.run();
    for fate in ["1: in time", "2: late", "3: lost", "4: replaced", "6: waits"] {
        harness.get_by_label_contains(fate);
    }
    let options = SnapshotOptions::new().threshold(THRESHOLD).max_failed_pixels(24_usize);
    harness.snapshot_options(format!("ladder_{theme:?}").to_lowercase(), &options);
}

#[test]
fn commands_of_a_process_dark() {
    commands_of_a_process(Theme::Dark);
}

#[test]
fn commands_of_a_process_light() {
    commands_of_a_process(Theme::Light);
}

#[test]
fn buffers_of_a_drive_dark() {
    check_frame("buffers_drive", samples::driving(), "buffers", Theme::Dark);
}

#[test]
fn log_dark() {
    check_frame("log", samples::driving(), "log", Theme::Dark);
}

#[test]
fn timing_dark() {
    check_frame("timing", samples::driving(), "timing", Theme::Dark);
}

#[test]
fn frames_light() {
    check("frames", Theme::Light);
}

#[test]
fn fields_dark() {
    check("fields", Theme::Dark);
}

/// The data of a map below the fields, as a picture or as a histogram.
fn array(name: &str, form: &serde_json::Value, theme: Theme) {
    let mut shown = Shown::new("fields", samples::full());
    shown.selection.topic = Some(crate::TopicKey::shown("/wm1/map"));
    shown.view.load(&serde_json::json!({"array": {"path": ".data", "form": form}})).unwrap();
    let mut harness = harness(shown, Vec2::new(480.0, 420.0), theme);
    harness.run();
    compare_picture(harness, name);
}

#[test]
fn an_array_as_a_picture_dark() {
    array("fields_picture_dark", &serde_json::json!({"picture": {"width": 4824}}), Theme::Dark);
}

#[test]
fn an_array_as_a_histogram_light() {
    array("fields_histogram_light", &serde_json::json!("histogram"), Theme::Light);
}

#[test]
fn tuning_dark() {
    check_frame("tuning", samples::driving(), "tuning", Theme::Dark);
}

#[test]
fn plan_dark() {
    check_frame("plan", samples::driving(), "plan", Theme::Dark);
}

#[test]
fn plan_light() {
    check_frame("plan", samples::driving(), "plan", Theme::Light);
}

#[test]
fn compare_dark() {
    check_sized("compare", samples::compared(), "compare", Theme::Dark, Vec2::new(1100.0, 420.0));
}

#[test]
fn compare_light() {
    check_sized("compare", samples::compared(), "compare", Theme::Light, Vec2::new(1100.0, 420.0));
}

#[test]
fn compare_in_a_narrow_place_dark() {
    check_sized("compare_narrow", samples::compared(), "compare", Theme::Dark, Vec2::new(480.0, 460.0));
}
