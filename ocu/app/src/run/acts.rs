//! Actions of an operator in a run without a window, read from a file.
//!
//! The file is a JSON list: `[{"at_s": 1.5, "buffer": "/operator/teleop", "message": {"speed_mps": 0.5}, "every_s":
//! 0.05, "until_s": 3}]`. Messages are in protobuf's JSON. A parameter message contains only the fields to change; a
//! field that holds a file takes the text of the file. Without `until_s`, an action is repeated to the end of the run.

use crate::assets::read_text;
use crate::runs::{self, Stop};
use crate::{stacks, usage};
use anyhow::Context as _;
use ocu_ui::format;
use rcs_bus::Sample;
use rcs_log::Log;
use rcs_msg::rcs::fault::Kind;
use rcs_msg::rcs::r#override::Mode;
use rcs_msg::{AnyMessage, Stamp, params, rcs};
use rcs_runtime::{ExternalEvent, Plan, ProcessPlan, RunOptions, Stepped};
use serde::Deserialize;
use std::cmp::Reverse;
use std::collections::{BTreeMap, BinaryHeap};
use std::path::Path;
use std::sync::Arc;

/// Latest time of an action, s.
pub(super) const LATEST_S: f64 = 1e6;
/// Shortest period of an action, s.
const SHORTEST_S: f64 = 1e-3;

/// One action and its time.
#[derive(Clone, Debug)]
pub struct Act {
    /// Nanoseconds from the start of the run.
    pub at_ns: u64,
    /// How it is repeated; `None` if it is done once.
    pub repeated: Option<Repetition>,
    /// What is written. Of parameters: with those of the stack, before the run.
    pub event: ExternalEvent,
    /// Of parameters, the fields to change; empty for other messages.
    pub fields: Vec<(String, String)>,
}

/// The repetition of an action.
#[derive(Clone, Copy, Debug)]
pub struct Repetition {
    /// Period, ns.
    pub every_ns: u64,
    /// Latest time, nanoseconds from the start of the run.
    pub until_ns: u64,
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

    /// Name of the action in errors, at one of its times.
    pub(super) fn name(&self, at_ns: u64) -> String {
        format!("what was to be written to {} at {} s", self.event.buffer, at_ns as f64 * 1e-9)
    }

    /// The request that begins or ends a fault on demand; `None` for other actions.
    fn fault(&self) -> Option<&rcs::Override> {
        self.event.message.get::<rcs::Override>().filter(|change| change.fault.is_some())
    }
}

/// Whether a request of a fault begins it.
fn is_begin(change: &rcs::Override) -> bool {
    change.mode() != Mode::Release
}

/// A fault on demand as the command line writes it, without value and time: `wm1:frozen`.
pub(super) fn fault_name(change: &rcs::Override) -> String {
    let target = if change.process.is_empty() { &change.buffer } else { &change.process };
    let kind = change.fault.as_ref().map(|fault| kind_name(fault.kind())).unwrap_or_default();
    format!("{target}:{kind}")
}

/// The name of a kind of fault in a file and on the command line.
pub(super) fn kind_name(kind: Kind) -> String {
    kind.as_str_name().to_lowercase()
}

/// Seconds in nanoseconds; `None` unless they are between 0 and [`LATEST_S`].
pub(super) fn seconds_ns(seconds: f64) -> Option<u64> {
    (0.0..=LATEST_S).contains(&seconds).then(|| (seconds * 1e9).round() as u64)
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
    /// End of the repetition, s; that of the run by default.
    until_s: Option<f64>,
}

/// Refuses faults on demand that do not fit the stack, before anything runs or is recorded. What else keeps the stack from
/// running is an error of the run.
pub(crate) fn check_faults(plan: &Arc<Plan>, log: Option<&Log>, acts: &[Act]) -> anyhow::Result<()> {
    let begins: Vec<&Act> = acts.iter().filter(|act| act.fault().is_some_and(is_begin)).collect();
    if begins.is_empty() {
        return Ok(());
    }
    let options = RunOptions { threads: 1, ..stacks::options() };
    let Ok(run) = Stepped::new(Arc::clone(plan), log, options) else { return Ok(()) };
    begins.iter().try_for_each(|act| run.check(&act.event).map_err(|error| usage(error.to_string())))
}

/// Each time of each action in nanoseconds from the start of the run, with the index of the action, in order of time.
/// Actions of one time keep their order.
pub(super) fn times(acts: &[Act]) -> impl Iterator<Item = (u64, usize)> {
    let first = acts.iter().enumerate().map(|(index, act)| Reverse((act.at_ns, index)));
    let mut due: BinaryHeap<Reverse<(u64, usize)>> = first.collect();
    std::iter::from_fn(move || {
        let Reverse((at_ns, index)) = due.pop()?;
        if let Some(Repetition { every_ns, until_ns }) = acts[index].repeated
            && at_ns + every_ns <= until_ns
        {
            due.push(Reverse((at_ns + every_ns, index)));
        }
        Some((at_ns, index))
    })
}

/// Begins the run, and runs until the end, or until the referee of a course has decided; executes the actions on the way.
/// Returns the warnings about those that the run did not reach ([`undone`]).
pub(crate) fn go_to_the_end(
    run: &mut Stepped,
    until_s: Option<f64>,
    acts: &[Act],
    stop: Stop<'_>,
) -> anyhow::Result<Vec<String>> {
    run.begin()?;
    let end = runs::end(run, until_s);
    for (at_ns, index) in times(acts) {
        let at = run.start().after_ns(at_ns);
        let is_after_end = end.is_some_and(|end| at > end);
        if !runs::go_to(run, end, at, stop)? || is_after_end {
            return Ok(undone(acts, (at_ns, index), run.now().seconds_since(run.start())));
        }
        let act = &acts[index];
        let newest = run.buffers().iter().find(|buffer| buffer.name() == &*act.event.buffer);
        let event = act.event_after(newest.and_then(|buffer| buffer.latest()));
        event.and_then(|event| Ok(run.take(event)?)).with_context(|| act.name(at_ns))?;
    }
    runs::go_to(run, end, Stamp::MAX, stop)?;
    Ok(Vec::new())
}

/// Warnings about the actions that were never done because the run ended before the time and index `from`: one about each
/// fault that did not begin, and one about all other actions. A fault that did not end is none of them.
pub(super) fn undone(acts: &[Act], from: (u64, usize), end_s: f64) -> Vec<String> {
    let after = format!("after the end of the run at {} s", format::number(end_s));
    let at_s = |act: &Act| format::number(act.at_ns as f64 * 1e-9);
    let left = acts.iter().enumerate().filter(|(index, act)| (act.at_ns, *index) >= from);
    let (faults, others): (Vec<&Act>, Vec<&Act>) =
        left.map(|(_, act)| act).partition(|act| act.fault().is_some());
    let mut warnings = Vec::new();
    for act in faults {
        if let Some(change) = act.fault().filter(|change| is_begin(change)) {
            warnings.push(format!("the fault {} begins at {} s, {after}", fault_name(change), at_s(act)));
        }
    }
    if let Some(&first) = others.first() {
        let (count, buffer) = (others.len(), &first.event.buffer);
        warnings
            .push(format!("acts not done: {count}, the first one on {buffer} at {} s, {after}", at_s(first)));
    }
    warnings
}

/// Reads a file of actions and checks them against the stack. Actions are sorted by time.
pub(super) fn read(path: &Path, plan: &Plan) -> anyhow::Result<Vec<Act>> {
    let refused = |text: String| usage(format!("{text}: {}", path.display()));
    let text = read_text(path).map_err(|error| refused(format!("cannot read the acts: {error}")))?;
    parse(&text, plan).map_err(refused)
}

/// The actions in a text, sorted by their first time; an error says which one is wrong.
pub fn parse(text: &str, plan: &Plan) -> Result<Vec<Act>, String> {
    let entries: Vec<Entry> =
        serde_json::from_str(text).map_err(|error| format!("the acts cannot be read: {error}"))?;
    let mut acts = Vec::new();
    for (number, entry) in entries.into_iter().enumerate() {
        let refused = |text: String| format!("act {}: {text}", number + 1);
        let seconds = |value: f64, what: &str| {
            let got = format::number(value);
            let expected = || refused(format!("{what} is {got}; expected seconds from 0 to {LATEST_S:e}"));
            seconds_ns(value).ok_or_else(expected)
        };
        let (message, fields) = message(&entry, plan).map_err(refused)?;
        let event = ExternalEvent::operator(entry.buffer.as_str(), message);
        let at_ns = seconds(entry.at_s, "at_s")?;
        let repeated = match (entry.every_s, entry.until_s) {
            (None, None) => None,
            (None, Some(_)) => return Err(refused("until_s is given without every_s".to_owned())),
            (Some(every_s), _) if every_s < SHORTEST_S => {
                let got = format::number(every_s);
                return Err(refused(format!("every_s is {got}; expected at least {SHORTEST_S}")));
            }
            (_, Some(until_s)) if until_s < entry.at_s => {
                let (got, at_s) = (format::number(until_s), format::number(entry.at_s));
                return Err(refused(format!("until_s is {got}; expected at least at_s, which is {at_s}")));
            }
            (Some(every_s), until_s) => Some(Repetition {
                every_ns: seconds(every_s, "every_s")?,
                until_ns: seconds(until_s.unwrap_or(LATEST_S), "until_s")?,
            }),
        };
        acts.push(Act { at_ns, repeated, event, fields });
    }
    check_params(&acts, plan)?;
    acts.sort_by_key(|act| act.at_ns);
    Ok(acts)
}

/// The process whose parameters are in a buffer.
fn process_of<'p>(plan: &'p Plan, buffer: &str) -> Option<&'p ProcessPlan> {
    plan.processes.iter().find(|process| plan.buffers[process.params_buffer].spec.name == *buffer)
}

/// Refuses parameters that their process refuses, such as the text of a file, each with what the acts before it in time
/// have changed.
fn check_params(acts: &[Act], plan: &Plan) -> Result<(), String> {
    let mut order: Vec<usize> = (0..acts.len()).collect();
    order.sort_by_key(|&index| acts[index].at_ns);
    let mut newest: BTreeMap<&str, AnyMessage> = BTreeMap::new();
    for index in order {
        let Act { event, fields, .. } = &acts[index];
        let Some(process) = process_of(plan, &event.buffer) else { continue };
        let refused = |text: String| format!("act {}: {text}", index + 1);
        // A message without fields is that of the stack.
        let before = newest.get(&*event.buffer).filter(|_| !fields.is_empty()).unwrap_or(&process.params);
        let message = with_fields(before, fields).map_err(refused)?;
        let checked = process.kind.check(&message, &plan.files);
        checked.map_err(|text| refused(format!("{text}{}", hint(process, fields))))?;
        newest.insert(&event.buffer, message);
    }
    Ok(())
}

/// What an error says in addition where the act changes a parameter that holds a file: `--param` takes a path.
fn hint(process: &ProcessPlan, fields: &[(String, String)]) -> &'static str {
    let descriptor = process.kind.params_schema().descriptor();
    let spec_of = |field: &str| params::find(descriptor?, field).ok();
    let is_file = |(field, _): &(String, String)| spec_of(field).is_some_and(|spec| spec.file.is_some());
    if fields.iter().any(is_file) { "; an act takes the text of a file, not its path" } else { "" }
}

/// The message of an entry, and the fields that it changes if it is of parameters.
fn message(entry: &Entry, plan: &Plan) -> Result<(AnyMessage, Vec<(String, String)>), String> {
    let name = &entry.buffer;
    let buffer = plan.buffers.iter().find(|buffer| buffer.spec.name == *name);
    let buffer = buffer.ok_or_else(|| format!("there is no buffer {name} in the stack"))?;
    match process_of(plan, name) {
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
