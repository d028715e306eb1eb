//! Many lines at once, where they are of the usual kind: the hot loop of text.
//!
//! In the next 32 bytes those that are no digits are found together; between them stand the numbers. So no number waits for
//! the one before it, as it does where a number must be read to know its end, and no branch depends on how long a
//! coordinate is. What is not of the usual kind is left to [`super::line`], which tells the same of every line that is
//! read here.

use super::layout::Layout;
use super::line::POWERS;
use crate::intake::Plain;
use lobula_core::vector::{outside, widest};

/// Lines that are read together.
pub(super) const LINES: usize = 256;
/// Longest line, with its end.
const LINE_BYTES_MAX: usize = 32;
/// A line, and what is read beyond it with its last number.
const CHUNK_BYTES: usize = LINE_BYTES_MAX + 8;
/// Digits that any number of 63 bits may have.
const DIGITS_MAX: usize = 18;

/// Lines of the usual kind.
#[derive(Debug)]
pub(super) struct Batch {
    pub events: [Plain; LINES],
    pub len: usize,
    /// How long they are together, with their ends.
    pub bytes: usize,
}

/// What the lines have in common.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Shape {
    /// Which fields, counted from 0, are t, x, y and p.
    places: [usize; 4],
    /// Times have a fraction.
    fraction: bool,
    /// Lines end with a carriage return and a line feed.
    returns: bool,
    separator: u8,
    /// By which power of ten times become µs.
    power: usize,
}

impl Shape {
    const TXYP: [usize; 4] = [0, 1, 2, 3];

    /// That of the line at the start of a text.
    fn of(text: &[u8], layout: &Layout) -> Option<Self> {
        let power = usize::try_from(layout.power).ok().filter(|_| layout.fields == 4)?;
        let line = text.get(..LINE_BYTES_MAX)?.split(|byte| *byte == b'\n').next()?;
        let mut marks = line.iter().filter(|byte| !byte.is_ascii_digit());
        let separator = *marks.find(|byte| **byte != b'.')?;
        let (fraction, returns) = (line.contains(&b'.'), line.ends_with(b"\r"));
        let shape = Self { places: layout.places, fraction, returns, separator, power };
        layout.separator.is(separator).then_some(shape)
    }
}

impl Batch {
    /// Reads lines from the start of `text`, at most `lines_max`: each of four numbers with one separator between them, a
    /// fraction only in the time and no finer than a µs, x and y below 10000, p of one digit.
    pub fn read(text: &[u8], layout: &Layout, lines_max: usize) -> Self {
        let mut batch = Self { events: [Plain { t_us: 0, pixel: 0 }; LINES], len: 0, bytes: 0 };
        if let Some(shape) = Shape::of(text, layout) {
            widest(
                #[inline(always)]
                || batch.fill(text, shape, lines_max),
            );
        }
        batch
    }

    /// The shapes that are written most are constants to the compiler.
    #[inline(always)]
    fn fill(&mut self, text: &[u8], shape: Shape, lines_max: usize) {
        let Shape { places, fraction, returns, .. } = shape;
        match (places, fraction, returns) {
            (Shape::TXYP, true, false) => {
                let shape = Shape { places: Shape::TXYP, fraction: true, returns: false, ..shape };
                self.fill_all(text, shape, lines_max);
            }
            (Shape::TXYP, false, false) => {
                let shape = Shape { places: Shape::TXYP, fraction: false, returns: false, ..shape };
                self.fill_all(text, shape, lines_max);
            }
            _ => self.fill_all(text, shape, lines_max),
        }
    }

    #[inline(always)]
    fn fill_all(&mut self, text: &[u8], shape: Shape, lines_max: usize) {
        let mut rest = text;
        for event in self.events.iter_mut().take(lines_max) {
            let Some(chunk) = rest.first_chunk() else { break };
            let Some((line, end)) = shape.line(chunk) else { break };
            *event = line;
            self.len += 1;
            rest = rest.get(end..).unwrap_or_default();
        }
        self.bytes = text.len() - rest.len();
    }
}

impl Shape {
    /// The line at the start of a chunk, and its length.
    #[inline(always)]
    fn line(self, chunk: &[u8; CHUNK_BYTES]) -> Option<(Plain, usize)> {
        let [t, x, y, p] = self.places;
        let mut marks = outside(chunk.first_chunk()?, b'0', b'9');
        let mut mark = || {
            let at = marks.trailing_zeros() as usize;
            marks &= marks.wrapping_sub(1);
            at
        };
        let is_not = |at: usize, byte: u8| chunk.get(at).map_or(1, |found| found ^ byte);
        let (mut starts, mut ends, mut wrong) = ([0; 4], [0; 4], 0);
        let (mut at, mut point) = (0, 0);
        for i in 0..4 {
            if self.fraction && i == t {
                point = mark();
                wrong |= is_not(point, b'.');
            }
            let end = mark();
            wrong |= is_not(
                end,
                if i < 3 {
                    self.separator
                } else if self.returns {
                    b'\r'
                } else {
                    b'\n'
                },
            );
            (starts[i], ends[i], at) = (at, end, end + 1);
        }
        if self.returns {
            wrong |= is_not(at, b'\n');
            at += 1;
        }
        // Beyond the last mark all are at the same place.
        if wrong != 0 || at > LINE_BYTES_MAX {
            return None;
        }
        let field = |i: usize| starts.get(i).copied().zip(ends.get(i).copied());
        let ((t, t_end), (x, x_end), (y, y_end), (p, p_end)) = (field(t)?, field(x)?, field(y)?, field(p)?);
        let (x_digits, y_digits) = (x_end - x, y_end - y);
        let is_short = (x_digits.wrapping_sub(1) | y_digits.wrapping_sub(1)) < 4;
        if !is_short || p_end - p != 1 {
            return None;
        }
        let pixel = two(chunk, [(x, x_digits), (y, y_digits)])?;
        let p = u64::from(*chunk.get(p)? ^ b'0');
        let whole_end = if self.fraction { point } else { t_end };
        let mut t_us = long(chunk, t, whole_end - t, self.power)?;
        if self.fraction {
            let digits = t_end - point - 1;
            t_us += number(chunk, point + 1, digits)? * *POWERS.get(self.power.checked_sub(digits)?)?;
        }
        Some((Plain::of(t_us, pixel | p << 32), at))
    }
}

/// A number of so many digits, 1 to 16, times a power of ten.
#[inline(always)]
fn long(chunk: &[u8; CHUNK_BYTES], at: usize, digits: usize, power: usize) -> Option<u64> {
    if digits + power > DIGITS_MAX {
        return None;
    }
    let whole = match digits.checked_sub(8) {
        None | Some(0) => number(chunk, at, digits)?,
        Some(high) => number(chunk, at, high)? * POWERS[8] + number(chunk, at + high, 8)?,
    };
    Some(whole * POWERS.get(power)?)
}

/// A number of so many digits, 1 to 8.
#[inline(always)]
fn number(chunk: &[u8; CHUNK_BYTES], at: usize, digits: usize) -> Option<u64> {
    if digits.wrapping_sub(1) >= 8 {
        return None;
    }
    let word = u64::from_le_bytes(*chunk.get(at..)?.first_chunk()?);
    // Zeros in front, then pairs, fours and all of it: the first digit is in the lowest byte.
    let fours = fours((word << (64 - 8 * digits)) & DIGITS);
    Some((fours.wrapping_mul(10_000).wrapping_add(fours >> 32)) & 0xFFFF_FFFF)
}

/// Two numbers of 1 to 4 digits: the first in bits 0 to 15, the second in bits 16 to 31.
#[inline(always)]
fn two(chunk: &[u8; CHUNK_BYTES], places: [(usize, usize); 2]) -> Option<u64> {
    let mut words = [0; 2];
    for (word, (at, digits)) in words.iter_mut().zip(places) {
        let bytes = u32::from_le_bytes(*chunk.get(at..)?.first_chunk()?);
        *word = u64::from(bytes << ((32 - 8 * digits as u32) & 31));
    }
    let fours = fours((words[0] | words[1] << 32) & DIGITS);
    Some((fours | fours >> 16) & 0xFFFF_FFFF)
}

/// The value of a digit in each byte.
const DIGITS: u64 = 0x0F0F_0F0F_0F0F_0F0F;

/// Eight digits become two numbers of four.
#[inline(always)]
fn fours(digits: u64) -> u64 {
    let pairs = (digits.wrapping_mul(10).wrapping_add(digits >> 8)) & 0x00FF_00FF_00FF_00FF;
    (pairs.wrapping_mul(100).wrapping_add(pairs >> 16)) & 0x0000_FFFF_0000_FFFF
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::text::line::{self, Line, Separator};

    /// Every line that is read here is read so by the exact reader; how many are.
    fn check(text: &str, places: [usize; 4], power: i32) -> usize {
        let separator = Separator::of(text.as_bytes());
        let layout = Layout { separator, fields: 4, places, power };
        let batch = Batch::read(text.as_bytes(), &layout, LINES);
        let mut lines = text.split_inclusive('\n');
        let mut bytes = 0;
        for event in &batch.events[..batch.len] {
            let text = lines.next().unwrap();
            let Line::Event { t_us, x, y, on } = line::parse(text.as_bytes(), &layout) else {
                // It is refused where all are put in: p is no polarity.
                assert!(event.pixel as u32 > 1, "{text}");
                continue;
            };
            assert_eq!(event.t_us as i64, t_us, "{text}");
            let told = Plain::of(t_us as u64, x as u64 | (y as u64) << 16 | u64::from(on) << 32);
            assert_eq!(event.pixel, told.pixel, "{text}");
            bytes += text.len();
        }
        assert_eq!(batch.bytes, bytes);
        batch.len
    }

    #[test]
    fn lines_read_as_one_by_one() {
        const ENOUGH: &str = "7 7 7 7 7 7 7 7 7 7 7 7 7 7 7 7 7 7 7 7 7 7";
        let txyp = |text: &str, power| check(&format!("{text}{ENOUGH}"), [0, 1, 2, 3], power);
        assert_eq!(txyp("1,2,3,1\n12345678901,1279,719,0\n123456789012345,9999,10,1\n", 0), 3);
        assert_eq!(txyp("0.5 1 2 1\n1744227144.732712 3 4 0\n12.25 1 2 1\n", 6), 3);
        assert_eq!(txyp("5;1;2;1\r\n6;1;2;0\r\n", 3), 2);
        assert_eq!(check(&format!("1,2,1,99\n1279,719,0,12345678\n{ENOUGH}"), [3, 0, 1, 2], 0), 2);
        assert_eq!(check(&format!("1,2,99.125,1\n1279,719,7.5,0\n{ENOUGH}"), [2, 0, 1, 3], 3), 2);
        for other in [
            "1,2,3\n",
            "1,2,3,4,5\n",
            "1,,3,1\n",
            ",2,3,1\n",
            "1,2,3,\n",
            "1,2,3,-1\n",
            "-1,2,3,1\n",
            "1,2,3,10\n",
            "1.,2,3,1\n",
            ".5,2,3,1\n",
            "1,20000,3,1\n",
            "1,2,3,1 \n",
            "1, 2,3,1\n",
            "# 1\n",
            "\n",
            "1,2,3,1\r\r\n",
            "12345678901234567,1,2,1\n",
            "1,2,3,1;",
            "1;2,3,1\n",
            "0.1234567,1,2,1\n",
            "1234567890123.5,1,2,1\n",
        ] {
            assert_eq!(txyp(other, 6), 0, "{other:?}");
            assert_eq!(txyp(&format!("1,2,3,1\n{other}"), 6), 1, "{other:?}");
        }
    }
}
