//! What the dialogs that ask for a file share: their frame, the row with the path, and the rules of writing to it.

use crate::output::{self, Files};
use crate::say;
use egui::{Button, Id, Key, RichText, TextEdit, Ui};
use ocu_ui::{tokens, typing};
use std::path::{Path, PathBuf};

/// Paints a dialog in the middle of the window; `false` once the user has closed it.
pub(super) fn dialog(ctx: &egui::Context, title: &str, contents: impl FnOnce(&mut Ui)) -> bool {
    let mut open = true;
    egui::Window::new(title)
        .collapsible(false)
        .resizable(false)
        .default_width(480.0)
        .anchor(egui::Align2::CENTER_CENTER, egui::Vec2::ZERO)
        .open(&mut open)
        .show(ctx, |ui| {
            contents(ui);
            closing_hint(ui);
        });
    open && !ctx.input(|input| input.key_pressed(Key::Escape))
}

/// Where the key that closes dialogs and the palette is noted.
fn closing_key() -> Id {
    Id::unique("the key that closes dialogs")
}

/// Notes the key that closes dialogs and the palette, which they say; empty where there is none.
pub(super) fn note_closing_key(ctx: &egui::Context, key: String) {
    ctx.data_mut(|data| data.insert_temp(closing_key(), key));
}

/// Says which key closes what is open: Escape stops the vehicle where there is one.
pub(super) fn closing_hint(ui: &mut Ui) {
    let key: String = ui.data(|data| data.get_temp(closing_key())).unwrap_or_default();
    if !key.is_empty() {
        ui.label(RichText::new(format!("{key} closes")).small().color(tokens(ui).weak));
    }
}

/// What is done with the file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Purpose {
    Load,
    Save,
}

/// A path, the button that acts on it, and why the last attempt failed.
#[derive(Debug)]
pub(super) struct PathRow {
    text: String,
    is_fresh: bool,
    failed: Option<String>,
}

impl PathRow {
    pub(super) fn new(text: impl Into<String>) -> Self {
        Self { text: text.into(), is_fresh: true, failed: None }
    }

    /// Paints the row. Calls `act` with the path when the user confirms, by the button or by Enter; an existing file is
    /// replaced only by the button, which says so. Returns what `act` did; its error is shown below the row.
    pub(super) fn ui<T>(
        &mut self,
        ui: &mut Ui,
        purpose: Purpose,
        enabled: bool,
        act: impl FnOnce(&Path) -> anyhow::Result<T>,
    ) -> Option<T> {
        let mut confirmed = None;
        ui.horizontal(|ui| {
            let label = ui.label("File");
            let edit =
                ui.add(TextEdit::singleline(&mut self.text).desired_width(360.0)).labelled_by(label.id);
            let entered = typing::entered(&edit);
            typing::keep_keyboard(&edit, std::mem::take(&mut self.is_fresh));
            let path = PathBuf::from(self.text.trim());
            let replaces = purpose == Purpose::Save && path.exists();
            let verb = match purpose {
                Purpose::Load => "Load",
                Purpose::Save if replaces => "Replace",
                Purpose::Save => "Save",
            };
            let enabled = enabled && !path.as_os_str().is_empty();
            let clicked = ui.add_enabled(enabled, Button::new(verb)).clicked();
            if enabled && (clicked || (entered && !replaces)) {
                confirmed = Some(path);
            }
        });
        let done =
            confirmed.and_then(|path| act(&path).map_err(|error| self.failed = Some(say(&error))).ok());
        if let Some(failed) = &self.failed {
            ui.add(egui::Label::new(RichText::new(failed).color(tokens(ui).error)).wrap());
        }
        done
    }
}

/// Writes a complete file. It may replace another one, but not one of `in_use`.
pub(super) fn save(path: &Path, bytes: &[u8], mut in_use: Files) -> anyhow::Result<()> {
    in_use.writes("Save", path)?;
    output::write(path, bytes, true)
}

#[cfg(test)]
mod tests {
    use super::*;
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable as _;

    #[test]
    fn a_dialog_says_which_key_closes_it() {
        let mut harness = Harness::builder().with_context_setup(ocu_ui::install).build_ui(|ui| {
            note_closing_key(ui.ctx(), "F4".to_owned());
            dialog(ui.ctx(), "Save", |_| {});
        });
        harness.run();
        assert!(harness.query_by_label("F4 closes").is_some());
    }
}
