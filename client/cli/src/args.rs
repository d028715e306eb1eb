//! The command line: every subcommand and option.

use clap::{Parser, Subcommand};
use lobula_core::Geometry;
use std::path::PathBuf;

/// Event cameras on robots: recordings, the daemon and its clients.
#[derive(Debug, Parser)]
#[command(name = "lobula", version, about)]
pub struct Args {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

/// The subcommands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Tells what is in a recording
    Info(InfoArgs),
    /// Tells how the daemon is
    Status(StatusArgs),
    /// Tells how the daemon is, again and again
    Top(TopArgs),
    /// Prints the events or the tensors of a view as they come
    Echo(EchoArgs),
}

/// Options of `info`.
#[derive(Debug, clap::Args)]
pub struct InfoArgs {
    /// The recording
    pub file: PathBuf,
    /// One line of JSON
    #[arg(long)]
    pub json: bool,
    /// Also the SHA-256 over all events: each as little-endian u64 t (µs), u16 x, u16 y, u8 p
    #[arg(long)]
    pub digest: bool,
    /// Columns and rows of the sensor, where the file does not tell
    #[arg(long, value_name = "WxH", value_parser = geometry)]
    pub sensor_size: Option<Geometry>,
}

/// Options of `status`.
#[derive(Debug, clap::Args)]
pub struct StatusArgs {
    /// One line of JSON
    #[arg(long)]
    pub json: bool,
}

/// Options of `top`.
#[derive(Debug, clap::Args)]
pub struct TopArgs {
    /// One line of JSON each time
    #[arg(long)]
    pub json: bool,
    /// Seconds between two times
    #[arg(long, default_value_t = 1.0, value_parser = seconds)]
    pub interval: f64,
    /// End after so many times
    #[arg(short = 'n', long)]
    pub count: Option<u64>,
}

/// Options of `echo`.
#[derive(Debug, clap::Args)]
pub struct EchoArgs {
    /// `events`, or the name of a view
    pub stream: String,
    /// A line of JSON each
    #[arg(long)]
    pub json: bool,
    /// End after so many events (of a view: tensors)
    #[arg(short = 'n', long)]
    pub count: Option<u64>,
    /// Only the SHA-256 over all events received (of a view: over its tensors' bytes), when the replay ends
    #[arg(long)]
    pub digest: bool,
    /// Clients that a lossless replay waits for
    #[arg(long, default_value_t = 1)]
    pub clients: u32,
    /// Seconds to wait for something to come
    #[arg(long, default_value_t = 10.0, value_parser = seconds)]
    pub timeout: f64,
}

fn geometry(text: &str) -> Result<Geometry, String> {
    let sides = text.split_once('x').and_then(|(w, h)| Some((w.parse().ok()?, h.parse().ok()?)));
    match sides {
        Some((width, height)) if width > 0 && height > 0 => Ok(Geometry::new(width, height)),
        _ => Err("give columns and rows, such as 1280x720".into()),
    }
}

fn seconds(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(seconds) if (0.01..=86_400.0).contains(&seconds) => Ok(seconds),
        _ => Err("give 0.01 to 86400 seconds".into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn the_command_line_is_consistent() {
        Args::command().debug_assert();
    }

    #[test]
    fn sizes_are_two_numbers() {
        assert_eq!(geometry("640x480"), Ok(Geometry::new(640, 480)));
        for bad in ["640", "0x1", "640x480x1", "-1x2", "70000x1"] {
            assert!(geometry(bad).is_err(), "{bad}");
        }
    }
}
