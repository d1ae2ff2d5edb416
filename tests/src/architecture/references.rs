//! Checks that `docs/references.md` lists every work that the code cites, and no other.

use super::assert_kept;
use super::tree::{read, sources};
use std::collections::BTreeSet;

/// Keys of the table of references: `Albus 2006a`.
fn keys(references: &str) -> BTreeSet<&str> {
    references.lines().filter_map(|line| line.strip_prefix("| ")?.split(" |").next()).collect()
}

/// Whether a word before a year is a surname, or the end of `Chan et al.`, which is no key.
fn is_name(word: &str) -> bool {
    let is_letter = |c: char| c.is_alphabetic() || c == '-';
    let is_surname = word.starts_with(char::is_uppercase) && word.chars().all(is_letter);
    word == "al." || (is_surname && word.chars().count() > 1)
}

/// Whether a word is a year, with a letter or without: `1978`, `2006a`.
fn is_year(word: &str) -> bool {
    let digits = word.strip_suffix(|c: char| c.is_ascii_lowercase()).unwrap_or(word);
    digits.len() == 4 && digits.parse::<u16>().is_ok_and(|year| (1900..2100).contains(&year))
}

/// Citations in a text without a matching key: `Albus 2007`, and a paper cited by a letter (`A 3.1.1`).
fn unresolved(text: &str, keys: &BTreeSet<&str>) -> Vec<String> {
    let words: Vec<&str> = text.split([' ', '\n', '(', '[']).filter(|word| !word.is_empty()).collect();
    let mut found = Vec::new();
    for pair in words.windows(2) {
        let name = pair[0].trim_end_matches(',');
        let year = pair[1].split(|c: char| !c.is_alphanumeric()).next().unwrap_or_default();
        let is_proposal = name == "REP" && year.starts_with(|c: char| c.is_ascii_digit());
        let is_citation = is_proposal || (is_name(name) && is_year(year));
        let section: Vec<&str> = pair[1].trim_end_matches([',', '.', ';', ':', ')']).split('.').collect();
        let is_section = section.len() == 3 && section.iter().all(|part| part.parse::<u8>().is_ok());
        if (is_citation && !keys.contains(&*format!("{name} {year}")))
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

/// Keys that no text has, on one line or on two.
fn uncited<'a>(keys: &BTreeSet<&'a str>, texts: &[String]) -> Vec<&'a str> {
    let words = |text: &String| text.split_whitespace().collect::<Vec<_>>().join(" ");
    let texts: Vec<String> = texts.iter().map(words).collect();
    keys.iter().copied().filter(|key| !texts.iter().any(|text| text.contains(*key))).collect()
}

#[test]
fn every_citation_stands_in_the_list_of_references_which_has_no_other_works() {
    let text = read("docs/references.md");
    let mut keys = keys(&text);
    assert!(keys.remove("key") && keys.remove("---"), "the head of the table: {keys:?}");
    assert!(keys.contains("Albus 2006a"), "{keys:?}");
    let (mut breaches, mut texts) = (Vec::new(), vec![read("docs/glossary.md")]);
    let sources = ["core", "plugins", "ocu", "tools", "tests", "benches"].into_iter().flat_map(sources);
    for source in sources.filter(|source| !source.path.ends_with("architecture/references.rs")) {
        let comments = comments(&source.text);
        let found = unresolved(&comments, &keys);
        breaches.extend(found.into_iter().map(|citation| format!("{}: {citation}", source.path)));
        texts.push(comments);
    }
    breaches.extend(uncited(&keys, &texts).into_iter().map(|key| format!("{key} is cited nowhere")));
    assert_kept("docs/references.md has every work that is cited, and no other", &breaches);
}

#[test]
fn a_citation_without_an_entry_and_one_by_a_letter_are_found() {
    let keys = BTreeSet::from(["Albus 2006a", "REP 103"]);
    let check =
        |text: &str, expected: &[&str]| assert_eq!(unresolved(&comments(text), &keys), expected, "{text}");
    check("/// A mean (Albus 2006a, 3.1.1), with axes of REP 103.", &[]);
    check("//! As in Albus\n//! 2007, 4.", &["Albus 2007,"]);
    check("// The rule (A 3.1.1), for a gap. A 2.5 m wide one.", &["A 3.1.1),"]);
    check("// Joined (Chan et al. 1983), as in Cooley and Tukey 1965.", &["al. 1983),", "Tukey 1965."]);
    check("/// Wilson, 2017: of 2000 images, in 1920 x 1080. REP 105.", &["Wilson 2017:", "REP 105."]);
}

#[test]
fn a_reference_that_nothing_cites_is_found() {
    let keys = BTreeSet::from(["Albus 2002", "Albus 2006a", "Swain 1991"]);
    let texts = ["A mean (Albus\n2006a, 4).".to_owned(), "Histograms (Swain 1991)".to_owned()];
    assert_eq!(uncited(&keys, &texts), ["Albus 2002"]);
}
