//! What the scene says where it cannot draw, and over its picture.

use super::*;
use crate::samples;
use crate::view::Selection;
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable as _;
use std::sync::mpsc::channel;

/// Shows a scene of a frame.
fn show(frame: Frame) -> impl FnMut(&mut Ui, &mut Scene) {
    move |ui, scene| {
        let (mut controls, mut wishes) = (Vec::new(), Vec::new());
        let mut selection = Selection::default();
        let mut cx = ViewContext {
            frame: &frame,
            controls: &mut controls,
            selection: &mut selection,
            wishes: &mut wishes,
        };
        scene.ui(ui, &mut cx);
    }
}

#[test]
fn a_thread_that_has_ended_is_said_and_another_one_begins_when_a_person_tries_again() {
    let (_, pictures) = channel();
    let scene = Scene { worker: Some(Worker::of(pictures)), ..Scene::default() };
    let harness = Harness::builder().with_max_steps(12).with_context_setup(ocu_ui::install);
    let mut harness = harness.build_ui_state(show(samples::full()), scene);
    harness.run();
    assert!(harness.query_by_label_contains("has ended by a panic").is_some());
    assert!(harness.state().worker.is_none());
    harness.get_by_label("Try again").click();
    harness.run();
    assert!(harness.query_by_label_contains("has ended by a panic").is_none());
    // Without a graphics driver there is another reason now.
    let scene = harness.state();
    assert!(scene.picture.is_some() || scene.failed.is_some());
}

#[test]
fn what_could_not_be_read_and_what_is_shown_and_old_are_named_over_the_picture() {
    let layer = |name: &str, age_s: f64, is_stale: bool| Placed {
        name: name.to_owned(),
        thing: Thing::Path(Vec::new()),
        scene_from_layer: Pose::IDENTITY,
        series: 0,
        is_usual: true,
        is_stale,
        age_s: Some(age_s),
        loose: None,
    };
    let mut layers = vec![layer("/wm1/map", 0.2, false)];
    layers.extend(["/a", "/b", "/c", "/d", "/e"].map(|name| layer(name, 30.0, true)));
    let shown: Vec<&Placed<'_>> = layers.iter().collect();
    let problems = ["/f: it is no point cloud".to_owned()];
    let show = |ui: &mut Ui| {
        let canvas = ui.max_rect();
        notes(ui, canvas, &problems, &shown);
    };
    let mut harness = Harness::builder().with_context_setup(ocu_ui::install).build_ui(show);
    harness.run();
    for text in ["/f: it is no point cloud", "/a: old, 30 s", "/c: old, 30 s", "and 2 more"] {
        assert!(harness.query_by_label(text).is_some(), "{text}");
    }
    for text in ["/d: old", "/wm1/map"] {
        assert!(harness.query_by_label_contains(text).is_none(), "{text}");
    }
}

#[test]
fn the_first_picture_of_a_window_is_followed_by_one_with_the_ground_and_by_no_other() {
    let (sender, pictures) = channel();
    let scene = Scene { worker: Some(Worker::of(pictures)), ..Scene::default() };
    let install = |ctx: &egui::Context| {
        ocu_ui::install(ctx);
        prepare::start(ctx).expect("threads");
    };
    let harness = Harness::builder().with_max_steps(12).with_context_setup(install);
    let mut harness = harness.build_ui_state(show(samples::full()), scene);
    harness.run();
    let first = harness.state().number;
    assert_eq!(harness.state().camera(), None);
    let fit = Camera::fit(DVec3::ZERO, DVec3::splat(10.0), 1.0);
    let picture = |number: u64| Picture {
        number,
        camera: fit,
        fit,
        image: Arc::new(egui::ColorImage::filled([2, 2], Color32::BLACK)),
        depth: vec![1.0; 4],
        problems: Vec::new(),
    };
    // A window takes one pass when a picture has come.
    for number in [first, first + 1] {
        sender.send(Ok(picture(number))).expect("a scene");
        harness.run();
        assert_eq!((harness.state().number, harness.state().camera()), (first + 1, Some(fit)));
    }
    drop(sender);
}
