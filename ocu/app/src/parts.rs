//! The files of a recording: one, or those into which it was split, as ROS 2 names them: `drive_0.mcap`, `drive_1.mcap`.

use crate::usage;
use std::path::{Path, PathBuf};

/// The files of the recording at a path: those of a folder; with a file whose name ends with the number 0, those whose
/// names continue it; else the file alone. An error if one of them is there in compressed form only.
pub(crate) fn of(path: &Path) -> anyhow::Result<Vec<PathBuf>> {
    if !path.is_dir() {
        if path.ends_with("metadata.yaml") {
            let text = format!("the file describes a bag of ROS 2; expected its folder: {}", path.display());
            return Err(usage(text));
        }
        return continued(path);
    }
    let entries = std::fs::read_dir(path).map_err(|error| usage(format!("{error}: {}", path.display())))?;
    let mut files: Vec<PathBuf> = entries.filter_map(|entry| Some(entry.ok()?.path())).collect();
    let is_compressed = |file: &&PathBuf| {
        let unpacked = file.with_extension("");
        has_ending(file, "zstd") && has_ending(&unpacked, "mcap") && !unpacked.is_file()
    };
    if let Some(file) = files.iter().filter(is_compressed).min() {
        return Err(compressed(file));
    }
    let database = files.iter().filter(|file| is_database(file)).min().cloned();
    files.retain(|file| has_ending(file, "mcap"));
    let mut numbered: Vec<(Option<(String, u64)>, PathBuf)> =
        files.into_iter().map(|file| (number(&file), file)).collect();
    numbered.sort_by(|a, b| a.0.cmp(&b.0));
    let stem = |part: &(Option<(String, u64)>, PathBuf)| part.0.as_ref().map(|(stem, _)| stem.clone());
    let are_parts =
        numbered.windows(2).all(|pair| stem(&pair[0]).is_some() && stem(&pair[0]) == stem(&pair[1]));
    match numbered.len() {
        0 => Err(database.map_or_else(
            || usage(format!("the folder has no .mcap file: {}", path.display())),
            |database| unconverted(&database),
        )),
        _ if !are_parts => Err(usage(format!(
            "the folder has several recordings; expected the parts of one, as NAME_0.mcap and NAME_1.mcap, or the path \
             of one of them: {}",
            path.display()
        ))),
        _ => Ok(numbered.into_iter().map(|(_, file)| file).collect()),
    }
}

/// Whether [`of`] a path may return more files later.
pub(crate) fn may_be_continued(path: &Path) -> bool {
    path.is_dir() || number(path).is_some_and(|(_, number)| number == 0)
}

/// A file, and the files that continue it if it is the first part of a recording.
fn continued(first: &Path) -> anyhow::Result<Vec<PathBuf>> {
    let mut files = vec![first.to_owned()];
    let Some((stem, 0)) = number(first) else { return Ok(files) };
    let name = first.file_stem().unwrap_or_default().to_string_lossy();
    let width = name.len() - stem.len() - 1;
    let extension = first.extension().unwrap_or_default().to_string_lossy();
    for number in 1.. {
        let name = format!("{stem}_{number:0width$}.{extension}");
        let (next, packed) = (first.with_file_name(&name), first.with_file_name(format!("{name}.zstd")));
        if next.is_file() {
            files.push(next);
        } else if packed.is_file() {
            return Err(compressed(&packed));
        } else {
            break;
        }
    }
    Ok(files)
}

fn compressed(file: &Path) -> anyhow::Error {
    usage(format!(
        "a file of the recording is compressed, expected what `zstd -d` unpacks: {}",
        file.display()
    ))
}

/// Whether a file is named like a bag of ROS 2 in `SQLite`, compressed or not.
fn is_database(file: &Path) -> bool {
    has_ending(file, "db3") || (has_ending(file, "zstd") && has_ending(&file.with_extension(""), "db3"))
}

fn unconverted(database: &Path) -> anyhow::Error {
    let unpacked = if has_ending(database, "zstd") { "`zstd -d` unpacks and " } else { "" };
    usage(format!(
        "the folder has no .mcap file, but an SQLite bag of ROS 2, which {unpacked}`mcap convert` (Foxglove's \
         command-line tool) converts to one: {}",
        database.display()
    ))
}

/// Whether the name of a file has this ending, in capitals or not.
pub(crate) fn has_ending(file: &Path, ending: &str) -> bool {
    file.extension().is_some_and(|extension| extension.eq_ignore_ascii_case(ending))
}

/// The name of a file without its number, and the number.
fn number(file: &Path) -> Option<(String, u64)> {
    let name = file.file_stem()?.to_str()?;
    let (stem, number) = name.rsplit_once('_')?;
    let is_number = !number.is_empty() && number.bytes().all(|byte| byte.is_ascii_digit());
    is_number.then(|| Some((stem.to_owned(), number.parse().ok()?))).flatten()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_a_bag_in_sqlite_the_folder_says_how_it_is_converted_and_its_description_names_the_folder() {
        let folder = tempfile::tempdir().unwrap();
        let error = |path: &Path| of(path).unwrap_err().to_string();
        let description = folder.path().join("metadata.yaml");
        std::fs::write(&description, "").unwrap();
        let told = error(&description);
        assert!(told.contains("expected its folder: "), "{told}");
        for (name, advice) in [
            ("drive_0.db3.zstd", "which `zstd -d` unpacks and `mcap convert` (Foxglove's"),
            ("drive_0.db3", "which `mcap convert` (Foxglove's"),
        ] {
            std::fs::write(folder.path().join(name), "").unwrap();
            let told = error(folder.path());
            assert!(told.contains(advice) && told.ends_with(name), "{told}");
        }
    }

    #[test]
    fn a_folder_and_a_first_part_are_all_parts_in_order_and_another_file_is_itself() {
        let folder = tempfile::tempdir().unwrap();
        let file = |name: &str| {
            let path = folder.path().join(name);
            std::fs::write(&path, "").unwrap();
            path
        };
        let names = |paths: Vec<PathBuf>| -> Vec<String> {
            paths.iter().map(|path| path.file_name().unwrap().to_string_lossy().into_owned()).collect()
        };
        assert!(of(folder.path()).unwrap_err().to_string().contains("no .mcap file: "));
        let expect_compressed = |path: &Path, name: &str| {
            let error = of(path).unwrap_err().to_string();
            assert!(error.contains("is compressed, expected what `zstd -d` unpacks: "), "{error}");
            assert!(error.ends_with(name), "{error}");
        };
        file("drive_0.mcap.zstd");
        expect_compressed(folder.path(), "drive_0.mcap.zstd");
        // rosbag2 that is killed leaves its last file as it is.
        file("drive_1.mcap.zstd");
        let last = file("drive_2.mcap");
        expect_compressed(folder.path(), "drive_0.mcap.zstd");
        assert_eq!(names(of(&last).unwrap()), ["drive_2.mcap"]);
        let first = file("drive_0.mcap");
        expect_compressed(folder.path(), "drive_1.mcap.zstd");
        expect_compressed(&first, "drive_1.mcap.zstd");
        // Compressed files may stay beside what was unpacked.
        let paths: Vec<PathBuf> = (0..12).map(|part| file(&format!("drive_{part}.mcap"))).collect();
        file("metadata.yaml");
        let wanted: Vec<String> = (0..12).map(|part| format!("drive_{part}.mcap")).collect();
        assert_eq!(names(of(folder.path()).unwrap()), wanted);
        assert_eq!(names(of(&paths[0]).unwrap()), wanted);
        assert_eq!(names(of(&paths[3]).unwrap()), ["drive_3.mcap"]);
        let first = file("drive_20260101.mcap");
        assert_eq!(names(of(&first).unwrap()), ["drive_20260101.mcap"]);
        for name in ["run-00.mcap", "run_00.mcap", "run_01.mcap", "run_03.mcap"] {
            file(name);
        }
        assert_eq!(names(of(&folder.path().join("run_00.mcap")).unwrap()), ["run_00.mcap", "run_01.mcap"]);
        assert!(of(folder.path()).unwrap_err().to_string().contains("several recordings"));
    }
}
