//! Errors in stack files.

use std::fmt;
use std::ops::Range;

/// An error in a stack file: `path:line: what is wrong, and what was expected`.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub struct StackError {
    /// Name of the file, or the argument that is wrong.
    pub file: String,
    /// Line, from 1; 0 where no line is to blame.
    pub line: usize,
    /// What is wrong, and what was expected.
    pub message: String,
}

impl fmt::Display for StackError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { file, line, message } = self;
        match line {
            0 => write!(f, "{file}: {message}"),
            _ => write!(f, "{file}:{line}: {message}"),
        }
    }
}

impl StackError {
    /// An error at a byte range of `text`.
    pub(crate) fn at(file: &str, text: &str, span: &Range<usize>, message: impl Into<String>) -> Self {
        let line = 1 + text.get(..span.start).unwrap_or(text).matches('\n').count();
        let mut message = message.into();
        // The parser does not say which one.
        if message == "duplicate key"
            && let Some(key) = text.get(span.clone()).filter(|key| !key.is_empty())
        {
            message = format!("duplicate key {}", key.trim());
        }
        Self { file: file.to_owned(), line, message }
    }
}

/// `a`, `b` or `c`, for error texts.
pub(crate) fn one_of<'a>(names: impl IntoIterator<Item = &'a str>) -> String {
    let names: Vec<_> = names.into_iter().collect();
    match names.as_slice() {
        [] => "none: there are none".to_owned(),
        [one] => (*one).to_owned(),
        [most @ .., last] => format!("{} or {last}", most.join(", ")),
    }
}
