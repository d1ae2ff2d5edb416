//! Small pictures of the views, drawn by the software Vulkan driver.

use super::{Shown, harness};
use crate::samples;
use egui::{Theme, Vec2};
use egui_kittest::SnapshotOptions;

/// Anti-aliasing may differ by a little between drivers; a shape that moved may not.
const THRESHOLD: f32 = 1.6;

fn check(kind: &str, theme: Theme) {
    let mut harness = harness(Shown::new(kind, samples::full()), Vec2::new(480.0, 320.0), theme);
    harness.run();
    let options = SnapshotOptions::new().threshold(THRESHOLD).max_failed_pixels(24_usize);
    harness.snapshot_options(format!("{kind}_{theme:?}").to_lowercase(), &options);
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
