//! Persistent storage of the user's arrangements.

use super::notices::Notices;
use crate::layout::Layout;
use crate::say;
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Minimum interval between two writes.
const KEEP_EVERY: Duration = Duration::from_secs(2);

/// Stores each layout as last arranged in a file of its own, so that it survives a crash.
pub(super) struct LayoutStore {
    folder: Option<PathBuf>,
    last: Option<Layout>,
    looked: Instant,
}

impl LayoutStore {
    pub(super) fn new(folder: Option<PathBuf>) -> Self {
        Self { folder, last: None, looked: Instant::now() }
    }

    /// File of a layout. Characters other than letters, digits and `-` in its name are replaced by `_`.
    fn path(&self, name: &str) -> Option<PathBuf> {
        let plain = |c: char| if c.is_alphanumeric() || c == '-' { c } else { '_' };
        let file: String = name.chars().take(64).map(plain).collect();
        Some(self.folder.as_ref()?.join(format!("{file}.ron")))
    }

    /// The stored layout with this name, if any.
    pub(super) fn load(&mut self, name: &str, notices: &mut Notices) -> Option<Layout> {
        let path = self.path(name).filter(|path| path.exists())?;
        match Layout::load(&path) {
            Ok(layout) => {
                self.last = Some(layout.clone());
                Some(layout)
            }
            Err(error) => {
                notices.error(format!("the arrangement that was kept cannot be used: {}", say(&error)));
                None
            }
        }
    }

    /// Whether the layout should be checked for changes now.
    pub(super) fn is_due(&mut self) -> bool {
        let due = self.folder.is_some() && self.looked.elapsed() >= KEEP_EVERY;
        if due {
            self.looked = Instant::now();
        }
        due
    }

    /// Writes the layout if it has changed.
    pub(super) fn keep(&mut self, layout: &Layout, notices: &mut Notices) {
        let Some(path) = self.path(&layout.name).filter(|_| self.last.as_ref() != Some(layout)) else {
            return;
        };
        if let Err(error) = layout.save(&path) {
            // Reported once: repeating it every two seconds would not help.
            notices.error(format!("the arrangement cannot be kept: {}", say(&error)));
            self.folder = None;
            return;
        }
        self.last = Some(layout.clone());
    }
}
