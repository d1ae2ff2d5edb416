//! How much of its past a run keeps, and where.

use std::path::PathBuf;

/// How much of its past a run keeps, and where.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PastOptions {
    /// Memory that the past may take, bytes.
    pub memory_bytes: u64,
    /// Disk that the past may take, bytes; with 0 it stays in memory.
    pub disk_bytes: u64,
    /// Folder for what does not stay in memory. Each process makes its own in it, removes that at its end, and removes at
    /// its start what processes left that were killed.
    pub folder: PathBuf,
}

impl Default for PastOptions {
    /// 1 GiB of memory and 4 GiB of disk in the user's cache.
    fn default() -> Self {
        Self { memory_bytes: 1 << 30, disk_bytes: 4 << 30, folder: cache_folder() }
    }
}

/// `$XDG_CACHE_HOME/ocu/past`, or what stands for it: not the folder for temporary files, which is often memory.
fn cache_folder() -> PathBuf {
    let set = |name: &str| std::env::var_os(name).map(PathBuf::from).filter(|path| path.is_absolute());
    let cache = set("XDG_CACHE_HOME").or_else(|| set("HOME").map(|home| home.join(".cache")));
    cache.unwrap_or_else(std::env::temp_dir).join("ocu").join("past")
}
