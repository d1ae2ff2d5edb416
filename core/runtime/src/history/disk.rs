//! Storage of a run's past on disk: compressed pieces, appended to files without a name.
//!
//! Pieces are reference-counted; when the last reference is dropped, the bytes of the piece are dead. A file without
//! live bytes is closed, and a file that is mostly dead is rewritten. No other process can open the files, and the system
//! frees their space when this one ends, in whatever way.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io;
use std::os::unix::fs::FileExt;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};

/// Greatest size of a file to which pieces are appended; less if the budget is small.
const FILE_BYTES: std::ops::RangeInclusive<u64> = 64 << 10..=16 << 20;
/// Prefix of the error for a used-up budget.
pub(crate) const OVER_BUDGET: &str = "the past would take more than its";
/// zstd's level: most of the data are camera noise or empty map cells, for which a higher level gains nothing.
const LEVEL: i32 = 1;

/// One file of pieces.
struct Pack {
    file: Arc<File>,
    bytes: u64,
    living: u64,
    pieces: Vec<Weak<Piece>>,
}

struct Inner {
    packs: BTreeMap<u32, Pack>,
    next: u32,
    bytes: u64,
    living: u64,
}

/// All pieces on disk.
pub(crate) struct Disk {
    folder: PathBuf,
    budget: u64,
    file_bytes: u64,
    inner: Mutex<Inner>,
}

/// Compressed bytes on disk; dead when dropped.
pub(crate) struct Piece {
    disk: Arc<Disk>,
    /// File and offset.
    at: Mutex<(u32, u64)>,
    bytes: u32,
    raw: u32,
}

impl Drop for Piece {
    fn drop(&mut self) {
        let (pack, _) = *self.at.lock().unwrap_or_else(PoisonError::into_inner);
        self.disk.release(pack, u64::from(self.bytes));
    }
}

impl Piece {
    /// The original bytes.
    pub(crate) fn read(&self) -> io::Result<Vec<u8>> {
        let packed = self.read_packed()?;
        let raw = zstd::bulk::decompress(&packed, self.raw as usize)?;
        if raw.len() == self.raw as usize { Ok(raw) } else { Err(io::ErrorKind::InvalidData.into()) }
    }

    fn read_packed(&self) -> io::Result<Vec<u8>> {
        // The file stays open, and its content in place, while it is read.
        let (file, offset) = {
            let inner = self.disk.lock();
            let (pack, offset) = *self.at.lock().unwrap_or_else(PoisonError::into_inner);
            let pack = inner.packs.get(&pack).ok_or(io::ErrorKind::NotFound)?;
            (Arc::clone(&pack.file), offset)
        };
        let mut packed = vec![0; self.bytes as usize];
        file.read_exact_at(&mut packed, offset)?;
        Ok(packed)
    }
}

impl Disk {
    /// Up to `budget` bytes in files in `folder`, which is created at the first write.
    pub(crate) fn new(folder: PathBuf, budget: u64) -> Arc<Self> {
        let inner = Inner { packs: BTreeMap::new(), next: 0, bytes: 0, living: 0 };
        let file_bytes = (budget / 32).clamp(*FILE_BYTES.start(), *FILE_BYTES.end());
        Arc::new(Self { folder, budget, file_bytes, inner: Mutex::new(inner) })
    }

    /// Size of all files, bytes.
    pub(crate) fn bytes(&self) -> u64 {
        self.lock().bytes
    }

    /// Live bytes.
    pub(crate) fn living(&self) -> u64 {
        self.lock().living
    }

    /// Compresses bytes and appends them.
    pub(crate) fn write(self: &Arc<Self>, raw: &[u8]) -> io::Result<Arc<Piece>> {
        let mut compressor = zstd::bulk::Compressor::new(LEVEL)?;
        compressor.include_checksum(true)?;
        let packed = compressor.compress(raw)?;
        let at = self.append(&packed)?;
        let piece = Arc::new(Piece {
            disk: Arc::clone(self),
            at: Mutex::new(at),
            bytes: packed.len() as u32,
            raw: raw.len() as u32,
        });
        if let Some(pack) = self.lock().packs.get_mut(&at.0) {
            pack.pieces.push(Arc::downgrade(&piece));
        }
        Ok(piece)
    }

    /// Appends compressed bytes; returns file and offset.
    fn append(&self, packed: &[u8]) -> io::Result<(u32, u64)> {
        let length = packed.len() as u64;
        let (number, file, offset) = {
            let mut inner = self.lock();
            if inner.bytes + length > self.budget {
                return Err(io::Error::new(
                    io::ErrorKind::QuotaExceeded,
                    format!("{OVER_BUDGET} {} bytes on disk", self.budget),
                ));
            }
            let fits = |pack: &Pack| pack.bytes < self.file_bytes;
            let current = inner.packs.iter().next_back().filter(|(_, pack)| fits(pack)).map(|(&n, _)| n);
            let number = match current {
                Some(number) => number,
                None => self.begin_file(&mut inner)?,
            };
            inner.bytes += length;
            inner.living += length;
            let Some(pack) = inner.packs.get_mut(&number) else {
                return Err(io::ErrorKind::NotFound.into());
            };
            let offset = pack.bytes;
            pack.bytes += length;
            pack.living += length;
            (number, Arc::clone(&pack.file), offset)
        };
        let written = file.write_all_at(packed, offset);
        written.inspect_err(|_| self.release(number, length))?;
        Ok((number, offset))
    }

    fn begin_file(&self, inner: &mut Inner) -> io::Result<u32> {
        fs::create_dir_all(&self.folder)?;
        let file = tempfile::tempfile_in(&self.folder)?;
        let number = inner.next;
        inner.next += 1;
        let pack = Pack { file: Arc::new(file), bytes: 0, living: 0, pieces: Vec::new() };
        inner.packs.insert(number, pack);
        Ok(number)
    }

    fn release(&self, number: u32, bytes: u64) {
        let mut inner = self.lock();
        inner.living = inner.living.saturating_sub(bytes);
        let is_last = inner.packs.keys().next_back() == Some(&number);
        let Some(pack) = inner.packs.get_mut(&number) else { return };
        pack.living = pack.living.saturating_sub(bytes);
        if pack.living == 0 && (!is_last || pack.bytes >= self.file_bytes) {
            let length = pack.bytes;
            inner.packs.remove(&number);
            inner.bytes = inner.bytes.saturating_sub(length);
        }
    }

    /// Rewrites one file that is mostly dead; `false` if there is none.
    pub(crate) fn compact(self: &Arc<Self>) -> io::Result<bool> {
        let found = {
            let inner = self.lock();
            let last = inner.packs.keys().next_back().copied();
            let sparse = |(number, pack): &(&u32, &Pack)| {
                Some(**number) != last && pack.bytes >= self.file_bytes / 4 && pack.living * 2 < pack.bytes
            };
            inner.packs.iter().find(sparse).map(|(&number, pack)| (number, pack.pieces.clone()))
        };
        let Some((number, pieces)) = found else { return Ok(false) };
        for piece in pieces.iter().filter_map(Weak::upgrade) {
            let packed = piece.read_packed()?;
            let to = self.append(&packed)?;
            *piece.at.lock().unwrap_or_else(PoisonError::into_inner) = to;
            if let Some(pack) = self.lock().packs.get_mut(&to.0) {
                pack.pieces.push(Arc::downgrade(&piece));
            }
            self.release(number, u64::from(piece.bytes));
        }
        Ok(true)
    }

    fn lock(&self) -> MutexGuard<'_, Inner> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Bytes that do not compress.
    fn noise(seed: u8, length: usize) -> Vec<u8> {
        let mut state = u32::from(seed) * 7919 + 1;
        let mut next = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 24) as u8
        };
        (0..length).map(|_| next()).collect()
    }

    #[test]
    fn what_is_written_is_read_back_until_it_is_damaged() {
        let root = tempfile::tempdir().unwrap();
        let disk = Disk::new(root.path().join("past"), 1 << 20);
        assert_eq!(fs::read_dir(root.path()).unwrap().count(), 0, "nothing is made before it is needed");
        let pieces: Vec<_> = (0..4).map(|i| disk.write(&noise(i, 1000)).unwrap()).collect();
        for (i, piece) in pieces.iter().enumerate() {
            assert_eq!(piece.read().unwrap(), noise(i as u8, 1000));
        }
        let file = Arc::clone(&disk.lock().packs[&0].file);
        let mut byte = [0];
        file.read_exact_at(&mut byte, 500).unwrap();
        file.write_all_at(&[byte[0] ^ 1], 500).unwrap();
        assert!(pieces[0].read().is_err(), "damage is seen");
        assert!(pieces[1].read().is_ok());
    }

    #[test]
    fn the_files_have_no_names() {
        let root = tempfile::tempdir().unwrap();
        let disk = Disk::new(root.path().to_owned(), 1 << 20);
        let piece = disk.write(b"alive").unwrap();
        assert_eq!(fs::read_dir(root.path()).unwrap().count(), 0);
        assert_eq!(piece.read().unwrap(), b"alive");
    }

    #[test]
    fn dead_bytes_are_given_back_and_the_budget_is_kept() {
        let root = tempfile::tempdir().unwrap();
        let disk = Disk::new(root.path().to_owned(), 100 << 20);
        let block = noise(1, 1 << 20);
        let mut pieces: Vec<_> = (0..64).map(|_| Some(disk.write(&block).unwrap())).collect();
        assert!(disk.bytes() > 64 << 20);
        for (i, piece) in pieces.iter_mut().enumerate() {
            if i % 4 != 0 {
                *piece = None;
            }
        }
        while disk.compact().unwrap() {}
        assert!(disk.bytes() < 40 << 20, "{}", disk.bytes());
        for piece in pieces.iter().flatten() {
            assert_eq!(piece.read().unwrap(), block);
        }
        pieces.clear();
        let full: Vec<_> = std::iter::from_fn(|| disk.write(&block).ok()).collect();
        assert!(disk.bytes() <= 100 << 20 && full.len() > 60, "{} pieces", full.len());
    }
}
