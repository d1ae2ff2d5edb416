//! The layouts that the user keeps: each as it was last arranged, in a file of its own, apart from the bundled ones.

use crate::assets::{looks_like_path, read_text};
use crate::bundled;
use crate::layout::Layout;
use anyhow::Context as _;
use std::path::{Path, PathBuf};

/// Why an arrangement is not as it was kept.
const UNUSABLE: &str = "the kept arrangement cannot be used, and is set aside as .old before it is replaced";

/// Their folder, in the folder of the program's data.
pub(crate) fn folder(data_dir: &Path) -> PathBuf {
    data_dir.join("layouts")
}

/// Whether a layout with this name comes with the program.
pub(crate) fn is_bundled(name: &str) -> bool {
    bundled::names("layout").contains(&name)
}

/// File name of a layout. Characters other than letters, digits and `-` in its name are replaced by `_`. No layout of the
/// user's has the file of a bundled one.
pub(crate) fn file_name(name: &str) -> String {
    let plain = |c: char| if c.is_alphanumeric() || c == '-' { c } else { '_' };
    let stem: String = name.chars().take(64).map(plain).collect();
    let prefix = if is_bundled(&stem) && !is_bundled(name) { "own-" } else { "" };
    format!("{prefix}{stem}.ron")
}

/// Names of the layouts in a folder that are none of the bundled ones, sorted.
pub(crate) fn names(folder: &Path) -> Vec<String> {
    let files = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let mut names: Vec<String> = files.filter_map(|file| name_of(&file.path())).collect();
    names.retain(|name| !is_bundled(name));
    names.sort();
    names
}

/// The kept layout with this name; `None` if there is none. The error says why its file cannot be used.
pub(crate) fn load(folder: &Path, name: &str) -> anyhow::Result<Option<Layout>> {
    let path = folder.join(file_name(name));
    if !path.exists() {
        return Ok(None);
    }
    let layout = Layout::load(&path).context(UNUSABLE)?;
    // A file from before may have another name written in it.
    Ok(Some(Layout { name: name.to_owned(), ..layout }))
}

/// The layout named on the command line for the window: as the user last arranged it, else as it comes. If the file of
/// a bundled one cannot be used, it is as it comes, and the reason is returned, too.
pub(crate) fn as_arranged(spec: &str, data_dir: Option<&Path>) -> anyhow::Result<(Layout, Option<String>)> {
    let kept = data_dir.filter(|_| is_bundled(spec)).map_or(Ok(None), |dir| load(&folder(dir), spec));
    match kept {
        Ok(Some(kept)) => Ok((kept, None)),
        Ok(None) => Ok((named(spec, data_dir)?, None)),
        Err(error) => Ok((named(spec, data_dir)?, Some(crate::say(&error)))),
    }
}

/// The layout named on the command line: a bundled one as it comes, one that the user keeps, or a file.
pub(crate) fn named(spec: &str, data_dir: Option<&Path>) -> anyhow::Result<Layout> {
    if is_bundled(spec) {
        return Layout::named(spec);
    }
    let folder = data_dir.map(folder);
    if let Some(folder) = &folder
        && name_of(&folder.join(file_name(spec))).as_deref() == Some(spec)
        && let Some(kept) = load(folder, spec)?
    {
        return Ok(kept);
    }
    if looks_like_path(spec) {
        return Layout::named(spec);
    }
    let own = folder.as_deref().map(names).unwrap_or_default();
    let known = bundled::names("layout").into_iter().chain(own.iter().map(String::as_str));
    let known: Vec<&str> = known.collect();
    Err(crate::usage(format!("no layout is called {spec:?}; expected {} or a .ron file", known.join(", "))))
}

/// The name of the layout in a file: the one that is written in it, or that of the file if it cannot be read. `None` for
/// a file that no layout with that name would have.
fn name_of(path: &Path) -> Option<String> {
    if path.extension().is_none_or(|extension| extension != "ron") {
        return None;
    }
    let stem = path.file_stem()?.to_string_lossy().into_owned();
    let written = read_text(path).ok().and_then(|text| Layout::name_in(&text));
    let mut names = written.into_iter().chain([stem]);
    names.find(|name| path.file_name().is_some_and(|file| file == file_name(name).as_str()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_kept_layout_is_named_on_the_command_line_and_a_damaged_one_is_refused_with_its_file() {
        let dir = tempfile::tempdir().unwrap();
        let path = folder(dir.path()).join("mine.ron");
        let mine = Layout { name: "mine".to_owned(), ..Layout::empty() };
        mine.save(&path).unwrap();
        let named = |spec: &str| named(spec, Some(dir.path()));
        assert_eq!(named("mine").unwrap(), mine);
        assert_eq!(named("default").unwrap().name, "default");
        let unknown = named("yours").unwrap_err().to_string();
        assert!(unknown.contains("default") && unknown.contains("mine"), "{unknown}");

        std::fs::write(&path, "Layout(version: 77)").unwrap();
        let damaged = crate::say(&named("mine").unwrap_err());
        assert!(damaged.contains("mine.ron:1") && damaged.contains("version 77"), "{damaged}");
    }

    #[test]
    fn a_bundled_layout_opens_in_the_window_as_it_was_arranged_and_as_it_comes_where_its_file_is_damaged() {
        let dir = tempfile::tempdir().unwrap();
        let (path, bundled) = (folder(dir.path()).join("default.ron"), Layout::named("default").unwrap());
        let arranged = || as_arranged("default", Some(dir.path())).unwrap();
        assert_eq!(arranged(), (bundled.clone(), None));
        let own = Layout { name: "default".to_owned(), ..Layout::empty() };
        own.save(&path).unwrap();
        assert_eq!(arranged(), (own, None));
        assert_eq!(named("default", Some(dir.path())).unwrap(), bundled, "of a command");

        std::fs::write(&path, "Layout(version: 1, na").unwrap();
        let (layout, problem) = arranged();
        assert_eq!(layout, bundled);
        assert!(problem.is_some_and(|text| text.contains("default.ron:1") && text.contains("set aside")));
    }
}
