//! The bytes of a log: a file with positioned reads, several of them, or memory.

use crate::error::LogError;
use bytes::Bytes;
use std::collections::VecDeque;
use std::fs::{File, Metadata};
use std::io;
use std::os::unix::fs::{FileExt, MetadataExt};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

/// Greatest number of files of a split log that are open at a time: the system limits those of a process, often to 1024.
const MOST_OPEN: usize = 256;

/// Read-only bytes with a length that is fixed when they are opened.
#[derive(Debug)]
pub(crate) struct Source {
    bytes: Medium,
    length: u64,
    path: PathBuf,
}

#[derive(Debug)]
enum Medium {
    File(File, Known),
    /// A file of a split log, with its position among the files.
    Pooled(Arc<Pool>, usize, Known),
    Memory(Bytes),
    /// Files one after another, with the position of the first byte of each.
    Parts(Vec<(u64, Source)>),
}

impl Source {
    pub(crate) fn open(path: &Path) -> Result<Self, LogError> {
        let failed = |source| LogError::Open { path: path.to_owned(), source };
        let (file, metadata) = open_regular(path).map_err(failed)?;
        let (known, length) = (Known::new(&metadata), metadata.len());
        Ok(Self { bytes: Medium::File(file, known), length, path: path.to_owned() })
    }

    /// The file of a split log with this position among its files. The pool opens it again where it has closed it.
    pub(crate) fn open_in(pool: &Arc<Pool>, part: usize, path: &Path) -> Result<Self, LogError> {
        let failed = |source| LogError::Open { path: path.to_owned(), source };
        let (file, metadata) = open_regular(path).map_err(failed)?;
        pool.keep(part, file);
        let (known, length) = (Known::new(&metadata), metadata.len());
        Ok(Self { bytes: Medium::Pooled(Arc::clone(pool), part, known), length, path: path.to_owned() })
    }

    /// Files one after another; each begins at its position.
    pub(crate) fn parts(parts: Vec<(u64, Self)>) -> Self {
        let length = parts.last().map_or(0, |(start, last)| start + last.length);
        let path = parts.first().map(|(_, first)| first.path.clone()).unwrap_or_default();
        Self { bytes: Medium::Parts(parts), length, path }
    }

    /// Its files, or itself.
    pub(crate) fn files(&self) -> impl Iterator<Item = &Self> {
        let (parts, own) = match &self.bytes {
            Medium::Parts(parts) => (parts.as_slice(), None),
            _ => (&[][..], Some(self)),
        };
        parts.iter().map(|(_, part)| part).chain(own)
    }

    /// The file that has the byte at `offset`, with the position of its first byte.
    pub(crate) fn file_at(&self, offset: u64) -> (u64, &Self) {
        let Medium::Parts(parts) = &self.bytes else { return (0, self) };
        let part = parts.iter().rev().find(|(start, _)| *start <= offset);
        part.map_or((0, self), |(start, part)| (*start, part))
    }

    /// How the file at its path differs from the one that was opened, and what to do; `None` if it does not, or if
    /// there is none. More bytes are a difference only if it may not grow.
    pub(crate) fn change(&self, may_grow: bool) -> Option<String> {
        let (Medium::File(_, known) | Medium::Pooled(_, _, known)) = &self.bytes else { return None };
        let found = Known::new(&self.path.metadata().ok()?);
        known.check(&found, may_grow).err()
    }

    pub(crate) fn memory(bytes: Bytes) -> Self {
        Self { length: bytes.len() as u64, bytes: Medium::Memory(bytes), path: PathBuf::new() }
    }

    pub(crate) fn length(&self) -> u64 {
        self.length
    }

    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// Reads into `into` from offset `offset` on. Missing bytes, in a file that has shrunk, are an error.
    pub(crate) fn read_into(&self, offset: u64, into: &mut [u8]) -> Result<(), LogError> {
        let result = match &self.bytes {
            Medium::File(file, _) => file.read_exact_at(into, offset),
            Medium::Pooled(pool, part, known) => {
                pool.file(*part, known, &self.path).and_then(|file| file.read_exact_at(into, offset))
            }
            Medium::Parts(parts) => return read_parts(parts, offset, into),
            Medium::Memory(bytes) => {
                let range = usize::try_from(offset)
                    .ok()
                    .and_then(|from| bytes.get(from..from.checked_add(into.len())?));
                match range {
                    Some(range) => {
                        into.copy_from_slice(range);
                        Ok(())
                    }
                    None => Err(std::io::ErrorKind::UnexpectedEof.into()),
                }
            }
        };
        let length = into.len() as u64;
        result.map_err(|source| {
            let source = self.change(true).map_or(source, io::Error::other);
            LogError::Read { offset, length, path: self.path.clone(), source }
        })
    }

    /// `length` bytes from offset `offset` on; memory is shared, not copied.
    pub(crate) fn read(&self, offset: u64, length: usize) -> Result<Bytes, LogError> {
        if let Medium::Memory(bytes) = &self.bytes
            && let Ok(from) = usize::try_from(offset)
            && let Some(to) = from.checked_add(length)
            && to <= bytes.len()
        {
            return Ok(bytes.slice(from..to));
        }
        let mut buffer = vec![0; length];
        self.read_into(offset, &mut buffer)?;
        Ok(buffer.into())
    }
}

/// A regular file. Checked before opening, too, because opening a pipe blocks until it has a writer.
fn open_regular(path: &Path) -> io::Result<(File, Metadata)> {
    let regular = |metadata: Metadata| {
        if metadata.is_file() { Ok(metadata) } else { Err(io::Error::other("expected a regular file")) }
    };
    regular(path.metadata()?)?;
    let file = File::open(path)?;
    let metadata = regular(file.metadata()?)?;
    Ok((file, metadata))
}

/// The files of a split log, of which a bounded number is open: those that were opened last.
#[derive(Debug)]
pub(crate) struct Pool {
    most: usize,
    /// With their positions among the files of the log.
    open: Mutex<VecDeque<(usize, Arc<File>)>>,
}

/// A file, as it was when it was opened first.
#[derive(Debug)]
struct Known {
    length: u64,
    /// Device and inode number.
    id: (u64, u64),
    /// Time of the last modification: seconds and nanoseconds.
    modified: (i64, i64),
}

impl Default for Pool {
    fn default() -> Self {
        Self { most: MOST_OPEN, open: Mutex::default() }
    }
}

impl Known {
    fn new(metadata: &Metadata) -> Self {
        Self {
            length: metadata.len(),
            id: (metadata.dev(), metadata.ino()),
            modified: (metadata.mtime(), metadata.mtime_nsec()),
        }
    }

    /// Refuses another file: one that differs in inode number and in time, or is shorter, or longer if it may not grow.
    /// A difference in only one of inode number and time is accepted: some file systems give a file a new inode
    /// number, and a file that is still written has a new time.
    fn check(&self, found: &Self, may_grow: bool) -> Result<(), String> {
        let (got, known) = (found.length, self.length);
        let how = if found.id != self.id && found.modified != self.modified {
            "another file has taken its place".to_owned()
        } else if got < known || (got > known && !may_grow) {
            format!("it has {got} bytes, expected {}{known}", if may_grow { "at least " } else { "" })
        } else {
            return Ok(());
        };
        Err(format!("the file has changed since it was opened: {how}; open it again"))
    }
}

impl Pool {
    /// Keeps a file open, and closes the one that was opened first if there are too many.
    fn keep(&self, part: usize, file: File) -> Arc<File> {
        let file = Arc::new(file);
        let mut open = self.open.lock().unwrap_or_else(PoisonError::into_inner);
        if open.len() >= self.most {
            open.pop_front();
        }
        open.push_back((part, Arc::clone(&file)));
        file
    }

    /// The file of a part, opened again if it was closed; an error if another one is at its path by then.
    fn file(&self, part: usize, known: &Known, path: &Path) -> io::Result<Arc<File>> {
        let open = self.open.lock().unwrap_or_else(PoisonError::into_inner);
        let held = open.iter().find(|(other, _)| *other == part).map(|(_, file)| Arc::clone(file));
        drop(open);
        if let Some(file) = held {
            return Ok(file);
        }
        let (file, metadata) = open_regular(path)?;
        known.check(&Known::new(&metadata), true).map_err(io::Error::other)?;
        Ok(self.keep(part, file))
    }
}

/// Reads from files one after another.
fn read_parts(parts: &[(u64, Source)], mut offset: u64, mut into: &mut [u8]) -> Result<(), LogError> {
    while !into.is_empty() {
        let index = parts.partition_point(|(start, _)| *start <= offset).saturating_sub(1);
        let Some((start, part)) = parts.get(index) else { break };
        let left = (start + part.length).saturating_sub(offset);
        // Behind the last one, the part itself tells the error.
        let count = if left == 0 { into.len() as u64 } else { left.min(into.len() as u64) };
        let (front, rest) = into.split_at_mut(count as usize);
        part.read_into(offset - start, front)?;
        (offset, into) = (offset + count, rest);
    }
    Ok(())
}

/// Sequential reading of part of a source, for a decompressor.
pub(crate) struct Stream<'a> {
    source: &'a Source,
    at: u64,
    end: u64,
    failure: Option<LogError>,
}

impl<'a> Stream<'a> {
    pub(crate) fn new(source: &'a Source, at: u64, end: u64) -> Self {
        Self { source, at, end, failure: None }
    }

    /// The source's own error, separate from what a decompressor makes of it.
    pub(crate) fn failure(self) -> Option<LogError> {
        self.failure
    }
}

impl std::io::Read for Stream<'_> {
    fn read(&mut self, into: &mut [u8]) -> std::io::Result<usize> {
        let count = into.len().min(usize::try_from(self.end - self.at).unwrap_or(usize::MAX));
        self.source.read_into(self.at, &mut into[..count]).map_err(|error| {
            self.failure = Some(error);
            std::io::Error::other("the log cannot be read")
        })?;
        self.at += count as u64;
        Ok(count)
    }
}

/// A small buffered window of a source for reading headers in sequence: most steps need no read of the file.
pub(crate) struct Window<'a> {
    source: &'a Source,
    start: u64,
    buffer: Vec<u8>,
    span: usize,
}

impl<'a> Window<'a> {
    pub(crate) fn new(source: &'a Source, span: usize) -> Self {
        Self { source, start: 0, buffer: Vec::new(), span }
    }

    pub(crate) fn source(&self) -> &'a Source {
        self.source
    }

    /// Up to `length` bytes from `offset` on; fewer at the end of the source.
    pub(crate) fn get(&mut self, offset: u64, length: usize) -> Result<&[u8], LogError> {
        let left = self.source.length().saturating_sub(offset);
        let length = length.min(usize::try_from(left).unwrap_or(usize::MAX));
        let held = offset >= self.start && offset + length as u64 <= self.start + self.buffer.len() as u64;
        if !held {
            let span = length.max(self.span).min(usize::try_from(left).unwrap_or(usize::MAX));
            // Cleared first, so that after a failed read old bytes are not taken for those at the new offset.
            self.buffer.clear();
            self.start = offset;
            let mut buffer = std::mem::take(&mut self.buffer);
            buffer.resize(span, 0);
            self.source.read_into(offset, &mut buffer)?;
            self.buffer = buffer;
        }
        let from = (offset - self.start) as usize;
        Ok(&self.buffer[from..from + length])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::SystemTime;

    #[test]
    fn of_many_files_few_are_open_and_each_is_read_as_the_one_that_it_was() {
        let folder = tempfile::tempdir().unwrap();
        let file = |name: &str, content: u8| {
            let path = folder.path().join(name);
            std::fs::write(&path, [content]).unwrap();
            path
        };
        let pool = Arc::new(Pool { most: 2, ..Pool::default() });
        let paths: Vec<PathBuf> = (0..4).map(|part| file(&format!("drive_{part}.mcap"), part)).collect();
        let opened = paths.iter().enumerate().map(|(part, path)| Source::open_in(&pool, part, path));
        let sources: Vec<Source> = opened.map(Result::unwrap).collect();
        let open = || -> Vec<usize> { pool.open.lock().unwrap().iter().map(|(part, _)| *part).collect() };
        for (content, source) in (0..4u8).zip(&sources).cycle().take(8) {
            assert_eq!(source.read(0, 1).unwrap()[..], [content]);
            assert_eq!(open().len(), 2);
        }
        let set_modified = |path: &Path, to: SystemTime| {
            File::options().write(true).open(path).unwrap().set_modified(to).unwrap();
        };
        // A closed file grows.
        std::fs::write(&paths[0], [0u8, 7]).unwrap();
        set_modified(&paths[0], SystemTime::UNIX_EPOCH);
        assert_eq!(sources[0].read(0, 1).unwrap()[..], [0]);
        // A closed file gets another inode number.
        let modified = paths[1].metadata().unwrap().modified().unwrap();
        let again = file("again.mcap", 1);
        set_modified(&again, modified);
        std::fs::rename(again, &paths[1]).unwrap();
        assert_eq!(sources[1].read(0, 1).unwrap()[..], [1]);
        assert_eq!(open(), [0, 1]);
        // A closed file is replaced, and another one becomes shorter: neither takes the place of an open one.
        let other = file("other.mcap", 9);
        set_modified(&other, SystemTime::UNIX_EPOCH);
        std::fs::rename(other, &paths[2]).unwrap();
        std::fs::write(&paths[3], "").unwrap();
        for (part, expect) in [
            (2, "another file has taken its place"),
            (2, "another file has taken its place"),
            (3, "it has 0 bytes, expected at least 1"),
        ] {
            let error = sources[part].read(0, 1).unwrap_err().to_string();
            assert!(error.contains(expect), "{error}");
            assert_eq!(open(), [0, 1]);
        }
    }
}
