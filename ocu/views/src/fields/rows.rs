//! The visible rows of a partly expanded tree. Only expanded values become rows, and long lists are split into pages.

use ocu_ui::format;
use rcs_msg::{FieldPath, Value};
use std::borrow::Cow;
use std::collections::BTreeSet;

/// Maximum number of rows of an expanded list: longer ones are split into pages, and these into pages again.
pub(super) const PAGE: usize = 100;
/// Maximum number of search results.
pub(super) const MOST_FOUND: usize = 500;

/// One row of the tree.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Row {
    /// Depth in the tree.
    pub(super) depth: usize,
    /// Name of the field, `[12]`, or `[0 … 99]`; the full path in search results.
    pub(super) name: String,
    /// Path of the value; for a page, the path of its list.
    pub(super) path: FieldPath,
    /// Key of the row's expanded state: its path, and for a page its range.
    pub(super) key: String,
    /// Short text of the value.
    pub(super) text: String,
    /// Whether it is expanded; `None` where it has no children.
    pub(super) open: Option<bool>,
}

/// The visible rows of `root`, given the keys of expanded values.
pub(super) fn rows(root: &Value, open: &BTreeSet<String>) -> Vec<Row> {
    let mut rows = Vec::new();
    children(root, &FieldPath::root(), 0, open, &mut rows);
    rows
}

/// All leaves whose path or text contains `search` (lower case), and whether there are more.
pub(super) fn found(root: &Value, search: &str) -> (Vec<Row>, bool) {
    let mut rows = Vec::new();
    for (path, value) in root.leaves() {
        let (name, text) = (path.to_string(), short(value));
        if !name.to_lowercase().contains(search) && !text.to_lowercase().contains(search) {
            continue;
        }
        if rows.len() == MOST_FOUND {
            return (rows, true);
        }
        rows.push(Row { depth: 0, key: name.clone(), name, path, text, open: None });
    }
    (rows, false)
}

fn children(value: &Value, path: &FieldPath, depth: usize, open: &BTreeSet<String>, rows: &mut Vec<Row>) {
    for (name, value) in value.fields() {
        row(name.clone(), value, &path.field(name), depth, open, rows);
    }
    if let (Value::List(_) | Value::Packed(_), Some(length)) = (value, value.len()) {
        items(value, path, 0..length, depth, open, rows);
    }
}

fn items(
    list: &Value,
    path: &FieldPath,
    range: std::ops::Range<usize>,
    depth: usize,
    open: &BTreeSet<String>,
    rows: &mut Vec<Row>,
) {
    let mut page = 1;
    while range.len() > page * PAGE {
        page *= PAGE;
    }
    if page == 1 {
        for index in range {
            let Some(item) = list.item(index) else { continue };
            row(format!("[{index}]"), &item, &path.index(index), depth, open, rows);
        }
        return;
    }
    let mut start = range.start;
    while start < range.end {
        let end = (start + page).min(range.end);
        let key = format!("{path}[{start}..{end}]");
        let is_open = open.contains(&key);
        rows.push(Row {
            depth,
            name: format!("[{start} … {}]", end - 1),
            path: path.clone(),
            key,
            text: String::new(),
            open: Some(is_open),
        });
        if is_open {
            items(list, path, start..end, depth + 1, open, rows);
        }
        start = end;
    }
}

fn row(
    name: String,
    value: &Value,
    path: &FieldPath,
    depth: usize,
    open: &BTreeSet<String>,
    rows: &mut Vec<Row>,
) {
    let key = path.to_string();
    let opens = match value {
        Value::Message(fields) => !fields.is_empty(),
        Value::List(_) | Value::Packed(_) => value.len() != Some(0),
        _ => false,
    };
    let is_open = opens.then(|| open.contains(&key));
    rows.push(Row { depth, name, path: path.clone(), key, text: short(value), open: is_open });
    if is_open == Some(true) {
        children(value, path, depth + 1, open, rows);
    }
}

/// A value on one line.
pub(super) fn short(value: &Value) -> String {
    match value {
        Value::Null => "–".to_owned(),
        Value::Bool(value) => value.to_string(),
        Value::Int(value) => value.to_string(),
        Value::Uint(value) => value.to_string(),
        Value::Float(value) => format::exact(*value),
        Value::Text(text) if text.chars().count() > 200 => {
            format!("{:?} … {} bytes", text.chars().take(200).collect::<String>(), text.len())
        }
        Value::Text(text) => format!("{text:?}"),
        Value::Bytes(bytes) => {
            let rest = if bytes.len() > 12 { " …" } else { "" };
            let shown = &bytes[..bytes.len().min(12)];
            format!("{} bytes  {}{rest}", format::count(bytes.len() as u64), hex(shown))
        }
        Value::Enum { number, name } if name.is_empty() => format!("{number} (not named)"),
        Value::Enum { number, name } => format!("{name} ({number})"),
        Value::List(list) => match list.len() {
            0 => "empty".to_owned(),
            1 => "1 element".to_owned(),
            count => format!("{} elements", format::count(count as u64)),
        },
        Value::Packed(packed) => {
            let shown: Vec<_> = packed.iter().take(6).map(|number| short(&number.into())).collect();
            let rest = if packed.len() > shown.len() { ", …" } else { "" };
            let count = format::count(packed.len() as u64);
            if packed.is_empty() {
                "empty".to_owned()
            } else {
                format!("{count} × [{}{rest}]", shown.join(", "))
            }
        }
        Value::Message(fields) => message(value, fields),
    }
}

/// A message on one line: a time, the numbers of a small vector, or nothing.
fn message(value: &Value, fields: &[(String, Value)]) -> String {
    if let Some(stamp) = value.as_stamp().filter(|_| fields.len() == 2) {
        return format!("{}  {stamp}", format::clock(stamp.0));
    }
    let numbers: Vec<Cow<'_, str>> = fields
        .iter()
        .take(5)
        .filter_map(|(name, value)| {
            let Value::Float(number) = value else { return None };
            Some(format!("{name} {}", format::number(*number)).into())
        })
        .collect();
    if numbers.len() == fields.len() { numbers.join("  ") } else { String::new() }
}

/// Bytes in hexadecimal, separated by blanks.
pub(super) fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample(length: usize) -> Value {
        let cell = |i: usize| Value::Message(vec![("cost".to_owned(), Value::Uint(i as u64))]);
        Value::Message(vec![
            ("pose".to_owned(), Value::Message(vec![("x".to_owned(), Value::Float(1.5))])),
            ("cells".to_owned(), Value::List((0..length).map(cell).collect())),
            ("name".to_owned(), Value::Text("north".to_owned())),
        ])
    }

    fn names(rows: &[Row]) -> Vec<String> {
        rows.iter()
            .map(|row| format!("{}{} {}", " ".repeat(row.depth), row.name, row.text).trim_end().to_owned())
            .collect()
    }

    #[test]
    fn only_what_is_open_becomes_a_row() {
        let root = sample(2);
        let closed = rows(&root, &BTreeSet::new());
        assert_eq!(names(&closed), ["pose x 1.5", "cells 2 elements", "name \"north\""]);
        let open = rows(&root, &[".cells".to_owned(), ".cells[1]".to_owned()].into());
        assert_eq!(
            names(&open),
            ["pose x 1.5", "cells 2 elements", " [0]", " [1]", "  cost 1", "name \"north\""]
        );
        assert!(open.iter().all(|row| root.get(&row.path).is_ok()));
    }

    #[test]
    fn a_long_list_opens_in_pages_of_pages() {
        let root = sample(100_000);
        let open = rows(&root, &[".cells".to_owned()].into());
        assert!(open.len() <= PAGE + 3, "{} rows", open.len());
        let mut keys: BTreeSet<String> = [".cells".to_owned()].into();
        keys.insert(open.iter().find(|row| row.name == "[10000 … 19999]").unwrap().key.clone());
        let open = rows(&root, &keys);
        keys.insert(open.iter().find(|row| row.name == "[10100 … 10199]").unwrap().key.clone());
        let open = rows(&root, &keys);
        assert!(open.iter().any(|row| row.name == "[10150]" && row.path.to_string() == ".cells[10150]"));
        assert!(open.len() < 400);
    }

    #[test]
    fn a_search_finds_paths_and_values_and_stops_in_time() {
        assert_eq!(
            names(&found(&sample(3), "cost").0),
            [".cells[0].cost 0", ".cells[1].cost 1", ".cells[2].cost 2"]
        );
        assert_eq!(names(&found(&sample(3), "north").0), [".name \"north\""]);
        let (rows, more) = found(&sample(10_000), "cost");
        assert_eq!((rows.len(), more), (MOST_FOUND, true));
    }

    #[test]
    fn times_vectors_and_bytes_are_told_in_one_line() {
        let stamp = Value::Message(vec![
            ("sec".to_owned(), Value::Int(3661)),
            ("nanosec".to_owned(), Value::Uint(5_000_000)),
        ]);
        assert_eq!(short(&stamp), "01:01:01.005  3661.005 s");
        assert_eq!(short(&Value::Bytes(vec![0xff, 0x0a].into())), "2 bytes  ff 0a");
        assert_eq!(short(&Value::Enum { number: 9, name: String::new() }), "9 (not named)");
    }
}
