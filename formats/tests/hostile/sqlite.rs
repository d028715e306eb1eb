//! A small rosbag2 database, page by page as SQLite's file format has it: no program here writes one.

/// Bytes of a page.
const PAGE: usize = 512;
/// Events of a message, and messages.
const EVENTS: u16 = 120;
const MESSAGES: u8 = 4;

/// Page 1: the tables; 2: topics; 3: messages, an inner page over 4 to 7; from 8 on what overflows.
pub fn small() -> Vec<u8> {
    let mut pages = vec![vec![0; PAGE]; 7];
    pages[0] = tables();
    pages[1] = leaf(
        0,
        &[row(
            1,
            &[Null, Int(1), Text("/events"), Text("event_camera_msgs/msg/EventPacket"), Text("cdr")],
            &mut Vec::new(),
            0,
        )],
    );
    for number in 0..MESSAGES {
        let (mut overflow, next) = (Vec::new(), pages.len() as u32 + 1);
        let row = row(number, &[Null, Int(1), Int(5), Blob(&message(number))], &mut overflow, next);
        pages.append(&mut overflow);
        pages[3 + usize::from(number)] = leaf(0, &[row]);
    }
    pages[2] = inner(&[(4, 0), (5, 1), (6, 2)], 7);
    pages.concat()
}

/// A value of a column.
enum Value<'a> {
    Null,
    Int(u8),
    Text(&'a str),
    Blob(&'a [u8]),
}
use Value::{Blob, Int, Null, Text};

fn varint(value: usize) -> Vec<u8> {
    if value < 128 { vec![value as u8] } else { vec![0x80 | (value >> 7) as u8, value as u8 & 0x7F] }
}

/// The cell of a row; what does not fit goes to overflow pages, the first of them page `next`.
fn row(number: u8, values: &[Value<'_>], overflow: &mut Vec<Vec<u8>>, next: u32) -> Vec<u8> {
    let (mut kinds, mut body) = (Vec::new(), Vec::new());
    for value in values {
        match value {
            Null => kinds.push(0),
            Int(value) => (kinds.push(1), body.push(*value)).1,
            Text(text) => (kinds.extend(varint(13 + 2 * text.len())), body.extend(text.bytes())).1,
            Blob(bytes) => (kinds.extend(varint(12 + 2 * bytes.len())), body.extend(*bytes)).1,
        }
    }
    let payload = [vec![kinds.len() as u8 + 1], kinds, body].concat();
    let head = [varint(payload.len()), vec![number]].concat();
    if payload.len() <= PAGE - 35 {
        return [head, payload].concat();
    }
    let least = (PAGE - 12) * 32 / 255 - 23;
    let local = least + (payload.len() - least) % (PAGE - 4);
    let local = if local <= PAGE - 35 { local } else { least };
    let pieces: Vec<_> = payload[local..].chunks(PAGE - 4).collect();
    for (i, piece) in (1u32..).zip(&pieces) {
        let after = if i as usize == pieces.len() { 0 } else { next + i };
        let mut page = [&after.to_be_bytes()[..], piece].concat();
        page.resize(PAGE, 0);
        overflow.push(page);
    }
    [&head[..], &payload[..local], &next.to_be_bytes()].concat()
}

/// A leaf whose own header stands at `at`.
fn leaf(at: usize, rows: &[Vec<u8>]) -> Vec<u8> {
    let mut page = vec![0; PAGE];
    page[at] = 13;
    page[at + 4] = rows.len() as u8;
    let mut end = PAGE;
    for (i, row) in rows.iter().enumerate() {
        end -= row.len();
        page[end..end + row.len()].copy_from_slice(row);
        page[at + 8 + 2 * i..at + 10 + 2 * i].copy_from_slice(&(end as u16).to_be_bytes());
    }
    page
}

fn inner(children: &[(u32, u8)], last: u32) -> Vec<u8> {
    let mut page = vec![0; PAGE];
    page[0] = 5;
    page[4] = children.len() as u8;
    page[8..12].copy_from_slice(&last.to_be_bytes());
    for (i, (child, key)) in children.iter().enumerate() {
        let at = PAGE - 5 * (i + 1);
        page[at..at + 4].copy_from_slice(&child.to_be_bytes());
        page[at + 4] = *key;
        page[12 + 2 * i..14 + 2 * i].copy_from_slice(&(at as u16).to_be_bytes());
    }
    page
}

fn tables() -> Vec<u8> {
    let table = |name, root, sql| [Text("table"), Text(name), Text(name), Int(root), Text(sql)];
    let topics = table("topics", 2, "CREATE TABLE topics(a, id, name, type, serialization_format)");
    let messages = table("messages", 3, "CREATE TABLE messages(id, topic_id, timestamp, data)");
    let rows = [row(1, &topics, &mut Vec::new(), 0), row(2, &messages, &mut Vec::new(), 0)];
    let mut page = leaf(100, &rows);
    page[..16].copy_from_slice(b"SQLite format 3\0");
    page[16..18].copy_from_slice(&(PAGE as u16).to_be_bytes());
    page[59] = 1;
    page
}

/// An EventPacket of ROS 2 with words of libcaer_cmp.
fn message(number: u8) -> Vec<u8> {
    let words = (0..EVENTS).flat_map(|i| [0x1000 | i, 0x2000 | i, 0x3000 | (i % 100)]);
    let words: Vec<u8> = words.flat_map(u16::to_le_bytes).collect();
    let mut bytes = vec![0, 1, 0, 0];
    bytes.extend([5u32, 0, 1, 0, 100, 200].iter().flat_map(|value| value.to_le_bytes()));
    bytes.extend(
        [u64::from(number), u64::from(number) * 1_000_000].iter().flat_map(|value| value.to_le_bytes()),
    );
    bytes.extend([&12u32.to_le_bytes()[..], b"libcaer_cmp\0", &[0; 4]].concat());
    bytes.extend((words.len() as u32).to_le_bytes());
    [bytes, words].concat()
}
