//! Saving what a view shows, as text or as a picture: asks where, and writes.

use crate::say;
use egui::{ColorImage, RichText};
use ocu_ui::tokens;
use std::io::Cursor;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, TryRecvError, channel};

/// The dialog, while it is open.
#[derive(Default)]
pub(super) struct SaveFile {
    open: Option<Dialog>,
    /// The part of the window that a picture will be of, once the window has drawn it.
    awaited: Option<(egui::Rect, String, Receiver<Arc<ColorImage>>)>,
}

struct Dialog {
    path: String,
    content: Arc<[u8]>,
    /// Why the last attempt failed.
    failed: Option<String>,
    fresh: bool,
}

impl SaveFile {
    /// Asks where to write a file.
    pub(super) fn ask(&mut self, name: &str, content: Arc<[u8]>) {
        let folder = std::env::current_dir().unwrap_or_default();
        let path = folder.join(name).display().to_string();
        self.open = Some(Dialog { path, content, failed: None, fresh: true });
    }

    /// Takes a picture of a part of the window, and then asks where to write it.
    pub(super) fn ask_picture(&mut self, ctx: &egui::Context, name: &str, area: egui::Rect) {
        let (sender, receiver) = channel();
        let waking = ctx.clone();
        ctx.request_screenshot(move |image| {
            // Fails if another picture was asked for meanwhile.
            let _ = sender.send(image);
            waking.request_repaint();
        });
        self.awaited = Some((area, name.to_owned(), receiver));
    }

    /// Paints the dialog.
    pub(super) fn ui(&mut self, ctx: &egui::Context) {
        self.take_picture(ctx);
        let Some(dialog) = &mut self.open else { return };
        let (mut open, mut done) = (true, false);
        egui::Window::new("Save")
            .collapsible(false)
            .resizable(false)
            .default_width(480.0)
            .anchor(egui::Align2::CENTER_CENTER, egui::Vec2::ZERO)
            .open(&mut open)
            .show(ctx, |ui| {
                ui.horizontal(|ui| {
                    let label = ui.label("File");
                    let edit = egui::TextEdit::singleline(&mut dialog.path).desired_width(360.0);
                    let response = ui.add(edit).labelled_by(label.id);
                    if std::mem::take(&mut dialog.fresh) {
                        response.request_focus();
                    }
                    let path = PathBuf::from(dialog.path.trim());
                    let verb = if path.exists() { "Replace" } else { "Save" };
                    let entered =
                        response.lost_focus() && ui.input(|input| input.key_pressed(egui::Key::Enter));
                    let can = !dialog.path.trim().is_empty();
                    if (ui.add_enabled(can, egui::Button::new(verb)).clicked() || entered) && can {
                        match std::fs::write(&path, &dialog.content) {
                            Ok(()) => done = true,
                            Err(error) => {
                                dialog.failed = Some(say(&anyhow::anyhow!("{error}: {}", path.display())));
                            }
                        }
                    }
                });
                let size = ocu_ui::format::bytes(dialog.content.len() as u64);
                ui.label(RichText::new(size).small().color(tokens(ui).weak));
                if let Some(failed) = &dialog.failed {
                    ui.colored_label(tokens(ui).error, failed);
                }
            });
        if done || !open || ctx.input(|input| input.key_pressed(egui::Key::Escape)) {
            self.open = None;
        }
    }

    fn take_picture(&mut self, ctx: &egui::Context) {
        let Some((area, name, receiver)) = &self.awaited else { return };
        let image = match receiver.try_recv() {
            Ok(image) => image,
            Err(TryRecvError::Empty) => return,
            Err(TryRecvError::Disconnected) => return self.awaited = None,
        };
        let part = image.region(area, Some(ctx.pixels_per_point()));
        let name = name.clone();
        self.awaited = None;
        match png(&part) {
            Ok(content) => self.ask(&name, content.into()),
            Err(error) => tracing::error!("the picture cannot be compressed: {error}"),
        }
    }
}

/// An image as PNG.
fn png(part: &ColorImage) -> image::ImageResult<Vec<u8>> {
    let [width, height] = part.size.map(|side| side as u32);
    let rgba: Vec<u8> = part.pixels.iter().flat_map(egui::Color32::to_array).collect();
    let mut content = Cursor::new(Vec::new());
    let picture = image::RgbaImage::from_raw(width, height, rgba).unwrap_or_default();
    picture.write_to(&mut content, image::ImageFormat::Png)?;
    Ok(content.into_inner())
}
