//! Storage of the user's arrangements: each layout as it was last arranged, in a file of its own, apart from the bundled
//! ones. They are written after every change by a thread of their own, so that they survive a crash.

use super::notices::{Matter, Notices};
use crate::assets::read_text;
use crate::bundled;
use crate::layout::Layout;
use crate::say;
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

fn is_bundled(name: &str) -> bool {
    bundled::names("layout").contains(&name)
}

/// File name of a layout. Characters other than letters, digits and `-` in its name are replaced by `_`. No layout of the
/// user's has the file of a bundled one.
fn file_name(name: &str) -> String {
    let plain = |c: char| if c.is_alphanumeric() || c == '-' { c } else { '_' };
    let stem: String = name.chars().take(64).map(plain).collect();
    let prefix = if is_bundled(&stem) && !is_bundled(name) { "own-" } else { "" };
    format!("{prefix}{stem}.ron")
}

/// The name of the layout in a file: the one that is written in it, or that of the file if it cannot be read. `None` for
/// a file that no layout with that name would have.
fn name_of(path: &Path) -> Option<String> {
    if path.extension().is_none_or(|extension| extension != "ron") {
        return None;
    }
    let stem = path.file_stem()?.to_string_lossy().into_owned();
    let written = read_text(path).ok().and_then(|text| Layout::name_in(&text));
    let mut names = written.into_iter().chain([stem]);
    names.find(|name| path.file_name().is_some_and(|file| file == file_name(name).as_str()))
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
        let mut own: Vec<String> = paths.filter_map(|path| name_of(&path)).collect();
        own.retain(|name| !is_bundled(name));
        own.sort();
        Self { folder, last: None, writer: None, own }
    }

    /// File of a layout.
    fn path(&self, name: &str) -> Option<PathBuf> {
        Some(self.folder.as_ref()?.join(file_name(name)))
    }

    /// The stored layout with this name, if any.
    pub(super) fn load(&self, name: &str, notices: &mut Notices) -> Option<Layout> {
        let path = self.path(name).filter(|path| path.exists())?;
        match Layout::load(&path) {
            // A file from before may have another name written in it.
            Ok(layout) => Some(Layout { name: name.to_owned(), ..layout }),
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
        let mut notices = Notices::default();
        for name in ["world_model", "world model", "a_b"] {
            assert_eq!(again.load(name, &mut notices).map(|layout| layout.name).as_deref(), Some(name));
        }
    }

    #[test]
    fn a_file_with_another_name_written_in_it_has_the_name_that_was_asked_for() {
        let dir = tempfile::tempdir().unwrap();
        let written = Layout { name: "world model".to_owned(), ..Layout::empty() };
        written.save(&dir.path().join("world_model.ron")).unwrap();
        let store = LayoutStore::new(Some(dir.path().to_owned()));
        let loaded = store.load("world_model", &mut Notices::default());
        assert_eq!(loaded, Some(Layout { name: "world_model".to_owned(), ..written }));
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
