//! Command-line options that limit the history kept of a run.

use clap::Args;
use rcs_runtime::PastOptions;
use std::path::PathBuf;

/// Limits of the history kept of a run, and its folder.
#[derive(Debug, Clone, Default, PartialEq, Eq, Args)]
pub struct PastArgs {
    /// Memory for the past of a run and for the pictures of it, like 512MiB; 1GiB by default
    #[arg(long, value_name = "SIZE", value_parser = parse_memory)]
    pub memory: Option<u64>,
    /// Disk that the past of a run may take, like 20GiB, or 0 for none; 4GiB by default. What does not fit is computed again
    /// when it is viewed
    #[arg(long, value_name = "SIZE", value_parser = parse_bytes)]
    pub disk: Option<u64>,
    /// Folder for what of the past is on disk, by default in the user's cache
    #[arg(long, value_name = "FOLDER")]
    pub disk_folder: Option<PathBuf>,
}

impl PastArgs {
    /// The options, with defaults for missing ones.
    pub fn options(&self) -> PastOptions {
        let default = PastOptions::default();
        PastOptions {
            memory_bytes: self.memory.unwrap_or(default.memory_bytes),
            disk_bytes: self.disk.unwrap_or(default.disk_bytes),
            folder: self.disk_folder.clone().unwrap_or(default.folder),
        }
    }
}

/// Smallest memory limit: less would not hold one second of camera images.
const LEAST_MEMORY: u64 = 64 << 20;

fn parse_memory(text: &str) -> Result<u64, String> {
    match parse_bytes(text)? {
        bytes if bytes < LEAST_MEMORY => Err(format!("expected at least 64MiB, got {text:?}")),
        bytes => Ok(bytes),
    }
}

/// Parses a number of bytes: `512MiB`, `20GB`, `0`.
fn parse_bytes(text: &str) -> Result<u64, String> {
    const UNITS: [(&str, f64); 8] = [
        ("KiB", 1024.0),
        ("MiB", 1_048_576.0),
        ("GiB", 1_073_741_824.0),
        ("TiB", 1_099_511_627_776.0),
        ("kB", 1e3),
        ("MB", 1e6),
        ("GB", 1e9),
        ("TB", 1e12),
    ];
    let found = UNITS.iter().find_map(|(unit, bytes)| Some((text.strip_suffix(unit)?, *bytes)));
    let (number, unit) = found.unwrap_or((text, 1.0));
    match number.trim().parse::<f64>() {
        Ok(number) if number.is_finite() && (0.0..=1e15).contains(&(number * unit)) => {
            Ok((number * unit) as u64)
        }
        _ => Err(format!("expected a size like 512MiB or 4GiB, got {text:?}")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_read_with_their_units_and_nothing_else_is() {
        assert_eq!(parse_bytes("4GiB"), Ok(4 << 30));
        assert_eq!(parse_bytes("1.5 GB"), Ok(1_500_000_000));
        assert_eq!(parse_bytes("0"), Ok(0));
        for bad in ["", "GiB", "-1GB", "nan", "4 gigs", "1e99TB"] {
            assert!(parse_bytes(bad).is_err_and(|error| error.contains("expected a size")), "{bad}");
        }
        assert!(parse_memory("1MiB").is_err_and(|error| error.contains("at least 64MiB")));
    }

    #[test]
    fn what_is_not_said_keeps_its_default() {
        let args = PastArgs { disk: Some(0), ..PastArgs::default() };
        assert_eq!(args.options(), PastOptions { disk_bytes: 0, ..PastOptions::default() });
    }
}
