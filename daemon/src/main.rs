//! The binary of the installed service.

use clap::Parser;
use lobulad::config::{self, Config};
use std::path::PathBuf;
use std::process::ExitCode;

/// Owns the camera; publishes events and representations in shared memory.
#[derive(Parser)]
#[command(version)]
struct Arguments {
    /// Configuration; without one a synthetic camera is served.
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Check a configuration, with all it names, and end.
    #[arg(long, value_name = "FILE", conflicts_with = "config")]
    check: Option<PathBuf>,
    /// Directory of the instance, in place of the configured one.
    #[arg(long, value_name = "DIR")]
    root: Option<PathBuf>,
    /// End when the process that started this one does.
    #[arg(long)]
    die_with_parent: bool,
}

fn main() -> ExitCode {
    tracing_subscriber::fmt().with_writer(std::io::stderr).with_target(false).init();
    let arguments = Arguments::parse();
    if arguments.die_with_parent {
        lobulad::die_with_parent();
    }
    let path = arguments.check.as_ref().or(arguments.config.as_ref());
    let mut config = match path.map_or_else(|| Ok(Config::default()), |path| config::load(path)) {
        Ok(config) => config,
        Err(message) => return bad(&message),
    };
    if let Some(root) = arguments.root {
        config.instance.root = Some(root);
    }
    match arguments.check {
        None => lobulad::serve(&config),
        Some(path) => match lobulad::check(&config) {
            Ok(()) => {
                println!("{}: ok", path.display());
                ExitCode::SUCCESS
            }
            Err(error) => bad(&format!("{}: {error}", path.display())),
        },
    }
}

fn bad(message: &str) -> ExitCode {
    eprintln!("lobulad: {message}");
    ExitCode::from(lobulad::EXIT_CONFIG)
}
