//! `ocu run`: runs a stack to its end in simulated time, in real time, or as recorded, and prints a report.

pub mod acts;
pub(crate) mod faults;
mod live;
mod replay;
mod report;

use crate::assets::looks_like_path;
use crate::cli::{RunArgs, Save};
use crate::output::{self, Files};
use crate::remembered::Remembered;
use crate::runs::{self, RunReport, Stop};
use crate::{BUILD, Ended, stacks, usage};
use acts::Act;
use anyhow::Context as _;
use rcs_log::Log;
use rcs_runtime::{Plan, RecordOptions, RecordWhat, Recording, RunOptions, Stepped};
pub(crate) use report::LogDamage;
use report::{Outcome, Report};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

/// Runs the stack as often as requested, and prints the report.
pub fn run(args: &RunArgs, out: &mut dyn Write) -> anyhow::Result<Ended> {
    let files = check_files(args)?;
    if let Some(recording) = &args.replay {
        return replay::run(args, recording, files, out);
    }
    let log = args.log.as_ref().map(stacks::open_log).transpose()?;
    let (plan, course) = plan(args, log.as_ref())?;
    check_assets(args, files)?;
    runs::check(&plan, log.as_ref(), args.until, args.course.is_some())?;
    let mut told = plan.warnings.clone();
    told.extend(log.iter().flat_map(|log| stacks::warnings_on(&plan, &overrides(args), log)));
    for warning in &told {
        tracing::warn!("{warning}");
    }
    check_buffers(args, &plan)?;
    let mut acts = args.acts.as_deref().map(|path| acts::read(path, &plan)).transpose()?.unwrap_or_default();
    acts.extend(faults::acts(&args.faults.faults, &plan)?);
    acts.sort_by_key(|act| act.at_ns);
    acts::check_faults(&plan, log.as_ref(), &acts)?;
    if args.live {
        let referee = runs::referee(&plan);
        return live::run(args, plan, referee, &acts, told, out);
    }
    let seed = stacks::seed_on(args.seed, log.as_ref());
    let mut stack = Ready { args, plan, course, log, acts };
    let mut memory = remembered(args);
    let mut recordings = recordings(args).into_iter();
    let mut runs = Vec::new();
    let mut done = stack.run(seed, recordings.next())?;
    let of_seed = |seed: u64, text: String| {
        if args.runs > 1 { format!("seed {seed}: {text}") } else { text }
    };
    let mut warnings: Vec<String> =
        done.report.warnings.drain(..).map(|warning| of_seed(seed, warning)).collect();
    runs.extend(done.verdict.take());
    let mut outcome = done.report.outcome;
    for more in 1..args.runs {
        if done.failure.is_some() {
            break;
        }
        // What the last report, which is printed, does not say.
        let before = seed.wrapping_add(u64::from(more) - 1);
        warnings.extend(done.report.errors().map(|error| of_seed(before, error)));
        let seed = seed.wrapping_add(more.into());
        memory.add(std::mem::take(&mut done.memory));
        match stack.run_again(&memory, seed, recordings.next()) {
            Ok(next) => done = next,
            Err(error) => {
                done.failure = Some(error.context(format!("run {} of {}", more + 1, args.runs)));
                break;
            }
        }
        warnings.extend(done.report.warnings.drain(..).map(|warning| of_seed(seed, warning)));
        runs.extend(done.verdict.take());
        outcome = outcome.max(done.report.outcome);
    }
    done.report.runs = runs;
    done.report.warnings = warnings;
    done.report.outcome = outcome;
    done.print(args, told, out)
}

/// Collects the files named by the arguments; refuses outputs onto any of them before anything is opened.
fn check_files(args: &RunArgs) -> anyhow::Result<Files> {
    let mut files = Files::new(args.force);
    let named =
        [("the log", &args.log), ("the recording that is repeated", &args.replay), ("--acts", &args.acts)];
    for (what, path) in named {
        if let Some(path) = path {
            files.reads_log(what, path);
        }
    }
    args.faults
        .faults
        .iter()
        .map(Path::new)
        .filter(|path| path.is_file())
        .for_each(|path| files.reads("--fault", path));
    for (what, name) in [("the stack", &args.stack), ("the course", &args.course)] {
        name.iter().filter(|name| looks_like_path(name)).for_each(|name| files.reads(what, Path::new(name)));
    }
    check_outputs(args, files.clone())?;
    Ok(files)
}

fn check_outputs(args: &RunArgs, mut files: Files) -> anyhow::Result<()> {
    recordings(args).iter().try_for_each(|path| files.writes("--record", path))?;
    args.save.iter().try_for_each(|save| files.writes(&format!("--save {}", save.buffer), &save.path))
}

/// Refuses outputs onto files that were read: those named by the stack or the course, and `--remembered`.
fn check_assets(args: &RunArgs, mut files: Files) -> anyhow::Result<()> {
    for path in crate::assets::files_read() {
        files.reads("a file that is read", &path);
    }
    check_outputs(args, files)
}

/// The stack named by the arguments, with their course, or that of the recording that it reads, and their parameters; and
/// this course, `None` for the stack's own.
fn plan(args: &RunArgs, log: Option<&Log>) -> anyhow::Result<(Arc<Plan>, Option<String>)> {
    let stack =
        args.stack.as_deref().ok_or_else(|| usage("expected --stack, or --replay with a recording"))?;
    let (overrides, remembered) = (overrides(args), remembered(args));
    let is_given = |name: &&str| overrides.iter().any(|(given, _)| given == name);
    if let Some(name) = remembered.names().find(is_given) {
        return Err(usage(format!("--param and --remembered both have {name}; expected one of them")));
    }
    let course = stacks::course_on(stack, args.course.as_deref(), log);
    let plan = stacks::plan_with(stack, course.as_deref(), &overrides, &remembered)?;
    Ok((plan, course))
}

/// Parameters of the command line, as `(process.field, value)`.
fn overrides(args: &RunArgs) -> Vec<(String, String)> {
    args.params.iter().map(crate::cli::Param::to_override).collect()
}

/// What the command line says that an earlier run remembers.
fn remembered(args: &RunArgs) -> Remembered {
    args.remembered.as_deref().cloned().unwrap_or_default()
}

/// Refuses `--save` and `--record-what` of buffers that the stack does not have.
fn check_buffers(args: &RunArgs, plan: &Plan) -> anyhow::Result<()> {
    let recorded: &[String] = match &args.record_what {
        Some(RecordWhat::Buffers(names)) => names,
        _ => &[],
    };
    let saved = args.save.iter().map(|save| (&save.buffer, "save"));
    let mut named = saved.chain(recorded.iter().map(|name| (name, "record")));
    let has_buffer = |name: &str| plan.buffers.iter().any(|buffer| buffer.spec.name == name);
    let Some((name, purpose)) = named.find(|(name, _)| !has_buffer(name)) else { return Ok(()) };
    Err(usage(format!("there is no buffer {name} to {purpose} in the stack {}", plan.file.name())))
}

/// The file of each run that `--record` writes; none without it. Those of several runs are numbered from 1 with a hyphen,
/// because an underscore numbers the parts of one recording ([`crate::parts`]).
fn recordings(args: &RunArgs) -> Vec<PathBuf> {
    let Some(path) = &args.record else { return Vec::new() };
    if args.runs == 1 {
        return vec![path.clone()];
    }
    let name = path.file_stem().unwrap_or_default().to_string_lossy();
    let ending = path.extension().map_or(String::new(), |ending| format!(".{}", ending.to_string_lossy()));
    (1..=args.runs).map(|number| path.with_file_name(format!("{name}-{number}{ending}"))).collect()
}

/// Starts to record a stepped run to a file.
fn record(args: &RunArgs, run: &Stepped, path: &Path) -> anyhow::Result<Recording> {
    let options = RecordOptions {
        lossless: true,
        build: BUILD.to_owned(),
        what: what(args),
        replace: args.force,
        from: None,
    };
    Ok(Recording::start(path, run.plan(), run.buffers(), &options)?)
}

/// What to record.
fn what(args: &RunArgs) -> RecordWhat {
    args.record_what.clone().unwrap_or_default()
}

/// A stack that is ready to run.
struct Ready<'a> {
    args: &'a RunArgs,
    plan: Arc<Plan>,
    /// The course of every run; `None` for the stack's own.
    course: Option<String>,
    log: Option<Log>,
    acts: Vec<Act>,
}

/// A finished run.
struct Done {
    report: Report,
    verdict: Option<RunReport>,
    failure: Option<anyhow::Error>,
    /// Why a buffer was not saved, such as that nothing was written to it; the next run may write to it.
    unsaved: Option<anyhow::Error>,
    /// What the processes remember at the end.
    memory: Remembered,
}

impl Done {
    /// The report of a stepped run.
    fn new(
        run: &Stepped,
        args: &RunArgs,
        outcome: Outcome,
        failure: Option<anyhow::Error>,
        log: Option<&Log>,
        (recording, clock, seed): (Option<Recording>, Instant, u64),
        is_again: bool,
    ) -> Self {
        let mut failure = failure;
        if let Some(recording) = recording
            && let Err(error) = recording.finish_at(run.now())
        {
            failure.get_or_insert(error.into());
        }
        let unsaved = save(run, args, is_again).err();
        let outcome = if failure.is_some() { Outcome::Error } else { outcome };
        let mut report = Report::new(run.summary(), outcome, clock.elapsed().as_secs_f64());
        report.log = log.and_then(LogDamage::of);
        let verdict = runs::referee(run.plan())
            .and_then(|referee| runs::verdict(&run.buffers()[referee]))
            .map(|verdict| RunReport::new(seed, &verdict, report.hash.clone()));
        let memory = Remembered::of(run).unwrap_or_else(|error| {
            failure.get_or_insert(error);
            Remembered::default()
        });
        Self { report, verdict, failure, unsaved, memory }
    }

    /// Prints the report. As JSON it has the warnings that were told before the run (`told`), too. What went wrong is told
    /// whether or not anybody reads it.
    fn print(self, args: &RunArgs, told: Vec<String>, out: &mut dyn Write) -> anyhow::Result<Ended> {
        let failure = self.failure.or(self.unsaved);
        let mut report = self.report.judged(args.fail_on_fault);
        if failure.is_some() {
            report.outcome = Outcome::Error;
        }
        if args.json {
            report.warnings.extend(told);
        }
        let printed = crate::despite_closed_output(report.print(args.json, args.runs > 1, out));
        if let Some(error) = failure {
            return Err(error);
        }
        printed?;
        Ok(match report.outcome {
            Outcome::Error => Ended::Failed,
            Outcome::End if report.log.is_some() => Ended::Damaged,
            Outcome::End => Ended::Well,
        })
    }
}

impl Ready<'_> {
    /// The first run, recorded to a file if there is one.
    fn run(&self, seed: u64, recorded: Option<PathBuf>) -> anyhow::Result<Done> {
        self.run_one(seed, recorded, false)
    }

    /// One more run, with what those before remember.
    fn run_again(
        &mut self,
        memory: &Remembered,
        seed: u64,
        recorded: Option<PathBuf>,
    ) -> anyhow::Result<Done> {
        if let Some(name) = &self.args.stack {
            let course = self.course.as_deref();
            self.plan = stacks::plan_with(name, course, &overrides(self.args), memory)?;
        }
        self.run_one(seed, recorded, true)
    }

    fn run_one(&self, seed: u64, recorded: Option<PathBuf>, is_again: bool) -> anyhow::Result<Done> {
        let base = stacks::options();
        let threads = self.args.threads.map_or(base.threads, usize::from);
        let options = RunOptions { seed, threads, hash: true, ..base };
        let clock = Instant::now();
        let mut run = Stepped::new(Arc::clone(&self.plan), self.log.as_ref(), options)
            .context("the stack cannot run")?;
        let recording = recorded.map(|path| record(self.args, &run, &path)).transpose()?;
        let (undone, failure) = match self.to_the_end(&mut run, recording.as_ref()) {
            Ok(undone) => (undone, None),
            Err(error) => (Vec::new(), Some(error)),
        };
        let times = (recording, clock, seed);
        let mut done = Done::new(&run, self.args, Outcome::End, failure, self.log.as_ref(), times, is_again);
        done.report.warnings.extend(undone);
        Ok(done)
    }

    /// Runs until the recording has no more messages to process, until `--until`, or until the referee of a course has
    /// decided; executes the actions of the operator on the way. Returns warnings about those that it did not reach.
    fn to_the_end(&self, run: &mut Stepped, recording: Option<&Recording>) -> anyhow::Result<Vec<String>> {
        let recording = recording.filter(|_| !self.args.keep_going);
        acts::go_to_the_end(run, self.args.until, &self.acts, Stop { recording, cancelled: None })
    }
}

/// Writes the newest messages of the buffers named by `--save`; those of a run before are replaced. One that cannot be
/// written does not hinder the others; the first error is returned.
fn save(run: &Stepped, args: &RunArgs, is_again: bool) -> anyhow::Result<()> {
    let save = |Save { buffer, path }: &Save| {
        let newest = run.buffers().iter().find(|candidate| candidate.name() == buffer);
        save_one(newest.and_then(|buffer| buffer.latest()), buffer, path, args.force || is_again)
    };
    let saved: Vec<anyhow::Result<()>> = args.save.iter().map(save).collect();
    saved.into_iter().collect()
}

/// Writes one message to a file, as JSON.
fn save_one(newest: Option<rcs_bus::Sample>, buffer: &str, path: &Path, force: bool) -> anyhow::Result<()> {
    let sample =
        newest.with_context(|| format!("nothing was ever written to {buffer}: it cannot be saved"))?;
    output::write(path, rcs_msg::to_json(&sample.message)?.as_bytes(), force)
}
