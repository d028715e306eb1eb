//! How far a tensor's values go: its greatest magnitude, or the one that most stay below.

use crate::tensor::Element;
use crate::vector::widest;

/// Scratch memory of [`percentile`]: 8 KiB, whatever it holds.
pub type Histogram = [u32; BUCKETS];

const BUCKETS: usize = 1 << 11;

/// Bits of a magnitude from which it is no number: infinite or NaN.
const INFINITE: u32 = 0x7F80_0000;

/// The greatest magnitude of a tensor; 0 when it has none. What is not finite is left out.
pub fn maximum<E: Element>(tensor: &[E]) -> f32 {
    let most = widest(
        #[inline(always)]
        || {
            let finite = |bits: u32| if bits < INFINITE { bits } else { 0 };
            tensor.iter().fold(0, |most, element| finite(magnitude(*element)).max(most))
        },
    );
    f32::from_bits(most)
}

/// The magnitude that `percent` percent of the elements that are not 0 stay below, at most 100: numpy's `percentile`
/// with linear interpolation, of `abs(t[t != 0])`. 0 when all are. What is not finite is left out.
///
/// Exact, and without a sort: the two neighbouring magnitudes are found digit by digit, in four passes.
///
/// ```
/// use lobula_core::tensor::percentile;
/// let mut scratch = [0; 2048];
/// assert_eq!(percentile(&[0u8, 0, 4, 0, 1, 2, 3, 5], 75.0, &mut scratch), 4.0);
/// assert_eq!(percentile(&[-2.0, 0.0, 1.0f32], 50.0, &mut scratch), 1.5);
/// ```
pub fn percentile<E: Element>(tensor: &[E], percent: f32, scratch: &mut Histogram) -> f32 {
    let all = Digits { shift: 20, bits: 11, prefix: None };
    let n = all.count(tensor, scratch);
    let Some(last) = n.checked_sub(1) else { return 0.0 };
    let rank = f64::from(percent.clamp(0.0, 100.0)) / 100.0 * last as f64;
    let below = rank as u64;
    let share = (rank - below as f64) as f32;

    let (high, left) = find(scratch, below);
    let middle = Digits { shift: 10, bits: 10, prefix: Some(high) };
    middle.count(tensor, scratch);
    let (digit, left) = find(scratch, left);
    let prefix = high << 10 | digit;
    let low = Digits { shift: 0, bits: 10, prefix: Some(prefix) };
    low.count(tensor, scratch);
    let (digit, left) = find(scratch, left);
    let lower = prefix << 10 | digit;

    let same = scratch.get(digit as usize).is_some_and(|count| left + 1 < u64::from(*count));
    let upper = if same || below == last { lower } else { next_above(tensor, lower) };
    let (lower, upper) = (f32::from_bits(lower), f32::from_bits(upper));
    lower + (upper - lower) * share
}

/// An element's distance from 0, as bits that sort as the magnitudes do.
#[inline(always)]
fn magnitude<E: Element>(element: E) -> u32 {
    element.real().to_bits() & 0x7FFF_FFFF
}

/// A digit of the magnitudes, of those that begin with `prefix`.
struct Digits {
    shift: u32,
    bits: u32,
    prefix: Option<u32>,
}

impl Digits {
    /// Counts how often each digit is there, and how many magnitudes there are.
    fn count<E: Element>(&self, tensor: &[E], histogram: &mut Histogram) -> u64 {
        histogram.fill(0);
        let mut n = 0;
        for bits in tensor.iter().map(|element| magnitude(*element)) {
            let of_prefix = self.prefix.is_none_or(|prefix| bits >> (self.shift + self.bits) == prefix);
            if bits == 0 || bits >= INFINITE || !of_prefix {
                continue;
            }
            n += 1;
            let digit = (bits >> self.shift) & ((1 << self.bits) - 1);
            if let Some(count) = histogram.get_mut(digit as usize) {
                *count = count.saturating_add(1);
            }
        }
        n
    }
}

/// The digit that the magnitude of this rank has, and its rank among those that have it too.
fn find(histogram: &Histogram, rank: u64) -> (u32, u64) {
    let mut left = rank;
    for (digit, count) in histogram.iter().enumerate() {
        match left.checked_sub((*count).into()) {
            Some(rest) => left = rest,
            None => return (digit as u32, left),
        }
    }
    (0, 0)
}

/// The least magnitude above `lower`.
fn next_above<E: Element>(tensor: &[E], lower: u32) -> u32 {
    let above = |bits: &u32| *bits > lower && *bits < INFINITE;
    tensor.iter().map(|element| magnitude(*element)).filter(above).min().unwrap_or(lower)
}
