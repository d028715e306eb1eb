//! Stages chosen at run time from settings: the one parser of them for daemon, tool and Python.
//!
//! A [`Chain`] of filters gives the same bits as the same filters in a tuple on firmware ([`pipeline`](crate::pipeline)).

mod cut;
mod filter;
mod view;

pub use filter::{AnyFilter, DenoiseSpec, FilterSpec, HotPixelSpec, MaskSpec};
pub use view::{BadView, Canvas, Line, Offline, PushError, Reference, View, ViewSpec};

use crate::filter::{DenoiseParams, FilterError};
use crate::{Block, Event, Filter, Geometry, WrongGeometry};
use alloc::vec::Vec;

/// What a chain is made of: filters in order, each with its parameters. Unknown kinds and keys are errors.
///
/// ```
/// use lobula_core::chain::{Chain, Spec};
/// # use lobula_core::Geometry;
/// let spec: Spec = serde_json::from_str(r#"[
///     { "kind": "refractory", "dt_us": 500 },
///     { "kind": "background_activity", "dt_us": 5000, "neighbours": "eight", "shift": 4 }
/// ]"#)?;
/// let chain = Chain::try_new(&spec, Geometry::new(1280, 720))?;
/// assert_eq!(chain.counts().collect::<Vec<_>>(), [("refractory", 0), ("background_activity", 0)]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(transparent)]
pub struct Spec {
    /// The filters, first to last; none passes every event.
    pub filters: Vec<FilterSpec>,
}

impl Spec {
    /// What the daemon filters with unless told otherwise: [`Denoise`](crate::filter::Denoise) with its defaults, in
    /// a map of 16 bits.
    pub fn standard() -> Self {
        let params = DenoiseParams { shift: 3, ..DenoiseParams::default() };
        Self { filters: [FilterSpec::Denoise(params.into())].into() }
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
    /// Its parameters.
    Filter(FilterError),
    /// There is not enough memory for its map.
    OutOfMemory {
        /// Bytes it needs.
        bytes: usize,
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
            ChainCause::OutOfMemory { bytes } => write!(f, "no memory for its map of {bytes} bytes"),
            ChainCause::PixelOffSensor { x, y, geometry } => {
                write!(f, "pixel ({x}, {y}) is not on the {geometry} sensor: give the pixels of this camera")
            }
        }
    }
}

impl core::error::Error for ChainError {}

/// Filters in a row, with a count of what each removed.
#[derive(Clone, Debug)]
pub struct Chain {
    geometry: Geometry,
    stages: Vec<Stage>,
}

#[derive(Clone, Debug)]
struct Stage {
    kind: &'static str,
    filter: AnyFilter,
    removed: u64,
}

impl Chain {
    /// The filters of `spec` for events of this sensor, with memory of their own.
    pub fn try_new(spec: &Spec, geometry: Geometry) -> Result<Self, ChainError> {
        let stages = spec.filters.iter().enumerate().map(|(stage, spec)| {
            let kind = spec.kind();
            match AnyFilter::try_new(spec, geometry) {
                Ok(filter) => Ok(Stage { kind, filter, removed: 0 }),
                Err(cause) => Err(ChainError { stage, kind, cause }),
            }
        });
        Ok(Self { geometry, stages: stages.collect::<Result<_, _>>()? })
    }

    /// The sensor's size.
    pub fn geometry(&self) -> Geometry {
        self.geometry
    }

    /// Kind of each filter, in order, and the number of events it removed since the chain was made.
    pub fn counts(&self) -> impl ExactSizeIterator<Item = (&'static str, u64)> + '_ {
        self.stages.iter().map(|stage| (stage.kind, stage.removed))
    }

    /// Number of events all filters removed since the chain was made.
    pub fn removed(&self) -> u64 {
        self.stages.iter().map(|stage| stage.removed).sum()
    }
}

impl Filter for Chain {
    fn advance(&mut self, now: u64) {
        for stage in &mut self.stages {
            stage.filter.advance(now);
        }
    }

    fn keep(&mut self, event: Event) -> bool {
        self.stages.iter_mut().all(|stage| {
            let keep = stage.filter.keep(event);
            stage.removed += !keep as u64;
            keep
        })
    }

    fn retain(&mut self, block: &mut Block<'_>) -> Result<usize, WrongGeometry> {
        self.geometry.check(block.geometry)?;
        for stage in &mut self.stages {
            let before = block.len();
            let kept = stage.filter.retain(block)?;
            stage.removed += (before - kept) as u64;
        }
        Ok(block.len())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Polarity;

    #[test]
    fn an_empty_chain_passes_all_and_still_knows_its_sensor() {
        let mut chain = Chain::try_new(&Spec::default(), Geometry::new(4, 4)).unwrap();
        let mut events = [Event::new(1, 2, 3, Polarity::On); 5];
        assert_eq!(chain.retain(&mut Block::new(1, 1, Geometry::new(4, 4), &mut events)), Ok(5));
        assert!(chain.retain(&mut Block::new(1, 1, Geometry::new(5, 4), &mut events)).is_err());
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
        ] {
            assert!(serde_json::from_str::<Spec>(wrong).is_err(), "{wrong}");
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
            { "kind": "rate_limit", "events": 1000 }
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
        ];
        assert_eq!(kinds, expected);
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
}
