//! Faults on demand of a run without a window: `--fault wm1:frozen@10..12`, or a TOML file with a list `[[fault]]`.
//!
//! Each one becomes two acts of the operator, its begin and its end, which the run journals. The end of a fault ends all of
//! its kind and target, so that two of these may not overlap.

use super::acts::{Act, LATEST_S, fault_name, kind_name, seconds_ns};
use crate::assets::read_text;
use crate::nearest::nearest;
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
        let refused = |error: String| usage(format!("the fault {text}: {error}"));
        let path = Path::new(text);
        let is_file = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("toml"));
        let entries = if is_file {
            let unread = |what: String| usage(format!("the faults cannot be read: {what}: {text}"));
            let file = read_text(path).map_err(unread)?;
            toml::from_str::<Entries>(&file).map_err(|error| unread(error.to_string()))?.fault
        } else {
            vec![parse(text).map_err(refused)?]
        };
        for entry in entries {
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

/// A fault as `TARGET:KIND[=VALUE][@FROM[..TO]]`. An error says which part is wrong, and what that must be.
fn parse(text: &str) -> Result<Entry, String> {
    let (what, when) = text.rsplit_once('@').map_or((text, None), |(what, when)| (what, Some(when)));
    let (target, kind) = what.split_once(':').ok_or(
        "expected TARGET:KIND[=VALUE][@FROM[..TO]] with a process or a buffer and stopped, slowed=MS, frozen, \
         nan[=FIELD], dropped[=1/N or =PROBABILITY] or late=MS, or a file that ends with .toml",
    )?;
    let (kind, value) = kind.split_once('=').map_or((kind, None), |(kind, value)| (kind, Some(value)));
    let number =
        |text: &str, needed: &str| text.trim().parse::<f64>().map_err(|_| format!("{needed}, got {text:?}"));
    let mut entry = Entry { kind: kind.to_owned(), ..Entry::default() };
    if target.starts_with('/') { &mut entry.buffer } else { &mut entry.process }.push_str(target);
    match (kind, value) {
        ("slowed" | "late", value) => {
            let needed = format!("{kind} needs milliseconds, such as {kind}=200");
            entry.delay_ms = Some(number(value.ok_or_else(|| needed.clone())?, &needed)?);
        }
        ("nan", Some(field)) => entry.field = Some(field.to_owned()),
        ("dropped", Some(value)) => {
            let needed = "dropped needs a share of the messages, such as dropped=1/3 or dropped=0.2";
            match value.strip_prefix("1/").map(str::parse::<u32>) {
                Some(every) => entry.every = Some(every.map_err(|_| format!("{needed}, got {value:?}"))?),
                None => entry.probability = Some(number(value, needed)?),
            }
        }
        ("stopped" | "frozen", Some(value)) => return Err(format!("{kind} has no value, got {value:?}")),
        // Whether there is such a kind is checked with the stack.
        _ => {}
    }
    if let Some(when) = when {
        let (from, to) = when.split_once("..").map_or((when, None), |(from, to)| (from, Some(to)));
        let seconds = |text: &str| number(text, "a time is in seconds, such as @10 or @10..12");
        entry.from_s = seconds(from)?;
        entry.to_s = to.map(seconds).transpose()?;
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
            return Err(self.unknown(plan));
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

    /// Says that the stack does not have its target, and what has a similar name.
    fn unknown(&self, plan: &Plan) -> String {
        let buffers = plan.buffers.iter().map(|known| known.spec.name.as_str());
        let processes = plan.processes.iter().map(|known| &*known.name);
        let (what, name, known): (&str, &str, Vec<&str>) = if self.process.is_empty() {
            ("buffer", self.buffer.as_str(), buffers.collect())
        } else {
            // A name without a slash may be meant for a buffer.
            ("process or buffer", self.process.as_str(), processes.chain(buffers).collect())
        };
        let nearest = nearest(name, &known);
        format!("the stack {} has no {what} {name}; the nearest names are {nearest}", plan.file.name())
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
    }

    #[test]
    fn a_fault_that_cannot_be_read_is_refused_with_the_part_that_is_wrong() {
        for (text, refused) in [
            ("wm1:slowed", "slowed needs milliseconds, such as slowed=200"),
            ("wm1:late=200ms@1", "late needs milliseconds, such as late=200, got \"200ms\""),
            ("wm1:frozen=1", "frozen has no value, got \"1\""),
            ("wm1:stopped@1..2s", "a time is in seconds, such as @10 or @10..12, got \"2s\""),
            (
                "wm1:dropped=2/3",
                "dropped needs a share of the messages, such as dropped=1/3 or dropped=0.2, got \"2/3\"",
            ),
        ] {
            assert_eq!(parse(text).unwrap_err(), refused);
        }
        assert!(parse("wm1").unwrap_err().starts_with("expected TARGET:KIND"));
    }

    #[test]
    fn a_target_that_the_stack_does_not_have_is_refused_with_the_names_that_are_nearest() {
        for (text, what, near) in [
            ("truth_drivr:frozen", "process or buffer truth_drivr", "truth_driver"),
            ("truth_driver/drive:frozen", "process or buffer truth_driver/drive", "/truth_driver/drive"),
            ("/truth_driver/driv:frozen", "buffer /truth_driver/driv", "/truth_driver/drive"),
        ] {
            let refused = acts(&[text.to_owned()], &plan()).unwrap_err().to_string();
            let says = format!("the stack truth_driver has no {what}; the nearest names are {near}, ");
            assert!(refused.contains(&says), "{refused}");
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
