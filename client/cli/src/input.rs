//! Options of every subcommand that reads a recording: what its file does not say. Each is the library's of that name.

use lobula_core::Geometry;
use lobula_core::wire::Encoding;
use lobula_formats::{Columns, Error, OpenOptions, Recording, TimeUnit, open_with};
use std::path::Path;

/// What a file does not say, or says wrongly; to be flattened into the options of a subcommand.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct InputArgs {
    /// Columns and rows of the sensor, in place of what the file tells
    #[arg(long, value_name = "WxH", value_parser = geometry)]
    pub sensor_size: Option<Geometry>,
    /// What one unit of time is, where the file does not tell: s, ms, us or ns
    #[arg(long, value_name = "UNIT")]
    pub time_unit: Option<TimeUnit>,
    /// Which column is what, where the file does not tell, such as t,x,y,p
    #[arg(long, value_name = "ORDER")]
    pub columns: Option<Columns>,
    /// Which stream of events, where the file has several
    #[arg(long, value_name = "NAME")]
    pub topic: Option<String>,
    /// What to add to every time; no event may be before 0
    #[arg(long, value_name = "MICROSECONDS", default_value_t = 0, allow_negative_numbers = true)]
    pub time_shift: i64,
    /// How a camera's bytes are encoded, in place of what the file tells
    #[arg(long, value_name = "NAME", value_parser = encoding)]
    pub encoding: Option<Encoding>,
}

impl InputArgs {
    /// The library's options.
    pub fn options(&self) -> OpenOptions {
        let mut options = OpenOptions::default();
        options.sensor_size = self.sensor_size;
        options.time_unit = self.time_unit;
        options.columns = self.columns;
        options.topic = self.topic.clone();
        options.time_shift_us = self.time_shift;
        options.encoding = self.encoding;
        options
    }

    /// Opens a recording with them.
    ///
    /// # Errors
    /// As [`open_with`].
    pub fn open(&self, path: &Path) -> Result<Recording, Error> {
        open_with(path, &self.options())
    }
}

fn geometry(text: &str) -> Result<Geometry, String> {
    let sides = text.split_once('x').and_then(|(w, h)| Some((w.parse().ok()?, h.parse().ok()?)));
    match sides {
        Some((width, height)) if width > 0 && height > 0 => Ok(Geometry::new(width, height)),
        _ => Err("give columns and rows, such as 1280x720".into()),
    }
}

/// Reads the name of an encoding.
pub fn encoding(text: &str) -> Result<Encoding, String> {
    Encoding::from_name(text).ok_or_else(|| {
        let known: Vec<_> = Encoding::ALL.iter().map(|encoding| encoding.name()).collect();
        format!("give one of {}", known.join(", "))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[derive(Debug, Parser)]
    struct Alone {
        #[command(flatten)]
        input: InputArgs,
    }

    fn parsed(args: &[&str]) -> Option<OpenOptions> {
        let args = ["alone"].iter().chain(args);
        Alone::try_parse_from(args).ok().map(|alone| alone.input.options())
    }

    #[test]
    fn every_option_reaches_the_library() {
        let options = parsed(&[
            "--sensor-size=640x480",
            "--time-unit=ms",
            "--columns=x,y,p,t",
            "--topic=/left/events",
            "--time-shift=-7",
            "--encoding=evt2",
        ]);
        let options = options.unwrap();
        assert_eq!(options.sensor_size, Some(Geometry::new(640, 480)));
        assert_eq!(options.time_unit, Some(TimeUnit::Milliseconds));
        assert_eq!(options.columns, "x,y,p,t".parse().ok());
        assert_eq!(options.topic.as_deref(), Some("/left/events"));
        assert_eq!((options.time_shift_us, options.encoding), (-7, Some(Encoding::Evt2)));
        assert_eq!(parsed(&["--time-shift", "-7"]).unwrap().time_shift_us, -7);
        assert_eq!(parsed(&[]).unwrap().time_shift_us, 0);
    }

    #[test]
    fn what_is_none_of_them_is_refused() {
        for bad in
            ["--time-unit=h", "--columns=t,x,y", "--columns=t,t,x,y", "--encoding=evt9", "--time-shift=1.5"]
        {
            assert!(parsed(&[bad]).is_none(), "{bad}");
        }
        for bad in ["640", "0x1", "640x480x1", "-1x2", "70000x1"] {
            assert!(parsed(&[&format!("--sensor-size={bad}")]).is_none(), "{bad}");
        }
    }
}
