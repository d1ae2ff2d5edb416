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
    let faults = held.iter().filter(|held| held.is_fault).count();
    let values = held.len() - faults;
    let fault_word = if faults == 1 { "fault on demand" } else { "faults on demand" };
    let (icon, name) = match (values, faults) {
        (_, 0) => (icons::ICON_LOCK, format!("{values} held")),
        (0, _) => (icons::ICON_BUG_REPORT, format!("{faults} {fault_word}")),
        _ => (icons::ICON_BUG_REPORT, format!("{values} held, {faults} {fault_word}")),
    };
    if faults > 0 {
        ui.visuals_mut().override_text_color = Some(tokens(ui).warning);
    }
    let response = bar::menu(ui, form, icon, &name, |ui| {
        for (is_fault, title) in [(false, "Held by the operator"), (true, "Faults on demand")] {
            let mut group = held.iter().filter(|held| held.is_fault == is_fault).peekable();
            if group.peek().is_some() {
                ui.label(egui::RichText::new(title).small().color(tokens(ui).weak));
            }
            for held in group {
                let row = |ui: &mut egui::Ui| {
                    let is = if is_fault { ":" } else { " =" };
                    ui.label(widgets::mono(format!("{}{is} {}", held.target, held.what)));
                    let button = ui.button("Release");
                    button.widget_info(|| {
                        let label = format!("Release {} {}", held.target, held.what);
                        egui::WidgetInfo::labeled(egui::Role::Button, true, label)
                    });
                    if button.clicked() {
                        actions.push(TopBarAction::Release(Some(held.id)));
                    }
                };
                // One that ends while the mouse is pressed moves those after it.
                widgets::named(ui, held.id, |ui| ui.horizontal(row).inner);
            }
        }
        if held.len() > 1 && widgets::named(ui, "all", |ui| ui.button("Release all").clicked()) {
            actions.push(TopBarAction::Release(None));
        }
    });
    response.on_hover_text(
        "Values that replace what processes write, and faults on demand, until they are released",
    );
}
