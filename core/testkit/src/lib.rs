//! What tests share.
//!
//! - [`mod@bench`]: a stack that a test feeds and steps.
//! - [`logs`]: logs made on the spot.
//! - [`golden`]: traces of numbers beside committed ones.
//! - [`data_dir`]: where public datasets are found.

pub mod bench;
pub mod golden;
pub mod logs;

use std::path::PathBuf;

rcs_msg::messages!(
    /// Messages of processes that only tests have.
    pub mod proto
);

/// The folder with public datasets: `$OCU_DATA`, else `../shared/data` beside the checkout.
///
/// `None` where it is absent, with a line that says so; with `OCU_REQUIRE_DATA=1` its absence is a failure.
///
/// # Panics
/// Where the folder is absent and `OCU_REQUIRE_DATA` is 1.
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
