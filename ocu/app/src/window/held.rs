//! What the operator holds: every override in force, in the top bar until it is released.

use super::top_state::{Actions, TopBarAction};
use ocu_ui::bar::{self, Form};
use ocu_ui::{icons, tokens, widgets};
use ocu_views::edit;
use rcs_runtime::source::Frame;

/// Whether something is held.
pub(super) fn is_any(frame: &Frame) -> bool {
    !edit::held(frame).is_empty()
}

/// The menu of what is held.
pub(super) fn menu(ui: &mut egui::Ui, form: Form, frame: &Frame, actions: &mut Actions) {
    let held = edit::held(frame);
    let name = format!("{} held", held.len());
    let response = bar::menu(ui, form, icons::ICON_LOCK, &name, |ui| {
        ui.label(egui::RichText::new("Held by the operator").small().color(tokens(ui).weak));
        for (field, value, id) in &held {
            ui.horizontal(|ui| {
                ui.label(widgets::mono(format!("{field} = {value}")));
                let button = ui.button("Release");
                button.widget_info(|| {
                    egui::WidgetInfo::labeled(egui::Role::Button, true, format!("Release {field}"))
                });
                if button.clicked() {
                    actions.push(TopBarAction::Release(Some(*id)));
                }
            });
        }
        if held.len() > 1 && ui.button("Release all").clicked() {
            actions.push(TopBarAction::Release(None));
        }
    });
    response.on_hover_text("Values that replace what processes write, until they are released");
}
