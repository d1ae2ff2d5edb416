//! The menu of the layers of a scene.

use super::Scene;
use crate::map::{Placed, Thing};
use egui::{Label, RichText, Ui};
use ocu_ui::{format, tokens, widgets};
use rcs_msg::foxglove::PointCloud;

/// Width of the menu, and how far what is said of a layer lies to the right of its name, screen points.
const WIDTH: f32 = 220.0;
const INDENT: f32 = 22.0;

impl Scene {
    pub(super) fn layers_menu(&mut self, ui: &mut Ui, placed: &[Placed<'_>]) {
        ui.set_min_width(WIDTH);
        let mut names = widgets::RowNames::default();
        for layer in placed {
            // Those before it come and go.
            names.named(ui, &layer.name, |ui| self.layer(ui, layer));
        }
        ui.separator();
        widgets::named(ui, "axes", |ui| ui.checkbox(&mut self.saved.axes, "Coordinate frames"));
    }

    fn layer(&mut self, ui: &mut Ui, layer: &Placed<'_>) {
        let mut shown = self.shows(layer);
        if ui.checkbox(&mut shown, &layer.name).changed() {
            self.saved.layers.insert(layer.name.clone(), shown);
        }
        age(ui, layer);
        if let Some(loose) = &layer.loose {
            let warning = tokens(ui).warning;
            ui.horizontal(|ui| {
                ui.add_space(INDENT);
                ui.set_max_width(WIDTH);
                let text = format!("not drawn: {}", loose.reason);
                ui.add(Label::new(RichText::new(text).small().color(warning)).wrap());
            });
            // Where only some entities are missing, their frames may differ.
            if matches!(layer.thing, Thing::Nothing) {
                ui.horizontal(|ui| {
                    ui.add_space(INDENT);
                    let text = format!("Draw in {}", loose.frame_id);
                    if ui.link(RichText::new(text).small()).clicked() {
                        self.saved.frame = Some(loose.frame_id.clone());
                        self.fit();
                    }
                });
            }
        }
        if let Thing::Cloud(message) = layer.thing
            && let Some(cloud) = message.get::<PointCloud>()
            && shown
        {
            let known = self.saved.clouds.get(&layer.name).cloned().unwrap_or_default();
            let mut look = known.clone();
            look.ui(ui, &layer.name, cloud, INDENT);
            if look != known {
                self.saved.clouds.insert(layer.name.clone(), look);
            }
        }
    }
}

/// The age of a layer, below its name.
fn age(ui: &mut Ui, layer: &Placed<'_>) {
    let Some(age_s) = layer.age_s else { return };
    let (age, tokens) = (format::age(age_s), tokens(ui));
    let (text, color) = if layer.is_stale {
        (format!("old: {age}"), tokens.stale)
    } else {
        (format!("age {age}"), tokens.weak)
    };
    ui.horizontal(|ui| {
        ui.add_space(INDENT);
        ui.label(RichText::new(text).small().color(color));
    });
}
