//! How tracks are painted on a map.

use super::{Shown, harness};
use crate::samples;
use egui::{Shape, Theme, Vec2};
use rcs_runtime::source::{Frame, WGS84};
use std::sync::Arc;

/// What a map of a frame paints where it shows the whole tracks of the samples.
fn painted(frame: Frame) -> Vec<Shape> {
    let mut shown = Shown::new("map", frame);
    let viewport = serde_json::json!({ "center": [10.0, 0.0], "scale": 20.0, "y_up": true });
    shown.view.load(&serde_json::json!({ "viewport": viewport })).unwrap();
    let mut map = harness(shown, Vec2::new(900.0, 760.0), Theme::Dark);
    map.run();
    map.output().shapes.iter().map(|clipped| clipped.shape.clone()).collect()
}

/// Whether it is a line with many points; of this width, if one is given.
fn is_line(shape: &Shape, width: Option<f32>) -> bool {
    let Shape::Path(path) = shape else { return false };
    !path.closed && path.points.len() > 8 && width.is_none_or(|width| path.stroke.width == width)
}

#[test]
fn the_track_of_the_run_that_was_left_has_an_edge_and_its_name() {
    let shapes = painted(samples::compared());
    assert!(shapes.iter().any(|shape| is_line(shape, Some(3.5))));
    let is_name = |shape: &Shape| matches!(shape, Shape::Text(text) if text.galley.text() == "run 0");
    assert!(shapes.iter().any(is_name));
}

#[test]
fn position_fixes_are_dots_without_a_line() {
    let mut frame = samples::full();
    frame.tracks = frame.tracks.iter().filter(|track| &*track.frame_id == WGS84).cloned().collect();
    frame.topics = Arc::new([]);
    let shapes = painted(frame);
    let is_dot = |shape: &&Shape| matches!(shape, Shape::Circle(circle) if circle.radius <= 1.5);
    let dots = shapes.iter().filter(is_dot).count();
    assert!(dots > 20, "{dots}");
    assert!(!shapes.iter().any(|shape| is_line(shape, None)));
}
