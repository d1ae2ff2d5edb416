//! The files that stacks name: bundled ones by name, others by path.

use crate::bundled;
use crate::layout::looks_like_path;
use rcs_runtime::{Asset, Assets};
use std::path::Path;

/// Bundled files by name, and any other by its path.
#[derive(Clone, Copy, Debug)]
pub struct ProgramAssets;

impl Assets for ProgramAssets {
    fn read(&self, kind: &str, name: &str, beside: &str) -> Result<Asset, String> {
        // A part may be a whole stack.
        let other = (kind == "part").then(|| bundled::file("stack", name)).flatten();
        if let Some(file) = bundled::file(kind, name).or(other) {
            return Ok(Asset { file: file.path(), text: file.text.to_owned() });
        }
        if looks_like_path(name) {
            let path = Path::new(beside).parent().unwrap_or(Path::new("")).join(name);
            let file = path.display().to_string();
            let text = std::fs::read_to_string(&path)
                .map_err(|error| format!("cannot read the {kind}: {error}: {file}"))?;
            return Ok(Asset { file, text });
        }
        let names = bundled::names(kind).join(", ");
        Err(format!("no bundled {kind} is called {name:?}; expected {names} or a file"))
    }
}
