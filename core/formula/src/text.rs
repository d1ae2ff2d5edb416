//! The operands in the text of a formula: numbers, names of states, texts in quotes, and paths of fields.
//!
//! A path begins with `/`, where an operand is expected; there a `/` cannot be a division. It ends before the first
//! blank, operator or comma outside of brackets. A name with other characters is written in braces: `{/odd name.x}`.

use crate::error::FormulaError;
use crate::eval::{Data, Operators};
use crate::functions::{Function, functions};
use exmex::{MakeOperators as _, Operator};
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

/// An open parenthesis.
struct Open<'a> {
    /// Its place in the text.
    at: usize,
    /// The function of two values that awaits its comma.
    awaits: Option<&'a str>,
    /// Whether it had a comma.
    two: bool,
}

/// The calls that are open. A function of two values is written between them, because the parser of operators cannot nest
/// its calls otherwise.
#[derive(Default)]
struct Calls<'a> {
    /// The function of two values whose parenthesis comes next.
    next: Option<&'a str>,
    open: Vec<Open<'a>>,
}

impl Calls<'_> {
    /// Adds the parenthesis or the comma at this place to the text.
    fn take(&mut self, c: char, at: usize, text: &mut String) -> Result<(), String> {
        match (c, self.open.last_mut()) {
            ('(', _) => {
                text.push_str(if self.next.is_some() { "((" } else { "(" });
                self.open.push(Open { at, awaits: self.next.take(), two: false });
            }
            (_, None) => {
                let place = if c == ',' { "outside of a function" } else { "without '(' before it" };
                return Err(format!("got {c:?} {place}"));
            }
            (',', Some(open)) => {
                let name = open.awaits.take().ok_or("expected at most two values in a function")?;
                open.two = true;
                text.push_str(&[") ", name, " ("].concat());
            }
            (_, Some(Open { awaits: Some(name), .. })) => {
                return Err(format!("{name} lacks its second value"));
            }
            (_, Some(open)) => {
                text.push_str(if open.two { "))" } else { ")" });
                self.open.pop();
            }
        }
        Ok(())
    }
}

/// The operator at the beginning of a text: one before a value where a value may begin (`open`), else one between two.
fn operator(text: &str, open: bool) -> Result<&'static str, String> {
    let operators = Operators::make();
    let found = operators.iter().filter(|operator| text.starts_with(operator.repr()));
    let found = found.max_by_key(|operator| operator.repr().len());
    let expected = if open { "a value" } else { "an operator" };
    let fits = |operator: &&Operator<'static, Data>| {
        if open { operator.has_unary() } else { operator.has_bin() }
    };
    found.filter(fits).map(Operator::repr).ok_or_else(|| {
        let got: String = found.map_or_else(|| text.chars().take(1).collect(), |got| got.repr().to_owned());
        format!("got {got:?}, expected {expected}")
    })
}

/// Refuses a function that has one value where it needs two, or two values (`two`) where it has one; the error says how it
/// is called.
fn check_values(function: &Function, two: bool) -> Result<(), String> {
    let operators = Operators::make();
    let fits = |operator: &Operator<'static, Data>| {
        operator.repr() == function.name && if two { operator.has_bin() } else { operator.has_unary() }
    };
    if operators.iter().any(fits) { Ok(()) } else { Err(format!("expected {}", function.call)) }
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

/// What is said of two values side by side.
const BETWEEN: &str = "expected an operator between two values";

/// Finds the operands of a formula, and refuses values, operators and parentheses that are not where they can be.
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
                if open && rest[end..].trim_start().starts_with('(') {
                    let Some(function) = functions().iter().find(|function| function.name == name) else {
                        let known: Vec<_> = functions().iter().map(|function| function.name).collect();
                        let problem = format!("got {name:?}, expected one of {}", known.join(", "));
                        return Err(fail(at, problem));
                    };
                    let two = has_comma(&rest[end..]);
                    check_values(function, two).map_err(|problem| fail(at, problem))?;
                    if two {
                        calls.next = Some(name);
                    } else {
                        found.text.push_str(name);
                    }
                    at += end;
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
                return Err(fail(at, BETWEEN.to_owned()));
            }
            let _ = write!(found.text, "v{:04}", found.operands.len());
            found.operands.push(operand);
            at += length;
            open = false;
        } else if "(),".contains(c) {
            if (c == '(') != open {
                let problem = if open { format!("got {c:?}, expected a value") } else { BETWEEN.to_owned() };
                return Err(fail(at, problem));
            }
            calls.take(c, at, &mut found.text).map_err(|problem| fail(at, problem))?;
            at += c.len_utf8();
            open = c != ')';
        } else if "+-*/%^<>=!&|".contains(c) {
            let operator = operator(rest, open).map_err(|problem| fail(at, problem))?;
            found.text.push_str(operator);
            at += operator.len();
            open = true;
        } else {
            return Err(fail(at, format!("got {c:?}, expected a value or an operator")));
        }
    }
    if found.operands.is_empty() {
        return Err(fail(0, "expected a field such as /wm1/status.cycle".to_owned()));
    }
    if open {
        return Err(fail(text.trim_end().len(), "expected a value".to_owned()));
    }
    if let Some(unclosed) = calls.open.last() {
        return Err(fail(unclosed.at, "'(' without ')' after it".to_owned()));
    }
    Ok(found)
}
