//! eventcv-core 1.0.11: events in four columns, every operation a new stream or a new frame.
//!
//! It has no form that takes packets, but for two: its file reader can push events into a consumer of the caller's,
//! and its polarity histogram can be reset and filled again. Both are used here as its best `stream` way.

use std::hint::black_box;
use std::path::PathBuf;

use eventcv_core::camera::Camera;
use eventcv_core::image::PoolingMethod;
use eventcv_core::io::{EventConsumer, EvtVersion, LoadOptions, SliceSource};
use eventcv_core::io::{decode_words, open_raw_slice, read_raw};
use eventcv_core::representation::{
    AveragedTimeSurface, Binary, CountMask, EventCount, EventFrame, EventFrameData, Mcts, Polarity,
    PolarityAccumulator, RedBlue, Representation, RepresentationError, Tencode, TimeSurface, VoxelGrid,
};
use eventcv_core::viz::render_raw;
use eventcv_core::{EventStream, EventStreamBuilder};
use lobula_core::Event;
use lobula_core::transform::BrownConrady;
use lobula_core::wire::Encoding;

use super::Library;
use crate::contest::{Peer, Protocol, Work};
use crate::input::{PACKET_EVENTS, Scene};
use crate::op::fused::Stretch;
use crate::op::{self, Op};
use crate::wire::Wire;

const MILLISECONDS_OF_A_MICROSECOND: f64 = 1e-3;
/// Window of its lazy reader, in µs: what its own benches and the paper use.
const SLICE_US: i64 = 33_000;

/// Prepares the peer's input from `scene`.
///
/// # Errors
/// A sentence, where it cannot read it.
pub fn load(scene: &Scene) -> Result<Option<Box<dyn Library>>, String> {
    EventCv::new(scene).map(|library| Some(Box::new(library) as Box<dyn Library>))
}

struct EventCv {
    file: TemporaryFile,
    words: Vec<u8>,
    size: (usize, usize),
    source: Box<dyn SliceSource>,
    stream: EventStream,
    tensor: EventStream,
    window_ms: f64,
}

impl EventCv {
    fn new(scene: &Scene) -> Result<Self, String> {
        let size = (usize::from(scene.geometry.width), usize::from(scene.geometry.height));
        let file = TemporaryFile::with_words("3.0", &scene.bytes)?;
        let source = open_raw_slice(&file.0, &options(size)).map_err(|e| e.to_string())?;
        let stream =
            decode_words(&scene.bytes, EvtVersion::Evt3, size.0, size.1).map_err(|e| e.to_string())?;
        let tensor = first(&stream, scene.tensor_events);
        let window = scene.tensor_window;
        let window_ms = (window.t1 - window.t0) as f64 * MILLISECONDS_OF_A_MICROSECOND;
        Ok(Self {
            file,
            words: scene.bytes.clone(),
            size,
            source: Box::new(source),
            stream,
            tensor,
            window_ms,
        })
    }

    fn decode_whole(&self) -> Vec<Peer<'_>> {
        let (width, height) = self.size;
        let words: Work<'_> = Box::new(move || {
            let stream = decode_words(&self.words, EvtVersion::Evt3, width, height);
            black_box(stream).map_or(0, |s| s.len() as u64)
        });
        let file: Work<'_> = Box::new(move || {
            black_box(read_raw(&self.file.0, &options(self.size))).map_or(0, |s| s.len() as u64)
        });
        vec![peer("decode_words", words), peer("read_raw", file)]
    }

    fn decode_stream(&self) -> Vec<Peer<'_>> {
        let (t0, t1) = self.source.time_span();
        let mut packet = Packet::new();
        let pushed: Work<'_> = Box::new(move || {
            packet.total = 0;
            // Well past the end: it stops at the first time beyond, and times step back.
            let done = self.source.slice_time_into(t0, t1 + SLICE_US, &mut packet);
            done.map_or(0, |()| packet.total)
        });
        let slices = move || {
            let windows = (t0..=t1).step_by(SLICE_US as usize);
            windows
                .map(|t| self.source.slice_time(t, t + SLICE_US).map_or(0, |s| black_box(s).len() as u64))
                .sum()
        };
        // A time that steps back over a window's edge is lost to it: its count is its own.
        let expected = Some(slices());
        let sliced = Peer { expected, ..peer("slice_time 33 ms, fresh streams", Box::new(slices)) };
        vec![peer("slice_time_into a reused packet", pushed), sliced]
    }

    fn polarity_stream(&self) -> Vec<Peer<'_>> {
        let (width, height) = self.size;
        let Ok(mut counts) = PolarityAccumulator::new(width, height, 1) else { return Vec::new() };
        let again: Work<'_> = Box::new(move || {
            counts.reset();
            let stream = &self.tensor;
            for i in 0..stream.len() {
                counts.push(stream.xs()[i], stream.ys()[i], stream.ts()[i], stream.ps()[i]);
            }
            black_box(&counts);
            stream.len() as u64
        });
        let again = peer("PolarityAccumulator, reset and filled again", again);
        self.making(Op::Polarity).into_iter().chain([again]).collect()
    }

    /// What it does for an operation of one call, which makes everything anew: its only way but for polarity.
    fn made(&self, op: Op) -> Option<Made> {
        Some(match op {
            Op::Polarity => frame("Polarity::generate", |own| Polarity::new(false).generate(&own.tensor)),
            Op::Voxel5 => frame("VoxelGrid::generate", |own| {
                VoxelGrid::new(op::voxel5::BINS.into(), own.window_ms).generate(&own.tensor)
            }),
            Op::TimeSurface => frame("TimeSurface::generate", |own| {
                let tau_ms = op::time_surface::TAU_US as f64 * MILLISECONDS_OF_A_MICROSECOND;
                TimeSurface::new(tau_ms).generate(&own.tensor)
            }),
            Op::Count | Op::CountU16 => {
                frame("EventCount::generate", |own| EventCount::new(false).generate(&own.tensor))
            }
            Op::Binary => frame("Binary::generate", |own| Binary.generate(&own.tensor)),
            Op::PolarityShare => {
                frame("Polarity::generate normalised", |own| Polarity::new(true).generate(&own.tensor))
            }
            Op::AveragedTimeSurface => frame("AveragedTimeSurface::generate", |own| {
                let tau_ms = op::averaged_time_surface::TAU_US as f64 * MILLISECONDS_OF_A_MICROSECOND;
                AveragedTimeSurface::new(tau_ms).generate(&own.tensor)
            }),
            Op::Mcts => frame("Mcts::generate", |own| {
                let max_ms = op::mcts::MAX_WINDOW_US as f64 * MILLISECONDS_OF_A_MICROSECOND;
                Mcts::new(max_ms).generate(&own.tensor)
            }),
            Op::Tencode => {
                frame("Tencode::generate", |own| Tencode::new(own.window_ms).generate(&own.tensor))
            }
            Op::Countmask => frame("CountMask::generate", |own| {
                CountMask::new(op::countmask::PERCENTILE.into(), false).generate(&own.tensor)
            }),
            Op::RedBlue => frame("RedBlue::generate", |own| {
                RedBlue::new(op::red_blue::PERCENTILE.into()).generate(&own.tensor)
            }),
            Op::EventImage => frame("render_raw", |own| {
                let tau_ms = op::event_image::TAU_US as f64 * MILLISECONDS_OF_A_MICROSECOND;
                let image = render_raw(&own.tensor, tau_ms);
                EventFrame::intensity(EventFrameData::U8(image.pixels), 3 * own.size.0, own.size.1)
            }),
            Op::Refractory => {
                stream("refractory_filter", |all| all.refractory_filter(op::refractory::PERIOD_US.into()))
            }
            Op::BackgroundActivity => stream("background_activity_filter", |all| {
                all.background_activity_filter(op::background_activity::WITHIN_US.into())
            }),
            Op::HotPixel => {
                stream("hot_pixel_filter", |all| all.hot_pixel_filter(op::hot_pixel::SIGMAS.into()))
            }
            Op::KeepPolarity => stream("filter_polarity", |all| all.filter_polarity(true)),
            Op::Decimate => stream("decimate", |all| all.decimate(op::decimate::N as usize)),
            Op::Mask => stream("mask", |all| all.mask(&mask(all), all.sensor_size().0, all.sensor_size().1)),
            Op::Crop => stream("crop", |all| all.crop(160, 120, 960, 480)),
            Op::FlipX => stream("flip_x", |all| all.flip_x()),
            Op::FlipY => stream("flip_y", |all| all.flip_y()),
            Op::Rotate90 => stream("rotate90", |all| all.rotate90(1)),
            Op::Transpose => stream("transpose", |all| all.transpose()),
            Op::Translate => stream("translate", |all| all.translate(50, -20)),
            Op::Resize => stream("resize", |all| all.resize(346, 260)),
            Op::ResizeHalf => stream("resize", |all| all.resize(640, 360)),
            Op::Scale => stream("scale", |all| all.scale(0.5, 0.5)),
            Op::WarpAffine => stream("warp_affine", |all| all.warp_affine(op::warp_affine::MATRIX)),
            Op::WarpPerspective => {
                stream("warp_perspective", |all| all.warp_perspective(op::warp_perspective::MATRIX))
            }
            Op::Undistort => stream("undistort", |all| all.undistort(&camera())),
            Op::InvertPolarity => stream("invert_polarity", |all| all.invert_polarity()),
            Op::TimeShift => stream("time_shift", |all| all.time_shift(12_345)),
            Op::TimeScale => stream("time_scale", |all| all.time_scale(2.5)),
            Op::TimeWindow => stream("time_window", |all| {
                let time = |t: Option<&i64>| t.copied().unwrap_or_default().unsigned_abs();
                let (t0, t1) = op::middle_half(time(all.ts().first()), time(all.ts().last()));
                all.time_window(t0 as i64, t1 as i64)
            }),
            Op::NormalizeTime => stream("normalize_time", |all| all.normalize_time()),
            Op::EventDrop => stream("event_drop", |all| all.event_drop(0.5, 0)),
            Op::PixelDropout => stream("pixel_dropout", |all| all.pixel_dropout(0.1, 0)),
            Op::SpatialJitter => stream("spatial_jitter", |all| all.spatial_jitter(1.0, 0)),
            Op::TimeJitter => stream("time_jitter", |all| all.time_jitter(10.0, 0)),
            Op::RandomFlipX => stream("random_flip_x", |all| all.random_flip_x(1.0, 0)),
            Op::RandomFlipY => stream("random_flip_y", |all| all.random_flip_y(1.0, 0)),
            Op::RandomPolarityFlip => stream("random_polarity_flip", |all| all.random_polarity_flip(1.0, 0)),
            Op::RandomCrop => stream("random_crop", |all| all.random_crop(640, 360, 0)),
            Op::SortByTime => stream("sort_by_time", |all| all.sort_by_time()),
            Op::Evt3Decode | Op::Evt2Decode | Op::Evt21Decode | Op::Voxel5Share | Op::ReplayVoxel5 => {
                return None;
            }
            Op::Denoise | Op::Stcf | Op::DoubleWindow | Op::Trail | Op::Inceptive => return None,
            Op::LeakyHotPixel | Op::AntiFlicker | Op::RateLimit | Op::RegionOfInterest => return None,
            Op::StackedHistogram | Op::MixedDensityStack | Op::EventSpikeTensor => return None,
            Op::Tore | Op::Sits | Op::Tos | Op::TensorBytes | Op::Intervals | Op::SlidingCount => {
                return None;
            }
            Op::RandomRotation | Op::RandomTranslation | Op::DropByArea => return None,
            Op::Merge | Op::EventRate | Op::TensorResize => return None, // see `ways`
            Op::FilePolarity | Op::FileVoxel5 | Op::FileTimeSurface => return None, // see `fused`
        })
    }

    fn making(&self, op: Op) -> Option<Peer<'_>> {
        let Made { call, work } = self.made(op)?;
        Some(match work {
            Making::Frame(make) => {
                peer(call, Box::new(move || black_box(make(self)).map_or(0, |_| self.tensor.len() as u64)))
            }
            Making::Stream(make) => peer(call, Box::new(move || black_box(make(&self.stream)).len() as u64)),
        })
    }

    /// The events of a mask made before.
    fn inside(&self) -> Peer<'_> {
        let mask = mask(&self.stream);
        let (width, height) = self.size;
        let inside = move || black_box(self.stream.mask(&mask, width, height)).len() as u64;
        peer("mask", Box::new(inside))
    }

    /// A voxel grid for each window of its lazy reader.
    fn replay(&self) -> Peer<'_> {
        let (t0, t1) = self.source.time_span();
        let window_us = i64::from(op::replay_voxel5::PERIOD_US);
        let window_ms = window_us as f64 * MILLISECONDS_OF_A_MICROSECOND;
        let voxel = VoxelGrid::new(op::voxel5::BINS.into(), window_ms);
        let replay = move || {
            let windows = (t0..=t1).step_by(window_us as usize);
            windows
                .map(|t| {
                    self.source.slice_time(t, t + window_us).map_or(0, |slice| {
                        black_box(voxel.generate(&slice)).map_or(0, |_| slice.len() as u64)
                    })
                })
                .sum()
        };
        // A time that steps back over a window's edge is lost to it: its count is its own.
        let expected = Some(replay());
        Peer { expected, ..peer("slice_time 1 ms, VoxelGrid::generate", Box::new(replay)) }
    }

    /// Two streams made before, put together and sorted.
    fn merge(&self) -> Peer<'_> {
        let [on, off] = [true, false].map(|polarity| self.stream.filter_polarity(polarity));
        let merge = move || black_box(on.concat(&[&off]).sort_by_time()).len() as u64;
        peer("concat, sort_by_time", Box::new(merge))
    }

    fn event_rate(&self) -> Peer<'_> {
        let rate = || {
            black_box(self.stream.event_rate(op::statistics::BIN_US.into()));
            self.stream.len() as u64
        };
        peer("event_rate", Box::new(rate))
    }

    /// Its time surface, made before, at half the resolution.
    fn resize(&self) -> Option<Peer<'_>> {
        let surface = self.surface()?;
        let (channels, height, width) = surface.shape();
        let resize = move || black_box(smaller(&surface)).map_or(0, |_| (channels * height * width) as u64);
        Some(peer("EventFrame::resize", Box::new(resize)))
    }

    fn surface(&self) -> Option<EventFrame> {
        match self.made(Op::TimeSurface)?.work {
            Making::Frame(make) => make(self).ok(),
            Making::Stream(_) => None,
        }
    }

    /// The events of a mask learnt before.
    fn masked(&self) -> Peer<'_> {
        let mask = self.stream.hot_pixel_mask(op::hot_pixel::SIGMAS.into());
        let masked = move || black_box(self.stream.drop_masked_pixels(&mask)).len() as u64;
        peer("drop_masked_pixels", Box::new(masked))
    }
}

fn smaller(frame: &EventFrame) -> Option<EventFrame> {
    let (width, height) = op::tensor_end::SMALLER;
    frame.resize(width, height, PoolingMethod::Average).ok()
}

/// The camera of `undistort`.
fn camera() -> Camera {
    let BrownConrady { fx, fy, cx, cy, k1, k2, p1, p2, k3 } = op::undistort::LENS;
    Camera { fx, fy, cx, cy, k1, k2, p1, p2, k3 }
}

/// The pixels of [`op::mask`], as it wants them.
fn mask(stream: &EventStream) -> Vec<bool> {
    let (width, height) = stream.sensor_size();
    let pixels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
    pixels.map(|(x, y)| op::mask::inside(x as u16, y as u16)).collect()
}

/// A call of its, and what it makes.
struct Made {
    call: &'static str,
    work: Making,
}

enum Making {
    /// Of the events of a tensor.
    Frame(fn(&EventCv) -> Result<EventFrame, RepresentationError>),
    /// Of all events.
    Stream(fn(&EventStream) -> EventStream),
}

fn frame(call: &'static str, make: fn(&EventCv) -> Result<EventFrame, RepresentationError>) -> Made {
    Made { call, work: Making::Frame(make) }
}

fn stream(call: &'static str, make: fn(&EventStream) -> EventStream) -> Made {
    Made { call, work: Making::Stream(make) }
}

impl Library for EventCv {
    fn ways(&self, op: Op, protocol: Protocol) -> Vec<Peer<'_>> {
        match (op, protocol) {
            (Op::Evt3Decode, Protocol::Whole) => self.decode_whole(),
            (Op::Evt3Decode, Protocol::Stream) => self.decode_stream(),
            (Op::Polarity, Protocol::Stream) => self.polarity_stream(),
            (Op::HotPixel, Protocol::Stream) => vec![self.masked()],
            (Op::Mask, _) => vec![self.inside()],
            (Op::ReplayVoxel5, _) => vec![self.replay()],
            (Op::Merge, _) => vec![self.merge()],
            (Op::EventRate, _) => vec![self.event_rate()],
            (Op::TensorResize, _) => self.resize().into_iter().collect(),
            // Of the decoders of other formats see `decoders`.
            _ => self.making(op).into_iter().collect(),
        }
    }

    fn decoders<'a>(&self, wire: &'a Wire, protocol: Protocol) -> Result<Vec<Peer<'a>>, String> {
        match protocol {
            Protocol::Whole => Ok(vec![peer(
                "decode_words",
                Box::new(move || evt2(wire).map_or(0, |stream| black_box(stream).len() as u64)),
            )]),
            Protocol::Stream => evt2_stream(wire),
        }
    }

    fn fused<'a>(&'a self, op: Op, stretch: &Stretch<'_>) -> Result<Vec<Peer<'a>>, String> {
        let file = TemporaryFile::with_words("3.0", stretch.bytes)?;
        let source = open_raw_slice(&file.0, &options(self.size)).map_err(|e| e.to_string())?;
        let (t0, t1) = source.time_span();
        let window_ms = self.window_ms;
        let ((width, height), events) = (self.size, stretch.events as u64);
        let tau_ms = op::time_surface::TAU_US as f64 * MILLISECONDS_OF_A_MICROSECOND;
        let work: Work<'a> = Box::new(move || {
            let _open = &file;
            let whole = || source.slice_time(t0, t1 + SLICE_US).ok();
            let built = match op {
                Op::FilePolarity => PolarityAccumulator::new(width, height, 1).ok().and_then(|mut counts| {
                    source.slice_time_into(t0, t1 + SLICE_US, &mut counts).ok()?;
                    Some(counts.into_frame(false))
                }),
                Op::FileVoxel5 => whole().and_then(|stream| {
                    VoxelGrid::new(op::voxel5::BINS.into(), window_ms).generate(&stream).ok()
                }),
                _ => whole().and_then(|stream| TimeSurface::new(tau_ms).generate(&stream).ok()),
            };
            black_box(built).map_or(0, |_| events)
        });
        let call = match op {
            Op::FilePolarity => "slice_time_into a PolarityAccumulator",
            Op::FileVoxel5 => "slice_time, VoxelGrid::generate",
            _ => "slice_time, TimeSurface::generate",
        };
        Ok(vec![peer(call, work)])
    }

    fn decoded(&self, wire: &Wire) -> Option<Vec<Event>> {
        (wire.encoding == Encoding::Evt2)
            .then(|| evt2(wire).map(|stream| events_of(&stream)).unwrap_or_default())
    }

    fn events(&self, op: Op) -> Vec<Event> {
        match self.made(op).map(|made| made.work) {
            Some(Making::Stream(make)) => events_of(&make(&self.stream)),
            Some(Making::Frame(_)) => Vec::new(),
            None => events_of(&self.stream),
        }
    }

    fn tensor(&self, op: Op) -> Vec<f32> {
        let frame = match self.made(op).map(|made| made.work) {
            Some(Making::Frame(make)) => make(self).ok(),
            _ if op == Op::TensorResize => self.surface().as_ref().and_then(smaller),
            _ => None,
        };
        match frame.map(EventFrame::into_data) {
            // Interleaved: to planes.
            Some(EventFrameData::U8(values)) if op == Op::EventImage => {
                (0..3).flat_map(|c| values.iter().skip(c).step_by(3)).map(|v| f32::from(*v)).collect()
            }
            Some(EventFrameData::U8(values)) => values.into_iter().map(f32::from).collect(),
            Some(EventFrameData::U16(values)) => values.into_iter().map(f32::from).collect(),
            Some(EventFrameData::U64(values)) => values.into_iter().map(|v| v as f32).collect(),
            Some(EventFrameData::F32(values)) => values,
            _ => Vec::new(),
        }
    }
}

fn events_of(stream: &EventStream) -> Vec<Event> {
    let event =
        |e: eventcv_core::Event| Event::new(e.timestamp as u32, e.x as u16, e.y as u16, polarity(e.polarity));
    stream.iter().map(event).collect()
}

fn size_of(wire: &Wire) -> (usize, usize) {
    (wire.geometry.width.into(), wire.geometry.height.into())
}

fn evt2(wire: &Wire) -> Option<EventStream> {
    let (width, height) = size_of(wire);
    decode_words(&wire.bytes, EvtVersion::Evt2, width, height).ok()
}

/// Its reader, into packets used again. The file lives as long as the work.
fn evt2_stream(wire: &Wire) -> Result<Vec<Peer<'_>>, String> {
    let file = TemporaryFile::with_words("2.0", &wire.bytes)?;
    let source = open_raw_slice(&file.0, &options(size_of(wire))).map_err(|e| e.to_string())?;
    let (t0, t1) = source.time_span();
    let mut packet = Packet::new();
    let pushed: Work<'_> = Box::new(move || {
        let _open = &file;
        packet.total = 0;
        let done = source.slice_time_into(t0, t1 + SLICE_US, &mut packet);
        done.map_or(0, |()| packet.total)
    });
    Ok(vec![peer("slice_time_into a reused packet", pushed)])
}

/// What its reader pushes events into: one packet's columns, used again.
struct Packet {
    columns: Box<[(i64, u16, u16, bool)]>,
    len: usize,
    total: u64,
}

impl Packet {
    fn new() -> Self {
        Self { columns: vec![(0, 0, 0, false); PACKET_EVENTS].into_boxed_slice(), len: 0, total: 0 }
    }
}

impl EventConsumer for Packet {
    #[inline]
    fn push(&mut self, x: u16, y: u16, t: i64, p: bool) {
        self.columns[self.len] = (t, x, y, p);
        self.len += 1;
        self.total += 1;
        if self.len == self.columns.len() {
            black_box(&self.columns);
            self.len = 0;
        }
    }
}

/// A recording of its own for the peer's reader; gone with the value.
struct TemporaryFile(PathBuf);

impl TemporaryFile {
    fn with_words(version: &str, words: &[u8]) -> Result<Self, String> {
        let path = std::env::temp_dir().join(format!(
            "lobula-report-{}-evt{version}-{:p}.raw",
            std::process::id(),
            words
        ));
        let file = Self(path);
        let content = [format!("% evt {version}\n").as_bytes(), words].concat();
        std::fs::write(&file.0, content).map_err(|e| format!("{}: {e}", file.0.display()))?;
        Ok(file)
    }
}

impl Drop for TemporaryFile {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.0);
    }
}

fn options(size: (usize, usize)) -> LoadOptions {
    LoadOptions { sensor_size: Some(size), ..LoadOptions::default() }
}

fn peer<'a>(call: &str, work: Work<'a>) -> Peer<'a> {
    Peer { name: format!("eventcv-core 1.0.11 {call}"), work, expected: None }
}

fn polarity(on: bool) -> lobula_core::Polarity {
    lobula_core::Polarity::from_bit(on.into())
}

fn first(stream: &EventStream, events: usize) -> EventStream {
    let (width, height) = stream.sensor_size();
    let mut builder = EventStreamBuilder::with_capacity(width, height, stream.timestamp_scale_ms(), events);
    for i in 0..events.min(stream.len()) {
        builder.push(stream.xs()[i], stream.ys()[i], stream.ts()[i], stream.ps()[i]);
    }
    builder.build()
}
