//! The pages that are made from definitions: `docs/reference`, and the tables of the README. A test says where a page is
//! another; `scripts/docs` writes all of them anew (it sets `UPDATE_DOCS`). Of `docs/write-a-plugin.md`, which a person
//! writes, the stack is checked.

mod asked;
mod channels;
mod declarations;
mod layouts;
mod messages;
mod modes;
mod plugins;
mod proto;
mod readme;
mod stacks;
mod vehicle_keys;
mod world_keys;
mod worlds;
mod write_a_plugin;

use std::fmt::Write as _;
use std::path::Path;

/// A file of the repository.
fn path(name: &str) -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the package lies in the workspace").join(name)
}

fn read(name: &str) -> String {
    std::fs::read_to_string(path(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
}

/// Holds a page against what it should be, or writes it where `UPDATE_DOCS` is set.
fn check(name: &str, expected: &str) {
    if std::env::var_os("UPDATE_DOCS").is_some() {
        let folder = path(name).parent().map(std::fs::create_dir_all);
        folder.transpose().unwrap_or_else(|error| panic!("{name}: {error}"));
        std::fs::write(path(name), expected).unwrap_or_else(|error| panic!("{name}: {error}"));
        return;
    }
    let found = std::fs::read_to_string(path(name)).unwrap_or_default();
    let differs = || expected.lines().zip(found.lines()).position(|(a, b)| a != b);
    assert!(
        found == expected,
        "{name} is not what the definitions say, from line {} on; scripts/docs writes it anew",
        differs().unwrap_or_else(|| expected.lines().count().min(found.lines().count())) + 1
    );
}

/// The page of the reference of that name.
fn check_reference(name: &str, text: &str) {
    check(&format!("docs/reference/{name}.md"), text);
}

/// A table; cells may hold `|`.
fn table(headings: &[&str], rows: &[Vec<String>]) -> String {
    let mut text = String::new();
    let mut line = |cells: &[String]| {
        let cells: Vec<_> = cells.iter().map(|cell| cell.replace('|', "\\|")).collect();
        writeln!(text, "| {} |", cells.join(" | ")).expect("a text takes a line");
    };
    line(&headings.iter().map(|heading| (*heading).to_owned()).collect::<Vec<_>>());
    line(&vec!["---".to_owned(); headings.len()]);
    for row in rows {
        line(row);
    }
    text.push('\n');
    text
}

fn code(text: &str) -> String {
    if text.is_empty() { String::new() } else { format!("`{text}`") }
}

#[test]
fn every_page_of_the_reference_is_checked() {
    let entries = std::fs::read_dir(path("docs/reference")).expect("there is a reference");
    let mut names: Vec<_> = entries
        .map(|entry| entry.expect("it can be read").file_name().into_string().expect("a name"))
        .collect();
    names.sort();
    let pages = ["channels", "layouts", "messages", "modes", "plugins", "stacks", "worlds"];
    assert_eq!(names, pages.map(|page| format!("{page}.md")));
}
