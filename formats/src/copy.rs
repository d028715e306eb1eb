//! Copies a recording, or a part of it, into another file: every stream that both formats have, in constant memory.

use crate::container::Items;
use crate::{Blocks, Error, ErrorKind, Frame, ImuSample, Part, Recording, Writer};
use lobula_core::{Block, Event, Filter, SPAN_MAX_US, Span, Transform, Trigger};
use std::iter::Peekable;
use std::ops::Range;

/// Which part of a recording to copy, and through what.
#[derive(Default)]
#[non_exhaustive]
pub struct CopyOptions<'a> {
    /// Which part. Default: all.
    pub part: CopyPart,
    /// What thins the events; triggers and other streams are not filtered. Default: nothing.
    pub filter: Option<&'a mut dyn Filter>,
    /// What moves the events that are left, to other pixels or times; triggers and other streams come to the same
    /// [times](Transform::time), and frames keep their pixels. Made for the recording's
    /// [size](Recording::block_geometry), and the writer for its [own](Transform::output_geometry). Default: nothing.
    pub transform: Option<&'a mut dyn Transform>,
    /// Told of the [position](Blocks::position) reached, after each block.
    pub progress: Option<&'a mut dyn FnMut(u64)>,
}

/// A part of a recording.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum CopyPart {
    /// All.
    #[default]
    All,
    /// What is of `start <= time < end`, in µs.
    Time(Range<u64>),
    /// Events of these numbers, counted from 0 in file order, and of the other streams what lies between their times.
    Events(Range<u64>),
}

/// What a copy left out on request.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct Copied {
    /// Events read.
    pub read: u64,
    /// Those that the filter or the transform dropped.
    pub filtered: u64,
    /// Triggers, IMU samples and frames whose time the transform leaves no place for.
    pub out_of_time: u64,
    /// Events that the reader dropped since they are off the sensor.
    pub off_sensor: u64,
    /// Events and triggers that the reader dropped since the file marks them as invalid.
    pub marked_invalid: u64,
    /// Bytes that could not be read.
    pub bytes_faulty: u64,
}

/// Copies a part of a recording; finishing the file is left to the caller.
///
/// ```no_run
/// use lobula_formats::{CopyOptions, WriteOptions, Writer, copy, open};
/// let recording = open("driving.raw")?;
/// let mut writer = Writer::create("driving.aedat4", recording.geometry(), &WriteOptions::default())?;
/// copy(&recording, &mut writer, CopyOptions::default())?;
/// writer.finish()?;
/// # Ok::<(), lobula_formats::Error>(())
/// ```
///
/// # Errors
/// Those of reading, and what the format written cannot hold.
pub fn copy(recording: &Recording, writer: &mut Writer, options: CopyOptions<'_>) -> Result<Copied, Error> {
    let CopyOptions { part, filter, transform, mut progress } = options;
    let mut blocks = match &part {
        CopyPart::All => recording.blocks(),
        CopyPart::Time(t) => recording.slice_time(t.clone())?,
        CopyPart::Events(numbers) => recording.slice_events(numbers.clone())?,
    };
    let mut side = SideItems::new(recording, &part);
    let mut press = Press { recording, filter, transform, scratch: Vec::new(), copied: Copied::default() };
    let mut t_last = None;
    while let Some(chunk) = blocks.next_block()? {
        let span = chunk.span();
        if let (Some(first), Some(last)) = (span.events.first(), span.events.last()) {
            side.write_before(span.time(*first), &mut press, writer)?;
            t_last = Some(span.time(*last));
        }
        press.copied.read += span.events.len() as u64;
        if press.changes_nothing() {
            writer.write_chunk(&chunk)?;
        } else {
            for part in chunk.parts() {
                match part {
                    Part::Events(span) => press.write(span, writer)?,
                    Part::Trigger(trigger) => {
                        if let Some(t) = press.time(trigger.t) {
                            writer.write_trigger(Trigger { t, ..trigger })?;
                        }
                    }
                }
            }
        }
        if let Some(progress) = &mut progress {
            progress(blocks.position());
        }
    }
    side.write_rest(t_last, &mut press, writer)?;
    let mut copied = press.copied;
    count_losses(&blocks, &part, &mut copied);
    Ok(copied)
}

/// The reader's counts go from the start of the recording, so they say something of a whole copy only.
fn count_losses(blocks: &Blocks, part: &CopyPart, copied: &mut Copied) {
    if *part == CopyPart::All {
        let counters = blocks.counters();
        (copied.off_sensor, copied.bytes_faulty) = (counters.off_sensor, counters.bytes_faulty);
        copied.marked_invalid = counters.marked_invalid;
    }
}

/// What events go through on their way.
struct Press<'a, 'b> {
    recording: &'a Recording,
    filter: Option<&'b mut dyn Filter>,
    transform: Option<&'b mut dyn Transform>,
    scratch: Vec<Event>,
    copied: Copied,
}

impl Press<'_, '_> {
    fn changes_nothing(&self) -> bool {
        self.filter.is_none() && self.transform.is_none()
    }

    /// Where a time is after it; what has none is counted.
    fn time(&mut self, t: u64) -> Option<u64> {
        let moved = self.moved(t);
        self.copied.out_of_time += u64::from(moved.is_none());
        moved
    }

    fn moved(&self, t: u64) -> Option<u64> {
        self.transform.as_deref().map_or(Some(t), |transform| transform.time(t))
    }

    /// Writes what the filter and the transform leave of the events, in memory of their own.
    fn write(&mut self, span: Span<'_>, writer: &mut Writer) -> Result<(), Error> {
        self.scratch.clear();
        self.scratch.extend_from_slice(span.events);
        let mut block = Block::new(span.t_first, span.t_last, span.geometry, &mut self.scratch);
        if let Some(filter) = &mut self.filter {
            let kept = filter.retain(&mut block).map_err(|wrong| refused(self.recording, &wrong))?;
            self.copied.filtered += (span.events.len() - kept) as u64;
        }
        let Some(transform) = &mut self.transform else { return writer.write(block.span()) };
        // Slow motion may make a block too long for one: then it goes in pieces.
        let reach_max = transform.reach_max(SPAN_MAX_US - 1);
        let kept = block.len();
        let mut rest = self.scratch.get_mut(..kept).unwrap_or_default();
        while !rest.is_empty() {
            let whole = Span { events: rest, ..span };
            let fitting = whole.fitting(reach_max);
            let t_first = whole.events.first().map_or(span.t_first, |first| whole.time(*first));
            let (piece, after) = rest.split_at_mut(fitting);
            let mut piece = Block::new(t_first, span.t_last, span.geometry, piece);
            let left = transform.apply(&mut piece).map_err(|unfit| refused(self.recording, &unfit))?;
            self.copied.filtered += (fitting - left) as u64;
            writer.write(piece.span())?;
            rest = after;
        }
        Ok(())
    }
}

fn refused(recording: &Recording, why: &dyn core::fmt::Display) -> Error {
    let remedy = "make filter and transform for the size of the recording";
    Error::new(ErrorKind::Refused, recording.path(), format!("cannot be filtered: {why}"), remedy)
}

/// The streams beside the events, each as far as it was written.
struct SideItems {
    imu: Peekable<Items<ImuSample>>,
    frames: Peekable<Items<Frame>>,
    /// Times to copy.
    window: Window,
}

/// Which side items to copy.
enum Window {
    /// Those of these times.
    Of(Range<u64>),
    /// Those from this time on until the last event's; not known before the first event.
    OfEvents(Option<u64>),
}

impl Window {
    fn contains(&self, t: u64) -> bool {
        match self {
            Self::Of(range) => range.contains(&t),
            Self::OfEvents(first) => first.is_some_and(|first| t >= first),
        }
    }
}

impl SideItems {
    fn new(recording: &Recording, part: &CopyPart) -> Self {
        let window = match part {
            CopyPart::All => Window::Of(0..u64::MAX),
            CopyPart::Time(t) => Window::Of(t.clone()),
            CopyPart::Events(_) => Window::OfEvents(None),
        };
        Self { imu: recording.imu().peekable(), frames: recording.frames().peekable(), window }
    }

    /// Writes what comes before an event of time `t`.
    fn write_before(&mut self, t: u64, press: &mut Press<'_, '_>, writer: &mut Writer) -> Result<(), Error> {
        if let Window::OfEvents(first @ None) = &mut self.window {
            *first = Some(t);
        }
        while let Some(sample) = self.imu.next_if(|one| one.as_ref().map_or(true, |sample| sample.t < t)) {
            let sample = sample?;
            if self.window.contains(sample.t)
                && let Some(t) = press.time(sample.t)
            {
                writer.write_imu(&ImuSample { t, ..sample })?;
            }
        }
        while let Some(frame) = self.frames.next_if(|one| one.as_ref().map_or(true, |frame| frame.t < t)) {
            let frame = frame?;
            if self.window.contains(frame.t)
                && let Some(t) = press.time(frame.t)
            {
                let exposure = frame.exposure.clone();
                let exposure =
                    exposure.and_then(|both| Some(press.moved(both.start)?..press.moved(both.end)?));
                writer.write_frame(Frame { t, exposure, ..frame })?;
            }
        }
        Ok(())
    }

    /// Writes what comes after the last event, whose time is `t_last`.
    fn write_rest(
        &mut self,
        t_last: Option<u64>,
        press: &mut Press<'_, '_>,
        writer: &mut Writer,
    ) -> Result<(), Error> {
        match (&self.window, t_last) {
            (Window::Of(_), _) => self.write_before(u64::MAX, press, writer),
            (Window::OfEvents(_), Some(t_last)) => self.write_before(t_last.saturating_add(1), press, writer),
            (Window::OfEvents(_), None) => Ok(()),
        }
    }
}
