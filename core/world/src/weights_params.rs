//! Weights in the parameters of a process that fuses costs, found by the roles of the parameters: any process whose
//! parameters have a list with the roles `source`, `source_weight` and `source_kind`. Also which of these weights are
//! replaced by learned ones, and whether others can be learned from a drive (`source_kind`, `source_max_confidence`).

use crate::experience::SURE;
use crate::{Source, SourceKind, Weighted, Weights};
use rcs_msg::params::{ParamKind, ParamSpec, specs};
use rcs_msg::{AnyMessage, Value};

/// The type of messages of learned weights: an entry of their list `weights` has a source, its weight, and the weight
/// of the parameters from which that was learned (`source`, `weight`, `given`).
pub const LEARNED_WEIGHTS: &str = "rcs.FusionWeights";

/// Name of the list of sources, and of the fields of an entry: name, weight and kind of a source, and its highest confidence
/// in an obstacle, which a list may lack.
struct Names {
    list: String,
    name: String,
    weight: String,
    kind: String,
    max_confidence: Option<String>,
}

impl Names {
    fn kind_of(&self, item: &Value) -> SourceKind {
        match item.field(&self.kind).and_then(Value::as_i64) {
            Some(1) => SourceKind::Override,
            Some(2) => SourceKind::Learned,
            _ => SourceKind::Range,
        }
    }
}

fn names(specs: &[ParamSpec]) -> Option<Names> {
    specs.iter().filter(|spec| spec.kind == ParamKind::List).find_map(|spec| {
        let field = |role: &str| spec.fields.iter().find(|field| field.role == role).map(|f| f.name.clone());
        let (name, weight, kind) = (field("source")?, field("source_weight")?, field("source_kind")?);
        let max_confidence = field("source_max_confidence");
        Some(Names { list: spec.name.clone(), name, weight, kind, max_confidence })
    })
}

/// The weights that parameters give, those of the bundled sources if they list none; `None` if they are those of a process that fuses no costs. Sources whose names are
/// not valid are left out.
pub fn weights_of(params: &AnyMessage) -> Option<Weights> {
    let specs = specs(params.schema().descriptor()?);
    let names = names(&specs)?;
    let value = params.value().ok()?;
    let Value::List(items) = value.field(&names.list)? else { return None };
    let weighted = |item: &Value| {
        let source = Source::new(item.field(&names.name)?.as_text()?).ok()?;
        let weight = item.field(&names.weight).and_then(Value::as_f64).unwrap_or(0.0) as f32;
        Some(Weighted { source, weight, kind: names.kind_of(item) })
    };
    let mut weights: Weights =
        if items.is_empty() { Weights::default() } else { items.iter().filter_map(weighted).collect() };
    let least = specs.iter().find(|spec| spec.role == "least_evidence").map(|spec| &spec.name);
    if let Some(least) = least.and_then(|name| value.field(name)).and_then(Value::as_f64) {
        weights.least_evidence = least as f32;
    }
    Some(weights)
}

/// Why no drive with the parameters has judgements of some kind ([`crate::Experience`]): of cells that were driven
/// over, which only a touch tells, or of obstacles seen from near, of which a range sensor has to be sure; `None` where
/// a drive can have both.
pub fn never_judged(params: &AnyMessage) -> Option<String> {
    let names = names(&specs(params.schema().descriptor()?))?;
    let value = params.value().ok()?;
    let Value::List(items) = value.field(&names.list)? else { return None };
    // Without a list, the sources are the bundled ones.
    if items.is_empty() {
        return None;
    }
    let has_touch = items.iter().any(|item| names.kind_of(item) == SourceKind::Override);
    let untold =
        (!has_touch).then(|| "no source of kind SOURCE_OVERRIDE tells what was driven over".to_owned());
    let causes: Vec<String> = untold.into_iter().chain(never_sure(&names, items)).collect();
    (!causes.is_empty()).then(|| causes.join("; "))
}

/// Why no range sensor in a list of sources is ever sure of an obstacle; `None` where one can be.
fn never_sure(names: &Names, items: &[Value]) -> Option<String> {
    let max_confidence = names.max_confidence.as_ref()?;
    let ranges = items.iter().filter(|item| names.kind_of(item) == SourceKind::Range);
    match ranges.filter_map(|item| item.field(max_confidence)?.as_i64()).max() {
        None => Some("no source is a range sensor, which could be sure of an obstacle".to_owned()),
        Some(most) if most < i64::from(SURE) => Some(format!(
            "no range sensor can be sure of an obstacle: the greatest {max_confidence} is {most}, expected at least {SURE}"
        )),
        Some(_) => None,
    }
}

/// The field of the weight of a source, such as `sources[2].weight`; `None` if the parameters do not list the source.
pub fn weight_field(params: &AnyMessage, source: Source) -> Option<String> {
    let names = names(&specs(params.schema().descriptor()?))?;
    let value = params.value().ok()?;
    let Value::List(items) = value.field(&names.list)? else { return None };
    let is_it = |item: &Value| item.field(&names.name).and_then(Value::as_text) == Some(source.name());
    let place = items.iter().position(is_it)?;
    Some(format!("{}[{place}].{}", names.list, names.weight))
}

/// The fields of the weights that differ from those with which a map was fused, such as `sources[2].weight`, and the
/// weights of the map: ones that were learned, or those of parameters before these.
pub fn weights_beside(params: &AnyMessage, fused: &Weights) -> Vec<(String, f32)> {
    let Some(given) = weights_of(params) else { return Vec::new() };
    let of_map = |entry: &Weighted| fused.get(entry.source).weight;
    let differing = given.iter().filter(|entry| entry.weight != of_map(entry));
    differing.filter_map(|entry| Some((weight_field(params, entry.source)?, of_map(&entry)))).collect()
}

/// The fields of the weights that are replaced by learned ones, such as `sources[2].weight`; `learned` is a message of
/// the type [`LEARNED_WEIGHTS`]. A learned weight counts while the parameters have the weight from which it was learned.
pub fn weights_learned(params: &AnyMessage, learned: &AnyMessage) -> Vec<String> {
    let (Some(given), Ok(value)) = (weights_of(params), learned.value()) else { return Vec::new() };
    let Some(Value::List(entries)) = value.field("weights") else { return Vec::new() };
    let field = |entry: &Value| {
        let source = Source::new(entry.field("source")?.as_text()?).ok()?;
        let number = |name: &str| entry.field(name).and_then(Value::as_f64).unwrap_or(0.0) as f32;
        let from = number("given");
        let counts = number("weight") != from && given.get(source).weight == from;
        counts.then(|| weight_field(params, source)).flatten()
    };
    entries.iter().filter_map(field).collect()
}
