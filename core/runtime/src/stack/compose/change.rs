//! `[change.<process>]`: changes the keys of a process from an include.

use super::blocks::{Block, Line};
use super::{Origin, StackError, one_of};
use std::collections::BTreeMap;
use toml::{Table, Value};

/// Applies every `[change.<process>]`, in the order of the files.
pub(super) fn apply(blocks: &mut Vec<Block>) -> Result<(), StackError> {
    let (changes, mut others): (Vec<_>, Vec<_>) = blocks.drain(..).partition(|block| block.is("change"));
    // A change keeps the name of its process.
    let names = if changes.is_empty() { Vec::new() } else { names(&others) };
    for change in changes {
        let wanted: BTreeMap<String, Table> = change.parse("change")?;
        for (name, keys) in wanted {
            let Some(index) = names.iter().position(|known| known.as_deref() == Some(&*name)) else {
                let names = one_of(names.iter().flatten().map(String::as_str));
                return Err(change.error(
                    change.text().find('[').unwrap_or(0),
                    format!("there is no process {name:?} to change; expected {names}"),
                ));
            };
            if keys.contains_key("name") {
                return Err(change.error(0, format!("the name of {name} cannot be changed")));
            }
            let process: Table = others[index].parse("process")?;
            others[index] = rewritten(&others[index], &process, &change, &keys);
        }
    }
    *blocks = others;
    Ok(())
}

fn names(blocks: &[Block]) -> Vec<Option<String>> {
    let name = |block: &Block| -> Option<String> {
        let process: Table = block.is("process").then(|| block.parse("process").ok())??;
        process.get("name")?.as_str().map(str::to_owned)
    };
    blocks.iter().map(name).collect()
}

/// The process with the changed keys, one line each.
fn rewritten(process: &Block, old: &Table, change: &Block, new: &Table) -> Block {
    let mut block = Block { header: process.header.clone(), lines: Vec::new() };
    block.lines.push(Line { text: "[[process]]".to_owned(), origin: process.origin().clone() });
    let mut all = old.clone();
    for (key, value) in new {
        match (all.get_mut(key), value) {
            (Some(Value::Table(old)), Value::Table(new)) => {
                old.extend(new.iter().map(|(key, value)| (key.clone(), value.clone())));
            }
            _ => {
                all.insert(key.clone(), value.clone());
            }
        }
    }
    let origin = |key: &str, changed: bool| place(if changed { change } else { process }, key);
    for (key, value) in all.iter().filter(|(_, value)| !value.is_table()) {
        let origin = origin(key, new.contains_key(key));
        block.lines.push(Line { text: format!("{} = {value}", quoted(key)), origin });
    }
    for (key, value) in &all {
        let Value::Table(table) = value else { continue };
        let changed = new.get(key).and_then(Value::as_table);
        let header = format!("[process.{key}]");
        block.lines.push(Line { text: header, origin: origin(key, changed.is_some()) });
        for (inner, value) in table {
            let origin = origin(inner, changed.is_some_and(|changed| changed.contains_key(inner)));
            block.lines.push(Line { text: format!("{} = {value}", quoted(inner)), origin });
        }
    }
    block.lines.push(Line { text: String::new(), origin: process.origin().clone() });
    block
}

fn quoted(key: &str) -> String {
    let bare = key.chars().all(|c| c.is_ascii_alphanumeric() || c == '_' || c == '-');
    if bare && !key.is_empty() { key.to_owned() } else { Value::from(key).to_string() }
}

/// Origin of a key in a block; that of the header if the key is in an inline table.
fn place(block: &Block, key: &str) -> Origin {
    let gives = |line: &&Line| {
        let text = line.text.trim_start();
        text.strip_prefix(key).is_some_and(|rest| rest.trim_start().starts_with('='))
            || text.split(['{', ',']).any(|part| {
                part.trim_start().strip_prefix(key).is_some_and(|rest| rest.trim_start().starts_with('='))
            })
    };
    block.lines.iter().find(gives).map_or_else(|| block.origin().clone(), |line| line.origin.clone())
}
