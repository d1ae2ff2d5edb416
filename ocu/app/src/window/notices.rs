//! Error messages, shown at the top of the window until they are dismissed.

use ocu_ui::{icons, tokens, widgets};

/// Maximum number of messages; older ones are dropped.
const MOST: usize = 4;

/// The current messages.
#[derive(Debug, Default)]
pub(super) struct Notices {
    texts: Vec<String>,
    /// The source's error that was dismissed; it is shown again when it changes.
    dismissed: Option<String>,
}

impl Notices {
    /// Adds an error, unless the same one is already shown.
    pub(super) fn error(&mut self, text: impl Into<String>) {
        let text = text.into();
        self.texts.retain(|known| *known != text);
        self.texts.push(text);
        let surplus = self.texts.len().saturating_sub(MOST);
        self.texts.drain(..surplus);
    }

    /// Paints a line for each message, and for the source's own error.
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

/// One line; returns whether it was dismissed.
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
