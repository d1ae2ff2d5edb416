//! What the cards show.

use super::cards::{self, Shown};
use super::patch::{Atlas, Patch};
use super::read::{Histogram, Model, Models, Number};
use crate::samples::NOW;
use egui::{Color32, ColorImage, Theme, Vec2};
use egui_kittest::kittest::Queryable;
use egui_kittest::{Harness, SnapshotOptions};
use std::cell::RefCell;

/// A model of 30 bins of red and green around a colour.
fn color_model(name: &str, [red, green]: [f32; 2]) -> Model {
    let away = |bin: usize, level: f32| (bin as f32 - level * 30.0 / 256.0).powi(2);
    let counts = (0..900).map(|i| (40.0 - away(i / 30, red) - away(i % 30, green)).max(0.0)).collect();
    let axes = Some(["red".to_owned(), "green".to_owned()]);
    let histogram = Histogram { name: "counts".to_owned(), axes, columns: 30, counts };
    let patch = histogram.swatch();
    Model {
        name: name.to_owned(),
        is_named: true,
        kind: "ground".to_owned(),
        histograms: vec![histogram],
        numbers: vec![("uses".to_owned(), Number::Plain(25.0))],
        patch,
    }
}

/// A picture of stripes.
fn stripes(colors: [Color32; 2]) -> Patch {
    let pixels = (0..256).map(|i| colors[i / 16 % 2]).collect();
    let picture = ColorImage::new([16, 16], pixels);
    Patch { picture, taken: Some((Some(NOW.before_ns(4_300_000_000)), "front_left".to_owned())) }
}

#[test]
fn cards_show_pictures_or_else_the_colours_of_the_histogram_dark() {
    let browns = [Color32::from_rgb(120, 84, 58), Color32::from_rgb(140, 100, 70)];
    let terrain = Model {
        name: "model 3".to_owned(),
        histograms: vec![Histogram {
            name: "texture".to_owned(),
            axes: None,
            columns: 8,
            counts: vec![1.0, 4.0, 9.0, 3.0, 2.0, 0.0, 1.0, 6.0],
        }],
        numbers: vec![("obstacle fraction".to_owned(), Number::Fraction(0.92))],
        patch: Some(stripes([Color32::from_rgb(40, 90, 30), Color32::from_rgb(70, 120, 40)])),
        ..Model::default()
    };
    let learned = Model { patch: Some(stripes(browns)), ..color_model("learned 1", [120.0, 84.0]) };
    let models = Models { models: vec![learned, color_model("mulch", [200.0, 120.0]), terrain] };
    let pictures = Atlas::new(&models.patches());
    let mut harness = Harness::builder()
        .with_size(Vec2::new(752.0, 300.0))
        .with_theme(Theme::Dark)
        .with_render_cursor(false)
        .with_context_setup(ocu_ui::install)
        .build_ui(move |ui| {
            ui.painter().rect_filled(ui.max_rect(), 0.0, ocu_ui::tokens(ui).panel());
            let pictures = pictures.as_ref();
            cards::show(ui, &Shown { now: NOW, models: &models, pictures, refused: None, leaving: Some(1) });
        });
    harness.run();
    assert_eq!(harness.query_all_by_label("Picture of the model").count(), 2);
    harness.get_by_label("Colours of the model");
    harness.get_by_label("deleted next");
    let options = SnapshotOptions::new().threshold(1.6).max_failed_pixels(24_usize);
    harness.snapshot_options("models_dark", &options);
}

#[test]
fn a_press_on_a_model_deletes_no_other_one_although_models_come_or_go_before_the_release() {
    let of = |names: &[&str]| Models {
        models: names.iter().map(|name| color_model(name, [120.0, 84.0])).collect(),
    };
    // Where the pressed one is still there, it is deleted, wherever it is now; otherwise none is.
    let cases: [(&[&str], &[&str]); 4] = [
        (&["soil", "mulch"], &["mulch"]),
        (&["mulch", "grass"], &["mulch"]),
        (&["new", "soil", "mulch"], &["mulch"]),
        (&["soil", "grass"], &[]),
    ];
    for (then, expected) in cases {
        let models = RefCell::new(of(&["soil", "mulch", "grass"]));
        let deleted: RefCell<Vec<String>> = RefCell::default();
        let mut harness = Harness::builder()
            .with_size(Vec2::new(752.0, 300.0))
            .with_context_setup(ocu_ui::install)
            .build_ui(|ui| {
                let models = models.borrow();
                let shown = Shown { now: NOW, models: &models, pictures: None, refused: None, leaving: None };
                let index = cards::show(ui, &shown);
                deleted.borrow_mut().extend(index.map(|index| models.models[index].name.clone()));
            });
        harness.run();
        let at = harness.get_by_label("Delete mulch").rect().center();
        harness.drag_at(at);
        harness.step();
        *models.borrow_mut() = of(then);
        harness.step();
        harness.drop_at(at);
        harness.step();
        assert_eq!(*deleted.borrow(), expected, "{then:?}");
    }
}
