//! Overrides ([`rcs::Override`]): checked when they are set, listed while they last.
//!
//! The [`OverrideTable`] sets and releases the overrides of a run. After each event it drops those that have expired,
//! and puts those in force that waited for a cycle. Whenever the list changes, it is published in `/runtime/overrides`.
//! A buffer drops an override that does not fit a message; this is reported in `/runtime/log` as an error of the
//! operator, and the message passes unchanged.

use crate::error::RunError;
use crate::faults::{self, Targets};
use crate::stack::{Plan, names};
use prost_reflect::{Cardinality, DynamicMessage, FieldDescriptor, Kind, MessageDescriptor};
use rcs_bus::{
    Buffer, Bus, Draft, Due, FaultKind, Override, OverrideMode, OverrideValue, Release, Scalar, Writer,
    WriterId,
};
use rcs_msg::{AnyMessage, FieldPath, Schema, Segment, Stamp, Value, foxglove, params, rcs};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Greatest time until an override expires, s.
const LONGEST_S: f64 = 1e7;

/// A checked request of the operator.
pub(crate) enum Change {
    /// In the buffers with these indices. Number and times are assigned when it takes effect.
    Set { indices: Vec<usize>, new: Box<Override>, expires_ns: Option<u64> },
    /// In one buffer, or in all buffers.
    Release(Option<usize>, Release),
}

/// The overrides of a run.
pub(crate) struct OverrideTable {
    buffers: Vec<Arc<Buffer>>,
    /// Status buffer of each process, by its name.
    statuses: BTreeMap<Arc<str>, Arc<Buffer>>,
    targets: Targets,
    /// Whether any override may exist.
    any: Arc<AtomicBool>,
    list: Writer,
    log: Writer,
}

impl OverrideTable {
    /// The overrides of all buffers of a plan, in its order; `None` if the runtime's own buffers are missing.
    pub(crate) fn new(plan: &Plan, bus: &Bus, buffers: &[Arc<Buffer>]) -> Option<Self> {
        let own = |name: &str| bus.get(name).map(|buffer| buffer.writer(WriterId::RUNTIME));
        let status = |process: &crate::stack::ProcessPlan| {
            (Arc::clone(&process.name), Arc::clone(&buffers[process.status_buffer]))
        };
        Some(Self {
            buffers: buffers.to_vec(),
            statuses: plan.processes.iter().map(status).collect(),
            targets: faults::targets(plan),
            any: Arc::clone(bus.overridden()),
            list: own(names::OVERRIDES)?,
            log: own(names::LOG)?,
        })
    }

    fn index_of(&self, name: &str) -> Result<usize, String> {
        let index = self.buffers.iter().position(|buffer| buffer.name() == name);
        let index = index.ok_or_else(|| format!("there is no buffer {name} to override"))?;
        if name.starts_with(names::OWN) {
            return Err(format!("{name} is written by the runtime, and cannot be overridden"));
        }
        Ok(index)
    }

    /// Checks a request against buffer, field, type and range. Changes nothing.
    pub(crate) fn check(&self, message: &AnyMessage) -> Result<Change, RunError> {
        let refused = |text: String| RunError::Refused(text);
        let change = message
            .to::<rcs::Override>()
            .ok_or_else(|| refused("an override that does not decode".to_owned()))?;
        if change.mode() == rcs::r#override::Mode::Release {
            return self.check_release(&change).map_err(refused);
        }
        let what = if change.fault.is_some() { "fault" } else { "override" };
        let about = |text: String| match target(&change).as_str() {
            "" => refused(format!("the {what}: {text}")),
            of => refused(format!("the {what} of {of}: {text}")),
        };
        let (value, indices) = if let Some(fault) = &change.fault {
            if !change.buffer.is_empty() {
                self.index_of(&change.buffer).map_err(refused)?;
            }
            if change.mode() == rcs::r#override::Mode::Once {
                return Err(about("it cannot be for one message; expected the mode HOLD".to_owned()));
            }
            let checked = faults::check(&change, fault, &self.targets, &self.buffers);
            checked.map(|(fault, indices)| (OverrideValue::Fault(fault), indices)).map_err(about)?
        } else {
            let index = self.index_of(&change.buffer).map_err(refused)?;
            (value_of(&change, &self.buffers[index].spec().schema).map_err(about)?, vec![index])
        };
        let due = match change.due_process.as_str() {
            "" => None,
            process if self.statuses.contains_key(process) => {
                Some(Due { process: process.to_owned(), cycle: change.due_cycle })
            }
            process => {
                return Err(about(format!("there is no process {process} whose cycle it could wait for")));
            }
        };
        let expires_s = change.expires_s;
        if !(0.0..=LONGEST_S).contains(&expires_s) {
            return Err(about(format!("it expires after {expires_s} s; expected 0 (never) to {LONGEST_S}")));
        }
        let owner = if change.owner.is_empty() { "operator" } else { change.owner.as_str() };
        let mode = match change.mode() {
            rcs::r#override::Mode::Once => OverrideMode::Once,
            _ => OverrideMode::Hold,
        };
        let expires_ns = (expires_s > 0.0).then_some((expires_s * 1e9) as u64);
        let new = Override { id: 0, owner: owner.into(), mode, value, since: Stamp(0), until: None, due };
        Ok(Change::Set { indices, new: Box::new(new), expires_ns })
    }

    fn check_release(&self, change: &rcs::Override) -> Result<Change, String> {
        let index = match change.buffer.as_str() {
            "" => None,
            name => Some(self.index_of(name)?),
        };
        if let Some(fault) = &change.fault {
            // Accepted even if it has expired or did not fit, because a schedule ends its faults in any case.
            let any = rcs::Fault { delay_ms: 1.0, ..*fault };
            let (fault, _) = faults::check(change, &any, &self.targets, &self.buffers)?;
            return Ok(Change::Release(index, Release::Fault(fault)));
        }
        let which = match (change.id, change.all) {
            (0, true) => Release::All,
            (0, false) if index.is_none() => {
                return Err("a release names nothing; expected a number, a buffer, or all".to_owned());
            }
            (0, false) => Release::Path(change.path.parse().map_err(|error| format!("{error}"))?),
            (id, _) => Release::Id(id),
        };
        let held = |buffer: &Arc<Buffer>| buffer.overrides().iter().any(|active| which.is_of(active));
        // Releasing everything is accepted even if nothing is overridden, because operators do it as a precaution.
        let found = match (&which, index) {
            (Release::All | Release::Fault(_), _) => true,
            (Release::Id(_), _) => self.buffers.iter().any(held),
            (Release::Path(_), Some(index)) => held(&self.buffers[index]),
            (Release::Path(_), None) => false,
        };
        if !found {
            return Err(match which {
                Release::Id(id) => format!("no override has the number {id}"),
                _ => format!("nothing overrides {}", target(change)),
            });
        }
        let index = if matches!(which, Release::Id(_)) { None } else { index };
        Ok(Change::Release(index, which))
    }

    /// Applies a checked request. `id` is the number of an override.
    pub(crate) fn apply(&self, change: Change, id: u64, now: Stamp) {
        match change {
            Change::Set { indices, new, expires_ns } => {
                let until = expires_ns.map(|expires_ns| now.after_ns(expires_ns));
                for index in indices {
                    self.buffers[index].set_override(Override { id, since: now, until, ..(*new).clone() });
                }
            }
            Change::Release(Some(index), which) => {
                self.buffers[index].release_overrides(&which);
            }
            Change::Release(None, which) => {
                for buffer in &self.buffers {
                    buffer.release_overrides(&which);
                }
            }
        }
    }

    /// Whether any override may exist.
    pub(crate) fn is_any(&self) -> bool {
        self.any.load(Ordering::Relaxed)
    }

    /// To be called after every event; without overrides it costs one check.
    pub(crate) fn update(&self, now: Stamp) {
        if self.is_any() {
            self.update_all(now);
        }
    }

    fn update_all(&self, now: Stamp) {
        let cycles = self.cycles_waited_for();
        let is_due = |due: &Due| cycles.get(&due.process).is_some_and(|&cycle| cycle + 1 >= due.cycle);
        let (mut changed, mut dropped, mut last, mut active) = (false, 0, None, Vec::new());
        for buffer in &self.buffers {
            let changes = buffer.update_overrides(now, is_due);
            changed |= changes.changed;
            for (failed, reason) in changes.failed {
                let text = format!(
                    "the override {} of {}{} by {} does not fit and was dropped: {reason}; the message went on as it was",
                    failed.id,
                    buffer.name(),
                    failed.path(),
                    failed.owner
                );
                self.tell(now, &text);
                dropped += 1;
                last = Some(text);
            }
            active.extend(changes.active.iter().map(|active| listed(active, buffer.name())));
        }
        if active.is_empty() {
            self.any.store(false, Ordering::Relaxed);
        }
        if changed {
            active.sort_by_key(|active| active.id);
            // A fault of a process is one, in however many buffers.
            active.dedup_by_key(|active| active.id);
            let before =
                self.list.buffer().latest().and_then(|sample| sample.message.to::<rcs::OverrideList>());
            let before = before.unwrap_or_default();
            let list = rcs::OverrideList {
                timestamp: Some(now.to_proto()),
                active,
                dropped: before.dropped + dropped,
                last_dropped: last.unwrap_or(before.last_dropped),
            };
            write(&self.list, now, AnyMessage::new(list));
        }
    }

    /// The last published cycle of each process that an override waits for.
    fn cycles_waited_for(&self) -> BTreeMap<String, u64> {
        let waiting =
            self.buffers.iter().flat_map(|buffer| buffer.overrides()).filter_map(|active| active.due);
        let cycle = |due: Due| {
            let status = self.statuses.get(due.process.as_str()).and_then(|buffer| buffer.latest());
            let cycle =
                status.and_then(|sample| sample.message.get::<rcs::Status>().map(|status| status.cycle));
            (due.process, cycle.unwrap_or(0))
        };
        waiting.map(cycle).collect()
    }

    fn tell(&self, now: Stamp, text: &str) {
        let message = foxglove::Log {
            timestamp: Some(now.to_proto()),
            level: foxglove::log::Level::Warning.into(),
            message: text.to_owned(),
            name: "operator".to_owned(),
            ..foxglove::Log::default()
        };
        write(&self.log, now, AnyMessage::new(message));
    }
}

/// What a request is about: its process or buffer, and the path of its field, as in `/a/b.x`.
fn target(change: &rcs::Override) -> String {
    let rcs::Override { process, buffer, path, .. } = change;
    let and = if process.is_empty() || buffer.is_empty() { "" } else { " and " };
    // The first dot of a path is optional.
    let dot = if path.is_empty() || path.starts_with(['.', '[']) { "" } else { "." };
    format!("{process}{and}{buffer}{dot}{path}")
}

fn write(writer: &Writer, now: Stamp, message: AnyMessage) {
    if let Err(error) = writer.write(Draft { log_time: now, acq_time: now, message }) {
        tracing::warn!("{error}");
    }
}

fn listed(active: &Override, buffer: &str) -> rcs::OverrideInForce {
    let value = match &active.value {
        OverrideValue::Field(_, Scalar::Bool(on)) => on.to_string(),
        OverrideValue::Field(_, Scalar::Int(number)) => number.to_string(),
        OverrideValue::Field(_, Scalar::Uint(number)) => number.to_string(),
        OverrideValue::Field(_, Scalar::Float(number)) => number.to_string(),
        OverrideValue::Field(_, Scalar::Text(text)) => serde_json::Value::from(text.as_str()).to_string(),
        OverrideValue::Message(message) => message.schema().name().to_owned(),
        OverrideValue::Fault(_) => String::new(),
    };
    let fault = active.fault();
    let process = fault.map(|fault| fault.process.to_string()).unwrap_or_default();
    let path = match fault.map(|fault| &fault.kind) {
        Some(FaultKind::Nan { path }) => path.clone(),
        _ => active.path().to_string(),
    };
    rcs::OverrideInForce {
        id: active.id,
        owner: active.owner.to_string(),
        buffer: if process.is_empty() { buffer.to_owned() } else { String::new() },
        path,
        fault: fault.map(|fault| faults::text(&fault.kind)).unwrap_or_default(),
        process,
        value,
        once: active.mode == OverrideMode::Once,
        since: Some(active.since.to_proto()),
        until: active.until.map(Stamp::to_proto),
        due_process: active.due.as_ref().map(|due| due.process.clone()).unwrap_or_default(),
        due_cycle: active.due.as_ref().map_or(0, |due| due.cycle),
    }
}

/// The new value, checked against the type of the buffer.
fn value_of(change: &rcs::Override, schema: &Arc<Schema>) -> Result<OverrideValue, String> {
    if change.path.is_empty() {
        let whole = rcs_msg::canonical(schema, &change.message).and_then(Result::ok);
        let whole = whole.ok_or_else(|| format!("the message does not decode as {}", schema.name()))?;
        return Ok(OverrideValue::Message(whole));
    }
    let path: FieldPath = change.path.parse().map_err(|error| format!("{error}"))?;
    let value = match serde_json::from_str(&change.value_json) {
        Ok(serde_json::Value::Bool(on)) => Scalar::Bool(on),
        Ok(serde_json::Value::String(text)) => Scalar::Text(text),
        Ok(serde_json::Value::Number(number)) => match (number.as_i64(), number.as_u64()) {
            (Some(number), _) => Scalar::Int(number),
            (None, Some(number)) => Scalar::Uint(number),
            (None, None) => Scalar::Float(number.as_f64().unwrap_or(f64::NAN)),
        },
        _ => {
            return Err(format!(
                "{:?} is no value for a field; expected a number, a text, true or false",
                change.value_json
            ));
        }
    };
    let descriptor = schema.descriptor().ok_or_else(|| format!("{} has no descriptor", schema.name()))?;
    check_field(descriptor, &path, &value)?;
    Ok(OverrideValue::Field(path, value))
}

/// Refuses a path that does not exist in a type, and a value of another type or out of the field's range.
fn check_field(descriptor: &MessageDescriptor, path: &FieldPath, value: &Scalar) -> Result<(), String> {
    let mut message = descriptor.clone();
    let mut segments = path.segments().iter();
    while let Some(segment) = segments.next() {
        let Segment::Field(name) = segment else {
            return Err(format!("expected a field of {}", message.full_name()));
        };
        let field = message.get_field_by_name(name).ok_or_else(|| {
            let names: Vec<_> = message.fields().map(|field| field.name().to_owned()).collect();
            format!("{} has no field {name}; expected one of {}", message.full_name(), names.join(", "))
        })?;
        let mut rest = segments.clone();
        if field.cardinality() == Cardinality::Repeated || field.kind() == Kind::Bytes {
            // An element: of a list by its index, of a map by its key.
            let fits = match rest.next() {
                Some(Segment::Index(_)) => !field.is_map(),
                Some(Segment::Field(_)) => field.is_map(),
                _ => false,
            };
            if !fits {
                return Err(format!("{name} is a list; expected one element of it, like {name}[0]"));
            }
            segments = rest;
            match element_of(&field) {
                Kind::Message(inner) => message = inner,
                kind if segments.next().is_none() => return check_element(&kind, value),
                _ => return Err(format!("{name} holds plain values; expected nothing behind its element")),
            }
        } else if let Kind::Message(inner) = field.kind() {
            message = inner;
        } else if segments.next().is_none() {
            let mut one = DynamicMessage::new(message);
            return params::set_param(&mut one, name, &Value::from(value.clone()))
                .map_err(|error| error.to_string());
        } else {
            return Err(format!("{name} is a plain value; expected nothing behind it"));
        }
    }
    Err(format!("it is a whole {}; expected one of its fields", message.full_name()))
}

fn element_of(field: &FieldDescriptor) -> Kind {
    match field.kind() {
        Kind::Message(entry) if field.is_map() => entry.map_entry_value_field().kind(),
        kind => kind,
    }
}

/// An element of a list, or a byte.
fn check_element(kind: &Kind, value: &Scalar) -> Result<(), String> {
    let whole = |least: i128, most: i128| match value {
        Scalar::Int(number) => (least..=most).contains(&i128::from(*number)),
        Scalar::Uint(number) => i128::from(*number) <= most,
        _ => false,
    };
    let (fits, expected) = match kind {
        Kind::Bytes => (whole(0, 255), "a whole number from 0 to 255"),
        Kind::Bool => (matches!(value, Scalar::Bool(_)), "true or false"),
        Kind::String => (matches!(value, Scalar::Text(_)), "a text"),
        Kind::Double | Kind::Float => {
            let fits = match value {
                Scalar::Float(number) => number.is_finite(),
                value => matches!(value, Scalar::Int(_) | Scalar::Uint(_)),
            };
            (fits, "a number")
        }
        Kind::Enum(_) => (matches!(value, Scalar::Int(_) | Scalar::Text(_)), "a choice"),
        Kind::Int32 | Kind::Sint32 | Kind::Sfixed32 => {
            (whole(i128::from(i32::MIN), i128::from(i32::MAX)), "a whole number")
        }
        Kind::Uint32 | Kind::Fixed32 => (whole(0, i128::from(u32::MAX)), "a whole number of at least 0"),
        Kind::Uint64 | Kind::Fixed64 => (whole(0, i128::from(u64::MAX)), "a whole number of at least 0"),
        _ => (whole(i128::from(i64::MIN), i128::from(i64::MAX)), "a whole number"),
    };
    if fits { Ok(()) } else { Err(format!("got {value:?}, expected {expected}")) }
}
