//! Serving as a program does: until a signal, with an exit code.

use crate::config::Config;
use crate::daemon::{Daemon, StartError};
use crate::{memory, signals};
use std::process::ExitCode;

/// Exit code of a bad configuration (EX_CONFIG of sysexits.h), which alone is fatal and which a restart will not cure.
pub const EXIT_CONFIG: u8 = 78;

/// Serves until SIGTERM, SIGINT or a client's `stop`, then ends cleanly. An error is one sentence on stderr.
pub fn serve(config: &Config) -> ExitCode {
    signals::catch();
    let locked = memory::lock();
    match Daemon::start_until(config, signals::asked) {
        Ok(daemon) => {
            tracing::info!(locked, "serves {} (generation {})", daemon.root(), daemon.generation());
            daemon.join();
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("lobulad: {error}");
            match error {
                StartError::Config(_) => ExitCode::from(EXIT_CONFIG),
                StartError::System(_) => ExitCode::FAILURE,
            }
        }
    }
}
