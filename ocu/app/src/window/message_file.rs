//! Saving a message to a file, and loading a file into a parameter: learned models, for example.

use crate::layout::write_whole;
use crate::say;
use ocu_ui::tokens;
use ocu_views::TopicKey;
use rcs_msg::AnyMessage;
use rcs_msg::params::with_params;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// What is done with the file.
enum What {
    /// The message is written to it.
    Save(AnyMessage),
    /// Its text becomes a parameter of a process.
    Load { process: Arc<str>, field: String, in_force: AnyMessage },
}

/// The dialog, while it is open.
pub(super) struct MessageFile {
    what: What,
    title: String,
    file: String,
    is_fresh: bool,
    /// Why the last attempt failed.
    failed: Option<String>,
}

/// What became of the dialog.
pub(super) enum Done {
    Cancelled,
    Saved(PathBuf),
    /// The parameters of a process, to be written.
    Loaded {
        process: Arc<str>,
        message: AnyMessage,
    },
}

impl MessageFile {
    /// Asks for the file to which a message is saved.
    pub(super) fn save(topic: &TopicKey, message: AnyMessage) -> Self {
        let file = format!("{}.json", topic.name.trim_matches('/').replace('/', "_"));
        let title = format!("Save {}", topic.name);
        Self { what: What::Save(message), title, file, is_fresh: true, failed: None }
    }

    /// Asks for the file whose text becomes a parameter.
    pub(super) fn load(process: &Arc<str>, field: String, in_force: AnyMessage) -> Self {
        let title = format!("Load {field} of {process}");
        let what = What::Load { process: Arc::clone(process), field, in_force };
        Self { what, title, file: String::new(), is_fresh: true, failed: None }
    }

    /// Paints the dialog; `None` while it is open.
    pub(super) fn ui(&mut self, ctx: &egui::Context) -> Option<Done> {
        let (mut open, mut done) = (true, None);
        let title = std::mem::take(&mut self.title);
        egui::Window::new(&title)
            .collapsible(false)
            .resizable(false)
            .default_width(480.0)
            .anchor(egui::Align2::CENTER_CENTER, egui::Vec2::ZERO)
            .open(&mut open)
            .show(ctx, |ui| {
                ui.horizontal(|ui| {
                    let label = ui.label("File");
                    let edit = egui::TextEdit::singleline(&mut self.file).desired_width(340.0);
                    let edit = ui.add(edit).labelled_by(label.id);
                    if std::mem::take(&mut self.is_fresh) {
                        edit.request_focus();
                    }
                    let path = PathBuf::from(self.file.trim());
                    let verb = match &self.what {
                        What::Load { .. } => "Load",
                        What::Save(_) if path.exists() => "Replace",
                        What::Save(_) => "Save",
                    };
                    let entered = edit.lost_focus() && ui.input(|input| input.key_pressed(egui::Key::Enter));
                    let ready = !self.file.trim().is_empty();
                    let pressed = ui.add_enabled(ready, egui::Button::new(verb)).clicked();
                    // A file is replaced by the button alone, on which that stands.
                    if ready && (pressed || (entered && verb != "Replace")) {
                        match self.carry_out(&path) {
                            Ok(result) => done = Some(result),
                            Err(error) => self.failed = Some(say(&error)),
                        }
                    }
                });
                if let Some(failed) = &self.failed {
                    let text = egui::RichText::new(failed).color(tokens(ui).error);
                    ui.add(egui::Label::new(text).wrap());
                }
            });
        self.title = title;
        let escaped = ctx.input(|input| input.key_pressed(egui::Key::Escape));
        if done.is_none() && (!open || escaped) {
            return Some(Done::Cancelled);
        }
        done
    }

    fn carry_out(&self, path: &Path) -> anyhow::Result<Done> {
        Ok(match &self.what {
            What::Save(message) => {
                write_whole(path, &rcs_msg::to_json(message)?)?;
                Done::Saved(path.to_owned())
            }
            What::Load { process, field, in_force } => {
                let text = crate::assets::read_text(path);
                let text = text.map_err(|error| anyhow::anyhow!("{error}: {}", path.display()))?;
                let message = with_params(in_force, [(field.as_str(), text.as_str())])?;
                Done::Loaded { process: Arc::clone(process), message }
            }
        })
    }
}
