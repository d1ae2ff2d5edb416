//! `docs/reference/messages.md`: the messages of package `rcs`, from their `.proto` files.

use super::proto::{Declared, declared};
use super::{check_reference, code, path, read, table};
use std::path::Path;

/// The `.proto` files of a folder, by name.
fn files(folder: &str) -> Vec<String> {
    let entries = std::fs::read_dir(path(folder)).unwrap_or_else(|error| panic!("{folder}: {error}"));
    let names =
        entries.map(|entry| entry.expect("it can be read").file_name().to_string_lossy().into_owned());
    let mut files: Vec<_> = names
        .filter(|name| Path::new(name).extension().is_some_and(|end| end == "proto"))
        .map(|name| format!("{folder}/{name}"))
        .collect();
    files.sort();
    files
}

/// Folders with the plugins' own messages.
fn plugin_folders() -> Vec<String> {
    let entries = std::fs::read_dir(path("plugins")).expect("there are plugins");
    let names =
        entries.map(|entry| entry.expect("it can be read").file_name().to_string_lossy().into_owned());
    let mut folders: Vec<_> =
        names.map(|name| format!("plugins/{name}/proto")).filter(|folder| path(folder).is_dir()).collect();
    folders.sort();
    folders
}

fn section(message: &Declared) -> String {
    let mut text = format!("### {}\n\n", message.name);
    if !message.help.is_empty() {
        text += &[&*message.help, "\n\n"].concat();
    }
    if message.entries.is_empty() {
        return text;
    }
    let row = |entry: &super::proto::Entry| {
        let mut row = vec![code(&entry.name), entry.number.clone()];
        row.extend((!message.is_enum).then(|| code(&entry.type_name)));
        row.push(entry.help.clone());
        row
    };
    let rows: Vec<_> = message.entries.iter().map(row).collect();
    let headings: &[&str] =
        if message.is_enum { &["value", "number", "what"] } else { &["field", "number", "type", "what"] };
    text + &table(headings, &rows)
}

#[test]
fn the_reference_of_messages_is_made_from_their_declarations() {
    let mut text = "# Messages\n\nThe messages of package `rcs`, made from the `.proto` files. Parameter messages are in \
                    [plugins.md](plugins.md), Foxglove's schemas in Foxglove's documentation.\n\n"
        .to_owned();
    for folder in std::iter::once("core/msg/proto/rcs".to_owned()).chain(plugin_folders()) {
        for file in files(&folder) {
            let messages: Vec<_> =
                declared(&read(&file)).into_iter().filter(|message| !message.is_parameters()).collect();
            if !messages.is_empty() {
                text += &["## `", &*file, "`\n\n"].concat();
                text.extend(messages.iter().map(section));
            }
        }
    }
    check_reference("messages", &format!("{}\n", text.trim_end()));
}
