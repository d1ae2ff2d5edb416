//! `ocu diff`: compares two recordings and reports the first difference, or that of each buffer.

use crate::cli::DiffArgs;
use crate::comparison::Comparison;
use crate::run::LogDamage;
use crate::{Ended, stacks};
use anyhow::Context as _;
use rcs_log::Log;
use rcs_runtime::{NotCompared, RunDifference};
use std::io::Write;

/// Compares two recordings and prints the result: [`Ended::Failed`] if they differ, one begins later or is shorter, or
/// they cannot be compared, [`Ended::Damaged`] if they agree as far as they can be read.
pub fn diff(args: &DiffArgs, out: &mut dyn Write) -> anyhow::Result<Ended> {
    let (first, second) = (stacks::open_full(&args.first)?, stacks::open_full(&args.second)?);
    let runs = rcs_runtime::diff_runs(&first, &second)?;
    let comparison = match rcs_runtime::not_compared(&first, &second) {
        Some(reason) => Comparison::without_messages(runs, text(reason, [&first, &second])),
        None => of_messages([&first, &second], runs, args.all)?,
    };
    // Includes damage found while reading, such as map deltas that could not be applied and were not compared.
    for (log, path) in [(&first, &args.first), (&second, &args.second)] {
        for problem in log.problems() {
            tracing::warn!("{problem}: {}", path.display());
        }
    }
    if args.json {
        serde_json::to_writer_pretty(&mut *out, &comparison).context("cannot write the result")?;
        writeln!(out)?;
    } else {
        comparison.write(out)?;
    }
    if !comparison.equal {
        return Ok(Ended::Failed);
    }
    let damaged = [&first, &second].into_iter().find(|log| LogDamage::of(log).is_some());
    Ok(Ended::after(damaged))
}

/// Compares the messages; tells the first difference of each buffer, or the first of all.
fn of_messages(
    [first, second]: [&Log; 2],
    runs: Vec<RunDifference>,
    tells_all: bool,
) -> anyhow::Result<Comparison> {
    let later = rcs_runtime::diff_starts(first, second)?;
    let shorter = rcs_runtime::diff_lengths(first, second)?;
    let differences = if tells_all {
        rcs_runtime::diff_each(first, second)?
    } else {
        rcs_runtime::diff(first, second)?.into_iter().collect()
    };
    Ok(Comparison::of_recordings([first, second], runs, later, shorter, &differences, tells_all))
}

/// One sentence about why messages are not compared.
fn text(reason: NotCompared, logs: [&Log; 2]) -> String {
    let [first, second] = match reason {
        NotCompared::NoCommonBuffer => return "no buffer in common".to_owned(),
        NotCompared::NoCommonTime => logs.map(|log| {
            let info = log.info();
            if info.messages == 0 {
                return "has no message".to_owned();
            }
            let start = info.complete_from.unwrap_or_default().max(info.start);
            let [from, to] = [start, info.end].map(crate::time::date_and_time);
            format!("is from {from} to {to}")
        }),
    };
    format!("no common time: the first {first}, the second {second}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::CutArgs;
    use std::path::{Path, PathBuf};

    /// What is said of two recordings that do not agree, as text and as JSON.
    fn told(first: &Path, second: &Path) -> (String, serde_json::Value) {
        let [text, json] = [false, true].map(|json| {
            let args = DiffArgs { first: first.to_owned(), second: second.to_owned(), all: false, json };
            let mut out = Vec::new();
            assert_eq!(diff(&args, &mut out).unwrap(), Ended::Failed);
            String::from_utf8(out).unwrap()
        });
        (text.trim_end().to_owned(), serde_json::from_str(&json).unwrap())
    }

    fn cut(log: &Path, from: f64, to: Option<f64>, output: PathBuf) -> PathBuf {
        let args = CutArgs { log: log.to_owned(), from, to, output: output.clone(), force: false };
        assert_eq!(crate::cut::cut(&args, &mut Vec::new()).unwrap(), Ended::Well);
        output
    }

    #[test]
    fn a_recording_and_its_later_part_are_equal_from_where_the_part_begins() {
        let folder = tempfile::tempdir().unwrap();
        let whole = folder.path().join("whole.mcap");
        crate::sample::write(&whole, 4.0, false).unwrap();
        let part = cut(&whole, 2.0, None, folder.path().join("part.mcap"));
        for (first, second, name, start_s) in [(&whole, &part, "second", 2.0), (&part, &whole, "first", 0.0)]
        {
            let (text, json) = told(first, second);
            assert_eq!(text, format!("equal from {start_s:.6} s on, where the {name} begins"));
            let later = serde_json::json!({"recording": name, "start_s": start_s});
            assert_eq!(json, serde_json::json!({"equal": false, "later": later, "first": null}));
        }
    }

    #[test]
    fn recordings_without_a_common_time_are_not_compared() {
        let folder = tempfile::tempdir().unwrap();
        let whole = folder.path().join("whole.mcap");
        crate::sample::write(&whole, 4.0, false).unwrap();
        let before = cut(&whole, 0.0, Some(1.0), folder.path().join("before.mcap"));
        let after = cut(&whole, 2.0, None, folder.path().join("after.mcap"));
        let [before_spans, after_spans] = [&before, &after].map(|path| {
            let log = stacks::open_log(path).unwrap();
            [log.info().start, log.info().end].map(crate::time::date_and_time).join(" to ")
        });
        let expected =
            format!("no common time: the first is from {before_spans}, the second is from {after_spans}");
        let (text, json) = told(&before, &after);
        assert_eq!(text, expected);
        assert_eq!(json, serde_json::json!({"equal": false, "not_compared": expected, "first": null}));
    }
}
