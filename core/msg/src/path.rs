//! Field paths: `.pose.position.x`, `.cells[12].cost`, `.data.@length`, `["a name with.dots"]`.

use std::fmt;
use std::str::FromStr;

/// One step of a path.
#[derive(Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Segment {
    /// `.name`: a field of a message, or a key of a map.
    Field(String),
    /// `[12]`: an element of a list or of bytes.
    Index(usize),
    /// `.@length`: the number of elements of a list or of bytes, or of the bytes of a text.
    Length,
}

/// The position of a value within a message. The empty path is the message itself.
#[derive(Clone, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct FieldPath(Vec<Segment>);

/// Why a text is not a path.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("field path, column {column}: got {got}, expected {expected}: {text:?}")]
pub struct PathSyntaxError {
    /// Column of the error, from 1.
    pub column: usize,
    /// The text found.
    pub got: String,
    /// The text expected.
    pub expected: &'static str,
    /// The whole text.
    pub text: String,
}

impl FieldPath {
    /// The message itself.
    pub fn root() -> Self {
        Self::default()
    }

    /// The steps, from the outermost inwards.
    pub fn segments(&self) -> &[Segment] {
        &self.0
    }

    /// This path extended by one step.
    #[must_use]
    pub fn join(&self, segment: Segment) -> Self {
        let mut segments = Vec::with_capacity(self.0.len() + 1);
        segments.extend_from_slice(&self.0);
        segments.push(segment);
        Self(segments)
    }

    /// The path of a field of the value that this path names.
    #[must_use]
    pub fn field(&self, name: impl Into<String>) -> Self {
        self.join(Segment::Field(name.into()))
    }

    /// The path of an element of the value that this path names.
    #[must_use]
    pub fn index(&self, index: usize) -> Self {
        self.join(Segment::Index(index))
    }

    /// The path of the length of the value that this path names.
    #[must_use]
    pub fn length(&self) -> Self {
        self.join(Segment::Length)
    }
}

impl From<Vec<Segment>> for FieldPath {
    fn from(segments: Vec<Segment>) -> Self {
        Self(segments)
    }
}

/// Whether a name may follow a dot without quotes.
fn plain(name: &str) -> bool {
    !name.is_empty() && !name.starts_with('@') && !name.contains(['.', '[', ']', '"'])
}

impl fmt::Display for FieldPath {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for segment in &self.0 {
            match segment {
                Segment::Field(name) if plain(name) => write!(f, ".{name}")?,
                Segment::Field(name) => write!(f, "[{}]", serde_json::Value::from(name.as_str()))?,
                Segment::Index(index) => write!(f, "[{index}]")?,
                Segment::Length => f.write_str(".@length")?,
            }
        }
        Ok(())
    }
}

impl FromStr for FieldPath {
    type Err = PathSyntaxError;

    /// Parses a path; the first dot is optional.
    fn from_str(text: &str) -> Result<Self, PathSyntaxError> {
        let mut segments = Vec::new();
        let mut rest = text.trim_end();
        while !rest.is_empty() {
            let here = rest;
            let fail = |expected| {
                let got = here.chars().next().map_or("the end".to_owned(), |c| format!("`{c}`"));
                let column = text[..text.trim_end().len() - here.len()].chars().count() + 1;
                PathSyntaxError { column, got, expected, text: text.to_owned() }
            };
            let first = segments.is_empty();
            if let Some(inner) = rest.strip_prefix('[') {
                let (segment, after) = bracket(inner).ok_or_else(|| fail("`[index]` or `[\"name\"]`"))?;
                segments.push(segment);
                rest = after;
                continue;
            }
            let name = match rest.strip_prefix('.') {
                Some(name) => name,
                None if first => rest,
                None => return Err(fail("`.` or `[`")),
            };
            let end = name.find(['.', '[']).unwrap_or(name.len());
            let (name, after) = name.split_at(end);
            segments.push(match name {
                "@length" => Segment::Length,
                name if plain(name) => Segment::Field(name.to_owned()),
                _ => return Err(fail("a field name or `@length`")),
            });
            rest = after;
        }
        Ok(Self(segments))
    }
}

/// Parses the text after `[`; also returns the text after the closing bracket.
fn bracket(inner: &str) -> Option<(Segment, &str)> {
    if inner.starts_with('"') {
        let mut names = serde_json::Deserializer::from_str(inner).into_iter::<String>();
        let name = names.next()?.ok()?;
        let after = inner.get(names.byte_offset()..)?.strip_prefix(']')?;
        return Some((Segment::Field(name), after));
    }
    let (digits, after) = inner.split_once(']')?;
    // `usize` alone would also accept a plus sign.
    let index = digits.bytes().all(|b| b.is_ascii_digit()).then(|| digits.parse().ok())??;
    Some((Segment::Index(index), after))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_path_reads_as_it_prints() {
        for text in [
            "",
            ".pose.position.x",
            ".cells[12].cost",
            ".data.@length",
            "[3]",
            ".a[\"b.c \\\"d\\\"\"].e",
            "[\"\"]",
        ] {
            let path: FieldPath = text.parse().expect(text);
            assert_eq!(path.to_string(), text);
        }
        assert_eq!("pose.x".parse::<FieldPath>(), ".pose.x".parse());
    }

    #[test]
    fn what_is_no_path_is_refused_with_its_column() {
        for (text, column) in [
            ("a..b", 2),
            (".a[", 3),
            ("a[x]", 2),
            ("a[+1]", 2),
            ("a[1]b", 5),
            ("a[\"b]", 2),
            (".", 1),
            ("a.@size", 2),
        ] {
            let error = text.parse::<FieldPath>().expect_err(text);
            assert_eq!(error.column, column, "{error}");
        }
    }
}
