//! How many events there are over time.

use core::num::NonZeroU64;
use core::ops::Range;

use bytemuck::{Pod, Zeroable};

use crate::statistics::BadStatistic;
use crate::{Event, Span};

/// Events by polarity.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct Tally {
    /// ON events.
    pub on: u64,
    /// OFF events.
    pub off: u64,
}

impl Tally {
    /// Events of either polarity.
    pub const fn events(self) -> u64 {
        self.on.saturating_add(self.off)
    }

    /// Events a second, where they were counted for so many µs; 0 for none.
    pub fn per_second(self, us: u64) -> f64 {
        if us == 0 { 0.0 } else { self.events() as f64 / (us as f64 / 1e6) }
    }

    /// Balance of the polarities: (ON - OFF) / (ON + OFF), from -1 to 1; 0 without events.
    pub fn balance(self) -> f64 {
        let events = self.events();
        if events == 0 { 0.0 } else { (self.on as f64 - self.off as f64) / events as f64 }
    }

    fn add(&mut self, events: &[Event]) {
        let on = events.iter().map(|event| u64::from(event.is_on())).sum();
        self.on = self.on.wrapping_add(on);
        self.off = self.off.wrapping_add((events.len() as u64).wrapping_sub(on));
    }
}

/// Events by polarity in bins of equal length, `[start + n bin_us, start + (n + 1) bin_us)`.
///
/// Each event goes to the bin of its time, whatever the order. Events before the first bin or after the last are counted
/// in [`outside`](Self::outside). With `start` at the time of the earliest event these are the bins of eventcv's
/// `event_rate`; on the grid of a [`Slicer`](crate::Slicer), it is a multiple of `bin_us`.
///
/// ```
/// use lobula_core::statistics::{EventRate, Tally};
/// use lobula_core::{Event, Geometry, Polarity, Span};
/// let events = [1_000, 1_400, 2_100].map(|t| Event::new(t, 0, 0, Polarity::from_bit(u16::from(t < 1_200))));
/// let mut rate = EventRate::try_new(1_000, 1_000, [Tally::default(); 2])?;
/// rate.push(Span { t_first: 1_000, t_last: 2_100, geometry: Geometry::new(1, 1), events: &events });
/// assert_eq!(rate.bins(), [Tally { on: 1, off: 1 }, Tally { on: 0, off: 1 }]);
/// assert_eq!(rate.bins()[0].per_second(1_000), 2_000.0);
/// # Ok::<(), lobula_core::statistics::BadStatistic>(())
/// ```
#[derive(Clone, Debug)]
pub struct EventRate<S> {
    start: u64,
    bin_us: NonZeroU64,
    bins: S,
    outside: u64,
}

impl<S: AsRef<[Tally]> + AsMut<[Tally]>> EventRate<S> {
    /// As many bins as `bins` holds, of `bin_us` µs, the first from `start` on. What `bins` held is zeroed.
    pub fn try_new(start: u64, bin_us: u64, mut bins: S) -> Result<Self, BadStatistic> {
        let bin_us = NonZeroU64::new(bin_us).ok_or(BadStatistic::BinUs)?;
        bins.as_mut().fill(Tally::default());
        Ok(Self { start, bin_us, bins, outside: 0 })
    }

    /// Counts the events of a block.
    pub fn push(&mut self, span: Span<'_>) {
        let mut rest = span.events;
        while let Some(first) = rest.first() {
            let (bin, bounds) = self.bin(span.time(*first));
            let len = rest.iter().take_while(|event| bounds.contains(&span.time(**event))).count();
            let (now, later) = rest.split_at_checked(len.max(1)).unwrap_or((rest, &[]));
            let slot = bin.and_then(|bin| usize::try_from(bin).ok());
            match slot.and_then(|bin| self.bins.as_mut().get_mut(bin)) {
                Some(tally) => tally.add(now),
                None => self.outside = self.outside.wrapping_add(now.len() as u64),
            }
            rest = later;
        }
    }

    /// The number of the bin of a time, and all times of it; before the first, none and all times before.
    fn bin(&self, t: u64) -> (Option<u64>, Range<u64>) {
        match t.checked_sub(self.start) {
            Some(since) => {
                let first = t - since % self.bin_us;
                (Some(since / self.bin_us), first..first.saturating_add(self.bin_us.get()))
            }
            None => (None, 0..self.start),
        }
    }

    /// What each bin counted.
    pub fn bins(&self) -> &[Tally] {
        self.bins.as_ref()
    }

    /// Start of the first bin, in µs.
    pub const fn start(&self) -> u64 {
        self.start
    }

    /// Length of a bin in µs.
    pub const fn bin_us(&self) -> u64 {
        self.bin_us.get()
    }

    /// Events of no bin.
    pub const fn outside(&self) -> u64 {
        self.outside
    }

    /// All bins together.
    pub fn total(&self) -> Tally {
        self.bins().iter().fold(Tally::default(), |sum, bin| Tally {
            on: sum.on.wrapping_add(bin.on),
            off: sum.off.wrapping_add(bin.off),
        })
    }
}
