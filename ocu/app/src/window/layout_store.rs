//! Storage of the user's arrangements: each layout as it was last arranged, in a file of its own, apart from the bundled
//! ones. They are written after every change by a thread of their own, so that they survive a crash.

use super::notices::{Matter, Notices};
use crate::bundled;
use crate::layout::Layout;
use crate::say;
use std::path::PathBuf;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::JoinHandle;

/// Stores the user's arrangements.
pub(super) struct LayoutStore {
    folder: Option<PathBuf>,
    last: Option<Layout>,
    writer: Option<Writer>,
    /// Names of the user's layouts that are none of the bundled ones.
    own: Vec<String>,
}

/// The thread that writes.
struct Writer {
    layouts: Sender<(PathBuf, Layout)>,
    errors: Receiver<String>,
    thread: JoinHandle<()>,
}

impl Writer {
    fn start() -> std::io::Result<Self> {
        let (layouts, jobs) = channel::<(PathBuf, Layout)>();
        let (failed, errors) = channel();
        let thread = std::thread::Builder::new().name("layouts".to_owned()).spawn(move || {
            while let Ok(mut job) = jobs.recv() {
                // Of several states of one layout only the last is written.
                while let Ok(next) = jobs.try_recv() {
                    if next.0 != job.0 {
                        write(&job, &failed);
                    }
                    job = next;
                }
                write(&job, &failed);
            }
        })?;
        Ok(Self { layouts, errors, thread })
    }
}

fn is_bundled(name: &str) -> bool {
    bundled::names("layout").contains(&name)
}

fn write((path, layout): &(PathBuf, Layout), failed: &Sender<String>) {
    if let Err(error) = layout.save(path) {
        // Nobody waits for it after the window has closed.
        let _ = failed.send(format!("the arrangement cannot be kept: {}", say(&error)));
    }
}

impl LayoutStore {
    pub(super) fn new(folder: Option<PathBuf>) -> Self {
        let files = folder.as_deref().map(std::fs::read_dir).and_then(Result::ok);
        let paths = files.into_iter().flatten().flatten().map(|file| file.path());
        let layouts = paths.filter(|path| path.extension().is_some_and(|extension| extension == "ron"));
        let names = layouts.filter_map(|path| Some(path.file_stem()?.to_string_lossy().into_owned()));
        let mut own: Vec<String> = names.filter(|name| !is_bundled(name)).collect();
        own.sort();
        Self { folder, last: None, writer: None, own }
    }

    /// File of a layout. Characters other than letters, digits and `-` in its name are replaced by `_`.
    fn path(&self, name: &str) -> Option<PathBuf> {
        let plain = |c: char| if c.is_alphanumeric() || c == '-' { c } else { '_' };
        let file: String = name.chars().take(64).map(plain).collect();
        Some(self.folder.as_ref()?.join(format!("{file}.ron")))
    }

    /// The stored layout with this name, if any.
    pub(super) fn load(&self, name: &str, notices: &mut Notices) -> Option<Layout> {
        let path = self.path(name).filter(|path| path.exists())?;
        match Layout::load(&path) {
            Ok(layout) => Some(layout),
            Err(error) => {
                let text = format!("the arrangement that was kept cannot be used: {}", say(&error));
                notices.error(Matter::Layout, text);
                None
            }
        }
    }

    /// Names of the user's layouts that are none of the bundled ones.
    pub(super) fn own_names(&self) -> &[String] {
        &self.own
    }

    /// Stores a layout if it has changed.
    pub(super) fn keep(&mut self, layout: &Layout) {
        let Some(path) = self.path(&layout.name).filter(|_| self.last.as_ref() != Some(layout)) else {
            return;
        };
        if self.writer.is_none() {
            self.writer = Writer::start().ok();
        }
        if let Some(writer) = &self.writer {
            self.last = Some(layout.clone());
            if !is_bundled(&layout.name) && !self.own.contains(&layout.name) {
                self.own.push(layout.name.clone());
            }
            let _ = writer.layouts.send((path, layout.clone()));
        }
    }

    /// Reports what could not be written. The reason is said once: it does not change by itself.
    pub(super) fn report(&mut self, notices: &mut Notices) {
        if let Some(error) = self.writer.as_ref().and_then(|writer| writer.errors.try_recv().ok()) {
            notices.error(Matter::Layout, error);
            self.folder = None;
        }
    }

    /// Waits until everything is written.
    pub(super) fn finish(&mut self) {
        if let Some(Writer { layouts, thread, .. }) = self.writer.take() {
            drop(layouts);
            let _ = thread.join();
        }
    }
}
