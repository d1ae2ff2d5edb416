//! The parameters of a process: the stack's, the course's, the command line's.

use super::assets::{Asset, Assets, Course, NoAssets};
use super::error::StackError;
use super::file::{ProcessEntry, StackFile};
use crate::process::ProcessType;
use prost_reflect::{DynamicMessage, MessageDescriptor};
use rcs_msg::{AnyMessage, Value, params, rcs};
use std::sync::Arc;

/// What is given beside a stack file when it is checked.
#[derive(Clone, Copy)]
pub struct PlanOptions<'a> {
    /// Parameters that count more than the stack's: `(process.field, value)`.
    pub overrides: &'a [(String, String)],
    /// Course that counts more than the stack's.
    pub course: Option<&'a str>,
    /// Where the files come from that are named.
    pub assets: &'a dyn Assets,
}

/// Makes parameter messages, and remembers the files that went into them.
pub(super) struct ParamReader<'a> {
    pub(super) file: &'a StackFile,
    pub(super) options: PlanOptions<'a>,
    pub(super) course: Option<Course>,
    pub(super) assets: Vec<Asset>,
    /// Whole messages, of a recorded run: nothing else is looked at.
    given: Option<&'a [rcs::InitialParams]>,
}

/// A parameter that is the text of a file: kind of the file, name of the field.
struct FileField {
    kind: String,
    field: String,
}

impl<'a> ParamReader<'a> {
    pub(super) fn new(file: &'a StackFile, options: PlanOptions<'a>) -> Result<Self, StackError> {
        let course = Course::read(file, options.course, options.assets)?;
        Ok(Self { file, options, course, assets: Vec::new(), given: None })
    }

    /// The parameters of a recorded run, as they were.
    pub(super) fn given(file: &'a StackFile, given: &'a [rcs::InitialParams]) -> Self {
        let options = PlanOptions { overrides: &[], course: None, assets: &NoAssets };
        Self { file, options, course: None, assets: Vec::new(), given: Some(given) }
    }

    pub(super) fn read(
        &mut self,
        name: &str,
        entry: &ProcessEntry,
        kind: &ProcessType,
    ) -> Result<AnyMessage, StackError> {
        let schema = kind.params_schema();
        let Some(descriptor) = schema.descriptor() else {
            return Err(self
                .file
                .error(&entry.plugin.span(), format!("{} has no descriptor", schema.name())));
        };
        if let Some(given) = self.given {
            let given = given.iter().find(|given| given.process == name && given.schema == schema.name());
            let message = given.map(|given| AnyMessage::encoded(Arc::clone(schema), given.params.clone()));
            let error = |text: String| self.file.error(&entry.name.span(), text);
            let message = message
                .ok_or_else(|| error(format!("the recording holds no {} of {name}", schema.name())))?;
            kind.check(&message).map_err(|text| error(format!("recorded parameters of {name}: {text}")))?;
            return Ok(message);
        }
        let files = file_fields(descriptor);
        let mut values = params::defaults(descriptor);
        for (field, value) in &entry.params {
            let error = |error: String| {
                self.file.error(&value.span(), format!("parameter {name}.{}: {error}", field.get_ref()))
            };
            let mut new = to_value(value.get_ref()).ok_or_else(|| {
                error("expected a number, a text, true or false, or a list of these".to_owned())
            })?;
            if let (Some(file), Value::Text(named)) = (find(&files, field.get_ref()), &new) {
                let asset = self.options.assets.read(&file.kind, named, &self.file.file).map_err(error)?;
                new = Value::Text(asset.text.clone());
                self.assets.push(asset);
            }
            params::set_param(&mut values, field.get_ref(), &new).map_err(|e| error(e.to_string()))?;
        }
        self.take_course(&files, &mut values)?;
        for (path, text) in self.options.overrides {
            let Some(field) = path.strip_prefix(name).and_then(|rest| rest.strip_prefix('.')) else {
                continue;
            };
            let error = |error: String| StackError {
                file: "--param".to_owned(),
                line: 1,
                message: format!("{path}: {error}"),
            };
            let mut text = text.clone();
            if let Some(file) = find(&files, field) {
                let asset = self.options.assets.read(&file.kind, &text, "").map_err(error)?;
                text.clone_from(&asset.text);
                self.assets.push(asset);
            }
            params::set_param_text(&mut values, field, &text).map_err(|e| error(e.to_string()))?;
        }
        let message = AnyMessage::encoded(Arc::clone(schema), prost::Message::encode_to_vec(&values).into());
        kind.check(&message).map_err(|error| self.blame(entry, &files, &values, error))?;
        Ok(message)
    }

    /// Sets what comes with the course: the course itself, and the files that it names.
    fn take_course(&mut self, files: &[FileField], values: &mut DynamicMessage) -> Result<(), StackError> {
        let Some(course) = &self.course else { return Ok(()) };
        for file in files {
            let Some(asset) = course.asset(&file.kind, self.options.assets)? else { continue };
            let text = Value::Text(asset.text.clone());
            params::set_param(values, &file.field, &text).map_err(|error| StackError {
                file: asset.file.clone(),
                line: 1,
                message: error.to_string(),
            })?;
            self.assets.push(asset);
        }
        Ok(())
    }

    /// Where a process found something wrong: `field: line N, …` is said of the file that the field holds.
    fn blame(
        &self,
        entry: &ProcessEntry,
        files: &[FileField],
        values: &DynamicMessage,
        error: String,
    ) -> StackError {
        let said = |error: &str| {
            let (field, rest) = error.split_once(": line ")?;
            let digits = rest.find(|c: char| !c.is_ascii_digit())?;
            let line = rest[..digits].parse().ok()?;
            let file = find(files, field)?;
            let text = values.get_field_by_name(&file.field)?;
            let asset = self.assets.iter().find(|asset| Some(asset.text.as_str()) == text.as_str())?;
            let message = rest[digits..].trim_start_matches([',', ':', ' ']).to_owned();
            Some(StackError { file: asset.file.clone(), line, message })
        };
        said(&error).unwrap_or_else(|| self.file.error(&entry.name.span(), error))
    }
}

fn file_fields(descriptor: &MessageDescriptor) -> Vec<FileField> {
    let specs = params::specs(descriptor).into_iter();
    specs.filter_map(|spec| Some(FileField { kind: spec.file?, field: spec.name })).collect()
}

fn find<'f>(files: &'f [FileField], field: &str) -> Option<&'f FileField> {
    files.iter().find(|file| file.field == field)
}

fn to_value(value: &toml::Value) -> Option<Value> {
    Some(match value {
        toml::Value::String(text) => Value::Text(text.clone()),
        toml::Value::Integer(number) => Value::Int(*number),
        toml::Value::Float(number) => Value::Float(*number),
        toml::Value::Boolean(on) => Value::Bool(*on),
        toml::Value::Array(list) => Value::List(list.iter().map(to_value).collect::<Option<_>>()?),
        toml::Value::Datetime(_) | toml::Value::Table(_) => return None,
    })
}
