//! Reads a TOML file so that every error names its line and key.
//!
//! A [`Table`] returns values by key and records the keys that were requested; [`Table::finish`] refuses the others.

use std::borrow::Cow;
use std::ops::RangeInclusive;

use rcs_geom::DVec2;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// Why a file is refused: line, key, and what was expected.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("line {line}, key \"{key}\": {message}")]
pub struct SceneError {
    /// Line, from 1.
    pub line: usize,
    /// Key with its tables: `thing.radius_m`. Empty if the text is not TOML.
    pub key: String,
    /// What is wrong, with the value found and the value expected.
    pub message: String,
}

/// Greatest absolute value of a coordinate in a file, m.
pub(crate) const COORDINATE_M: RangeInclusive<f64> = -1.0e4..=1.0e4;

struct Entry<'t> {
    key: Cow<'t, str>,
    /// Offset of the key. Its line is counted for an error only, because counting the line of every key takes time
    /// proportional to the square of the size.
    at: usize,
    value: Option<Spanned<DeValue<'t>>>,
}

/// One table of a file.
pub(crate) struct Table<'t> {
    text: &'t str,
    path: String,
    /// Offset of its first byte.
    at: usize,
    entries: Vec<Entry<'t>>,
    asked: Vec<&'static str>,
}

fn line_of(text: &str, at: usize) -> usize {
    1 + text.bytes().take(at).filter(|&byte| byte == b'\n').count()
}

/// The duplicate key, if that is the error: the parser does not name it.
fn duplicate_key<'t>(text: &'t str, error: &toml::de::Error) -> Option<&'t str> {
    (error.message().trim() == "duplicate key").then(|| text.get(error.span()?))?
}

impl<'t> Table<'t> {
    /// The whole file.
    pub(crate) fn open(text: &'t str) -> Result<Table<'t>, SceneError> {
        let table = DeTable::parse(text).map_err(|error| SceneError {
            line: error.span().map_or(1, |span| line_of(text, span.start)),
            key: duplicate_key(text, &error).unwrap_or_default().to_owned(),
            message: error.message().to_owned(),
        })?;
        Ok(Table::of(text, String::new(), 0, table.into_inner()))
    }

    fn of(text: &'t str, path: String, at: usize, table: DeTable<'t>) -> Table<'t> {
        let entry = |(key, value): (Spanned<Cow<'t, str>>, Spanned<DeValue<'t>>)| Entry {
            at: key.span().start,
            key: key.into_inner(),
            value: Some(value),
        };
        Table { text, path, at, entries: table.into_iter().map(entry).collect(), asked: Vec::new() }
    }

    /// An error at a key of this table, or at the table if it has no such key.
    pub(crate) fn error(&self, key: &str, message: impl Into<String>) -> SceneError {
        let at = self.entries.iter().find(|entry| entry.key == key).map_or(self.at, |entry| entry.at);
        let line = line_of(self.text, at);
        let key = if self.path.is_empty() { key.to_owned() } else { format!("{}.{key}", self.path) };
        SceneError { line, key, message: message.into() }
    }

    pub(crate) fn take(&mut self, key: &'static str) -> Option<Spanned<DeValue<'t>>> {
        self.asked.push(key);
        self.entries.iter_mut().find(|entry| entry.key == key)?.value.take()
    }

    fn missing(&self, key: &str, expected: &str) -> SceneError {
        self.error(key, format!("is missing, expected {expected}"))
    }

    /// A number within a range, from the value of a key.
    pub(crate) fn number_in(
        &self,
        key: &str,
        value: &DeValue<'_>,
        range: &RangeInclusive<f64>,
    ) -> Result<f64, SceneError> {
        let expected = format!("a number from {} to {}", range.start(), range.end());
        let number = match value {
            DeValue::Float(float) => float.as_str().parse::<f64>().ok(),
            DeValue::Integer(integer) if integer.radix() == 10 => integer.as_str().parse::<f64>().ok(),
            _ => return Err(self.error(key, format!("got a {}, expected {expected}", value.type_str()))),
        };
        match number {
            Some(number) if range.contains(&number) => Ok(number),
            got => {
                // Not all 300 digits of a great number.
                let shown = |n: f64| if n.abs() < 1e15 { n.to_string() } else { format!("{n:e}") };
                let got = got.map_or_else(|| "no number".to_owned(), shown);
                Err(self.error(key, format!("got {got}, expected {expected}")))
            }
        }
    }

    /// A number, if the key exists.
    pub(crate) fn number(
        &mut self,
        key: &'static str,
        range: RangeInclusive<f64>,
    ) -> Result<Option<f64>, SceneError> {
        self.take(key).map(|value| self.number_in(key, value.get_ref(), &range)).transpose()
    }

    /// A number, or a default if the key does not exist.
    pub(crate) fn number_or(
        &mut self,
        key: &'static str,
        default: f64,
        range: RangeInclusive<f64>,
    ) -> Result<f64, SceneError> {
        Ok(self.number(key, range)?.unwrap_or(default))
    }

    /// A required number.
    pub(crate) fn need_number(
        &mut self,
        key: &'static str,
        range: RangeInclusive<f64>,
    ) -> Result<f64, SceneError> {
        let expected = format!("a number from {} to {}", range.start(), range.end());
        self.number(key, range)?.ok_or_else(|| self.missing(key, &expected))
    }

    /// Refuses a file of another version of its format.
    pub(crate) fn need_format(&mut self, expected: f64) -> Result<(), SceneError> {
        let format = self.need_number("format", 0.0..=1.0e6)?;
        if format == expected {
            return Ok(());
        }
        Err(self.error("format", format!("got {format}, expected {expected}")))
    }

    /// An integer.
    pub(crate) fn integer(
        &mut self,
        key: &'static str,
        range: RangeInclusive<u32>,
    ) -> Result<Option<u32>, SceneError> {
        let bounds = f64::from(*range.start())..=f64::from(*range.end());
        let Some(number) = self.number(key, bounds)? else { return Ok(None) };
        if number.fract() != 0.0 {
            return Err(self.error(key, format!("got {number}, expected a whole number")));
        }
        Ok(Some(number as u32))
    }

    /// True or false.
    pub(crate) fn flag(&mut self, key: &'static str) -> Result<Option<bool>, SceneError> {
        let Some(value) = self.take(key) else { return Ok(None) };
        let flag = value.get_ref().as_bool();
        let got = value.get_ref().type_str();
        flag.map(Some).ok_or_else(|| self.error(key, format!("got a {got}, expected true or false")))
    }

    /// Text.
    pub(crate) fn text(&mut self, key: &'static str) -> Result<Option<String>, SceneError> {
        let Some(value) = self.take(key) else { return Ok(None) };
        let text = value.get_ref().as_str().map(str::to_owned);
        let got = value.get_ref().type_str();
        text.map(Some).ok_or_else(|| self.error(key, format!("got a {got}, expected text")))
    }

    /// A required text.
    pub(crate) fn need_text(&mut self, key: &'static str) -> Result<String, SceneError> {
        self.text(key)?.ok_or_else(|| self.missing(key, "text"))
    }

    /// One of a list of names.
    pub(crate) fn choice<T>(
        &mut self,
        key: &'static str,
        names: &[&str],
        find: impl Fn(&str) -> Option<T>,
    ) -> Result<Option<T>, SceneError> {
        let Some(text) = self.text(key)? else { return Ok(None) };
        let unknown = || self.error(key, format!("got \"{text}\", expected one of {}", names.join(", ")));
        find(&text).map(Some).ok_or_else(unknown)
    }

    /// A required name from a list.
    pub(crate) fn need_choice<T>(
        &mut self,
        key: &'static str,
        names: &[&str],
        find: impl Fn(&str) -> Option<T>,
    ) -> Result<T, SceneError> {
        let expected = format!("one of {}", names.join(", "));
        self.choice(key, names, find)?.ok_or_else(|| self.missing(key, &expected))
    }

    fn numbers_in<const N: usize>(
        &self,
        key: &str,
        value: &DeValue<'_>,
        range: &RangeInclusive<f64>,
    ) -> Result<[f64; N], SceneError> {
        let list = value.as_array().filter(|list| list.len() == N);
        let Some(list) = list else {
            let got = value
                .as_array()
                .map_or(value.type_str().to_owned(), |list| format!("{} entries", list.len()));
            return Err(self.error(key, format!("got {got}, expected a list of {N} numbers")));
        };
        let mut numbers = [0.0; N];
        for (number, value) in numbers.iter_mut().zip(list.iter()) {
            *number = self.number_in(key, value.get_ref(), range)?;
        }
        Ok(numbers)
    }

    /// A list of exactly N numbers.
    pub(crate) fn numbers<const N: usize>(
        &mut self,
        key: &'static str,
        range: RangeInclusive<f64>,
    ) -> Result<Option<[f64; N]>, SceneError> {
        self.take(key).map(|value| self.numbers_in(key, value.get_ref(), &range)).transpose()
    }

    /// A number, or a list of least and greatest value.
    pub(crate) fn span(
        &mut self,
        key: &'static str,
        range: RangeInclusive<f64>,
    ) -> Result<Option<[f64; 2]>, SceneError> {
        let Some(value) = self.take(key) else { return Ok(None) };
        if value.get_ref().as_array().is_none() {
            let number = self.number_in(key, value.get_ref(), &range)?;
            return Ok(Some([number, number]));
        }
        let [least, largest] = self.numbers_in(key, value.get_ref(), &range)?;
        if least > largest {
            let message = format!("got [{least}, {largest}], expected the smaller number first");
            return Err(self.error(key, message));
        }
        Ok(Some([least, largest]))
    }

    /// A position, m.
    pub(crate) fn point(&mut self, key: &'static str) -> Result<Option<DVec2>, SceneError> {
        Ok(self.numbers::<2>(key, COORDINATE_M)?.map(DVec2::from_array))
    }

    /// A required position, m.
    pub(crate) fn need_point(&mut self, key: &'static str) -> Result<DVec2, SceneError> {
        self.point(key)?.ok_or_else(|| self.missing(key, "[x, y] in metres"))
    }

    /// A list of at least `least` positions, m.
    pub(crate) fn points(
        &mut self,
        key: &'static str,
        least: usize,
    ) -> Result<Option<Vec<DVec2>>, SceneError> {
        let expected = format!("expected a list of at least {least} places [x, y] in metres");
        self.list_of_points(key, &expected, |count| count >= least)
    }

    /// Two required positions, m.
    pub(crate) fn need_two_points(&mut self, key: &'static str) -> Result<[DVec2; 2], SceneError> {
        let expected = "expected the two corners [[x, y], [x, y]] in metres";
        let points = self.list_of_points(key, expected, |count| count == 2)?;
        match points.as_deref() {
            Some([first, second]) => Ok([*first, *second]),
            _ => Err(self.error(key, expected)),
        }
    }

    fn list_of_points(
        &mut self,
        key: &'static str,
        expected: &str,
        is_count: impl Fn(usize) -> bool,
    ) -> Result<Option<Vec<DVec2>>, SceneError> {
        let Some(value) = self.take(key) else { return Ok(None) };
        let Some(list) = value.get_ref().as_array().filter(|list| is_count(list.len())) else {
            return Err(self.error(key, expected));
        };
        let point = |value: &Spanned<DeValue<'_>>| {
            self.numbers_in::<2>(key, value.get_ref(), &COORDINATE_M).map(DVec2::from_array)
        };
        list.iter().map(point).collect::<Result<Vec<_>, _>>().map(Some)
    }

    /// A table within this one.
    pub(crate) fn table(&mut self, key: &'static str) -> Result<Option<Table<'t>>, SceneError> {
        let Some(value) = self.take(key) else { return Ok(None) };
        self.child(key, value).map(Some)
    }

    fn child(&self, key: &str, value: Spanned<DeValue<'t>>) -> Result<Table<'t>, SceneError> {
        let at = value.span().start;
        let path = if self.path.is_empty() { key.to_owned() } else { format!("{}.{key}", self.path) };
        match value.into_inner() {
            DeValue::Table(table) => Ok(Table::of(self.text, path, at, table)),
            other => Err(self.error(key, format!("got a {}, expected a table", other.type_str()))),
        }
    }

    /// A list of tables; empty if the key does not exist.
    pub(crate) fn tables(&mut self, key: &'static str) -> Result<Vec<Table<'t>>, SceneError> {
        let Some(value) = self.take(key) else { return Ok(Vec::new()) };
        match value.into_inner() {
            DeValue::Array(list) => list.into_iter().map(|value| self.child(key, value)).collect(),
            other => Err(self.error(key, format!("got a {}, expected a list of tables", other.type_str()))),
        }
    }

    /// Refuses keys that were not requested.
    pub(crate) fn finish(self) -> Result<(), SceneError> {
        match self.entries.iter().find(|entry| entry.value.is_some()) {
            None => Ok(()),
            Some(entry) => {
                let mut known = self.asked.clone();
                known.sort_unstable();
                known.dedup();
                Err(self.error(&entry.key, format!("is unknown, expected one of {}", known.join(", "))))
            }
        }
    }
}
