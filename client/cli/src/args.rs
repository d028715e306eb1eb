//! The command line: every subcommand and option.

use crate::convert::{self, Numbers, Region, Time};
use crate::input::{self, InputArgs};
use crate::render;
use clap::{Parser, Subcommand};
use lobula_core::Polarity;
use lobula_core::chain::Spec;
use lobula_core::wire::Encoding;
use lobula_formats::{Compression, Rebase};
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
    /// Writes a recording in another format
    Convert(ConvertArgs),
    /// Writes a part of a recording
    Slice(SliceArgs),
    /// Writes tensors of a recording's windows, as a NumPy array or as pictures
    Render(RenderArgs),
    /// Learns the hot pixels of a recording's camera, for filters
    HotPixels(HotPixelsArgs),
    /// Tells whether a recording is whole and in order, and what of it can be read
    Check(CheckArgs),
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
    /// What the file does not tell
    #[command(flatten)]
    pub input: InputArgs,
}

/// Options of `hot-pixels`.
#[derive(Debug, clap::Args)]
pub struct HotPixelsArgs {
    /// The recording; best a long one of a quiet scene
    pub file: PathBuf,
    /// The list to write, or a folder for one named by the camera's serial number; by default none is written
    pub output: Option<PathBuf>,
    /// How many standard deviations above the mean count of the pixels that fired a hot pixel's is, at least
    #[arg(long, value_name = "N", default_value_t = 3.0)]
    pub sigmas: f32,
    /// The camera's serial number, in place of what the file tells
    #[arg(long, value_name = "SERIAL")]
    pub serial: Option<String>,
    /// Replace the list that is there
    #[arg(long)]
    pub overwrite: bool,
    /// One line of JSON
    #[arg(long)]
    pub json: bool,
    /// What the file does not tell
    #[command(flatten)]
    pub input: InputArgs,
}

/// Options of `check`.
#[derive(Debug, clap::Args)]
pub struct CheckArgs {
    /// The recording
    pub file: PathBuf,
    /// One line of JSON
    #[arg(long)]
    pub json: bool,
    /// What the file does not tell
    #[command(flatten)]
    pub input: InputArgs,
}

/// Which part of a recording: between two times, or all of it.
#[derive(Debug, clap::Args)]
pub struct PartArgs {
    /// Only from this time on: µs, or a number with s, ms or us; +1s counts from the first event
    #[arg(long, value_name = "TIME", value_parser = convert::time)]
    pub t_start: Option<Time>,
    /// Only before this time
    #[arg(long, value_name = "TIME", value_parser = convert::time)]
    pub t_stop: Option<Time>,
}

/// Options of `convert`.
#[derive(Debug, clap::Args)]
pub struct ConvertArgs {
    /// The recording
    pub file: PathBuf,
    /// The file to write; the end of its name says the format
    pub output: PathBuf,
    /// Which part of it
    #[command(flatten)]
    pub part: PartArgs,
    /// Only events of this polarity
    #[arg(long, value_name = "on|off", value_parser = convert::polarity)]
    pub polarity: Option<Polarity>,
    /// Only events of this part of the sensor, which keeps its size
    #[arg(long, value_name = "X,Y,WxH", value_parser = convert::region)]
    pub roi: Option<Region>,
    /// Only events of pixels that are not in this list, which `lobula hot-pixels` wrote
    #[arg(long, value_name = "FILE")]
    pub hot_pixels: Option<PathBuf>,
    /// Filters and transforms, first to last, after --polarity and --roi: JSON, or a file of it, such as
    /// [{"kind": "denoise"}, {"kind": "crop", "x": 160, "y": 120, "width": 320, "height": 240}]
    #[arg(long, value_name = "JSON|FILE", value_parser = convert::chain)]
    pub chain: Option<Spec>,
    /// Format to write, in place of what the end of the name says
    #[arg(long, value_name = "NAME")]
    pub format: Option<String>,
    /// How to encode events, in a camera's format: evt2, evt21, evt21_legacy, evt3 or evt4
    #[arg(long, value_name = "NAME", value_parser = input::encoding)]
    pub output_encoding: Option<Encoding>,
    /// How to compress, where the format can: none, lz4, lz4-high, zstd, zstd-high, gzip or bz2
    #[arg(long, value_name = "NAME")]
    pub compression: Option<Compression>,
    /// Which layout, where the format has several: lobula or dsec
    #[arg(long, value_name = "NAME")]
    pub layout: Option<String>,
    /// Subtract this from every time; without a number the time of the first item
    #[arg(long, value_name = "MICROSECONDS", value_parser = convert::rebase, num_args = 0..=1, require_equals = true, default_missing_value = "first")]
    pub rebase: Option<Rebase>,
    /// Replace the file that is there
    #[arg(long)]
    pub overwrite: bool,
    /// Keep what comes before a place that cannot be read
    #[arg(long)]
    pub recover: bool,
    /// One line of JSON
    #[arg(long)]
    pub json: bool,
    /// What the file does not tell
    #[command(flatten)]
    pub input: InputArgs,
}

/// Options of `slice`.
#[derive(Debug, clap::Args)]
pub struct SliceArgs {
    /// Only events of these numbers, counted from 0 in file order, the end not included
    #[arg(long, value_name = "FIRST..END", value_parser = convert::numbers, conflicts_with_all = ["t_start", "t_stop"])]
    pub events: Option<Numbers>,
    /// The rest
    #[command(flatten)]
    pub convert: ConvertArgs,
}

/// Options of `render`.
#[derive(Debug, clap::Args)]
pub struct RenderArgs {
    /// The recording
    pub file: PathBuf,
    /// An .npy file for an array N x C x H x W, or a folder for a picture of each window, named by its start in µs, or with
    /// --slice-events by its number from 0 on
    pub output: PathBuf,
    /// What kind of tensor, such as count, voxel_grid or time_surface: those of the daemon's views
    #[arg(long, value_name = "NAME")]
    pub kind: String,
    /// Length of a window: µs, or a number with s, ms or us; windows begin at multiples of it
    #[arg(long, value_name = "TIME", default_value = "33ms", value_parser = convert::time)]
    pub period: Time,
    /// From the start of one window to that of the next, a whole part of the period: shorter than it, windows overlap
    /// [default: the period]
    #[arg(long, value_name = "TIME", value_parser = convert::time)]
    pub stride: Option<Time>,
    /// Number of events of a window, in place of a period
    #[arg(long, value_name = "N", conflicts_with_all = ["period", "stride"])]
    pub slice_events: Option<u32>,
    /// From the first event of one window to that of the next, a whole part of --slice-events: fewer, and windows overlap
    /// [default: as many]
    #[arg(long, value_name = "N", requires = "slice_events")]
    pub stride_events: Option<u32>,
    /// Another setting of the view, such as dtype=u16 or bins=9; again for more
    #[arg(long, value_name = "KEY=VALUE", value_parser = render::setting)]
    pub set: Vec<(String, String)>,
    /// Which part of it
    #[command(flatten)]
    pub part: PartArgs,
    /// Replace files that are there
    #[arg(long)]
    pub overwrite: bool,
    /// One line of JSON
    #[arg(long)]
    pub json: bool,
    /// What the file does not tell
    #[command(flatten)]
    pub input: InputArgs,
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
}
