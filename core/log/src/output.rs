//! The file of a recording: begun so that nothing is lost that was there before, and held so that nobody else begins it.
//!
//! A new file is created, never opened over another. One that may be replaced is written beside the old one and takes its
//! name as soon as the log has begun: the old file is there until then, and a recording that is killed later is found
//! under its own name. While a recording goes on, its file is locked against other recorders (an advisory lock, which
//! the system lets go of when the program ends, however it ends).

use crate::error::LogError;
use std::fs::{File, OpenOptions, TryLockError};
use std::io;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

/// A file that a recording is to be written to.
#[derive(Debug)]
pub(crate) struct Output {
    file: Option<File>,
    replaces: Option<Replaced>,
}

/// The file that is to be replaced.
#[derive(Debug)]
struct Replaced {
    target: PathBuf,
    /// Where the new one stands meanwhile.
    beside: PathBuf,
    /// Locked until its name is the new one's.
    _old: File,
}

impl Output {
    /// Creates the file at `path`; where there is one already, one beside it if it may be replaced.
    pub(crate) fn create(path: &Path, replace: bool) -> Result<Self, LogError> {
        let failed = |source| LogError::Create { path: path.to_owned(), source };
        let lock = |file: File| match file.try_lock() {
            Err(TryLockError::WouldBlock) => Err(LogError::Busy { path: path.to_owned() }),
            // Some file systems have no locks.
            Ok(()) | Err(TryLockError::Error(_)) => Ok(file),
        };
        match OpenOptions::new().write(true).create_new(true).open(path) {
            Ok(file) => return Ok(Self { file: Some(lock(file)?), replaces: None }),
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {}
            Err(error) => return Err(failed(error)),
        }
        // The file itself, where the path is a link to it; not opened before it is known to be a file: a pipe waits.
        let target = path.canonicalize().map_err(failed)?;
        if !target.metadata().map_err(failed)?.is_file() {
            return Err(failed(io::Error::other("expected a regular file")));
        }
        let old = lock(File::open(&target).map_err(failed)?)?;
        if !replace {
            return Err(LogError::Exists { path: path.to_owned() });
        }
        // Between opening and locking it, another recorder may have put its own file there.
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

    /// The log has begun: its file takes the old one's place.
    pub(crate) fn begun(mut self) -> io::Result<()> {
        match self.replaces.take() {
            Some(Replaced { target, beside, .. }) => std::fs::rename(beside, target),
            None => Ok(()),
        }
    }
}

impl Drop for Output {
    /// A log that did not begin leaves nothing beside the old one.
    fn drop(&mut self) {
        if let Some(Replaced { beside, .. }) = &self.replaces {
            let _ = std::fs::remove_file(beside);
        }
    }
}
