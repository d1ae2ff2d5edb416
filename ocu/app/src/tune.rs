//! `ocu tune`: learns the weights of a world model from a drive, and writes them into a stack file if they are kept.

use crate::cli::{Param, TuneArgs};
use crate::eval::told;
use crate::output::Files;
use crate::{Ended, despite_closed_output, output, stack_edit, stacks};
use anyhow::bail;
use rcs_eval::tune;
use std::io::Write;
use std::path::Path;

/// Executes `ocu tune`. It fails where a file was asked for and no weights were kept: a script that goes on with the file
/// would fail later, or use an older one.
pub fn tune(args: &TuneArgs, out: &mut dyn Write) -> anyhow::Result<Ended> {
    let mut files = Files::new(args.force);
    files.reads_log("the recording", &args.log);
    if let Some(path) = &args.output {
        files.writes("--output", path)?;
    }
    let overrides: Vec<(String, String)> = args.params.iter().map(Param::to_override).collect();
    let log = stacks::open_full(&args.log)?;
    let (course, warning) = stacks::course_and_warning(&args.stack, args.course.as_deref(), Some(&log));
    let job = tune::Job {
        plan: stacks::plan(&args.stack, course.as_deref(), &overrides)?,
        process: args.process.as_deref(),
        runs: args.run,
        options: stacks::options(),
    };
    // Refused before the weights are learned, which takes long.
    let stack = args.output.as_ref().map(|path| stack_for(args, path)).transpose()?;
    // On recorded maps no stack runs, so that it drives to no goal.
    if let Some(warning) = warning.filter(|_| job.runs_on(&log).unwrap_or(false)) {
        tracing::warn!("{warning}");
    }
    let tuned = tune::tune(&job, &log).map_err(told)?;
    let kept = tuned.report.kept;
    if let Some((path, (file, text))) = args.output.as_ref().zip(stack).filter(|_| kept) {
        let course = args.course.as_deref();
        let text = stack_edit::with_params(&file, &text, course, &tuned.report.process, &tuned.params)?;
        output::write(path, text.as_bytes(), args.force)?;
    }
    despite_closed_output(print(args, &tuned.report, out))?;
    let ended = Ended::after(Some(&log));
    match &args.output {
        Some(path) if !kept => {
            bail!("no file was written ({}): {}", tuned.report.verdict(), path.display())
        }
        _ => Ok(ended),
    }
}

/// The file of the stack and its text, which is written to `path` with new weights; an error if it would not start from
/// there.
fn stack_for(args: &TuneArgs, path: &Path) -> anyhow::Result<(String, String)> {
    let (file, text) = stacks::text_of(&args.stack)?;
    stack_edit::check_path(path, &file, &text, args.course.as_deref())?;
    Ok((file, text))
}

/// Prints what was learned.
fn print(args: &TuneArgs, report: &tune::Report, out: &mut dyn Write) -> anyhow::Result<()> {
    if args.json {
        serde_json::to_writer_pretty(&mut *out, report)?;
        writeln!(out)?;
        return Ok(());
    }
    write!(out, "{report}")?;
    if let Some(path) = args.output.as_ref().filter(|_| report.kept) {
        writeln!(out, "written to {}", path.display())?;
    }
    Ok(())
}
