//! Actions of an operator in a run without a window, read from a file.
//!
//! The file is a JSON list: `[{"at_s": 1.5, "buffer": "/operator/teleop", "message": {"speed_mps": 0.5}, "every_s":
//! 0.05, "until_s": 3}]`. Messages are in protobuf's JSON. A parameter message contains only the fields to change.

use crate::assets::read_text;
use crate::runs::{self, Stop};
use crate::usage;
use anyhow::Context as _;
use rcs_bus::Sample;
use rcs_msg::{AnyMessage, Stamp, params, rcs};
use rcs_runtime::{ExternalEvent, Plan, ProcessPlan, Stepped};
use serde::Deserialize;
use std::path::Path;

/// Maximum number of actions.
const MOST: usize = 1_000_000;

/// One action and its time.
#[derive(Clone, Debug)]
pub struct Act {
    /// Nanoseconds from the start of the run.
    pub at_ns: u64,
    /// What is written. Of parameters: with those of the stack, before the run.
    pub event: ExternalEvent,
    /// Of parameters, the fields to change; empty for other messages.
    pub fields: Vec<(String, String)>,
}

impl Act {
    /// What is written when the newest message of the buffer is this one: earlier changes of other parameters stay, and so
    /// does what the run got from the one before.
    pub(super) fn event_after(&self, newest: Option<Sample>) -> anyhow::Result<ExternalEvent> {
        let newest = newest.filter(|_| !self.fields.is_empty());
        Ok(match newest {
            Some(newest) => {
                let message = with_fields(&newest.message, &self.fields).map_err(anyhow::Error::msg)?;
                ExternalEvent { message, ..self.event.clone() }
            }
            None => self.event.clone(),
        })
    }

    /// Name of the action in errors.
    pub(super) fn name(&self) -> String {
        format!("what was to be written to {} at {} s", self.event.buffer, self.at_ns as f64 * 1e-9)
    }
}

/// An entry of the file.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Entry {
    at_s: f64,
    buffer: String,
    message: serde_json::Value,
    /// Period with which the action is repeated, s.
    every_s: Option<f64>,
    /// End of the repetition, s.
    until_s: Option<f64>,
}

/// Refuses faults on demand that do not fit the run, before it begins.
fn check_faults(run: &Stepped, acts: &[Act]) -> anyhow::Result<()> {
    let is_begin =
        |change: &rcs::Override| change.fault.is_some() && change.mode() != rcs::r#override::Mode::Release;
    let begins = acts.iter().filter(|act| act.event.message.get::<rcs::Override>().is_some_and(is_begin));
    begins
        .map(|act| run.check(&act.event))
        .try_for_each(|checked| checked.map_err(|error| usage(error.to_string())))
}

/// Begins the run, and runs until the end, or until the referee of a course has decided; executes the actions on the way.
pub(crate) fn go_to_the_end(
    run: &mut Stepped,
    until_s: Option<f64>,
    acts: &[Act],
    stop: Stop<'_>,
) -> anyhow::Result<()> {
    check_faults(run, acts)?;
    run.begin()?;
    let end = runs::end(run, until_s);
    for act in acts {
        let at = run.start().after_ns(act.at_ns);
        if end.is_some_and(|end| at > end) {
            break;
        }
        if !runs::go_to(run, end, at, stop)? {
            return Ok(());
        }
        let newest = run.buffers().iter().find(|buffer| buffer.name() == &*act.event.buffer);
        let event = act.event_after(newest.and_then(|buffer| buffer.latest()));
        event.and_then(|event| Ok(run.take(event)?)).with_context(|| act.name())?;
    }
    runs::go_to(run, end, Stamp::MAX, stop)?;
    Ok(())
}

/// Reads a file of actions and checks them against the stack. Actions are sorted by time.
pub(super) fn read(path: &Path, plan: &Plan) -> anyhow::Result<Vec<Act>> {
    let refused = |text: String| usage(format!("{text}: {}", path.display()));
    let text = read_text(path).map_err(|error| refused(format!("cannot read the acts: {error}")))?;
    parse(&text, plan).map_err(refused)
}

/// The actions in a text, sorted by time; an error says which one is wrong.
pub fn parse(text: &str, plan: &Plan) -> Result<Vec<Act>, String> {
    let entries: Vec<Entry> =
        serde_json::from_str(text).map_err(|error| format!("the acts cannot be read: {error}"))?;
    let mut acts = Vec::new();
    for (number, entry) in entries.into_iter().enumerate() {
        let refused = |text: String| format!("act {}: {text}", number + 1);
        let seconds = |value: f64, what: &str| {
            let good = value.is_finite() && (0.0..=1e6).contains(&value);
            good.then(|| (value * 1e9).round() as u64)
                .ok_or_else(|| refused(format!("{what} is {value}; expected seconds from 0 to 1e6")))
        };
        let (message, fields) = message(&entry, plan).map_err(refused)?;
        let event = ExternalEvent::operator(entry.buffer.as_str(), message);
        let mut at_ns = seconds(entry.at_s, "at_s")?;
        let every_ns = seconds(entry.every_s.unwrap_or(0.0), "every_s")?;
        let until_ns = seconds(entry.until_s.unwrap_or(entry.at_s), "until_s")?;
        loop {
            acts.push(Act { at_ns, event: event.clone(), fields: fields.clone() });
            at_ns += every_ns;
            if every_ns == 0 || at_ns > until_ns {
                break;
            }
            if acts.len() > MOST {
                return Err(refused(format!("it is done more than {MOST} times")));
            }
        }
    }
    acts.sort_by_key(|act| act.at_ns);
    Ok(acts)
}

/// The message of an entry, and the fields that it changes if it is of parameters.
fn message(entry: &Entry, plan: &Plan) -> Result<(AnyMessage, Vec<(String, String)>), String> {
    let name = &entry.buffer;
    let buffer = plan.buffers.iter().find(|buffer| buffer.spec.name == *name);
    let buffer = buffer.ok_or_else(|| format!("there is no buffer {name} in the stack"))?;
    let is_params = |process: &&ProcessPlan| plan.buffers[process.params_buffer].spec.name == *name;
    match plan.processes.iter().find(is_params) {
        Some(process) => {
            let fields = fields(&entry.message)?;
            Ok((with_fields(&process.params, &fields)?, fields))
        }
        None => rcs_msg::from_json_as(&buffer.spec.schema, &entry.message.to_string())
            .map(|message| (message, Vec::new()))
            .map_err(|error| error.to_string()),
    }
}

/// The fields of a parameter message and their values, as texts.
fn fields(message: &serde_json::Value) -> Result<Vec<(String, String)>, String> {
    let fields = message.as_object().ok_or("expected an object of fields as the message")?;
    let text = |value: &serde_json::Value| value.as_str().map_or_else(|| value.to_string(), str::to_owned);
    Ok(fields.iter().map(|(field, value)| (field.clone(), text(value))).collect())
}

/// A parameter message with the given fields changed.
fn with_fields(params: &AnyMessage, fields: &[(String, String)]) -> Result<AnyMessage, String> {
    let changes = fields.iter().map(|(field, text)| (field.as_str(), text.as_str()));
    params::with_params(params, changes).map_err(|error| error.to_string())
}
