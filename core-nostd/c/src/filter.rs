//! `lobula_<filter>_*`: the registry's filters, each with its parameters in C.

use crate::memory::{Opaque, slice_mut};
use crate::{Block, Size, Status};
use lobula_core::filter::{
    AntiFlicker, AntiFlickerParams, BackgroundActivity, BackgroundActivityParams, Decimate, DecimateParams,
    Denoise, DenoiseParams, DoubleWindow, DoubleWindowParams, FilterError, FlickerKeep, HotPixelFilter,
    Inceptive, InceptiveKeep, InceptiveParams, LeakyHotPixel, LeakyHotPixelParams, MaskFilter, MaskKeep,
    Neighbours, PixelMask, PolarityFilter, PolarityMatch, PolarityParams, RateLimit, RateLimitParams,
    Refractory, RefractoryParams, Refresh, RegionOfInterest, RegionParams, Stcf, StcfParams, Trail,
    TrailMode, TrailParams,
};
use lobula_core::time_map::TimeMapError;
use lobula_core::{Event, Filter, Geometry, Polarity};

/// `lobula_filter`.
pub type Memory = Opaque<40>;

impl From<FilterError> for Status {
    fn from(error: FilterError) -> Self {
        match error {
            FilterError::MemoryTooShort { .. }
            | FilterError::TimeMap(TimeMapError::MemoryTooShort { .. }) => Self::MemoryTooShort,
            _ => Self::BadParameter,
        }
    }
}

/// `lobula_polarity_params`.
#[derive(Clone, Copy)]
#[repr(C)]
pub struct PolarityOnly {
    on: bool,
}

/// `lobula_region_of_interest_params`.
#[derive(Clone, Copy)]
#[repr(C)]
pub struct Region {
    x: u16,
    y: u16,
    width: u16,
    height: u16,
}

/// `lobula_hot_pixel_params`: none.
#[derive(Clone, Copy)]
#[repr(C)]
pub struct HotPixelParams {
    reserved: u8,
}

/// `lobula_refractory_params`.
#[derive(Clone, Copy)]
#[repr(C)]
pub struct RefractoryPeriod {
    period_us: u32,
    refresh_all: bool,
    shift: u8,
}

/// `lobula_background_activity_params`.
#[derive(Clone, Copy)]
#[repr(C)]
pub struct Background {
    dt_us: u32,
    four_neighbours: bool,
    shift: u8,
}

/// `lobula_denoise_params`.
#[derive(Clone, Copy)]
#[repr(C)]
pub struct DenoiseAll {
    refractory_us: u32,
    support_us: u32,
    trail_us: u32,
    support: u8,
    same_polarity: bool,
    shift: u8,
}

/// `lobula_double_window_params`.
#[derive(Clone, Copy)]
#[repr(C)]
pub struct Windows {
    window: u16,
    distance_px: u16,
    support: u16,
}

/// `lobula_stcf_params`.
#[derive(Clone, Copy)]
#[repr(C)]
pub struct Correlation {
    dt_us: u32,
    support: u8,
    same_polarity: bool,
    shift: u8,
}

/// `lobula_mask_params`.
#[derive(Clone, Copy)]
#[repr(C)]
pub struct MaskSide {
    outside: bool,
}

/// `lobula_leaky_hot_pixel_params`.
#[derive(Clone, Copy)]
#[repr(C)]
pub struct Leak {
    period_us: u32,
    limit: u8,
    leak: u8,
}

/// `lobula_trail_params` and `lobula_inceptive_params`: which of three, by its number in the header.
#[derive(Clone, Copy)]
#[repr(C)]
pub struct Burst {
    dt_us: u32,
    keep: u8,
    shift: u8,
}

/// `lobula_anti_flicker_params`.
#[derive(Clone, Copy)]
#[repr(C)]
pub struct Flicker {
    frequency_hz: u32,
    band_hz: u32,
    tile_shift: u8,
    burst: u8,
    cycles: u8,
    keep_flickering: bool,
}

/// `lobula_decimate_params`.
#[derive(Clone, Copy)]
#[repr(C)]
pub struct OneOf {
    n: u32,
}

/// `lobula_rate_limit_params`.
#[derive(Clone, Copy)]
#[repr(C)]
pub struct Rate {
    events: u32,
    period_us: u32,
    tile_shift: u8,
}

/// Lines of `name: type over its memory, word of the memory, parameters in C, words needed, how to make it`.
macro_rules! filters {
    ($($name:ident: $type:ty, $word:ty, $params:ty, $len:expr, $make:expr;)*) => {$(
        mod $name {
            use super::*;

            type Words = &'static mut [$word];

            fn needed(geometry: Geometry, params: $params) -> usize {
                let len: fn(Geometry, $params) -> usize = $len;
                len(geometry, params)
            }

            #[unsafe(export_name = concat!("lobula_", stringify!($name), "_required_len"))]
            unsafe extern "C" fn required_len(geometry: Size, params: *const $params) -> usize {
                // SAFETY: the caller's promise.
                needed(geometry.into(), unsafe { *params })
            }

            #[unsafe(export_name = concat!("lobula_", stringify!($name), "_init"))]
            unsafe extern "C" fn init(
                at: *mut Memory,
                geometry: Size,
                params: *const $params,
                memory: *mut $word,
                len: usize,
            ) -> Status {
                let make: fn(Geometry, $params, Words) -> Result<$type, FilterError> = $make;
                // SAFETY: the caller's promise.
                let (params, memory) = unsafe { (*params, slice_mut(memory, len)) };
                if memory.len() < needed(geometry.into(), params) {
                    return Status::MemoryTooShort;
                }
                match make(geometry.into(), params, memory) {
                    Ok(filter) => {
                        // SAFETY: the caller's promise.
                        unsafe { Memory::write(at, filter) };
                        Status::Ok
                    }
                    Err(error) => error.into(),
                }
            }

            #[unsafe(export_name = concat!("lobula_", stringify!($name), "_retain"))]
            unsafe extern "C" fn retain(filter: *mut Memory, block: *mut Block) -> Status {
                // SAFETY: the caller's promise.
                let (filter, block) = unsafe { (Memory::get::<$type>(filter), &mut *block) };
                super::retain(filter, block)
            }

            #[unsafe(export_name = concat!("lobula_", stringify!($name), "_keep"))]
            unsafe extern "C" fn keep(filter: *mut Memory, event: Event) -> bool {
                // SAFETY: the caller's promise.
                unsafe { Memory::get::<$type>(filter) }.keep(event)
            }

            #[unsafe(export_name = concat!("lobula_", stringify!($name), "_advance"))]
            unsafe extern "C" fn advance(filter: *mut Memory, now: u64) {
                // SAFETY: the caller's promise.
                unsafe { Memory::get::<$type>(filter) }.advance(now)
            }
        }
    )*};
}

fn retain(filter: &mut impl Filter, block: &mut Block) -> Status {
    // SAFETY: the caller's promise.
    let events = unsafe { slice_mut(block.events, block.len) };
    let mut thinned = lobula_core::Block::new(block.t_first, block.t_last, block.geometry.into(), events);
    match filter.retain(&mut thinned) {
        Ok(len) => {
            block.len = len;
            Status::Ok
        }
        Err(_) => Status::WrongGeometry,
    }
}

fn refractory(params: RefractoryPeriod) -> RefractoryParams {
    let refresh = if params.refresh_all { Refresh::All } else { Refresh::Kept };
    RefractoryParams { dt_us: params.period_us, refresh, shift: params.shift }
}

fn background(params: Background) -> BackgroundActivityParams {
    let neighbours = if params.four_neighbours { Neighbours::Four } else { Neighbours::Eight };
    BackgroundActivityParams { dt_us: params.dt_us, neighbours, shift: params.shift }
}

fn denoise(params: DenoiseAll) -> DenoiseParams {
    let DenoiseAll { refractory_us, support_us, trail_us, support, same_polarity, shift } = params;
    let polarity_match = alike(same_polarity);
    DenoiseParams { refractory_us, support_us, support, polarity_match, trail_us, shift }
}

fn double_window(Windows { window, distance_px, support }: Windows) -> DoubleWindowParams {
    DoubleWindowParams { window, distance_px, support }
}

fn alike(same_polarity: bool) -> PolarityMatch {
    if same_polarity { PolarityMatch::Same } else { PolarityMatch::Any }
}

fn stcf(Correlation { dt_us, support, same_polarity, shift }: Correlation) -> StcfParams {
    StcfParams { dt_us, support, polarity_match: alike(same_polarity), shift }
}

fn trail(Burst { dt_us, keep, shift }: Burst) -> Option<TrailParams> {
    let mode = *[TrailMode::Trail, TrailMode::StcCutTrail, TrailMode::StcKeepTrail].get(usize::from(keep))?;
    Some(TrailParams { dt_us, mode, shift })
}

fn inceptive(Burst { dt_us, keep, shift }: Burst) -> Option<InceptiveParams> {
    let kinds = [InceptiveKeep::Inceptive, InceptiveKeep::Confirming, InceptiveKeep::Trailing];
    Some(InceptiveParams { dt_us, keep: *kinds.get(usize::from(keep))?, shift })
}

/// A number in the parameters that names nothing.
fn unknown(value: u8) -> FilterError {
    FilterError::OutOfRange { name: "keep", value: value.into(), min: 0, max: 2 }
}

fn anti_flicker(params: Flicker) -> AntiFlickerParams {
    let Flicker { frequency_hz, band_hz, tile_shift, burst, cycles, keep_flickering } = params;
    let keep = if keep_flickering { FlickerKeep::Flickering } else { FlickerKeep::Steady };
    AntiFlickerParams { frequency_hz, band_hz, tile_shift, burst, cycles, keep }
}

filters! {
    stcf_u32: Stcf<u32, Words>, u32, Correlation,
        |geometry, _| Stcf::<u32, ()>::required_len(geometry),
        |geometry, params, memory| Stcf::try_new(geometry, stcf(params), memory);
    stcf_u16: Stcf<u16, Words>, u16, Correlation,
        |geometry, _| Stcf::<u16, ()>::required_len(geometry),
        |geometry, params, memory| Stcf::try_new(geometry, stcf(params), memory);
    mask: MaskFilter<Words>, u32, MaskSide,
        |geometry, _| PixelMask::<()>::required_len(geometry),
        |geometry, params, memory| {
            let keep = if params.outside { MaskKeep::Outside } else { MaskKeep::Inside };
            PixelMask::try_from_words(geometry, memory).map(|mask| MaskFilter::new(mask, keep))
        };
    leaky_hot_pixel: LeakyHotPixel<Words>, u8, Leak,
        |geometry, _| LeakyHotPixel::<()>::required_len(geometry),
        |geometry, Leak { period_us, limit, leak }, memory| {
            LeakyHotPixel::try_new(geometry, LeakyHotPixelParams { limit, leak, period_us }, memory)
        };
    trail_u32: Trail<u32, Words>, u32, Burst,
        |geometry, _| Trail::<u32, ()>::required_len(geometry),
        |geometry, params, memory| {
            Trail::try_new(geometry, trail(params).ok_or(unknown(params.keep))?, memory)
        };
    trail_u16: Trail<u16, Words>, u16, Burst,
        |geometry, _| Trail::<u16, ()>::required_len(geometry),
        |geometry, params, memory| {
            Trail::try_new(geometry, trail(params).ok_or(unknown(params.keep))?, memory)
        };
    inceptive_u32: Inceptive<u32, Words>, u32, Burst,
        |geometry, _| Inceptive::<u32, ()>::required_len(geometry),
        |geometry, params, memory| {
            Inceptive::try_new(geometry, inceptive(params).ok_or(unknown(params.keep))?, memory)
        };
    inceptive_u16: Inceptive<u16, Words>, u16, Burst,
        |geometry, _| Inceptive::<u16, ()>::required_len(geometry),
        |geometry, params, memory| {
            Inceptive::try_new(geometry, inceptive(params).ok_or(unknown(params.keep))?, memory)
        };
    anti_flicker: AntiFlicker<Words>, u32, Flicker,
        |geometry, params| AntiFlicker::<()>::required_len(geometry, params.tile_shift),
        |geometry, params, memory| AntiFlicker::try_new(geometry, anti_flicker(params), memory);
    decimate: Decimate, u8, OneOf, |_, _| 0,
        |geometry, params, _| Decimate::try_new(geometry, DecimateParams { n: params.n });
    rate_limit: RateLimit<Words>, u32, Rate,
        |geometry, params| RateLimit::<()>::required_len(geometry, params.tile_shift),
        |geometry, Rate { events, period_us, tile_shift }, memory| {
            RateLimit::try_new(geometry, RateLimitParams { events, period_us, tile_shift }, memory)
        };
    polarity: PolarityFilter, u8, PolarityOnly, |_, _| 0, |geometry, params, _| {
        let keep = if params.on { Polarity::On } else { Polarity::Off };
        Ok(PolarityFilter::new(geometry, PolarityParams { keep }))
    };
    region_of_interest: RegionOfInterest, u8, Region, |_, _| 0, |geometry, params, _| {
        let Region { x, y, width, height } = params;
        RegionOfInterest::try_new(geometry, RegionParams { x, y, width, height })
    };
    hot_pixel: HotPixelFilter<Words>, u32, HotPixelParams,
        |geometry, _| PixelMask::<()>::required_len(geometry),
        |geometry, _, memory| PixelMask::empty(geometry, memory).map(HotPixelFilter::new);
    refractory_u32: Refractory<u32, Words>, u32, RefractoryPeriod,
        |geometry, _| Refractory::<u32, ()>::required_len(geometry),
        |geometry, params, memory| Refractory::try_new(geometry, refractory(params), memory);
    refractory_u16: Refractory<u16, Words>, u16, RefractoryPeriod,
        |geometry, _| Refractory::<u16, ()>::required_len(geometry),
        |geometry, params, memory| Refractory::try_new(geometry, refractory(params), memory);
    background_activity_u32: BackgroundActivity<u32, Words>, u32, Background,
        |geometry, _| BackgroundActivity::<u32, ()>::required_len(geometry),
        |geometry, params, memory| BackgroundActivity::try_new(geometry, background(params), memory);
    background_activity_u16: BackgroundActivity<u16, Words>, u16, Background,
        |geometry, _| BackgroundActivity::<u16, ()>::required_len(geometry),
        |geometry, params, memory| BackgroundActivity::try_new(geometry, background(params), memory);
    denoise_u32: Denoise<u32, Words>, u32, DenoiseAll,
        |geometry, _| Denoise::<u32, ()>::required_len(geometry),
        |geometry, params, memory| Denoise::try_new(geometry, denoise(params), memory);
    denoise_u16: Denoise<u16, Words>, u16, DenoiseAll,
        |geometry, _| Denoise::<u16, ()>::required_len(geometry),
        |geometry, params, memory| Denoise::try_new(geometry, denoise(params), memory);
    double_window: DoubleWindow<Words>, u32, Windows,
        |_, params| DoubleWindow::<()>::required_len(params.window),
        |geometry, params, memory| DoubleWindow::try_new(geometry, double_window(params), memory);
}

macro_rules! masks {
    ($($name:literal: $type:ty;)*) => {$(
        const _: () = {
            #[unsafe(export_name = concat!("lobula_", $name, "_mask"))]
            unsafe extern "C" fn mask(filter: *mut Memory, x: u16, y: u16) -> bool {
                // SAFETY: the caller's promise.
                unsafe { Memory::get::<$type>(filter) }.mask(x, y)
            }
        };
    )*};
}

masks! {
    "hot_pixel": HotPixelFilter<&'static mut [u32]>;
    "denoise_u32": Denoise<u32, &'static mut [u32]>;
    "denoise_u16": Denoise<u16, &'static mut [u16]>;
}
