//! The bar above the map: its frame, where it looks, and what is drawn on it.

use super::{Map, layers, mission};
use crate::operator::Inputs;
use egui::Ui;
use ocu_ui::bar::{self, Bar, Choice, Fit, Form};
use ocu_ui::icons;
use ocu_ui::palette::MapPalette;
use rcs_runtime::source::Frame;

impl Map {
    pub(super) fn toolbar(&mut self, ui: &mut Ui, frame: &Frame, map: &str, frames: &[&str], roomy: bool) {
        let mut bar: Bar<'_, Self> = Bar::new("toolbar");
        bar.left("frame", Fit::Leaves(60), |ui, form, view| view.frame_choice(ui, form, map, frames));
        bar.right("fit", Fit::Leaves(50), |ui, form, view| {
            if bar::tool(ui, form, icons::ICON_FIT_SCREEN, "Fit everything").clicked() {
                view.saved.viewport = None;
            }
        });
        bar.right("follow", Fit::Leaves(45), |ui, form, view| {
            let name = "Follow the vehicle";
            bar::tool_toggle(ui, form, icons::ICON_MY_LOCATION, name, &mut view.saved.follows);
        });
        bar.right("vehicle up", Fit::Leaves(42), |ui, form, view| {
            let name = "Turn the map: the vehicle heads up";
            bar::tool_toggle(ui, form, icons::ICON_NAVIGATION, name, &mut view.saved.vehicle_up);
        });
        bar.right("measure", Fit::Leaves(20), |ui, form, view| {
            let name = "Measure a distance";
            let measure = bar::tool_toggle(ui, form, icons::ICON_STRAIGHTEN, name, &mut view.measuring);
            if measure.clicked() {
                view.measured = None;
                view.example = None;
            }
        });
        if Inputs::of(frame).training.is_some() {
            bar.right("training", Fit::Leaves(30), |ui, form, view| {
                let mut drawing = view.example.is_some();
                let name = "Draw an obstacle or ground to learn from";
                if bar::tool_toggle(ui, form, icons::ICON_SCHOOL, name, &mut drawing).clicked() {
                    view.toggle_example();
                }
            });
        }
        if let Some(buffer) = Inputs::of(frame).mission {
            bar.right("mission", Fit::Leaves(40), move |ui, form, view| {
                let editing = view.draft.is_some();
                let name = "Draw a mission: goals and keep-out zones";
                let refused = mission::refusal(frame, map, &buffer).filter(|_| !editing);
                let tool = bar::tool_of(ui, form, icons::ICON_TOUR, name, editing, refused.is_none());
                if tool.on_disabled_hover_text(refused.unwrap_or_default()).clicked() {
                    view.toggle_draft(frame, map, &buffer);
                }
            });
        }
        bar.right("palette", Fit::Leaves(10), |ui, form, view| {
            let mut even = view.saved.palette == MapPalette::Even;
            let name = "Even colours, for colour-blind people";
            if bar::tool_toggle(ui, form, icons::ICON_PALETTE, name, &mut even).clicked() {
                view.saved.palette = if even { MapPalette::Even } else { MapPalette::Papers };
            }
        });
        bar.right("layers", Fit::Leaves(70), |ui, form, view| {
            let mut listed = view.saved.panel.unwrap_or(roomy);
            let name = "Show the list of layers";
            if bar::tool_toggle(ui, form, icons::ICON_LAYERS, name, &mut listed).clicked() {
                view.saved.panel = Some(listed);
            }
        });
        crate::toolbar::show(ui, bar, self);
    }

    fn frame_choice(&mut self, ui: &mut Ui, form: Form, map: &str, frames: &[&str]) {
        let choice = Choice::new("Frame of the map", layers::frame_label(map), [72.0, 160.0]);
        let list = bar::choice(ui, form, choice, |ui| {
            for frame in frames {
                if ui.selectable_label(*frame == map, layers::frame_label(frame)).clicked() {
                    self.saved.frame = Some((*frame).to_owned());
                    self.saved.viewport = None;
                }
            }
        });
        list.response.on_hover_text("Frame that everything is drawn in");
    }
}
