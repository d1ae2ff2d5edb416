//! Acts of the operator, in words: what a journal says that the operator wrote. Of parameters, the values that they
//! change are told, where the run says with which ones it began.

use super::known::Known;
use super::per_run::Written;
use crate::compare::{differing_each, show};
use crate::role::InputRole;
use bytes::Bytes;
use rcs_msg::rcs::r#override::Mode;
use rcs_msg::{FieldPath, Segment, Value, rcs, registry};
use std::collections::{BTreeMap, BTreeSet};

/// The name of the operator as a writer, in a journal and in the metadata of a channel.
pub(super) const OPERATOR: &str = "operator";
/// Types of the messages that describe a run.
const DESCRIBING: [&str; 2] = ["rcs.ProcessInfo", "rcs.RunInfo"];
/// Driving by hand is one act until nothing was commanded for this time.
const HAND_S: f64 = 1.0;
/// Most values that are told of one act.
const MOST_TOLD: usize = 3;

/// Whether messages of this type describe a run.
pub(super) fn is_describing_type(name: &str) -> bool {
    DESCRIBING.contains(&name)
}

/// What a run says of itself that is needed to tell an act in words.
#[derive(Clone, Default)]
pub(super) struct Described {
    /// The process whose parameters a buffer has, by buffer.
    params_of: BTreeMap<String, String>,
    /// The parameters with which each process began, by process.
    begun: BTreeMap<String, Bytes>,
    /// The buffers by which the operator drives by hand.
    teleoperation: BTreeSet<String>,
}

impl Described {
    /// Takes the description of a process.
    pub(super) fn take_process(&mut self, process: &rcs::ProcessInfo) {
        self.params_of.insert(process.params_buffer.clone(), process.name.clone());
        let inputs = process.inputs.iter().filter(|input| input.role == InputRole::Teleoperation.name());
        self.teleoperation.extend(inputs.map(|input| input.buffer.clone()));
    }

    /// Takes the identity of a run.
    pub(super) fn take_run(&mut self, run: &rcs::RunInfo) {
        let begun = run.params.iter().map(|begun| (begun.process.clone(), begun.params.clone()));
        self.begun.extend(begun);
    }

    /// Whether a message drives the vehicle by hand. A recording that describes no process does not tell its inputs:
    /// there, every drive command of the operator does.
    fn drives(&self, event: &rcs::JournalEvent) -> bool {
        if self.params_of.is_empty() {
            return event.schema == "rcs.DriveCommand";
        }
        self.teleoperation.contains(&event.buffer)
    }
}

/// What an event of the journal says that the operator did; `None` for what is told elsewhere, or goes on.
pub(super) fn told(
    known: &mut Known,
    described: &Described,
    at: Written,
    event: &rcs::JournalEvent,
) -> Option<String> {
    if event.writer != OPERATOR {
        return None;
    }
    match event.schema.as_str() {
        // Found in the buffers themselves.
        "rcs.EmergencyStop" | "rcs.Command" => None,
        "rcs.Override" => {
            let change = <rcs::Override as prost::Message>::decode(event.message.clone()).ok();
            let told = change.as_ref().and_then(crate::faults::told);
            let told = told.or_else(|| change.as_ref().map(overridden));
            Some(told.unwrap_or_else(|| "writes Override".to_owned()))
        }
        _ if described.drives(event) => {
            (!known.driven.goes_on(at, HAND_S)).then(|| "drives by hand".to_owned())
        }
        _ => Some(match described.params_of.get(&event.buffer) {
            Some(process) => changed(known, described.begun.get(process), at, event),
            None => written(event),
        }),
    }
}

/// What parameters change; `begun` are those with which their process began.
fn changed(known: &mut Known, begun: Option<&Bytes>, at: Written, event: &rcs::JournalEvent) -> String {
    let sent = known.params.entry(event.buffer.clone()).or_default();
    let before = sent.get().or(begun).and_then(|before| value_of(event, before));
    sent.set(at, event.message.clone());
    let pair = before.zip(value_of(event, &event.message));
    let Some(changes) = pair.map(|(before, now)| differing_each(&before, &now)) else {
        return written(event);
    };
    let value = |text: &str| if text.is_empty() { "nothing".to_owned() } else { text.to_owned() };
    let told = changes.iter().take(MOST_TOLD).map(|(field, [from, to])| {
        format!("{} from {} to {}", field.trim_start_matches('.'), value(from), value(to))
    });
    let told = told.collect::<Vec<_>>().join(", ");
    match changes.len().saturating_sub(MOST_TOLD) {
        0 if told.is_empty() => format!("writes {} without a change", short_name(&event.schema)),
        0 => format!("changes {told}"),
        more => format!("changes {told} and {more} more"),
    }
}

/// The values of a message, apart from its time, or its type where there are many.
fn written(event: &rcs::JournalEvent) -> String {
    let value = value_of(event, &event.message).unwrap_or(Value::Null);
    let is_time = |path: &FieldPath| match path.segments().first() {
        Some(Segment::Field(name)) => value.field(name).is_some_and(|field| field.as_stamp().is_some()),
        _ => false,
    };
    let leaves = value.leaves().filter(|(path, leaf)| **leaf != Value::Null && !is_time(path));
    let told = leaves.map(|(path, leaf)| {
        let path = path.to_string();
        format!("{} = {}", path.trim_start_matches('.'), show(leaf))
    });
    let told: Vec<String> = told.take(MOST_TOLD + 1).collect();
    if told.is_empty() || told.len() > MOST_TOLD {
        return format!("writes {}", short_name(&event.schema));
    }
    format!("writes {}", told.join(", "))
}

/// A message of the type of an event as a tree; `None` if it cannot be read.
fn value_of(event: &rcs::JournalEvent, message: &Bytes) -> Option<Value> {
    registry().schema(&event.schema)?.value(message).ok()
}

/// The name of a type without its package.
fn short_name(schema: &str) -> &str {
    schema.rsplit('.').next().unwrap_or(schema)
}

/// What an override of the operator does.
pub(super) fn overridden(change: &rcs::Override) -> String {
    let what = format!("{}{}", change.buffer, change.path);
    let value = if change.path.is_empty() { "a whole message" } else { change.value_json.as_str() };
    match change.mode() {
        Mode::Hold => format!("holds {what} = {value}"),
        Mode::Once => format!("writes {what} = {value} into the next message"),
        Mode::Release if change.id != 0 => format!("releases override {}", change.id),
        Mode::Release if change.all && change.buffer.is_empty() => "releases all overrides".to_owned(),
        Mode::Release => format!("releases {what}"),
    }
}
