//! `ocu diff`: compares two recordings and reports the first difference, or that of each buffer.

use crate::cli::DiffArgs;
use crate::comparison::Comparison;
use crate::run::LogDamage;
use crate::{Ended, stacks};
use anyhow::Context as _;
use std::io::Write;

/// Compares two recordings and prints the result: [`Ended::Failed`] if they differ or one is shorter, [`Ended::Damaged`] if
/// they agree as far as they can be read.
pub fn diff(args: &DiffArgs, out: &mut dyn Write) -> anyhow::Result<Ended> {
    let (first, second) = (stacks::open_full(&args.first)?, stacks::open_full(&args.second)?);
    let runs = rcs_runtime::diff_runs(&first, &second)?;
    let shorter = rcs_runtime::diff_lengths(&first, &second)?;
    let differences = if args.all {
        rcs_runtime::diff_each(&first, &second)?
    } else {
        rcs_runtime::diff(&first, &second)?.into_iter().collect()
    };
    let comparison = Comparison::of_recordings([&first, &second], runs, shorter, &differences, args.all);
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
