//! `docs/reference/channels.md`: what a channel of a recording says beside its messages.

use super::{check_reference, code, path, table};
use rcs_msg::channel::{METADATA, TIMES};
use rcs_runtime::Role;

#[test]
fn the_reference_of_channels_is_made_from_their_definition() {
    let mut text = "# Channels of a recording\n\nMCAP channels that this program writes, made from the definitions in \
                    `core/msg` and `core/runtime`. A recording of another program needs none of it.\n\n## Times and numbers\n\n"
        .to_owned();
    let rows = |pairs: &[(&str, &str)]| -> Vec<Vec<String>> {
        pairs.iter().map(|(key, what)| vec![code(key), (*what).to_owned()]).collect()
    };
    text += &table(&["field", "what"], &rows(TIMES));
    text += "## Metadata\n\n";
    text += &table(&["key", "what"], &rows(METADATA));
    text += "## Roles\n\nValues of `rcs.role`, with the types of the messages that can play each.\n\n";
    let role = |role: Role| {
        let types: Vec<_> = role.types().iter().map(|name| code(name)).collect();
        vec![code(role.name()), if types.is_empty() { "any".to_owned() } else { types.join(", ") }]
    };
    text += &table(&["role", "types"], &Role::all().map(role).collect::<Vec<_>>());
    check_reference("channels", &format!("{}\n", text.trim_end()));
}

/// Metadata keys in a source: `"rcs.lower_case"`.
fn keys(text: &str) -> Vec<&str> {
    let is_key = |word: &&str| {
        let name = word.strip_prefix("rcs.").unwrap_or_default();
        !name.is_empty() && name.chars().all(|c| c.is_ascii_lowercase() || c == '_')
    };
    // What begins at any quotation mark, so that a quotation mark that is a character hides no key after it.
    text.split('"').skip(1).filter(is_key).collect()
}

/// Folders with the sources of the program: everything but tests, which have keys of their own.
fn sources() -> Vec<std::path::PathBuf> {
    let packages = ["core", "ocu", "plugins", "tools"].into_iter().flat_map(|part| {
        let entries = std::fs::read_dir(path(part)).unwrap_or_else(|error| panic!("{part}: {error}"));
        entries.map(|entry| entry.expect("it can be read").path().join("src"))
    });
    packages.filter(|folder| folder.is_dir()).collect()
}

#[test]
fn every_metadata_key_in_the_code_is_defined() {
    let mut folders = sources();
    assert!(folders.len() > 20, "{folders:?}");
    let mut found = 0;
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder).expect("it can be read") {
            let entry = entry.expect("it can be read").path();
            if entry.is_dir() {
                folders.push(entry);
            } else if entry.extension().is_some_and(|ending| ending == "rs") {
                let text = std::fs::read_to_string(&entry).expect("it can be read");
                for key in keys(&text) {
                    found += 1;
                    assert!(METADATA.iter().any(|(known, _)| *known == key), "{key} in {}", entry.display());
                }
            }
        }
    }
    assert!(found > 10, "{found}");
    assert_eq!(keys("a(\"rcs.role\", \"rcs.Command\", \"x\")"), ["rcs.role"]);
    assert_eq!(keys("a('\"', \"rcs.role\")"), ["rcs.role"]);
}
