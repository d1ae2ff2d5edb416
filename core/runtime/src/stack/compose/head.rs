//! The head of a part: its keys before the first header. Some hold for the whole stack, the others for the part alone.

use super::blocks::{Block, Line};
use super::{Origin, StackError, one_of};
use std::collections::BTreeMap;
use toml::{Spanned, Value};

/// The version of the format of stack files.
pub(crate) const FORMAT: u32 = 1;

/// Keys that hold for the whole stack: the including file takes them over unless it has them itself.
const INHERITED: [&str; 3] = ["course", "remembers", "authority_s"];
/// Keys that concern the part alone.
const OWN: [&str; 4] = ["format", "name", "description", "arguments"];
/// Keys of which a part takes only those with a header of their own.
const WITH_HEADER: [&str; 5] = ["input", "process", "buffers", "include", "change"];

/// A key of a part that holds for the whole stack.
pub(super) struct Inherited {
    key: String,
    value: Value,
    origin: Origin,
}

/// The keys of a part's head that hold for the whole stack. An unknown key and another format are refused.
pub(super) fn inherited(head: &Block) -> Result<Vec<Inherited>, StackError> {
    let mut inherited = Vec::new();
    for (key, value) in keys(head)? {
        let start = key.span().start;
        let key = key.into_inner();
        let error = |message: String| head.error(start, message);
        match key.as_str() {
            "format" if value.as_integer() != Some(i64::from(FORMAT)) => {
                return Err(error(format!("format {value} is not known; expected {FORMAT}")));
            }
            known if OWN.contains(&known) => {}
            known if WITH_HEADER.contains(&known) => {
                return Err(error(format!(
                    "{key} is not taken from the head of a part; expected [[{key}]] or [{key}.…]"
                )));
            }
            known if INHERITED.contains(&known) => {
                inherited.push(Inherited { key, value, origin: head.origin_at(start).clone() });
            }
            _ => {
                let names = one_of(OWN.into_iter().chain(INHERITED));
                return Err(error(format!("unknown field `{key}` of a part; expected {names}")));
            }
        }
    }
    Ok(inherited)
}

/// Adds what the parts of a file say for the whole stack to the head of the file, where that does not say it. Two parts
/// that say different things are refused.
pub(super) fn inherit(head: &mut Block, of_parts: Vec<Inherited>) -> Result<(), StackError> {
    if of_parts.is_empty() {
        return Ok(());
    }
    let own = keys(head)?;
    let mut taken: Vec<Inherited> = Vec::new();
    for new in of_parts {
        if own.keys().any(|key| *key.get_ref() == new.key) {
            continue;
        }
        let Some(first) = taken.iter().find(|first| first.key == new.key) else {
            taken.push(new);
            continue;
        };
        if first.value != new.value {
            let Inherited { key, value, origin } = new;
            let message = format!(
                "{key} is {value} here and {} in {}:{}; expected the same, or {key} in the file that includes both parts",
                first.value, first.origin.file, first.origin.line
            );
            return Err(StackError { file: origin.file, line: origin.line, message });
        }
    }
    let is_filled = |line: &Line| !line.text.trim().is_empty();
    let end = head.lines.iter().rposition(is_filled).map_or(0, |last| last + 1);
    let rest = head.lines.split_off(end);
    let line = |new: Inherited| Line { text: format!("{} = {}", new.key, new.value), origin: new.origin };
    head.lines.extend(taken.into_iter().map(line));
    head.lines.extend(rest);
    Ok(())
}

fn keys(head: &Block) -> Result<BTreeMap<Spanned<String>, Value>, StackError> {
    toml::from_str(&head.text())
        .map_err(|error| head.error(error.span().unwrap_or(0..0).start, error.message().trim().to_owned()))
}
