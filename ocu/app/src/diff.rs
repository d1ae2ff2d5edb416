//! `ocu diff`: compares two recordings and reports the first difference.

use crate::cli::DiffArgs;
use crate::run::{Comparison, LogDamage};
use crate::{Ended, stacks};
use anyhow::Context as _;
use std::io::Write;

/// Compares two recordings and prints the result: [`Ended::Failed`] if they differ, [`Ended::Damaged`] if they agree as
/// far as they can be read.
pub fn diff(args: &DiffArgs, out: &mut dyn Write) -> anyhow::Result<Ended> {
    let (first, second) = (stacks::open_log(&args.first)?, stacks::open_log(&args.second)?);
    let comparison = Comparison::new(rcs_runtime::diff(&first, &second)?.as_ref());
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
        writeln!(out, "{}", comparison.line())?;
    }
    if !comparison.equal {
        return Ok(Ended::Failed);
    }
    let damaged = [&first, &second].into_iter().find(|log| LogDamage::of(log).is_some());
    Ok(Ended::after(damaged))
}
