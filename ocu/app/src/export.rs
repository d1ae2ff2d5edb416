//! `ocu export`: writes fields of a recording, and formulas over them, as a table of text or in the format Parquet.

use crate::cli::ExportArgs;
use crate::nearest::nearest;
use crate::output::{self, Files};
use crate::parquet::parquet;
use crate::{Ended, parts, stacks, usage};
use anyhow::Context as _;
use ocu_ui::format;
use rcs_formula::{FieldRef, Formula, Over, Points};
use rcs_log::{CursorOptions, Log};
use rcs_msg::{Segment, Stamp, Value};
use rcs_runtime::source::{FieldSeries, exact_points, read_fields};
use std::collections::BTreeSet;
use std::io::Write;
use std::ops::RangeInclusive;

/// Writes the table named on the command line.
pub fn export(args: &ExportArgs, out: &mut dyn Write) -> anyhow::Result<Ended> {
    let mut files = Files::new(args.force);
    files.reads_log("the recording that is read", &args.log);
    files.writes("--output", &args.output)?;
    let is_parquet = parts::has_ending(&args.output, "parquet");
    if !is_parquet && !parts::has_ending(&args.output, "csv") {
        let path = args.output.display();
        return Err(usage(format!("--output is {path}; expected a .csv or a .parquet file")));
    }
    let formulas: Vec<Formula> = args
        .fields
        .iter()
        .map(|text| text.parse())
        .collect::<Result<_, _>>()
        .map_err(|error| usage(format!("{error}")))?;
    if let Some(constant) = formulas.iter().find(|formula| formula.fields().is_empty()) {
        return Err(usage(format!("got {constant}, expected a formula with a field")));
    }
    // The text is the name of the column.
    let mut columns = BTreeSet::new();
    if let Some(twice) = args.fields.iter().find(|text| !columns.insert(text.as_str())) {
        return Err(usage(format!("--fields has {twice} twice; expected each column once")));
    }
    let log = stacks::open_log(&args.log)?;
    let info = log.info();
    check_fields(args, &log, &formulas)?;
    let length_s = info.end.seconds_since(info.start);
    let from_s = args.from;
    match args.to {
        Some(to_s) if from_s > to_s => {
            return Err(usage(format!("--from is {from_s} s; expected at most --to, {to_s} s")));
        }
        None if from_s > length_s => {
            let text = format!("--from is {from_s} s; expected at most {length_s:.3} s, where it ends");
            return Err(usage(text));
        }
        _ => {}
    }
    let at = |seconds: f64| info.start.after_ns((seconds * 1e9).round() as u64);
    let times = at(args.from)..=args.to.map_or(info.end, at);

    // What is computed depends on values outside of a range, too: an integral begins with the recording, and a state
    // holds until its next message.
    let whole = info.start..=info.end;
    let (computed, others): (Vec<&Formula>, Vec<&Formula>) =
        formulas.iter().partition(|formula| times != whole && formula.as_field().is_none());
    let inputs = read_fields(&log, &fields_of(&computed), whole);
    let series = read_fields(&log, &fields_of(&others), times.clone());
    let all = || inputs.iter().chain(&series);
    if let Some(wrong) = all().find(|series| series.problem.is_some() && series.points.is_empty()) {
        stacks::check_full(&log, &args.log)?;
        let problem = wrong.problem.as_deref().unwrap_or_default();
        let fields = fields_of_message(&log, &wrong.field);
        let fields = fields.map(|names| format!("; it has the fields {names}")).unwrap_or_default();
        return Err(usage(format!("{}: {problem}{fields}: {}", wrong.field, args.log.display())));
    }
    let mut columns: Vec<(String, Points)> = Vec::new();
    for (formula, text) in formulas.iter().zip(&args.fields) {
        let alone = formula.as_field().and_then(|field| series.iter().find(|series| series.field == *field));
        let points = if let Some(alone) = alone {
            exact_points(&log, alone, &times)
        } else {
            let of = |field: &FieldRef| all().find(|series| series.field == *field).map(FieldSeries::all);
            let values: Vec<Points> = formula.fields().iter().filter_map(of).collect();
            within(formula.eval(&values).map_err(|error| usage(format!("{error}")))?, &times)
        };
        if points.over == Over::Frequency {
            return Err(usage(format!("{text} is over frequency; expected a formula over time")));
        }
        columns.push((text.clone(), points));
    }
    let named: Vec<(String, &Points)> = columns.iter().map(|(name, points)| (name.clone(), points)).collect();
    let bytes = if is_parquet {
        parquet(&named, &times, info.start).context("the table cannot be written")?
    } else {
        rcs_formula::csv(&named, &times, info.start).into_bytes()
    };
    output::write(&args.output, &bytes, args.force)?;
    for ((name, points), formula) in columns.iter().zip(&formulas) {
        // The cell of a value that is not a number is empty.
        let values = points.values.iter().filter(|value| !value.is_nan()).count();
        let is_element = formula.as_field().is_some_and(has_index);
        let why = if values == 0 && is_element { "; no message has a value at this index" } else { "" };
        writeln!(out, "{name}: {} values{why}", format::count(values as u64))?;
    }
    let problem = |series: &FieldSeries| Some(format!("{}: {}", series.field, series.problem.as_deref()?));
    let mut problems: Vec<String> = all().filter_map(problem).collect();
    problems.sort_unstable();
    problems.dedup();
    for problem in &problems {
        writeln!(out, "{problem}")?;
    }
    // Includes damage found while reading.
    for problem in log.problems() {
        writeln!(out, "{problem}")?;
    }
    let is_whole = problems.is_empty() && log.problems().is_empty();
    Ok(if is_whole { Ended::Well } else { Ended::Damaged })
}

/// Refuses topics that the log does not have, and those without a field.
fn check_fields(args: &ExportArgs, log: &Log, formulas: &[Formula]) -> anyhow::Result<()> {
    let info = log.info();
    let mut fields = formulas.iter().flat_map(Formula::fields);
    if let Some(absent) = fields.clone().find(|field| info.topics_named(&field.topic).next().is_none()) {
        stacks::check_full(log, &args.log)?;
        let known: BTreeSet<&str> = info.topics.iter().map(|topic| topic.name.as_str()).collect();
        let known: Vec<&str> = known.into_iter().collect();
        let others = match nearest(&absent.topic, &known) {
            names if names.is_empty() => "it has none".to_owned(),
            names => format!("the nearest names are {names}"),
        };
        return Err(usage(format!("the log has no topic {}; {others}", absent.topic)));
    }
    let Some(whole) = fields.find(|field| is_whole(field)) else { return Ok(()) };
    let names = fields_of_message(log, whole).map(|names| format!(": {names}")).unwrap_or_default();
    Err(usage(format!("got the topic {}, expected a field of it{names}", whole.topic)))
}

/// The fields of these formulas, each once.
fn fields_of(formulas: &[&Formula]) -> Vec<FieldRef> {
    let mut fields: Vec<FieldRef> = formulas.iter().flat_map(|formula| formula.fields().to_vec()).collect();
    fields.sort_unstable();
    fields.dedup();
    fields
}

/// Whether a field is a topic without a field of it.
fn is_whole(field: &FieldRef) -> bool {
    field.path.segments().is_empty()
}

/// Whether a field is an element of a list, or is in one.
fn has_index(field: &FieldRef) -> bool {
    field.path.segments().iter().any(|segment| matches!(segment, Segment::Index(_)))
}

/// The fields of the message at the path of a field, in the first message of its topic; `None` if no message with fields is
/// there.
fn fields_of_message(log: &Log, field: &FieldRef) -> Option<String> {
    let topic = log.info().topics_named(&field.topic).next()?;
    let options = CursorOptions { topics: Some(vec![topic.id]), ..CursorOptions::default() };
    let first = log.cursor(options).find_map(Result::ok)?;
    let root = topic.schema.value(&first.data).ok()?;
    let found = root.get(&field.path).ok()?;
    let Value::Message(fields) = &*found else { return None };
    let names: Vec<&str> = fields.iter().map(|(name, _)| name.as_str()).collect();
    (!names.is_empty()).then(|| names.join(", "))
}

/// The points between two times.
fn within(points: Points, times: &RangeInclusive<Stamp>) -> Points {
    let from = points.stamps.partition_point(|stamp| stamp < times.start());
    let to = points.stamps.partition_point(|stamp| stamp <= times.end()).max(from);
    let (stamps, values) = (points.stamps[from..to].into(), points.values[from..to].into());
    Points { stamps, values, ..points }
}
