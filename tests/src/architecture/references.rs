//! Checks that `docs/references.md` lists every work that the code cites.

use super::assert_kept;
use super::tree::{root, sources};
use std::collections::BTreeSet;

/// Surnames of cited authors. A new name here needs a new entry in the list of references.
const CITED: [&str; 7] = ["Albus", "Hirschmüller", "Ojala", "Oskard", "Swain", "Wellington", "REP"];

/// Keys of the table of references: `Albus 2006a`.
fn keys(references: &str) -> BTreeSet<&str> {
    references.lines().filter_map(|line| line.strip_prefix("| ")?.split(" |").next()).collect()
}

/// Citations in a text without a matching key: `Albus 2007`, and a paper cited by a letter (`A 3.1.1`).
fn unresolved(text: &str, keys: &BTreeSet<&str>) -> Vec<String> {
    let words: Vec<&str> = text.split([' ', '\n', '(', '[']).filter(|word| !word.is_empty()).collect();
    let mut found = Vec::new();
    for pair in words.windows(2) {
        let name = pair[0];
        let year = pair[1].split(|c: char| !c.is_alphanumeric()).next().unwrap_or_default();
        let is_number = year.starts_with(|c: char| c.is_ascii_digit());
        let section: Vec<&str> = pair[1].trim_end_matches([',', '.', ';', ':', ')']).split('.').collect();
        let is_section = section.len() == 3 && section.iter().all(|part| part.parse::<u8>().is_ok());
        if (CITED.contains(&name) && is_number && !keys.contains(&*format!("{name} {year}")))
            || (matches!(name, "A" | "B") && is_section)
        {
            found.push(format!("{name} {}", pair[1]));
        }
    }
    found
}

/// The comments of a source, without comment markers.
fn comments(text: &str) -> String {
    let lines = text.lines().filter_map(|line| line.split_once("//").map(|(_, comment)| comment));
    lines.map(|line| line.trim_start_matches(['/', '!'])).collect::<Vec<_>>().join("\n")
}

#[test]
fn every_citation_stands_in_the_list_of_references() {
    let text = std::fs::read_to_string(root().join("docs/references.md")).expect("the list of references");
    let keys = keys(&text);
    assert!(keys.contains("Albus 2006a"), "{keys:?}");
    let breaches: Vec<String> = ["core", "plugins", "ocu", "tools", "tests", "benches"]
        .into_iter()
        .flat_map(sources)
        .filter(|source| !source.path.ends_with("architecture/references.rs"))
        .flat_map(|source| {
            let found = unresolved(&comments(&source.text), &keys);
            found.into_iter().map(move |citation| format!("{}: {citation}", source.path))
        })
        .collect();
    assert_kept("every citation stands in docs/references.md", &breaches);
}

#[test]
fn a_citation_without_an_entry_and_one_by_a_letter_are_found() {
    let keys = BTreeSet::from(["Albus 2006a", "REP 103"]);
    let check =
        |text: &str, expected: &[&str]| assert_eq!(unresolved(&comments(text), &keys), expected, "{text}");
    check("/// A mean (Albus 2006a, 3.1.1), with axes of REP 103.", &[]);
    check("//! As in Albus\n//! 2007, 4.", &["Albus 2007,"]);
    check("// The rule (A 3.1.1), for a gap. A 2.5 m wide one.", &["A 3.1.1),"]);
}
