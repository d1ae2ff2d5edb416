//! The output file of a recording: protects existing files, and excludes other recorders.
//!
//! A new file is created, never opened over another. A file that replaces an existing one is written beside it, and
//! renamed to its name as soon as the log has begun: until then the old file exists, and a recording that is killed
//! later has its final name. During a recording the file has an advisory lock against other recorders, which the system
//! releases when the program ends in any way.

use crate::error::LogError;
use std::fs::{File, OpenOptions, TryLockError};
use std::io;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

/// The output file of a recording.
#[derive(Debug)]
pub(crate) struct Output {
    file: Option<File>,
    replaces: Option<Replaced>,
}

/// The file to replace.
#[derive(Debug)]
struct Replaced {
    target: PathBuf,
    /// Path of the new file until it is renamed.
    beside: PathBuf,
    /// Locked until the new file has its name.
    _old: File,
}

impl Output {
    /// Creates the file at `path`; if one exists and may be replaced, creates a file beside it.
    pub(crate) fn create(path: &Path, replace: bool) -> Result<Self, LogError> {
        let failed = |source| LogError::Create { path: path.to_owned(), source };
        let lock = |file: File| match file.try_lock() {
            Err(TryLockError::WouldBlock) => Err(LogError::Busy { path: path.to_owned() }),
            // Some file systems do not support locks.
            Ok(()) | Err(TryLockError::Error(_)) => Ok(file),
        };
        match OpenOptions::new().write(true).create_new(true).open(path) {
            Ok(file) => return Ok(Self { file: Some(lock(file)?), replaces: None }),
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {}
            Err(error) => return Err(failed(error)),
        }
        // The target of a link. It is opened only after checking that it is a file, because opening a pipe would block.
        let target = path.canonicalize().map_err(failed)?;
        if !target.metadata().map_err(failed)?.is_file() {
            return Err(failed(io::Error::other("expected a regular file")));
        }
        let old = lock(File::open(&target).map_err(failed)?)?;
        if !replace {
            return Err(LogError::Exists { path: path.to_owned() });
        }
        // Another recorder may have replaced the file between opening and locking it.
        let (was, is) = (old.metadata().map_err(failed)?, target.metadata().map_err(failed)?);
        if (was.dev(), was.ino()) != (is.dev(), is.ino()) {
            return Err(LogError::Busy { path: path.to_owned() });
        }
        let name = target.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let beside = target.with_file_name(format!(".{name}.{}.new", std::process::id()));
        let file = OpenOptions::new().write(true).create_new(true).open(&beside).map_err(failed)?;
        let replaces = Some(Replaced { target, beside, _old: old });
        Ok(Self { file: Some(lock(file)?), replaces })
    }

    /// The file to write to.
    pub(crate) fn take_file(&mut self) -> Option<File> {
        self.file.take()
    }

    /// To be called when the log has begun: renames the new file to the old one's name.
    pub(crate) fn begun(mut self) -> io::Result<()> {
        match self.replaces.take() {
            Some(Replaced { target, beside, .. }) => std::fs::rename(beside, target),
            None => Ok(()),
        }
    }
}

impl Drop for Output {
    /// A log that did not begin leaves no file beside the old one.
    fn drop(&mut self) {
        if let Some(Replaced { beside, .. }) = &self.replaces {
            let _ = std::fs::remove_file(beside);
        }
    }
}
