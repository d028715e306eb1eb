//! `lobula render`: tensors of a recording's windows, as one NumPy array or as pictures.
//!
//! The view is that of the daemon, made of the same settings, so the same bytes.

use crate::args::RenderArgs;
use crate::convert::{self, Time};
use crate::output::{json, line, thousands};
use crate::progress::Progress;
use crate::{Failure, png_file};
use lobula_core::chain::{Offline, View, ViewSpec};
use lobula_core::representation::Dtype;
use lobula_core::{Closed, Shape};
use lobula_formats::{Blocks, CopyPart, Recording, TensorWriter};
use serde::Serialize;
use serde_json::{Map, Value};
use std::cell::Cell;
use std::path::{Path, PathBuf};

/// Renders.
pub fn run(args: &RenderArgs) -> Result<(), Failure> {
    let recording = args.input.open(&args.file)?;
    let spec = args.spec()?;
    let mut view = View::try_new(&spec, recording.sensor_size()?)
        .map_err(|error| Failure::new(Failure::INPUT, error.to_string()))?;
    let blocks = blocks(&recording, args)?;
    let name = if spec.slice_events.is_some() { PictureName::Number } else { PictureName::Start };
    let mut output = Target::create(&args.output, args.overwrite, name, view.shape(), view.dtype())?;
    let rendered = render(&mut view, blocks, recording.bytes(), &mut output);
    let windows = rendered.and_then(|()| output.finish())?;
    let report = Report {
        windows,
        shape: [view.shape().channels, view.shape().height, view.shape().width],
        dtype: view.dtype().name(),
        late: view.late(),
        skipped: view.skipped(),
        older: view.older(),
        overflowed: view.overflowed(),
        saturated: view.saturated(),
    };
    if args.json { json(&report) } else { report.print() }
}

impl RenderArgs {
    /// The view's settings, by the one parser of them.
    fn spec(&self) -> Result<ViewSpec, Failure> {
        let wrong = |text: String| Failure::new(Failure::INPUT, text);
        let mut settings = Map::new();
        for (key, value) in &self.set {
            let value = serde_json::from_str(value).unwrap_or_else(|_| Value::String(value.clone()));
            settings.insert(key.clone(), value);
        }
        settings.insert("name".into(), Value::String("render".into()));
        settings.insert("kind".into(), Value::String(self.kind.clone()));
        let period = if self.slice_events.is_none() { Some(self.period) } else { None };
        for (key, time) in [("period_us", period), ("stride_us", self.stride)] {
            if let Some(time) = time {
                settings.insert(key.into(), time.duration_us().map_err(wrong)?.into());
            }
        }
        for (key, events) in [("slice_events", self.slice_events), ("stride_events", self.stride_events)] {
            settings.extend(events.map(|events| (key.into(), events.into())));
        }
        serde_json::from_value(Value::Object(settings)).map_err(|error| wrong(format!("the view: {error}")))
    }
}

/// Reads `KEY=VALUE`.
pub fn setting(text: &str) -> Result<(String, String), String> {
    let setting = text.split_once('=').map(|(key, value)| (key.to_string(), value.to_string()));
    setting.ok_or_else(|| format!("give KEY=VALUE, such as bins=9, not {text}"))
}

impl Time {
    /// As a length of time.
    fn duration_us(self) -> Result<u64, String> {
        match self {
            Self { us, from_first: false } => Ok(us),
            _ => Err("a length of time counts from nothing: leave the plus out".into()),
        }
    }
}

fn blocks(recording: &Recording, args: &RenderArgs) -> Result<Blocks, Failure> {
    Ok(match convert::part(recording, &args.part)? {
        CopyPart::Time(t) => recording.slice_time(t)?,
        _ => recording.blocks(),
    })
}

/// Draws all windows.
fn render(view: &mut View, mut blocks: Blocks, bytes: u64, output: &mut Target) -> Result<(), Failure> {
    let mut progress = Progress::start(bytes);
    let taken = Cell::new(Ok(()));
    let mut canvas = Offline::new(view.len_bytes(), |closed: Closed, tensor: &[u8]| {
        taken.set(taken.replace(Ok(())).and_then(|()| output.take(closed, tensor)));
    });
    let mut t_last = 0;
    while let Some(chunk) = blocks.next_block()? {
        let span = chunk.span();
        t_last = span.t_last;
        view.push(span, &mut canvas).map_err(Failure::general)?;
        taken.replace(Ok(()))?;
        progress.at(blocks.position());
    }
    view.finish(t_last, &mut canvas).map_err(Failure::general)?;
    progress.end();
    taken.replace(Ok(()))
}

/// Where tensors go.
enum Target {
    /// All of them, N x C x H x W.
    Array(TensorWriter),
    /// A picture of each.
    Pictures(Pictures),
}

impl Target {
    fn create(
        path: &Path,
        overwrite: bool,
        name: PictureName,
        shape: Shape,
        dtype: Dtype,
    ) -> Result<Self, Failure> {
        if path.extension().is_some_and(|end| end == "npy") {
            return Ok(Self::Array(TensorWriter::create(path, overwrite, shape, dtype)?));
        }
        if path.extension().is_some() && !path.is_dir() {
            let text = "give a name that ends in .npy, or a folder for pictures";
            return Err(Failure::new(Failure::INPUT, format!("{}: {text}", path.display())));
        }
        std::fs::create_dir_all(path)
            .map_err(|error| Failure::general(format!("{}: {error}", path.display())))?;
        Ok(Self::Pictures(Pictures { folder: path.into(), overwrite, name, shape, dtype, windows: 0 }))
    }

    fn take(&mut self, closed: Closed, tensor: &[u8]) -> Result<(), Failure> {
        match self {
            Self::Array(array) => Ok(array.push(tensor)?),
            Self::Pictures(pictures) => pictures.take(closed, tensor),
        }
    }

    /// How many there were.
    fn finish(self) -> Result<u64, Failure> {
        match self {
            Self::Array(array) => Ok(array.finish()?),
            Self::Pictures(pictures) => Ok(pictures.windows),
        }
    }
}

fn exists(path: &Path) -> Failure {
    Failure::new(Failure::INPUT, format!("{} is there: give another name, or --overwrite", path.display()))
}

/// How a window's picture is named.
enum PictureName {
    /// By its start in µs.
    Start,
    /// By its number: windows of events may start at the same time.
    Number,
}

/// Pictures in a folder.
struct Pictures {
    folder: PathBuf,
    overwrite: bool,
    name: PictureName,
    shape: Shape,
    dtype: Dtype,
    windows: u64,
}

impl Pictures {
    fn take(&mut self, closed: Closed, tensor: &[u8]) -> Result<(), Failure> {
        let name = match self.name {
            PictureName::Start => closed.window.t0,
            PictureName::Number => self.windows,
        };
        let path = self.folder.join(format!("{name:012}.png"));
        if path.exists() && !self.overwrite {
            return Err(exists(&path));
        }
        self.windows += 1;
        let pixels = colours(self.shape, &values(self.dtype, tensor));
        png_file::write(&path, (self.shape.width as u32, self.shape.height as u32), &pixels)
    }
}

/// The elements as numbers.
fn values(dtype: Dtype, tensor: &[u8]) -> Vec<f32> {
    let words = || tensor.chunks_exact(2).map(|word| u16::from_le_bytes([word[0], word[1]]));
    match dtype {
        Dtype::U8 => tensor.iter().copied().map(f32::from).collect(),
        Dtype::U16 => words().map(f32::from).collect(),
        Dtype::F16 => words().map(|word| lobula_core::f16::from_bits(word).to_f32()).collect(),
        Dtype::F32 => tensor.chunks_exact(4).map(bytemuck::pod_read_unaligned).collect(),
    }
}

/// Red, green, blue of each pixel. Three planes are red, green and blue already; of two the first (ON) is warm and
/// the second cold; of any other number the sum is warm above and cold below 0. The greatest is brightest.
fn colours(shape: Shape, values: &[f32]) -> Vec<u8> {
    let pixels = shape.height * shape.width;
    let plane = |channel: usize| &values[channel * pixels..][..pixels];
    if shape.channels == 3 {
        let [red, green, blue] = [plane(0), plane(1), plane(2)];
        return (0..pixels).flat_map(|at| [red[at] as u8, green[at] as u8, blue[at] as u8]).collect();
    }
    let (warm, cold): (Vec<f32>, Vec<f32>) = match shape.channels {
        2 => (plane(0).to_vec(), plane(1).to_vec()),
        channels => {
            let sum = |at| (0..channels).map(|channel| plane(channel)[at]).sum::<f32>();
            (0..pixels).map(sum).map(|sum| (sum.max(0.0), (-sum).max(0.0))).unzip()
        }
    };
    let top = warm.iter().chain(&cold).fold(f32::MIN_POSITIVE, |top, value| top.max(*value));
    let level = |value: f32| (value / top).clamp(0.0, 1.0).sqrt();
    let pixel = |(warm, cold): (&f32, &f32)| {
        let (warm, cold) = (level(*warm), level(*cold));
        [255.0 * warm, 130.0 * warm + 130.0 * cold, 255.0 * cold].map(|part: f32| part.min(255.0) as u8)
    };
    warm.iter().zip(&cold).flat_map(pixel).collect()
}

/// What is said at the end.
#[derive(Serialize)]
struct Report {
    windows: u64,
    shape: [usize; 3],
    dtype: &'static str,
    late: u64,
    skipped: u64,
    older: u64,
    overflowed: u64,
    saturated: u64,
}

impl Report {
    fn print(&self) -> Result<(), Failure> {
        let [channels, height, width] = self.shape;
        let windows = thousands(self.windows);
        line(format!("rendered {windows} windows of {channels} x {height} x {width} {}", self.dtype))?;
        let notes = [
            (self.late, "events came after their window had closed: they count at the start of the next"),
            (self.skipped, "empty windows in a row were left out"),
            (self.older, "events were older than window_us before the last of their slice, and were dropped"),
            (
                self.overflowed,
                "events had no room in their slice, and were dropped: give a greater events_max",
            ),
            (self.saturated, "events met a pixel that can count no further: give a wider dtype"),
        ];
        let mut told = notes.iter().filter(|(n, _)| *n > 0);
        told.try_for_each(|(n, text)| line(format!("note: {} {text}", thousands(*n))))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_are_pairs() {
        assert_eq!(setting("bins=9"), Ok(("bins".into(), "9".into())));
        assert!(setting("bins").is_err());
    }

    #[test]
    fn planes_have_colours() {
        let shape = |channels| Shape { channels, height: 1, width: 2 };
        assert_eq!(colours(shape(3), &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]), [1, 3, 5, 2, 4, 6]);
        let two = colours(shape(2), &[4.0, 0.0, 0.0, 1.0]);
        assert_eq!(two, [255, 130, 0, 0, 65, 127]);
        let signed = colours(shape(1), &[-1.0, 0.0]);
        assert_eq!(signed, [0, 130, 255, 0, 0, 0]);
    }
}
