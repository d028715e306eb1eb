//! Hot pixels of a camera, learned over a whole recording and kept in a text file: one `x,y` a line, below a header.
//!
//! ```text
//! # lobula hot pixels
//! # serial 00000307
//! # sensor 1280x720
//! # sigmas 3
//! 17,4
//! 640,359
//! ```
//!
//! `sensor` must be there, so that a list is never used for another sensor; `serial` where the recording told it. Other
//! lines with `#`, and empty ones, mean nothing. The rule is that of [`HotPixelLearner`].

use crate::output::Output;
use crate::{Error, ErrorKind, Recording};
use lobula_core::Geometry;
use lobula_core::chain::Spec;
use lobula_core::filter::{HotPixelFilter, HotPixelLearner, PixelMask};
use std::path::Path;

/// The longest file that is read, in bytes: more pixels than any sensor has would fit.
const BYTES_MAX: u64 = 64 << 20;

/// The hot pixels of a camera.
///
/// ```no_run
/// use lobula_formats::HotPixels;
/// let recording = lobula_formats::open("quiet.raw")?;
/// let learned = HotPixels::learn(&recording, 3.0, |_| {})?;
/// println!("{} pixels made {} of {} events", learned.hot.pixels.len(), learned.removed, learned.events);
/// learned.hot.save("front.txt", false)?;
/// let filter = HotPixels::load("front.txt")?.filter();
/// # Ok::<(), lobula_formats::Error>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct HotPixels {
    /// The camera's serial number, if it is known.
    pub serial: Option<String>,
    /// Its sensor's size.
    pub geometry: Geometry,
    /// How many standard deviations above the mean a pixel's count was, at least; if it is known.
    pub sigmas: Option<f32>,
    /// The pixels as (x, y), in the order of the file; those learned are in that of the sensor, row by row.
    pub pixels: Vec<(u16, u16)>,
}

/// What was learned of a recording.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct LearnedHotPixels {
    /// The hot pixels.
    pub hot: HotPixels,
    /// Events of the recording.
    pub events: u64,
    /// Those of hot pixels.
    pub removed: u64,
}

impl HotPixels {
    /// Learns from all events of a recording: a pixel is hot if it has more events than the mean and `sigmas` standard
    /// deviations of the pixels that have any. Tells `progress` the position reached, after each block.
    ///
    /// # Errors
    /// Those of reading; where the size of the sensor is unknown; `sigmas` that are below 0 or no number.
    pub fn learn(
        recording: &Recording,
        sigmas: f32,
        mut progress: impl FnMut(u64),
    ) -> Result<LearnedHotPixels, Error> {
        let refused = |what: String| {
            Error::new(ErrorKind::Refused, recording.path(), what, "give a number of sigmas such as 3")
        };
        let geometry = recording.sensor_size()?;
        let counters = vec![0; HotPixelLearner::<()>::required_len(geometry)];
        let mut learner =
            HotPixelLearner::try_new(geometry, counters).map_err(|error| refused(error.to_string()))?;
        let (mut blocks, mut events) = (recording.blocks(), 0);
        while let Some(chunk) = blocks.next_block()? {
            events += chunk.span().events.len() as u64;
            learner.learn(chunk.span()).map_err(|error| refused(error.to_string()))?;
            progress(blocks.position());
        }
        let words = vec![0; PixelMask::<()>::required_len(geometry)];
        let mask = learner.mask(sigmas, words).map_err(|error| refused(error.to_string()))?;
        let pixels: Vec<_> = mask.iter().collect();
        let count = |&(x, y): &(u16, u16)| learner.counts().get(geometry.index(x, y)).copied().unwrap_or(0);
        let removed = pixels.iter().map(count).map(u64::from).sum();
        let serial = serial(recording).map(str::to_owned);
        Ok(LearnedHotPixels { hot: Self { serial, geometry, sigmas: Some(sigmas), pixels }, events, removed })
    }

    /// Reads a file.
    ///
    /// # Errors
    /// Where it cannot be read, and with the number of the line where one is wrong.
    pub fn load(path: impl AsRef<Path>) -> Result<Self, Error> {
        let path = path.as_ref();
        let io = |source| Error::io(path, "reading it", source);
        let bytes = std::fs::metadata(path).map_err(io)?.len();
        if bytes > BYTES_MAX {
            let what = format!("is no list of hot pixels: it has {bytes} bytes");
            return Err(Error::new(
                ErrorKind::TooLarge,
                path,
                what,
                "give a file that `lobula hot-pixels` wrote",
            ));
        }
        let text = std::fs::read_to_string(path).map_err(io)?;
        Self::parse(&text).map_err(|Wrong { line, what, remedy }| {
            Error::new(ErrorKind::Malformed, path, format!("line {line} {what}"), remedy)
        })
    }

    /// Loads the files of hot pixels that the settings of filters name, from `folder` on.
    ///
    /// # Errors
    /// As [`load`](Self::load).
    pub fn load_lists(settings: &mut Spec, folder: &Path) -> Result<(), Error> {
        for list in settings.stages.iter_mut().filter_map(|stage| stage.hot_pixels_mut()) {
            let Some(file) = list.file.take() else { continue };
            let hot = Self::load(folder.join(file))?;
            list.pixels.extend(&hot.pixels);
            *list.sensor = Some((hot.geometry.width, hot.geometry.height));
        }
        Ok(())
    }

    /// Writes a file, whole or not at all.
    ///
    /// # Errors
    /// Where it is there already and `overwrite` is not set, or cannot be written.
    pub fn save(&self, path: impl AsRef<Path>, overwrite: bool) -> Result<(), Error> {
        let mut output = Output::create(path.as_ref(), overwrite)?;
        output.write(self.text().as_bytes())?;
        output.finish().map(|_| ())
    }

    /// Refuses to be used for another camera: with another size, or, where both are known, another serial number.
    /// `path` is that of this list, for the message.
    ///
    /// # Errors
    /// What differs.
    pub fn check(&self, path: &Path, recording: &Recording) -> Result<(), Error> {
        let remedy = "learn the hot pixels of this camera with `lobula hot-pixels`";
        let other = |what: String| Err(Error::new(ErrorKind::Refused, path, what, remedy));
        let geometry = recording.sensor_size()?;
        if geometry != self.geometry {
            return other(format!("is for a {} sensor, the recording is of a {geometry} one", self.geometry));
        }
        match (&self.serial, serial(recording)) {
            (Some(own), Some(found)) if own != found => {
                other(format!("is for camera {own}, the recording is of camera {found}"))
            }
            _ => Ok(()),
        }
    }

    /// A filter that drops the events of these pixels.
    ///
    /// # Panics
    /// Never: the mask has the memory that it needs.
    pub fn filter(&self) -> HotPixelFilter<Vec<u32>> {
        let words = vec![0; PixelMask::<()>::required_len(self.geometry)];
        #[allow(clippy::expect_used)] // its length is right by construction
        let mut filter =
            HotPixelFilter::new(PixelMask::empty(self.geometry, words).expect("memory of the needed length"));
        for (x, y) in &self.pixels {
            filter.mask(*x, *y);
        }
        filter
    }

    fn text(&self) -> String {
        let mut text = String::from("# lobula hot pixels\n");
        let mut fact = |name: &str, value: String| text.push_str(&format!("# {name} {value}\n"));
        if let Some(serial) = &self.serial {
            fact("serial", serial.clone());
        }
        fact("sensor", self.geometry.to_string());
        if let Some(sigmas) = self.sigmas {
            fact("sigmas", sigmas.to_string());
        }
        self.pixels.iter().for_each(|(x, y)| text.push_str(&format!("{x},{y}\n")));
        text
    }

    fn parse(text: &str) -> Result<Self, Wrong> {
        let (mut serial, mut geometry, mut sigmas) = (None, None, None);
        let mut pixels = Vec::new();
        for (number, line) in (1..).zip(text.lines()) {
            let wrong = |what: String, remedy| Wrong { line: number, what, remedy };
            let line = line.trim();
            if let Some(comment) = line.strip_prefix('#') {
                match comment.trim().split_once(' ') {
                    Some(("serial", value)) => serial = Some(value.trim().to_owned()),
                    Some(("sigmas", value)) => sigmas = value.trim().parse().ok(),
                    Some(("sensor", value)) => {
                        let remedy = "write it as in `# sensor 1280x720`";
                        let what = || format!("tells no size of a sensor: {}", value.trim());
                        geometry = Some(size(value.trim()).ok_or_else(|| wrong(what(), remedy))?);
                    }
                    _ => {}
                }
            } else if !line.is_empty() {
                let remedy = "write a column and a row, as in `640,359`";
                pixels.push((
                    number,
                    pair(line, ',').ok_or_else(|| wrong(format!("is no pixel: {line}"), remedy))?,
                ));
            }
        }
        let remedy = "add the line `# sensor WxH`";
        let geometry = geometry.ok_or_else(|| Wrong {
            line: 1,
            what: "and no other tells the sensor's size".into(),
            remedy,
        })?;
        let off = pixels.iter().find(|(_, (x, y))| !geometry.contains(*x, *y));
        if let Some((line, (x, y))) = off {
            let what = format!("is off the {geometry} sensor: {x},{y}");
            return Err(Wrong {
                line: *line,
                what,
                remedy: "give the list of this camera, or correct its size",
            });
        }
        let pixels = pixels.into_iter().map(|(_, pixel)| pixel).collect();
        Ok(Self { serial, geometry, sigmas, pixels })
    }
}

/// What is wrong with a line, counted from 1.
struct Wrong {
    line: usize,
    what: String,
    remedy: &'static str,
}

/// The serial number that the recording's header tells.
fn serial(recording: &Recording) -> Option<&str> {
    let named = |(key, _): &(&str, &str)| matches!(*key, "serial_number" | "serial");
    recording.fields().into_iter().find(named).map(|(_, value)| value)
}

fn pair(text: &str, between: char) -> Option<(u16, u16)> {
    let (first, second) = text.split_once(between)?;
    Some((first.trim().parse().ok()?, second.trim().parse().ok()?))
}

fn size(text: &str) -> Option<Geometry> {
    let (width, height) = pair(text, 'x')?;
    (width > 0 && height > 0).then_some(Geometry::new(width, height))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_of_another_hand_is_read() {
        let hot =
            HotPixels::parse("# made by hand\n\n#serial  A 7 \n# sensor 4x3\n 1 , 2 \n3,0\n").ok().unwrap();
        let expected = HotPixels {
            serial: Some("A 7".into()),
            geometry: Geometry::new(4, 3),
            sigmas: None,
            pixels: vec![(1, 2), (3, 0)],
        };
        assert_eq!(hot, expected);
        assert_eq!(HotPixels::parse(&hot.text()).ok(), Some(hot));
    }

    #[test]
    fn what_is_wrong_is_told_with_its_line() {
        let wrong = |text: &str| HotPixels::parse(text).err().map(|wrong| (wrong.line, wrong.what)).unwrap();
        assert_eq!(wrong("1,2\n"), (1, "and no other tells the sensor's size".into()));
        assert_eq!(wrong("# sensor 4x3\n1;2\n"), (2, "is no pixel: 1;2".into()));
        assert_eq!(wrong("# sensor 4x3\n1,2\n1,-2\n"), (3, "is no pixel: 1,-2".into()));
        assert_eq!(wrong("# sensor 4by3\n"), (1, "tells no size of a sensor: 4by3".into()));
        assert_eq!(wrong("\n4,0\n# sensor 4x3\n"), (2, "is off the 4x3 sensor: 4,0".into()));
    }
}
