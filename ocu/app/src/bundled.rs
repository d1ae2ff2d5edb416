//! The bundled files: everything under `assets/` and `layouts/`, by kind and name.

use include_dir::{Dir, include_dir};
use std::path::Path;

static ASSETS: Dir<'_> = include_dir!("$CARGO_MANIFEST_DIR/../../assets");
static LAYOUTS: Dir<'_> = include_dir!("$CARGO_MANIFEST_DIR/../../layouts");

/// Kinds of bundled files: the kind as named in stacks, courses and on the command line, and its folder.
const FOLDERS: &[(&str, &str)] = &[
    ("world", "worlds"),
    ("vehicle", "vehicles"),
    ("course", "courses"),
    ("look", "looks"),
    ("models", "models"),
    ("mode", "modes"),
    ("stack", "stacks"),
    ("part", "stacks/parts"),
];

/// A bundled file.
#[derive(Clone, Copy, Debug)]
pub struct Bundled {
    /// Name without folder and extension, such as `meadow`.
    pub name: &'static str,
    folder: &'static str,
    path: &'static Path,
    /// The complete text.
    pub text: &'static str,
}

impl Bundled {
    /// Path in the repository, used in errors: `assets/worlds/meadow.toml`.
    pub fn path(&self) -> String {
        format!("{}/{}", self.folder, self.path.display())
    }
}

/// The bundled files of a kind (`world`, `vehicle`, `course`, `look`, `models`, `mode`, `stack`, `part`, `layout`), sorted by name.
pub fn files(kind: &str) -> impl Iterator<Item = Bundled> {
    let known = FOLDERS.iter().find(|(known, _)| *known == kind);
    let (folder, dir) = match kind {
        "layout" => ("layouts", Some(&LAYOUTS)),
        _ => ("assets", known.and_then(|(_, folder)| ASSETS.get_dir(folder))),
    };
    dir.into_iter().flat_map(Dir::files).filter_map(move |file| {
        let name = file.path().file_stem()?.to_str()?;
        Some(Bundled { name, folder, path: file.path(), text: file.contents_utf8()? })
    })
}

/// The bundled file with a kind and name.
pub fn file(kind: &str, name: &str) -> Option<Bundled> {
    files(kind).find(|file| file.name == name)
}

/// Names of the bundled files of a kind.
pub fn names(kind: &str) -> Vec<&'static str> {
    files(kind).map(|file| file.name).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_kind_has_files_and_names_are_sorted_and_unique() {
        for kind in FOLDERS.iter().map(|(kind, _)| *kind).chain(["layout"]) {
            let names = names(kind);
            assert!(!names.is_empty(), "{kind}");
            assert!(names.is_sorted_by(|a, b| a < b), "{kind}: {names:?}");
        }
    }
}
