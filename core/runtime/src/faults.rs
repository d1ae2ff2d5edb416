//! Requests of faults on demand ([`rcs::Fault`]): checked against the plan, and told in words.

use crate::stack::{Plan, ProcessPlan};
use prost_reflect::{Kind, MessageDescriptor};
use rcs_bus::{Buffer, Fault, FaultKind, Loss};
use rcs_msg::{FieldPath, Segment, rcs};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Longest delay, ms.
const LONGEST_MS: f64 = 60_000.0;

/// The buffers of each process, by its name: its status, and its outputs with the commands to its children.
pub(crate) type Targets = BTreeMap<Arc<str>, (usize, Vec<usize>)>;

/// The buffers of every process of a plan.
pub(crate) fn targets(plan: &Plan) -> Targets {
    let of = |process: &ProcessPlan| {
        let children = process.children.iter().map(|child| plan.processes[child.process].command_buffer);
        let outputs = process.outputs.iter().copied().chain(children).collect();
        (Arc::clone(&process.name), (process.status_buffer, outputs))
    };
    plan.processes.iter().map(of).collect()
}

/// The fault that a request asks for, and the indices of the buffers that hold it.
pub(crate) fn check(
    change: &rcs::Override,
    fault: &rcs::Fault,
    targets: &Targets,
    buffers: &[Arc<Buffer>],
) -> Result<(Fault, Vec<usize>), String> {
    use rcs::fault::Kind as Wanted;
    let delay_ns = || {
        let fits = fault.delay_ms > 0.0 && fault.delay_ms <= LONGEST_MS;
        fits.then_some((fault.delay_ms * 1e6) as u64).ok_or_else(|| {
            format!("the delay is {} ms; expected more than 0, at most {LONGEST_MS}", fault.delay_ms)
        })
    };
    let kind = match fault.kind() {
        Wanted::None => return Err("the fault has no kind".to_owned()),
        Wanted::Stopped => FaultKind::Stopped,
        Wanted::Slowed => FaultKind::Slowed { delay_ns: delay_ns()? },
        Wanted::Frozen => FaultKind::Frozen,
        Wanted::Nan => FaultKind::Nan { path: change.path.clone() },
        Wanted::Dropped => FaultKind::Dropped { loss: loss(fault)?, seen: 0 },
        Wanted::Late => FaultKind::Late { delay_ns: delay_ns()? },
    };
    let of_process = matches!(kind, FaultKind::Stopped | FaultKind::Slowed { .. });
    if fault.kind() != Wanted::Nan && !change.path.is_empty() {
        return Err(format!("a fault that is {} has no field", word(fault.kind())));
    }
    let fault = Fault { kind, process: change.process.as_str().into() };
    let indices = match (change.process.as_str(), change.buffer.as_str()) {
        ("", "") => return Err("it names no process and no buffer".to_owned()),
        ("", _) if of_process => return Err("a process is stopped or slowed, not a buffer".to_owned()),
        ("", name) => {
            let index = buffers.iter().position(|buffer| buffer.name() == name);
            vec![index.ok_or_else(|| format!("there is no buffer {name}"))?]
        }
        (_, name) if !name.is_empty() => {
            return Err("it names a process and a buffer; expected one of them".to_owned());
        }
        (process, _) => {
            let (status, outputs) =
                targets.get(process).ok_or_else(|| format!("there is no process {process}"))?;
            if of_process { vec![*status] } else { outputs.clone() }
        }
    };
    if let FaultKind::Nan { path } = &fault.kind {
        let path: FieldPath = path.parse().map_err(|error| format!("{error}"))?;
        let fits = |&index: &usize| can_be_nan(buffers[index].spec().schema.descriptor(), &path);
        if !indices.iter().any(fits) {
            let mut types: Vec<&str> =
                indices.iter().map(|&index| buffers[index].spec().schema.name()).collect();
            types.sort_unstable();
            types.dedup();
            return Err(format!(
                "it has no floating-point number that could be NaN; expected a field of {} that is or holds one",
                types.join(" or ")
            ));
        }
    }
    if let FaultKind::Late { .. } = fault.kind {
        let is_written = |index: &usize| {
            targets.values().any(|(status, outputs)| status == index || outputs.contains(index))
        };
        if !indices.iter().all(is_written) {
            return Err("no process writes it: only messages of processes can be late".to_owned());
        }
    }
    Ok((fault, indices))
}

fn loss(fault: &rcs::Fault) -> Result<Loss, String> {
    match (fault.every, fault.probability) {
        (0, 0.0) => Ok(Loss::Every(1)),
        (every, 0.0) => Ok(Loss::Every(every)),
        (0, probability) if probability > 0.0 && probability <= 1.0 => {
            Ok(Loss::Random { probability, seed: fault.seed })
        }
        (0, probability) => Err(format!("the probability is {probability}; expected 0 to 1")),
        _ => {
            Err("the fault drops every so many messages, or with a probability; expected one of them"
                .to_owned())
        }
    }
}

/// Whether a field of a type, or a part of it, is a floating-point number. Without a descriptor it may be.
fn can_be_nan(descriptor: Option<&MessageDescriptor>, path: &FieldPath) -> bool {
    let Some(mut message) = descriptor.cloned() else { return true };
    for segment in path.segments() {
        let Segment::Field(name) = segment else { continue };
        let Some(field) = message.get_field_by_name(name) else { return false };
        match field.kind() {
            Kind::Message(inner) => message = inner,
            kind => return matches!(kind, Kind::Double | Kind::Float),
        }
    }
    has_float(&message, &mut Vec::new())
}

fn has_float(message: &MessageDescriptor, seen: &mut Vec<String>) -> bool {
    // Cells, points and pixels are bytes, and each message says whether they hold floating-point numbers.
    let has = |name: &str| message.get_field_by_name(name).is_some();
    if has("data") && (has("encoding") || has("fields")) {
        return true;
    }
    if seen.iter().any(|name| name == message.full_name()) {
        return false;
    }
    seen.push(message.full_name().to_owned());
    message.fields().any(|field| match field.kind() {
        Kind::Double | Kind::Float => true,
        Kind::Message(inner) => has_float(&inner, seen),
        _ => false,
    })
}

/// The fault in words: `slowed by 200 ms`.
pub(crate) fn text(kind: &FaultKind) -> String {
    let ms = |delay_ns: u64| delay_ns as f64 * 1e-6;
    match kind {
        FaultKind::Stopped => "stopped".to_owned(),
        FaultKind::Slowed { delay_ns } => format!("slowed by {} ms", ms(*delay_ns)),
        FaultKind::Frozen => "frozen".to_owned(),
        FaultKind::Nan { path } if path.is_empty() => "NaN".to_owned(),
        FaultKind::Nan { path } => format!("NaN in {path}"),
        FaultKind::Dropped { loss: Loss::Every(1), .. } => "dropped".to_owned(),
        FaultKind::Dropped { loss: Loss::Every(every), .. } => format!("one of {every} dropped"),
        FaultKind::Dropped { loss: Loss::Random { probability, .. }, .. } => {
            format!("{} % dropped", probability * 100.0)
        }
        FaultKind::Late { delay_ns } => format!("{} ms late", ms(*delay_ns)),
    }
}

/// The name of a kind, as the command line writes it.
fn word(kind: rcs::fault::Kind) -> String {
    kind.as_str_name().to_lowercase()
}

/// What a request of the operator does, for the list of events: `wm1 frozen`.
pub(crate) fn told(change: &rcs::Override) -> Option<String> {
    let fault = change.fault.as_ref()?;
    let target = if change.process.is_empty() { &change.buffer } else { &change.process };
    let what = word(fault.kind());
    Some(match change.mode() {
        rcs::r#override::Mode::Release => format!("fault ends: {target} {what}"),
        _ => {
            format!("fault begins: {target} {what}{}", if change.path.is_empty() { "" } else { &change.path })
        }
    })
}
