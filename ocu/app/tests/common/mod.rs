//! What the tests of the program share: the command line here, the window in a file of its own.

#![allow(dead_code, clippy::unwrap_used, reason = "not every test uses all of it, and a test may fail")]

pub(crate) mod window;

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// Runs `ocu` and gives its exit code, output and errors.
pub(crate) fn ocu(args: &[&str]) -> (i32, String, String) {
    let Output { status, stdout, stderr } =
        Command::new(env!("CARGO_BIN_EXE_ocu")).args(args).env_remove("DISPLAY").output().unwrap();
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    (status.code().unwrap_or(-1), text(stdout), text(stderr))
}

/// A recording of about two seconds in a folder of its own.
pub(crate) fn recording() -> (tempfile::TempDir, PathBuf) {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("drive.mcap");
    ocu_app::sample::write(&path, 2.0, false).unwrap();
    (dir, path)
}

pub(crate) fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

pub(crate) fn json(text: &str) -> serde_json::Value {
    serde_json::from_str(text).unwrap_or_else(|error| panic!("{error}: {text}"))
}

pub(crate) fn keys(value: &serde_json::Value) -> Vec<&str> {
    let mut keys: Vec<&str> = value.as_object().unwrap().keys().map(String::as_str).collect();
    keys.sort_unstable();
    keys
}
