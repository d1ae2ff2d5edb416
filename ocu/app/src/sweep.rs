//! `ocu sweep`: runs a stack once for each combination of parameter values and seeds, on all cores, and prints a table of
//! what became of each run. A run depends on its log, stack, parameters and seed alone, so each line can be repeated with
//! `ocu run`.

use crate::cli::{SweepArgs, Values};
use crate::output::Files;
use crate::run::acts::{self, Act};
use crate::run::{LogDamage, faults};
use crate::runs::{self, RunReport, Stop};
use crate::table::{Align, Table};
use crate::{BUILD, Ended, say, stacks, usage};
use anyhow::Context as _;
use ocu_ui::format;
use rcs_log::Log;
use rcs_msg::rcs::ProcessState;
use rcs_runtime::{Plan, RecordOptions, RecordWhat, Recording, RunOptions, Stepped};
use serde::Serialize;
use std::collections::BTreeMap;
use std::io::Write;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

/// Largest number of runs of a sweep.
const MOST: usize = 100_000;

/// A run that is to be made.
struct Variant {
    plan: Arc<Plan>,
    params: BTreeMap<String, String>,
    seed: u64,
    /// Begins and ends of its faults.
    acts: Vec<Act>,
    /// Where it is recorded.
    recording: Option<PathBuf>,
}

/// What became of a run: an entry of `ocu sweep --json`.
#[derive(Debug, Default, Serialize)]
pub(crate) struct Row {
    params: BTreeMap<String, String>,
    pub(crate) seed: u64,
    /// Simulated time at its end, s.
    end_s: f64,
    /// Processes in `ERROR` at its end, with the reason.
    errors: Vec<String>,
    /// Faults that it did not reach.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    warnings: Vec<String>,
    /// What the referee of the course says, if there is one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) course: Option<RunReport>,
    hash: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) recording: Option<PathBuf>,
    /// Why it could not be run to its end.
    #[serde(skip_serializing_if = "Option::is_none")]
    failure: Option<String>,
}

impl Row {
    /// The values of its parameters, as `path=value`.
    pub(crate) fn params(&self) -> String {
        let params: Vec<String> = self.params.iter().map(|(path, value)| format!("{path}={value}")).collect();
        params.join(" ")
    }

    /// What became of it, in one word.
    pub(crate) fn outcome(&self) -> &'static str {
        match (&self.failure, &self.course) {
            (Some(_), _) => "failed",
            (None, Some(course)) => course.outcome,
            (None, None) => "ended",
        }
    }

    /// Simulated time at its end, as the referee says it if there is one, s.
    pub(crate) fn time_s(&self) -> f64 {
        self.course.as_ref().map_or(self.end_s, |course| course.time_s)
    }

    /// Why it failed, the processes in `ERROR`, and the faults that it did not reach.
    pub(crate) fn errors(&self) -> String {
        let errors = self.failure.iter().chain(&self.errors).chain(&self.warnings);
        errors.map(String::as_str).collect::<Vec<_>>().join("; ")
    }
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
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let jobs = args.jobs.map_or(cores, usize::from);
    let rows: Mutex<BTreeMap<usize, Row>> = Mutex::default();
    let prepared = Prepared::new(args)?;
    prepared.run(jobs, &AtomicBool::new(false), &|index, row| {
        rows.lock().unwrap_or_else(PoisonError::into_inner).insert(index, row);
    });
    let runs = rows.into_inner().unwrap_or_else(PoisonError::into_inner).into_values().collect();
    let report = SweepReport { runs, log: prepared.log.as_ref().and_then(LogDamage::of) };
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

/// A sweep that has been checked and can run.
pub(crate) struct Prepared<'a> {
    args: &'a SweepArgs,
    variants: Vec<Variant>,
    log: Option<Log>,
}

impl<'a> Prepared<'a> {
    /// Refuses what cannot run, before anything runs; makes the folder of the recordings.
    pub(crate) fn new(args: &'a SweepArgs) -> anyhow::Result<Self> {
        let log = args.log.as_ref().map(|log| stacks::open_named(log, &args.parts)).transpose()?;
        let variants = variants(args, log.as_ref())?;
        for variant in &variants {
            runs::check(&variant.plan, log.as_ref(), args.until, args.course.is_some())?;
        }
        // Whether a fault fits depends on processes, buffers and schemas, which all runs have in common.
        if let Some(first) = variants.first() {
            acts::check_faults(&first.plan, log.as_ref(), &first.acts)?;
            // All runs set the same parameters.
            let overrides: Vec<(String, String)> = first.params.clone().into_iter().collect();
            for warning in log.iter().flat_map(|log| stacks::warnings_on(&first.plan, &overrides, log)) {
                tracing::warn!("{warning}");
            }
        }
        check_files(args, &variants)?;
        Ok(Self { args, variants, log })
    }

    /// Number of runs.
    pub(crate) fn len(&self) -> usize {
        self.variants.len()
    }

    /// Makes the runs, so many at the same time, until all have ended or it is cancelled. Gives each one that ended,
    /// with its index.
    pub(crate) fn run(&self, jobs: usize, cancelled: &AtomicBool, ended: &(dyn Fn(usize, Row) + Sync)) {
        let next = AtomicUsize::new(0);
        std::thread::scope(|scope| {
            for _ in 0..jobs.min(self.variants.len()) {
                scope.spawn(|| {
                    loop {
                        let index = next.fetch_add(1, Ordering::Relaxed);
                        let Some(variant) = self.variants.get(index) else { return };
                        let row = run(self.args, variant, self.log.as_ref(), cancelled);
                        if cancelled.load(Ordering::Relaxed) {
                            return;
                        }
                        ended(index, row);
                    }
                });
            }
        });
    }
}

/// Every combination of values and seeds. The last parameter changes first.
fn variants(args: &SweepArgs, log: Option<&Log>) -> anyhow::Result<Vec<Variant>> {
    let mut paths: Vec<&str> = args.params.iter().map(|values| values.path.as_str()).collect();
    paths.sort_unstable();
    if let Some(pair) = paths.windows(2).find(|pair| pair[0] == pair[1]) {
        let path = pair[0];
        return Err(usage(format!("--param {path} is given twice; expected all its values in one list")));
    }
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
    let course = stacks::course_on(&args.stack, args.course.as_deref(), log);
    let mut variants = Vec::with_capacity(runs);
    for params in combinations {
        let overrides: Vec<(String, String)> = params.clone().into_iter().collect();
        let plan = stacks::plan(&args.stack, course.as_deref(), &overrides)?;
        let acts = faults::acts(&args.faults.faults, &plan)?;
        for seed in (0..u64::from(args.runs)).map(|run| args.seed.wrapping_add(run)) {
            let name = format!("run-{:04}.mcap", variants.len() + 1);
            let recording = args.record.as_ref().map(|folder| folder.join(name));
            let (plan, params, acts) = (Arc::clone(&plan), params.clone(), acts.clone());
            variants.push(Variant { plan, params, seed, acts, recording });
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
        files.reads_log("the log", log);
        args.parts.iter().for_each(|part| files.reads("the log", part));
    }
    for path in crate::assets::files_read() {
        files.reads("a file that the stack names", &path);
    }
    variants
        .iter()
        .filter_map(|variant| variant.recording.as_ref())
        .try_for_each(|path| files.writes("--record", path))
}

fn run(args: &SweepArgs, variant: &Variant, log: Option<&Log>, cancelled: &AtomicBool) -> Row {
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
    match to_the_end(args, variant, &mut run, cancelled) {
        Ok(undone) => row.warnings = undone,
        Err(error) => row.failure = Some(say(&error)),
    }
    let summary = run.summary();
    let failed = summary.processes.iter().filter(|process| process.state == ProcessState::Error);
    row.errors = failed.map(|process| format!("{}: {}", process.name, process.state_text)).collect();
    row.end_s = summary.time_s;
    row.hash = summary.hash.unwrap_or_default();
    let verdict = runs::referee(run.plan()).and_then(|referee| runs::verdict(&run.buffers()[referee]));
    row.course = verdict.map(|verdict| RunReport::new(variant.seed, &verdict, row.hash.clone()));
    row
}

/// Runs to the end, and records it if the run is to be recorded. Returns warnings about faults that it did not reach.
fn to_the_end(
    args: &SweepArgs,
    variant: &Variant,
    run: &mut Stepped,
    cancelled: &AtomicBool,
) -> anyhow::Result<Vec<String>> {
    let options = RecordOptions {
        lossless: true,
        build: BUILD.to_owned(),
        what: RecordWhat::Journal,
        replace: args.force,
        from: None,
    };
    let start = |path: &PathBuf| Recording::start(path, run.plan(), run.buffers(), &options);
    let recording = variant.recording.as_ref().map(start).transpose()?;
    let stop = Stop { recording: recording.as_ref(), cancelled: Some(cancelled) };
    let ended = acts::go_to_the_end(run, args.until, &variant.acts, stop);
    let closed = recording.map_or(Ok(()), |recording| recording.finish_at(run.now()).map(drop));
    let undone = ended?;
    closed?;
    Ok(undone)
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
        let course = row.course.as_ref();
        let of = |read: &dyn Fn(&RunReport) -> String| course.map(read).unwrap_or_default();
        table.row([
            row.params(),
            row.seed.to_string(),
            row.outcome().to_owned(),
            format::number(row.time_s()),
            of(&|course| format!("{:.2}", course.remaining_m)),
            of(&|course| course.collisions.to_string()),
            of(&|course| course.bumper_hits.to_string()),
            row.hash.chars().take(12).collect(),
            row.recording.as_ref().map(|path| path.display().to_string()).unwrap_or_default(),
            row.errors(),
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
