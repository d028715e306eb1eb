//! `lobula serve`: the daemon, in this process.

use crate::args::ServeArgs;
use crate::{Failure, output};
use lobula_client::{Client, ClientOptions, Root};
use lobulad::config::{self, Config};
use std::process::ExitCode;
use std::time::Duration;

/// Serves until a signal or a client's `stop`; the daemon's own exit codes.
pub fn run(args: &ServeArgs) -> Result<ExitCode, Failure> {
    tracing_subscriber::fmt().with_writer(std::io::stderr).with_target(false).init();
    if args.die_with_parent {
        lobulad::die_with_parent();
    }
    let config = args.config.as_ref().map_or_else(|| Ok(Config::default()), |path| config::load(path));
    let mut config = config.map_err(|error| Failure::new(lobulad::EXIT_CONFIG, error))?;
    if args.root.is_some() {
        config.instance.root.clone_from(&args.root);
    }
    if args.json {
        let root = config.instance.root.clone().map_or_else(Root::from_env, Root::new)?;
        std::thread::spawn(move || tell(root));
    }
    Ok(lobulad::serve(&config))
}

/// Prints who serves, once somebody does.
fn tell(root: Root) {
    let options = ClientOptions::default().root(root).name("lobula serve");
    if let Ok(client) = Client::connect_within(options, Duration::from_secs(60)) {
        // A reader that has gone does not end the daemon.
        let _ = output::json(&client.hello());
    }
}
