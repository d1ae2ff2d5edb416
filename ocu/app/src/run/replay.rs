//! `ocu run --replay`: repeats a recorded run and compares it with the recording.

use super::report::{LogDamage, Outcome};
use super::{Done, check_assets, check_buffers, overrides, plan, record};
use crate::assets::ProgramAssets;
use crate::cli::RunArgs;
use crate::comparison::Comparison;
use crate::output::Files;
use crate::{Ended, parts, stacks, usage};
use anyhow::Context as _;
use rcs_log::Log;
use rcs_msg::Stamp;
use rcs_runtime::{RecordedRun, Replay, RunError, RunOptions};
use std::io::Write;
use std::path::Path;
use std::time::Instant;

/// Repeats a recorded run, prints the report of `ocu run`, and whether it equals the recording.
pub(super) fn run(
    args: &RunArgs,
    recording: &Path,
    mut files: Files,
    out: &mut dyn Write,
) -> anyhow::Result<Ended> {
    let original = Log::open_parts(&parts::of(recording)?)?;
    let recorded = RecordedRun::read(&original, rcs_plugins::all()).map_err(refused)?;
    for problem in recorded.problems() {
        tracing::warn!("{problem}");
    }
    let log = match (&args.log, recorded.info().log.as_str()) {
        (None, "") => None,
        (None, identity) => {
            let log = stacks::beside(&original.info().path, identity);
            let log = log.context("expected --log, or the log in the folder of the recording")?;
            files.reads_log("the log", &log.info().path);
            Some(log)
        }
        (Some(path), _) => Some(stacks::open_log(path)?),
    };
    let asked = match &args.stack {
        Some(_) => plan(args, log.as_ref())?.0,
        None => recorded.plan_with(rcs_plugins::all(), &overrides(args), &ProgramAssets)?,
    };
    check_assets(args, files)?;
    check_buffers(args, &asked)?;
    recorded.check(&asked, args.seed).map_err(refused)?;
    let base = stacks::options();
    let threads = args.threads.map_or(base.threads, usize::from);
    let options = RunOptions { threads, hash: true, ..base };
    let clock = Instant::now();
    let seed = recorded.info().seed;
    let until = match args.until {
        Some(seconds) => recorded.start().after_ns((seconds * 1e9).round() as u64),
        None => Stamp::MAX,
    };
    let run = recorded.stepped(&asked, log.as_ref(), options).map_err(refused);
    let run = run.context("the recorded run cannot be repeated")?;
    let recording = args.record.as_deref().map(|path| record(args, &run, path)).transpose()?;
    let mut replay = Replay::new(recorded, run)?;
    let failure = replay.run_until(until).err().map(Into::into);
    let comparison = Comparison::with_recording(&original, replay.first());
    let equal = comparison.equal;
    let run = replay.run();
    let mut done = Done::new(run, args, Outcome::End, failure, log.as_ref(), (recording, clock, seed), false);
    // Of two damaged recordings, that of the run itself.
    done.report.log = LogDamage::of(&original).or(done.report.log);
    done.report.runs.extend(done.verdict.take());
    done.report.replay = Some(comparison);
    let ended = done.print(args, Vec::new(), out)?;
    Ok(if equal { ended } else { Ended::Failed })
}

/// What is refused before anything has run is wrong usage: a recording that holds no run or only a part of one, and
/// another stack, seed, parameter or log than the recorded one.
fn refused(error: RunError) -> anyhow::Error {
    match error {
        RunError::Refused(text) => usage(text),
        error => error.into(),
    }
}
