//! Saving what a view shows, as a message, text or picture: asks where, and writes.

use super::dialog::{PathRow, Purpose, dialog, save};
use crate::output::Files;
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
    path: PathRow,
    content: Arc<[u8]>,
}

impl SaveFile {
    /// Asks where to write a file.
    pub(super) fn ask(&mut self, name: &str, content: Arc<[u8]>) {
        let folder = std::env::current_dir().unwrap_or_default();
        let path = PathRow::new(folder.join(name).display().to_string());
        self.open = Some(Dialog { path, content });
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

    /// Paints the dialog; no file of `in_use` is written. Returns the file that was written.
    pub(super) fn ui(&mut self, ctx: &egui::Context, in_use: impl FnOnce() -> Files) -> Option<PathBuf> {
        self.take_picture(ctx);
        let Dialog { path, content } = self.open.as_mut()?;
        let mut written = None;
        let open = dialog(ctx, "Save", |ui| {
            written = path.ui(ui, Purpose::Save, true, |path| {
                save(path, content, in_use())?;
                Ok(path.to_owned())
            });
            let size = ocu_ui::format::bytes(content.len() as u64);
            ui.label(RichText::new(size).small().color(tokens(ui).weak));
        });
        if written.is_some() || !open {
            self.open = None;
        }
        written
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
