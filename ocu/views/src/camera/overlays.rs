//! The row with the switches of the overlays.

use super::layer::{Overlay, Quantity};
use super::{Camera, Projected};
use crate::image::{DecodedImage, Pixels};
use crate::view::rate_hz;
use egui::{Role, Ui, WidgetInfo};
use ocu_ui::bar::{self, Bar, Choice, Fit, Form};
use ocu_ui::{icons, tokens, widgets};
use rcs_runtime::source::Topic;
use std::collections::BTreeSet;

/// How an overlay of an image is shown.
pub(super) struct OverlayState {
    pub(super) shown: bool,
    pub(super) opacity: f32,
}

impl Camera {
    /// Settings of an overlay.
    pub(super) fn overlay_state(&self, overlay: &Overlay<'_>) -> OverlayState {
        self.state(&overlay.topic.name, overlay.is_usual)
    }

    /// Settings of a projection.
    pub(super) fn projected_state(&self, what: Projected) -> OverlayState {
        self.state(what.key(), what.is_usual())
    }

    /// Settings by the name in layouts.
    fn state(&self, key: &str, is_usual: bool) -> OverlayState {
        let saved = self.saved.overlays.get(key).copied().unwrap_or_default();
        OverlayState { shown: saved.shown.unwrap_or(is_usual), opacity: saved.opacity }
    }

    /// The row of switches. `unusable` says why nothing can be projected.
    pub(super) fn overlay_bar(
        &mut self,
        ui: &mut Ui,
        topic: &Topic,
        image: Option<&DecodedImage>,
        overlays: &[Overlay<'_>],
        projected: &[Projected],
        unusable: Option<&str>,
    ) {
        let whole = Quantity::of(topic) == Quantity::Range
            && image.is_some_and(|image| matches!(image.pixels, Pixels::Values { whole: true, .. }));
        let has_switches = !(overlays.is_empty() && projected.is_empty());
        if !has_switches && !whole && unusable.is_none() {
            return;
        }
        // Channels of a recording that have one name, but messages of different types, have one switch.
        let mut names = BTreeSet::new();
        let overlays: Vec<&Overlay<'_>> =
            overlays.iter().filter(|overlay| names.insert(&*overlay.topic.name)).collect();
        // Overlays that do not fit in the row, and ground truth, are listed in a menu.
        let truth = overlays.iter().any(|overlay| overlay.topic.is_ground_truth());
        let mut bar: Bar<'_, Self> = Bar::new("overlays");
        if has_switches {
            bar.left("overlays", Fit::Shrinks, |ui, form, view| {
                if form == Form::Full && !truth {
                    for overlay in &overlays {
                        view.overlay_switch(ui, overlay);
                    }
                    for what in projected {
                        view.projected_switch(ui, *what);
                    }
                } else {
                    view.overlay_menu(ui, form, &overlays, projected);
                }
            });
        }
        bar.left("behind", Fit::Leaves(20), |ui, _, view| {
            for overlay in overlays.iter().filter(|overlay| view.overlay_state(overlay).shown) {
                behind(ui, topic, overlay.topic);
            }
        });
        if whole {
            bar.left("depth unit", Fit::Leaves(10), |ui, form, view| view.depth_unit(ui, form));
        }
        if let Some(why) = unusable {
            // Where it is cut, the whole text is shown when the pointer rests on it.
            bar.left("unusable", Fit::Stretches(48.0), move |ui, _, _| {
                let text = format!("{}  nothing is projected: {why}", icons::ICON_WARNING.codepoint);
                ui.label(egui::RichText::new(text).small().color(tokens(ui).warning));
            });
        }
        crate::toolbar::show(ui, bar, self);
    }

    /// All overlays in a menu, with ground truth at the end; the button names those that are on.
    fn overlay_menu(&mut self, ui: &mut Ui, form: Form, overlays: &[&Overlay<'_>], projected: &[Projected]) {
        let topics = overlays.iter().filter(|overlay| self.overlay_state(overlay).shown);
        let others = projected.iter().filter(|what| self.projected_state(**what).shown);
        let on: Vec<&str> =
            topics.map(|overlay| &*overlay.topic.name).chain(others.map(|what| what.name())).collect();
        let shown = match (on.as_slice(), form) {
            ([], _) => "none".to_owned(),
            (on, Form::Short) => on.len().to_string(),
            (on, _) => on.join(", "),
        };
        let text = format!("Overlays: {shown}");
        let form = if form == Form::Short { Form::Full } else { form };
        let response = bar::menu(ui, form, icons::ICON_LAYERS, &text, |ui| {
            let mut truth = false;
            egui::Grid::new("overlays").num_columns(2).show(ui, |ui| {
                let (own, given) = overlays.split_at(own(overlays));
                for overlay in own {
                    self.overlay_switch(ui, overlay);
                    ui.end_row();
                }
                for what in projected {
                    self.projected_switch(ui, *what);
                    ui.end_row();
                }
                for overlay in given {
                    if overlay.topic.is_ground_truth() && !std::mem::replace(&mut truth, true) {
                        ui.label(
                            egui::RichText::new("Truth of the simulation").small().color(tokens(ui).weak),
                        );
                        ui.end_row();
                    }
                    self.overlay_switch(ui, overlay);
                    ui.end_row();
                }
            });
        });
        response.on_hover_text("What lies over the image");
    }

    fn overlay_switch(&mut self, ui: &mut Ui, overlay: &Overlay<'_>) {
        self.switch(ui, &overlay.topic.name, &overlay.topic.name, overlay.is_usual);
    }

    fn projected_switch(&mut self, ui: &mut Ui, what: Projected) {
        self.switch(ui, what.key(), what.name(), what.is_usual());
    }

    /// A checkbox and an opacity slider; `key` is the name in layouts.
    fn switch(&mut self, ui: &mut Ui, key: &str, name: &str, is_usual: bool) {
        let before = self.saved.overlays.get(key).copied().unwrap_or_default();
        let mut saved = before;
        let mut shown = saved.shown.unwrap_or(is_usual);
        // Those before it come and go with their topics. A name is not broken into lines in a cell of the menu.
        let checkbox = |ui: &mut Ui| {
            ui.style_mut().wrap_mode = Some(egui::TextWrapMode::Extend);
            ui.checkbox(&mut shown, name)
        };
        let checkbox = widgets::named(ui, (key, "shown"), checkbox);
        if checkbox.on_hover_text("Show this overlay").changed() {
            saved.shown = (shown != is_usual).then_some(shown);
        }
        let slider = egui::Slider::new(&mut saved.opacity, 0.0..=1.0)
            .custom_formatter(|v, _| format!("{:3.0} %", v * 100.0))
            .custom_parser(|text| text.trim_end_matches('%').trim().parse::<f64>().ok().map(|v| v / 100.0));
        let response = widgets::named(ui, (key, "opacity"), |ui| ui.add_enabled(shown, slider));
        let name = format!("Opacity of {name}");
        response.widget_info(|| WidgetInfo::labeled(Role::Slider, true, &name));
        response.on_hover_text(name);
        if saved != before {
            self.saved.overlays.insert(key.to_owned(), saved);
        }
    }

    fn depth_unit(&mut self, ui: &mut Ui, form: Form) {
        let step = &mut self.saved.depth_step_m;
        if form == Form::Full {
            ui.label("Depth unit");
        }
        let text = if *step == 1.0 / 256.0 { "1/256 m".to_owned() } else { format!("{} mm", *step * 1000.0) };
        let list = bar::choice(ui, form, Choice::new("Depth unit", &text, [72.0, 88.0]), |ui| {
            ui.selectable_value(step, 0.001, "1 mm (ROS)");
            ui.selectable_value(step, 1.0 / 256.0, "1/256 m");
        });
        list.response.on_hover_text("The image does not say what one step of its depth is: an assumption");
    }
}

/// Number of overlays before those of ground truth, which are the last ones.
fn own(overlays: &[&Overlay<'_>]) -> usize {
    overlays.iter().position(|overlay| overlay.topic.is_ground_truth()).unwrap_or(overlays.len())
}

/// Shows that an overlay belongs to another image than the one shown. A delay of up to one image is normal for a
/// computed overlay and is not shown, because the text would flicker.
fn behind(ui: &mut Ui, topic: &Topic, overlay: &Topic) {
    let (Some(image), Some(labels)) = (topic.acq_time(), overlay.acq_time()) else { return };
    let behind_s = image.seconds_since(labels);
    let hz = rate_hz(topic);
    let usual_s = if hz > 0.0 { 1.5 / hz } else { 0.02 };
    if behind_s.abs() > usual_s.max(0.02) {
        let word = if behind_s > 0.0 { "older" } else { "newer" };
        let text = format!("{:.2} s {word} than the image", behind_s.abs());
        ui.label(egui::RichText::new(text).small().color(tokens(ui).stale));
    }
}
