//! What a run remembers: `ocu run --runs` and the window hand it to the next run, and the window saves it.
//!
//! What a process remembers is an output that has the name of one of its parameters, where that parameter holds a file:
//! `ocu run --save` writes it, and the parameter reads it. So the next run begins with what the one before has learned.
//!
//! # File
//!
//! JSON with `format`, which is 1, and `remembered`: for each parameter, as `process.field`, the text that it holds. Each
//! of these texts is a file of its own kind and version, such as a map of `map_memory`.

use crate::assets::{ProgramAssets, read_text};
use crate::usage;
use anyhow::Context as _;
use rcs_msg::params::{ParamSpec, specs};
use rcs_msg::{Schema, from_json_as};
use rcs_runtime::source::Frame;
use rcs_runtime::{Asset, Assets, Plan, Stepped};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

/// Kinds of files that processes write: what they learned, the way that they drove, where it was slippery, and the map of
/// it. Files of other kinds are written by people, and an output of the same name (the goal of a course, and the goal in
/// the local frame) is something else.
const REMEMBERED: [&str; 4] = ["models", "route", "slips", "map"];

/// The version of the file that is written.
const FORMAT: u32 = 1;

/// Texts by parameter: `process.field`.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Remembered {
    texts: BTreeMap<String, String>,
}

/// The file.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    format: u32,
    remembered: BTreeMap<String, String>,
}

impl Remembered {
    /// What the processes of a run remember at its end; nothing of a stack that does not remember.
    pub(crate) fn of(run: &Stepped) -> anyhow::Result<Self> {
        let mut found = Self::default();
        if !run.plan().file.remembers() {
            return Ok(found);
        }
        for process in &run.plan().processes {
            let names = remembered(&process.params.schema());
            for (port, &buffer) in process.kind.outputs().iter().zip(&process.outputs) {
                let newest = run.buffers()[buffer].latest();
                if let Some(sample) = newest.filter(|_| names.iter().any(|name| name == port.name)) {
                    found.put(&process.name, port.name, &sample)?;
                }
            }
        }
        Ok(found)
    }

    /// What the processes remember at the moment that is shown, of a run or of a recording of one. An error while
    /// messages of this moment are being computed.
    pub(crate) fn of_frame(frame: &Frame) -> anyhow::Result<Self> {
        let mut found = Self::default();
        for process in frame.processes.iter() {
            let names = remembered_by(&process.plugin);
            for port in process.outputs.iter().filter(|port| names.contains(&port.name)) {
                let Some(topic) = frame.topic(&port.buffer) else { continue };
                anyhow::ensure!(
                    !topic.pending,
                    "{} of this moment is still being computed; try again",
                    topic.name
                );
                if let Some(sample) = &topic.latest {
                    found.put(&process.name, &port.name, sample)?;
                }
            }
        }
        Ok(found)
    }

    fn put(&mut self, process: &str, field: &str, sample: &rcs_bus::Sample) -> anyhow::Result<()> {
        self.texts.insert(format!("{process}.{field}"), rcs_msg::to_json(&sample.message)?);
        Ok(())
    }

    /// Reads a file.
    pub(crate) fn load(path: &Path) -> anyhow::Result<Self> {
        let read = || -> anyhow::Result<Self> {
            let text = read_text(path).map_err(anyhow::Error::msg)?;
            let file: File = serde_json::from_str(&text).map_err(|error| match parameter_of(&text) {
                None => anyhow::Error::new(error),
                Some(parameter) => anyhow::anyhow!(
                    "{error}; this is the file of one parameter: `ocu run --param {parameter}={}`",
                    path.display()
                ),
            })?;
            anyhow::ensure!(file.format == FORMAT, "format is {}, expected {FORMAT}", file.format);
            Ok(Self { texts: file.remembered })
        };
        read().with_context(|| format!("no file of what a run remembers: {}", path.display()))
    }

    /// The text of a file.
    pub(crate) fn to_text(&self) -> anyhow::Result<String> {
        Ok(serde_json::to_string_pretty(&File { format: FORMAT, remembered: self.texts.clone() })?)
    }

    /// Whether nothing is remembered.
    pub(crate) fn is_empty(&self) -> bool {
        self.texts.is_empty()
    }

    /// The parameters that hold it, as `process.field`.
    pub(crate) fn names(&self) -> impl Iterator<Item = &str> {
        self.texts.keys().map(String::as_str)
    }

    /// Those of the parameters that processes of this source have.
    pub(crate) fn in_force(&self, frame: &Frame) -> Vec<&str> {
        let is_in_force = |name: &&str| {
            let Some((process, field)) = name.split_once('.') else { return false };
            let known = frame.processes.iter().find(|known| known.name == process);
            known.is_some_and(|known| remembered_by(&known.plugin).iter().any(|known| known == field))
        };
        self.names().filter(is_in_force).collect()
    }

    /// Adds what a later run remembers; what it has forgotten stays.
    pub(crate) fn add(&mut self, later: Remembered) {
        self.texts.extend(later.texts);
    }

    /// The parameters of a stack that hold it, as overrides whose values are the names of files of these [`Assets`]. An
    /// error if the stack has none of them, or does not remember.
    pub(crate) fn overrides(&self, plan: &Plan) -> anyhow::Result<Vec<(String, String)>> {
        let stack = plan.file.name();
        if !self.is_empty() && !plan.file.remembers() {
            return Err(usage(format!("the stack {stack} remembers nothing from run to run")));
        }
        let fields = |process: &rcs_runtime::ProcessPlan| {
            let names = remembered(&process.params.schema());
            names.into_iter().map(|name| format!("{}.{name}", process.name)).collect::<Vec<_>>()
        };
        let known = plan.processes.iter().flat_map(fields).filter(|name| self.texts.contains_key(name));
        let overrides: Vec<_> = known.map(|name| (name.clone(), name)).collect();
        if overrides.is_empty() && !self.is_empty() {
            let names = self.names().collect::<Vec<_>>().join(", ");
            return Err(usage(format!(
                "the stack {stack} has no parameter of those that an earlier run remembers: {names}"
            )));
        }
        Ok(overrides)
    }

    /// A warning of what is not among these overrides, because the stack does not have these parameters; `None` where
    /// nothing is left out.
    pub(crate) fn left_out(&self, overrides: &[(String, String)]) -> Option<String> {
        let is_left_out = |name: &&str| !overrides.iter().any(|(known, _)| known == name);
        let names: Vec<&str> = self.names().filter(is_left_out).collect();
        let names = names.join(", ");
        let text = || format!("the stack lacks parameters that an earlier run remembers: {names}");
        (!names.is_empty()).then(text)
    }
}

/// The parameter that holds a text as `ocu run --save` writes it, as `plugin.field`: what one process remembers.
fn parameter_of(text: &str) -> Option<String> {
    rcs_plugins::all().iter().find_map(|kind| {
        let names = remembered(kind.params_schema());
        let outputs = kind.outputs().into_iter().filter(|port| names.iter().any(|name| name == port.name));
        let mut read = outputs.filter_map(|port| Some((port.name, from_json_as(&port.schema, text).ok()?)));
        let (field, _) = read.find(|(_, message)| !message.bytes().is_empty())?;
        Some(format!("{}.{field}", kind.def().plugin))
    })
}

/// The parameters of a plugin that hold what it remembers.
fn remembered_by(plugin: &str) -> Vec<String> {
    let kind = rcs_plugins::all().iter().find(|kind| kind.def().plugin == plugin);
    kind.map(|kind| remembered(kind.params_schema())).unwrap_or_default()
}

/// The parameters of a process that hold what it remembers.
fn remembered(schema: &Schema) -> Vec<String> {
    let is_remembered =
        |spec: &ParamSpec| spec.file.as_deref().is_some_and(|kind| REMEMBERED.contains(&kind));
    let specs = schema.descriptor().map(specs).unwrap_or_default();
    specs.into_iter().filter(is_remembered).map(|spec| spec.name).collect()
}

/// Reads a file that the command line names.
pub(crate) fn parse_remembered(path: &str) -> Result<Arc<Remembered>, String> {
    Remembered::load(Path::new(path)).map(Arc::new).map_err(|error| crate::say(&error))
}

impl Assets for Remembered {
    fn read(&self, kind: &str, name: &str, beside: &str) -> Result<Asset, String> {
        match self.texts.get(name) {
            Some(text) => Ok(Asset { file: format!("{name} of an earlier run"), text: text.clone() }),
            None => ProgramAssets.read(kind, name, beside),
        }
    }
}
