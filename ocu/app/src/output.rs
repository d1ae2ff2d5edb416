//! Output files of a command: never written onto a file that is in use, and over another file only with `--force`.
//!
//! Files are identified by device and inode, so that different spellings, links or handles of one file are recognized.
//! All checks are made before any file is opened.

use crate::{parts, usage};
use anyhow::Context as _;
use std::fs::OpenOptions;
use std::io::Write as _;
use std::os::unix::fs::{FileTypeExt as _, MetadataExt as _};
use std::path::{Path, PathBuf};

/// The files that a command reads and writes.
#[derive(Clone, Debug)]
pub(crate) struct Files {
    /// Whether an existing file may be replaced.
    force: bool,
    used: Vec<(Identity, String)>,
}

/// Identity of a file.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Identity {
    /// Device and inode of an existing file.
    There(u64, u64),
    /// Folder and name of a file that does not exist.
    Absent(PathBuf),
}

impl Identity {
    fn of(path: &Path) -> Option<Self> {
        if let Ok(metadata) = path.metadata() {
            return Some(Self::There(metadata.dev(), metadata.ino()));
        }
        let folder = folder_of(path).canonicalize().ok()?;
        Some(Self::Absent(folder.join(path.file_name()?)))
    }
}

/// The folder that contains a file.
fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

impl Files {
    /// An empty list. With `force`, existing files may be replaced.
    pub(crate) fn new(force: bool) -> Self {
        Self { force, used: Vec::new() }
    }

    /// Adds a file that is read; `what` describes it in errors.
    pub(crate) fn reads(&mut self, what: &str, path: &Path) {
        if let Some(identity) = Identity::of(path) {
            self.used.push((identity, what.to_owned()));
        }
    }

    /// Adds a recording that is read, with all files into which it was split. A path that is no recording is refused when
    /// it is opened.
    pub(crate) fn reads_log(&mut self, what: &str, path: &Path) {
        self.reads(what, path);
        parts::of(path).unwrap_or_default().iter().for_each(|part| self.reads(what, part));
    }

    /// Adds a file that the flag `flag` writes. Refuses a file in use, a path that is not a regular file, a link that
    /// leads to no file (it may be an output of this command later), and an existing file unless it may be replaced.
    pub(crate) fn writes(&mut self, flag: &str, path: &Path) -> anyhow::Result<()> {
        let refused = |text: &str| Err(usage(format!("{flag}: {text}: {}", path.display())));
        let Some(identity) = Identity::of(path) else {
            return refused("expected a file in a folder that is there");
        };
        if let Some((_, what)) = self.used.iter().find(|(used, _)| *used == identity) {
            return refused(&format!("the file is {what}; expected another one to write to"));
        }
        if path.is_symlink() && !path.exists() {
            return refused("expected a file or a new name, got a link that leads to no file");
        }
        if let Ok(metadata) = path.metadata() {
            if !metadata.is_file() {
                return refused(&format!("expected a regular file, got {}", kind(metadata.file_type())));
            }
            if !self.force {
                return refused("the file exists already; expected a new one, or --force to replace it");
            }
        }
        self.used.push((identity, format!("what {flag} writes")));
        Ok(())
    }
}

fn kind(kind: std::fs::FileType) -> &'static str {
    if kind.is_dir() {
        "a folder"
    } else if kind.is_fifo() {
        "a pipe"
    } else if kind.is_socket() {
        "a socket"
    } else {
        "a device"
    }
}

/// Writes a complete file, or none. With `force` it may replace an existing one, which stays in place until the new one is
/// complete.
pub(crate) fn write(path: &Path, bytes: &[u8], force: bool) -> anyhow::Result<()> {
    let attempt = || {
        let mut new = OpenOptions::new();
        new.write(true).create_new(true);
        if !(force && path.exists()) {
            let written = new.open(path)?.write_all(bytes);
            if written.is_err() {
                // A part of a file looks like a file.
                let _ = std::fs::remove_file(path);
            }
            return written;
        }
        let target = path.canonicalize()?;
        let name = target.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let beside = target.with_file_name(format!(".{name}.{}.new", std::process::id()));
        let written = new.open(&beside).and_then(|mut file| file.write_all(bytes));
        let done = written.and_then(|()| std::fs::rename(&beside, &target));
        if done.is_err() {
            let _ = std::fs::remove_file(&beside);
        }
        done
    };
    attempt().with_context(|| format!("cannot write {}", path.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A folder with a file `log` that is being read; returns why `--record` refuses a path, if it does.
    fn refused(force: bool, make: impl FnOnce(&Path) -> PathBuf) -> Option<String> {
        let dir = tempfile::tempdir().unwrap();
        let log = dir.path().join("log");
        std::fs::write(&log, "a recording").unwrap();
        let path = make(dir.path());
        let mut files = Files::new(force);
        files.reads("the log", &log);
        let result = files.writes("--record", &path);
        assert_eq!(std::fs::read(&log).unwrap(), b"a recording");
        result.err().map(|error| error.to_string())
    }

    #[test]
    fn what_is_read_is_not_written_to_by_any_spelling_link_or_handle() {
        let is = |force, make: fn(&Path) -> PathBuf| {
            let text = refused(force, make).expect("it is refused");
            assert!(text.contains("the file is the log"), "{text}");
        };
        for force in [false, true] {
            is(force, |dir| dir.join("log"));
            is(force, |dir| {
                std::fs::create_dir(dir.join("x")).unwrap();
                dir.join("x/../log")
            });
            is(force, |dir| {
                std::os::unix::fs::symlink("log", dir.join("soft")).unwrap();
                dir.join("soft")
            });
            is(force, |dir| {
                std::fs::hard_link(dir.join("log"), dir.join("hard")).unwrap();
                dir.join("hard")
            });
            is(force, |dir| {
                use std::os::fd::IntoRawFd as _;
                let handle = std::fs::File::open(dir.join("log")).unwrap().into_raw_fd();
                format!("/proc/self/fd/{handle}").into()
            });
        }
    }

    #[test]
    fn an_existing_file_is_replaced_only_by_force_and_what_is_no_file_never() {
        let other = |dir: &Path| {
            std::fs::write(dir.join("other"), "").unwrap();
            dir.join("other")
        };
        assert!(refused(false, other).unwrap().contains("exists already"));
        assert_eq!(refused(true, other), None);
        assert_eq!(refused(false, |dir| dir.join("new")), None);
        assert!(refused(true, ToOwned::to_owned).unwrap().contains("a folder"));
        assert!(refused(true, |_| "/dev/null".into()).unwrap().contains("a device"));
        assert!(refused(true, |dir| dir.join("no/new")).unwrap().contains("a folder that is there"));
    }

    #[test]
    fn a_link_that_leads_to_no_file_is_refused_because_the_file_may_be_another_output() {
        for force in [false, true] {
            for target in ["rec.mcap", "link", "no/new"] {
                let link = |dir: &Path| {
                    std::os::unix::fs::symlink(target, dir.join("link")).unwrap();
                    dir.join("link")
                };
                let text = refused(force, link).expect("it is refused");
                assert!(text.contains("a link that leads to no file"), "{target}: {text}");
            }
        }
    }

    #[test]
    fn no_part_of_a_recording_that_is_read_is_written_to() {
        let dir = tempfile::tempdir().unwrap();
        let part = |number: u32| dir.path().join(format!("drive_{number}.mcap"));
        (0..3).for_each(|number| std::fs::write(part(number), "a recording").unwrap());
        for named in [part(0), dir.path().to_owned()] {
            let mut files = Files::new(true);
            files.reads_log("the recording", &named);
            for number in 0..3 {
                let error = files.writes("--output", &part(number)).unwrap_err().to_string();
                assert!(error.contains("the file is the recording"), "{error}");
            }
            files.writes("--output", &part(3)).unwrap();
        }
    }

    #[test]
    fn two_outputs_are_not_one_file() {
        let dir = tempfile::tempdir().unwrap();
        let mut files = Files::new(false);
        files.writes("--record", &dir.path().join("a")).unwrap();
        let error = files.writes("--save", &dir.path().join("./a")).unwrap_err().to_string();
        assert!(error.contains("what --record writes"), "{error}");
    }

    #[test]
    fn a_file_that_is_replaced_is_whole_before_and_after() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.json");
        write(&path, b"one", false).unwrap();
        assert!(write(&path, b"two", false).is_err());
        assert_eq!(std::fs::read(&path).unwrap(), b"one");
        write(&path, b"two", true).unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"two");
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1, "nothing stays beside it");
    }
}
