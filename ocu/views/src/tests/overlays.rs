//! The switches of what lies over the images of several cameras.

use super::{Shown, harness};
use crate::samples;
use egui::accesskit::{Role, Toggled};
use egui::{Theme, Vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::{NodeT as _, Queryable as _};
use rcs_msg::foxglove::{ImageAnnotations, RawImage};
use rcs_runtime::source::Frame;

/// Shapes that name no image, but are named like the front camera.
const BOXES: &str = "/front/boxes";

/// A front and a rear camera, of which the front one is shown.
fn two_cameras() -> Harness<'static, Shown> {
    let image = samples::full().topic("/camera/image").unwrap().get::<RawImage>().unwrap().clone();
    let topics = [
        samples::topic(BOXES, 5.0, 0.1, ImageAnnotations::default()),
        samples::topic("/front/image", 5.0, 0.1, image.clone()),
        samples::topic("/rear/image", 5.0, 0.1, image),
    ];
    let frame = Frame { topics: topics.into(), ..samples::empty() };
    let mut harness = harness(Shown::new("camera", frame), Vec2::new(900.0, 560.0), Theme::Dark);
    harness.run();
    harness
}

fn look_at(harness: &mut Harness<'_, Shown>, image: &str) {
    let shown = harness.state_mut();
    shown.view.drop_topic(shown.frame.topic(image).unwrap());
    harness.run();
}

fn is_on(harness: &Harness<'_, Shown>) -> bool {
    let switch = harness.get_by_role_and_label(Role::CheckBox, BOXES);
    switch.accesskit_node().toggled() == Some(Toggled::True)
}

fn switch(harness: &mut Harness<'_, Shown>) {
    harness.get_by_role_and_label(Role::CheckBox, BOXES).click();
    harness.run();
}

#[test]
fn the_opacity_of_an_overlay_does_not_switch_it_on_for_another_camera() {
    let mut harness = two_cameras();
    assert!(is_on(&harness));
    harness.get_by_role_and_label(Role::Slider, "Opacity of /front/boxes").set_value_accesskit(0.75);
    harness.run();
    let saved = harness.state().view.save()["overlays"][BOXES].clone();
    assert!(saved["shown"].is_null() && saved["opacity"].as_f64() > Some(0.7), "{saved}");
    look_at(&mut harness, "/rear/image");
    assert!(!is_on(&harness));
    look_at(&mut harness, "/front/image");
    assert!(is_on(&harness));
}

#[test]
fn a_switched_overlay_is_saved_until_it_is_as_usual_again() {
    let mut harness = two_cameras();
    look_at(&mut harness, "/rear/image");
    let saved =
        |harness: &Harness<'_, Shown>| harness.state().view.save()["overlays"][BOXES]["shown"].clone();
    switch(&mut harness);
    assert!(is_on(&harness));
    assert_eq!(saved(&harness), true);
    switch(&mut harness);
    assert!(!is_on(&harness));
    assert!(saved(&harness).is_null());
    // As layouts have it that were saved with both settings.
    let both = serde_json::json!({ "overlays": { BOXES: { "shown": true, "opacity": 0.5 } } });
    harness.state_mut().view.load(&both).unwrap();
    look_at(&mut harness, "/rear/image");
    assert!(is_on(&harness));
}
