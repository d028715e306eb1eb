//! `lobula_<filter>_*`: the registry's filters, each with its parameters in C.

use crate::memory::{Opaque, slice_mut};
use crate::{Block, Size, Status};
use lobula_core::filter::{
    BackgroundActivity, BackgroundActivityParams, Denoise, DenoiseParams, DoubleWindow, DoubleWindowParams,
    FilterError, HotPixelFilter, Neighbours, PixelMask, PolarityFilter, PolarityMatch, PolarityParams,
    Refractory, RefractoryParams, Refresh, RegionOfInterest, RegionParams,
};
use lobula_core::time_map::TimeMapError;
use lobula_core::{Event, Filter, Geometry, Polarity};

/// `lobula_filter`.
pub type Memory = Opaque<24>;

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
    let polarity_match = if same_polarity { PolarityMatch::Same } else { PolarityMatch::Any };
    DenoiseParams { refractory_us, support_us, support, polarity_match, trail_us, shift }
}

fn double_window(Windows { window, distance_px, support }: Windows) -> DoubleWindowParams {
    DoubleWindowParams { window, distance_px, support }
}

filters! {
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
