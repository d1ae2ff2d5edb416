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
    text.split('"').skip(1).step_by(2).filter(is_key).collect()
}

#[test]
fn every_metadata_key_in_the_code_is_defined() {
    let mut folders =
        vec![path("core/runtime/src"), path("core/msg/src"), path("ocu/views/src"), path("ocu/app/src")];
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
}
