//! Faults on demand of a run without a window: `--fault wm1:frozen@10..12`, or a TOML file with a list `[[fault]]`.
//!
//! Each one becomes two acts of the operator, its begin and its end, which the run journals. The end of a fault ends all of
//! its kind and target, so that two of these may not overlap.

use super::acts::{Act, LATEST_S, fault_name, kind_name, seconds_ns};
use crate::assets::read_text;
use crate::usage;
use ocu_ui::format;
use rcs_msg::rcs::fault::Kind;
use rcs_msg::rcs::r#override::Mode;
use rcs_msg::{AnyMessage, rcs};
use rcs_runtime::{ExternalEvent, Plan};
use serde::Deserialize;
use std::path::Path;

/// Buffer of the requests.
const OVERRIDE: &str = "/runtime/override";

/// One fault: an entry of the file.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct Entry {
    /// The process, or the buffer.
    process: String,
    buffer: String,
    /// `stopped`, `slowed`, `frozen`, `nan`, `dropped` or `late`.
    kind: String,
    /// Delay of `slowed` and `late`, ms.
    delay_ms: Option<f64>,
    /// Of `dropped`: one of so many, or with this probability and seed; all messages by default.
    every: Option<u32>,
    probability: Option<f64>,
    seed: Option<u64>,
    /// The field that becomes NaN; all numbers by default.
    field: Option<String>,
    /// When it begins and ends, seconds from the start of the run.
    from_s: f64,
    to_s: Option<f64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Entries {
    fault: Vec<Entry>,
}

/// The acts that begin and end the faults of the command line, sorted by time: each is a text, or the path of a TOML file.
pub(crate) fn acts(texts: &[String], plan: &Plan) -> anyhow::Result<Vec<Act>> {
    let mut faults: Vec<Fault> = Vec::new();
    for text in texts {
        let path = Path::new(text);
        let is_file = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("toml"));
        let entries = if is_file {
            let refused = |what: String| usage(format!("the faults cannot be read: {what}: {text}"));
            let file = read_text(path).map_err(refused)?;
            toml::from_str::<Entries>(&file).map_err(|error| refused(error.to_string()))?.fault
        } else {
            vec![parse(text).map_err(usage)?]
        };
        for entry in entries {
            let refused = |error: String| usage(format!("the fault {text}: {error}"));
            let Some(fault) = entry.checked(plan).map_err(refused)? else { continue };
            if let Some(other) = faults.iter().find(|other| fault.overlaps(other)) {
                return Err(refused(fault.overlap_with(other)));
            }
            faults.push(fault);
        }
    }
    // A fault may end when another one of its kind begins: at one time, ends come first.
    let ends = faults.iter().filter_map(Fault::end);
    let mut acts: Vec<Act> = ends.chain(faults.iter().map(Fault::begin)).collect();
    acts.sort_by_key(|act| act.at_ns);
    Ok(acts)
}

/// A fault as `TARGET:KIND[=VALUE][@FROM[..TO]]`.
fn parse(text: &str) -> Result<Entry, String> {
    let expected = || {
        format!(
            "expected TARGET:KIND[=VALUE][@FROM[..TO]] with a process or a buffer and stopped, slowed=MS, frozen, \
             nan[=FIELD], dropped[=1/N or =PROBABILITY] or late=MS, or a file that ends with .toml, got {text:?}"
        )
    };
    let (what, when) = text.rsplit_once('@').map_or((text, None), |(what, when)| (what, Some(when)));
    let (target, kind) = what.split_once(':').ok_or_else(expected)?;
    let (kind, value) = kind.split_once('=').map_or((kind, None), |(kind, value)| (kind, Some(value)));
    let number = |text: &str| text.trim().parse::<f64>().map_err(|_| expected());
    let mut entry = Entry { kind: kind.to_owned(), ..Entry::default() };
    if target.starts_with('/') { &mut entry.buffer } else { &mut entry.process }.push_str(target);
    match (kind, value) {
        ("slowed" | "late", Some(value)) => entry.delay_ms = Some(number(value)?),
        ("nan", Some(field)) => entry.field = Some(field.to_owned()),
        ("dropped", Some(value)) => match value.split_once('/') {
            Some(("1", every)) => entry.every = Some(every.parse().map_err(|_| expected())?),
            Some(_) => return Err(expected()),
            None => entry.probability = Some(number(value)?),
        },
        ("slowed" | "late", None) | (_, Some(_)) => return Err(expected()),
        (_, None) => {}
    }
    if let Some(when) = when {
        let (from, to) = when.split_once("..").map_or((when, None), |(from, to)| (from, Some(to)));
        entry.from_s = number(from)?;
        entry.to_s = to.map(number).transpose()?;
    }
    Ok(entry)
}

impl Entry {
    /// The fault, checked against the stack; `None` if it drops messages with a probability of 0.
    fn checked(&self, plan: &Plan) -> Result<Option<Fault>, String> {
        let kinds = [Kind::Stopped, Kind::Slowed, Kind::Frozen, Kind::Nan, Kind::Dropped, Kind::Late]
            .map(|kind| (kind_name(kind), kind));
        let kind = kinds.iter().find(|(name, _)| *name == self.kind).map(|(_, kind)| *kind);
        let kind = kind.ok_or_else(|| {
            let names: Vec<&str> = kinds.iter().map(|(name, _)| name.as_str()).collect();
            format!("its kind is {:?}; expected one of {}", self.kind, names.join(", "))
        })?;
        self.check_values(kind)?;
        let known = match (self.process.as_str(), self.buffer.as_str()) {
            ("", "") => return Err("it names no process and no buffer".to_owned()),
            ("", buffer) => plan.buffers.iter().any(|known| known.spec.name == buffer),
            (process, _) => plan.processes.iter().any(|known| &*known.name == process),
        };
        if !known {
            return Err(format!("the stack has no {}{}", self.process, self.buffer));
        }
        let at_ns = |seconds: f64| {
            let refused = || format!("its time is {seconds} s; expected 0 to {LATEST_S:e}");
            seconds_ns(seconds).ok_or_else(refused)
        };
        let (from_ns, to_ns) = (at_ns(self.from_s)?, self.to_s.map(at_ns).transpose()?);
        if to_ns.is_some_and(|to_ns| to_ns <= from_ns) {
            return Err("it ends before it begins".to_owned());
        }
        // In a request, a probability of 0 stands for all messages.
        if self.probability == Some(0.0) {
            return Ok(None);
        }
        let request = rcs::Override {
            mode: Mode::Hold.into(),
            process: self.process.clone(),
            buffer: self.buffer.clone(),
            path: self.field.clone().unwrap_or_default(),
            fault: Some(rcs::Fault {
                kind: kind.into(),
                delay_ms: self.delay_ms.unwrap_or_default(),
                every: self.every.unwrap_or_default(),
                probability: self.probability.unwrap_or_default(),
                seed: self.seed.unwrap_or_default(),
            }),
            ..rcs::Override::default()
        };
        Ok(Some(Fault { request, from_ns, to_ns }))
    }

    /// Refuses values that a fault of its kind does not have, and a share of messages that is told twice or cannot be.
    fn check_values(&self, kind: Kind) -> Result<(), String> {
        let values = [
            ("delay_ms", self.delay_ms.is_some(), matches!(kind, Kind::Slowed | Kind::Late)),
            ("every", self.every.is_some(), kind == Kind::Dropped),
            ("probability", self.probability.is_some(), kind == Kind::Dropped),
            ("seed", self.seed.is_some(), kind == Kind::Dropped),
            ("field", self.field.is_some(), kind == Kind::Nan),
        ];
        if let Some((value, ..)) = values.iter().find(|(_, is_given, is_known)| *is_given && !is_known) {
            return Err(format!("it has {value}, which a fault that is {} does not have", self.kind));
        }
        match (self.every, self.probability) {
            (Some(_), Some(_)) => Err("it has every and probability; expected one of them".to_owned()),
            (Some(0), None) => Err("one of 0 messages is dropped; expected one of at least 1".to_owned()),
            _ => Ok(()),
        }
    }
}

/// A fault that fits the stack, with its begin and end in nanoseconds from the start of the run; without an end, it lasts
/// as long as the run.
struct Fault {
    /// What begins it.
    request: rcs::Override,
    from_ns: u64,
    to_ns: Option<u64>,
}

impl Fault {
    /// What the end of a fault names: kind, process, buffer, and the field that is NaN.
    fn target(&self) -> (Option<Kind>, [&str; 3]) {
        let rcs::Override { process, buffer, path, fault, .. } = &self.request;
        (fault.as_ref().map(rcs::Fault::kind), [process.as_str(), buffer.as_str(), path.as_str()])
    }

    /// Whether both are of one kind and target and in force at one time, so that the end of one would end the other.
    fn overlaps(&self, other: &Self) -> bool {
        let lasts_into = |one: &Self, next: &Self| one.to_ns.is_none_or(|to_ns| to_ns > next.from_ns);
        self.target() == other.target() && lasts_into(self, other) && lasts_into(other, self)
    }

    /// Says that it overlaps another one.
    fn overlap_with(&self, other: &Self) -> String {
        let [from_s, other_s] = [self, other].map(|fault| format::number(fault.from_ns as f64 * 1e-9));
        format!(
            "{} from {from_s} s overlaps the one from {other_s} s; expected one to end before the other begins",
            fault_name(&self.request)
        )
    }

    fn begin(&self) -> Act {
        act(self.from_ns, self.request.clone())
    }

    fn end(&self) -> Option<Act> {
        let release = rcs::Override { mode: Mode::Release.into(), ..self.request.clone() };
        self.to_ns.map(|to_ns| act(to_ns, release))
    }
}

fn act(at_ns: u64, request: rcs::Override) -> Act {
    let event = ExternalEvent::operator(OVERRIDE, AnyMessage::new(request));
    Act { at_ns, repeated: None, event, fields: Vec::new() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fault_is_a_target_a_kind_and_a_time() {
        let entry = |kind: &str| Entry { kind: kind.to_owned(), ..Entry::default() };
        let of = |process: &str, kind: &str| Entry { process: process.to_owned(), ..entry(kind) };
        let on = |buffer: &str, kind: &str| Entry { buffer: buffer.to_owned(), ..entry(kind) };
        for (text, expected) in [
            ("wm1:stopped", of("wm1", "stopped")),
            ("wm1:frozen@10..12", Entry { from_s: 10.0, to_s: Some(12.0), ..of("wm1", "frozen") }),
            ("wm1:slowed=200@1.5", Entry { delay_ms: Some(200.0), from_s: 1.5, ..of("wm1", "slowed") }),
            ("/a/b:nan=.x.y", Entry { field: Some(".x.y".to_owned()), ..on("/a/b", "nan") }),
            ("/a/b:dropped=1/3", Entry { every: Some(3), ..on("/a/b", "dropped") }),
            ("/a/b:dropped=0.25", Entry { probability: Some(0.25), ..on("/a/b", "dropped") }),
            ("/a/b:late=40", Entry { delay_ms: Some(40.0), ..on("/a/b", "late") }),
        ] {
            assert_eq!(parse(text), Ok(expected), "{text}");
        }
        for text in ["wm1", "wm1:slowed", "wm1:late=fast", "wm1:frozen=1", "wm1:stopped@x", "wm1:dropped=2/3"]
        {
            assert!(parse(text).unwrap_err().contains("expected TARGET:KIND"), "{text}");
        }
    }

    #[test]
    fn a_file_lists_faults() {
        let text = "[[fault]]\nprocess = \"wm1\"\nkind = \"slowed\"\ndelay_ms = 200\nfrom_s = 3\n";
        let read = toml::from_str::<Entries>(text).unwrap().fault;
        assert_eq!(read, [parse("wm1:slowed=200@3").unwrap()]);
        assert!(toml::from_str::<Entries>("[[fault]]\ncolour = 1\n").is_err());
    }

    fn plan() -> std::sync::Arc<Plan> {
        crate::stacks::plan("truth_driver", Some("meadow"), &[]).unwrap()
    }

    #[test]
    fn a_probability_of_zero_drops_nothing_and_values_that_a_kind_does_not_have_are_refused() {
        let plan = plan();
        let is_fault = |entry: Entry| entry.checked(&plan).map(|fault| fault.is_some());
        let of_text = |text: &str| is_fault(parse(text).unwrap());
        assert_eq!(of_text("/truth_driver/drive:dropped"), Ok(true));
        assert_eq!(of_text("/truth_driver/drive:dropped=0.5"), Ok(true));
        assert_eq!(of_text("/truth_driver/drive:dropped=0"), Ok(false));
        assert!(of_text("/truth_driver/drive:dropped=1/0").unwrap_err().contains("at least 1"));
        for (values, part) in [
            ("kind = \"frozen\"\nevery = 3", "it has every"),
            ("kind = \"dropped\"\ndelay_ms = 50", "it has delay_ms"),
            ("kind = \"dropped\"\nevery = 3\nprobability = 0.0", "expected one of them"),
        ] {
            let text = format!("[[fault]]\nprocess = \"truth_driver\"\n{values}\n");
            let entry = toml::from_str::<Entries>(&text).unwrap().fault.remove(0);
            let refused = is_fault(entry).unwrap_err();
            assert!(refused.contains(part), "{values}: {refused}");
        }
    }

    #[test]
    fn faults_of_one_kind_and_target_do_not_overlap_and_one_may_begin_when_another_ends() {
        let plan = plan();
        let acts_of = |texts: [&str; 2]| acts(&texts.map(str::to_owned), &plan);
        let overlapping = ["truth_driver:slowed=100@0..10", "truth_driver:slowed=300@5..20"];
        let refused = acts_of(overlapping).unwrap_err().to_string();
        assert!(refused.contains("truth_driver:slowed from 5 s overlaps the one from 0 s"), "{refused}");
        let ordered = acts_of(["truth_driver:frozen@10..12", "truth_driver:frozen@5..10"]).unwrap();
        let told = ordered.iter().map(|act| {
            let mode = act.event.message.get::<rcs::Override>().unwrap().mode();
            (act.at_ns / 1_000_000_000, mode)
        });
        let expected = [(5, Mode::Hold), (10, Mode::Release), (10, Mode::Hold), (12, Mode::Release)];
        assert_eq!(told.collect::<Vec<_>>(), expected);
        // Others may overlap.
        assert!(acts_of(["truth_driver:frozen@5", "truth_driver:slowed=100@5"]).is_ok());
        assert!(acts_of(["truth_driver:nan=.x@5", "truth_driver:nan=.y@5"]).is_ok());
    }
}
