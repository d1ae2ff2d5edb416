//! What went wrong, said where it cannot be missed, until it is dismissed.

use ocu_ui::{icons, tokens, widgets};

/// Notices are kept to the newest few.
const MOST: usize = 4;

/// Everything that is to be said now.
#[derive(Debug, Default)]
pub(super) struct Notices {
    texts: Vec<String>,
    /// The source's own error that was dismissed; it is shown again when it changes.
    dismissed: Option<String>,
}

impl Notices {
    /// Says that something could not be done; the same thing once.
    pub(super) fn error(&mut self, text: impl Into<String>) {
        let text = text.into();
        self.texts.retain(|known| *known != text);
        self.texts.push(text);
        let surplus = self.texts.len().saturating_sub(MOST);
        self.texts.drain(..surplus);
    }

    /// Shows a line for each notice, and for the source's own error.
    pub(super) fn ui(&mut self, ui: &mut egui::Ui, source_error: Option<&str>) {
        let mut closed = None;
        for (index, text) in self.texts.iter().enumerate() {
            if line(ui, text) {
                closed = Some(index);
            }
        }
        if let Some(index) = closed {
            self.texts.remove(index);
        }
        match source_error {
            None => self.dismissed = None,
            Some(text) if self.dismissed.as_deref() == Some(text) => {}
            Some(text) => {
                if line(ui, text) {
                    self.dismissed = Some(text.to_owned());
                }
            }
        }
    }

    /// Whether there is anything to show.
    pub(super) fn is_empty(&self, source_error: Option<&str>) -> bool {
        self.texts.is_empty() && (source_error.is_none() || self.dismissed.as_deref() == source_error)
    }
}

/// One line; `true` when it was dismissed.
fn line(ui: &mut egui::Ui, text: &str) -> bool {
    let error = tokens(ui).error;
    ui.horizontal(|ui| {
        ui.label(icons::ICON_ERROR.rich_text().size(16.0).color(error));
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
            let closed = widgets::icon_button(ui, icons::ICON_CLOSE, "Dismiss").clicked();
            ui.with_layout(egui::Layout::left_to_right(egui::Align::Center), |ui| {
                ui.add(egui::Label::new(text).wrap());
            });
            closed
        })
        .inner
    })
    .inner
}
