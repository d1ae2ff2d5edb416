//! How much of its past a run keeps, and where.

use std::path::PathBuf;

/// How much of its past a run keeps, and where.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PastOptions {
    /// Memory limit of the past, bytes.
    pub memory_bytes: u64,
    /// Disk limit of the past, bytes; with 0 it stays in memory.
    pub disk_bytes: u64,
    /// Folder for what does not stay in memory: files without a name, whose space is free again when the program ends.
    pub folder: PathBuf,
}

impl Default for PastOptions {
    /// 1 GiB of memory and 4 GiB of disk in the user's cache.
    fn default() -> Self {
        Self { memory_bytes: 1 << 30, disk_bytes: 4 << 30, folder: cache_folder() }
    }
}

/// `$XDG_CACHE_HOME/ocu/past` or its default. Not the folder for temporary files, which is often in memory.
fn cache_folder() -> PathBuf {
    let set = |name: &str| std::env::var_os(name).map(PathBuf::from).filter(|path| path.is_absolute());
    let cache = set("XDG_CACHE_HOME").or_else(|| set("HOME").map(|home| home.join(".cache")));
    cache.unwrap_or_else(std::env::temp_dir).join("ocu").join("past")
}
