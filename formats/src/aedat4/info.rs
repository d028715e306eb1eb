//! The streams of a file, as the small tree of text in its header tells them.
//!
//! ```text
//! <dv version="2.0"><node name="outInfo"><node name="0">           the number of a stream
//!     <attr key="typeIdentifier" type="string">EVTS</attr>         what it holds
//!     <attr key="originalOutputName" type="string">events</attr>
//!     <node name="info"><attr key="sizeX" type="int">346</attr>    size of its sensor, its source
//! ```

use lobula_core::Geometry;

/// A stream as the header tells it.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Declared {
    pub id: i32,
    /// `EVTS`, `FRME`, `IMUS`, `TRIG` or another.
    pub kind: String,
    pub name: String,
    /// The camera that it comes from.
    pub source: String,
    width: Option<u16>,
    height: Option<u16>,
    /// Number of the trigger input, in files that we write.
    pub channel: Option<u8>,
}

impl Declared {
    pub fn geometry(&self) -> Option<Geometry> {
        let sides = self.width.zip(self.height).filter(|(width, height)| *width > 0 && *height > 0);
        sides.map(|(width, height)| Geometry::new(width, height))
    }

    fn set(&mut self, key: &str, value: String) {
        match key {
            "typeIdentifier" => self.kind = value,
            "originalOutputName" => self.name = value,
            "source" => self.source = value,
            "sizeX" => self.width = value.parse().ok(),
            "sizeY" => self.height = value.parse().ok(),
            "channel" => self.channel = value.parse().ok(),
            _ => {}
        }
    }
}

/// Every stream; `None` where the text is no such tree.
pub(super) fn streams(text: &str) -> Option<Vec<Declared>> {
    let mut streams: Vec<Declared> = Vec::new();
    let mut path: Vec<String> = Vec::new();
    let mut rest = text.trim_end_matches('\0').trim();
    while !rest.is_empty() {
        let (before, after) = rest.split_once('<')?;
        if !before.trim().is_empty() {
            return None;
        }
        let (tag, after) = after.split_once('>')?;
        rest = after.trim_start();
        match tag.split_whitespace().next()? {
            "node" => {
                path.push(value_of(tag, "name")?);
                if let Some(id) = id(&path).filter(|_| path.len() == 2) {
                    streams.push(Declared { id, ..Declared::default() });
                }
                if tag.ends_with('/') {
                    path.pop();
                }
            }
            "/node" => drop(path.pop()?),
            "attr" if !tag.ends_with('/') => {
                let (value, after) = rest.split_once("</attr>")?;
                rest = after;
                let of_stream = id(&path).and_then(|_| streams.last_mut());
                if let Some(stream) = of_stream {
                    stream.set(&value_of(tag, "key")?, unescaped(value));
                }
            }
            _ => {}
        }
    }
    path.is_empty().then_some(streams)
}

/// The number of the stream that a node belongs to.
fn id(path: &[String]) -> Option<i32> {
    match path {
        [out, id, rest @ ..] if out == "outInfo" && rest.first().is_none_or(|node| node == "info") => {
            id.parse().ok()
        }
        _ => None,
    }
}

/// The value of a tag's attribute.
fn value_of(tag: &str, key: &str) -> Option<String> {
    let (_, rest) = tag.split_once(&format!(" {key}=\""))?;
    rest.split_once('"').map(|(value, _)| unescaped(value))
}

const ESCAPES: [(&str, &str); 5] =
    [("&lt;", "<"), ("&gt;", ">"), ("&quot;", "\""), ("&apos;", "'"), ("&amp;", "&")];

fn unescaped(text: &str) -> String {
    ESCAPES.iter().fold(text.to_owned(), |text, (escape, letter)| text.replace(escape, letter))
}

fn escaped(text: &str) -> String {
    ESCAPES.iter().rev().fold(text.to_owned(), |text, (escape, letter)| text.replace(letter, escape))
}

/// The tree of these streams, as DV writes it.
pub(super) fn text(streams: &[Declared], compression: &str) -> String {
    let mut text = String::from("<dv version=\"2.0\">\n    <node name=\"outInfo\" path=\"/outInfo/\">\n");
    for stream in streams {
        let Declared { id, kind, name, source, width, height, channel } = stream;
        let (name, source) = (escaped(name), escaped(source));
        let attr = |key: &str, kind: &str, value: &str| {
            format!("<attr key=\"{key}\" type=\"{kind}\">{value}</attr>\n")
        };
        let size = width.zip(*height).map(|(width, height)| {
            format!(
                "{0}{1}{0}{2}",
                DEEP,
                attr("sizeX", "int", &width.to_string()),
                attr("sizeY", "int", &height.to_string())
            )
        });
        let channel =
            channel.map(|channel| format!("{DEEP}{}", attr("channel", "int", &channel.to_string())));
        text.push_str(&format!(
            "        <node name=\"{id}\" path=\"/outInfo/{id}/\">\n{IN}{}{IN}{}{IN}{}{IN}{}{IN}<node name=\"info\" path=\"/outInfo/{id}/info/\">\n{}{}{DEEP}{}{IN}</node>\n        </node>\n",
            attr("compression", "string", compression),
            attr("originalModuleName", "string", "lobula"),
            attr("originalOutputName", "string", &name),
            attr("typeIdentifier", "string", kind),
            size.unwrap_or_default(),
            channel.unwrap_or_default(),
            attr("source", "string", &source),
        ));
    }
    text.push_str("    </node>\n</dv>\n");
    text
}

const IN: &str = "            ";
const DEEP: &str = "                ";

impl Declared {
    /// A stream to write.
    pub fn new(id: i32, kind: &str, name: &str, geometry: Option<Geometry>, channel: Option<u8>) -> Self {
        Self {
            id,
            kind: kind.to_owned(),
            name: name.to_owned(),
            source: "lobula".to_owned(),
            width: geometry.map(|geometry| geometry.width),
            height: geometry.map(|geometry| geometry.height),
            channel,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_reads_back() {
        let geometry = Some(Geometry::new(346, 260));
        let mut events = Declared::new(0, "EVTS", "events <\"&'>", geometry, None);
        events.source = "DAVIS346_1 & 2".into();
        let declared = [events, Declared::new(7, "TRIG", "triggers6", None, Some(6))];
        assert_eq!(streams(&text(&declared, "LZ4")), Some(declared.to_vec()));
    }

    #[test]
    fn what_is_no_tree_is_refused() {
        for text in ["<dv", "word<dv>", "<node>", "<node name=\"a\">", "</node>", "<attr key=\"a\">"] {
            assert_eq!(streams(text), None, "{text}");
        }
        assert_eq!(streams(""), Some(Vec::new()));
    }
}
