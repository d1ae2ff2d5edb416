//! The text of a stack file as blocks: the lines between two headers, each line with its origin.

use super::{Origin, StackError};
use serde::de::DeserializeOwned;
use std::collections::BTreeMap;

/// A line of a stack file and its origin.
#[derive(Clone, Debug)]
pub(super) struct Line {
    pub(super) text: String,
    pub(super) origin: Origin,
}

/// A header, the lines that follow it, and the comment directly above it. A block of a process includes the tables of
/// its ports and parameters.
#[derive(Clone, Debug)]
pub(super) struct Block {
    /// The header without white space; empty for the lines before the first header.
    pub(super) header: String,
    /// At least one line, except for an empty first block.
    pub(super) lines: Vec<Line>,
}

impl Block {
    /// Parses the header again, after the texts of the block have been changed.
    pub(super) fn read_header(&mut self) {
        if let Some(header) = self.lines.iter().find_map(|line| header_of(&line.text)) {
            self.header = header;
        }
    }

    /// Whether it is a table, or an element of an array of tables, with this key.
    pub(super) fn is(&self, key: &str) -> bool {
        first_key(&self.header) == key
    }

    /// Whether it is the first block, before any header: name, description, course.
    pub(super) fn is_head(&self) -> bool {
        self.header.is_empty()
    }

    /// Origin of its header.
    pub(super) fn origin(&self) -> &Origin {
        let header = self.lines.iter().find(|line| line.text.trim_start().starts_with('['));
        &header.unwrap_or(&self.lines[0]).origin
    }

    pub(super) fn text(&self) -> String {
        self.lines.iter().flat_map(|line| [line.text.as_str(), "\n"]).collect()
    }

    /// Parses the block as a value at `key`, in an array or not.
    pub(super) fn parse<T: DeserializeOwned>(&self, key: &str) -> Result<T, StackError> {
        let text = self.text();
        let error = |error: &toml::de::Error| {
            self.error(error.span().unwrap_or(0..0).start, error.message().trim().to_owned())
        };
        if self.header.starts_with("[[") {
            let mut table: BTreeMap<String, Vec<T>> = toml::from_str(&text).map_err(|e| error(&e))?;
            let list = table.remove(key).unwrap_or_default();
            return list.into_iter().next().ok_or_else(|| self.error(0, format!("expected [[{key}]]")));
        }
        let mut table: BTreeMap<String, T> = toml::from_str(&text).map_err(|e| error(&e))?;
        table.remove(key).ok_or_else(|| self.error(0, format!("expected [{key}]")))
    }

    /// Origin of the line with a byte of [`Block::text`].
    pub(super) fn origin_at(&self, byte: usize) -> &Origin {
        let text = self.text();
        let line = text.get(..byte).unwrap_or_default().matches('\n').count();
        self.lines.get(line).map_or_else(|| self.origin(), |line| &line.origin)
    }

    /// An error at a byte of [`Block::text`].
    pub(super) fn error(&self, byte: usize, message: impl Into<String>) -> StackError {
        let origin = self.origin_at(byte);
        StackError { file: origin.file.clone(), line: origin.line, message: message.into() }
    }
}

/// `process` for `[[process]]` and for `[process.params]`.
fn first_key(header: &str) -> &str {
    let inner = header.trim_matches(['[', ']']);
    inner.split('.').next().unwrap_or_default().trim_matches('"')
}

/// Splits a text at its headers.
pub(super) fn split(file: &str, text: &str) -> Vec<Block> {
    let mut blocks = vec![Block { header: String::new(), lines: Vec::new() }];
    let mut scanner = Scanner::default();
    for (index, text) in text.lines().enumerate() {
        let at_top = scanner.is_at_top();
        let line = Line { text: text.to_owned(), origin: Origin { file: file.to_owned(), line: index + 1 } };
        let header = at_top.then(|| header_of(text)).flatten();
        if header.is_none() {
            scanner.take(text);
        }
        let Some(header) = header else {
            push(&mut blocks, line);
            continue;
        };
        // [process.inputs] belongs to the [[process]] above it.
        let inside = blocks.last().is_some_and(|last| {
            last.header.starts_with("[[") && header.starts_with(&format!("[{}.", first_key(&last.header)))
        });
        if inside {
            push(&mut blocks, line);
            continue;
        }
        let mut lines = comment_above(&mut blocks);
        lines.push(line);
        blocks.push(Block { header, lines });
    }
    blocks
}

fn push(blocks: &mut [Block], line: Line) {
    if let Some(last) = blocks.last_mut() {
        last.lines.push(line);
    }
}

/// Removes the comment at the end of the last block, which belongs to the next one.
fn comment_above(blocks: &mut [Block]) -> Vec<Line> {
    let Some(last) = blocks.last_mut() else { return Vec::new() };
    let is_comment = |line: &Line| line.text.trim_start().starts_with('#');
    let comment = last.lines.iter().rev().take_while(|line| is_comment(line)).count();
    last.lines.split_off(last.lines.len() - comment)
}

/// The header in a line, without white space; `None` if the line is not a header.
fn header_of(line: &str) -> Option<String> {
    let line = line.trim();
    if !line.starts_with('[') {
        return None;
    }
    let mut quoted = false;
    let end = line.char_indices().find_map(|(at, c)| {
        if c == '"' {
            quoted = !quoted;
        }
        (c == '#' && !quoted).then_some(at)
    });
    let header = line[..end.unwrap_or(line.len())].trim();
    Some(header.chars().filter(|c| !c.is_whitespace()).collect())
}

/// Whether a line begins inside of an array, an inline table or a multi-line text.
#[derive(Default)]
pub(super) struct Scanner {
    depth: usize,
    /// The quotes that end a multi-line text.
    text: Option<&'static str>,
}

impl Scanner {
    fn is_at_top(&self) -> bool {
        self.depth == 0 && self.text.is_none()
    }

    /// Reads the next line; returns the length in bytes of what stands before its comment.
    pub(super) fn take(&mut self, line: &str) -> usize {
        let mut rest = line;
        while !rest.is_empty() {
            if let Some(quotes) = self.text {
                let Some(end) = rest.find(quotes) else { break };
                rest = &rest[end + quotes.len()..];
                self.text = None;
                continue;
            }
            if let Some(quotes) = ["\"\"\"", "'''"].into_iter().find(|quotes| rest.starts_with(quotes)) {
                self.text = Some(quotes);
                rest = &rest[quotes.len()..];
                continue;
            }
            let Some(first) = rest.chars().next() else { break };
            if first == '#' {
                return line.len() - rest.len();
            }
            rest = &rest[first.len_utf8()..];
            match first {
                '[' | '{' => self.depth += 1,
                ']' | '}' => self.depth = self.depth.saturating_sub(1),
                '"' => rest = after_text(rest, '"'),
                '\'' => rest = after_text(rest, '\''),
                _ => {}
            }
        }
        line.len()
    }
}

fn after_text(rest: &str, quote: char) -> &str {
    let mut escaped = false;
    for (at, c) in rest.char_indices() {
        if c == quote && !escaped {
            return &rest[at + c.len_utf8()..];
        }
        escaped = c == '\\' && quote == '"' && !escaped;
    }
    ""
}
