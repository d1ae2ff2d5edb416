//! Arguments of a part: declared by the part, given by the file that includes it, substituted in the part's texts.

use super::blocks::{Block, Scanner};
use super::{StackError, one_of};
use serde::Deserialize;
use std::collections::BTreeMap;

/// Values of a part's arguments, by name.
#[derive(Default)]
pub(super) struct Arguments(BTreeMap<String, toml::Value>);

/// The files to name in errors about the arguments of an include.
pub(super) enum Problem {
    /// The part.
    InPart(StackError),
    /// The file that includes it.
    InInclude(String),
}

/// The section of a stack file that declares arguments.
#[derive(Deserialize)]
struct Declarations {
    #[serde(default)]
    arguments: BTreeMap<String, Declaration>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Declaration {
    /// One sentence that says what it is for.
    help: String,
    /// Its value where an include gives none; without one, an include must.
    default: Option<toml::Value>,
}

impl Arguments {
    /// The arguments that a part declares, with the given values or the defaults.
    pub(super) fn of(
        file: &str,
        text: &str,
        mut given: BTreeMap<String, toml::Value>,
    ) -> Result<Self, Problem> {
        let declared: Declarations = toml::from_str(text).map_err(|error| {
            let span = error.span().unwrap_or(0..0);
            Problem::InPart(StackError::at(file, text, &span, error.message().trim().to_owned()))
        })?;
        if let Some(unknown) = given.keys().find(|name| !declared.arguments.contains_key(*name)) {
            let known = known(declared.arguments.keys());
            return Err(Problem::InInclude(format!("{file} has no argument {unknown:?}; {known}")));
        }
        let mut values = BTreeMap::new();
        for (name, declaration) in declared.arguments {
            let Some(value) = given.remove(&name).or(declaration.default) else {
                return Err(Problem::InInclude(format!(
                    "{file} needs the argument {name}; expected with = {{ {name} = … }} ({})",
                    declaration.help
                )));
            };
            values.insert(name, value);
        }
        Ok(Self(values))
    }

    /// Substitutes the values in the texts of a block, except in its comments.
    pub(super) fn fill(&self, block: &mut Block) -> Result<(), StackError> {
        let mut scanner = Scanner::default();
        for line in &mut block.lines {
            let (code, comment) = line.text.split_at(scanner.take(&line.text));
            if !code.contains("${") {
                continue;
            }
            let filled = self.fill_line(code).map_err(|message| StackError {
                file: line.origin.file.clone(),
                line: line.origin.line,
                message,
            })?;
            line.text = filled + comment;
        }
        Ok(())
    }

    fn fill_line(&self, line: &str) -> Result<String, String> {
        let mut filled = String::new();
        let mut rest = line;
        while let Some(start) = rest.find("${") {
            let Some(length) = rest[start..].find('}') else {
                return Err("${ is not closed; expected ${argument}".to_owned());
            };
            let name = &rest[start + 2..start + length];
            let after = &rest[start + length + 1..];
            if name.contains('.') {
                // A value from another file, such as ${vehicle.wheels.track_m}: looked up when parameters are read.
                filled.push_str(&rest[..=start + length]);
                rest = after;
                continue;
            }
            let Some(value) = self.0.get(name) else {
                return Err(format!("there is no argument {name:?}; {}", known(self.0.keys())));
            };
            // A text that is only an argument takes the type of the argument.
            if let (Some(before), Some(after)) = (rest[..start].strip_suffix('"'), after.strip_prefix('"')) {
                filled.push_str(before);
                filled.push_str(&value.to_string());
                rest = after;
                continue;
            }
            filled.push_str(&rest[..start]);
            match value {
                toml::Value::String(text) => filled.push_str(text),
                other => filled.push_str(&other.to_string()),
            }
            rest = after;
        }
        filled.push_str(rest);
        Ok(filled)
    }
}

/// The arguments that a file declares, for error texts.
fn known<'a>(names: impl ExactSizeIterator<Item = &'a String>) -> String {
    if names.len() == 0 {
        return "this file declares no arguments".to_owned();
    }
    format!("expected {}", one_of(names.map(String::as_str)))
}
