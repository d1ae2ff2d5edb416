//! Faults on demand, for `ocu run` and `ocu sweep`.

use clap::Args;

/// What goes wrong on purpose.
#[derive(Debug, Clone, Default, Args)]
pub struct FaultArgs {
    /// Fault on demand, TARGET:KIND[=VALUE][@FROM[..TO]] with a process or a buffer and stopped, slowed=MS, frozen,
    /// nan[=FIELD], dropped[=1/N or =PROBABILITY] or late=MS, times in seconds; or a .toml file with a list of them.
    /// May be given several times
    #[arg(long = "fault", value_name = "FAULT")]
    pub faults: Vec<String>,
}
