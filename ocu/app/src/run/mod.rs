//! `ocu run`: a stack to its end, in simulated time, with a summary.

use crate::cli::{RunArgs, Save};
use crate::runs::{self, RunReport};
use crate::table::{Align, Table};
use crate::{BUILD, stacks, usage};
use anyhow::Context as _;
use ocu_ui::format;
use rcs_log::Log;
use rcs_msg::Stamp;
use rcs_msg::rcs::ProcessState;
use rcs_runtime::{Plan, RecordOptions, Recording, RunOptions, Stepped, Summary};
use serde::Serialize;
use std::io::Write;
use std::sync::Arc;
use std::time::Instant;

/// How a run ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
enum Outcome {
    /// The recording ended, or the course was decided.
    End,
    /// The time that `--until` gives was reached.
    Timeout,
    /// A process ended in `ERROR`, or what was asked for could not be done to the end.
    Error,
}

/// `ocu run --json`.
#[derive(Debug, Serialize)]
struct Report {
    outcome: Outcome,
    time_s: f64,
    wall_s: f64,
    processes: Vec<ProcessReport>,
    buffers: Vec<BufferReport>,
    hash: String,
    /// Runs of a course, in order; the rest of the report is the last one's.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    runs: Vec<RunReport>,
}

#[derive(Debug, Serialize)]
struct ProcessReport {
    name: String,
    state: &'static str,
    cycles: u64,
    mean_us: f64,
    max_us: f64,
    overruns: u64,
}

#[derive(Debug, Serialize)]
struct BufferReport {
    name: String,
    schema: String,
    messages: u64,
    bytes: u64,
    hash: String,
}

/// Runs the stack, as often as it was asked for, and prints what came of it; `false` if a run failed.
pub fn run(args: &RunArgs, out: &mut dyn Write) -> anyhow::Result<bool> {
    let overrides: Vec<(String, String)> = args
        .params
        .iter()
        .map(|param| (format!("{}.{}", param.process, param.field), param.value.clone()))
        .collect();
    let plan = stacks::plan(&args.stack, args.course.as_deref(), &overrides)?;
    let log = args.log.as_ref().map(Log::open).transpose()?;
    let referee = runs::referee(&plan);
    if log.is_none() && args.until.is_none() && referee.is_none() {
        return Err(usage(
            "a stack without a recording runs on for ever: expected --log, --course or --until",
        ));
    }
    if args.course.is_some() && referee.is_none() {
        return Err(usage(format!(
            "the stack {} runs no course: nothing in it reports one",
            plan.file.name()
        )));
    }
    if let Some(save) = args.save.iter().find(|save| !has_buffer(&plan, &save.buffer)) {
        return Err(usage(format!(
            "there is no buffer {} to save in the stack {}",
            save.buffer,
            plan.file.name()
        )));
    }
    let mut runs = Vec::new();
    let mut done = Done::run(args, &plan, log.as_ref(), referee, args.seed)?;
    runs.extend(done.verdict.take());
    for more in 1..args.runs {
        if done.failure.is_some() {
            break;
        }
        done = Done::run(args, &plan, log.as_ref(), referee, args.seed + u64::from(more))?;
        runs.extend(done.verdict.take());
    }
    let report = Report { runs, ..done.report };
    if args.json {
        serde_json::to_writer_pretty(&mut *out, &report).context("cannot write the report")?;
        writeln!(out)?;
    } else {
        human(&report, out)?;
    }
    match done.failure {
        Some(error) => Err(error),
        None => Ok(report.outcome != Outcome::Error),
    }
}

fn has_buffer(plan: &Plan, name: &str) -> bool {
    plan.buffers.iter().any(|buffer| buffer.spec.name == name)
}

/// One run, done.
struct Done {
    report: Report,
    verdict: Option<RunReport>,
    failure: Option<anyhow::Error>,
}

impl Done {
    fn run(
        args: &RunArgs,
        plan: &Arc<Plan>,
        log: Option<&Log>,
        referee: Option<usize>,
        seed: u64,
    ) -> anyhow::Result<Self> {
        let base = stacks::options();
        let threads = args.threads.map_or(base.threads, usize::from);
        let options = RunOptions { seed, threads, hash: true, ..base };
        let clock = Instant::now();
        let mut run = Stepped::new(Arc::clone(plan), log, options).context("the stack cannot run")?;
        let recording = match &args.record {
            Some(path) => {
                let options =
                    RecordOptions { lossless: true, build: BUILD.to_owned(), ..RecordOptions::default() };
                Some(Recording::start(path, run.plan(), run.buffers(), &options)?)
            }
            None => None,
        };
        let (outcome, mut failure) = match to_the_end(&mut run, args.until, referee) {
            Ok(outcome) => (outcome, None),
            Err(error) => (Outcome::Error, Some(error)),
        };
        if let Some(recording) = recording
            && let Err(error) = recording.finish_at(run.now())
        {
            failure.get_or_insert(error.into());
        }
        if let Err(error) = save(&run, &args.save) {
            failure.get_or_insert(error);
        }
        let outcome = if failure.is_some() { Outcome::Error } else { outcome };
        let report = report(run.summary(), outcome, clock.elapsed().as_secs_f64());
        let verdict = referee
            .and_then(|referee| runs::verdict(&run.buffers()[referee]))
            .map(|verdict| RunReport::new(seed, &verdict, report.hash.clone()));
        Ok(Self { report, verdict, failure })
    }
}

/// Writes the newest messages of the buffers that `--save` names.
fn save(run: &Stepped, saves: &[Save]) -> anyhow::Result<()> {
    for Save { buffer, path } in saves {
        let newest = run.buffers().iter().find(|candidate| candidate.name() == buffer);
        let sample = newest
            .and_then(|buffer| buffer.latest())
            .with_context(|| format!("nothing was ever written to {buffer}: it cannot be saved"))?;
        let text = rcs_msg::to_json(&sample.message)?;
        std::fs::write(path, text).with_context(|| format!("cannot write {}", path.display()))?;
    }
    Ok(())
}

/// Runs until the recording has nothing more to cause, until `until_s` after its start, or until the referee of a course
/// has decided.
fn to_the_end(run: &mut Stepped, until_s: Option<f64>, referee: Option<usize>) -> anyhow::Result<Outcome> {
    run.begin()?;
    if let (Some(referee), None, None) = (referee, until_s, run.horizon()) {
        runs::to_the_verdict(run, referee)?;
        return Ok(Outcome::End);
    }
    let horizon = run.horizon();
    let until = until_s.map(|seconds| run.start().after_ns((seconds * 1e9).round() as u64));
    let end = match (horizon, until) {
        (Some(horizon), Some(until)) => horizon.min(until),
        (horizon, until) => horizon.or(until).unwrap_or(Stamp(0)),
    };
    let more = run.run_until(end)?;
    let cut = more && until.is_some_and(|until| horizon.is_none_or(|horizon| until < horizon));
    Ok(if cut { Outcome::Timeout } else { Outcome::End })
}

fn report(summary: Summary, outcome: Outcome, wall_s: f64) -> Report {
    let failed = summary.processes.iter().any(|process| process.state == ProcessState::Error);
    Report {
        outcome: if failed { Outcome::Error } else { outcome },
        time_s: summary.time_s,
        wall_s,
        processes: summary
            .processes
            .into_iter()
            .map(|process| ProcessReport {
                name: process.name,
                state: process.state.as_str_name(),
                cycles: process.cycles,
                mean_us: process.mean_us,
                max_us: process.max_us,
                overruns: process.overruns,
            })
            .collect(),
        buffers: summary
            .buffers
            .into_iter()
            .map(|buffer| BufferReport {
                name: buffer.name,
                schema: buffer.schema,
                messages: buffer.messages,
                bytes: buffer.bytes.unwrap_or(0),
                hash: buffer.hash.unwrap_or_default(),
            })
            .collect(),
        hash: summary.hash.unwrap_or_default(),
        runs: Vec::new(),
    }
}

fn human_runs(runs: &[RunReport], out: &mut dyn Write) -> anyhow::Result<()> {
    let mut table = Table::new(&[
        ("seed", Align::Right),
        ("course", Align::Left),
        ("time", Align::Right),
        ("distance", Align::Right),
        ("remaining", Align::Right),
        ("collisions", Align::Right),
        ("bumper hits", Align::Right),
        ("slip", Align::Right),
    ]);
    for run in runs {
        table.row([
            run.seed.to_string(),
            run.outcome.to_owned(),
            format!("{:.1} s", run.time_s),
            format!("{:.1} m", run.distance_m),
            format!("{:.1} m", run.remaining_m),
            run.collisions.to_string(),
            run.bumper_hits.to_string(),
            format!("{:.1} s", run.slip_s),
        ]);
    }
    table.write(out)?;
    writeln!(out)?;
    Ok(())
}

fn human(report: &Report, out: &mut dyn Write) -> anyhow::Result<()> {
    let outcome = match report.outcome {
        Outcome::End => "end: there was nothing more to run",
        Outcome::Timeout => "timeout: the time asked for was reached",
        Outcome::Error => "error",
    };
    let speed = report.time_s / report.wall_s.max(1e-9);
    writeln!(out, "outcome  {outcome}")?;
    let (time, wall) = (format::elapsed(report.time_s), format::elapsed(report.wall_s));
    writeln!(out, "time     {time} in {wall} (× {})", format::number((speed * 10.0).round() / 10.0))?;
    writeln!(out, "hash     {}\n", report.hash)?;
    if !report.runs.is_empty() {
        human_runs(&report.runs, out)?;
    }
    let mut table = Table::new(&[
        ("process", Align::Left),
        ("state", Align::Left),
        ("cycles", Align::Right),
        ("mean", Align::Right),
        ("max", Align::Right),
        ("overruns", Align::Right),
    ]);
    for process in &report.processes {
        table.row([
            process.name.clone(),
            process.state.to_owned(),
            process.cycles.to_string(),
            format!("{:.0} µs", process.mean_us),
            format!("{:.0} µs", process.max_us),
            process.overruns.to_string(),
        ]);
    }
    table.write(out)?;
    writeln!(out)?;
    let mut table = Table::new(&[
        ("buffer", Align::Left),
        ("schema", Align::Left),
        ("messages", Align::Right),
        ("size", Align::Right),
        ("hash", Align::Left),
    ]);
    for buffer in report.buffers.iter().filter(|buffer| buffer.messages > 0) {
        table.row([
            buffer.name.clone(),
            buffer.schema.clone(),
            buffer.messages.to_string(),
            format::bytes(buffer.bytes),
            buffer.hash.clone(),
        ]);
    }
    table.write(out)?;
    Ok(())
}
