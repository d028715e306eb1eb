//! `lobula_<representation>_*`: the registry's representations, made from `lobula_parameters`.

use crate::memory::{Opaque, slice, slice_mut};
use crate::{Block, Size, Status};
use lobula_core::representation::{
    AveragedTimeSurface, Background, BadRepresentation, Binary, Build, Combine, Count, Decay, EventFrame,
    EventImage, EventSpikeTensor, IntegerTimeSurface, Interpolation, List, Mcts, MixedDensityStack, Palette,
    Parameters, Polarities, PolarityHistogram, Sits, SliceCountmask, SlicePolarityHistogram, SliceRedBlue,
    SliceVoxelGrid, StackedHistogram, Tencode, TileCount, TimeSurface, Tore, Tos, VoxelGrid,
};
use lobula_core::{Representation, Span, Window, f16};

/// `lobula_representation`.
pub type Memory = Opaque<24>;

/// `lobula_parameters`. What is one of several is a number from 0, in the order of the header.
#[derive(Clone, Copy)]
#[repr(C)]
pub struct Settings {
    tau_us: u32,
    max_window_us: u32,
    windows_us: [u32; List::MAX],
    age_min_us: u32,
    age_max_us: u32,
    windows_len: u16,
    bins: u16,
    tile_px: u16,
    radius: u16,
    depth: u16,
    cutoff: u8,
    threshold: u8,
    percentile: u8,
    polarities: u8,
    interpolation: u8,
    decay: u8,
    combine: u8,
    background: u8,
    palette: u8,
}

#[unsafe(export_name = "lobula_parameters_default")]
extern "C" fn defaults() -> Settings {
    let parameters = Parameters::default();
    Settings {
        tau_us: parameters.tau_us,
        max_window_us: parameters.max_window_us,
        windows_us: [0; List::MAX],
        age_min_us: parameters.age_min_us,
        age_max_us: parameters.age_max_us,
        windows_len: 0,
        bins: parameters.bins,
        tile_px: parameters.tile_px,
        radius: parameters.radius,
        depth: parameters.depth,
        cutoff: parameters.cutoff,
        threshold: parameters.threshold,
        percentile: parameters.percentile,
        polarities: 0,
        interpolation: 0,
        decay: 0,
        combine: 0,
        background: 0,
        palette: 0,
    }
}

impl Settings {
    /// None where a number stands for nothing.
    fn parameters(&self) -> Option<Parameters> {
        fn choice<T: Copy>(of: &[T], at: u8) -> Option<T> {
            of.get(usize::from(at)).copied()
        }
        let mut parameters = Parameters::default();
        parameters.tau_us = self.tau_us;
        parameters.max_window_us = self.max_window_us;
        parameters.windows_us = List::try_new(self.windows_us.get(..self.windows_len.into())?)?;
        parameters.age_min_us = self.age_min_us;
        parameters.age_max_us = self.age_max_us;
        parameters.bins = self.bins;
        parameters.tile_px = self.tile_px;
        parameters.radius = self.radius;
        parameters.depth = self.depth;
        parameters.cutoff = self.cutoff;
        parameters.threshold = self.threshold;
        parameters.percentile = self.percentile;
        parameters.polarities = choice(&[Polarities::Signed, Polarities::Apart], self.polarities)?;
        parameters.interpolation =
            choice(&[Interpolation::Linear, Interpolation::Nearest], self.interpolation)?;
        parameters.decay = choice(&[Decay::Exponential, Decay::Linear], self.decay)?;
        parameters.combine = choice(&[Combine::Sum, Combine::Latest], self.combine)?;
        parameters.background = choice(&[Background::Black, Background::White], self.background)?;
        parameters.palette = choice(&[Palette::Dark, Palette::Light, Palette::Gray], self.palette)?;
        Some(parameters)
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

fn init<R: Build<State>>(at: *mut Memory, settings: &Settings, geometry: Size, state: State) -> Status {
    let Some(parameters) = settings.parameters() else { return Status::BadParameter };
    match R::build(&parameters, geometry.into(), state) {
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
                let settings = unsafe { &*settings };
                let len = |parameters| <$type as Build<State>>::state_len(&parameters, geometry.into());
                settings.parameters().map_or(0, len)
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
                let (settings, state) = unsafe { (&*settings, slice_mut(state, len)) };
                super::init::<$type>(at, settings, geometry, state)
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
    count_f32: Count<f32>;
    polarity_histogram_u8: PolarityHistogram<u8>;
    polarity_histogram_u16: PolarityHistogram<u16>;
    polarity_histogram_f32: PolarityHistogram<f32>;
    voxel_grid_f32: VoxelGrid;
    time_surface_f32: TimeSurface<f32, State>;
    time_surface_f16: TimeSurface<f16, State>;
    time_surface_u8: IntegerTimeSurface<State>;
    tile_count_u16: TileCount<u16>;
    tile_count_f32: TileCount<f32>;
    binary: Binary;
    slice_polarity_histogram: SlicePolarityHistogram<State>;
    event_frame_u8: EventFrame<u8>;
    event_frame_f32: EventFrame<f32>;
    slice_voxel_grid: SliceVoxelGrid<State>;
    averaged_time_surface: AveragedTimeSurface<State>;
    mcts_f32: Mcts<f32, State>;
    mcts_f16: Mcts<f16, State>;
    tencode: Tencode<State>;
    slice_countmask: SliceCountmask<State>;
    slice_red_blue: SliceRedBlue<State>;
    event_image: EventImage<State>;
    stacked_histogram: StackedHistogram;
    mixed_density_stack: MixedDensityStack;
    event_spike_tensor: EventSpikeTensor;
    tore: Tore<State>;
    sits: Sits<State>;
    tos: Tos<State>;
}
