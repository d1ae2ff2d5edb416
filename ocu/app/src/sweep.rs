//! `ocu sweep`: runs a stack once for each combination of parameter values and seeds, on all cores, and prints a table of
//! what became of each run. A run depends on its log, stack, parameters and seed alone, so each line can be repeated with
//! `ocu run`.

use crate::cli::{SweepArgs, Values};
use crate::output::Files;
use crate::run::LogDamage;
use crate::runs::{self, RunReport};
use crate::table::{Align, Table};
use crate::{BUILD, Ended, say, stacks, usage};
use anyhow::Context as _;
use ocu_ui::format;
use rcs_log::Log;
use rcs_msg::Stamp;
use rcs_msg::rcs::ProcessState;
use rcs_runtime::{Plan, RecordOptions, RecordWhat, Recording, RunOptions, Stepped};
use serde::Serialize;
use std::collections::BTreeMap;
use std::io::Write;
use std::path::PathBuf;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

/// Largest number of runs of a sweep.
const MOST: usize = 100_000;

/// A run that is to be made.
struct Variant {
    plan: Arc<Plan>,
    params: BTreeMap<String, String>,
    seed: u64,
    /// Where it is recorded.
    recording: Option<PathBuf>,
}

/// What became of a run: an entry of `ocu sweep --json`.
#[derive(Debug, Default, Serialize)]
struct Row {
    params: BTreeMap<String, String>,
    seed: u64,
    /// Simulated time at its end, s.
    end_s: f64,
    /// Processes in `ERROR` at its end, with the reason.
    errors: Vec<String>,
    /// What the referee of the course says, if there is one.
    #[serde(skip_serializing_if = "Option::is_none")]
    course: Option<RunReport>,
    hash: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    recording: Option<PathBuf>,
    /// Why it could not be run to its end.
    #[serde(skip_serializing_if = "Option::is_none")]
    failure: Option<String>,
}

/// The result of `ocu sweep --json`.
#[derive(Debug, Serialize)]
struct SweepReport {
    runs: Vec<Row>,
    /// Damage of the recording that the runs read.
    #[serde(skip_serializing_if = "Option::is_none")]
    log: Option<LogDamage>,
}

/// Makes the runs, and prints the table.
pub fn sweep(args: &SweepArgs, out: &mut dyn Write) -> anyhow::Result<Ended> {
    let variants = variants(args)?;
    let log = args.log.as_ref().map(stacks::open_log).transpose()?;
    for variant in &variants {
        runs::check(&variant.plan, log.as_ref(), args.until, args.course.is_some())?;
    }
    check_files(args, &variants)?;
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let jobs = args.jobs.map_or(cores, usize::from).min(variants.len());
    let next = AtomicUsize::new(0);
    let rows: Mutex<BTreeMap<usize, Row>> = Mutex::default();
    std::thread::scope(|scope| {
        for _ in 0..jobs {
            scope.spawn(|| {
                loop {
                    let index = next.fetch_add(1, Ordering::Relaxed);
                    let Some(variant) = variants.get(index) else { return };
                    let row = run(args, variant, log.as_ref());
                    rows.lock().unwrap_or_else(PoisonError::into_inner).insert(index, row);
                }
            });
        }
    });
    let runs = rows.into_inner().unwrap_or_else(PoisonError::into_inner).into_values().collect();
    let report = SweepReport { runs, log: log.as_ref().and_then(LogDamage::of) };
    if args.json {
        serde_json::to_writer_pretty(&mut *out, &report).context("cannot write the table")?;
        writeln!(out)?;
    } else {
        print(&report, out)?;
    }
    Ok(match &report.log {
        _ if report.runs.iter().any(|run| run.failure.is_some()) => Ended::Failed,
        Some(_) => Ended::Damaged,
        None => Ended::Well,
    })
}

/// Every combination of values and seeds. The last parameter changes first.
fn variants(args: &SweepArgs) -> anyhow::Result<Vec<Variant>> {
    let mut runs = args.params.iter().map(|values| values.values.len()).chain([args.runs as usize]);
    let runs = runs.try_fold(1, usize::checked_mul).unwrap_or(usize::MAX);
    if runs > MOST {
        return Err(usage(format!("the sweep has {runs} runs; expected at most {MOST}")));
    }
    let mut combinations: Vec<BTreeMap<String, String>> = vec![BTreeMap::new()];
    for Values { path, values } in &args.params {
        let with = |known: &BTreeMap<String, String>, value: &String| {
            known
                .iter()
                .map(|(path, value)| (path.clone(), value.clone()))
                .chain([(path.clone(), value.clone())])
                .collect()
        };
        combinations = combinations
            .iter()
            .flat_map(|known| values.iter().map(move |value| with(known, value)))
            .collect();
    }
    let mut variants = Vec::with_capacity(runs);
    for params in combinations {
        let overrides: Vec<(String, String)> = params.clone().into_iter().collect();
        let plan = stacks::plan(&args.stack, args.course.as_deref(), &overrides)?;
        for seed in (0..u64::from(args.runs)).map(|run| args.seed.wrapping_add(run)) {
            let name = format!("run-{:04}.mcap", variants.len() + 1);
            let recording = args.record.as_ref().map(|folder| folder.join(name));
            variants.push(Variant { plan: Arc::clone(&plan), params: params.clone(), seed, recording });
        }
    }
    Ok(variants)
}

/// Refuses recordings onto files in use, before anything runs; makes their folder.
fn check_files(args: &SweepArgs, variants: &[Variant]) -> anyhow::Result<()> {
    let Some(folder) = &args.record else { return Ok(()) };
    std::fs::create_dir_all(folder)
        .with_context(|| format!("cannot make the folder {}", folder.display()))?;
    let mut files = Files::new(args.force);
    if let Some(log) = &args.log {
        files.reads("the log", log);
    }
    for path in crate::assets::files_read() {
        files.reads("a file that the stack names", &path);
    }
    variants
        .iter()
        .filter_map(|variant| variant.recording.as_ref())
        .try_for_each(|path| files.writes("--record", path))
}

fn run(args: &SweepArgs, variant: &Variant, log: Option<&Log>) -> Row {
    let mut row = Row {
        params: variant.params.clone(),
        seed: variant.seed,
        recording: variant.recording.clone(),
        ..Row::default()
    };
    // Runs share the cores, so each has one thread; its result does not depend on it.
    let options = RunOptions { seed: variant.seed, threads: 1, hash: true, ..stacks::options() };
    let mut run = match Stepped::new(Arc::clone(&variant.plan), log, options) {
        Ok(run) => run,
        Err(error) => {
            row.failure = Some(error.to_string());
            return row;
        }
    };
    row.failure = to_the_end(args, variant, &mut run).err().map(|error| say(&error));
    let summary = run.summary();
    let failed = summary.processes.iter().filter(|process| process.state == ProcessState::Error);
    row.errors = failed.map(|process| format!("{}: {}", process.name, process.state_text)).collect();
    row.end_s = summary.time_s;
    row.hash = summary.hash.unwrap_or_default();
    let verdict = runs::referee(run.plan()).and_then(|referee| runs::verdict(&run.buffers()[referee]));
    row.course = verdict.map(|verdict| RunReport::new(variant.seed, &verdict, row.hash.clone()));
    row
}

fn to_the_end(args: &SweepArgs, variant: &Variant, run: &mut Stepped) -> anyhow::Result<()> {
    let options = RecordOptions {
        lossless: true,
        build: BUILD.to_owned(),
        what: RecordWhat::Journal,
        replace: args.force,
        from: None,
    };
    let start = |path: &PathBuf| Recording::start(path, run.plan(), run.buffers(), &options);
    let recording = variant.recording.as_ref().map(start).transpose()?;
    let ended = run.begin().and_then(|()| {
        let end = runs::end(run, args.until);
        runs::go_to(run, end, Stamp::MAX, recording.as_ref())
    });
    let closed = recording.map_or(Ok(()), |recording| recording.finish_at(run.now()).map(drop));
    ended?;
    Ok(closed?)
}

fn print(report: &SweepReport, out: &mut dyn Write) -> anyhow::Result<()> {
    let rows = &report.runs;
    let mut table = Table::new(&[
        ("parameters", Align::Left),
        ("seed", Align::Right),
        ("outcome", Align::Left),
        ("time s", Align::Right),
        ("remaining m", Align::Right),
        ("collisions", Align::Right),
        ("bumper hits", Align::Right),
        ("hash", Align::Left),
        ("recording", Align::Left),
        ("errors", Align::Left),
    ]);
    for row in rows {
        let params: Vec<String> = row.params.iter().map(|(path, value)| format!("{path}={value}")).collect();
        let course = row.course.as_ref();
        let outcome = match (&row.failure, course) {
            (Some(_), _) => "failed",
            (None, Some(course)) => course.outcome,
            (None, None) => "ended",
        };
        let of = |read: &dyn Fn(&RunReport) -> String| course.map(read).unwrap_or_default();
        let errors: Vec<&str> = row.failure.iter().chain(&row.errors).map(String::as_str).collect();
        table.row([
            params.join(" "),
            row.seed.to_string(),
            outcome.to_owned(),
            format::number(course.map_or(row.end_s, |course| course.time_s)),
            of(&|course| format!("{:.2}", course.remaining_m)),
            of(&|course| course.collisions.to_string()),
            of(&|course| course.bumper_hits.to_string()),
            row.hash.chars().take(12).collect(),
            row.recording.as_ref().map(|path| path.display().to_string()).unwrap_or_default(),
            errors.join("; "),
        ]);
    }
    table.write(out)?;
    if report.log.is_some() {
        writeln!(out, "the recording is damaged; ocu check says where")?;
    }
    let courses: Vec<&RunReport> = rows.iter().filter_map(|row| row.course.as_ref()).collect();
    if !courses.is_empty() {
        let reached = courses.iter().filter(|course| course.outcome == "reached").count();
        writeln!(out, "{reached} of {} runs reached the goal", rows.len())?;
    }
    Ok(())
}
