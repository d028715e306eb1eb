//! `lobula top`: how the daemon is, again and again, also across its restarts.

use crate::args::TopArgs;
use crate::output::{json, line};
use crate::{Failure, status};
use crossterm::cursor::MoveTo;
use crossterm::terminal::{Clear, ClearType};
use lobula_client::Error;
use std::io::{IsTerminal, Write, stdout};
use std::thread::sleep;
use std::time::Duration;

/// Asks the daemon each interval until the count is reached or the user ends it.
pub fn run(args: &TopArgs) -> Result<(), Failure> {
    let client = crate::connect(args.root.as_deref(), "top")?;
    let on_screen = !args.json && stdout().is_terminal();
    for turn in 0..args.count.unwrap_or(u64::MAX) {
        if turn > 0 {
            sleep(Duration::from_secs_f64(args.interval));
        }
        if on_screen {
            let mut out = stdout().lock();
            crossterm::queue!(out, MoveTo(0, 0), Clear(ClearType::FromCursorDown))?;
            out.flush()?;
        }
        match client.status() {
            Ok(status) if args.json => json(&status)?,
            Ok(status) => status::lines(&status).iter().try_for_each(line)?,
            Err(error @ Error::NoDaemon { .. }) if on_screen => line(format!("{error}"))?,
            Err(Error::NoDaemon { .. }) if args.count.is_none() => {}
            Err(error) => return Err(error.into()),
        }
    }
    Ok(())
}
