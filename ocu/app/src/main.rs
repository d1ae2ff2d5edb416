//! The program `ocu`.

use clap::Parser as _;
use ocu_app::cli::Cli;
use std::io::IsTerminal as _;
use std::process::ExitCode;
use tracing_subscriber::EnvFilter;

fn main() -> ExitCode {
    let cli = Cli::parse();
    let filter = EnvFilter::try_from_env("OCU_LOG").unwrap_or_else(|_| EnvFilter::new("warn"));
    let colours = std::io::stderr().is_terminal();
    let writer = std::io::stderr;
    tracing_subscriber::fmt().with_env_filter(filter).with_ansi(colours).with_writer(writer).init();
    // Panics in readers of untrusted data are caught and reported by their callers.
    let hook = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |panic| {
        if !rcs_msg::guard::is_guarded() {
            hook(panic);
        }
    }));
    // Errors are not locked: every other thread that logs or panics would wait until the program ends.
    let code = ocu_app::main(&cli, &mut std::io::stdout().lock(), &mut std::io::stderr());
    ExitCode::from(code)
}
