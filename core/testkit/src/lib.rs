//! What tests of several crates share.
//!
//! - [`mod@bench`]: runs a stack that a test feeds and steps.
//! - [`logs`]: writes logs for tests.
//! - [`golden`]: compares traces of numbers with committed ones.
//! - [`data_dir`]: locates the public datasets.
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
