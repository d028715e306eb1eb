//! Another resolution: pixels are put together, or spread.
//!
//! Rule: column x of W becomes floor(x w / W) of w, rows alike; no event is lost, and several pixels may share one. With
//! w = q W + r it is q x + floor(x r / W), and floor(x r / W) is (x m) >> 32 with m = ceil(2^32 r / W): m exceeds the true
//! ratio by less than 1, so that the product exceeds by less than x < 2^32 / W, too little to reach the next whole number.
//! Where W = w 2^k, it is a shift by k.

use super::pixels::{X_MAX, Y_MAX, at, move_all, x_of, y_of};
use super::{TransformError, sensor};
use crate::{Block, Geometry, Transform, Unfit};

/// Parameters of [`Resize`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(deny_unknown_fields))]
pub struct ResizeParams {
    /// Columns of the new sensor.
    pub width: u16,
    /// Rows of the new sensor, at most 32768.
    pub height: u16,
}

/// Parameters of [`Scale`].
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(deny_unknown_fields))]
pub struct ScaleParams {
    /// New columns for each old one.
    pub sx: f64,
    /// New rows for each old one.
    pub sy: f64,
}

/// Moves (x, y) to (floor(x w / W), floor(y h / H)) on a sensor of w x h.
///
/// ```
/// use lobula_core::{Block, Event, Geometry, Polarity, Transform, transform::{Resize, ResizeParams}};
/// let mut events = [Event::new(0, 639, 2, Polarity::On)];
/// let mut block = Block::new(0, 0, Geometry::new(640, 480), &mut events);
/// Resize::try_new(block.geometry, ResizeParams { width: 200, height: 240 })?.apply(&mut block)?;
/// assert_eq!((block.span().events[0].x(), block.span().events[0].y()), (199, 1));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct Resize {
    geometry: Geometry,
    output: Geometry,
    x: Ratio,
    y: Ratio,
}

impl Resize {
    /// A new resolution for a sensor's events.
    pub fn try_new(geometry: Geometry, params: ResizeParams) -> Result<Self, TransformError> {
        let output = sensor(params.width.into(), params.height.into())?;
        let x = Ratio::new(geometry.width, output.width);
        Ok(Self { geometry, output, x, y: Ratio::new(geometry.height, output.height) })
    }
}

impl Transform for Resize {
    fn output_geometry(&self) -> Geometry {
        self.output
    }

    fn apply(&mut self, block: &mut Block<'_>) -> Result<usize, Unfit> {
        let (rx, ry) = (self.x, self.y);
        if let (Some(dx), Some(dy)) = (rx.halvings(), ry.halvings()) {
            return Ok(move_all(
                block,
                self.geometry,
                self.output,
                #[inline(always)]
                move |word| at(word, x_of(word) >> dx, y_of(word) >> dy),
            )?);
        }
        Ok(move_all(
            block,
            self.geometry,
            self.output,
            #[inline(always)]
            move |word| at(word, rx.of(x_of(word), X_MAX), ry.of(y_of(word), Y_MAX)),
        )?)
    }
}

/// [`Resize`] to a sensor of round(W sx) x round(H sy).
///
/// ```
/// use lobula_core::{Geometry, Transform, transform::{Scale, ScaleParams}};
/// let scale = Scale::try_new(Geometry::new(640, 480), ScaleParams { sx: 0.5, sy: 0.1 })?;
/// assert_eq!(scale.output_geometry(), Geometry::new(320, 48));
/// # Ok::<(), lobula_core::transform::TransformError>(())
/// ```
#[derive(Clone, Debug)]
pub struct Scale(Resize);

impl Scale {
    /// A new resolution for a sensor's events.
    pub fn try_new(geometry: Geometry, params: ScaleParams) -> Result<Self, TransformError> {
        let side = |len: u16, factor: f64, key| {
            if factor.is_finite() {
                Ok(rounded(f64::from(len) * factor))
            } else {
                Err(TransformError::NotFinite { key })
            }
        };
        let output = sensor(side(geometry.width, params.sx, "sx")?, side(geometry.height, params.sy, "sy")?)?;
        let params = ResizeParams { width: output.width, height: output.height };
        Resize::try_new(geometry, params).map(Self)
    }
}

impl Transform for Scale {
    fn output_geometry(&self) -> Geometry {
        self.0.output_geometry()
    }

    fn apply(&mut self, block: &mut Block<'_>) -> Result<usize, Unfit> {
        self.0.apply(block)
    }
}

/// Rounded half away from zero; negative is 0, too large the largest.
fn rounded(value: f64) -> u32 {
    let whole = value as u32;
    whole.saturating_add((value - f64::from(whole) >= 0.5) as u32)
}

/// One side's new length over its old one.
#[derive(Clone, Copy, Debug)]
struct Ratio {
    whole: u32,
    /// 2^32 times the rest, rounded up.
    part: u32,
}

impl Ratio {
    fn new(from: u16, to: u16) -> Self {
        let (from, to) = (u32::from(from).max(1), u32::from(to));
        let part = (u64::from(to % from) << 32).div_ceil(u64::from(from));
        Self { whole: to / from, part: part as u32 }
    }

    /// How often the old length was halved, if that is all: division is then by a shift, several times as fast.
    fn halvings(self) -> Option<u32> {
        match (self.whole, self.part) {
            (1, 0) => Some(0),
            (0, part) if part.is_power_of_two() => Some(32 - part.trailing_zeros()),
            _ => None,
        }
    }

    /// At most `max`, which is off the sensor, for what was off it.
    #[inline(always)]
    fn of(self, place: u64, max: u64) -> u64 {
        let place = place & X_MAX;
        let new = place * u64::from(self.whole) + ((place * u64::from(self.part)) >> 32);
        if new < max { new } else { max }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ratio_is_the_floor_of_the_quotient() {
        for from in (1..=u16::MAX).step_by(997).chain([1, 2, 3, 640, 720, 1279, 1280, 65_534, 65_535]) {
            for to in (1..=u16::MAX).step_by(1999).chain([1, 2, 3, 640, 1280, 65_534, 65_535]) {
                let ratio = Ratio::new(from, to);
                let places = (0..from).step_by(1 + usize::from(from) / 50).chain([from - 1, from / 2]);
                for place in places.map(u64::from) {
                    assert_eq!(
                        ratio.of(place, X_MAX),
                        place * u64::from(to) / u64::from(from),
                        "{place} of {from}"
                    );
                    if let Some(halvings) = ratio.halvings() {
                        assert_eq!(place >> halvings, ratio.of(place, X_MAX), "{place} of {from}");
                    }
                }
                assert!(ratio.of(from.into(), X_MAX) >= to.into(), "off stays off");
            }
        }
    }

    #[test]
    fn halvings_are_told_from_other_ratios() {
        let halvings = |from, to| Ratio::new(from, to).halvings();
        assert_eq!([halvings(1280, 640), halvings(720, 720), halvings(48, 3)], [Some(1), Some(0), Some(4)]);
        for (from, to) in [(1280, 641), (3, 1), (640, 1280), (641, 320), (48, 9)] {
            assert_eq!(halvings(from, to), None, "{to} of {from}");
        }
    }
}
