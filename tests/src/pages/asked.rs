//! What a reader of TOML files accepts, found by asking it: it refuses files with a wrong value or an unknown key, and
//! says what it expected.
//!
//! The pages state name, default and meaning of each key. Values and ranges come from the reader, and so does the list
//! of keys with which that of the page is compared.

use super::{code, table};
use std::collections::BTreeSet;
use toml::{Table, Value};

/// A key that no file has.
const UNKNOWN: &str = "unknown_key";
/// How a refusal of an unknown key goes on after the name of the key.
const IS_UNKNOWN: &str = "is unknown, expected one of ";

/// A key: its name, its default, and what it is. A default that is written as in TOML is compared with what the reader
/// does without the key; other texts say what holds without it.
pub(super) type Key = (&'static str, &'static str, &'static str);

/// A table of a file.
pub(super) struct Section {
    /// How the file begins it; empty for the keys before all tables.
    pub(super) heading: &'static str,
    /// Its keys from the top of the file, joined by `.`; of a list, the first entry is asked.
    pub(super) at: &'static str,
    pub(super) keys: &'static [&'static [Key]],
    /// Keys that the reader may know, too, and that the page states elsewhere.
    pub(super) besides: &'static [&'static str],
}

/// A kind of file.
pub(super) struct Kind {
    /// What a file says, as a text that differs where the file means something else, or why it is refused.
    pub(super) read: fn(&str) -> Result<String, String>,
    /// A file that is accepted, with an entry of each table. Where one value is the bound of another, it is that which
    /// leaves most to the other.
    pub(super) sample: &'static str,
}

/// The table at a path; of a list, its first entry.
fn table_at<'t>(file: &'t mut Table, at: &str) -> &'t mut Table {
    at.split('.').filter(|step| !step.is_empty()).fold(file, |table, step| {
        let inner = match table.get_mut(step) {
            Some(Value::Array(list)) => list.first_mut(),
            inner => inner,
        };
        inner.and_then(Value::as_table_mut).unwrap_or_else(|| panic!("the sample has a table {at}"))
    })
}

/// What a refusal says was expected.
fn expected(refusal: &str) -> &str {
    let text = refusal.rsplit_once("expected ").map_or("", |(_, expected)| expected);
    text.strip_prefix("a ").unwrap_or(text)
}

impl Kind {
    /// Reads the sample with a change of one of its tables.
    fn changed(&self, at: &str, change: impl FnOnce(&mut Table)) -> Result<String, String> {
        let mut file = self.sample.parse::<Table>().unwrap_or_else(|error| panic!("the sample: {error}"));
        change(table_at(&mut file, at));
        (self.read)(&file.to_string())
    }

    /// Why the sample is refused with a change and, in the same table, an unknown key, which is found last.
    fn refusal(&self, at: &str, change: impl FnOnce(&mut Table)) -> String {
        let read = self.changed(at, |table| {
            change(table);
            table.insert(UNKNOWN.to_owned(), true.into());
        });
        read.expect_err("an unknown key is refused")
    }

    /// All keys that the reader knows in a table after a change.
    pub(super) fn known(&self, at: &str, change: impl FnOnce(&mut Table)) -> BTreeSet<String> {
        let refusal = self.refusal(at, change);
        let known = refusal.split_once(IS_UNKNOWN).unwrap_or_else(|| panic!("{at}: {refusal}")).1;
        known.split(", ").map(str::to_owned).collect()
    }

    fn is_required(&self, at: &str, key: &str) -> bool {
        let without = self.refusal(at, |table| {
            table.remove(key);
        });
        !without.contains(IS_UNKNOWN)
    }

    /// What a key takes, such as `number, 0 to 5`.
    pub(super) fn value(&self, at: &str, key: &str) -> String {
        let ask = |value: Value| {
            self.refusal(at, |table| {
                table.insert(key.to_owned(), value);
            })
        };
        // No key takes a date.
        let date = "2000-01-01".parse::<toml::value::Datetime>().expect("it is a date");
        let refusal = ask(Value::Datetime(date));
        assert!(!refusal.contains(IS_UNKNOWN), "{at}: {key} takes anything");
        let kind = expected(&refusal);
        if let Some((low, high)) =
            kind.strip_prefix("number from ").and_then(|range| range.split_once(" to "))
        {
            if low == high {
                return low.to_owned();
            }
            let low_number: f64 = low.parse().expect("it is a number");
            let refusal = ask((low_number + 0.5).into());
            return match expected(&refusal) {
                "whole number" => format!("whole number, {low} to {high}"),
                only if only.parse::<f64>().is_ok() => only.to_owned(),
                _ => format!("number, {low} to {high}"),
            };
        }
        if kind == "text" {
            let refusal = ask("?".into());
            let words = refusal.split_once("expected one of ").filter(|_| !refusal.contains(IS_UNKNOWN));
            return words.map_or(kind.to_owned(), |(_, words)| names(words.split(", ")));
        }
        if let Some(count) = kind.strip_prefix("list of ").and_then(|kind| kind.strip_suffix(" numbers")) {
            let count: usize = count.parse().expect("it is a number");
            let refusal = ask(vec![1e9_f64; count].into());
            let range = expected(&refusal).strip_prefix("number from ");
            return range.map_or(kind.to_owned(), |range| format!("{kind}, each {range}"));
        }
        kind.to_owned()
    }

    /// Fails where a file without a key means something else than one with its default.
    fn check_default(&self, at: &str, key: &str, default: &str) {
        let Ok(stated) = format!("{key} = {default}").parse::<Table>() else { return };
        let with = self.changed(at, |table| table.extend(stated));
        let without = self.changed(at, |table| {
            table.remove(key);
        });
        assert!(with.is_ok() && with == without, "{at}: {key} is not {default} without it: {with:?}");
    }

    /// The sections of the page. Fails where the reader knows a table that has none.
    pub(super) fn sections(&self, sections: &[Section]) -> String {
        let text: String = sections.iter().map(|section| self.section(section)).collect();
        for Section { at, keys, .. } in sections {
            for (key, ..) in keys.iter().copied().flatten() {
                let is_table = ["table", "list of tables"].contains(&self.value(at, key).as_str());
                let path = if at.is_empty() { (*key).to_owned() } else { format!("{at}.{key}") };
                // Of tables with names of any kind, the page has one.
                let below = format!("{path}.");
                let has_section = sections.iter().any(|it| it.at == path || it.at.starts_with(&below));
                assert!(!is_table || has_section, "{path} has no section");
            }
        }
        text
    }

    /// A section of the page. Fails where the reader knows other keys than those of the section.
    fn section(&self, section: &Section) -> String {
        let Section { heading, at, keys, besides } = section;
        let keys: Vec<&Key> = keys.iter().copied().flatten().collect();
        let stated: BTreeSet<String> = keys.iter().map(|(key, ..)| (*key).to_owned()).collect();
        let mut known = self.known(at, |_| {});
        known.retain(|key| stated.contains(key) || !besides.contains(&key.as_str()));
        assert_eq!(stated, known, "keys of the page and of the reader: {heading}");
        let row = |&&(key, default, what): &&Key| {
            self.check_default(at, key, default);
            let is_literal = format!("{key} = {default}").parse::<Table>().is_ok();
            let otherwise = match default {
                "" if self.is_required(at, key) => "required".to_owned(),
                default if is_literal => code(default),
                default => default.to_owned(),
            };
            vec![code(key), self.value(at, key), otherwise, what.to_owned()]
        };
        let rows: Vec<_> = keys.iter().map(row).collect();
        let heading = if heading.is_empty() { String::new() } else { format!("### {}\n\n", code(heading)) };
        heading + &table(&["key", "value", "default", "what"], &rows)
    }
}

/// Names in a row: `a`, `b`.
pub(super) fn names<'t>(names: impl IntoIterator<Item = &'t str>) -> String {
    names.into_iter().map(code).collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A reader with one table, in the words of those of worlds and vehicles.
    fn read(text: &str) -> Result<String, String> {
        let file: Table = text.parse().map_err(|error: toml::de::Error| error.to_string())?;
        let part = file.get("part").and_then(|parts| parts.get(0)).and_then(Value::as_table);
        let part = part.ok_or("part is missing, expected a list of tables")?;
        let size = match part.get("size_m").map(|size| size.as_float().filter(|size| *size <= 2.0)) {
            Some(Some(size)) => size,
            Some(None) => return Err("size_m is wrong, expected a number from 0.5 to 2".to_owned()),
            None => 1.0,
        };
        if !part.get("name").is_some_and(Value::is_str) {
            return Err("name is wrong, expected a text".to_owned());
        }
        if let Some(key) = part.keys().find(|key| !["name", "size_m"].contains(&key.as_str())) {
            return Err(format!("{key} is unknown, expected one of name, size_m"));
        }
        match file.keys().find(|key| *key != "part") {
            Some(key) => Err(format!("{key} is unknown, expected one of part")),
            None => Ok(size.to_string()),
        }
    }

    const KIND: Kind = Kind { read, sample: "part = [{ name = \"a\" }]" };
    const SIZE: Key = ("size_m", "1.0", "Size.");
    const NAME: Key = ("name", "", "Name.");

    fn section(keys: &'static [&'static [Key]]) -> String {
        KIND.section(&Section { heading: "[[part]]", at: "part", keys, besides: &[] })
    }

    #[test]
    fn values_and_what_is_required_come_from_the_reader() {
        let expected = "### `[[part]]`\n\n| key | value | default | what |\n| --- | --- | --- | --- |\n\
                        | `name` | text | required | Name. |\n\
                        | `size_m` | number, 0.5 to 2 | `1.0` | Size. |\n\n";
        assert_eq!(section(&[&[NAME], &[SIZE]]), expected);
    }

    #[test]
    #[should_panic(expected = "keys of the page and of the reader: [[part]]")]
    fn a_key_that_the_page_lacks_is_found() {
        section(&[&[NAME]]);
    }

    #[test]
    #[should_panic(expected = "keys of the page and of the reader: [[part]]")]
    fn a_key_that_the_reader_does_not_know_is_found() {
        section(&[&[NAME, SIZE, ("length_m", "", "Length.")]]);
    }

    #[test]
    #[should_panic(expected = "part has no section")]
    fn a_table_that_the_page_lacks_is_found() {
        let top = Section { heading: "", at: "", keys: &[&[("part", "", "Parts.")]], besides: &[] };
        KIND.sections(&[top]);
    }

    #[test]
    #[should_panic(expected = "part: size_m is not 0.6 without it")]
    fn another_default_than_that_of_the_reader_is_found() {
        section(&[&[NAME, ("size_m", "0.6", "Size.")]]);
    }
}
