//! What cameras see of maps, paths and examples, and what both sides mark of each other.

use super::pictures::compare_picture;
use super::{Shown, harness};
use crate::samples::{self, CAMERA_M};
use crate::{Hover, HoverPoint};
use egui::accesskit::{Role, Toggled};
use egui::{Pos2, Theme, Vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::{NodeT as _, Queryable as _};
use rcs_msg::foxglove::CameraCalibration;
use rcs_runtime::source::Topic;

fn camera(size: Vec2) -> Harness<'static, Shown> {
    let mut harness = harness(Shown::new("camera", samples::camera_in_space()), size, Theme::Dark);
    harness.run();
    harness
}

fn switch(harness: &mut Harness<'_, Shown>, name: &str) {
    harness.get_by_role_and_label(Role::CheckBox, name).click();
    harness.run();
}

#[test]
fn horizon_path_cells_and_examples_are_drawn_and_kept_dark() {
    let mut harness = camera(Vec2::new(620.0, 440.0));
    harness.get_by_label_contains("Overlays: ").click();
    harness.run();
    let toggled = |harness: &Harness<'_, Shown>, name: &str| {
        harness.get_by_role_and_label(Role::CheckBox, name).accesskit_node().toggled()
    };
    assert_eq!(toggled(&harness, "planned path"), Some(Toggled::True));
    assert_eq!(toggled(&harness, "horizon"), Some(Toggled::False));
    for name in ["horizon", "cells of the map", "/obstacles/labels", "/color/shapes"] {
        switch(&mut harness, name);
    }
    assert_eq!(harness.state().view.save()["overlays"]["(horizon)"]["shown"], true);
    // The menu closes.
    harness.get_by_label_contains("Overlays: ").click();
    harness.run();
    harness.hover_at(Pos2::new(2.0, 2.0));
    harness.run();
    compare_picture(harness, "camera_projected_dark");
}

#[test]
fn without_a_calibration_nothing_is_projected() {
    let mut frame = samples::camera_in_space();
    let topics = frame.topics.iter().filter(|topic| topic.type_name() != "foxglove.CameraCalibration");
    frame.topics = topics.cloned().collect();
    let mut harness = harness(Shown::new("camera", frame), Vec2::new(620.0, 440.0), Theme::Dark);
    harness.run();
    harness.get_by_label_contains("Overlays: ").click();
    harness.run();
    assert!(harness.query_by_label("planned path").is_none());
}

#[test]
fn a_calibration_that_cannot_be_used_is_told_where_overlays_are_chosen() {
    let check = |change: fn(&mut CameraCalibration), expected: &str| {
        let mut frame = samples::camera_in_space();
        let with_change = |topic: &Topic| {
            let Some(calibration) = topic.get::<CameraCalibration>() else { return topic.clone() };
            let mut calibration = calibration.clone();
            change(&mut calibration);
            samples::topic(&topic.name, 1.0, 0.1, calibration)
        };
        frame.topics = frame.topics.iter().map(with_change).collect();
        let mut harness = harness(Shown::new("camera", frame), Vec2::new(620.0, 440.0), Theme::Dark);
        harness.run();
        let text = format!("nothing is projected: /camera/calibration: {expected}");
        assert!(harness.query_by_label_contains(&text).is_some(), "{text}");
    };
    check(|calibration| calibration.distortion_model = "omni".into(), "distortion model \"omni\" is unknown");
    check(|calibration| calibration.k = vec![0.0; 9], "camera is not calibrated");
    let ratio = "image has 96×64 pixels, expected the aspect ratio of 192×96";
    check(|calibration| calibration.height = 96, ratio);
}

#[test]
fn a_pixel_is_a_place_on_the_ground_and_a_place_is_a_pixel() {
    let mut harness = camera(Vec2::new(620.0, 440.0));
    let canvas = harness.get_by_label("Image of /camera/image").rect();
    // Below the middle of the image the ray meets the ground ahead of the camera.
    let at = canvas.center() + Vec2::new(0.0, 60.0);
    harness.hover_at(at);
    harness.run();
    assert!(harness.query_by_label_contains("if it is ground").is_some());
    let point = harness.state().selection.hovered.get().point.clone().unwrap();
    let [x, y, z] = point.position_m;
    assert_eq!(point.frame_id, "local");
    assert!(x > CAMERA_M[0] + 1.0 && (y - CAMERA_M[1]).abs() < 0.1 && z.abs() < 0.01, "{x} {y} {z}");

    // The same place, said by a map, is marked there.
    harness.hover_at(Pos2::new(2.0, 2.0));
    harness.run();
    let shapes = |harness: &Harness<'_, Shown>| harness.output().shapes.len();
    let without = shapes(&harness);
    let point = HoverPoint { frame_id: "local".to_owned(), position_m: [x, y, f64::NAN] };
    harness.state_mut().selection.hovered.set(Hover { point: Some(point), ..Hover::default() });
    harness.state_mut().selection.hovered.turn();
    harness.step();
    let marked = harness.output().shapes.iter().find_map(|clipped| match &clipped.shape {
        egui::Shape::Circle(circle) if circle.radius == 6.0 => Some(circle.center),
        _ => None,
    });
    assert!(shapes(&harness) > without);
    assert!((marked.unwrap() - at).length() < 1.0, "{marked:?} {at}");
}
