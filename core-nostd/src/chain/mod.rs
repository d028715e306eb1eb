//! Stages chosen at run time from settings: the one parser of them for daemon, tool and Python.
//!
//! A [`Chain`] of filters gives the same bits as the same filters in a tuple on firmware ([`pipeline`](crate::pipeline)).

mod cut;
mod filter;
mod transform;
mod view;

pub use filter::{AnyFilter, DenoiseSpec, HotPixelList, HotPixelSpec, MaskSpec, StageSpec};
pub use transform::AnyTransform;
pub use view::{BadView, Canvas, Line, Offline, PushError, Reference, View, ViewSpec};

use crate::filter::{DenoiseParams, FilterError};
use crate::transform::TransformError;
use crate::{Block, Filter, Geometry, SPAN_MAX_US, Transform, Unfit};
use alloc::vec::Vec;

/// What a chain is made of: filters and transforms in order, each with its parameters. Unknown kinds and keys are errors.
///
/// ```
/// use lobula_core::chain::{Chain, Spec};
/// # use lobula_core::{Geometry, Transform};
/// let spec: Spec = serde_json::from_str(r#"[
///     { "kind": "refractory", "dt_us": 500 },
///     { "kind": "resize", "width": 320, "height": 180 },
///     { "kind": "background_activity", "dt_us": 5000, "neighbours": "eight", "shift": 4 }
/// ]"#)?;
/// let chain = Chain::try_new(&spec, Geometry::new(1280, 720))?;
/// assert_eq!(chain.counts().collect::<Vec<_>>(), [("refractory", 0), ("resize", 0), ("background_activity", 0)]);
/// assert_eq!(chain.output_geometry(), Geometry::new(320, 180));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(transparent)]
pub struct Spec {
    /// The stages, first to last; none passes every event as it is.
    pub stages: Vec<StageSpec>,
}

impl Spec {
    /// What the daemon filters with unless told otherwise: [`Denoise`](crate::filter::Denoise) with its defaults, in
    /// a map of 16 bits.
    pub fn standard() -> Self {
        let params = DenoiseParams { shift: 3, ..DenoiseParams::default() };
        Self { stages: [StageSpec::Denoise(params.into())].into() }
    }

    /// The first stage that gives events other times, by its number and its kind.
    pub fn moves_time(&self) -> Option<(usize, &'static str)> {
        let moves = |(_, spec): &(usize, &StageSpec)| spec.moves_time();
        self.stages.iter().enumerate().find(moves).map(|(i, spec)| (i, spec.kind()))
    }
}

/// Why a chain cannot be made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ChainError {
    /// Which stage, from 0.
    pub stage: usize,
    /// Its kind.
    pub kind: &'static str,
    /// What is wrong with it.
    pub cause: ChainCause,
}

/// What is wrong with a stage.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ChainCause {
    /// Its parameters, of a filter.
    Filter(FilterError),
    /// Its parameters, of a transform.
    Transform(TransformError),
    /// A transform was asked for where only filters go.
    NoFilter,
    /// There is not enough memory for its map.
    OutOfMemory {
        /// Bytes it needs.
        bytes: usize,
    },
    /// Its hot pixels are in a file that whoever read the settings did not load.
    FileNotLoaded,
    /// Its hot pixels are of another sensor.
    OtherSensor {
        /// Whose they are.
        expected: Geometry,
        /// The sensor's size.
        geometry: Geometry,
    },
    /// A pixel of its mask is not on the sensor.
    PixelOffSensor {
        /// Its column.
        x: u16,
        /// Its row.
        y: u16,
        /// The sensor's size.
        geometry: Geometry,
    },
}

impl core::fmt::Display for ChainError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "filter {} ({}): ", self.stage, self.kind)?;
        match self.cause {
            ChainCause::Filter(error) => error.fmt(f),
            ChainCause::Transform(error) => error.fmt(f),
            ChainCause::NoFilter => f.write_str("it is a transform and no filter: put it into a chain"),
            ChainCause::OutOfMemory { bytes } => write!(f, "no memory for its map of {bytes} bytes"),
            ChainCause::FileNotLoaded => {
                f.write_str("its file of hot pixels was not loaded: give the pixels")
            }
            ChainCause::OtherSensor { expected, geometry } => {
                write!(
                    f,
                    "its hot pixels are of a {expected} sensor and this is a {geometry} one: learn this camera's"
                )
            }
            ChainCause::PixelOffSensor { x, y, geometry } => {
                write!(f, "pixel ({x}, {y}) is not on the {geometry} sensor: give the pixels of this camera")
            }
        }
    }
}

impl core::error::Error for ChainError {}

/// Filters and transforms in a row, with a count of what each removed.
///
/// As a whole it is a transform: it tells the sensor's size after it, and refuses a block that one of its stages would have
/// to refuse before any has seen it.
#[derive(Clone, Debug)]
pub struct Chain {
    geometry: Geometry,
    output: Geometry,
    stages: Vec<Stage>,
}

#[derive(Clone, Debug)]
struct Stage {
    kind: &'static str,
    work: Work,
    removed: u64,
}

#[derive(Clone, Debug)]
enum Work {
    Filter(AnyFilter),
    Transform(AnyTransform),
}

impl Work {
    fn try_new(spec: &StageSpec, geometry: Geometry) -> Result<Self, ChainCause> {
        match AnyTransform::try_new(spec, geometry) {
            Some(transform) => transform.map(Self::Transform),
            None => AnyFilter::try_new(spec, geometry).map(Self::Filter),
        }
    }
}

impl Chain {
    /// The stages of `spec` for events of this sensor, each made for the size that those before it give, with memory of
    /// their own.
    pub fn try_new(spec: &Spec, geometry: Geometry) -> Result<Self, ChainError> {
        let mut output = geometry;
        let stages = spec.stages.iter().enumerate().map(|(stage, spec)| {
            let kind = spec.kind();
            let work = Work::try_new(spec, output).map_err(|cause| ChainError { stage, kind, cause })?;
            if let Work::Transform(transform) = &work {
                output = transform.output_geometry();
            }
            Ok(Stage { kind, work, removed: 0 })
        });
        let stages = stages.collect::<Result<_, _>>()?;
        Ok(Self { geometry, output, stages })
    }

    /// The sensor's size before it; after it is [`output_geometry`](Transform::output_geometry).
    pub fn geometry(&self) -> Geometry {
        self.geometry
    }

    /// Kind of each stage, in order, and the number of events it removed since the chain was made.
    pub fn counts(&self) -> impl ExactSizeIterator<Item = (&'static str, u64)> + '_ {
        self.stages.iter().map(|stage| (stage.kind, stage.removed))
    }

    /// Number of events all stages removed since the chain was made.
    pub fn removed(&self) -> u64 {
        self.stages.iter().map(|stage| stage.removed).sum()
    }
}

impl Transform for Chain {
    fn output_geometry(&self) -> Geometry {
        self.output
    }

    fn reach_max(&self, after: u64) -> u64 {
        self.stages.iter().rev().fold(after, |after, stage| match &stage.work {
            Work::Filter(_) => after,
            Work::Transform(transform) => transform.reach_max(after),
        })
    }

    fn time(&self, t: u64) -> Option<u64> {
        self.stages.iter().try_fold(t, |t, stage| match &stage.work {
            Work::Filter(_) => Some(t),
            Work::Transform(transform) => transform.time(t),
        })
    }

    fn apply(&mut self, block: &mut Block<'_>) -> Result<usize, Unfit> {
        self.geometry.check(block.geometry)?;
        let reach_max = self.reach_max(SPAN_MAX_US - 1);
        if reach_max < SPAN_MAX_US - 1 && block.span().reach() > reach_max {
            return Err(Unfit::Reach { reach_max });
        }
        for stage in &mut self.stages {
            let before = block.len();
            let left = match &mut stage.work {
                Work::Filter(filter) => filter.retain(block)?,
                Work::Transform(transform) => transform.apply(block)?,
            };
            stage.removed += (before - left) as u64;
        }
        Ok(block.len())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Event, Polarity};

    #[test]
    fn an_empty_chain_passes_all_and_still_knows_its_sensor() {
        let mut chain = Chain::try_new(&Spec::default(), Geometry::new(4, 4)).unwrap();
        let mut events = [Event::new(1, 2, 3, Polarity::On); 5];
        assert_eq!(chain.apply(&mut Block::new(1, 1, Geometry::new(4, 4), &mut events)), Ok(5));
        assert!(chain.apply(&mut Block::new(1, 1, Geometry::new(5, 4), &mut events)).is_err());
    }

    #[test]
    fn refuses_what_it_does_not_know() {
        for wrong in [
            r#"[{ "kind": "refractory" }]"#,
            r#"[{ "kind": "refractory", "dt_ms": 1 }]"#,
            r#"[{ "kind": "refractory", "dt_us": 1, "dt_ms": 1 }]"#,
            r#"[{ "kind": "refractory", "dt_us": -1 }]"#,
            r#"[{ "kind": "refractor", "dt_us": 1 }]"#,
            r#"[{ "dt_us": 1 }]"#,
            r#"[{ "kind": "flip_x", "y": 1 }]"#,
            r#"[{ "kind": "crop", "x": 1, "y": 1, "width": 5 }]"#,
            r#"[{ "kind": "undistort", "fx": 1, "fy": 1, "cx": 0, "cy": 0 }]"#,
            r#"[{ "kind": "undistort", "model": "fisheye", "fx": 1, "fy": 1, "cx": 0, "cy": 0, "p1": 0 }]"#,
        ] {
            assert!(serde_json::from_str::<Spec>(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn hot_pixels_of_another_sensor_or_in_a_file_are_refused() {
        let cause = |text: &str| {
            let spec: Spec = serde_json::from_str(text).unwrap();
            Chain::try_new(&spec, Geometry::new(8, 8)).err().map(|error| error.cause)
        };
        let other = ChainCause::OtherSensor { expected: Geometry::new(8, 9), geometry: Geometry::new(8, 8) };
        for (text, expected) in [
            (r#"[{ "kind": "hot_pixel", "pixels": [[1, 2]], "sensor": [8, 8] }]"#, None),
            (r#"[{ "kind": "hot_pixel", "pixels": [[1, 2]], "sensor": [8, 9] }]"#, Some(other)),
            (r#"[{ "kind": "hot_pixel", "file": "a.txt" }]"#, Some(ChainCause::FileNotLoaded)),
            (r#"[{ "kind": "denoise", "hot_pixels": [], "hot_pixels_sensor": [8, 9] }]"#, Some(other)),
            (r#"[{ "kind": "denoise", "hot_pixels_file": "a.txt" }]"#, Some(ChainCause::FileNotLoaded)),
        ] {
            assert_eq!(cause(text), expected, "{text}");
        }
    }

    #[test]
    fn settings_survive_a_round_trip() {
        let text = r#"[
            { "kind": "polarity", "keep": "off" },
            { "kind": "region_of_interest", "x": 1, "y": 2, "width": 3, "height": 4 },
            { "kind": "hot_pixel", "pixels": [[1, 2], [3, 4]] },
            { "kind": "refractory", "dt_us": 100, "refresh": "all", "shift": 2 },
            { "kind": "background_activity", "dt_us": 100, "neighbours": "four" },
            { "kind": "denoise", "support": 3, "hot_pixels": [[5, 6]] },
            { "kind": "double_window", "window": 16 },
            { "kind": "stcf", "polarity_match": "same", "shift": 1 },
            { "kind": "mask", "pixels": [[1, 2]], "keep": "outside" },
            { "kind": "leaky_hot_pixel", "limit": 9 },
            { "kind": "trail", "mode": "stc_keep_trail", "shift": 3 },
            { "kind": "inceptive", "keep": "confirming" },
            { "kind": "anti_flicker", "frequency_hz": 120, "keep": "flickering" },
            { "kind": "decimate", "n": 4 },
            { "kind": "rate_limit", "events": 1000 },
            { "kind": "crop", "x": 1, "y": -2, "width": 6, "height": 12 },
            { "kind": "flip_x" },
            { "kind": "flip_y" },
            { "kind": "rotate90", "k": 1 },
            { "kind": "transpose" },
            { "kind": "translate", "dx": 1, "dy": -1 },
            { "kind": "resize", "width": 100, "height": 100 },
            { "kind": "scale", "sx": 0.5, "sy": 2.0 },
            { "kind": "affine", "matrix": [[1, 0, 0.5], [0, 1, 0]] },
            { "kind": "perspective", "matrix": [[1, 0, 0], [0, 1, 0], [0, 0, 1]] },
            { "kind": "undistort", "model": "brown_conrady", "fx": 50, "fy": 50, "cx": 25, "cy": 50, "k1": -0.2 },
            { "kind": "invert_polarity" },
            { "kind": "time_shift", "dt_us": -5 },
            { "kind": "time_scale", "factor": 2.0 },
            { "kind": "time_window", "t0_us": 5, "t1_us": 50 },
            { "kind": "normalize_time" }
        ]"#;
        let spec: Spec = serde_json::from_str(text).unwrap();
        let again = serde_json::from_str(&serde_json::to_string(&spec).unwrap()).unwrap();
        assert_eq!(spec, again);
        let chain = Chain::try_new(&spec, Geometry::new(8, 8)).unwrap();
        let kinds: Vec<&str> = chain.counts().map(|(kind, _)| kind).collect();
        let expected = [
            "polarity",
            "region_of_interest",
            "hot_pixel",
            "refractory",
            "background_activity",
            "denoise",
            "double_window",
            "stcf",
            "mask",
            "leaky_hot_pixel",
            "trail",
            "inceptive",
            "anti_flicker",
            "decimate",
            "rate_limit",
            "crop",
            "flip_x",
            "flip_y",
            "rotate90",
            "transpose",
            "translate",
            "resize",
            "scale",
            "affine",
            "perspective",
            "undistort",
            "invert_polarity",
            "time_shift",
            "time_scale",
            "time_window",
            "normalize_time",
        ];
        assert_eq!(kinds, expected);
        assert_eq!(
            (chain.geometry(), chain.output_geometry()),
            (Geometry::new(8, 8), Geometry::new(50, 200))
        );
        assert_eq!(spec.moves_time(), Some((27, "time_shift")));
        assert!(Chain::try_new(&Spec::standard(), Geometry::new(1280, 720)).is_ok());
    }

    #[test]
    fn refuses_hot_pixels_of_another_sensor() {
        let spec: Spec =
            serde_json::from_str(r#"[{ "kind": "hot_pixel", "pixels": [[7, 0], [8, 0]] }]"#).unwrap();
        let geometry = Geometry::new(8, 8);
        let cause = ChainCause::PixelOffSensor { x: 8, y: 0, geometry };
        assert_eq!(
            Chain::try_new(&spec, geometry).unwrap_err(),
            ChainError { stage: 0, kind: "hot_pixel", cause }
        );
    }

    #[test]
    fn names_the_stage_and_the_cause() {
        let spec = r#"[{ "kind": "polarity", "keep": "on" }, { "kind": "refractory", "dt_us": 1073741824 }]"#;
        let error = Chain::try_new(&serde_json::from_str(spec).unwrap(), Geometry::new(4, 4)).unwrap_err();
        let text = "filter 1 (refractory): 1073741824 µs is too long for the map: at most 1073741823";
        assert_eq!(alloc::string::ToString::to_string(&error), text);
    }

    #[test]
    fn a_stage_is_made_for_the_size_that_those_before_it_give() {
        let text = r#"[
            { "kind": "crop", "x": 2, "y": 1, "width": 4, "height": 3 },
            { "kind": "region_of_interest", "x": 0, "y": 0, "width": 4, "height": 3 },
            { "kind": "rotate90", "k": 1 },
            { "kind": "refractory", "dt_us": 10 }
        ]"#;
        let mut chain = Chain::try_new(&serde_json::from_str(text).unwrap(), Geometry::new(8, 8)).unwrap();
        let mut events =
            [(1, 2, 1), (2, 7, 1), (3, 2, 1), (14, 5, 3)].map(|(t, x, y)| Event::new(t, x, y, Polarity::On));
        let mut block = Block::new(1, 14, Geometry::new(8, 8), &mut events);
        assert_eq!(chain.apply(&mut block), Ok(2));
        assert_eq!(block.geometry, Geometry::new(3, 4));
        assert_eq!(
            block.span().events,
            [Event::new(1, 2, 0, Polarity::On), Event::new(14, 0, 3, Polarity::On)]
        );
        let removed: Vec<_> = chain.counts().map(|(_, removed)| removed).collect();
        assert_eq!(removed, [1, 0, 0, 1]);
        let off = text.replace(
            "\"width\": 4, \"height\": 3 },\n            { \"kind\": \"rot",
            "\"width\": 5, \"height\": 3 },\n            { \"kind\": \"rot",
        );
        assert_eq!(
            Chain::try_new(&serde_json::from_str(&off).unwrap(), Geometry::new(8, 8)).unwrap_err().stage,
            1
        );
    }

    #[test]
    fn a_block_too_long_is_refused_before_any_stage_saw_it() {
        let text = r#"[{ "kind": "refractory", "dt_us": 10 }, { "kind": "time_scale", "factor": 100 }]"#;
        let mut chain = Chain::try_new(&serde_json::from_str(text).unwrap(), Geometry::new(8, 8)).unwrap();
        let mut events = [0, 100_000_000].map(|t| Event::new(t, 1, 1, Polarity::On));
        let reach_max = chain.reach_max(SPAN_MAX_US - 1);
        let refusal = Err(Unfit::Reach { reach_max });
        assert_eq!(chain.apply(&mut Block::new(0, 100_000_000, Geometry::new(8, 8), &mut events)), refusal);
        let mut times = Vec::new();
        for event in &mut events {
            let t = event.t().into();
            let mut block = Block::new(t, t, Geometry::new(8, 8), core::slice::from_mut(event));
            assert_eq!(chain.apply(&mut block), Ok(1), "no stage has seen it yet");
            times.push(block.span().time(block.span().events[0]));
        }
        assert_eq!(times, [0, 10_000_000_000]);
        assert_eq!(chain.time(7), Some(700));
    }
}
