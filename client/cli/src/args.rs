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
    /// Proves the main job on screen, with a synthetic camera and processes of its own
    Demo(DemoArgs),
    /// Runs the daemon here, in the foreground
    Serve(ServeArgs),
    /// Tells how the daemon is
    Status(StatusArgs),
    /// Tells how the daemon is, again and again
    Top(TopArgs),
    /// Prints the events or the tensors of a view as they come
    Echo(EchoArgs),
    /// A client process of the demo
    #[command(hide = true)]
    DemoReader(ReaderArgs),
    /// One end of bare iceoryx2, a process of the demo
    #[command(hide = true)]
    DemoFloor(FloorArgs),
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

/// Options of `demo`.
#[derive(Debug, Clone, clap::Args)]
pub struct DemoArgs {
    /// A recording at its own pace instead of the synthetic camera
    #[arg(long, value_name = "FILE")]
    pub input: Option<PathBuf>,
    /// How much faster than it was recorded the input is played
    #[arg(long, default_value_t = 1.0, requires = "input")]
    pub speed: f64,
    /// Start the input over at its end (a recording shorter than the demo always does)
    #[arg(long = "loop", requires = "input")]
    pub looped: bool,
    /// How long it takes, without the start
    #[arg(long, default_value_t = 20.0, value_parser = seconds)]
    pub seconds: f64,
    /// Rate of the synthetic camera in Mev/s, 0.1 to 30 (from 10000 on: in events/s)
    #[arg(long, default_value = "1", value_parser = rate, conflicts_with = "input")]
    pub rate: Rate,
    /// Leave the daemon running
    #[arg(long)]
    pub keep: bool,
    /// One line of JSON at the end and nothing else
    #[arg(long)]
    pub json: bool,
}

/// Events per second.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Rate(pub u32);

/// Options of `serve`.
#[derive(Debug, clap::Args)]
pub struct ServeArgs {
    /// The configuration; default a synthetic camera of 1 Mev/s
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Directory of the instance, in place of the configured one
    #[arg(long, value_name = "DIR")]
    pub root: Option<PathBuf>,
    /// A line of JSON once it serves
    #[arg(long)]
    pub json: bool,
    /// End when the process that started this one does
    #[arg(long, hide = true)]
    pub die_with_parent: bool,
}

/// Options of `status`.
#[derive(Debug, clap::Args)]
pub struct StatusArgs {
    /// Directory of the instance; default $LOBULA_ROOT, else that of this user
    #[arg(long, value_name = "DIR")]
    pub root: Option<PathBuf>,
    /// One line of JSON
    #[arg(long)]
    pub json: bool,
}

/// Options of `top`.
#[derive(Debug, clap::Args)]
pub struct TopArgs {
    /// Directory of the instance; default $LOBULA_ROOT, else that of this user
    #[arg(long, value_name = "DIR")]
    pub root: Option<PathBuf>,
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
    /// Directory of the instance; default $LOBULA_ROOT, else that of this user
    #[arg(long, value_name = "DIR")]
    pub root: Option<PathBuf>,
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

/// Options of the demo's client process.
#[derive(Debug, clap::Args)]
pub struct ReaderArgs {
    /// Directory of the instance
    #[arg(long)]
    pub root: PathBuf,
    /// Name in the daemon's list
    #[arg(long)]
    pub name: String,
}

/// Options of one end of bare iceoryx2.
#[derive(Debug, clap::Args)]
pub struct FloorArgs {
    /// Directory of its own
    #[arg(long)]
    pub root: PathBuf,
    /// Publish this many packets, one a millisecond; without it: receive them
    #[arg(long)]
    pub publish: Option<u64>,
    /// Events in a packet
    #[arg(long, default_value_t = 1000)]
    pub events: usize,
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

fn rate(text: &str) -> Result<Rate, String> {
    let number: f64 = text.parse().map_err(|_| "give a number of Mev/s, such as 10".to_string())?;
    let evs = if number < 10_000.0 { number * 1e6 } else { number };
    match evs {
        evs if (1e5..=3e7).contains(&evs) => Ok(Rate(evs as u32)),
        _ => Err("give 0.1 to 30 Mev/s".into()),
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
    fn rates_are_in_mevs_or_plainly_not() {
        assert_eq!(rate("0.1"), Ok(Rate(100_000)));
        assert_eq!(rate("30"), Ok(Rate(30_000_000)));
        assert_eq!(rate("1000000"), Ok(Rate(1_000_000)));
        for bad in ["0", "31", "-1", "nan", "fast", "9999", "40000000"] {
            assert!(rate(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn sizes_are_two_numbers() {
        assert_eq!(geometry("640x480"), Ok(Geometry::new(640, 480)));
        for bad in ["640", "0x1", "640x480x1", "-1x2", "70000x1"] {
            assert!(geometry(bad).is_err(), "{bad}");
        }
    }
}
