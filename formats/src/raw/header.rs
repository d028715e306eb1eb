//! The text at the start of a Prophesee RAW file: lines of `% key value` until `% end` or the first line that is none.

use super::camera;
use crate::{Error, ErrorKind, Limits};
use lobula_core::Geometry;
use lobula_core::wire::{Encoding, WordOrder};
use std::path::Path;

/// The header's fields and where the events begin.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Header {
    fields: Vec<Field>,
    len: u64,
}

#[derive(Clone, Debug, PartialEq, Eq)]
struct Field {
    key: String,
    value: String,
    offset: u64,
}

/// What every line of a header starts with.
const PREFIX: &[u8] = b"% ";

impl Header {
    /// Reads the header at the start of `head`, the first bytes of a file of `file_bytes`.
    pub(crate) fn parse(head: &[u8], file_bytes: u64, path: &Path, limits: &Limits) -> Result<Self, Error> {
        let head = head.get(..limits.header_bytes_max).unwrap_or(head);
        let mut header = Self::default();
        let mut rest = head;
        loop {
            // The limit cut the next line's prefix: whether there is one is not known.
            if rest.len() < PREFIX.len() && (head.len() as u64) < file_bytes {
                return Err(Self::unfinished(head, file_bytes, path));
            }
            let Some(line) = rest.strip_prefix(PREFIX) else { break };
            let end = line.iter().position(|byte| *byte == b'\n');
            let text = &line[..end.unwrap_or(line.len())];
            if !is_text(text) {
                break; // events that happen to begin as a line does
            }
            let Some(end) = end else { return Err(Self::unfinished(head, file_bytes, path)) };
            let offset = (head.len() - rest.len()) as u64;
            rest = &line[end + 1..];
            if !header.push(&String::from_utf8_lossy(text), offset) {
                break;
            }
        }
        header.len = (head.len() - rest.len()) as u64;
        Ok(header)
    }

    fn unfinished(head: &[u8], file_bytes: u64, path: &Path) -> Error {
        let offset = head.len() as u64;
        if offset == file_bytes {
            let what = "ends inside its header";
            return Error::new(ErrorKind::Malformed, path, what, "copy it again from where it was recorded")
                .at(offset);
        }
        let what = format!("has a header of more than {offset} bytes");
        Error::new(
            ErrorKind::TooLarge,
            path,
            what,
            "check that it is a recording, or raise the limit for headers",
        )
    }

    /// Takes one line without its prefix; false for the line that ends the header.
    fn push(&mut self, line: &str, offset: u64) -> bool {
        let line = line.trim();
        let (key, value) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
        if key == "end" {
            return false;
        }
        if !key.is_empty() {
            self.fields.push(Field { key: key.to_owned(), value: value.trim().to_owned(), offset });
        }
        true
    }

    /// The value of `key`; of the last, where it stands twice.
    pub fn get(&self, key: &str) -> Option<&str> {
        self.field(key).map(|field| field.value.as_str())
    }

    fn field(&self, key: &str) -> Option<&Field> {
        self.fields.iter().rfind(|field| field.key == key)
    }

    /// Every key with its value, in file order.
    pub fn fields(&self) -> impl Iterator<Item = (&str, &str)> {
        self.fields.iter().map(|field| (field.key.as_str(), field.value.as_str()))
    }

    /// Length in bytes: the offset of the first event.
    pub fn bytes(&self) -> u64 {
        self.len
    }

    /// How events are encoded: by `format` and `evt`, which must agree.
    pub(super) fn encoding(&self, path: &Path) -> Result<Encoding, Error> {
        let evt = self.field("evt").map(|field| self.encoding_of(field, path)).transpose()?;
        let format = self.field("format").map(|field| self.encoding_of(field, path)).transpose()?;
        match (format, evt) {
            (Some(format), Some(evt)) if format != evt => Err(self.contradiction(path)),
            (Some(encoding), _) | (None, Some(encoding)) => Ok(encoding),
            (None, None) => Err(Error::new(
                ErrorKind::NeedsOption,
                path,
                "has a header that does not name the encoding (no `evt` and no `format` line)",
                "give it with --encoding",
            )),
        }
    }

    fn encoding_of(&self, field: &Field, path: &Path) -> Result<Encoding, Error> {
        let name = field.value.split(';').next().unwrap_or_default().trim();
        match (field.key.as_str(), name) {
            ("evt", "2.0") | ("format", "EVT2") => Ok(Encoding::Evt2),
            ("evt", "2.1") | ("format", "EVT21") => self.word_order(path),
            ("evt", "3.0") | ("format", "EVT3") => Ok(Encoding::Evt3),
            ("evt", "4.0") | ("format", "EVT4") => Ok(Encoding::Evt4),
            (key, _) => Err(Error::new(
                ErrorKind::Unsupported,
                path,
                format!("is encoded as `{key} {name}`, which is not read (EVT2, EVT2.1, EVT3 and EVT4 are),"),
                "record or convert it with one of these, or give --encoding if the header is wrong",
            )
            .at(field.offset)),
        }
    }

    /// EVT2.1 in the order of `endianness`, a part of `format` or a line of its own, else in that of the camera.
    fn word_order(&self, path: &Path) -> Result<Encoding, Error> {
        let part = self.format_part("endianness");
        let named =
            part.or_else(|| self.field("endianness").map(|field| (field.value.as_str(), field.offset)));
        match named {
            Some(("legacy", _)) => Ok(Encoding::Evt21(WordOrder::Legacy)),
            Some(("little", _)) => Ok(Encoding::Evt21(WordOrder::Little)),
            Some((other, offset)) => Err(Error::new(
                ErrorKind::Unsupported,
                path,
                format!("has EVT2.1 words in the unknown order `endianness={other}`"),
                "give --encoding evt21 or --encoding evt21_legacy",
            )
            .at(offset)),
            None if self.system_id().is_some_and(camera::swaps_halves) => {
                Ok(Encoding::Evt21(WordOrder::Legacy))
            }
            None => Ok(Encoding::Evt21(WordOrder::Little)),
        }
    }

    fn contradiction(&self, path: &Path) -> Error {
        let [format, evt] = ["format", "evt"].map(|key| self.get(key).unwrap_or_default());
        let what = format!("has a header that contradicts itself (`format {format}` and `evt {evt}`)");
        Error::new(ErrorKind::Malformed, path, what, "give the true one with --encoding")
    }

    /// The sensor's size: by `format` and `geometry`, which must agree, else by the camera; `None` if none tells.
    pub(super) fn geometry(&self, path: &Path, limits: &Limits) -> Result<Option<Geometry>, Error> {
        let size =
            |text: &str, offset| geometry(text, limits).map_err(|why| why.error(text, path).at(offset));
        let line = self.field("geometry").map(|field| size(&field.value, field.offset)).transpose()?;
        let part = match (self.format_part("width"), self.format_part("height")) {
            (Some((width, offset)), Some((height, _))) => Some(size(&format!("{width}x{height}"), offset)?),
            _ => None,
        };
        match (part, line) {
            (Some(part), Some(line)) if part != line => Err(Error::new(
                ErrorKind::Malformed,
                path,
                format!("has a header that contradicts itself (`format` says {part}, `geometry` {line})"),
                "give the true size with --sensor-size WxH",
            )),
            (Some(size), _) | (None, Some(size)) => Ok(Some(size)),
            (None, None) => Ok(self.geometry_of_camera()),
        }
    }

    /// The size `text`, which the line of `key` told.
    pub(crate) fn size_of(
        &self,
        text: &str,
        key: &str,
        path: &Path,
        limits: &Limits,
    ) -> Result<Geometry, Error> {
        let offset = self.field(key).map_or(0, |field| field.offset);
        geometry(text, limits).map_err(|why| why.error(text, path).at(offset))
    }

    fn geometry_of_camera(&self) -> Option<Geometry> {
        let system = self.system_id().and_then(camera::geometry_of_system);
        system.or_else(|| self.get("plugin_name").and_then(camera::geometry_of_plugin))
    }

    /// `system_ID`, where it is a number of Prophesee's own: other integrators number as they like.
    fn system_id(&self) -> Option<u64> {
        let keys = ["integrator_name", "camera_integrator_name", "plugin_integrator_name"];
        let foreign = keys.iter().any(|key| self.get(key).is_some_and(|name| name != "Prophesee"));
        self.get("system_ID").filter(|_| !foreign)?.parse().ok()
    }

    /// The value of `key=value` in the `format` line, with the line's offset.
    fn format_part(&self, key: &str) -> Option<(&str, u64)> {
        let field = self.field("format")?;
        let mut parts = field.value.split(';').filter_map(|part| part.split_once('='));
        parts.rfind(|(name, _)| name.trim() == key).map(|(_, value)| (value.trim(), field.offset))
    }
}

/// Whether a line may belong to a header: no control character but tab and carriage return.
fn is_text(line: &[u8]) -> bool {
    line.iter().all(|byte| *byte >= b' ' && *byte != 0x7F || matches!(byte, b'\t' | b'\r'))
}

/// Why a size is refused.
enum BadSize {
    NotTwoNumbers,
    Zero,
    TooLarge(u16),
}

impl BadSize {
    fn error(self, text: &str, path: &Path) -> Error {
        let (kind, what) = match self {
            Self::NotTwoNumbers => (ErrorKind::Malformed, format!("has the sensor size `{text}`, not WxH,")),
            Self::Zero => (ErrorKind::Malformed, format!("has the sensor size {text}, which has no pixel,")),
            Self::TooLarge(limit) => {
                (ErrorKind::TooLarge, format!("has the sensor size {text}, beyond {limit} pixels a side,"))
            }
        };
        Error::new(kind, path, what, "give the true size with --sensor-size WxH")
    }
}

fn geometry(text: &str, limits: &Limits) -> Result<Geometry, BadSize> {
    let side = |digits: &str| {
        let digits = digits.trim();
        let number = !digits.is_empty() && digits.bytes().all(|byte| byte.is_ascii_digit());
        // A number too long for u64 is a number still.
        number.then(|| digits.parse::<u64>().unwrap_or(u64::MAX)).ok_or(BadSize::NotTwoNumbers)
    };
    let (width, height) = text.split_once('x').ok_or(BadSize::NotTwoNumbers)?;
    let (width, height) = (side(width)?, side(height)?);
    if width == 0 || height == 0 {
        return Err(BadSize::Zero);
    }
    let limit = limits.sensor_side_px_max;
    let within = |side: u64| u16::try_from(side).ok().filter(|side| *side <= limit);
    match (within(width), within(height)) {
        (Some(width), Some(height)) => Ok(Geometry::new(width, height)),
        _ => Err(BadSize::TooLarge(limit)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &[u8]) -> Result<Header, Error> {
        Header::parse(text, text.len() as u64, Path::new("a.raw"), &Limits::default())
    }

    /// Encoding, size and length of a header; or what the error says.
    fn says(text: &str) -> String {
        let header = match read(text.as_bytes()) {
            Ok(header) => header,
            Err(error) => return error.to_string(),
        };
        let size = header.geometry(Path::new("a.raw"), &Limits::default());
        match (header.encoding(Path::new("a.raw")), size) {
            (Ok(encoding), Ok(Some(size))) => format!("{encoding} {size} {}", header.bytes()),
            (Ok(encoding), Ok(None)) => format!("{encoding} ? {}", header.bytes()),
            (Err(error), _) | (_, Err(error)) => error.to_string(),
        }
    }

    #[track_caller]
    fn check(text: &str, expected: &str) {
        assert_eq!(says(text), expected, "{text:?}");
    }

    #[test]
    fn encodings() {
        check("% evt 3.0\n% end\n% x y\n", "evt3 ? 16");
        check("% evt 2.0\n\u{1}", "evt2 ? 10");
        check("% evt 3.0\r\n% geometry 640x480\r\n% end\r\n", "evt3 640x480 38");
        check("% format EVT3;height=720;width=1280\n", "evt3 1280x720 36");
        check("% evt 2.1\n", "evt21 ? 10");
        check("% format EVT4;height=480;width=640\n", "evt4 640x480 35");
        check("% format EVT21;endianness=legacy\n% evt 2.1\n", "evt21_legacy ? 43");
        check("% format EVT21\n% endianness legacy\n", "evt21_legacy ? 35");
        check("% evt 2.1\n% system_ID 49\n", "evt21_legacy 1280x720 25");
        check("% evt 2.1\n% system_ID 58\n", "evt21 ? 25");
    }

    #[test]
    fn sizes_by_camera() {
        check("% evt 3.0\n% system_ID 48\n", "evt3 1280x720 25");
        check("% evt 2.0\n% system_ID 21\n", "evt2 640x480 25");
        check("% evt 3.0\n% system_ID 48\n% integrator_name CenturyArks\n", "evt3 ? 55");
        check("% evt 3.0\n% plugin_name hal_plugin_gen31_evk3\n", "evt3 640x480 46");
        check("% evt 3.0\n% system_ID 9999\n% plugin_name hal_plugin_gen41_evk2\n", "evt3 1280x720 63");
        check("% evt 3.0\n% geometry 304x240\n% system_ID 48\n", "evt3 304x240 44");
    }

    #[test]
    fn what_is_wrong_is_said() {
        let option = "give the true size with --sensor-size WxH";
        check(
            "% evt 3.0\n% geometry 1000000x1000000\n",
            &format!(
                "a.raw: has the sensor size 1000000x1000000, beyond 8192 pixels a side, at byte 10; {option}"
            ),
        );
        check(
            "% evt 3.0\n% geometry 99999999999999999999999x1\n",
            &format!(
                "a.raw: has the sensor size 99999999999999999999999x1, beyond 8192 pixels a side, at byte 10; {option}"
            ),
        );
        check(
            "% evt 3.0\n% geometry 0x480\n",
            &format!("a.raw: has the sensor size 0x480, which has no pixel, at byte 10; {option}"),
        );
        check(
            "% evt 3.0\n% geometry -1x480\n",
            &format!("a.raw: has the sensor size `-1x480`, not WxH, at byte 10; {option}"),
        );
        check(
            "% geometry 640x480\n% format EVT3;height=720;width=1280\n",
            &format!(
                "a.raw: has a header that contradicts itself (`format` says 1280x720, `geometry` 640x480); {option}"
            ),
        );
        check(
            "% evt 5.0\n",
            "a.raw: is encoded as `evt 5.0`, which is not read (EVT2, EVT2.1, EVT3 and EVT4 are), at byte 0; record or convert it with one of these, or give --encoding if the header is wrong",
        );
        check(
            "% evt 3.0\n% format EVT2\n",
            "a.raw: has a header that contradicts itself (`format EVT2` and `evt 3.0`); give the true one with --encoding",
        );
        check(
            "% format EVT21;endianness=big\n",
            "a.raw: has EVT2.1 words in the unknown order `endianness=big` at byte 0; give --encoding evt21 or --encoding evt21_legacy",
        );
        check(
            "% date today\n",
            "a.raw: has a header that does not name the encoding (no `evt` and no `format` line); give it with --encoding",
        );
        check(
            "% evt 3.",
            "a.raw: ends inside its header at byte 8; copy it again from where it was recorded",
        );
    }

    #[test]
    fn a_header_without_end_is_bounded() {
        for line in ["% a b\n", "% a bcd\n"] {
            let error = says(&line.repeat(20_000));
            assert!(error.contains("more than 65536 bytes"), "{error}");
        }
    }
}
