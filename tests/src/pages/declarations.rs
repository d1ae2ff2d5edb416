//! Structures and enums as their source declares and documents them: what a file that serde reads may say.

use super::{code, read, table};

/// A field of a structure, or a variant of an enum.
#[derive(Debug, PartialEq)]
pub(super) struct Item {
    pub(super) name: String,
    /// As the source writes it, without where it stands.
    type_name: String,
    pub(super) help: String,
    is_optional: bool,
}

/// Whether a line is `struct NAME {` or `enum NAME {`.
fn is_head(line: &str, name: &str) -> bool {
    let words: Vec<_> = line.split([' ', '<', '{']).collect();
    words.windows(2).any(|pair| ["struct", "enum"].contains(&pair[0]) && pair[1] == name)
}

/// The lines of `struct NAME {` or `enum NAME {` of a source, up to its end.
fn body<'t>(text: &'t str, name: &str) -> impl Iterator<Item = &'t str> {
    text.lines().skip_while(move |line| !is_head(line, name)).skip(1).take_while(|line| *line != "}")
}

/// Whether every field of a structure has a default: `#[serde(default)]` is above its head.
fn has_defaults(text: &str, name: &str) -> bool {
    let before: Vec<_> = text.lines().take_while(|line| !is_head(line, name)).collect();
    let mut above = before.iter().rev().take_while(|line| line.starts_with("#[") || line.starts_with("///"));
    above.any(|line| line.starts_with("#[serde(") && line.contains("default"))
}

/// `#[serde(rename = "x")]`.
fn renamed(attribute: &str) -> Option<String> {
    let (_, rest) = attribute.split_once("rename = \"")?;
    rest.split('"').next().map(str::to_owned)
}

fn plain(type_name: &str) -> String {
    let mut name = type_name.trim().trim_end_matches(',').replace("Spanned<", "<");
    for outer in ["Option<", "<"] {
        while let Some(inner) = name.strip_prefix(outer).and_then(|rest| rest.strip_suffix('>')) {
            name = inner.to_owned();
        }
    }
    name.replace("<<", "<").replace("<String>", "String")
}

fn kind(type_name: &str) -> &str {
    match type_name {
        "String" => "text",
        "bool" => "true or false",
        "f64" | "f32" => "number",
        "u32" | "usize" | "u64" | "i32" => "whole number",
        name if name.starts_with("BTreeMap") => "table",
        name if name.starts_with("Vec<") || name.starts_with("BTreeSet<") => "list",
        _ => "",
    }
}

/// The documented fields of a structure.
pub(super) fn fields(file: &str, name: &str) -> Vec<Item> {
    items(&read(file), name, true)
}

/// The variants of an enum in `snake_case`.
pub(super) fn variants(file: &str, name: &str) -> Vec<Item> {
    items(&read(file), name, false)
}

fn items(text: &str, name: &str, are_fields: bool) -> Vec<Item> {
    let (mut items, mut help, mut rename, mut defaulted) = (Vec::new(), Vec::new(), None, false);
    let has_defaults = has_defaults(text, name);
    for line in body(text, name).map(|line| line.strip_prefix("    ").unwrap_or(line)) {
        if let Some(doc) = line.strip_prefix("///") {
            help.push(doc.trim().to_owned());
        } else if line.starts_with("#[") {
            defaulted |= line.contains("default");
            rename = rename.or_else(|| renamed(line));
        } else if line.starts_with(|c: char| c.is_alphabetic()) {
            let line = line.trim_start_matches("pub(crate) ").trim_start_matches("pub(super) ");
            let (own, type_name) =
                line.trim_start_matches("pub ").split_once(':').filter(|_| are_fields).unwrap_or((line, ""));
            let own = own.split([',', '(', ' ']).next().unwrap_or(own).to_owned();
            items.push(Item {
                name: rename.take().unwrap_or(if are_fields { own } else { snake(&own) }),
                type_name: plain(type_name),
                help: std::mem::take(&mut help).join(" "),
                is_optional: std::mem::take(&mut defaulted)
                    || has_defaults
                    || type_name.trim().starts_with("Option<"),
            });
        }
    }
    assert!(!items.is_empty(), "{name} is declared");
    for item in &items {
        assert!(!item.help.is_empty(), "{name}.{} is documented", item.name);
    }
    items
}

pub(super) fn snake(name: &str) -> String {
    let mut text = String::new();
    for c in name.chars() {
        if c.is_uppercase() && !text.is_empty() {
            text.push('_');
        }
        text.extend(c.to_lowercase());
    }
    text
}

/// A table of keys.
pub(super) fn keys(items: &[Item]) -> String {
    let row = |item: &Item| {
        let needed = if item.is_optional { "" } else { "yes" };
        vec![code(&item.name), kind(&item.type_name).to_owned(), needed.to_owned(), item.help.clone()]
    };
    table(&["key", "value", "required", "what"], &items.iter().map(row).collect::<Vec<_>>())
}

/// A table of the words that a key may have as its value.
pub(super) fn words(heading: &str, items: &[Item]) -> String {
    let row = |item: &Item| vec![code(&item.name), item.help.clone()];
    table(&[heading, "what"], &items.iter().map(row).collect::<Vec<_>>())
}

#[test]
fn fields_are_read_with_their_names_types_and_help() {
    let text = "/// X.\npub struct Other {\n}\nstruct Entry {\n    /// How\n    /// deep.\n    #[serde(default, rename = \"queue\")]\n    \
                pub depth: Spanned<usize>,\n    /// Who.\n    pub(crate) who: Option<Spanned<String>>,\n}\nenum Class {\n    \
                /// Soon.\n    RealTime,\n    /// Side by side.\n    Row(Vec<(f32, Class)>),\n    /// Some.\n    Tabs {\n        \
                /// Which.\n        active: usize,\n    },\n}\n";
    let item = |name: &str, type_name: &str, help: &str, is_optional| Item {
        name: name.to_owned(),
        type_name: type_name.to_owned(),
        help: help.to_owned(),
        is_optional,
    };
    let expected = [item("queue", "usize", "How deep.", true), item("who", "String", "Who.", true)];
    assert_eq!(items(text, "Entry", true), expected);
    let expected = [("real_time", "Soon."), ("row", "Side by side."), ("tabs", "Some.")];
    assert_eq!(items(text, "Class", false), expected.map(|(name, help)| item(name, "", help, false)));
}

#[test]
fn no_field_of_a_structure_with_defaults_is_required() {
    let text = "/// X.\n#[derive(Default)]\n#[serde(default)]\nstruct Saved {\n    /// How deep.\n    depth: usize,\n}\n\n\
                #[derive(Default)]\nstruct Other {\n    /// Who.\n    who: usize,\n}\n";
    let is_optional = |name: &str| items(text, name, true)[0].is_optional;
    assert!(is_optional("Saved") && !is_optional("Other"));
}
