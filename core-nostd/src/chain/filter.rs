//! One stage of a chain: any filter of the registry, in memory of its own.

use super::ChainCause;
use crate::filter::*;
use crate::{Block, Event, Filter, Geometry, WrongGeometry};
use alloc::boxed::Box;
use alloc::vec::Vec;

/// A filter and its parameters.
///
/// A map's `shift` tells its entries: 0 (the default) for `u32` µs, n for `u16` ticks of 2^n µs, which halve the
/// memory and round times down.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
#[non_exhaustive]
pub enum FilterSpec {
    /// [`PolarityFilter`].
    Polarity(PolarityParams),
    /// [`RegionOfInterest`].
    RegionOfInterest(RegionParams),
    /// [`Refractory`].
    Refractory(RefractoryParams),
    /// [`BackgroundActivity`].
    BackgroundActivity(BackgroundActivityParams),
}

impl FilterSpec {
    /// The kind's name, as in a config file.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Polarity(_) => "polarity",
            Self::RegionOfInterest(_) => "region_of_interest",
            Self::Refractory(_) => "refractory",
            Self::BackgroundActivity(_) => "background_activity",
        }
    }
}

macro_rules! any_filter {
    (
        stateless { $($plain:ident: $plain_type:ty, $plain_params:ty;)* }
        stateful { $($variant:ident $module:ident: $type:ty, $params:ty, $word:ty;)* }
    ) => {
        $(mod $module {
            use super::*;
            pub type S = Box<[$word]>;
            pub type Of = $type;
        })*

        /// Any filter of the [registry](crate::filters), on the heap.
        #[derive(Clone, Debug)]
        #[non_exhaustive]
        #[allow(missing_docs, reason = "each is named by its type")]
        pub enum AnyFilter {
            $($plain($plain_type),)*
            $($variant($module::Of),)*
        }

        impl Filter for AnyFilter {
            fn advance(&mut self, now: u64) {
                match self {
                    $(Self::$plain(filter) => filter.advance(now),)*
                    $(Self::$variant(filter) => filter.advance(now),)*
                }
            }

            fn keep(&mut self, event: Event) -> bool {
                match self {
                    $(Self::$plain(filter) => filter.keep(event),)*
                    $(Self::$variant(filter) => filter.keep(event),)*
                }
            }

            fn retain(&mut self, block: &mut Block<'_>) -> Result<usize, WrongGeometry> {
                match self {
                    $(Self::$plain(filter) => filter.retain(block),)*
                    $(Self::$variant(filter) => filter.retain(block),)*
                }
            }
        }
    };
}

crate::filters!(any_filter);

impl AnyFilter {
    /// The filter that `spec` describes, for events of this sensor.
    pub fn try_new(spec: &FilterSpec, geometry: Geometry) -> Result<Self, ChainCause> {
        match *spec {
            FilterSpec::Polarity(params) => Ok(Self::Polarity(PolarityFilter::try_new(geometry, params)?)),
            FilterSpec::RegionOfInterest(params) => {
                Ok(Self::RegionOfInterest(RegionOfInterest::try_new(geometry, params)?))
            }
            FilterSpec::Refractory(params) => {
                let len = Refractory::<(), ()>::required_len(geometry);
                Ok(match params.shift {
                    0 => Self::RefractoryU32(Refractory::try_new(geometry, params, memory(len)?)?),
                    _ => Self::RefractoryU16(Refractory::try_new(geometry, params, memory(len)?)?),
                })
            }
            FilterSpec::BackgroundActivity(params) => {
                let len = BackgroundActivity::<(), ()>::required_len(geometry);
                Ok(match params.shift {
                    0 => Self::BackgroundActivityU32(BackgroundActivity::try_new(
                        geometry,
                        params,
                        memory(len)?,
                    )?),
                    _ => Self::BackgroundActivityU16(BackgroundActivity::try_new(
                        geometry,
                        params,
                        memory(len)?,
                    )?),
                })
            }
        }
    }
}

/// Memory of its own for a filter; too much is an error and never an abort.
fn memory<W: Clone + Default>(len: usize) -> Result<Box<[W]>, ChainCause> {
    let bytes = len.saturating_mul(size_of::<W>());
    let mut words = Vec::new();
    words.try_reserve_exact(len).map_err(|_| ChainCause::OutOfMemory { bytes })?;
    words.resize(len, W::default());
    Ok(words.into_boxed_slice())
}

impl From<FilterError> for ChainCause {
    fn from(error: FilterError) -> Self {
        Self::Filter(error)
    }
}
