//! Files that a stack names: worlds, vehicles, courses, models.

/// The content of a file that a stack names.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Asset {
    /// Name of the file in errors.
    pub file: String,
    /// The whole text.
    pub text: String,
}

/// Source of the files that a stack names: those in the program, or a disk.
pub trait Assets {
    /// The file with this kind (`world`, `vehicle`, `course`, `look`, `models`) and name; an error if there is none. A path is
    /// relative to the file `beside`, which names it; if that is empty, to the working directory.
    fn read(&self, kind: &str, name: &str, beside: &str) -> Result<Asset, String>;
}

/// No files: a stack that names a file is refused.
#[derive(Clone, Copy, Debug)]
pub struct NoAssets;

impl Assets for NoAssets {
    fn read(&self, kind: &str, name: &str, _beside: &str) -> Result<Asset, String> {
        Err(format!("the {kind} {name:?} cannot be read here; expected a program that has files"))
    }
}
