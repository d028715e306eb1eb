//! # lobula-cli
//!
//! The `lobula` tool, as a library, so that other packages (the Python wheel) can start it too. A subcommand is one
//! module and one line in [`args`].
//!
//! ```text
//!  args ─▶ info, convert, slice, check,
//!          render                       files                   (lobula-formats)
//!       ─▶ status, top, echo             a daemon                (lobula-client)
//!       ─▶ serve                         the daemon, in process  (lobulad)
//!       ─▶ demo ─▶ children: serve, demo-reader, demo-floor      the main job, proved on screen
//! ```

pub mod args;
mod failure;
pub mod input;
mod output;

mod check;
pub mod convert;
mod hot_pixels;
mod info;
mod png_file;
mod progress;
pub mod render;

mod echo;
mod status;
mod top;

mod serve;

mod demo;

pub use failure::Failure;

use args::{Args, Command};
use clap::Parser;
use lobula_client::{Client, ClientOptions, Root};
use std::ffi::OsString;
use std::process::ExitCode;

/// Runs the tool with the arguments of a command line, the program's name first.
///
/// Exit codes: 0 done, 1 failed, 2 wrong usage or a bad file, 3 no such stream or device, 4 no daemon, 5 no
/// permission, 6 nothing came in time, 8 another version, 78 a configuration that cannot be served, 130 ended by a signal.
pub fn main(args: impl IntoIterator<Item = OsString>) -> ExitCode {
    let args = match Args::try_parse_from(args) {
        Ok(args) => args,
        Err(error) => {
            // That the message cannot be written leaves nothing else to do.
            let _ = error.print();
            return ExitCode::from(error.exit_code() as u8);
        }
    };
    match run(args.command) {
        Ok(code) => code,
        Err(failure) => {
            failure.print();
            ExitCode::from(failure.code())
        }
    }
}

/// A connection to the daemon that a subcommand asks.
fn connect(root: Option<&std::path::Path>, name: &str) -> Result<Client, Failure> {
    let options = ClientOptions::default().name(format!("lobula {name}"));
    Ok(Client::connect(match root {
        Some(root) => options.root(Root::new(root)?),
        None => options,
    })?)
}

fn run(command: Command) -> Result<ExitCode, Failure> {
    match command {
        Command::Info(args) => info::run(&args),
        Command::HotPixels(args) => hot_pixels::run(&args),
        Command::Convert(args) => convert::run(&args),
        Command::Slice(args) => convert::slice(&args),
        Command::Render(args) => render::run(&args),
        Command::Check(args) => return check::run(&args),
        Command::Status(args) => status::run(&args),
        Command::Top(args) => top::run(&args),
        Command::Echo(args) => echo::run(&args),
        Command::Serve(args) => return serve::run(&args),
        Command::Demo(args) => demo::run(&args),
        Command::DemoReader(args) => demo::reader::run(&args),
        Command::DemoFloor(args) => demo::floor::run(&args),
    }?;
    Ok(ExitCode::SUCCESS)
}
