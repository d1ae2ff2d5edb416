//! `ocu export`: writes fields of a recording, and formulas over them, as a table of text or in the format Parquet.

use crate::cli::ExportArgs;
use crate::output::{self, Files};
use crate::parquet::parquet;
use crate::{Ended, stacks, usage};
use anyhow::Context as _;
use ocu_ui::format;
use rcs_formula::{FieldRef, Formula, Over, Points};
use rcs_runtime::source::{FieldSeries, exact_points, read_fields};
use std::io::Write;

/// Writes the table named on the command line.
pub fn export(args: &ExportArgs, out: &mut dyn Write) -> anyhow::Result<Ended> {
    let mut files = Files::new(args.force);
    files.reads_log("the recording that is read", &args.log);
    files.writes("--output", &args.output)?;
    let formulas: Vec<Formula> = args
        .fields
        .iter()
        .map(|text| text.parse())
        .collect::<Result<_, _>>()
        .map_err(|error| usage(format!("{error}")))?;
    let log = stacks::open_log(&args.log)?;
    let info = log.info();
    let length_s = info.end.seconds_since(info.start);
    let to_s = args.to.unwrap_or(length_s);
    if args.from > to_s {
        return Err(usage(format!("--from is {} s; expected at most --to, {to_s} s", args.from)));
    }
    let at = |seconds: f64| info.start.after_ns((seconds * 1e9).round() as u64);
    let times = at(args.from)..=args.to.map_or(info.end, at);

    let mut fields: Vec<FieldRef> = formulas.iter().flat_map(|formula| formula.fields().to_vec()).collect();
    fields.sort_unstable();
    fields.dedup();
    let series = read_fields(&log, &fields, times.clone());
    if let Some(wrong) = series.iter().find(|series| series.problem.is_some() && series.points.is_empty()) {
        let problem = wrong.problem.as_deref().unwrap_or_default();
        return Err(usage(format!("{}: {problem}: {}", wrong.field, args.log.display())));
    }
    let mut columns: Vec<(String, Points)> = Vec::new();
    for (formula, text) in formulas.iter().zip(&args.fields) {
        let of = |field: &FieldRef| series.iter().find(|series| series.field == *field);
        let points = if let Some(alone) = formula.as_field().and_then(of) {
            exact_points(&log, alone, &times)
        } else {
            let inputs: Vec<Points> =
                formula.fields().iter().filter_map(|field| of(field).map(FieldSeries::all)).collect();
            formula.eval(&inputs).map_err(|error| usage(format!("{error}")))?
        };
        if points.over == Over::Frequency {
            return Err(usage(format!("{text} is over frequency; expected a formula over time")));
        }
        columns.push((text.clone(), points));
    }
    let named: Vec<(String, &Points)> = columns.iter().map(|(name, points)| (name.clone(), points)).collect();
    let is_parquet = args.output.extension().is_some_and(|extension| extension == "parquet");
    let bytes = if is_parquet {
        parquet(&named, &times, info.start).context("the table cannot be written")?
    } else {
        rcs_formula::csv(&named, &times, info.start).into_bytes()
    };
    output::write(&args.output, &bytes, args.force)?;
    for (name, points) in &columns {
        writeln!(out, "{name}: {} values", format::count(points.len() as u64))?;
    }
    for series in &series {
        if let Some(problem) = &series.problem {
            writeln!(out, "{}: {problem}", series.field)?;
        }
    }
    // Includes damage found while reading.
    for problem in log.problems() {
        writeln!(out, "{problem}")?;
    }
    Ok(if log.problems().is_empty() { Ended::Well } else { Ended::Damaged })
}
