//! Reads a TOML table key by key; errors contain the line of the key.

use std::cell::RefCell;
use std::ops::{Range, RangeInclusive};
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// Why a file cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("line {line}: {reason}")]
pub struct FileError {
    /// Line, counted from 1.
    pub line: usize,
    /// Key, value found, and what was expected.
    pub reason: String,
}

/// A table of the file being read. Keys that were not read when [`Section::finish`] is called are unknown keys.
pub(crate) struct Section<'a> {
    text: &'a str,
    /// Path of the table in the file, such as `body.` or `camera.`; empty for the whole file.
    path: String,
    /// Offset of its first byte.
    start: usize,
    table: &'a DeTable<'a>,
    asked: RefCell<Vec<&'static str>>,
}

/// Parses a text and reads it with a function.
pub(crate) fn read_file<T>(
    text: &str,
    read: impl FnOnce(&Section<'_>) -> Result<T, FileError>,
) -> Result<T, FileError> {
    let table = DeTable::parse(text).map_err(|error| {
        let line = line_of(text, error.span().map_or(0, |span| span.start));
        let mut reason = error.message().trim().to_owned();
        if reason == "duplicate key"
            && let Some(key) = error.span().and_then(|span| text.get(span))
        {
            reason = format!("duplicate key {key}");
        }
        FileError { line, reason }
    })?;
    let section =
        Section { text, path: String::new(), start: 0, table: table.get_ref(), asked: RefCell::default() };
    let value = read(&section)?;
    section.finish()?;
    Ok(value)
}

fn line_of(text: &str, offset: usize) -> usize {
    1 + text.bytes().take(offset).filter(|&byte| byte == b'\n').count()
}

impl<'a> Section<'a> {
    /// An error at an offset of the text.
    fn error_at(&self, offset: usize, reason: String) -> FileError {
        FileError { line: line_of(self.text, offset), reason }
    }

    /// An error of a key, at its value, or at the table's header where the key is missing.
    pub(crate) fn error(&self, key: &str, reason: impl std::fmt::Display) -> FileError {
        let offset = self.table.get(key).map_or(self.start, |value| value.span().start);
        self.error_at(offset, format!("{}{key} {reason}", self.path))
    }

    /// An error of an element of a list of tables, at its `name`.
    pub(crate) fn error_of_name(&self, key: &str, index: usize, reason: impl std::fmt::Display) -> FileError {
        let list = self.table.get(key).and_then(|list| list.get_ref().as_array());
        let table = list.and_then(|list| list.get(index)).and_then(|entry| entry.get_ref().as_table());
        let offset = table.and_then(|table| table.get("name")).map_or(self.start, |name| name.span().start);
        self.error_at(offset, format!("{}{key} {reason}", self.path))
    }

    fn get(&self, key: &'static str) -> Option<&'a Spanned<DeValue<'a>>> {
        self.asked.borrow_mut().push(key);
        self.table.get(key)
    }

    fn missing(&self, key: &str, expected: &str) -> FileError {
        self.error(key, format_args!("is missing, expected {expected}"))
    }

    fn wrong(&self, key: &str, value: &DeValue<'_>, expected: &str) -> FileError {
        self.error(key, format_args!("is of type {}, expected {expected}", value.type_str()))
    }

    /// Whether a key is present.
    pub(crate) fn has(&self, key: &'static str) -> bool {
        self.get(key).is_some()
    }

    /// A number within a range.
    pub(crate) fn number(&self, key: &'static str, range: RangeInclusive<f64>) -> Result<f64, FileError> {
        let expected = format!("a number from {} to {}", range.start(), range.end());
        let value = self.get(key).ok_or_else(|| self.missing(key, &expected))?;
        let digits = match value.get_ref() {
            DeValue::Float(float) => float.as_str(),
            DeValue::Integer(integer) if integer.radix() == 10 => integer.as_str(),
            other => return Err(self.wrong(key, other, &expected)),
        };
        let number: f64 =
            digits.parse().map_err(|_| self.error(key, format_args!("is {digits}, expected {expected}")))?;
        if !range.contains(&number) {
            return Err(self.error(key, format_args!("is {digits}, expected {expected}")));
        }
        Ok(number)
    }

    /// A number within a range, with a default where the key is missing.
    pub(crate) fn number_or(
        &self,
        key: &'static str,
        range: RangeInclusive<f64>,
        default: f64,
    ) -> Result<f64, FileError> {
        match self.get(key) {
            Some(_) => self.number(key, range),
            None => Ok(default),
        }
    }

    /// A whole number within a range.
    pub(crate) fn count(&self, key: &'static str, range: RangeInclusive<u32>) -> Result<u32, FileError> {
        let number = self.number(key, f64::from(*range.start())..=f64::from(*range.end()))?;
        if number.fract() != 0.0 {
            return Err(self.error(key, format_args!("is {number}, expected a whole number")));
        }
        Ok(number as u32)
    }

    /// A non-empty text.
    pub(crate) fn text(&self, key: &'static str) -> Result<String, FileError> {
        let value = self.get(key).ok_or_else(|| self.missing(key, "a text"))?;
        match value.get_ref().as_str() {
            Some("") => Err(self.error(key, "is empty, expected a text")),
            Some(text) => Ok(text.to_owned()),
            None => Err(self.wrong(key, value.get_ref(), "a text")),
        }
    }

    /// A text; empty where the key is missing.
    pub(crate) fn text_or_empty(&self, key: &'static str) -> Result<String, FileError> {
        if self.get(key).is_some() { self.text(key) } else { Ok(String::new()) }
    }

    /// One of several words.
    pub(crate) fn choice<T: Copy>(
        &self,
        key: &'static str,
        choices: &[(&'static str, T)],
    ) -> Result<T, FileError> {
        let word = self.text(key)?;
        choices.iter().find(|choice| choice.0 == word).map(|choice| choice.1).ok_or_else(|| {
            let words: Vec<&str> = choices.iter().map(|choice| choice.0).collect();
            self.error(key, format_args!("is {word:?}, expected one of {}", words.join(", ")))
        })
    }

    /// A flag; false where the key is missing.
    pub(crate) fn flag(&self, key: &'static str) -> Result<bool, FileError> {
        let Some(value) = self.get(key) else { return Ok(false) };
        value.get_ref().as_bool().ok_or_else(|| self.wrong(key, value.get_ref(), "true or false"))
    }

    /// A list of exactly `N` numbers; zeros where the key is missing.
    pub(crate) fn numbers<const N: usize>(&self, key: &'static str) -> Result<[f64; N], FileError> {
        let Some(value) = self.get(key) else { return Ok([0.0; N]) };
        let expected = format!("a list of {N} numbers");
        let list = value.get_ref().as_array().ok_or_else(|| self.wrong(key, value.get_ref(), &expected))?;
        let mut numbers = [0.0; N];
        let mut length = 0;
        for entry in list {
            let number = match entry.get_ref() {
                DeValue::Float(float) => float.as_str().parse::<f64>().ok(),
                DeValue::Integer(integer) => integer.as_str().parse::<f64>().ok(),
                _ => None,
            };
            let number = number.filter(|number| number.is_finite());
            let number = number.ok_or_else(|| self.error(key, format_args!("is not {expected}")))?;
            if length < N {
                numbers[length] = number;
            }
            length += 1;
        }
        if length != N {
            return Err(self.error(key, format_args!("has {length} entries, expected {expected}")));
        }
        Ok(numbers)
    }

    /// A nested table.
    pub(crate) fn table<T>(
        &self,
        key: &'static str,
        read: impl FnOnce(&Section<'_>) -> Result<T, FileError>,
    ) -> Result<T, FileError> {
        self.optional_table(key, read)?.ok_or_else(|| self.missing(key, "a table"))
    }

    /// A nested table that may be missing.
    pub(crate) fn optional_table<T>(
        &self,
        key: &'static str,
        read: impl FnOnce(&Section<'_>) -> Result<T, FileError>,
    ) -> Result<Option<T>, FileError> {
        let Some(value) = self.get(key) else { return Ok(None) };
        self.enter(key, value, read).map(Some)
    }

    /// A list of tables; empty where the key is missing.
    pub(crate) fn tables<T>(
        &self,
        key: &'static str,
        mut read: impl FnMut(&Section<'_>) -> Result<T, FileError>,
    ) -> Result<Vec<T>, FileError> {
        let Some(value) = self.get(key) else { return Ok(Vec::new()) };
        let list =
            value.get_ref().as_array().ok_or_else(|| self.wrong(key, value.get_ref(), "a list of tables"))?;
        list.iter().map(|entry| self.enter(key, entry, &mut read)).collect()
    }

    fn enter<T>(
        &self,
        key: &'static str,
        value: &Spanned<DeValue<'_>>,
        read: impl FnOnce(&Section<'_>) -> Result<T, FileError>,
    ) -> Result<T, FileError> {
        let table = value.get_ref().as_table().ok_or_else(|| self.wrong(key, value.get_ref(), "a table"))?;
        let Range { start, .. } = value.span();
        let path = format!("{}{key}.", self.path);
        let section = Section { text: self.text, path, start, table, asked: RefCell::default() };
        let result = read(&section)?;
        section.finish()?;
        Ok(result)
    }

    /// Refuses keys that were not read.
    fn finish(&self) -> Result<(), FileError> {
        let asked = self.asked.borrow();
        let unknown = self
            .table
            .keys()
            .filter(|key| !asked.contains(&key.get_ref().as_ref()))
            .min_by_key(|key| key.span().start);
        let Some(key) = unknown else { return Ok(()) };
        let mut known: Vec<&str> = asked.clone();
        known.sort_unstable();
        known.dedup();
        let reason =
            format!("{}{} is unknown, expected one of {}", self.path, key.get_ref(), known.join(", "));
        Err(self.error_at(key.span().start, reason))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refusal(text: &str) -> String {
        let read = |file: &Section<'_>| {
            file.number("a", 0.0..=1.0)?;
            file.table("t", |t| t.text("name"))?;
            file.numbers::<2>("pair")
        };
        read_file(text, read).unwrap_err().to_string()
    }

    #[test]
    fn a_refusal_names_the_line_the_key_what_was_found_and_what_was_expected() {
        for (text, expected) in [
            ("\na = 2.0", "line 2: a is 2.0, expected a number from 0 to 1"),
            ("\n\na = nan", "line 3: a is nan, expected a number from 0 to 1"),
            ("a = true", "line 1: a is of type boolean, expected a number from 0 to 1"),
            ("", "line 1: a is missing, expected a number from 0 to 1"),
            ("a = 1", "line 1: t is missing, expected a table"),
            ("a = 1\n[t]", "line 2: t.name is missing, expected a text"),
            ("a = 1\n[t]\nname = ''", "line 3: t.name is empty, expected a text"),
            ("a = 1\n[t]\nname = 'x'\nnmae = 1", "line 4: t.nmae is unknown, expected one of name"),
            (
                "a = 1\npair = [1]\nt = { name = 'x' }",
                "line 2: pair has 1 entries, expected a list of 2 numbers",
            ),
            ("a = 1\nb = 1\nt = { name = 'x' }", "line 2: b is unknown, expected one of a, pair, t"),
        ] {
            assert_eq!(refusal(text), expected, "{text:?}");
        }
        assert!(refusal("a = 1\nb = = 2").starts_with("line 2: "));
    }
}
