//! Parameters of a process: from the stack, the course and the command line.

use super::assets::{Asset, Assets};
use super::course::Course;
use super::error::{StackError, one_of};
use super::file::{ParamEntry, ProcessEntry, StackFile};
use crate::files::FileTable;
use crate::process::ProcessType;
use prost_reflect::{DynamicMessage, MessageDescriptor, ReflectMessage};
use rcs_msg::params::{self, ParamKind, ParamSpec};
use rcs_msg::{AnyMessage, FieldPath, Value, rcs};
use std::collections::BTreeSet;
use std::sync::Arc;
use toml::Spanned;

/// Options for checking a stack file.
#[derive(Clone, Copy)]
pub struct PlanOptions<'a> {
    /// Parameters that override those of the stack: `(process.field, value)`.
    pub overrides: &'a [(String, String)],
    /// Course that overrides the stack's.
    pub course: Option<&'a str>,
    /// Source of the files that are named.
    pub assets: &'a dyn Assets,
}

/// Creates parameter messages, and collects the files that they name.
pub(super) struct ParamReader<'a> {
    pub(super) file: &'a StackFile,
    pub(super) options: PlanOptions<'a>,
    pub(super) course: Option<Course>,
    pub(super) files: FileTable,
    /// Whether a parameter has a file or a value of the course.
    uses_course: bool,
    /// Files of the stack that those of the course replace, with the line that names them, and a course without use.
    pub(super) warnings: Vec<String>,
    /// Complete messages of a recorded run; if present, nothing else is used.
    given: Option<&'a [rcs::InitialParams]>,
}

/// A parameter that names a file: kind of the file, path of the field.
struct FileField {
    kind: String,
    field: String,
}

impl<'a> ParamReader<'a> {
    pub(super) fn new(file: &'a StackFile, options: PlanOptions<'a>) -> Result<Self, StackError> {
        let course = Course::read(file, options.course, options.assets)?;
        let (files, warnings) = (FileTable::default(), Vec::new());
        Ok(Self { file, options, course, files, uses_course: false, warnings, given: None })
    }

    /// The parameters of a recorded run.
    pub(super) fn given(file: &'a StackFile, run: &'a rcs::RunInfo, options: PlanOptions<'a>) -> Self {
        let files = FileTable::of_run(run);
        let (warnings, given) = (Vec::new(), Some(run.params.as_slice()));
        Self { file, options, course: None, files, uses_course: false, warnings, given }
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
            kind.check(&message, &self.files)
                .map_err(|text| error(format!("recorded parameters of {name}: {text}")))?;
            return self.with_overrides(name, message, descriptor);
        }
        let files = file_fields(&params::specs(descriptor), "");
        let mut values = params::defaults(descriptor);
        for (field, value) in &entry.params {
            let path = FieldPath::root().field(field.get_ref().as_str());
            self.put(name, &mut values, &path, value)?;
        }
        self.take_course(entry, &files, &mut values)?;
        for (path, text) in self.options.overrides {
            let Some(field) = path.strip_prefix(name).and_then(|rest| rest.strip_prefix('.')) else {
                continue;
            };
            let error = |error: String| of_override(path, field, &error);
            let spec = params::find(descriptor, field).map_err(|e| error(e.to_string()))?;
            let mut text = text.clone();
            if let (ParamKind::Text, Some(kind)) = (spec.kind, &spec.file) {
                let asset = self.options.assets.read(kind, &text, "").map_err(error)?;
                text = self.take_file(kind, &asset);
            }
            params::set_param_text(&mut values, field, &text).map_err(|e| error(e.to_string()))?;
        }
        let message = AnyMessage::encoded(Arc::clone(schema), prost::Message::encode_to_vec(&values).into());
        kind.check(&message, &self.files).map_err(|error| self.blame(entry, &files, &values, error))?;
        Ok(message)
    }

    /// Sets a parameter entry by entry, so that an error is reported at its own line.
    fn put(
        &mut self,
        process: &str,
        values: &mut DynamicMessage,
        path: &FieldPath,
        entry: &Spanned<ParamEntry>,
    ) -> Result<(), StackError> {
        let file = self.file;
        let at = |error: String| file.error(&entry.span(), format!("parameter {process}{path}: {error}"));
        let name = path.to_string();
        let name = name.trim_start_matches('.');
        let spec = params::find(&values.descriptor(), name).map_err(|error| at(error.to_string()))?;
        let value = match (entry.get_ref(), spec.kind) {
            (ParamEntry::Table(fields), ParamKind::Group) => {
                for (field, value) in fields {
                    self.put(process, values, &path.field(field.get_ref().as_str()), value)?;
                }
                return Ok(());
            }
            (ParamEntry::List(items), ParamKind::List) => match plain(items) {
                Some(list) if !items.is_empty() => list,
                _ => {
                    // Creates the elements with their defaults, then sets the given fields of each.
                    let elements = Value::List(vec![Value::Message(Vec::new()); items.len()]);
                    params::set_param(values, name, &elements).map_err(|error| at(error.to_string()))?;
                    for (index, item) in items.iter().enumerate() {
                        self.put(process, values, &path.index(index), item)?;
                    }
                    return Ok(());
                }
            },
            (ParamEntry::Plain(Value::Text(text)), _) if is_reference(text) => {
                self.referenced(text).map_err(at)?
            }
            (ParamEntry::Plain(Value::Text(named)), ParamKind::Text) if spec.file.is_some() => {
                let kind = spec.file.as_deref().unwrap_or_default();
                let asset = self.options.assets.read(kind, named, &self.file.file).map_err(at)?;
                Value::Text(self.take_file(kind, &asset))
            }
            (ParamEntry::Plain(value), _) => value.clone(),
            // The error says what is expected instead.
            (ParamEntry::List(_), _) => Value::List(Vec::new()),
            (ParamEntry::Table(_), _) => Value::Message(Vec::new()),
        };
        params::set_param(values, name, &value).map_err(|error| at(error.to_string()))
    }

    /// Recorded parameters, overlaid with those of the command line.
    fn with_overrides(
        &mut self,
        name: &str,
        message: AnyMessage,
        descriptor: &MessageDescriptor,
    ) -> Result<AnyMessage, StackError> {
        let mut message = message;
        for (path, text) in self.options.overrides {
            let Some(field) = path.strip_prefix(name).and_then(|rest| rest.strip_prefix('.')) else {
                continue;
            };
            let error = |error: String| of_override(path, field, &error);
            let spec = params::find(descriptor, field).map_err(|refused| error(refused.to_string()))?;
            let text = match (spec.kind, &spec.file) {
                (ParamKind::Text, Some(kind)) => {
                    let asset = self.options.assets.read(kind, text, "").map_err(error)?;
                    self.take_file(kind, &asset)
                }
                _ => text.clone(),
            };
            let changed = params::with_params(&message, [(field, text.as_str())]);
            message = changed.map_err(|refused| error(refused.to_string()))?;
        }
        Ok(message)
    }

    /// The value that `${vehicle.wheels.track_m}` names: a key in a file of the course.
    fn referenced(&mut self, text: &str) -> Result<Value, String> {
        let path = text.trim_start_matches("${").trim_end_matches('}');
        let (kind, key) = path.split_once('.').unwrap_or((path, ""));
        let Some(course) = &self.course else {
            return Err(format!("{text} is a value of a course's {kind}; expected a stack with a course"));
        };
        let asset = course.asset(kind, self.options.assets).map_err(|error| error.to_string())?;
        let asset = asset.ok_or_else(|| format!("the course has no {kind}, which {text} is of"))?;
        self.uses_course = true;
        let table: toml::Table =
            toml::from_str(&asset.text).map_err(|error| format!("{}: {}", asset.file, error.message()))?;
        let mut value = &toml::Value::Table(table);
        for part in key.split('.') {
            let next = value.as_table().and_then(|table| table.get(part));
            value = next.ok_or_else(|| {
                let names = value.as_table().into_iter().flat_map(|table| table.keys());
                format!(
                    "{} has no {key}: there is no {part:?}; expected {}",
                    asset.file,
                    one_of(names.map(String::as_str))
                )
            })?;
        }
        let value = match value {
            toml::Value::String(text) => Value::Text(text.clone()),
            toml::Value::Integer(number) => Value::Int(*number),
            toml::Value::Float(number) => Value::Float(*number),
            toml::Value::Boolean(on) => Value::Bool(*on),
            other => {
                return Err(format!(
                    "{key} of {} is {}; expected a number, a text, true or false",
                    asset.file,
                    other.type_str()
                ));
            }
        };
        Ok(value)
    }

    /// Sets the parameters that come with the course: the course itself, and the files that it names.
    fn take_course(
        &mut self,
        entry: &ProcessEntry,
        files: &[FileField],
        values: &mut DynamicMessage,
    ) -> Result<(), StackError> {
        for file in files {
            let Some(course) = &self.course else { return Ok(()) };
            let Some(asset) = course.asset(&file.kind, self.options.assets)? else { continue };
            self.uses_course = true;
            let name = self.take_file(&file.kind, &asset);
            if text_at(values, &file.field).is_some_and(|own| !own.is_empty() && own != name) {
                self.warn_of_replaced(entry, file, &asset);
            }
            params::set_param(values, &file.field, &Value::Text(name)).map_err(|error| StackError {
                file: asset.file.clone(),
                line: 1,
                message: error.to_string(),
            })?;
        }
        Ok(())
    }

    /// Reads the files that the course names and no process of this stack takes, so that one that is missing is refused
    /// on every stack, and the source of the files knows all that are in use.
    pub(super) fn read_rest_of_course(&self, plugins: &[ProcessType]) -> Result<(), StackError> {
        let Some(course) = &self.course else { return Ok(()) };
        let descriptors = plugins.iter().filter_map(|kind| kind.params_schema().descriptor());
        let files = descriptors.flat_map(|descriptor| file_fields(&params::specs(descriptor), ""));
        let kinds: BTreeSet<String> = files.map(|file| file.kind).collect();
        kinds.iter().try_for_each(|kind| course.asset(kind, self.options.assets).map(|_| ()))
    }

    /// Warns of a course in the options of which no process takes anything.
    pub(super) fn warn_of_unused_course(&mut self) {
        let Some(course) = self.options.course.filter(|_| !self.uses_course) else { return };
        let stack = self.file.name();
        self.warnings.push(format!(
            "the stack {stack} uses nothing of the course {course}; expected a stack that uses it, or no course"
        ));
    }

    /// Warns of a file of the stack in whose place that of the course counts, unless the command line gives a third one.
    fn warn_of_replaced(&mut self, entry: &ProcessEntry, field: &FileField, of_course: &Asset) {
        let path = format!("{}.{}", entry.name.get_ref(), field.field);
        if self.options.overrides.iter().any(|(overridden, _)| *overridden == path) {
            return;
        }
        let key = field.field.split('.').next().unwrap_or_default();
        let span = entry.params.keys().find(|given| given.get_ref() == key).unwrap_or(&entry.name).span();
        let warning = format!(
            "the file of {path} does not count: the course brings {}; expected it in the course, or as --param {path}=…",
            of_course.file
        );
        self.warnings.push(self.file.error(&span, warning).to_string());
    }

    /// Adds a file to the run's; returns the name by which parameters refer to it.
    fn take_file(&mut self, kind: &str, asset: &Asset) -> String {
        self.files.insert(kind, &asset.file, &asset.text)
    }

    /// Origin of an error that a process reports: `field: …` refers to the file that the field names, and
    /// `field: line N, …` to a line of it.
    fn blame(
        &self,
        entry: &ProcessEntry,
        files: &[FileField],
        values: &DynamicMessage,
        error: String,
    ) -> StackError {
        let said = |error: &str| {
            let (field, rest) = error.split_once(": ")?;
            let field = find(files, field)?;
            let text = text_at(values, &field.field)?;
            if text.is_empty() {
                return self.blame_course(entry, field, rest);
            }
            let file = self.files.get(&text)?.file.clone();
            let (line, message) = line_and_rest(rest);
            Some(StackError { file, line, message: message.to_owned() })
        };
        said(&error).unwrap_or_else(|| self.file.error(&entry.name.span(), error))
    }

    /// Origin of an error of a parameter that has no text: the empty file that the course names, or the course, which
    /// names none; `None` if the text was not to come from a course.
    fn blame_course(&self, entry: &ProcessEntry, field: &FileField, error: &str) -> Option<StackError> {
        let path = format!("{}.{}", entry.name.get_ref(), field.field);
        let is_given = entry.params.keys().any(|key| *key.get_ref() == field.field)
            || self.options.overrides.iter().any(|(given, _)| *given == path);
        let course = self.course.as_ref().filter(|_| !is_given)?;
        let own = course.asset(&field.kind, self.options.assets).ok()?;
        let Some(empty) = own else {
            let kind = &field.kind;
            let message =
                format!("key \"{kind}\" is missing, expected the name of a {kind} or the path of its file");
            return Some(StackError { file: course.file().to_owned(), line: 0, message });
        };
        Some(StackError { file: empty.file, line: 1, message: error.to_owned() })
    }
}

/// An error in a parameter of the command line. That of a value names its field, as the path does.
fn of_override(path: &str, field: &str, error: &str) -> StackError {
    let error = error.strip_prefix(&format!("parameter {field}: ")).unwrap_or(error);
    StackError { file: "--param".to_owned(), line: 0, message: format!("{path}: {error}") }
}

/// Whether a text names a value in another file: `${vehicle.wheels.track_m}`.
fn is_reference(text: &str) -> bool {
    text.starts_with("${") && text.ends_with('}')
}

/// The line that an error names, `line N, …`, and what follows; line 1 if it names none.
fn line_and_rest(error: &str) -> (usize, &str) {
    let named = || {
        let rest = error.strip_prefix("line ")?;
        let digits = rest.find(|c: char| !c.is_ascii_digit())?;
        let line: usize = rest[..digits].parse().ok()?;
        Some((line, rest[digits..].trim_start_matches([',', ':', ' '])))
    };
    named().unwrap_or((1, error))
}

/// Files outside of lists, by the path of their field.
fn file_fields(specs: &[ParamSpec], within: &str) -> Vec<FileField> {
    let mut files = Vec::new();
    for spec in specs {
        let field = format!("{within}{}", spec.name);
        match (spec.kind, &spec.file) {
            (ParamKind::Group, _) => files.extend(file_fields(&spec.fields, &format!("{field}."))),
            (ParamKind::Text, Some(kind)) => files.push(FileField { kind: kind.clone(), field }),
            _ => {}
        }
    }
    files
}

fn find<'f>(files: &'f [FileField], field: &str) -> Option<&'f FileField> {
    files.iter().find(|file| file.field == field)
}

/// The text of the field at a path.
fn text_at(message: &DynamicMessage, path: &str) -> Option<String> {
    let (name, rest) = path.split_once('.').map_or((path, None), |(name, rest)| (name, Some(rest)));
    let value = message.get_field_by_name(name)?;
    match rest {
        None => value.as_str().map(str::to_owned),
        Some(rest) => text_at(value.as_message()?, rest),
    }
}

/// A list of plain values.
fn plain(items: &[Spanned<ParamEntry>]) -> Option<Value> {
    let item = |item: &Spanned<ParamEntry>| match item.get_ref() {
        ParamEntry::Plain(value) => Some(value.clone()),
        _ => None,
    };
    items.iter().map(item).collect::<Option<_>>().map(Value::List)
}
