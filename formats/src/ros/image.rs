//! `sensor_msgs/Image` and `sensor_msgs/CameraInfo`.
//!
//! Spec: <https://docs.ros.org/en/api/sensor_msgs/html/msg/Image.html> and
//! <https://docs.ros.org/en/api/sensor_msgs/html/msg/CameraInfo.html>
//!
//! ```text
//! Image       header, u32 height, u32 width, string encoding, bool is_bigendian, u32 step, u8[] data
//! CameraInfo  header, u32 height, u32 width, string distortion_model, f64[] D, f64[9] K, f64[9] R, f64[12] P, ...
//! ```

use super::fields::{Fields, Wire};
use crate::{Frame, PixelFormat};

/// The frame in a message of an image; `None` where it is damaged or of a pixel format that we do not read.
/// `time` makes its time of µs.
pub(crate) fn frame(message: &[u8], wire: Wire, time: impl Fn(i64) -> Option<u64>) -> Option<Frame> {
    let mut fields = Fields::new(message, wire)?;
    let t = time(fields.header()?.us())?;
    let (height, width) = (fields.u32()?, fields.u32()?);
    let (format, bits) = pixel_format(fields.string()?)?;
    let is_bigendian = fields.u8()? != 0;
    let step = fields.u32()? as usize;
    let len = fields.u32()? as usize;
    let data = fields.bytes(len)?;
    let (height, width) = (u16::try_from(height).ok()?, u16::try_from(width).ok()?);
    let row = usize::from(width) * format.bytes();
    if step < row || data.len() < step.checked_mul(height.into())? {
        return None;
    }
    let mut pixels = Vec::with_capacity(row * usize::from(height));
    for line in data.chunks_exact(step.max(1)).take(height.into()) {
        pixels.extend_from_slice(line.get(..row)?);
    }
    if bits == 16 && is_bigendian {
        pixels.as_chunks_mut::<2>().0.iter_mut().for_each(|pixel| pixel.reverse());
    }
    Some(Frame { t, exposure: None, x: 0, y: 0, width, height, format, pixels })
}

/// The layout of an encoding of this name, and the bits of a value.
fn pixel_format(encoding: &[u8]) -> Option<(PixelFormat, u8)> {
    match encoding {
        b"mono8" | b"8UC1" => Some((PixelFormat::Gray8, 8)),
        b"mono16" | b"16UC1" => Some((PixelFormat::Gray16, 16)),
        b"bgr8" | b"8UC3" => Some((PixelFormat::Bgr8, 8)),
        b"bgra8" | b"8UC4" => Some((PixelFormat::Bgra8, 8)),
        b"rgb8" => Some((PixelFormat::Rgb8, 8)),
        _ => None,
    }
}

/// The name of an encoding with this layout.
pub(crate) fn encoding(format: PixelFormat) -> &'static str {
    match format {
        PixelFormat::Gray8 => "mono8",
        PixelFormat::Gray16 => "mono16",
        PixelFormat::Bgr8 => "bgr8",
        PixelFormat::Bgra8 => "bgra8",
        PixelFormat::Rgb8 => "rgb8",
    }
}

/// What a camera's calibration says, as keys and values.
pub(crate) fn camera_info(message: &[u8], wire: Wire) -> Option<Vec<(String, String)>> {
    let mut fields = Fields::new(message, wire)?;
    fields.header()?;
    let (height, width) = (fields.u32()?, fields.u32()?);
    let model = String::from_utf8_lossy(fields.string()?).into_owned();
    let count = fields.u32()? as usize;
    // Each takes 8 bytes of the message, so a lie ends soon.
    let mut distortion = Vec::new();
    for _ in 0..count {
        distortion.push(fields.f64()?);
    }
    let (k, r, p) = (fields.f64s::<9>()?, fields.f64s::<9>()?, fields.f64s::<12>()?);
    let list = |values: &[f64]| values.iter().map(f64::to_string).collect::<Vec<_>>().join(" ");
    let told = [
        ("camera_info", format!("{width}x{height}")),
        ("distortion_model", model),
        ("D", list(&distortion)),
        ("K", list(&k)),
        ("R", list(&r)),
        ("P", list(&p)),
    ];
    Some(told.map(|(key, value)| (key.to_owned(), value)).to_vec())
}
