//! How recently each pixel fired, in integers: the [`TimeSurface`](super::TimeSurface) of microcontrollers.
//!
//! Times are kept in ticks of 2^shift µs, in 16 bits, and the decay is looked up by the age in ticks. No float is
//! touched once it is made.

use crate::math::exp;
use crate::representation::index::{Draw, Places, draw_each};
use crate::representation::time_surface::{Decay, TAU_US_MAX};
use crate::representation::{BadRepresentation, Build, Overlap, Parameters, check};
use crate::{Event, Geometry, Representation, Shape, Span, Window, WrongGeometry};

/// Ages that the table tells; all greater ones are 0.
const AGES: usize = 1 << 10;

/// Words of the state that hold the table.
const TABLE_WORDS: usize = AGES / size_of::<u32>();

/// An age in ticks that stands for every greater one, and for never.
const OLD: u16 = 1 << 15;

/// 255 exp(-age / tau) of the last event of each pixel and polarity, to the nearest whole number: 2 x H x W (ON, OFF)
/// of u8. With [`Decay::Linear`], 255 (1 - age / tau) as far as that is over 0.
///
/// The age is that of [`TimeSurface`](super::TimeSurface), from the window's end, but in whole ticks of
/// [`tick_us`](Self::tick_us), between `tau_us / 164` and `tau_us / 82`, or 1 µs: `floor(t1 / tick) - floor(t / tick)`.
/// So a value is that of an age a tick more or less, at most 3 beside the true one. It is 0 where nothing ever
/// fired, and from 6.24 tau (linear: tau) on.
///
/// The state is [`state_len`](Self::state_len) words of the caller's: 1 KiB for the table, and 4 bytes a pixel. It
/// holds through silence of any length; a window that ends before the one before it did forgets everything.
///
/// ```
/// use lobula_core::representation::IntegerTimeSurface;
/// use lobula_core::{Event, Geometry, Polarity, Representation, Span, Window};
/// let geometry = Geometry::new(2, 1);
/// let events = [Event::new(900, 1, 0, Polarity::On)];
/// let mut out = [7; 4]; // whatever was there
/// let state = [0; IntegerTimeSurface::<()>::state_len(Geometry::new(2, 1))];
/// let mut surface = IntegerTimeSurface::try_new(geometry, 100, state)?;
/// surface.begin(Window { t0: 0, t1: 1_000 }, &mut out);
/// surface.accumulate(Span { t_first: 900, t_last: 900, geometry, events: &events }, &mut out)?;
/// surface.finish(&mut out);
/// assert_eq!(out, [0, 94, 0, 0]); // 255 / e
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct IntegerTimeSurface<S> {
    geometry: Geometry,
    tau_us: u32,
    shift: u32,
    window: Window,
    /// When, in ticks, no age in the map was over [`OLD`]; none before the first window.
    settled: Option<u64>,
    state: S,
}

impl<S> IntegerTimeSurface<S> {
    /// Words of the state: the table and two times of 16 bits for each pixel.
    pub const fn state_len(geometry: Geometry) -> usize {
        TABLE_WORDS.saturating_add(geometry.pixels())
    }

    /// The tick for a decay, in µs: the shortest, of a power of two, with which the table reaches as far as the values.
    pub const fn tick_us(tau_us: u32) -> u32 {
        1 << shift(tau_us)
    }
}

/// log2 of the tick. 255 exp(-6.25) is under 0.5: the table need not go on.
const fn shift(tau_us: u32) -> u32 {
    let mut shift = 0;
    while ((AGES as u64) << shift) * 4 < 25 * tau_us as u64 && shift < 31 {
        shift += 1;
    }
    shift
}

impl<S: AsRef<[u32]> + AsMut<[u32]>> IntegerTimeSurface<S> {
    /// For a sensor of this size, a decay of 1 to 2^25 µs, and a state of [`state_len`](Self::state_len) words, whatever
    /// they hold.
    pub fn try_new(geometry: Geometry, tau_us: u32, state: S) -> Result<Self, BadRepresentation> {
        if tau_us == 0 || tau_us > TAU_US_MAX {
            return Err(BadRepresentation::TauUs { found: tau_us });
        }
        let (expected, found) = (Self::state_len(geometry), state.as_ref().len());
        if expected != found {
            return Err(BadRepresentation::StateLen { expected, found });
        }
        let (shift, window) = (shift(tau_us), Window { t0: 0, t1: 0 });
        let surface = Self { geometry, tau_us, shift, window, settled: None, state };
        Ok(surface.with_decay(Decay::Exponential))
    }

    /// The same with another decay.
    pub fn with_decay(mut self, decay: Decay) -> Self {
        let (tau_us, shift) = (self.tau_us, self.shift);
        for (age, value) in parts_mut(self.state.as_mut()).0.iter_mut().enumerate() {
            let decays = ((age as u32) << shift) as f32 / tau_us as f32;
            let share = match decay {
                Decay::Exponential => exp(-decays),
                Decay::Linear => 1.0 - decays,
            };
            *value = (255.0 * share + 0.5) as u8; // 0 for what is below
        }
        self
    }

    /// Readies the map for a window: by its end no age will have reached 2^16 ticks.
    fn settle(&mut self, window: Window) {
        let (before, end) = (self.window.t1 >> self.shift, window.t1 >> self.shift);
        let reaches = |settled: u64| end.wrapping_sub(settled) < OLD.into();
        let (_, map) = parts_mut(self.state.as_mut());
        self.settled = match self.settled.filter(|_| window.t1 >= self.window.t1) {
            Some(settled) if reaches(settled) => Some(settled),
            Some(_) if reaches(before) => {
                let now = before as u16;
                for last in map {
                    *last = now.wrapping_sub(now.wrapping_sub(*last).min(OLD));
                }
                Some(before)
            }
            // The first window, or a restart of the clock, or all that was is too old to be seen.
            _ => {
                map.fill((end as u16).wrapping_sub(OLD));
                Some(end)
            }
        };
    }
}

/// The two parts of the state: the table by age, and the map of times.
fn parts(state: &[u32]) -> (&[u8], &[u16]) {
    let (table, map) = state.split_at_checked(TABLE_WORDS).unwrap_or_default();
    (bytemuck::cast_slice(table), bytemuck::cast_slice(map))
}

fn parts_mut(state: &mut [u32]) -> (&mut [u8], &mut [u16]) {
    let (table, map) = state.split_at_mut_checked(TABLE_WORDS).unwrap_or_default();
    (bytemuck::cast_slice_mut(table), bytemuck::cast_slice_mut(map))
}

impl<S: AsRef<[u32]> + AsMut<[u32]>> Representation for IntegerTimeSurface<S> {
    type Pixel = u8;

    fn shape(&self) -> Shape {
        Shape { channels: 2, height: self.geometry.height.into(), width: self.geometry.width.into() }
    }

    fn begin(&mut self, window: Window, _: &mut [u8]) {
        self.settle(window);
        self.window = window;
    }

    fn accumulate(&mut self, span: Span<'_>, _: &mut [u8]) -> Result<(), WrongGeometry> {
        check(self.geometry, &span)?;
        let mut stamping = Stamping::new(self.window, self.shift);
        let (_, map) = parts_mut(self.state.as_mut());
        draw_each(span.events, Places::by_polarity(self.geometry), map, &mut stamping);
        Ok(())
    }

    fn finish(&mut self, out: &mut [u8]) {
        let now = (self.window.t1 >> self.shift) as u16;
        let (table, map) = parts(self.state.as_ref());
        for (pixel, last) in out.iter_mut().zip(map) {
            let age = usize::from(now.wrapping_sub(*last));
            *pixel = table.get(age).copied().unwrap_or_default();
        }
    }

    fn overlap(&self) -> Overlap {
        Overlap::Memory
    }
}

/// Notes the times of events, as far as they lie in the window.
struct Stamping {
    shift: u32,
    t0: u32,
    length_us: i32,
    /// µs from the start of its tick to the window's start.
    into_tick: u32,
    /// From the tick of the window's start to that of its end.
    ticks: u32,
    end: u16,
}

impl Stamping {
    fn new(Window { t0, t1 }: Window, shift: u32) -> Self {
        Self {
            shift,
            t0: t0 as u32,
            length_us: t1.saturating_sub(t0).min(1 << 30) as i32,
            into_tick: t0 as u32 & ((1 << shift) - 1),
            ticks: (t1 >> shift).saturating_sub(t0 >> shift).min(u32::MAX.into()) as u32,
            end: (t1 >> shift) as u16,
        }
    }
}

impl Draw for Stamping {
    type Pixel = u16;
    type Value = u16;

    #[inline(always)]
    fn prepare(&self, event: Event, _: &mut u32) -> u16 {
        let since = (event.t().wrapping_sub(self.t0) as i32).max(0).min(self.length_us);
        let age = self.ticks.saturating_sub(self.into_tick.wrapping_add(since as u32) >> self.shift);
        self.end.wrapping_sub(age.min(OLD.into()) as u16)
    }

    #[inline(always)]
    fn draw(&mut self, map: &mut [u16], at: usize, stamp: u16) {
        if let Some(last) = map.get_mut(at) {
            *last = stamp;
        }
    }
}

impl<S: AsRef<[u32]> + AsMut<[u32]>> Build<S> for IntegerTimeSurface<S> {
    fn state_len(_: &Parameters, geometry: Geometry) -> usize {
        Self::state_len(geometry)
    }

    fn build(parameters: &Parameters, geometry: Geometry, state: S) -> Result<Self, BadRepresentation> {
        Ok(Self::try_new(geometry, parameters.tau_us, state)?.with_decay(parameters.decay))
    }
}
