//! `ocu check`: checks everything that a recording states about itself, and every message.

use crate::cli::CheckArgs;
use crate::plain::plain;
use crate::{Ended, stacks};
use anyhow::Context as _;
use ocu_ui::format;
use rcs_log::{LogInfo, Verification};
use serde::Serialize;
use std::io::{IsTerminal as _, Write};
use std::time::{Duration, Instant};

/// Interval at which progress is shown, for the first time after one interval.
const SHOW_EVERY: Duration = Duration::from_millis(500);

/// `ocu check --json`.
#[derive(Debug, Serialize)]
struct Report<'a> {
    sound: bool,
    messages: u64,
    segments: u64,
    lost: Lost,
    problems: &'a [String],
}

/// What could not be read.
#[derive(Debug, Serialize)]
pub(crate) struct Lost {
    pub(crate) bytes: u64,
    pub(crate) messages: u64,
}

impl From<rcs_log::Lost> for Lost {
    fn from(lost: rcs_log::Lost) -> Self {
        Self { bytes: lost.bytes, messages: lost.messages }
    }
}

/// Reads the whole recording and prints its problems.
pub fn check(args: &CheckArgs, out: &mut dyn Write) -> anyhow::Result<Ended> {
    let log = stacks::open_log(&args.log)?;
    let began = Instant::now();
    let mut shown = began;
    let terminal = std::io::stderr().is_terminal();
    let found = log.verify(&mut |done, total| {
        if terminal && shown.elapsed() >= SHOW_EVERY {
            shown = Instant::now();
            let percent = done as f64 * 100.0 / total.max(1) as f64;
            let (done, total) = (format::bytes(done), format::bytes(total));
            // Failing to show the progress does no harm.
            let _ = write!(std::io::stderr(), "\r{percent:3.0} %  {done} of {total} ");
        }
    })?;
    if shown > began {
        let _ = write!(std::io::stderr(), "\r{:60}\r", "");
    }
    if args.json {
        let report = Report {
            sound: found.problems.is_empty(),
            messages: found.messages,
            segments: found.segments,
            lost: found.lost.into(),
            problems: &found.problems,
        };
        serde_json::to_writer_pretty(&mut *out, &report).context("cannot write the report")?;
        writeln!(out)?;
    } else {
        human(log.info(), &found, out)?;
    }
    Ok(if found.problems.is_empty() { Ended::Well } else { Ended::Damaged })
}

fn human(info: &LogInfo, found: &Verification, out: &mut dyn Write) -> anyhow::Result<()> {
    let Verification { segments, messages, lost, problems, .. } = found;
    let size = format::bytes(info.bytes);
    writeln!(out, "checked  {size}, {segments} chunks and runs of messages, {messages} messages")?;
    if *lost != rcs_log::Lost::default() {
        writeln!(out, "lost     {}, {} messages known", format::bytes(lost.bytes), lost.messages)?;
    }
    for problem in problems {
        writeln!(out, "problem  {}", plain(problem))?;
    }
    if problems.is_empty() {
        writeln!(out, "sound    checksums, counts, indexes, attachments and every message")?;
    }
    Ok(())
}
