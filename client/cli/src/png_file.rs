//! Pictures as PNG files.

use crate::Failure;
use std::fs::File;
use std::io::BufWriter;
use std::path::Path;

/// Writes a picture, in place of one that is there: red, green and blue of each pixel, row by row.
pub fn write(path: &Path, (width, height): (u32, u32), pixels: &[u8]) -> Result<(), Failure> {
    let failed = |error: &dyn std::fmt::Display| Failure::general(format!("{}: {error}", path.display()));
    let file = File::create(path).map_err(|error| failed(&error))?;
    let mut encoder = png::Encoder::new(BufWriter::new(file), width, height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    let mut writer = encoder.write_header().map_err(|error| failed(&error))?;
    writer.write_image_data(pixels).map_err(|error| failed(&error))
}
