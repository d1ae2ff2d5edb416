//! What tests of several crates share.
//!
//! - [`mod@bench`]: runs a stack that a test feeds and steps.
//! - [`logs`]: writes logs for tests.
//! - [`golden`]: compares traces of numbers with committed ones.
//! - [`data_dir`]: locates the public datasets.
//! - [`peak_bytes`]: how much memory this process has used.
//!
//! This crate is a dev-dependency only, and no part of the program. It is above the runtime, so tests inside of the
//! crates below cannot use types of theirs through it. A test of a plugin begins with [`bench::Setup`]:
//!
//! ```no_run
//! use rcs_msg::rcs;
//! use rcs_testkit::bench::Setup;
//! # fn test(my_plugin: rcs_runtime::ProcessType) {
//! let stack = "format = 1\nname = \"one\"\n\n[[process]]\nname = \"p\"\nplugin = \"my_plugin\"\nsupervisor =
//! \"viewer\"\nperiod_ms = 100.0\n";
//! let mut bench = Setup::new(stack, &[my_plugin]).bench();
//! bench.cycles(100, 3);
//! let status: rcs::Status = bench.latest("/p/status");
//! assert_eq!((status.cycle, bench.faults("p").0), (3, 0));
//! # }
//! ```

pub mod bench;
pub mod golden;
pub mod logs;

use std::path::PathBuf;

rcs_msg::messages!(
    /// Messages of processes that exist in tests only.
    pub mod proto
);

/// The folder with the public datasets: `$OCU_DATA`, else `../shared/data` beside the checkout.
///
/// `None` if it is absent; it prints a line that says so. With `OCU_REQUIRE_DATA=1` its absence is a failure.
///
/// # Panics
/// If the folder is absent and `OCU_REQUIRE_DATA` is 1.
pub fn data_dir() -> Option<PathBuf> {
    let dir = std::env::var_os("OCU_DATA").map_or_else(
        || PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data")),
        PathBuf::from,
    );
    if dir.is_dir() {
        return Some(dir);
    }
    let required = std::env::var("OCU_REQUIRE_DATA").is_ok_and(|value| value == "1");
    assert!(!required, "OCU_REQUIRE_DATA is 1, but there is no folder of recordings at {}", dir.display());
    eprintln!("skipped: no folder of recordings at {}; set OCU_DATA to one", dir.display());
    None
}

/// Greatest resident memory of this process so far, bytes.
///
/// `None` where the system does not report it, which is everywhere but on Linux; it prints a line that says so.
///
/// # Panics
/// If Linux does not report it.
pub fn peak_bytes() -> Option<u64> {
    if !cfg!(target_os = "linux") {
        eprintln!("skipped: this system does not report the memory of a process");
        return None;
    }
    let status = std::fs::read_to_string("/proc/self/status");
    let status = status.unwrap_or_else(|error| panic!("/proc/self/status: {error}"));
    let peak = peak_in(&status);
    assert!(peak.is_some(), "/proc/self/status has no VmHWM: {status}");
    peak
}

/// The greatest resident memory in a status file of Linux, bytes.
fn peak_in(status: &str) -> Option<u64> {
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    let kilobytes: u64 = line.split_whitespace().next()?.parse().ok()?;
    Some(kilobytes * 1024)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_peak_of_memory_is_that_of_the_status_file_and_never_silently_absent() {
        assert_eq!(peak_in("VmPeak:\t  90 kB\nVmHWM:\t    12 kB\nVmRSS:\t 8 kB\n"), Some(12 << 10));
        assert_eq!(peak_in("VmPeak:\t  90 kB\n"), None);
        assert_eq!(peak_bytes().is_some(), cfg!(target_os = "linux"));
    }
}
