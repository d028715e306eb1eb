//! The raw picture beside the filtered one: in the terminal, two pixels a character, and as PNG.

use crate::{Failure, png_file};
use lobula_core::{Event, Geometry};
use std::path::Path;

/// Red, green, blue.
pub type Colour = [u8; 3];

const GROUND: Colour = [16, 17, 22];
const ON: Colour = [255, 150, 60];
const OFF: Colour = [70, 150, 255];

/// Events of a stretch of time, raw and filtered.
#[derive(Clone, Debug)]
pub struct Picture {
    /// As they left the camera.
    pub raw: Plane,
    /// As the client got them.
    pub filtered: Plane,
}

impl Picture {
    /// An empty one.
    pub fn new(geometry: Geometry) -> Self {
        Self { raw: Plane::new(geometry), filtered: Plane::new(geometry) }
    }

    /// Writes both planes side by side, a pixel each.
    pub fn save(&self, path: &Path) -> Result<(), Failure> {
        let Geometry { width, height } = self.raw.geometry;
        png_file::write(path, (2 * u32::from(width) + GAP_PX, height.into()), &self.pixels())
    }

    fn pixels(&self) -> Vec<u8> {
        let width = usize::from(self.raw.geometry.width).max(1);
        let rows = self.raw.marks.chunks_exact(width).zip(self.filtered.marks.chunks_exact(width));
        let gap = [60; 3 * GAP_PX as usize];
        let mut pixels = Vec::new();
        for (raw, filtered) in rows {
            pixels.extend(raw.iter().flat_map(|mark| mark.colour()));
            pixels.extend(gap);
            pixels.extend(filtered.iter().flat_map(|mark| mark.colour()));
        }
        pixels
    }
}

/// Between the two planes of a PNG.
const GAP_PX: u32 = 8;

/// What happened last at a pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Mark {
    #[default]
    Nothing,
    Off,
    On,
}

impl Mark {
    const fn colour(self) -> Colour {
        match self {
            Self::Nothing => GROUND,
            Self::Off => OFF,
            Self::On => ON,
        }
    }
}

/// One picture, a mark for each pixel of the sensor.
#[derive(Clone, Debug)]
pub struct Plane {
    geometry: Geometry,
    marks: Vec<Mark>,
}

impl Plane {
    fn new(geometry: Geometry) -> Self {
        Self { geometry, marks: vec![Mark::default(); geometry.pixels()] }
    }

    /// Marks an event's pixel.
    pub fn mark(&mut self, event: Event) {
        if let Some(mark) = self.marks.get_mut(self.geometry.index(event.x(), event.y())) {
            *mark = if event.is_on() { Mark::On } else { Mark::Off };
        }
    }

    /// The plane in `columns` by `rows` cells, row-major: brighter with more marks, and visible with one.
    pub fn cells(&self, columns: usize, rows: usize) -> Vec<Colour> {
        let (width, height) = (usize::from(self.geometry.width), usize::from(self.geometry.height));
        let mut counts = vec![[0_u32; 2]; columns * rows];
        for (y, row) in self.marks.chunks_exact(width.max(1)).enumerate() {
            let line = y * rows / height.max(1) * columns;
            for (x, mark) in row.iter().enumerate().filter(|(_, mark)| **mark != Mark::Nothing) {
                let cell = counts.get_mut(line + x * columns / width.max(1));
                if let Some(count) = cell.and_then(|cell| cell.get_mut(usize::from(*mark == Mark::On))) {
                    *count += 1;
                }
            }
        }
        // A thin edge through a cell marks about its side.
        let full = ((width / columns.max(1)) as f32 / 1.5).max(1.0);
        counts.iter().map(|[off, on]| shade(*off, *on, full)).collect()
    }
}

/// The colour of a cell with so many marks; `full` give full colour.
fn shade(off: u32, on: u32, full: f32) -> Colour {
    let strength = ((off + on) as f32 / full).min(1.0);
    let strength = if strength > 0.0 { 0.2 + 0.8 * strength } else { 0.0 };
    let on_share = on as f32 / ((off + on) as f32).max(1.0);
    std::array::from_fn(|i| {
        let event = OFF[i] as f32 * (1.0 - on_share) + ON[i] as f32 * on_share;
        (GROUND[i] as f32 * (1.0 - strength) + event * strength) as u8
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use lobula_core::Polarity;

    fn picture() -> Picture {
        let mut picture = Picture::new(Geometry::new(8, 4));
        picture.raw.mark(Event::new(0, 7, 3, Polarity::On));
        picture.raw.mark(Event::new(0, 0, 0, Polarity::Off));
        picture.raw.mark(Event::new(0, 9, 9, Polarity::Off));
        picture
    }

    #[test]
    fn cells_show_where_events_were() {
        let cells = picture().raw.cells(2, 2);
        assert_ne!(cells[0], GROUND);
        assert_eq!(cells[1..3], [GROUND, GROUND]);
        assert!(cells[3][0] > cells[3][2], "ON is warm: {:?}", cells[3]);
        assert!(cells[0][2] > cells[0][0], "OFF is cold: {:?}", cells[0]);
    }

    #[test]
    fn a_png_reads_back() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        picture().save(&path).unwrap();
        let file = std::io::BufReader::new(std::fs::File::open(path).unwrap());
        let mut reader = png::Decoder::new(file).read_info().unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        let frame = reader.next_frame(&mut pixels).unwrap();
        assert_eq!((frame.width, frame.height), (2 * 8 + GAP_PX, 4));
        assert_eq!(pixels[..3], OFF);
        let last_raw = 3 * (3 * frame.width as usize + 7);
        assert_eq!(pixels[last_raw..last_raw + 3], ON);
        assert_eq!(pixels[pixels.len() - 3..], GROUND);
    }
}
