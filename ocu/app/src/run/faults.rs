//! Faults on demand of a run without a window: `--fault wm1:frozen@10..12`, or a TOML file with a list `[[fault]]`.
//!
//! Each one becomes two acts of the operator, its begin and its end, which the run journals.

use super::acts::Act;
use crate::assets::read_text;
use crate::usage;
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
    delay_ms: f64,
    /// Of `dropped`: one of so many, or with this probability and seed.
    every: u32,
    probability: f64,
    seed: u64,
    /// The field that becomes NaN; all numbers by default.
    field: String,
    /// When it begins and ends, seconds from the start of the run.
    from_s: f64,
    to_s: Option<f64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Entries {
    fault: Vec<Entry>,
}

/// The acts that begin and end the faults of the command line: each is a text, or the path of a TOML file.
pub(crate) fn acts(texts: &[String], plan: &Plan) -> anyhow::Result<Vec<Act>> {
    let mut acts = Vec::new();
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
            acts.extend(entry.acts(plan).map_err(|error| usage(format!("the fault {text}: {error}")))?);
        }
    }
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
        ("slowed" | "late", Some(value)) => entry.delay_ms = number(value)?,
        ("nan", Some(field)) => field.clone_into(&mut entry.field),
        ("dropped", Some(value)) => match value.split_once('/') {
            Some(("1", every)) => entry.every = every.parse().map_err(|_| expected())?,
            Some(_) => return Err(expected()),
            None => entry.probability = number(value)?,
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
    /// Its begin and its end.
    fn acts(&self, plan: &Plan) -> Result<Vec<Act>, String> {
        let kinds = [Kind::Stopped, Kind::Slowed, Kind::Frozen, Kind::Nan, Kind::Dropped, Kind::Late]
            .map(|kind| (name(kind), kind));
        let kind = kinds.iter().find(|(name, _)| *name == self.kind).map(|(_, kind)| *kind);
        let kind = kind.ok_or_else(|| {
            let names: Vec<&str> = kinds.iter().map(|(name, _)| name.as_str()).collect();
            format!("its kind is {:?}; expected one of {}", self.kind, names.join(", "))
        })?;
        let known = match (self.process.as_str(), self.buffer.as_str()) {
            ("", "") => return Err("it names no process and no buffer".to_owned()),
            ("", buffer) => plan.buffers.iter().any(|known| known.spec.name == buffer),
            (process, _) => plan.processes.iter().any(|known| &*known.name == process),
        };
        if !known {
            return Err(format!("the stack has no {}{}", self.process, self.buffer));
        }
        let at_ns = |seconds: f64| {
            let good = seconds.is_finite() && (0.0..=1e6).contains(&seconds);
            good.then(|| (seconds * 1e9).round() as u64)
                .ok_or_else(|| format!("its time is {seconds} s; expected 0 to 1e6"))
        };
        let (from_ns, to_ns) = (at_ns(self.from_s)?, self.to_s.map(at_ns).transpose()?);
        if to_ns.is_some_and(|to_ns| to_ns <= from_ns) {
            return Err("it ends before it begins".to_owned());
        }
        let set = rcs::Override {
            mode: Mode::Hold.into(),
            process: self.process.clone(),
            buffer: self.buffer.clone(),
            path: self.field.clone(),
            fault: Some(rcs::Fault {
                kind: kind.into(),
                delay_ms: self.delay_ms,
                every: self.every,
                probability: self.probability,
                seed: self.seed,
            }),
            ..rcs::Override::default()
        };
        let end = rcs::Override { mode: Mode::Release.into(), ..set.clone() };
        let act = |at_ns: u64, change: rcs::Override| Act {
            at_ns,
            event: ExternalEvent::operator(OVERRIDE, AnyMessage::new(change)),
            fields: Vec::new(),
        };
        Ok([Some(act(from_ns, set)), to_ns.map(|to_ns| act(to_ns, end))].into_iter().flatten().collect())
    }
}

/// The name of a kind in a file and on the command line.
fn name(kind: Kind) -> String {
    kind.as_str_name().to_lowercase()
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
            ("wm1:slowed=200@1.5", Entry { delay_ms: 200.0, from_s: 1.5, ..of("wm1", "slowed") }),
            ("/a/b:nan=.x.y", Entry { field: ".x.y".to_owned(), ..on("/a/b", "nan") }),
            ("/a/b:dropped=1/3", Entry { every: 3, ..on("/a/b", "dropped") }),
            ("/a/b:dropped=0.25", Entry { probability: 0.25, ..on("/a/b", "dropped") }),
            ("/a/b:late=40", Entry { delay_ms: 40.0, ..on("/a/b", "late") }),
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
}
