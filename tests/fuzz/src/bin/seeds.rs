//! `seeds FOLDER EXTENSION`: writes small files to begin with, where we write that format.

#[path = "../../../../formats/tests/hostile/ecf.rs"]
mod ecf;

use lobula_core::{Event, Geometry, Polarity, Span, wire::Encoding};
use lobula_formats::{Compression, Error, WriteOptions, Writer};
use std::path::Path;

fn main() {
    let args: Vec<_> = std::env::args().skip(1).collect();
    let [folder, extension] = &args[..] else { panic!("usage: seeds FOLDER EXTENSION") };
    if extension == "h5" {
        for mode in [ecf::Mode::Runs, ecf::Mode::ColumnsPacked, ecf::Mode::AllPacked] {
            let seed = Path::new(folder).join(format!("ecf-{}.h5", mode as u8));
            if let Err(error) = std::fs::write(&seed, ecf::small(mode)) {
                panic!("{}: {error}", seed.display());
            }
        }
    }
    for (i, encoding) in Encoding::ALL.iter().enumerate() {
        for (k, compression) in Compression::ALL.iter().map(Some).chain([None]).enumerate() {
            let mut options = WriteOptions::default();
            (options.encoding, options.compression, options.overwrite) =
                (Some(*encoding), compression.copied(), true);
            // Not every format knows every option.
            let _ = write(&Path::new(folder).join(format!("{i}-{k}.{extension}")), &options);
        }
    }
}

fn write(path: &Path, options: &WriteOptions) -> Result<(), Error> {
    let geometry = Geometry::new(320, 240);
    let mut writer = Writer::create(path, Some(geometry), options)?;
    for i in 0..40u64 {
        let t = 1000 + i * i;
        let events =
            [0, 1, 5].map(|x| Event::new(t as u32, x + i as u16, i as u16, Polarity::from_bit(i as u16)));
        writer.write(Span { t_first: t, t_last: t, geometry, events: &events })?;
    }
    writer.finish().map(|_| ())
}
