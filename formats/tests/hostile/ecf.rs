//! A small file as Prophesee's programs write it: events in ECF, triggers beside them. No program here writes one.

/// Events, in fours that share time, row and polarity, and triggers.
const EVENTS: u64 = 480;
const TRIGGERS: u64 = 5;
/// Bytes of an event, and of a trigger.
const EVENT_BYTES: u32 = 16;
const TRIGGER_BYTES: u32 = 12;
/// Bytes of the superblock.
const SUPERBLOCK: usize = 48;

/// How ECF packs columns.
#[derive(Clone, Copy)]
pub enum Mode {
    /// Each in runs.
    Runs = 0,
    /// x with p, y in runs.
    ColumnsPacked = 1,
    /// All in 24 bits.
    AllPacked = 2,
}

/// Time, x, y and polarity of an event.
fn event(i: u64) -> [u64; 4] {
    let four = i / 4;
    [1_000 + four * four * 37, 64 + [0, 1, 2, 5][(i % 4) as usize], four, four & 1]
}

/// A file of `CD/events` and `EXT_TRIGGER/events`.
pub fn small(mode: Mode) -> Vec<u8> {
    let mut file = vec![0; SUPERBLOCK];
    let chunk = chunk(mode);
    let events = [("x", 0, 2, 0), ("y", 2, 2, 0), ("p", 4, 2, 8), ("t", 8, 8, 8)];
    // One chunk, found without a tree: two sides, its bytes as stored, no filter left out, its address.
    let layout = [&[4, 2, 2, 2, 8][..], &words(&[EVENTS, EVENT_BYTES.into()]), &[1]].concat();
    let layout =
        [layout, words(&[chunk.len() as u64]), vec![0; 4], words(&[put(&mut file, &chunk)])].concat();
    let filters = [&[2, 1][..], &0x8ECFu16.to_le_bytes(), &[0; 6]].concat();
    let messages = [(1, space(EVENTS)), (3, compound(EVENT_BYTES, &events)), (11, filters), (8, layout)];
    let events = object(&mut file, &messages);
    let members = [("p", 0, 2, 8), ("t", 2, 8, 8), ("id", 10, 2, 8)];
    let trigger = |i: u64| {
        let [t, ..] = event(i * 90);
        [&(i as u16 & 1).to_le_bytes()[..], &t.to_le_bytes(), &[0, 0]].concat()
    };
    let triggers: Vec<u8> = (0..TRIGGERS).flat_map(trigger).collect();
    let layout = [vec![3, 1], words(&[put(&mut file, &triggers), triggers.len() as u64])].concat();
    let messages = [(1, space(TRIGGERS)), (3, compound(TRIGGER_BYTES, &members)), (8, layout)];
    let triggers = object(&mut file, &messages);
    let groups = [("CD", events), ("EXT_TRIGGER", triggers)];
    let groups = groups.map(|(name, dataset)| (name, object(&mut file, &[(6, link("events", dataset))])));
    let root = object(&mut file, &groups.map(|(name, group)| (6, link(name, group))));
    let superblock = words(&[0, u64::MAX, file.len() as u64, root]);
    file[..12].copy_from_slice(b"\x89HDF\r\n\x1a\n\x02\x08\x08\0");
    file[12..44].copy_from_slice(&superblock);
    file
}

fn words(words: &[u64]) -> Vec<u8> {
    words.iter().flat_map(|word| word.to_le_bytes()).collect()
}

/// Adds bytes to the file; their address.
fn put(file: &mut Vec<u8>, bytes: &[u8]) -> u64 {
    let address = file.len() as u64;
    file.extend_from_slice(bytes);
    address
}

/// Adds an object's header of these messages; its address. No reader of ours looks at its checksum.
fn object(file: &mut Vec<u8>, messages: &[(u8, Vec<u8>)]) -> u64 {
    let message = |(kind, body): &(u8, Vec<u8>)| {
        [&[*kind][..], &(body.len() as u16).to_le_bytes(), &[0], body].concat()
    };
    let messages: Vec<u8> = messages.iter().flat_map(message).collect();
    put(file, &[&b"OHDR\x02\x01"[..], &(messages.len() as u16).to_le_bytes(), &messages, &[0; 4]].concat())
}

fn link(name: &str, object: u64) -> Vec<u8> {
    [&[1, 0, name.len() as u8][..], name.as_bytes(), &object.to_le_bytes()].concat()
}

fn space(rows: u64) -> Vec<u8> {
    [vec![2, 1, 0, 1], words(&[rows])].concat()
}

/// Of integers: name, offset, bytes, and 8 for those with a sign.
fn compound(bytes: u32, members: &[(&str, u8, u8, u8)]) -> Vec<u8> {
    let member = |(name, offset, bytes, sign): &(&str, u8, u8, u8)| {
        let number = [0x10, *sign, 0, 0, *bytes, 0, 0, 0, 0, 0, bytes * 8, 0];
        [name.as_bytes(), &[0, *offset], &number].concat()
    };
    let members_bytes: Vec<u8> = members.iter().flat_map(member).collect();
    [&[0x36, members.len() as u8, 0, 0][..], &bytes.to_le_bytes(), &members_bytes].concat()
}

/// All events, in ECF.
fn chunk(mode: Mode) -> Vec<u8> {
    let events: Vec<_> = (0..EVENTS).map(event).collect();
    let fours = || events.chunks(4);
    let mut bytes = ((EVENTS as u32) << 2 | mode as u32).to_le_bytes().to_vec();
    bytes.extend(events[0][0].to_le_bytes());
    let mut before = events[0][0];
    for four in fours() {
        let mut step = four[0][0] - std::mem::replace(&mut before, four[0][0]);
        while step > 0 {
            bytes.push(0xF0 | step as u8 & 15);
            step >>= 4;
        }
        bytes.push(4);
    }
    if !matches!(mode, Mode::AllPacked) {
        bytes.extend(fours().flat_map(|four| ((four[0][2] as u16) << 5 | 4).to_le_bytes()));
    }
    match mode {
        Mode::Runs => {
            // One event and the bits of those 1, 2 and 5 columns on.
            bytes.extend(fours().flat_map(|four| ((four[0][1] as u16) << 5 | 0b11001).to_le_bytes()));
            bytes.extend(fours().map(|four| (four[0][3] as u8) << 7 | 4));
        }
        Mode::ColumnsPacked => bytes.extend(fours().flat_map(|four| {
            let [a, b, c, d] = [0, 1, 2, 3].map(|i| (four[i][1] << 1 | four[i][3]) as u16);
            [a << 4 | b & 15, b >> 4 << 8 | c & 0xFF, c >> 8 << 12 | d].map(u16::to_le_bytes).concat()
        })),
        Mode::AllPacked => bytes.extend(fours().flat_map(|four| {
            let [a, b, c, d] = [0, 1, 2, 3].map(|i| (four[i][2] << 12 | four[i][1] << 1 | four[i][3]) as u32);
            [a << 8 | b & 0xFF, b >> 8 << 16 | c & 0xFFFF, c >> 16 << 24 | d].map(u32::to_le_bytes).concat()
        })),
    }
    bytes
}
