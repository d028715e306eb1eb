//! `lobula convert` and `lobula slice`: a recording, or a part of it, into another file.

use crate::Failure;
use crate::args::{ConvertArgs, PartArgs, SliceArgs};
use crate::output::{json, line, thousands};
use crate::progress::Progress;
use lobula_core::chain::{Chain, Spec};
use lobula_core::filter::{PolarityFilter, PolarityParams, RegionOfInterest, RegionParams};
use lobula_core::{Block, Event, Filter, Polarity, Transform, WrongGeometry};
use lobula_formats::{
    Copied, CopyOptions, CopyPart, Error, HotPixels, Rebase, Recording, WriteOptions, Writer, Written, copy,
};
use serde::Serialize;
use std::ops::Range;
use std::path::Path;

/// Converts, all of it or between two times.
pub fn run(args: &ConvertArgs) -> Result<(), Failure> {
    let recording = args.input.open(&args.file)?;
    let part = part(&recording, &args.part)?;
    write(&recording, &args.output, part, args)
}

/// Cuts, which is converting with a part that must be given.
pub fn slice(args: &SliceArgs) -> Result<(), Failure> {
    let convert = &args.convert;
    let recording = convert.input.open(&convert.file)?;
    let part = match &args.events {
        Some(events) => CopyPart::Events(events.0.clone()),
        None => part(&recording, &convert.part)?,
    };
    if part == CopyPart::All {
        return Err(Failure::new(
            Failure::INPUT,
            "say which part: --t-start and --t-stop, or --events FIRST..END",
        ));
    }
    write(&recording, &convert.output, part, convert)
}

/// A time on the command line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Time {
    /// In µs.
    pub us: u64,
    /// Whether it counts from the first event.
    pub from_first: bool,
}

/// Reads a time: µs, or a number with its unit, from the first event on where it begins with a plus.
pub fn time(text: &str) -> Result<Time, String> {
    let bad = || format!("give a time such as 1500000, 1.5s, 20ms, +1s (from the first event), not {text}");
    let (from_first, number) = text.strip_prefix('+').map_or((false, text), |rest| (true, rest));
    let unit_at = number.find(|c: char| c.is_ascii_alphabetic()).unwrap_or(number.len());
    let (number, unit) = number.split_at(unit_at);
    let digits = match unit {
        "" | "us" => 0,
        "ms" => 3,
        "s" => 6,
        _ => return Err(bad()),
    };
    let (whole, part) = number.split_once('.').unwrap_or((number, ""));
    if part.len() > digits || whole.is_empty() {
        return Err(bad());
    }
    let us = format!("{whole}{part:0<digits$}").parse().map_err(|_| bad())?;
    Ok(Time { us, from_first })
}

/// Reads which polarity stays.
pub fn polarity(text: &str) -> Result<Polarity, String> {
    match text {
        "on" => Ok(Polarity::On),
        "off" => Ok(Polarity::Off),
        _ => Err(format!("give on or off, not {text}")),
    }
}

/// Reads what to subtract from every time.
pub fn rebase(text: &str) -> Result<Rebase, String> {
    match text {
        "first" => Ok(Rebase::First),
        _ => text.parse().map(Rebase::By).map_err(|_| format!("give a number of µs, or first, not {text}")),
    }
}

/// Numbers of events.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Numbers(pub Range<u64>);

/// Reads `FIRST..END`.
pub fn numbers(text: &str) -> Result<Numbers, String> {
    let ends = text.split_once("..").and_then(|(first, end)| Some(first.parse().ok()?..end.parse().ok()?));
    ends.map(Numbers).ok_or_else(|| format!("give FIRST..END, such as 0..1000, not {text}"))
}

/// A region of interest.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Region {
    x: u16,
    y: u16,
    width: u16,
    height: u16,
}

/// Reads `X,Y,WxH`.
pub fn region(text: &str) -> Result<Region, String> {
    let read = || {
        let mut parts = text.splitn(3, ',');
        let (x, y) = (parts.next()?.parse().ok()?, parts.next()?.parse().ok()?);
        let (width, height) = parts.next()?.split_once('x')?;
        Some(Region { x, y, width: width.parse().ok()?, height: height.parse().ok()? })
    };
    read().ok_or_else(|| format!("give left column, top row and size, such as 100,50,640x480, not {text}"))
}

/// Reads the stages of a chain: JSON, or the name of a file of it. Files of hot pixels are looked for where that file is.
pub fn chain(text: &str) -> Result<Spec, String> {
    let read = |json: &str, folder: &Path| {
        let mut spec = serde_json::from_str(json).map_err(|error| error.to_string())?;
        HotPixels::load_lists(&mut spec, folder).map_err(|error| error.to_string())?;
        Ok::<_, String>(spec)
    };
    if text.trim_start().starts_with('[') {
        return read(text, Path::new(""));
    }
    let json = std::fs::read_to_string(text)
        .map_err(|error| format!("{text}: {error}: give a list of stages in JSON, or a file of one"))?;
    read(&json, Path::new(text).parent().unwrap_or(Path::new(""))).map_err(|error| format!("{text}: {error}"))
}

/// The part that was asked for.
pub(crate) fn part(recording: &Recording, asked: &PartArgs) -> Result<CopyPart, Failure> {
    let PartArgs { t_start: start, t_stop: stop } = *asked;
    if start.is_none() && stop.is_none() {
        return Ok(CopyPart::All);
    }
    let first = match [start, stop].iter().flatten().any(|time| time.from_first) {
        true => first_time(recording)?,
        false => 0,
    };
    let us = |time: Time| if time.from_first { first.saturating_add(time.us) } else { time.us };
    Ok(CopyPart::Time(start.map_or(0, us)..stop.map_or(u64::MAX, us)))
}

/// Time of the first event.
fn first_time(recording: &Recording) -> Result<u64, Error> {
    let mut blocks = recording.blocks();
    while let Some(chunk) = blocks.next_block()? {
        if !chunk.block.is_empty() {
            return Ok(chunk.span().t_first);
        }
    }
    Ok(0)
}

/// What is said at the end with --json.
#[derive(Serialize)]
struct Report {
    format: &'static str,
    events: u64,
    filtered: u64,
    out_of_time: u64,
    triggers: u64,
    imu: u64,
    frames: u64,
    left_out_triggers: u64,
    left_out_imu: u64,
    left_out_frames: u64,
    left_out_magnetic_fields: u64,
    left_out_temperatures: u64,
    left_out_temperatures_unknown: u64,
    left_out_exposures: u64,
    left_out_positions: u64,
    off_sensor: u64,
    marked_invalid: u64,
    bytes_faulty: u64,
    bytes: u64,
    rebased_us: u64,
}

fn write(recording: &Recording, output: &Path, part: CopyPart, args: &ConvertArgs) -> Result<(), Failure> {
    let geometry = recording.geometry();
    let mut options = WriteOptions::default();
    options.format = args.format.clone();
    options.encoding = args.output_encoding;
    options.compression = args.compression;
    options.layout = args.layout.clone();
    options.overwrite = args.overwrite;
    options.rebase = args.rebase.unwrap_or_default();
    let mut chain = match &args.chain {
        None => None,
        Some(spec) => Some(
            Chain::try_new(spec, recording.sensor_size()?)
                .map_err(|error| Failure::new(Failure::INPUT, format!("--chain: {error}")))?,
        ),
    };
    let geometry = chain.as_ref().map(Chain::output_geometry).or(geometry);
    let mut writer = Writer::create(output, geometry, &options)?;
    let mut filter = Thin::new(recording, args)?;
    let mut progress = Progress::start(recording.bytes());
    let mut told = |position| progress.at(position);
    let mut copying = CopyOptions::default();
    copying.part = part;
    copying.filter = filter.as_mut().map(|filter| filter as &mut dyn Filter);
    copying.transform = chain.as_mut().map(|chain| chain as &mut dyn Transform);
    copying.progress = Some(&mut told);
    let copied = copy(recording, &mut writer, copying);
    progress.end();
    match copied {
        Ok(copied) => tell(recording, &copied, &writer.finish()?, args),
        Err(error) if args.recover && error.path() == recording.path() => {
            let written = writer.finish()?;
            let events = thousands(written.events);
            Err(Failure::general(format!(
                "{error}; wrote the {events} events before that to {}",
                output.display()
            )))
        }
        Err(error) => Err(error.into()),
    }
}

fn tell(
    recording: &Recording,
    copied: &Copied,
    written: &Written,
    args: &ConvertArgs,
) -> Result<(), Failure> {
    let left_out = written.left_out;
    if args.json {
        return json(&Report {
            format: recording.format().name,
            events: written.events,
            filtered: copied.filtered,
            out_of_time: copied.out_of_time,
            triggers: written.triggers,
            imu: written.imu,
            frames: written.frames,
            left_out_triggers: left_out.triggers,
            left_out_imu: left_out.imu,
            left_out_frames: left_out.frames,
            left_out_magnetic_fields: left_out.magnetic_fields,
            left_out_temperatures: left_out.temperatures,
            left_out_temperatures_unknown: left_out.temperatures_unknown,
            left_out_exposures: left_out.exposures,
            left_out_positions: left_out.positions,
            off_sensor: copied.off_sensor,
            marked_invalid: copied.marked_invalid,
            bytes_faulty: copied.bytes_faulty,
            bytes: written.bytes,
            rebased_us: written.rebased_us,
        });
    }
    let others = [(written.triggers, "triggers"), (written.imu, "IMU samples"), (written.frames, "frames")];
    let kinds: Vec<_> =
        [(written.events, "events")].into_iter().chain(others.into_iter().filter(|(n, _)| *n > 0)).collect();
    line(format!("wrote {} ({} bytes)", list(&kinds), thousands(written.bytes)))?;
    if written.rebased_us > 0 {
        line(format!("subtracted {} µs from every time", thousands(written.rebased_us)))?;
    }
    let lost: Vec<_> = left_out.counts().into_iter().filter(|(n, _)| *n > 0).collect();
    if !lost.is_empty() {
        line(format!("note: the format has no place for {}: left out", list(&lost)))?;
    }
    if left_out.temperatures_unknown > 0 {
        line(format!(
            "note: the format tells a temperature with every IMU sample: {} without one read 35 °C",
            thousands(left_out.temperatures_unknown)
        ))?;
    }
    if copied.filtered > 0 {
        line(format!("filtered {} events", thousands(copied.filtered)))?;
    }
    if copied.out_of_time > 0 {
        line(format!(
            "note: {} triggers, IMU samples and frames are of times that the chain leaves out",
            thousands(copied.out_of_time)
        ))?;
    }
    if copied.off_sensor > 0 {
        line(format!(
            "warning: {} events are off the sensor and were dropped; see --sensor-size",
            thousands(copied.off_sensor)
        ))?;
    }
    if copied.marked_invalid > 0 {
        line(format!(
            "note: {} events and triggers are marked invalid by the file: left out",
            thousands(copied.marked_invalid)
        ))?;
    }
    if copied.bytes_faulty > 0 {
        line(format!(
            "warning: {} bytes could not be read; see lobula check",
            thousands(copied.bytes_faulty)
        ))?;
    }
    Ok(())
}

/// Counts and names, with commas.
fn list(kinds: &[(u64, &str)]) -> String {
    let texts: Vec<_> = kinds.iter().map(|(n, name)| format!("{} {name}", thousands(*n))).collect();
    texts.join(", ")
}

/// What thins the events of a conversion: filters in a row.
struct Thin(Vec<Box<dyn Filter>>);

impl Thin {
    /// Of the options given; `None` where none is.
    fn new(recording: &Recording, args: &ConvertArgs) -> Result<Option<Self>, Failure> {
        let geometry = recording.block_geometry();
        let mut filters: Vec<Box<dyn Filter>> = Vec::new();
        if let Some(path) = &args.hot_pixels {
            let hot = HotPixels::load(path)?;
            hot.check(path, recording)?;
            filters.push(Box::new(hot.filter()));
        }
        if let Some(keep) = args.polarity {
            filters.push(Box::new(PolarityFilter::new(geometry, PolarityParams { keep })));
        }
        if let Some(Region { x, y, width, height }) = args.roi {
            let region = RegionOfInterest::try_new(geometry, RegionParams { x, y, width, height });
            let wrong = |error| Failure::new(Failure::INPUT, format!("--roi: {error}"));
            filters.push(Box::new(region.map_err(wrong)?));
        }
        Ok((!filters.is_empty()).then_some(Self(filters)))
    }
}

impl Filter for Thin {
    fn keep(&mut self, event: Event) -> bool {
        self.0.iter_mut().all(|filter| filter.keep(event))
    }

    fn retain(&mut self, block: &mut Block<'_>) -> Result<usize, WrongGeometry> {
        for filter in &mut self.0 {
            filter.retain(block)?;
        }
        Ok(block.len())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_have_units_or_are_us() {
        let at = |us| Time { us, from_first: false };
        assert_eq!(time("1500000"), Ok(at(1_500_000)));
        assert_eq!(time("1.5s"), Ok(at(1_500_000)));
        assert_eq!(time("0.000001s"), Ok(at(1)));
        assert_eq!(time("20ms"), Ok(at(20_000)));
        assert_eq!(time("+2s"), Ok(Time { us: 2_000_000, from_first: true }));
        for bad in ["", "s", "1.5", "-1", "1h", "1.0000001s", "+", "1e3", "99999999999999999999"] {
            assert!(time(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn regions_and_numbers() {
        assert_eq!(region("100,50,640x480"), Ok(Region { x: 100, y: 50, width: 640, height: 480 }));
        assert!(["100,50", "a,1,2x3", "1,2,3", "1,2,3x4x5"].iter().all(|bad| region(bad).is_err()));
        assert!(chain("[{\"kind\": \"flip_x\"}]").is_ok_and(|spec| spec.stages.len() == 1));
        assert!(chain("[{\"kind\": \"flip_z\"}]").is_err_and(|error| error.contains("flip_z")));
        let folder = tempfile::tempdir().unwrap();
        let file = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
        std::fs::write(file("hot.txt"), "# sensor 8x4\n3,2\n").unwrap();
        std::fs::write(file("chain.json"), r#"[{"kind": "hot_pixel", "file": "hot.txt"}]"#).unwrap();
        let mut spec = chain(&file("chain.json")).unwrap();
        assert_eq!(*spec.stages[0].hot_pixels_mut().unwrap().pixels, [(3, 2)], "beside the chain's file");
        assert!(chain("no/such/file.json").is_err_and(|error| error.contains("no/such/file.json")));
        assert_eq!(numbers("5..9"), Ok(Numbers(5..9)));
        assert!(["5", "..", "5..", "a..b"].iter().all(|bad| numbers(bad).is_err()));
    }
}
