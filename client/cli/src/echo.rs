//! `lobula echo`: the events or the tensors of a view, as they come.

use crate::Failure;
use crate::args::EchoArgs;
use crate::output::{json, line};
use lobula_client::{Client, Dtype, Packet, Stream, SubscribeOptions, Tensor};
use lobula_core::f16;
use lobula_formats::Digest;
use serde::Serialize;
use sha2::Digest as _;
use std::fmt::Write as _;
use std::io::Write as _;
use std::time::Duration;

/// Subscribes and prints until the count is reached or the source ends.
pub fn run(args: &EchoArgs) -> Result<(), Failure> {
    let client = crate::connect(args.root.as_deref(), "echo")?;
    let view = (args.stream != "events").then(|| args.stream.trim_start_matches("view/"));
    let stream = view.map_or_else(Stream::events, Stream::view);
    // A daemon offers a stream either live or as a lossless replay: take what there is.
    let lossless = client.hello().streams.contains(&stream.clone().lossless().to_string());
    let options = SubscribeOptions::default();
    let options = if lossless { options.lossless() } else { options };
    match view {
        None => {
            let mut events = client.events(options)?;
            begin(&client, args, lossless)?;
            echo_events(args, |timeout| Ok(events.recv(timeout)?))
        }
        Some(name) => {
            let mut tensors = client.view(name, options)?;
            begin(&client, args, lossless)?;
            echo_view(args, |timeout| Ok(tensors.recv(timeout)?))
        }
    }
}

/// A lossless replay starts when its clients say so.
fn begin(client: &Client, args: &EchoArgs, lossless: bool) -> Result<(), Failure> {
    if lossless {
        client.play(args.clients)?;
    }
    Ok(())
}

/// A packet's place in the digest of all events.
#[derive(Serialize)]
struct EventsDigest {
    events: u64,
    lost: u64,
    sha256: String,
}

fn echo_events(
    args: &EchoArgs,
    mut recv: impl FnMut(Duration) -> Result<Packet, Failure>,
) -> Result<(), Failure> {
    let mut digest = Digest::default();
    let (mut events, mut lost) = (0, 0);
    let most = args.count.unwrap_or(u64::MAX);
    while events < most {
        let packet = recv(Duration::from_secs_f64(args.timeout))?;
        lost += packet.lost_before();
        let take = (most - events).min(packet.len() as u64) as usize;
        let span = packet.span();
        let span = span.with_events(packet.get(..take).unwrap_or_default());
        events += take as u64;
        if args.digest {
            digest.update(span);
        } else {
            print_events(span, args.json)?;
        }
        if packet.is_end() {
            break;
        }
    }
    match (args.digest, args.json) {
        (false, _) => Ok(()),
        (true, true) => json(&EventsDigest { events, lost, sha256: digest.finish() }),
        (true, false) => line(format!("{}  {events} events, {lost} lost", digest.finish())),
    }
}

fn print_events(span: lobula_core::Span<'_>, as_json: bool) -> Result<(), Failure> {
    let mut text = String::with_capacity(span.events.len() * 24);
    for event in span.events {
        let (t, x, y, p) = (span.time(*event), event.x(), event.y(), event.is_on() as u8);
        // Writing to a string cannot fail.
        let _ = match as_json {
            true => writeln!(text, r#"{{"t":{t},"x":{x},"y":{y},"p":{p}}}"#),
            false => writeln!(text, "{t} {x} {y} {p}"),
        };
    }
    Ok(std::io::stdout().lock().write_all(text.as_bytes())?)
}

/// One window of a view, for programs and people.
#[derive(Serialize)]
struct Window {
    t0: u64,
    t1: u64,
    events: u64,
    dtype: Option<Dtype>,
    shape: [u32; 3],
    min: f64,
    max: f64,
    mean: f64,
    lost_before: u64,
}

#[derive(Serialize)]
struct ViewDigest {
    windows: u64,
    lost: u64,
    sha256: String,
}

fn echo_view(
    args: &EchoArgs,
    mut recv: impl FnMut(Duration) -> Result<Tensor, Failure>,
) -> Result<(), Failure> {
    let mut sha = sha2::Sha256::new();
    let (mut windows, mut lost) = (0, 0);
    while windows < args.count.unwrap_or(u64::MAX) {
        let tensor = recv(Duration::from_secs_f64(args.timeout))?;
        // What only says that the source has ended is no window.
        let empty_end = tensor.is_end() && tensor.bytes().is_empty();
        lost += tensor.lost_before();
        if !empty_end {
            windows += 1;
            sha.update(tensor.bytes());
            if !args.digest {
                print_window(&window(&tensor), args.json)?;
            }
        }
        if tensor.is_end() {
            break;
        }
    }
    let sha256: String = sha.finalize().iter().map(|byte| format!("{byte:02x}")).collect();
    match (args.digest, args.json) {
        (false, _) => Ok(()),
        (true, true) => json(&ViewDigest { windows, lost, sha256 }),
        (true, false) => line(format!("{sha256}  {windows} windows, {lost} lost")),
    }
}

fn print_window(window: &Window, as_json: bool) -> Result<(), Failure> {
    if as_json {
        return json(window);
    }
    let [channels, height, width] = window.shape;
    line(format!(
        "[{}, {}) µs  {channels}x{height}x{width}  {} events  min {:.4} mean {:.6} max {:.4}",
        window.t0, window.t1, window.events, window.min, window.mean, window.max
    ))
}

fn window(tensor: &Tensor) -> Window {
    let header = tensor.header();
    let (min, max, mean) = match header.dtype() {
        Some(Dtype::U8) => range(tensor.elements::<u8>().unwrap_or_default().iter().map(|v| *v as f64)),
        Some(Dtype::U16) => range(tensor.elements::<u16>().unwrap_or_default().iter().map(|v| *v as f64)),
        Some(Dtype::F16) => range(tensor.elements::<f16>().unwrap_or_default().iter().map(|v| v.to_f64())),
        Some(Dtype::F32) => range(tensor.elements::<f32>().unwrap_or_default().iter().map(|v| *v as f64)),
        None => (0.0, 0.0, 0.0),
    };
    Window {
        t0: header.t0,
        t1: header.t1,
        events: header.events,
        dtype: header.dtype(),
        shape: header.shape,
        min,
        max,
        mean,
        lost_before: tensor.lost_before(),
    }
}

/// Smallest, largest and mean value; zeros where there is none.
fn range(values: impl ExactSizeIterator<Item = f64>) -> (f64, f64, f64) {
    let n = values.len();
    if n == 0 {
        return (0.0, 0.0, 0.0);
    }
    let start = (f64::INFINITY, f64::NEG_INFINITY, 0.0);
    let (min, max, sum) = values.fold(start, |(min, max, sum), v| (min.min(v), max.max(v), sum + v));
    (min, max, sum / n as f64)
}
