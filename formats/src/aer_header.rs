//! The text at the start of AEDAT 2 and 3 files: lines that begin with `#`.
//!
//! Spec: <https://docs.inivation.com/software/software-advanced-usage/file-formats/index.html>
//!
//! Nothing tells how long it is: it ends after the line that says so, else before the first line that does not begin
//! with `#` or is no text. jAER puts all its preferences there, so that it may be long; of it only lines with a key are
//! kept.

use crate::input::Input;
use crate::{Error, ErrorKind, Limits};

/// Bytes read at once, and the longest line.
const READ_BYTES: usize = 64 << 10;

/// The lines of a header that say something, as key and value.
#[derive(Clone, Debug, Default)]
pub(crate) struct AerHeader {
    fields: Vec<(String, String)>,
    /// Bytes before the first record.
    pub bytes: u64,
    /// Whether there was a line that says that it ends.
    pub has_end: bool,
}

impl AerHeader {
    pub fn read(input: &Input, limits: &Limits) -> Result<Self, Error> {
        let mut header = Self::default();
        let mut room = limits.header_bytes_max;
        let left = usize::try_from(input.len()).unwrap_or(usize::MAX);
        let mut buffer = vec![0; READ_BYTES.min(left)];
        while !header.has_end {
            let len = input.read_at(header.bytes, &mut buffer)?;
            let before = header.bytes;
            header.lines(&buffer[..len], &mut room);
            if header.bytes == before {
                // Where text goes on until the end of the file, the end of the header is not there.
                let is_cut = header.bytes + len as u64 == input.len() && is_header_line(&buffer[..len]);
                return if is_cut { Err(cut(input)) } else { Ok(header) };
            }
        }
        Ok(header)
    }

    /// Takes the whole lines of these bytes, up to the end of the header.
    fn lines(&mut self, mut bytes: &[u8], room: &mut usize) {
        while let Some(end) = bytes.iter().position(|byte| *byte == b'\n') {
            let (line, rest) = (&bytes[..end], &bytes[end + 1..]);
            if !is_header_line(line) {
                return;
            }
            self.bytes += line.len() as u64 + 1;
            self.line(&String::from_utf8_lossy(line), room);
            if self.has_end {
                return;
            }
            bytes = rest;
        }
    }

    fn line(&mut self, line: &str, room: &mut usize) {
        let text = line.trim_start_matches(['#', '!']).trim();
        let lower = text.to_ascii_lowercase();
        self.has_end = lower == "end-header" || lower == "end of ascii header";
        if let Some((key, value)) = text.split_once(": ")
            && !key.contains('<')
            && let Some(left) = room.checked_sub(text.len())
        {
            *room = left;
            self.fields.push((key.trim().to_owned(), value.trim().to_owned()));
        }
    }

    /// Keys and values, in file order.
    pub fn fields(&self) -> impl Iterator<Item = (&str, &str)> {
        self.fields.iter().map(|(key, value)| (key.as_str(), value.as_str()))
    }

    /// The value of a key.
    pub fn get(&self, key: &str) -> Option<&str> {
        self.fields().find(|(one, _)| one.eq_ignore_ascii_case(key)).map(|(_, value)| value)
    }
}

fn cut(input: &Input) -> Error {
    let remedy = "copy it again from where it was recorded";
    Error::new(ErrorKind::Malformed, input.path(), "ends inside its header", remedy).at(input.len())
}

/// Whether it begins with `#` and is text: records may begin with that byte too.
fn is_header_line(line: &[u8]) -> bool {
    line.first() == Some(&b'#') && line.iter().all(|byte| *byte >= b' ' || matches!(byte, b'\t' | b'\r'))
}
