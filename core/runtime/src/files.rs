//! Files that parameters name: worlds, vehicles, courses, models.
//!
//! A parameter with the option `file` holds the name of a text, `blake3:` and the hash of its content. The texts are in
//! the run's identity ([`rcs::RunInfo::files`]), each once, and a process receives its parameters with the texts in
//! place. A parameter may also hold the text itself, which is then used as it is.

use rcs_msg::params::visit_file_texts;
use rcs_msg::{AnyMessage, params, rcs};
use std::collections::BTreeMap;
use std::sync::Arc;

/// What the name of a text by its content begins with.
const BY_CONTENT: &str = "blake3:";

/// The files of a run by the hash of their content. A clone shares them.
#[derive(Clone, Debug, Default)]
pub struct FileTable(Arc<BTreeMap<String, NamedFile>>);

/// A file that a parameter names.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NamedFile {
    /// `world`, `vehicle`, `course`, `models`.
    pub kind: String,
    /// Name of the file, for errors and display; empty in a recorded run, because where a person keeps a file must not
    /// be part of a run's hash.
    pub file: String,
    /// The whole text.
    pub text: String,
}

impl FileTable {
    /// The files in the identity of a recorded run. Their hashes are computed from their texts, so that no parameter
    /// names a text that was changed.
    pub fn of_run(run: &rcs::RunInfo) -> Self {
        let named = |file: &rcs::RunFile| {
            let (kind, text) = (file.kind.clone(), file.text.clone());
            (name_by_content(&text), NamedFile { kind, file: String::new(), text })
        };
        Self(Arc::new(run.files.iter().map(named).collect()))
    }

    /// Adds a file, and returns the name by which parameters refer to it; the empty text has the empty name.
    pub fn insert(&mut self, kind: &str, file: &str, text: &str) -> String {
        if text.is_empty() {
            return String::new();
        }
        let name = name_by_content(text);
        if !self.0.contains_key(&name) {
            let entry = NamedFile { kind: kind.to_owned(), file: file.to_owned(), text: text.to_owned() };
            Arc::make_mut(&mut self.0).insert(name.clone(), entry);
        }
        name
    }

    /// The file that a parameter names; `None` if the parameter is not the name of a file in this table.
    pub fn get(&self, name: &str) -> Option<&NamedFile> {
        self.0.get(name)
    }

    /// All files, ordered by their hashes, in the form of a run's identity.
    pub(crate) fn to_proto(&self) -> Vec<rcs::RunFile> {
        let file = |file: &NamedFile| rcs::RunFile { kind: file.kind.clone(), text: file.text.clone() };
        self.0.values().map(file).collect()
    }

    /// A parameter message with the texts in place of their names, for the process that reads it. An error names the
    /// parameter whose file is missing.
    pub fn resolve(&self, message: &AnyMessage) -> Result<AnyMessage, String> {
        let schema = message.schema();
        let Some(descriptor) = schema.descriptor().filter(|descriptor| params::has_files(descriptor)) else {
            return Ok(message.clone());
        };
        let mut values = prost_reflect::DynamicMessage::decode(descriptor.clone(), message.bytes())
            .map_err(|error| format!("{}: {error}", schema.name()))?;
        visit_file_texts(&mut values, &mut |parameter, text| {
            if text.starts_with(BY_CONTENT) {
                let file = self.0.get(text.as_str());
                let file = file.ok_or_else(|| format!("{parameter}: the run has no file {text}"))?;
                text.clone_from(&file.text);
            }
            Ok::<(), String>(())
        })?;
        Ok(AnyMessage::encoded(Arc::clone(&schema), prost::Message::encode_to_vec(&values).into()))
    }
}

fn name_by_content(text: &str) -> String {
    format!("{BY_CONTENT}{}", blake3::hash(text.as_bytes()).to_hex())
}
