//! What the scene says of what it shows.

use super::{Shown, harness};
use crate::samples;
use egui::{Theme, Vec2};
use egui_kittest::kittest::Queryable as _;
use rcs_msg::foxglove::PointCloud;

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

#[test]
fn a_cloud_that_no_transform_connects_is_named_with_the_frame_in_which_it_could_be_drawn() {
    let mut frame = samples::full();
    let loose = PointCloud { frame_id: "os_sensor".into(), ..samples::cloud(&[[1.0, 2.0, 0.5]]) };
    let loose = samples::topic("/loose/points", 10.0, 0.1, loose);
    frame.topics = frame.topics.iter().cloned().chain([loose]).collect();
    let mut harness = harness(Shown::new("scene", frame), Vec2::new(900.0, 560.0), Theme::Dark);
    harness.run();
    harness.get_by_label("Layers").click();
    harness.run();
    let reason = "not drawn: frame \"os_sensor\" is not connected to \"local\"";
    assert!(harness.query_by_label(reason).is_some());
    harness.get_by_label("Draw in os_sensor").click();
    harness.run();
    assert_eq!(harness.state().view.save()["frame"], "os_sensor");
}

#[test]
fn the_look_of_a_cloud_is_chosen_in_the_map_and_in_the_scene() {
    let mut map = harness(Shown::new("map", samples::full()), Vec2::new(900.0, 560.0), Theme::Dark);
    let mut scene = harness(Shown::new("scene", samples::full()), Vec2::new(900.0, 560.0), Theme::Dark);
    scene.run();
    scene.get_by_label("Layers").click();
    for (harness, part) in [(&mut map, "layers"), (&mut scene, "clouds")] {
        harness.run();
        harness.get_by_label("Colour /lidar/points by automatic").click();
        harness.run();
        harness.get_by_label("distance").click();
        harness.run();
        let saved = harness.state().view.save()[part]["/lidar/points"].clone();
        let look = if part == "layers" { &saved["cloud"] } else { &saved };
        assert_eq!(look["by"], "distance", "{part}");
    }
}
