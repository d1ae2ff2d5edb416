//! `ocu tune`: learns the weights of a world model from a drive, and writes them into a stack file if they are kept.

use crate::cli::{Param, TuneArgs};
use crate::eval::told;
use crate::output::Files;
use crate::{Ended, output, stack_edit, stacks};
use rcs_eval::tune;
use std::io::Write;

/// Executes `ocu tune`.
pub fn tune(args: &TuneArgs, out: &mut dyn Write) -> anyhow::Result<Ended> {
    let mut files = Files::new(args.force);
    files.reads_log("the recording", &args.log);
    if let Some(path) = &args.output {
        files.writes("--output", path)?;
    }
    let overrides: Vec<(String, String)> = args.params.iter().map(Param::to_override).collect();
    let log = stacks::open_log(&args.log)?;
    let course = stacks::course_on(&args.stack, args.course.as_deref(), Some(&log))?;
    let job = tune::Job {
        plan: stacks::plan(&args.stack, course.as_deref(), &overrides)?,
        process: args.process.as_deref(),
        runs: args.run,
        options: stacks::options(),
    };
    let tuned = tune::tune(&job, &log).map_err(told)?;
    let kept = tuned.report.kept;
    if let Some(path) = args.output.as_ref().filter(|_| kept) {
        let (file, text) = stacks::text_of(&args.stack)?;
        let course = args.course.as_deref();
        let text = stack_edit::with_params(&file, &text, course, &tuned.report.process, &tuned.params)?;
        output::write(path, text.as_bytes(), args.force)?;
    }
    if args.json {
        serde_json::to_writer_pretty(&mut *out, &tuned.report)?;
        writeln!(out)?;
        return Ok(Ended::after(Some(&log)));
    }
    write!(out, "{}", tuned.report)?;
    match &args.output {
        Some(path) if kept => writeln!(out, "written to {}", path.display())?,
        Some(_) => writeln!(out, "nothing is written")?,
        None => {}
    }
    Ok(Ended::after(Some(&log)))
}
