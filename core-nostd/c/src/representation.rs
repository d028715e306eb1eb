//! `lobula_<representation>_*`: the registry's representations, made from `lobula_parameters`.

use crate::memory::{Opaque, slice, slice_mut};
use crate::{Block, Size, Status};
use lobula_core::representation::{
    BadRepresentation, Build, Count, IntegerTimeSurface, Parameters, PolarityHistogram, TileCount,
    TimeSurface, VoxelGrid,
};
use lobula_core::{Representation, Span, Window};

/// `lobula_representation`.
pub type Memory = Opaque<24>;

/// `lobula_parameters`; 0 is the default.
#[derive(Clone, Copy)]
#[repr(C)]
pub struct Settings {
    tau_us: u32,
    bins: u16,
    tile_px: u16,
}

impl From<Settings> for Parameters {
    fn from(settings: Settings) -> Self {
        let mut parameters = Self::default();
        if settings.tau_us != 0 {
            parameters.tau_us = settings.tau_us;
        }
        if settings.bins != 0 {
            parameters.bins = settings.bins;
        }
        if settings.tile_px != 0 {
            parameters.tile_px = settings.tile_px;
        }
        parameters
    }
}

/// `lobula_shape`.
#[repr(C)]
pub struct Shape {
    channels: usize,
    height: usize,
    width: usize,
}

type State = &'static mut [u32];

fn init<R: Build<State>>(at: *mut Memory, parameters: &Parameters, geometry: Size, state: State) -> Status {
    match R::build(parameters, geometry.into(), state) {
        Ok(stage) => {
            // SAFETY: the caller's promise.
            unsafe { Memory::write(at, stage) };
            Status::Ok
        }
        Err(BadRepresentation::StateLen { .. }) => Status::MemoryTooShort,
        Err(_) => Status::BadParameter,
    }
}

macro_rules! representations {
    ($($name:ident: $type:ty;)*) => {$(
        mod $name {
            use super::*;
            type Pixel = <$type as Representation>::Pixel;

            #[unsafe(export_name = concat!("lobula_", stringify!($name), "_state_len"))]
            unsafe extern "C" fn state_len(geometry: Size, settings: *const Settings) -> usize {
                // SAFETY: the caller's promise.
                let parameters = unsafe { *settings }.into();
                <$type as Build<State>>::state_len(&parameters, geometry.into())
            }

            #[unsafe(export_name = concat!("lobula_", stringify!($name), "_init"))]
            unsafe extern "C" fn init(
                at: *mut Memory,
                geometry: Size,
                settings: *const Settings,
                state: *mut u32,
                len: usize,
            ) -> Status {
                // SAFETY: the caller's promise.
                let (parameters, state) = unsafe { ((*settings).into(), slice_mut(state, len)) };
                super::init::<$type>(at, &parameters, geometry, state)
            }

            #[unsafe(export_name = concat!("lobula_", stringify!($name), "_shape"))]
            unsafe extern "C" fn shape(stage: *mut Memory) -> Shape {
                // SAFETY: the caller's promise.
                let shape = unsafe { Memory::get::<$type>(stage) }.shape();
                Shape { channels: shape.channels, height: shape.height, width: shape.width }
            }

            #[unsafe(export_name = concat!("lobula_", stringify!($name), "_begin"))]
            unsafe extern "C" fn begin(stage: *mut Memory, t0: u64, t1: u64, out: *mut Pixel, len: usize) {
                // SAFETY: the caller's promise.
                unsafe { Memory::get::<$type>(stage).begin(Window { t0, t1 }, slice_mut(out, len)) }
            }

            #[unsafe(export_name = concat!("lobula_", stringify!($name), "_accumulate"))]
            unsafe extern "C" fn accumulate(
                stage: *mut Memory,
                block: *const Block,
                out: *mut Pixel,
                len: usize,
            ) -> Status {
                // SAFETY: the caller's promise.
                let (stage, block, out) =
                    unsafe { (Memory::get::<$type>(stage), &*block, slice_mut(out, len)) };
                // SAFETY: the caller's promise.
                let events = unsafe { slice(block.events, block.len) };
                let (t_first, t_last, geometry) = (block.t_first, block.t_last, block.geometry.into());
                match stage.accumulate(Span { t_first, t_last, geometry, events }, out) {
                    Ok(()) => Status::Ok,
                    Err(_) => Status::WrongGeometry,
                }
            }

            #[unsafe(export_name = concat!("lobula_", stringify!($name), "_finish"))]
            unsafe extern "C" fn finish(stage: *mut Memory, out: *mut Pixel, len: usize) {
                // SAFETY: the caller's promise.
                unsafe { Memory::get::<$type>(stage).finish(slice_mut(out, len)) }
            }

            #[unsafe(export_name = concat!("lobula_", stringify!($name), "_saturated"))]
            unsafe extern "C" fn saturated(stage: *mut Memory) -> u64 {
                // SAFETY: the caller's promise.
                Build::<State>::saturated(unsafe { Memory::get::<$type>(stage) })
            }
        }
    )*};
}

representations! {
    count_u8: Count<u8>;
    count_u16: Count<u16>;
    polarity_histogram_u8: PolarityHistogram<u8>;
    polarity_histogram_u16: PolarityHistogram<u16>;
    voxel_grid_f32: VoxelGrid;
    time_surface_f32: TimeSurface<f32, State>;
    time_surface_u8: IntegerTimeSurface<State>;
    tile_count_u16: TileCount<u16>;
}
