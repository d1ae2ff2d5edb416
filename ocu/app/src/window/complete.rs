//! Completion of paths: the folders, and the files that the window opens, that begin with what was typed.

use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, channel};

/// Most paths that are listed.
pub(super) const MOST_LISTED: usize = 8;
/// Most entries of a folder that are looked at.
const MOST_READ: usize = 20_000;
/// Endings of files that can be opened.
const ENDINGS: [&str; 4] = ["mcap", "toml", "ron", "json"];
/// Ending of bookmarks, which belong to a recording and are opened with it.
const BOOKMARKS: &str = ".marks.json";

/// What is offered for a text.
#[derive(Debug, Default)]
pub(super) struct Completion {
    asked: Option<String>,
    pending: Option<Receiver<Vec<String>>>,
    /// Sorted.
    found: Vec<String>,
}

impl Completion {
    /// The paths that begin with a text; read on a thread of its own, because a folder may be far away.
    pub(super) fn of(&mut self, ctx: &egui::Context, text: &str) -> &[String] {
        if self.asked.as_deref() != Some(text) {
            self.asked = Some(text.to_owned());
            let (sender, receiver) = channel();
            let (text, ctx) = (text.to_owned(), ctx.clone());
            let thread = std::thread::Builder::new().name("complete".to_owned()).spawn(move || {
                // Fails if something else was typed.
                let _ = sender.send(matches(&text));
                ctx.request_repaint();
            });
            self.pending = thread.is_ok().then_some(receiver);
        }
        if let Some(found) = self.pending.as_ref().and_then(|pending| pending.try_recv().ok()) {
            (self.found, self.pending) = (found, None);
        }
        &self.found
    }

    /// The longest text that everything that is offered begins with.
    pub(super) fn common(&self) -> Option<String> {
        // They are sorted: all begin with what the first and the last of them begin with.
        let (first, last) = (self.found.first()?, self.found.last()?);
        let mut length = first.bytes().zip(last.bytes()).take_while(|(a, b)| a == b).count();
        while !first.is_char_boundary(length) {
            length -= 1;
        }
        first.get(..length).map(str::to_owned)
    }
}

/// The home folder in place of `~`.
pub(super) fn expanded(text: &str) -> PathBuf {
    match (text.strip_prefix("~/"), std::env::var_os("HOME")) {
        (Some(rest), Some(home)) => Path::new(&home).join(rest),
        _ => PathBuf::from(text),
    }
}

/// Folders (with a slash at the end) and files that begin with a text, as one would type them.
fn matches(text: &str) -> Vec<String> {
    let (folder, begin) = text.rsplit_once('/').map_or(("", text), |(folder, begin)| (folder, begin));
    let typed = if text.contains('/') { format!("{folder}/") } else { String::new() };
    let folder = if typed.is_empty() { PathBuf::from(".") } else { expanded(&typed) };
    let begin_lower = begin.to_lowercase();
    let Ok(entries) = std::fs::read_dir(folder) else { return Vec::new() };
    let mut found: Vec<String> = entries
        .take(MOST_READ)
        .filter_map(|entry| {
            let entry = entry.ok()?;
            let name = entry.file_name().into_string().ok()?;
            let is_hidden = name.starts_with('.') && !begin.starts_with('.');
            if is_hidden || !name.to_lowercase().starts_with(&begin_lower) {
                return None;
            }
            // A link to a folder is one, too.
            let is_folder = entry.path().is_dir();
            let can_open = Path::new(&name)
                .extension()
                .is_some_and(|ending| ENDINGS.iter().any(|known| ending.eq_ignore_ascii_case(known)))
                && !name.ends_with(BOOKMARKS);
            (is_folder || can_open).then(|| format!("{typed}{name}{}", if is_folder { "/" } else { "" }))
        })
        .collect();
    found.sort_unstable();
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folders_and_what_can_be_opened_are_offered_by_their_beginning() {
        let dir = tempfile::tempdir().unwrap();
        for file in [
            "drive_1.mcap",
            "Drive_2.MCAP",
            "drive.txt",
            "drive_1.marks.json",
            ".drive.mcap",
            "other.toml",
            "remembered.json",
        ] {
            std::fs::write(dir.path().join(file), "").unwrap();
        }
        std::fs::create_dir(dir.path().join("drives")).unwrap();
        let base = format!("{}/", dir.path().display());
        let offered = |begin: &str| -> Vec<String> {
            let found = matches(&format!("{base}{begin}"));
            found.iter().map(|path| path.strip_prefix(&base).unwrap().to_owned()).collect()
        };
        assert_eq!(offered("dri"), ["Drive_2.MCAP", "drive_1.mcap", "drives/"]);
        assert_eq!(offered(".d"), [".drive.mcap"]);
        assert_eq!(offered("rem"), ["remembered.json"]);
        assert_eq!(offered("x"), Vec::<String>::new());
        assert_eq!(matches(&format!("{base}none/x")), Vec::<String>::new());
        let found = vec![format!("{base}drive_1.mcap"), format!("{base}drives/")];
        let completion = Completion { found, ..Completion::default() };
        assert_eq!(completion.common(), Some(format!("{base}drive")));
    }
}
