//! The content of a stack file; values keep their position in the text.

use super::assets::{Assets, NoAssets};
use super::compose::{FORMAT, Origin, compose};
use super::error::StackError;
use rcs_msg::Value;
use serde::de::{MapAccess, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer};
use std::collections::BTreeMap;
use std::fmt;
use std::ops::Range;
use toml::Spanned;

/// The supervisor that is built into the window: it sends `RUN` at the start, and the operator's commands.
pub const VIEWER: &str = "viewer";

/// A stack file that has been parsed but not yet checked against the plugins.
#[derive(Clone, Debug)]
pub struct StackFile {
    /// Name of the file.
    pub file: String,
    /// The complete text, with all includes inserted.
    pub text: String,
    pub(crate) content: Content,
    origins: Vec<Origin>,
    /// Offset of each line of the text.
    lines: Vec<usize>,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Content {
    /// Version of the format: 1.
    pub(crate) format: Spanned<u32>,
    /// Name of the stack.
    pub(crate) name: Spanned<String>,
    /// What it is for.
    #[serde(default)]
    pub(crate) description: String,
    /// Course of a simulation: it provides the parameters that are the text of a course, or of a file that the course
    /// names.
    pub(crate) course: Option<Spanned<String>>,
    /// Whether a run is handed what the run before has learned; without it, it is.
    pub(crate) remembers: Option<bool>,
    /// How long the operator keeps the authority over a process without sending a command.
    pub(crate) authority_s: Option<Spanned<f64>>,
    /// Topics of the log that it reads.
    #[serde(default, rename = "input")]
    pub(crate) inputs: Vec<Spanned<InputEntry>>,
    /// The processes; their order is that of cycles that start at one instant.
    #[serde(default, rename = "process")]
    pub(crate) processes: Vec<Spanned<ProcessEntry>>,
    /// What is special about buffers, by name.
    #[serde(default)]
    pub(crate) buffers: BTreeMap<Spanned<String>, Spanned<BufferEntry>>,
}

/// A topic of the log that the stack reads.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct InputEntry {
    /// The buffer that it feeds.
    pub buffer: Spanned<String>,
    /// Topic of the log.
    pub topic: Spanned<String>,
    /// Type of the buffer, if no process reads it: `foxglove.Odometry`.
    #[serde(rename = "type")]
    pub type_name: Option<Spanned<String>>,
    /// Whether its messages are valid for the whole log and are given at its start; always true for `/tf_static`.
    #[serde(default, rename = "static")]
    pub is_static: bool,
}

/// A process.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ProcessEntry {
    /// Its name, unique in the stack.
    pub name: Spanned<String>,
    /// The plugin that defines it.
    pub plugin: Spanned<String>,
    /// Its supervisor; if it is missing, the error says what to write.
    pub supervisor: Option<Spanned<String>>,
    /// Which of its supervisor's children it is; by default the one with its name or its plugin's name, else one of a
    /// set.
    #[serde(rename = "as")]
    pub child: Option<Spanned<String>>,
    /// Computer on which it runs: `local`, which is the only one so far.
    pub host: Option<Spanned<String>>,
    /// How the operating system schedules it in a live run; default `normal`.
    pub class: Option<Spanned<Class>>,
    /// Pool of threads on which it computes in a live run; processes that name the same pool share it.
    pub pool: Option<Spanned<String>>,
    /// Period of its cycles; default: that of the plugin.
    pub period_ms: Option<Spanned<f64>>,
    /// Time from the start of a cycle until its output is visible.
    pub latency_ms: Option<Spanned<f64>>,
    /// Buffers of the input ports.
    #[serde(default)]
    pub inputs: BTreeMap<Spanned<String>, Spanned<String>>,
    /// Buffers of the output ports; default `/<process>/<port>`.
    #[serde(default)]
    pub outputs: BTreeMap<Spanned<String>, Spanned<String>>,
    /// Parameters; those that are missing have their defaults.
    #[serde(default)]
    pub params: BTreeMap<Spanned<String>, Spanned<ParamEntry>>,
}

/// The value of a parameter; values within a table or a list keep their positions, too.
#[derive(Clone, Debug)]
pub enum ParamEntry {
    /// A number, a text, `true` or `false`.
    Plain(Value),
    /// A list.
    List(Vec<Spanned<ParamEntry>>),
    /// A table: parameters of a group.
    Table(BTreeMap<Spanned<String>, Spanned<ParamEntry>>),
}

impl<'de> Deserialize<'de> for ParamEntry {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        // serde buffers the input of an untagged enum, which loses positions.
        deserializer.deserialize_any(ParamVisitor)
    }
}

struct ParamVisitor;

impl<'de> Visitor<'de> for ParamVisitor {
    type Value = ParamEntry;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a number, a text, true or false, a list or a table")
    }

    fn visit_bool<E>(self, on: bool) -> Result<ParamEntry, E> {
        Ok(ParamEntry::Plain(Value::Bool(on)))
    }

    fn visit_i64<E>(self, number: i64) -> Result<ParamEntry, E> {
        Ok(ParamEntry::Plain(Value::Int(number)))
    }

    fn visit_f64<E>(self, number: f64) -> Result<ParamEntry, E> {
        Ok(ParamEntry::Plain(Value::Float(number)))
    }

    fn visit_str<E>(self, text: &str) -> Result<ParamEntry, E> {
        Ok(ParamEntry::Plain(Value::Text(text.to_owned())))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut items: A) -> Result<ParamEntry, A::Error> {
        let mut list = Vec::new();
        while let Some(item) = items.next_element()? {
            list.push(item);
        }
        Ok(ParamEntry::List(list))
    }

    fn visit_map<A: MapAccess<'de>>(self, mut entries: A) -> Result<ParamEntry, A::Error> {
        let mut table = BTreeMap::new();
        while let Some((key, value)) = entries.next_entry()? {
            table.insert(key, value);
        }
        Ok(ParamEntry::Table(table))
    }
}

/// How the operating system schedules a process in a live run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Class {
    /// Before all others: short cycles that must not be late. Computes on its own thread unless it has a pool.
    Realtime,
    /// The default: before background processes.
    #[default]
    Normal,
    /// When nothing else needs the processor.
    Background,
}

impl Class {
    /// The name in a stack file.
    pub fn name(self) -> &'static str {
        match self {
            Class::Realtime => "realtime",
            Class::Normal => "normal",
            Class::Background => "background",
        }
    }
}

/// How much a buffer keeps, and how much of it is recorded.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BufferEntry {
    /// Length of the queue; by default the buffer keeps the latest message only.
    pub queue: Option<Spanned<usize>>,
    /// What happens if a reader falls behind.
    pub overflow: Option<Spanned<OverflowEntry>>,
    /// Whether it is recorded; default `true`.
    pub record: Option<bool>,
    /// Greatest number of messages recorded per second; by default all are.
    pub record_hz: Option<Spanned<f64>>,
    /// Who may write it; by default a single writer.
    pub writers: Option<WritersEntry>,
}

/// Who may write a buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum WritersEntry {
    /// One process, or one topic of the log.
    One,
    /// Any number of writers, which readers distinguish by the header if necessary.
    Many,
}

/// What happens if a reader falls behind.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum OverflowEntry {
    /// The oldest message is dropped.
    DropOldest,
    /// The write is refused.
    Refuse,
}

impl StackFile {
    /// The version of the format that this program reads and writes.
    pub const FORMAT: u32 = FORMAT;

    /// Parses the text of a stack file without includes; errors name it `file`.
    pub fn parse(file: &str, text: &str) -> Result<Self, StackError> {
        Self::compose(file, text, &NoAssets)
    }

    /// Parses the text of a stack file and of the parts that it includes; errors name it `file`.
    pub fn compose(file: &str, text: &str, assets: &dyn Assets) -> Result<Self, StackError> {
        let composed = compose(file, text, assets)?;
        let text = composed.text;
        let content: Content = toml::from_str(&text).map_err(|error| {
            let span = error.span().unwrap_or(0..0);
            located(&composed.origins, file, &text, &span, error.message().trim())
        })?;
        let newlines = text.bytes().enumerate().filter(|(_, byte)| *byte == b'\n');
        let lines = std::iter::once(0).chain(newlines.map(|(at, _)| at + 1)).collect();
        let stack = Self { file: file.to_owned(), text, content, origins: composed.origins, lines };
        let format = &stack.content.format;
        if *format.get_ref() != Self::FORMAT {
            return Err(stack.error(
                &format.span(),
                format!("format {} is not known; expected {}", format.get_ref(), Self::FORMAT),
            ));
        }
        Ok(stack)
    }

    /// Name of the stack.
    pub fn name(&self) -> &str {
        self.content.name.get_ref()
    }

    /// Its description.
    pub fn description(&self) -> &str {
        &self.content.description
    }

    /// The course that it runs by default.
    pub fn course(&self) -> Option<&str> {
        self.content.course.as_ref().map(|course| course.get_ref().as_str())
    }

    /// Whether a run is handed what the run before has learned.
    pub fn remembers(&self) -> bool {
        self.content.remembers.unwrap_or(true)
    }

    /// Topics of the log that it reads.
    pub fn topics(&self) -> impl Iterator<Item = &str> {
        self.content.inputs.iter().map(|input| input.get_ref().topic.get_ref().as_str())
    }

    pub(crate) fn error(&self, span: &Range<usize>, message: impl Into<String>) -> StackError {
        located(&self.origins, &self.file, &self.text, span, message)
    }

    /// Origin of a byte range of the text.
    pub(crate) fn origin(&self, span: &Range<usize>) -> Origin {
        let line = self.lines.partition_point(|start| *start <= span.start);
        let own = || Origin { file: self.file.clone(), line };
        self.origins.get(line.saturating_sub(1)).cloned().unwrap_or_else(own)
    }

    /// Origin of each line of [`StackFile::text`].
    pub fn origins(&self) -> &[Origin] {
        &self.origins
    }
}

/// An error at a byte range of a composed text, reported at the line's origin.
fn located(
    origins: &[Origin],
    file: &str,
    text: &str,
    span: &Range<usize>,
    message: impl Into<String>,
) -> StackError {
    let error = StackError::at(file, text, span, message);
    match origins.get(error.line - 1) {
        Some(origin) => StackError { file: origin.file.clone(), line: origin.line, ..error },
        None => error,
    }
}
