//! What the scene says of what it shows.

use super::{Shown, harness};
use crate::samples;
use egui::{Theme, Vec2};
use egui_kittest::kittest::Queryable as _;

#[test]
fn the_menu_of_a_scene_has_the_ages_of_all_layers() {
    let mut frame = samples::full();
    let old = samples::topic("/lidar/points", 10.0, 30.0, samples::cloud(&[[1.0, 2.0, 0.5]]));
    let others = frame.topics.iter().filter(|topic| topic.name != old.name).cloned();
    frame.topics = others.chain([old.clone()]).collect();
    let mut harness = harness(Shown::new("scene", frame), Vec2::new(900.0, 560.0), Theme::Dark);
    harness.run();
    harness.get_by_label("Layers").click();
    harness.run();
    assert!(harness.query_by_label("old: 30 s").is_some());
    assert!(harness.query_by_label("age 0.2 s").is_some(), "that of the map");
}
