//! The operands in the text of a formula: numbers, names of states, texts in quotes, and paths of fields.
//!
//! A path begins with `/`, where an operand is expected; there a `/` cannot be a division. It ends before the first
//! blank, operator or comma outside of brackets. A name with other characters is written in braces: `{/odd name.x}`.

use crate::error::FormulaError;
use rcs_msg::FieldPath;
use std::fmt::{self, Write as _};

/// A field of a topic.
#[derive(Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct FieldRef {
    /// Name of the topic or buffer: `/wm1/status`.
    pub topic: String,
    /// Path of the field.
    pub path: FieldPath,
}

impl fmt::Display for FieldRef {
    /// As a formula contains it.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let text = format!("{}{}", self.topic, self.path);
        let plain = text.starts_with('/') && path_end(&text) == text.len() && !self.topic.contains('.');
        if plain { f.write_str(&text) } else { write!(f, "{{{}}}{}", self.topic, Braced(&self.path)) }
    }
}

/// A path after a name in braces.
struct Braced<'a>(&'a FieldPath);

impl fmt::Display for Braced<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let text = self.0.to_string();
        if path_end(&text) == text.len() { f.write_str(&text) } else { write!(f, "{{{text}}}") }
    }
}

/// An operand of a formula.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Operand {
    Number(f64),
    Name(String),
    Field(FieldRef),
}

/// A text in which each operand is replaced by a variable `v0000`, `v0001`, …, for the parser of operators.
#[derive(Debug, PartialEq)]
pub(crate) struct Operands {
    pub(crate) text: String,
    pub(crate) operands: Vec<Operand>,
}

/// Length of the path at the beginning of a text.
fn path_end(text: &str) -> usize {
    let mut depth = 0_usize;
    let mut quoted = false;
    // In the path of a field a `/` is a division.
    let mut in_topic = true;
    for (at, c) in text.char_indices() {
        match c {
            '"' if depth > 0 => quoted = !quoted,
            _ if quoted => {}
            '/' if !in_topic && depth == 0 => return at,
            '[' => (depth, in_topic) = (depth + 1, false),
            '.' => in_topic = false,
            ']' if depth > 0 => depth -= 1,
            _ if depth > 0 => {}
            _ if c.is_alphanumeric() || "/._@:~".contains(c) => {}
            _ => return at,
        }
    }
    text.len()
}

/// Length of a number at the beginning of a text, with an exponent.
fn number_end(text: &str) -> usize {
    let digits =
        |from: usize| from + text[from..].find(|c: char| !c.is_ascii_digit()).unwrap_or(text.len() - from);
    let mut end = digits(0);
    if text[end..].starts_with('.') {
        end = digits(end + 1);
    }
    if text[end..].starts_with(['e', 'E']) {
        let sign = usize::from(text[end + 1..].starts_with(['+', '-']));
        let after = digits(end + 1 + sign);
        if after > end + 1 + sign {
            end = after;
        }
    }
    end
}

/// The topic and the field of a path: the topic ends at the first dot or bracket after its last `/`.
fn field_ref(text: &str) -> Result<FieldRef, String> {
    let slash = text.find('[').unwrap_or(text.len());
    let slash = text[..slash].rfind('/').unwrap_or(0);
    let split = text[slash..].find(['.', '[']).map_or(text.len(), |at| slash + at);
    let (topic, path) = text.split_at(split);
    if topic.len() < 2 {
        return Err(format!("got {text:?}, expected a topic and a field such as /wm1/status.cycle"));
    }
    let path: FieldPath = path.parse().map_err(|error| format!("{error}"))?;
    Ok(FieldRef { topic: topic.to_owned(), path })
}

/// Whether the parentheses at the beginning of a text hold two values.
fn has_comma(text: &str) -> bool {
    let (mut depth, mut at) = (0_usize, 0);
    while let Some(c) = text[at..].chars().next() {
        match c {
            '(' => depth += 1,
            ')' if depth <= 1 => return false,
            ')' => depth -= 1,
            ',' if depth == 1 => return true,
            '"' | '{' => {
                let close = if c == '"' { '"' } else { '}' };
                at += text[at + 1..].find(close).unwrap_or(0);
            }
            '[' => at += text[at..].find(']').unwrap_or(0),
            _ => {}
        }
        at += text[at..].chars().next().map_or(1, char::len_utf8);
    }
    false
}

/// The calls that are open. A function of two values is written between them, because the parser of operators cannot nest
/// its calls otherwise.
#[derive(Default)]
struct Calls<'a> {
    /// The function of two values whose parenthesis comes next.
    next: Option<&'a str>,
    /// For each open parenthesis the function of two values that awaits its comma, and whether one had it.
    open: Vec<(Option<&'a str>, bool)>,
}

impl Calls<'_> {
    /// Adds an operator, a parenthesis or a comma to the text.
    fn take(&mut self, c: char, text: &mut String) -> Result<(), String> {
        match (c, self.open.last_mut()) {
            ('(', _) => {
                text.push_str(if self.next.is_some() { "((" } else { "(" });
                self.open.push((self.next.take(), false));
            }
            (')', Some((None, two))) => {
                text.push_str(if *two { "))" } else { ")" });
                self.open.pop();
            }
            (')', Some((Some(name), _))) => return Err(format!("{name} lacks its second value")),
            (',', Some((name, two))) => {
                let name = name.take().ok_or("expected at most two values in a function")?;
                *two = true;
                text.push_str(&[") ", name, " ("].concat());
            }
            (',', None) => return Err("got ',' outside of a function".to_owned()),
            (c, _) => text.push(c),
        }
        Ok(())
    }
}

/// The field at the beginning of a text whose topic is in braces, and its length.
fn braced(text: &str) -> Result<(Operand, usize), String> {
    let close = |from: usize| text[from..].find('}').map(|at| from + at).ok_or("expected `}`");
    let end = close(0)?;
    let mut after = end + 1;
    let path = if text[after..].starts_with('{') {
        let close = close(after)?;
        let path = &text[after + 1..close];
        after = close + 1;
        path
    } else {
        let path = &text[after..after + path_end(&text[after..])];
        after += path.len();
        path
    };
    let path = path.parse().map_err(|error| format!("{error}"))?;
    Ok((Operand::Field(FieldRef { topic: text[1..end].to_owned(), path }), after))
}

/// Finds the operands of a formula.
pub(crate) fn operands(text: &str) -> Result<Operands, FormulaError> {
    let mut found = Operands { text: String::new(), operands: Vec::new() };
    let mut at = 0;
    // Whether an operand may begin here.
    let mut open = true;
    let mut calls = Calls::default();
    let fail = |at: usize, problem: String| FormulaError::Syntax {
        column: text[..at].chars().count() + 1,
        problem,
        text: text.to_owned(),
    };
    while let Some(c) = text[at..].chars().next() {
        let rest = &text[at..];
        let operand = match c {
            _ if c.is_whitespace() => {
                found.text.push(' ');
                at += c.len_utf8();
                continue;
            }
            '/' if open => {
                let end = path_end(rest);
                Some((Operand::Field(field_ref(&rest[..end]).map_err(|problem| fail(at, problem))?), end))
            }
            '{' => Some(braced(rest).map_err(|problem| fail(at, problem))?),
            '"' => {
                let end = rest[1..].find('"').ok_or_else(|| fail(at, "expected `\"`".to_owned()))?;
                Some((Operand::Name(rest[1..=end].to_owned()), end + 2))
            }
            '0'..='9' | '.' => {
                let end = number_end(rest);
                let number =
                    rest[..end].parse().map_err(|_| fail(at, format!("got {c:?}, expected a number")))?;
                Some((Operand::Number(number), end))
            }
            _ if c.is_alphabetic() || c == '_' => {
                let end = rest.find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(rest.len());
                let name = &rest[..end];
                if rest[end..].trim_start().starts_with('(') {
                    if !crate::functions::functions().iter().any(|function| function.name == name) {
                        let known: Vec<_> = crate::functions::functions().iter().map(|f| f.name).collect();
                        let problem = format!("got {name:?}, expected one of {}", known.join(", "));
                        return Err(fail(at, problem));
                    }
                    if has_comma(&rest[end..]) {
                        calls.next = Some(name);
                    } else {
                        found.text.push_str(name);
                    }
                    at += end;
                    open = true;
                    continue;
                }
                let operand = match name {
                    "pi" | "π" => Operand::Number(std::f64::consts::PI),
                    _ => Operand::Name(name.to_owned()),
                };
                Some((operand, end))
            }
            _ => None,
        };
        if let Some((operand, length)) = operand {
            if !open {
                return Err(fail(at, "expected an operator between two values".to_owned()));
            }
            let _ = write!(found.text, "v{:04}", found.operands.len());
            found.operands.push(operand);
            at += length;
            open = false;
        } else if "+-*/%^<>=!&|(),".contains(c) {
            calls.take(c, &mut found.text).map_err(|problem| fail(at, problem))?;
            at += c.len_utf8();
            open = c != ')';
        } else {
            return Err(fail(at, format!("got {c:?}, expected a value or an operator")));
        }
    }
    if found.operands.is_empty() {
        return Err(fail(0, "expected a field such as /wm1/status.cycle".to_owned()));
    }
    Ok(found)
}
