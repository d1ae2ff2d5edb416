//! The bundled stacks, and sources made from stacks.

use crate::assets::{ProgramAssets, looks_like_path, read_text};
use crate::bundled;
use crate::open::{Request, SweptRun};
use crate::remembered::Remembered;
use crate::{parts, stack_warnings, usage};
use anyhow::Context as _;
use rcs_log::{CursorOptions, Log};
use rcs_msg::rcs::{CourseRun, RunInfo};
use rcs_msg::{AnyMessage, Payload, schema_of};
use rcs_runtime::source::{LogSource, Source, StackSource};
use rcs_runtime::{
    Assets as _, Plan, PlanOptions, ProcessPlan, RecordedRun, RunOptions, StackError, StackFile,
};
use std::path::{Path, PathBuf};
use std::sync::{Arc, LazyLock};

/// The bundled stacks, sorted by name.
pub fn bundled() -> &'static [(&'static str, StackFile)] {
    static STACKS: LazyLock<Vec<(&str, StackFile)>> = LazyLock::new(|| {
        let read = |file: bundled::Bundled| match read(&file.path(), file.text) {
            Ok(stack) => Some((file.name, stack)),
            Err(error) => {
                tracing::error!("{error}");
                None
            }
        };
        bundled::files("stack").filter_map(read).collect()
    });
    &STACKS
}

fn read(file: &str, text: &str) -> Result<StackFile, StackError> {
    StackFile::compose(file, text, &ProgramAssets)
}

/// The stack named by the user: a bundled one by name, or a file. Parsed, but not yet checked against the plugins.
pub fn named(spec: &str) -> anyhow::Result<StackFile> {
    if let Some(file) = bundled::file("stack", spec) {
        return Ok(read(&file.path(), file.text)?);
    }
    if !looks_like_path(spec) {
        return Err(usage(format!(
            "no bundled stack is called {spec:?}; expected {} or a .toml file",
            bundled::names("stack").join(", ")
        )));
    }
    let text = read_text(Path::new(spec))
        .map_err(|error| usage(format!("cannot read the stack: {error}: {spec}")))?;
    Ok(read(spec, &text)?)
}

/// The text of the stack named by the user, without its parts, and the file to which a changed one is written: a bundled
/// stack is part of the program, so that what differs becomes a file of the user's.
pub(crate) fn text_of(spec: &str) -> anyhow::Result<(String, String)> {
    if let Some(bundled) = bundled::file("stack", spec) {
        return Ok((format!("{spec}.toml"), bundled.text.to_owned()));
    }
    Ok((spec.to_owned(), read_text(Path::new(spec)).map_err(anyhow::Error::msg)?))
}

/// The stack named by the user, checked against the plugins, with parameters and course from the command line.
pub fn plan(spec: &str, course: Option<&str>, overrides: &[(String, String)]) -> anyhow::Result<Arc<Plan>> {
    Ok(Arc::new(checked(spec, &PlanOptions { overrides, course, assets: &ProgramAssets })?))
}

/// The stack named by the user, checked with these options, with all that is probably a mistake in it.
fn checked(spec: &str, options: &PlanOptions<'_>) -> anyhow::Result<Plan> {
    let mut plan = Plan::with(named(spec)?, rcs_plugins::all(), options)?;
    let warnings = stack_warnings::of(&plan);
    plan.warnings.extend(warnings);
    Ok(plan)
}

/// Like [`plan`], with what an earlier run remembers, as far as the stack has parameters for it. A warning names the
/// rest.
pub(crate) fn plan_with(
    spec: &str,
    course: Option<&str>,
    overrides: &[(String, String)],
    remembered: &Remembered,
) -> anyhow::Result<Arc<Plan>> {
    let plain = plan(spec, course, overrides)?;
    let own = remembered.overrides(&plain)?;
    if own.is_empty() {
        return Ok(plain);
    }
    let left_out = remembered.left_out(&own);
    let overrides: Vec<(String, String)> = overrides.iter().cloned().chain(own).collect();
    let mut plan = checked(spec, &PlanOptions { overrides: &overrides, course, assets: remembered })?;
    plan.warnings.extend(left_out);
    Ok(Arc::new(plan))
}

/// Opens a recording with the message codecs of all plugins: a file, or the files into which it was split, of which the
/// path is the folder or the first one.
pub fn open_log(path: impl AsRef<Path>) -> anyhow::Result<Log> {
    open_parts(&parts::of(path.as_ref())?)
}

fn open_parts(files: &[PathBuf]) -> anyhow::Result<Log> {
    Ok(Log::open_parts(files)?.with_codecs(rcs_runtime::codecs(rcs_plugins::all())))
}

/// Opens a recording like [`open_log`], for a command that reads what a run computed ([`check_full`]).
pub(crate) fn open_full(path: &Path) -> anyhow::Result<Log> {
    let log = open_log(path)?;
    check_full(&log, path)?;
    Ok(log)
}

/// Refuses a recording of the journal alone, which holds nothing of what its run computed, and names the command that
/// computes it again.
pub(crate) fn check_full(log: &Log, path: &Path) -> anyhow::Result<()> {
    if !RecordedRun::is_journal_alone(log) {
        return Ok(());
    }
    let path = path.display();
    Err(usage(format!(
        "{path} holds the journal only; expected a full recording: ocu run --replay {path} --record full.mcap"
    )))
}

/// Opens a recording like [`open_log`], or of these files if `parts` names further ones.
pub(crate) fn open_named(path: &Path, parts: &[PathBuf]) -> anyhow::Result<Log> {
    if parts.is_empty() {
        return open_log(path);
    }
    let files: Vec<PathBuf> = std::iter::once(path.to_owned()).chain(parts.iter().cloned()).collect();
    open_parts(&files)
}

/// The recording of a request.
pub(crate) fn log_of(request: &Request) -> anyhow::Result<Option<Log>> {
    request.log.as_ref().map(|path| open_named(path, &request.parts)).transpose()
}

/// The course of a stack: the given one, else that of the recorded run which it reads, so that it drives to the goal of then.
/// `None` for the stack's own course: without a recording, for a stack without a course, and for a recording of no bundled
/// course. Warns where the stack's own course has another name than that of the recording.
pub(crate) fn course_on(stack: &str, given: Option<&str>, log: Option<&Log>) -> Option<String> {
    let (course, warning) = course_and_warning(stack, given, log);
    if let Some(warning) = warning {
        tracing::warn!("{warning}");
    }
    course
}

/// Like [`course_on`], with the warning, which matters only where the stack runs.
pub(crate) fn course_and_warning(
    stack: &str,
    given: Option<&str>,
    log: Option<&Log>,
) -> (Option<String>, Option<String>) {
    if let Some(given) = given {
        return (Some(given.to_owned()), None);
    }
    let recorded =
        log.and_then(first_of).map(|run: CourseRun| run.course).filter(|course| !course.is_empty());
    let Some(recorded) = recorded else { return (None, None) };
    let Some(stack) = named(stack).ok().filter(|stack| stack.course().is_some()) else { return (None, None) };
    if bundled::file("course", &recorded).is_some() {
        return (Some(recorded), None);
    }
    let is_own = name_of_course(&stack).is_some_and(|name| name == recorded);
    let warning = (!is_own).then(|| {
        format!(
            "the recording is of the course {recorded:?}, which is neither a bundled one nor that of the stack: the \
             stack drives to the goal of its own course; expected the file of that course as --course"
        )
    });
    (None, warning)
}

/// The name in the file of a stack's own course; `None` if it cannot be read.
fn name_of_course(stack: &StackFile) -> Option<String> {
    let text = ProgramAssets.read("course", stack.course()?, &stack.file).ok()?.text;
    let table: toml::Table = toml::from_str(&text).ok()?;
    Some(table.get("name")?.as_str()?.to_owned())
}

/// The seed of a stack: the given one, else that of the recorded run which it reads, so that a stack on a recording of
/// itself repeats what was recorded; 0 without such a run.
pub(crate) fn seed_on(given: Option<u64>, log: Option<&Log>) -> u64 {
    let recorded = || log.and_then(first_of).map(|run: RunInfo| run.seed);
    given.or_else(recorded).unwrap_or(0)
}

/// The first message of the first topic of this type in a recording; `None` if there is none, or it cannot be read.
fn first_of<T: Payload>(log: &Log) -> Option<T> {
    let name = schema_of::<T>().name();
    let topic = log.info().topics.iter().find(|topic| topic.schema.name() == name)?;
    let options = CursorOptions { topics: Some(vec![topic.id]), ..CursorOptions::default() };
    let first = log.cursor(options).find_map(Result::ok)?;
    AnyMessage::encoded(topic.schema.clone(), first.data).to()
}

/// What is probably a mistake where a stack runs on a recording: it reads nothing of it, and did not make it either. A
/// stack on a recording of itself repeats the recorded run.
fn reads_nothing(plan: &Plan, log: &Log) -> Option<String> {
    let stack = plan.file.name();
    let made_it = || first_of::<RunInfo>(log).is_some_and(|run| run.stack == stack);
    (plan.inputs.is_empty() && !made_it()).then(|| {
        format!("the stack {stack} reads nothing of the recording; expected a stack that reads it, or none")
    })
}

/// What is told of a stack on a recording: that it reads nothing of it, and which processes of the recorded run had other
/// parameters, from its start on or sent by the operator: the stack has its own ones, and those of the command line
/// (`overrides`), which are meant to differ.
pub(crate) fn warnings_on(plan: &Plan, overrides: &[(String, String)], log: &Log) -> Vec<String> {
    let mut warnings: Vec<String> = reads_nothing(plan, log).into_iter().collect();
    let Ok(recorded) = RecordedRun::read(log, rcs_plugins::all()) else { return warnings };
    let names = |is_meant: &dyn Fn(&ProcessPlan) -> bool| {
        let meant = plan.processes.iter().filter(|process| is_meant(process));
        meant.map(|process| &*process.name).collect::<Vec<&str>>().join(", ")
    };
    let run = recorded.info();
    // Another stack has parameters of its own.
    let is_same_stack = run.stack == plan.file.name();
    // The recorded run with the same parameters of the command line, where it takes them.
    let as_given = (is_same_stack && !overrides.is_empty())
        .then(|| recorded.plan_with(rcs_plugins::all(), overrides, &ProgramAssets).ok())
        .flatten();
    let theirs = |name: &str| match &as_given {
        Some(plan) => {
            let process = plan.processes.iter().find(|process| *process.name == *name);
            process.map(|process| process.params.bytes())
        }
        None => run.params.iter().find(|params| params.process == name).map(|params| params.params.clone()),
    };
    let began = names(&|process: &ProcessPlan| {
        is_same_stack && theirs(&process.name).is_some_and(|theirs| theirs != process.params.bytes())
    });
    if !began.is_empty() {
        warnings.push(format!(
            "the recorded run began with other parameters of {began}: ocu run --replay repeats them"
        ));
    }
    let sent = names(&|process: &ProcessPlan| {
        let buffer = &plan.buffers[process.params_buffer].spec.name;
        recorded.journal().events().iter().any(|event| *buffer == *event.buffer)
    });
    if !sent.is_empty() {
        warnings.push(format!(
            "parameters that the operator sent to {sent} during the recorded run are not in force in a run on it; it has \
             those of the stack and of --param"
        ));
    }
    warnings
}

/// Opens a source: a recording, a stack on a recording, or a stack alone (on a course if it is a simulation).
pub fn open(request: &Request) -> anyhow::Result<Box<dyn Source>> {
    open_on(request, log_of(request)?.as_ref())
}

/// Like [`open`], where the recording of the request, if it names one, has been opened.
pub(crate) fn open_on(request: &Request, log: Option<&Log>) -> anyhow::Result<Box<dyn Source>> {
    let Some(stack) = &request.stack else {
        let log = log.ok_or_else(|| usage("expected a recording or a stack to open, got neither"))?;
        if RecordedRun::is_journal_alone(log) {
            return repeat(log, request.run.as_deref());
        }
        return Ok(Box::new(LogSource::new(log)?));
    };
    let remembered = request.remembered.as_deref().cloned().unwrap_or_default();
    let course = course_on(stack, request.course.as_deref(), log);
    let mut plan = plan_with(stack, course.as_deref(), &[], &remembered)?;
    let warnings = log.map(|log| warnings_on(&plan, &[], log)).unwrap_or_default();
    if let Some(plan) = Arc::get_mut(&mut plan) {
        plan.warnings.extend(warnings);
    }
    let seed = seed_on(request.seed, log);
    let options = RunOptions { seed, past: request.past.options(), ..options() };
    let source = StackSource::new(plan, log, options).context("the stack cannot run")?;
    Ok(Box::new(source))
}

/// Opens a recording that contains only the journal of a run: the run is computed again.
fn repeat(recording: &Log, run: Option<&SweptRun>) -> anyhow::Result<Box<dyn Source>> {
    let recorded = RecordedRun::read(recording, rcs_plugins::all())?;
    let plan = recorded.plan(rcs_plugins::all())?;
    let log = match recorded.info().log.as_str() {
        "" => None,
        identity => {
            let known = run.and_then(|run| open_named(run.log.as_ref()?, &run.parts).ok());
            let known = known.filter(|log| log.identity().is_ok_and(|found| found == identity));
            Some(known.map_or_else(|| beside(&recording.info().path, identity), Ok)?)
        }
    };
    let source = StackSource::repeating(&recorded, &plan, log.as_ref(), options());
    let source = source.context("the recorded run cannot be repeated")?;
    Ok(Box::new(match run {
        Some(run) => source.titled(&run.title),
        None => source,
    }))
}

/// The log with this identity, under any name, in the folder of the recording of a run that read it.
pub(crate) fn beside(recording: &Path, identity: &str) -> anyhow::Result<Log> {
    let folder = recording.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let mut paths: Vec<_> = std::fs::read_dir(folder)?.filter_map(|entry| Some(entry.ok()?.path())).collect();
    paths.sort();
    let is_log =
        |path: &PathBuf| path != recording && path.extension().is_some_and(|ending| ending == "mcap");
    // A file may be the first part of a recording, and may have been read alone.
    let readings = |path: &PathBuf| {
        let parts = parts::of(path).unwrap_or_default();
        let alone = (parts.len() != 1).then(|| vec![path.clone()]);
        (!parts.is_empty()).then_some(parts).into_iter().chain(alone)
    };
    for files in paths.iter().filter(|path| is_log(path)).take(MOST_LOGS).flat_map(readings) {
        let log = open_parts(&files).ok();
        if let Some(log) = log.filter(|log| log.identity().is_ok_and(|found| found == identity)) {
            return Ok(log);
        }
    }
    Err(usage(format!(
        "the recording holds the journal of a run on a log with the identity {identity}, which is not in its folder; \
         expected that log in {}",
        folder.display()
    )))
}

/// Maximum number of logs that are examined to find the one that a run read.
const MOST_LOGS: usize = 64;

/// How a stack is run, except for the options of the command line.
pub fn options() -> RunOptions {
    RunOptions {
        build: crate::BUILD.to_owned(),
        threads: std::thread::available_parallelism().map_or(1, usize::from),
        ..RunOptions::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rcs_log::{LogWriter, WriteHeader, WriterOptions};
    use rcs_msg::Stamp;
    use std::collections::BTreeMap;

    #[test]
    fn every_bundled_stack_fits_the_plugins_and_says_what_it_is_for() {
        assert_eq!(bundled().len(), bundled::names("stack").len(), "each can be read");
        for (name, stack) in bundled() {
            let plan = plan(name, None, &[]).unwrap_or_else(|error| panic!("{error}"));
            assert_eq!(plan.file.name(), *name);
            assert!(!stack.description().is_empty(), "{name}");
        }
    }

    #[test]
    fn every_overlay_of_a_bundled_stack_lies_on_an_image_of_it() {
        let mut overlays = 0;
        for (name, _) in bundled() {
            let plan = plan(name, None, &[]).unwrap_or_else(|error| panic!("{error}"));
            for buffer in &plan.buffers {
                let Some(base) = buffer.spec.metadata.get("rcs.overlay_of") else { continue };
                let base = plan.buffers.iter().find(|other| other.spec.name == *base);
                let schema = base.map(|base| base.spec.schema.name());
                assert_eq!(schema, Some("foxglove.RawImage"), "{name}: {}", buffer.spec.name);
                overlays += 1;
            }
        }
        assert!(overlays > 4, "{overlays}");
    }

    #[test]
    fn what_is_probably_a_mistake_in_a_stack_is_a_problem_of_its_source() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("mine.toml");
        let text = "format = 1\nname = \"mine\"\n[[process]]\nname = \"obstacles\"\nplugin = \"obstacles\"\n\
                    supervisor = \"viewer\"\nparams = { mount = { height_m = 1.5 } }\n";
        std::fs::write(&path, text).unwrap();
        let request = Request { stack: path.to_str().map(str::to_owned), ..Request::default() };
        let problems = open(&request).unwrap().frame().info.problems.clone();
        assert!(problems.len() == 1 && problems[0].contains("mount.height_m is set"), "{problems:?}");
    }

    #[test]
    fn a_recording_of_another_course_is_warned_of_only_where_the_stack_has_not_this_course() {
        let dir = tempfile::tempdir().unwrap();
        let [log, stack, course] = ["h.mcap", "hauler.toml", "own.toml"].map(|name| dir.path().join(name));
        let mut writer = LogWriter::create(&log, WriterOptions::default()).unwrap();
        let channel = writer.add_channel("/run", schema_of::<CourseRun>(), &BTreeMap::new()).unwrap();
        let run = CourseRun { course: "c_hauler".to_owned(), ..CourseRun::default() };
        let header = WriteHeader { sequence: 1, log_time: Stamp(1), publish_time: Stamp(1) };
        writer.write(channel, header, &AnyMessage::new(run).bytes()).unwrap();
        writer.finish().unwrap();
        let log = open_log(&log).unwrap();
        std::fs::write(&stack, "format = 1\nname = \"hauler\"\ncourse = \"own.toml\"\n").unwrap();
        let warning = |stack: &str, given: Option<&str>, log: Option<&Log>| {
            let (found, warning) = course_and_warning(stack, given, log);
            assert_eq!(found.as_deref(), given);
            warning
        };
        let stack = stack.to_str().unwrap();
        for (name, is_other) in [("c_hauler", false), ("another", true)] {
            std::fs::write(&course, format!("name = \"{name}\"\n")).unwrap();
            assert_eq!(warning(stack, None, Some(&log)).is_some(), is_other, "{name}");
        }
        let other = warning("lagr", None, Some(&log)).unwrap();
        assert!(other.contains("\"c_hauler\"") && other.contains("--course"), "{other}");
        assert_eq!(warning("lagr", Some("hill"), Some(&log)), None);
        assert_eq!(warning("lagr", None, None), None);
    }

    #[test]
    fn an_unknown_stack_is_refused_with_the_names_of_the_known_ones() {
        let error = named("samples").unwrap_err().to_string();
        assert!(error.contains("\"samples\"") && error.contains("truth_driver or"), "{error}");
        assert!(named("./absent.toml").unwrap_err().to_string().contains("absent.toml"));
    }
}

#[cfg(test)]
#[path = "stacks_remembered_tests.rs"]
mod remembered_tests;
