//! Saving parameters to the stack file: the difference is shown first, and written when the user says so.

use super::dialog::{PathRow, Purpose, dialog, save};
use crate::open::Request;
use crate::output::Files;
use crate::{say, stack_edit, stacks};
use egui::{RichText, ScrollArea};
use ocu_ui::{tokens, widgets};
use rcs_msg::AnyMessage;
use similar::{ChangeTag, TextDiff};
use std::path::PathBuf;

/// The dialog, while it is open.
pub(super) struct SaveParams {
    process: String,
    /// The file, which the user may change.
    file: PathRow,
    /// The text of the stack before and after, or why it cannot be written.
    edit: Result<(String, String), String>,
}

/// What became of the dialog.
pub(super) enum Saved {
    Open,
    Cancelled,
    Written(PathBuf),
}

impl SaveParams {
    /// Prepares to write parameters into the stack that runs.
    pub(super) fn new(current: &Request, process: &str, params: &AnyMessage) -> Self {
        let prepared = prepare(current, process, params).map_err(|error| say(&error));
        let (file, edit) = match prepared {
            Ok((file, old, new)) => (file, Ok((old, new))),
            Err(error) => (String::new(), Err(error)),
        };
        Self { process: process.to_owned(), file: PathRow::new(file), edit }
    }

    /// Paints the dialog; no file of `in_use` is written.
    pub(super) fn ui(&mut self, ctx: &egui::Context, in_use: impl FnOnce() -> Files) -> Saved {
        let mut written = None;
        let open = dialog(ctx, &format!("Save the parameters of {}", self.process), |ui| {
            let (old, new) = match &self.edit {
                Ok(both) => both,
                Err(error) => {
                    ui.add(egui::Label::new(RichText::new(error).color(tokens(ui).error)).wrap());
                    return;
                }
            };
            difference(ui, old, new);
            ui.add_space(4.0);
            written = self.file.ui(ui, Purpose::Save, old != new, |path| {
                save(path, new.as_bytes(), in_use())?;
                Ok(path.to_owned())
            });
        });
        match written {
            Some(path) => Saved::Written(path),
            None if open => Saved::Open,
            None => Saved::Cancelled,
        }
    }
}

/// The file to write, and the text of the stack before and after.
fn prepare(
    current: &Request,
    process: &str,
    params: &AnyMessage,
) -> anyhow::Result<(String, String, String)> {
    let Some(spec) = &current.stack else {
        anyhow::bail!("nothing runs here from a stack file, so there is none to write to");
    };
    let (file, text) = stacks::text_of(spec)?;
    let new = stack_edit::with_params(&file, &text, current.course.as_deref(), process, params)?;
    Ok((file, text, new))
}

/// The changed lines with three lines around them: marked by sign and colour.
fn difference(ui: &mut egui::Ui, old: &str, new: &str) {
    let tokens = tokens(ui);
    if old == new {
        ui.label("The stack file says the same already.");
        return;
    }
    let diff = TextDiff::from_lines(old, new);
    ScrollArea::vertical().max_height(320.0).show(ui, |ui| {
        ui.spacing_mut().item_spacing.y = 0.0;
        for group in diff.grouped_ops(3) {
            for change in group.iter().flat_map(|op| diff.iter_changes(op)) {
                let (sign, color) = match change.tag() {
                    ChangeTag::Delete => ('−', tokens.error),
                    ChangeTag::Insert => ('+', tokens.ok),
                    ChangeTag::Equal => (' ', tokens.weak),
                };
                let text = format!("{sign} {}", change.value().trim_end());
                ui.add(egui::Label::new(widgets::mono(text).color(color)).extend());
            }
            ui.add_space(6.0);
        }
    });
}
