//! Which of a file's streams are read: one of events, and what comes from the same camera.

use super::info::Declared;
use crate::packets::Kind;
use crate::{Error, ErrorKind, OpenOptions, Stream, StreamKind};
use lobula_core::Geometry;
use std::path::Path;

/// The streams of a file, in the order of its header.
#[derive(Debug)]
pub(super) struct Streams {
    streams: Vec<OneStream>,
    /// Which of them the events are read from.
    events: Option<usize>,
}

#[derive(Debug)]
pub(super) struct OneStream {
    declared: Declared,
    /// What is read of it.
    pub kind: Kind,
    /// Its name, which no other stream has.
    name: String,
}

impl OneStream {
    /// Whether buffers of it begin with these letters.
    pub fn is_of(&self, letters: [u8; 4]) -> bool {
        self.declared.kind.as_bytes() == letters
    }

    fn stream_kind(&self) -> StreamKind {
        match self.declared.kind.as_str() {
            "EVTS" => StreamKind::Events,
            "TRIG" => StreamKind::Triggers,
            "IMUS" => StreamKind::Imu,
            "FRME" => StreamKind::Frames,
            _ => StreamKind::Other,
        }
    }

    /// Whether an option names it.
    fn is_called(&self, topic: &str) -> bool {
        self.name == topic || self.declared.id.to_string() == topic
    }
}

impl Streams {
    /// The only stream of events, or the one that the option names.
    pub fn choose(declared: Vec<Declared>, options: &OpenOptions, path: &Path) -> Result<Self, Error> {
        let mut streams = named(declared);
        let events = |streams: &[OneStream]| -> Vec<usize> {
            let is_events = |i: &usize| streams[*i].stream_kind() == StreamKind::Events;
            (0..streams.len()).filter(is_events).collect()
        };
        let all = events(&streams);
        let chosen = match (&options.topic, all.as_slice()) {
            (Some(topic), all) => match all.iter().find(|i| streams[**i].is_called(topic)) {
                Some(one) => Some(*one),
                None => return Err(no_such_stream(path, topic, &streams, all)),
            },
            (None, []) => None,
            (None, [only]) => Some(*only),
            (None, several) => return Err(several_streams(path, &streams, several)),
        };
        let others: Vec<_> =
            all.iter().filter(|i| Some(**i) != chosen).map(|i| streams[*i].declared.source.clone()).collect();
        let source = chosen.map(|i| streams[i].declared.source.clone()).unwrap_or_default();
        for (i, stream) in streams.iter_mut().enumerate() {
            // Of another camera is what shares its source with other events, and not with those chosen.
            let elsewhere = stream.declared.source != source && others.contains(&stream.declared.source);
            stream.kind = match stream.stream_kind() {
                StreamKind::Events if Some(i) == chosen => Kind::Events,
                StreamKind::Triggers if !elsewhere => {
                    Kind::Triggers { channel: stream.declared.channel.unwrap_or_default() }
                }
                StreamKind::Imu if !elsewhere => Kind::Imu,
                StreamKind::Frames if !elsewhere => Kind::Frames,
                _ => Kind::Other,
            };
        }
        Ok(Self { streams, events: chosen })
    }

    /// The stream of this number.
    pub fn get(&self, id: i32) -> Option<&OneStream> {
        self.streams.iter().find(|stream| stream.declared.id == id)
    }

    /// The sensor's size, as the stream of events tells it.
    pub fn geometry(&self) -> Option<Geometry> {
        self.streams.get(self.events?)?.declared.geometry()
    }

    /// Every stream.
    pub fn list(&self) -> Vec<Stream> {
        self.streams.iter().map(|one| Stream::new(one.stream_kind(), one.name.as_str())).collect()
    }

    /// Cameras that the streams come from.
    pub fn fields(&self) -> Vec<(&str, &str)> {
        let with_source = self.streams.iter().filter(|one| !one.declared.source.is_empty());
        with_source.map(|one| (one.name.as_str(), one.declared.source.as_str())).collect()
    }
}

/// Gives each stream a name of its own: its number before it, where several have the same.
fn named(declared: Vec<Declared>) -> Vec<OneStream> {
    let names: Vec<_> = declared.iter().map(|one| one.name.clone()).collect();
    let is_alone = |name: &String| !name.is_empty() && names.iter().filter(|one| *one == name).count() == 1;
    let one = |declared: Declared| {
        let name = match is_alone(&declared.name) {
            true => declared.name.clone(),
            false => format!("{}:{}", declared.id, declared.name),
        };
        OneStream { declared, kind: Kind::Other, name }
    };
    declared.into_iter().map(one).collect()
}

fn list(streams: &[OneStream], which: &[usize]) -> String {
    let names: Vec<_> = which.iter().map(|i| streams[*i].name.as_str()).collect();
    names.join(", ")
}

fn several_streams(path: &Path, streams: &[OneStream], all: &[usize]) -> Error {
    let what = format!("has {} streams of events: {}", all.len(), list(streams, all));
    Error::new(ErrorKind::NeedsOption, path, what, "name the one to read with --topic NAME")
}

fn no_such_stream(path: &Path, topic: &str, streams: &[OneStream], all: &[usize]) -> Error {
    let what = match all {
        [] => format!("has no stream of events, so none called {topic}"),
        _ => format!("has no stream of events called {topic}, but {}", list(streams, all)),
    };
    Error::new(ErrorKind::NeedsOption, path, what, "name one of these with --topic NAME")
}
