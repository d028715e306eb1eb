//! The size of a sensor.

/// Width and height of a sensor in pixels; the origin is top left, x to the right, y down.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Geometry {
    /// Columns.
    pub width: u16,
    /// Rows; at most 32768, since an event keeps 15 bits of y.
    pub height: u16,
}

impl Geometry {
    /// A sensor of `width` columns and `height` rows.
    pub const fn new(width: u16, height: u16) -> Self {
        Self { width, height }
    }

    /// Number of pixels.
    #[inline]
    pub const fn pixels(self) -> usize {
        self.width as usize * self.height as usize
    }

    /// Whether (x, y) is on the sensor.
    #[inline]
    pub const fn contains(self, x: u16, y: u16) -> bool {
        x < self.width && y < self.height
    }

    /// Row-major index of (x, y). Beyond the map for a pixel off the sensor's height, so look up with `get`.
    #[inline]
    pub const fn index(self, x: u16, y: u16) -> usize {
        y as usize * self.width as usize + x as usize
    }

    /// Whether events of a `found` sensor may be given to a stage made for this one.
    #[inline]
    pub const fn check(self, found: Self) -> Result<(), WrongGeometry> {
        if self.width == found.width && self.height == found.height {
            Ok(())
        } else {
            Err(WrongGeometry { expected: self, found })
        }
    }
}

impl core::fmt::Display for Geometry {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "{}x{}", self.width, self.height)
    }
}

/// A stage was given events of a sensor it was not made for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WrongGeometry {
    /// What the stage was made for.
    pub expected: Geometry,
    /// What came.
    pub found: Geometry,
}

impl core::fmt::Display for WrongGeometry {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(
            f,
            "stage made for a {} sensor was given events of a {} one: make it for the right size",
            self.expected, self.found
        )
    }
}

impl core::error::Error for WrongGeometry {}
