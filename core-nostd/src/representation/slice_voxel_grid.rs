//! Events in space and time with mean 0 and deviation 1: what E2VID and its kin are fed.
//!
//! Source: Rebecq et al., High Speed and High Dynamic Range Video with an Event Camera, TPAMI 2019, section 3.2, and
//! their code, which normalises what is not 0.

use crate::math::sqrt;
use crate::representation::{BadRepresentation, Build, Parameters, VoxelGrid};
use crate::vector::in_order;
use crate::{Geometry, Representation, Shape, Span, Window, WrongGeometry};

/// A signed [`VoxelGrid`] whose elements other than 0 have mean 0 and standard deviation 1: bins x H x W of f32.
///
/// `(v - mean) / sigma` of each element v that is not 0, with mean and sigma (of the population) over those; 0 stays 0.
/// Where all are the same there is no sigma, and they become 0. Known only at the window's end: the grid is kept in
/// memory of the caller's ([`state_len`](Self::state_len) elements).
///
/// The bins span the window. Over a window from the first event to the newest ([`LastEvent`](crate::representation::LastEvent)) it is
/// what the paper has.
///
/// ```
/// use lobula_core::representation::SliceVoxelGrid;
/// use lobula_core::{Event, Geometry, Polarity, Representation, Span, Window};
/// let geometry = Geometry::new(2, 1);
/// let events = [(0, Polarity::On), (1, Polarity::Off)].map(|(x, p)| Event::new(0, x, 0, p));
/// let mut out = [f32::NAN; 4]; // whatever was there
/// let mut voxel = SliceVoxelGrid::try_new(geometry, 2, [0; 4])?;
/// voxel.begin(Window { t0: 0, t1: 100 }, &mut out);
/// voxel.accumulate(Span { t_first: 0, t_last: 0, geometry, events: &events }, &mut out)?;
/// voxel.finish(&mut out);
/// assert_eq!(out, [1.0, -1.0, 0.0, 0.0]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct SliceVoxelGrid<S> {
    grid: VoxelGrid,
    state: S,
}

impl<S: AsRef<[u32]> + AsMut<[u32]>> SliceVoxelGrid<S> {
    /// Elements of the state.
    pub const fn state_len(geometry: Geometry, bins: u16) -> usize {
        geometry.pixels().saturating_mul(bins as usize)
    }

    /// For a sensor of this size, at least 1 bin, and state of [`state_len`](Self::state_len) elements, whatever they
    /// hold.
    pub fn try_new(geometry: Geometry, bins: u16, state: S) -> Result<Self, BadRepresentation> {
        let grid = VoxelGrid::try_new(geometry, bins)?;
        let (expected, found) = (Self::state_len(geometry, bins), state.as_ref().len());
        if expected != found {
            return Err(BadRepresentation::StateLen { expected, found });
        }
        Ok(Self { grid, state })
    }

    fn voxels(&mut self) -> (&mut VoxelGrid, &mut [f32]) {
        (&mut self.grid, bytemuck::cast_slice_mut(self.state.as_mut()))
    }
}

impl<S: AsRef<[u32]> + AsMut<[u32]>> Representation for SliceVoxelGrid<S> {
    type Pixel = f32;

    fn shape(&self) -> Shape {
        self.grid.shape()
    }

    fn begin(&mut self, window: Window, _: &mut [f32]) {
        let (grid, voxels) = self.voxels();
        grid.begin(window, voxels);
    }

    fn accumulate(&mut self, span: Span<'_>, _: &mut [f32]) -> Result<(), WrongGeometry> {
        let (grid, voxels) = self.voxels();
        grid.accumulate(span, voxels)
    }

    fn finish(&mut self, out: &mut [f32]) {
        let voxels: &[f32] = bytemuck::cast_slice(self.state.as_ref());
        let moments = in_order(
            #[inline(always)]
            || Moments::of(voxels),
        );
        let (mean, scale) = moments.normal();
        in_order(
            #[inline(always)]
            move || {
                for (out, voxel) in out.iter_mut().zip(voxels) {
                    // An `if` becomes a branch, and no predictor knows which voxel is 0.
                    let stays = u32::from(*voxel != 0.0).wrapping_neg();
                    *out = f32::from_bits(((*voxel - mean) * scale).to_bits() & stays);
                }
            },
        );
    }
}

/// Lanes of a sum: fixed, so that it is the same on every machine.
const LANES: usize = 8;

/// Sums over all elements that are not 0.
#[derive(Default)]
struct Moments {
    count: f64,
    sum: f64,
    squares: f64,
}

impl Moments {
    #[inline(always)]
    fn of(voxels: &[f32]) -> Self {
        let (mut counts, mut sums, mut squares) = ([0u32; LANES], [0.0f64; LANES], [0.0f64; LANES]);
        let (groups, rest) = voxels.as_chunks::<LANES>();
        let mut last = [0.0; LANES];
        last.iter_mut().zip(rest).for_each(|(last, voxel)| *last = *voxel);
        for group in groups.iter().chain([&last]) {
            for (count, voxel) in counts.iter_mut().zip(group) {
                *count = count.wrapping_add(u32::from(*voxel != 0.0));
            }
            let group = group.map(f64::from);
            for (sum, voxel) in sums.iter_mut().zip(group) {
                *sum += voxel;
            }
            for (square, voxel) in squares.iter_mut().zip(group) {
                *square += voxel * voxel;
            }
        }
        let counts = counts.map(f64::from);
        let [count, sum, squares] = [counts, sums, squares].map(|lanes| lanes.iter().fold(0.0, |a, b| a + b));
        Self { count, sum, squares }
    }

    /// The mean, and one over the deviation; 0 where there is none.
    fn normal(&self) -> (f32, f32) {
        let count = self.count.max(1.0);
        let mean = self.sum / count;
        let variance = (self.squares / count - mean * mean) as f32;
        // What is left of rounding is no deviation.
        let none = variance <= 1e-12 * (self.squares / count) as f32;
        (mean as f32, if none { 0.0 } else { 1.0 / sqrt(variance) })
    }
}

impl<S: AsRef<[u32]> + AsMut<[u32]>> Build<S> for SliceVoxelGrid<S> {
    fn state_len(parameters: &Parameters, geometry: Geometry) -> usize {
        Self::state_len(geometry, parameters.bins)
    }

    fn build(parameters: &Parameters, geometry: Geometry, state: S) -> Result<Self, BadRepresentation> {
        Self::try_new(geometry, parameters.bins, state)
    }
}
