//! Files named by stacks: bundled ones by name, others by path.

use crate::bundled;
use rcs_runtime::{Asset, Assets};
use std::collections::BTreeSet;
use std::fs::File;
use std::io::Read as _;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

/// Maximum size of a text file; some special files never end.
const TEXT_LIMIT: u64 = 64 << 20;

static FILES_READ: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());

/// All text files that this program has read; none of them may be overwritten by an output.
pub(crate) fn files_read() -> Vec<PathBuf> {
    FILES_READ.lock().unwrap_or_else(PoisonError::into_inner).iter().cloned().collect()
}

/// Reads a text file. Pipes, devices and files above the size limit are refused, because they may never end.
pub(crate) fn read_text(path: &Path) -> Result<String, String> {
    let metadata = path.metadata().map_err(|error| error.to_string())?;
    if !metadata.is_file() {
        return Err("expected a regular file".to_owned());
    }
    let mut bytes = Vec::new();
    let file = File::open(path).map_err(|error| error.to_string())?;
    file.take(TEXT_LIMIT + 1).read_to_end(&mut bytes).map_err(|error| error.to_string())?;
    if bytes.len() as u64 > TEXT_LIMIT {
        return Err(format!("expected a text of at most {} MiB", TEXT_LIMIT >> 20));
    }
    FILES_READ.lock().unwrap_or_else(PoisonError::into_inner).insert(path.to_owned());
    String::from_utf8(bytes).map_err(|error| {
        let good = &error.as_bytes()[..error.utf8_error().valid_up_to()];
        let line = good.split(|byte| *byte == b'\n').count();
        format!("line {line} is no text in UTF-8")
    })
}

/// Bundled files by name, all others by path.
#[derive(Clone, Copy, Debug)]
pub struct ProgramAssets;

impl Assets for ProgramAssets {
    fn read(&self, kind: &str, name: &str, beside: &str) -> Result<Asset, String> {
        // A part may be a complete stack.
        let other = (kind == "part").then(|| bundled::file("stack", name)).flatten();
        if let Some(file) = bundled::file(kind, name).or(other) {
            return Ok(Asset { file: file.path(), text: file.text.to_owned() });
        }
        if looks_like_path(name) {
            let path = Path::new(beside).parent().unwrap_or(Path::new("")).join(name);
            let file = path.display().to_string();
            let text =
                read_text(&path).map_err(|error| format!("cannot read the {kind}: {error}: {file}"))?;
            // A parameter without a text has no file, which is not what a person means who names one.
            if text.trim().is_empty() {
                return Err(format!("cannot read the {kind}: expected a text, got an empty file: {file}"));
            }
            return Ok(Asset { file, text });
        }
        let names = bundled::names(kind).join(", ");
        Err(format!("no bundled {kind} is called {name:?}; expected {names} or a file"))
    }
}

/// Whether an argument is a path rather than the name of a bundled file.
pub(crate) fn looks_like_path(spec: &str) -> bool {
    spec.contains(['/', '\\', '.']) || Path::new(spec).exists()
}
