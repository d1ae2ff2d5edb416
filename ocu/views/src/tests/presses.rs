//! Presses on a thing of a list that changes before the release: that thing is acted on, or nothing, never the neighbour.

use super::{Shown, harness, press_at};
use crate::samples;
use crate::view::{TopicKey, Wish};
use egui::accesskit::Role;
use egui::{Pos2, Theme, Vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable as _;
use rcs_msg::{foxglove, rcs};
use rcs_runtime::source::{Control, Frame, RunTag, SourceInfo, SourceKind, Topic};
use std::sync::Arc;

fn view(kind: &str, frame: Frame) -> Harness<'static, Shown> {
    let mut harness = harness(Shown::new(kind, frame), Vec2::new(900.0, 560.0), Theme::Dark);
    harness.run();
    harness
}

/// A frame with these topics alone.
fn with(topics: impl IntoIterator<Item = Topic>) -> Frame {
    Frame { topics: topics.into_iter().collect(), tracks: Arc::new([]), ..samples::full() }
}

/// A frame with paths of these names.
fn paths(names: &[&str]) -> Frame {
    let path = samples::full().topic("/planner/path").unwrap().clone();
    with(names.iter().map(|name| {
        let mut topic = path.clone();
        topic.name = (*name).into();
        topic
    }))
}

fn switch(harness: &Harness<'_, Shown>, name: &str) -> Pos2 {
    harness.get_by_role_and_label(Role::CheckBox, name).rect().center()
}

#[test]
fn a_press_on_a_buffer_shows_no_other_one() {
    let (first, more) = (paths(&["/b", "/c"]), paths(&["/a", "/b", "/c"]));
    let gone = paths(&["/b", "/d"]);
    for (then, expected) in [(first.clone(), Some("/c")), (more, Some("/c")), (gone, None)] {
        let mut harness = view("buffers", first.clone());
        let at = harness.get_by_label("/c").rect().center();
        press_at(&mut harness, at, |shown| shown.frame = then);
        let shown: Vec<&str> = harness.state().wishes.iter().filter_map(topic_of).collect();
        assert_eq!(shown.first().copied(), expected);
    }
}

/// The topic that is to be shown.
fn topic_of(wish: &Wish) -> Option<&str> {
    match wish {
        Wish::Show { topic, .. } => Some(topic.name.as_str()),
        _ => None,
    }
}

#[test]
fn a_press_on_a_field_unfolds_no_other_one() {
    let frame = |goals: usize| {
        let mission = rcs::Mission {
            goals: vec![rcs::PlanePoint::default(); goals],
            area: Some(rcs::PlanePolygon::default()),
            keep_out: vec![rcs::PlanePolygon::default()],
            ..rcs::Mission::default()
        };
        with([samples::topic("/mission", 1.0, 0.1, mission)])
    };
    for goals in [1, 2] {
        let mut shown = Shown::new("fields", frame(1));
        shown.view.load(&serde_json::json!({ "open": [".goals"] })).unwrap();
        shown.selection.topic = Some(TopicKey::shown("/mission"));
        let mut harness = harness(shown, Vec2::new(900.0, 560.0), Theme::Dark);
        harness.run();
        let at = harness.get_by_label_contains("keep_out").rect().center();
        press_at(&mut harness, at, |shown| shown.frame = frame(goals));
        assert_eq!(harness.state().view.save()["open"], serde_json::json!([".goals", ".keep_out"]));
    }
}

#[test]
fn a_press_on_a_fault_on_demand_ends_no_other_one() {
    let frame = |ids: &[u64]| {
        let active = ids.iter().map(|&id| rcs::OverrideInForce {
            id,
            process: "obstacles".into(),
            fault: format!("fault {id}"),
            ..Default::default()
        });
        let list = rcs::OverrideList { active: active.collect(), ..Default::default() };
        let requests = samples::topic("/runtime/override", 0.0, 1.0, rcs::Override::default());
        let list = samples::topic("/runtime/overrides", 0.0, 1.0, list);
        let full = samples::full();
        let info = SourceInfo { kind: SourceKind::Stack, ..(*full.info).clone() };
        let topics = full.topics.iter().cloned().chain([requests, list]).collect();
        Frame { topics, info: Arc::new(info), ..full }
    };
    for (then, expected) in [(&[7, 8][..], Some(7)), (&[8][..], None)] {
        let mut harness = view("hierarchy", frame(&[7, 8]));
        harness.get_by_label("Process obstacles: EXEC").click_secondary();
        harness.run();
        let at = harness.get_by_label("End: fault 7").rect().center();
        press_at(&mut harness, at, |shown| shown.frame = frame(then));
        let ended = harness.state().controls.iter().find_map(|control| match control {
            Control::Write { message, .. } => Some(message.to::<rcs::Override>().unwrap().id),
            _ => None,
        });
        assert_eq!(ended, expected);
    }
}

#[test]
fn a_press_on_a_layer_of_a_map_or_scene_switches_no_other_one() {
    let (first, more) = (paths(&["/p1", "/p2"]), paths(&["/p0", "/p1", "/p2"]));
    let gone = paths(&["/p1", "/p3"]);
    for (then, is_switched) in [(first.clone(), true), (more, true), (gone, false)] {
        let mut map = view("map", first.clone());
        let at = switch(&map, "Show /p2");
        press_at(&mut map, at, |shown| shown.frame = then.clone());
        let mut scene = view("scene", first.clone());
        scene.get_by_label("Layers").click();
        scene.run();
        let at = switch(&scene, "/p2");
        press_at(&mut scene, at, |shown| shown.frame = then);
        for harness in [map, scene] {
            let layers = harness.state().view.save()["layers"].clone();
            let names: Vec<&str> = layers.as_object().unwrap().keys().map(String::as_str).collect();
            assert_eq!(names.first().copied(), is_switched.then_some("/p2"));
        }
    }
}

#[test]
fn a_press_on_an_overlay_of_a_camera_switches_no_other_one() {
    let frame = |overlays: &[&str]| {
        let image = samples::full().topic("/camera/image").unwrap().get::<foxglove::RawImage>().cloned();
        let image = samples::topic("/front/image", 5.0, 0.1, image.unwrap());
        let shapes = |name: &&str| samples::topic(name, 5.0, 0.1, foxglove::ImageAnnotations::default());
        with(overlays.iter().map(shapes).chain([image]))
    };
    let (first, more) = (["/front/b"], ["/front/a", "/front/b"]);
    // A stack that computes on a recording what that has, too.
    let mut twins = frame(&first);
    let mut recorded = twins.topic("/front/b").unwrap().clone();
    recorded.run = RunTag::Recorded;
    twins.topics = twins.topics.iter().cloned().chain([recorded]).collect();
    for (before, then, is_switched) in [
        (frame(&first), frame(&first), true),
        (frame(&first), frame(&more), false),
        (twins.clone(), twins, true),
    ] {
        let mut harness = view("camera", before);
        let at = switch(&harness, "/front/b");
        press_at(&mut harness, at, |shown| shown.frame = then);
        let overlays = harness.state().view.save()["overlays"].clone();
        let names: Vec<&str> = overlays.as_object().unwrap().keys().map(String::as_str).collect();
        assert_eq!(names.first().copied(), is_switched.then_some("/front/b"));
    }
}
