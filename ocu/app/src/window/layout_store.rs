//! What the window remembers of its arrangement from one start to the next.

use super::notices::Notices;
use crate::layout::Layout;
use crate::say;
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// The arrangement is written this long after the last time, at the soonest.
const KEEP_EVERY: Duration = Duration::from_secs(2);

/// Keeps each layout as it was last arranged, in a file of its own, so that it survives a crash.
pub(super) struct LayoutStore {
    folder: Option<PathBuf>,
    last: Option<Layout>,
    looked: Instant,
}

impl LayoutStore {
    pub(super) fn new(folder: Option<PathBuf>) -> Self {
        Self { folder, last: None, looked: Instant::now() }
    }

    /// File of the layout of that name; a name may hold anything, a file's name may not.
    fn path(&self, name: &str) -> Option<PathBuf> {
        let plain = |c: char| if c.is_alphanumeric() || c == '-' { c } else { '_' };
        let file: String = name.chars().take(64).map(plain).collect();
        Some(self.folder.as_ref()?.join(format!("{file}.ron")))
    }

    /// The layout of that name as it was left, if it was.
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

    /// Whether it is time to look whether anything has changed.
    pub(super) fn is_due(&mut self) -> bool {
        let due = self.folder.is_some() && self.looked.elapsed() >= KEEP_EVERY;
        if due {
            self.looked = Instant::now();
        }
        due
    }

    /// Writes the layout, if it has changed.
    pub(super) fn keep(&mut self, layout: &Layout, notices: &mut Notices) {
        let Some(path) = self.path(&layout.name).filter(|_| self.last.as_ref() != Some(layout)) else {
            return;
        };
        if let Err(error) = layout.save(&path) {
            // Said once; trying again every two seconds would not help.
            notices.error(format!("the arrangement cannot be kept: {}", say(&error)));
            self.folder = None;
            return;
        }
        self.last = Some(layout.clone());
    }
}
