//! `ocu diff`: compares two recordings and reports the first difference.

use crate::cli::DiffArgs;
use crate::parts;
use crate::run::Comparison;
use anyhow::Context as _;
use rcs_log::Log;
use std::io::Write;

/// Compares two recordings and prints the result; `false` if they differ.
pub fn diff(args: &DiffArgs, out: &mut dyn Write) -> anyhow::Result<bool> {
    let (first, second) =
        (Log::open_parts(&parts::of(&args.first)?)?, Log::open_parts(&parts::of(&args.second)?)?);
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
    Ok(comparison.equal)
}
