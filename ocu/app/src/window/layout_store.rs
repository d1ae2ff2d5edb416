//! Storage of the user's arrangements: each layout as it was last arranged, in a file of its own, apart from the bundled
//! ones. They are written after every change by a thread of their own, so that they survive a crash.

use super::notices::{Matter, Notices};
use crate::kept_layouts::{self, file_name, is_bundled};
use crate::layout::Layout;
use crate::say;
use anyhow::Context as _;
use std::path::{Path, PathBuf};
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

fn write((path, layout): &(PathBuf, Layout), failed: &Sender<String>) {
    if let Err(error) = set_damaged_aside(path).and_then(|()| layout.save(path)) {
        // Nobody waits for it after the window has closed.
        let _ = failed.send(format!("the arrangement cannot be kept: {}", say(&error)));
    }
}

/// Keeps a file that cannot be read as a layout, with `.old` at the end of its name.
fn set_damaged_aside(path: &Path) -> anyhow::Result<()> {
    if !path.exists() || Layout::load(path).is_ok() {
        return Ok(());
    }
    let failed = || format!("the damaged file cannot be set aside: {}", path.display());
    std::fs::rename(path, aside(path)).with_context(failed)
}

/// Where a file is set aside.
fn aside(path: &Path) -> PathBuf {
    path.with_extension("ron.old")
}

impl LayoutStore {
    pub(super) fn new(folder: Option<PathBuf>) -> Self {
        let own = folder.as_deref().map(kept_layouts::names).unwrap_or_default();
        Self { folder, last: None, writer: None, own }
    }

    /// File of a layout.
    fn path(&self, name: &str) -> Option<PathBuf> {
        Some(self.folder.as_ref()?.join(file_name(name)))
    }

    /// The stored layout with this name, if any. The error says why its file cannot be used.
    pub(super) fn load(&self, name: &str) -> anyhow::Result<Option<Layout>> {
        self.folder.as_deref().map_or(Ok(None), |folder| kept_layouts::load(folder, name))
    }

    /// Deletes a layout of the user's. Its file is kept with `.old` at the end of its name, and that is returned.
    pub(super) fn delete(&mut self, name: &str) -> anyhow::Result<PathBuf> {
        let path = self.path(name).context("layouts are not kept")?;
        let aside = aside(&path);
        let failed = || format!("the layout cannot be deleted: {}", path.display());
        std::fs::rename(&path, &aside).with_context(failed)?;
        self.own.retain(|own| own != name);
        self.last = None;
        Ok(aside)
    }

    /// Names of the user's layouts that are none of the bundled ones.
    pub(super) fn own_names(&self) -> &[String] {
        &self.own
    }

    /// The layout of the user's that one with this name would replace, because it has the same file.
    pub(super) fn replaced_by(&self, name: &str) -> Option<&str> {
        let file = file_name(name);
        self.own.iter().map(String::as_str).find(|own| file_name(own) == file)
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
                let file = file_name(&layout.name);
                self.own.retain(|own| file_name(own) != file);
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_like_that_of_another_layout_takes_no_file_of_a_bundled_one_and_replaces_one_of_the_users() {
        let dir = tempfile::tempdir().unwrap();
        let folder = || Some(dir.path().join("layouts"));
        let layout = |name: &str| Layout { name: name.to_owned(), ..Layout::empty() };
        let mut store = LayoutStore::new(folder());
        for name in ["world_model", "world model", "a b"] {
            store.keep(&layout(name));
        }
        assert_eq!((store.replaced_by("a_b"), store.replaced_by("a c")), (Some("a b"), None));
        store.keep(&layout("a_b"));
        assert_eq!(store.own_names(), ["world model", "a_b"]);
        store.finish();

        let again = LayoutStore::new(folder());
        assert_eq!(again.own_names(), ["a_b", "world model"]);
        for name in ["world_model", "world model", "a_b"] {
            assert_eq!(again.load(name).unwrap().map(|layout| layout.name).as_deref(), Some(name));
        }
    }

    #[test]
    fn a_file_with_another_name_written_in_it_has_the_name_that_was_asked_for() {
        let dir = tempfile::tempdir().unwrap();
        let written = Layout { name: "world model".to_owned(), ..Layout::empty() };
        written.save(&dir.path().join("world_model.ron")).unwrap();
        let store = LayoutStore::new(Some(dir.path().to_owned()));
        let loaded = store.load("world_model").unwrap();
        assert_eq!(loaded, Some(Layout { name: "world_model".to_owned(), ..written }));
    }

    #[test]
    fn a_damaged_file_is_set_aside_before_its_layout_is_written() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("default.ron");
        std::fs::write(&path, "Layout(version: 1, na").unwrap();
        let mut store = LayoutStore::new(Some(dir.path().to_owned()));
        for buffers in [true, false] {
            let layout = Layout { name: "default".to_owned(), buffers, ..Layout::empty() };
            store.keep(&layout);
            store.finish();
            assert_eq!(Layout::load(&path).unwrap(), layout);
            assert_eq!(std::fs::read_to_string(aside(&path)).unwrap(), "Layout(version: 1, na");
        }
    }

    #[test]
    fn a_pipe_among_the_layouts_does_not_block_the_start() {
        let dir = tempfile::tempdir().unwrap();
        let mine = Layout { name: "mine".to_owned(), ..Layout::empty() };
        mine.save(&dir.path().join("mine.ron")).unwrap();
        for name in ["notes", "pipe.ron"] {
            // Where there is no such program, there is no pipe.
            let _ = std::process::Command::new("mkfifo").arg(dir.path().join(name)).status();
        }
        let store = LayoutStore::new(Some(dir.path().to_owned()));
        assert_eq!(store.own_names().first().map(String::as_str), Some("mine"));
    }
}
