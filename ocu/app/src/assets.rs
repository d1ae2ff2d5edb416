//! The files that come with the program and that stacks name: worlds, vehicles, courses, models.

use crate::layout::looks_like_path;
use rcs_runtime::{Asset, Assets};
use std::path::Path;

/// A file that comes with the program.
struct Bundled {
    kind: &'static str,
    name: &'static str,
    file: &'static str,
    text: &'static str,
}

macro_rules! bundled {
    ($($kind:literal $name:literal $file:literal),* $(,)?) => {
        &[$(Bundled {
            kind: $kind,
            name: $name,
            file: concat!("assets/", $file),
            text: include_str!(concat!("../../../assets/", $file)),
        }),*]
    };
}

/// The one list.
const BUNDLED: &[Bundled] = bundled![
    "world" "meadow" "worlds/meadow.toml",
    "world" "mulch_path" "worlds/mulch_path.toml",
    "world" "dead_end" "worlds/dead_end.toml",
    "world" "tall_grass" "worlds/tall_grass.toml",
    "world" "hill" "worlds/hill.toml",
    "world" "corridor" "worlds/corridor.toml",
    "world" "transition" "worlds/transition.toml",
    "vehicle" "lagr" "vehicles/lagr.toml",
    "vehicle" "tractor" "vehicles/tractor.toml",
    "course" "meadow" "courses/meadow.toml",
    "course" "mulch_path" "courses/mulch_path.toml",
    "course" "dead_end" "courses/dead_end.toml",
    "course" "tall_grass" "courses/tall_grass.toml",
    "course" "hill" "courses/hill.toml",
    "course" "corridor" "courses/corridor.toml",
    "course" "transition" "courses/transition.toml",
    "models" "mulch" "models/mulch.json",
    "models" "white_lime" "models/white_lime.json",
    "models" "orange_fence" "models/orange_fence.json",
];

/// Names of the bundled files of a kind, in the order of the list.
pub fn names(kind: &str) -> impl Iterator<Item = &'static str> {
    BUNDLED.iter().filter(move |file| file.kind == kind).map(|file| file.name)
}

/// Bundled files by name, and any other by its path.
#[derive(Clone, Copy, Debug)]
pub struct ProgramAssets;

impl Assets for ProgramAssets {
    fn read(&self, kind: &str, name: &str, beside: &str) -> Result<Asset, String> {
        if let Some(file) = BUNDLED.iter().find(|file| file.kind == kind && file.name == name) {
            return Ok(Asset { file: file.file.to_owned(), text: file.text.to_owned() });
        }
        if looks_like_path(name) {
            let path = Path::new(beside).parent().unwrap_or(Path::new("")).join(name);
            let file = path.display().to_string();
            let text = std::fs::read_to_string(&path)
                .map_err(|error| format!("cannot read the {kind}: {error}: {file}"))?;
            return Ok(Asset { file, text });
        }
        let names: Vec<&str> = names(kind).collect();
        Err(format!("no bundled {kind} is called {name:?}; expected {} or a file", names.join(", ")))
    }
}
