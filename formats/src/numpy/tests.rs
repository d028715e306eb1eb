use super::*;
use crate::testing::{file, options, said};
use crate::{TimeUnit, open_with};

/// An array file as NumPy writes it.
fn npy(descr: &str, order: &str, shape: &str, data: &[u8]) -> Vec<u8> {
    let text = format!("{{'descr': {descr}, 'fortran_order': {order}, 'shape': {shape}, }}\n");
    let len = (text.len() as u16).to_le_bytes();
    [header::MAGIC, &[1, 0], &len, text.as_bytes(), data].concat()
}

#[track_caller]
fn check(unit: &str, columns: &str, bytes: &[u8], expected: &str) {
    assert_eq!(said(&file(bytes, &options(unit, columns)).unwrap()), expected);
}

#[track_caller]
fn refused(unit: &str, columns: &str, bytes: &[u8], words: &[&str]) {
    let error = file(bytes, &options(unit, columns)).unwrap_err().to_string();
    assert!(words.iter().all(|word| error.contains(word)), "{error}");
}

const TXYP: &str = "[('t', '<i8'), ('x', '<u2'), ('y', '<u2'), ('p', '|u1')]";

fn txyp(rows: &[(i64, u16, u16, u8)]) -> Vec<u8> {
    let row = |(t, x, y, p): &(i64, u16, u16, u8)| {
        [&t.to_le_bytes()[..], &x.to_le_bytes(), &y.to_le_bytes(), &[*p]].concat()
    };
    rows.iter().flat_map(row).collect()
}

#[test]
fn fields_of_any_name_width_and_order() {
    let data = txyp(&[(9_007_199_254_740_993, 3, 4, 1), (5, 6, 7, 0)]);
    let file = npy(TXYP, "False", "(2,)", &data);
    check("us", "", &file, "?, 9007199254740993 3 4 1, 5 6 7 0");
    let big = "[('p', '|i1'), ('y', '>i4'), ('skip', '<f4', (2,)), ('x', '>u2'), ('timestamp_ns', '>u8')]";
    let mut data = vec![0xFF, 0, 0, 0, 7];
    data.extend([9; 8]);
    data.extend([0, 6]);
    data.extend(1_499u64.to_be_bytes());
    check("", "", &npy(big, "False", "(1,)", &data), "?, 1 6 7 0");
    let typed = "[(('time of it', 't'), '<m8[ms]'), ('x', '|u1'), ('y', '|u1'), ('polarity', '|b1')]";
    let mut data = 3i64.to_le_bytes().to_vec();
    data.extend([8, 9, 1]);
    check("", "", &npy(typed, "False", "(1,)", &data), "?, 3000 8 9 1");
}

#[test]
fn matrices_of_both_orders() {
    let rows = [[5i32, 1, 2, 1], [6, 3, 4, -1]];
    let data: Vec<u8> = rows.as_flattened().iter().flat_map(|n| n.to_le_bytes()).collect();
    check("us", "t,x,y,p", &npy("'<i4'", "False", "(2, 4)", &data), "?, 5 1 2 1, 6 3 4 0");
    let columns: Vec<u8> = (0..4).flat_map(|c| rows.map(|row| row[c])).flat_map(i32::to_le_bytes).collect();
    check("us", "t,x,y,p", &npy("'<i4'", "True", "(2, 4)", &columns), "?, 5 1 2 1, 6 3 4 0");
    let floats: [f64; 8] = [1.0, 2.0, 1744227144.732712, 1.0, 1.5, 2.0, f64::NAN, 1.0];
    let data: Vec<u8> = floats.iter().flat_map(|n| n.to_le_bytes()).collect();
    check("s", "x,y,t,p", &npy("'<f8'", "False", "(2, 4)", &data), "?, 1744227144732712 1 2 1, 1 faults");
}

/// Of eventcv 1.0.8: NaN becomes 0, infinity the end of time, 2^53 + 1 loses the 1, x wraps.
#[test]
fn what_is_no_event_is_counted() {
    for bad in [f64::NAN, f64::INFINITY, 1e30] {
        let floats = [bad, 1.0, 2.0, 1.0, 0.5, 1.0, 2.0, 1.0];
        let data: Vec<u8> = floats.iter().flat_map(|n| n.to_le_bytes()).collect();
        check("s", "t,x,y,p", &npy("'<f8'", "False", "(2, 4)", &data), "?, 500000 1 2 1, 1 faults");
    }
    let wide: Vec<u8> =
        [5i64, 70_000, 2, 1, 6, -1, 2, 1, 7, 1, 2, 1].iter().flat_map(|n| n.to_le_bytes()).collect();
    let recording = file(&npy("'<i8'", "False", "(3, 4)", &wide), &options("us", "t,x,y,p")).unwrap();
    assert_eq!(said(&recording), "?, 7 1 2 1");
    let polarity = txyp(&[(5, 1, 2, 3), (6, 1, 2, 1)]);
    check("us", "", &npy(TXYP, "False", "(2,)", &polarity), "?, 6 1 2 1, 1 faults");
}

#[test]
fn what_is_not_told_is_asked_for() {
    let data = txyp(&[(5, 1, 2, 1)]);
    refused("", "", &npy(TXYP, "False", "(1,)", &data), &["--time-unit"]);
    refused("", "", &npy("'<i8'", "False", "(0, 4)", &[]), &["--time-unit", "--columns"]);
    refused("us", "", &npy("'<i8'", "False", "(0, 4)", &[]), &["--columns"]);
}

#[test]
fn what_is_no_table_says_so() {
    refused("us", "", &npy("'|O'", "False", "()", b"\x80\x04."), &["pickle", "allow_pickle=False"]);
    refused("us", "", &npy("'<c16'", "False", "(4,)", &[]), &["`<c16`"]);
    refused("us", "t,x,y,p", &npy("'<i8'", "False", "(4, 3)", &[]), &["[4, 3]", "N x 4"]);
    refused("us", "", &npy("[('t', '<i8'), ('x', '<u2')]", "False", "(4,)", &[]), &["(t, x)"]);
    refused(
        "us",
        "",
        &npy("[('t', '<i8'), ('ts', '<i8'), ('x', '<u2'), ('y', '<u2'), ('p', '|u1')]", "False", "(4,)", &[]),
        &["one each"],
    );
    refused("us", "", b"\x93NUMPY\x01\x00\x04\x00{'a'", &["no dictionary"]);
    refused("us", "", b"\x93NUMPY\x02\x00\xFF\xFF\xFF\xFF{", &["4294967307 bytes, more than 65536"]);
    let deep = "(".repeat(1000);
    refused("us", "", &npy(&deep, "False", "(4,)", &[]), &["no dictionary"]);
}

#[test]
fn an_array_cut_short_gives_what_is_there() {
    let data = txyp(&[(5, 1, 2, 1), (6, 1, 2, 1)]);
    check("us", "", &npy(TXYP, "False", "(2,)", &data[..20]), "?, 5 1 2 1, 1 faults");
    check("us", "", &npy(TXYP, "False", "(18446744073709551615,)", &data), "?, 5 1 2 1, 6 1 2 1, 1 faults");
}

/// A stored archive of these members.
fn npz(members: &[(&str, Vec<u8>)]) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.npz");
    let mut output = crate::output::Output::create(&path, false).unwrap();
    let mut writer = archive::Writer::default();
    for (name, bytes) in members {
        writer.add(name, bytes, &mut output).unwrap();
    }
    writer.finish(&mut output).unwrap();
    output.finish().unwrap();
    std::fs::read(path).unwrap()
}

fn column(descr: &str, values: &[i64], bytes: usize) -> Vec<u8> {
    let data: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()[..bytes].to_vec()).collect();
    npy(descr, "False", &format!("({},)", values.len()), &data)
}

#[test]
fn archives_of_columns_or_of_one_array_under_any_name() {
    let columns = [
        ("polarity", column("'|i1'", &[1, -1], 1)),
        ("ts", column("'<u4'", &[5, 6], 4)),
        ("x", column("'<i4'", &[1, 3], 4)),
        ("note", npy("'|O'", "False", "()", b".")),
        ("y", column("'<i2'", &[2, 4], 2)),
    ];
    let archive = npz(&columns);
    check("us", "", &archive, "?, 5 1 2 1, 6 3 4 0");
    let recording = file(&archive, &options("us", "")).unwrap();
    assert_eq!(
        recording.streams().iter().map(|stream| stream.name.as_str()).collect::<Vec<_>>(),
        ["", "note"]
    );
    refused("", "", &archive, &["--time-unit"]);
    let events = npy(TXYP, "False", "(1,)", &txyp(&[(5, 1, 2, 1)]));
    check("us", "", &npz(&[("event_data", events.clone())]), "?, 5 1 2 1");
    check(
        "us",
        "",
        &npz(&[("event_data", events.clone()), ("label", column("'<i8'", &[7], 8))]),
        "?, 5 1 2 1",
    );
    let other = npy(TXYP, "False", "(1,)", &txyp(&[(9, 8, 7, 0)]));
    let two = npz(&[("left", events), ("right", other)]);
    refused("us", "", &two, &["(left, right)", "--topic"]);
    let mut chosen = options("us", "");
    chosen.topic = Some("right".into());
    assert_eq!(said(&file(&two, &chosen).unwrap()), "?, 9 8 7 0");
    let uneven = npz(&[
        ("t", column("'<i8'", &[1, 2], 8)),
        ("x", column("'<i8'", &[1], 8)),
        ("y", column("'<i8'", &[1, 2], 8)),
        ("p", column("'<i8'", &[1, 1], 8)),
    ]);
    refused("us", "", &uneven, &["1 numbers in x and 2 in t"]);
    refused("us", "", &npz(&[("t", column("'<i8'", &[1], 8))]), &["no events", "(t)"]);
}

/// Of eventcv 1.0.8: one damaged time makes windows without end.
#[test]
fn one_wild_time_does_not_make_windows_without_end() {
    let data = txyp(&[(5, 1, 2, 1), (i64::MAX - 1, 1, 2, 1), (6, 1, 2, 1)]);
    let recording = file(&npy(TXYP, "False", "(3,)", &data), &options("us", "")).unwrap();
    let mut slice = recording.slice_time(0..10).unwrap();
    let mut events = 0;
    while let Some(chunk) = slice.next_block().unwrap() {
        events += chunk.block.len();
    }
    assert_eq!(events, 2);
}

#[test]
fn times_round_to_the_nearest_micros() {
    use dtype::Number;
    let micros = |int: i128, unit| Number::Int(int).micros(unit);
    assert_eq!(micros(1_500, TimeUnit::Nanoseconds), Some(2));
    assert_eq!(micros(-1_500, TimeUnit::Nanoseconds), Some(-2));
    assert_eq!(micros(i128::from(u64::MAX), TimeUnit::Microseconds), None);
    assert_eq!(micros(i128::from(u64::MAX), TimeUnit::Nanoseconds), Some(18_446_744_073_709_552));
    assert_eq!(micros(i128::from(i64::MAX), TimeUnit::Seconds), None);
}

/// One byte changed anywhere in a column, in its header or its rows: the events are given, and the damage is told, by
/// any number of pieces.
#[test]
fn a_column_that_does_not_fit_its_checksum_is_told() {
    let rows = 20_000i64;
    let values = |i: i64| column("'<i8'", &(0..rows).map(|row| row * i % 7).collect::<Vec<_>>(), 8);
    let columns = [("t", 1), ("x", 2), ("y", 3)].map(|(name, i)| (name, values(i)));
    let p = ("p", column("'|u1'", &(0..rows).map(|row| row % 2).collect::<Vec<_>>(), 1));
    let matrix: Vec<u8> = (0..rows * 4).flat_map(|i| (i % 2).to_le_bytes()).collect();
    let shape = format!("({rows}, 4)");
    let of_columns = npz(&columns.into_iter().chain([p]).collect::<Vec<_>>());
    let by_row = npz(&[("it", npy("'<i8'", "False", &shape, &matrix))]);
    let by_column = npz(&[("it", npy("'<i8'", "True", &shape, &matrix))]);
    let longer = npz(&[("it", npy("'<i8'", "False", &shape, &[&matrix[..], &[9; 5000]].concat()))]);
    for whole in [of_columns, by_row, by_column, longer] {
        let options = options("us", "t,x,y,p");
        let sound = file(&whole, &options).unwrap();
        assert_eq!(crate::Check::of(&sound, |_| {}).warnings, Vec::<String>::new());
        // Not in the headers before the members, which are told by the contents too.
        let heads: Vec<_> =
            whole.windows(4).enumerate().filter(|(_, four)| *four == archive::MAGIC).collect();
        let in_head = |at: &usize| heads.iter().any(|(head, _)| (*head..*head + 60).contains(at));
        for at in (60..whole.len() - 600).step_by(whole.len() / 31).filter(|at| !in_head(at)) {
            let mut bytes = whole.clone();
            bytes[at] ^= 1;
            let Ok(recording) = file(&bytes, &options) else { continue };
            let check = crate::Check::of(&recording, |_| {});
            assert!(!check.sound && check.warnings.len() == 1, "byte {at}: {check:?}");
            assert!(check.events + check.off_sensor + 5 > rows as u64, "byte {at}: {check:?}");
            let loaded = recording.load().unwrap();
            assert_eq!(loaded.counters().bytes_faulty, check.bytes_faulty, "byte {at}");
        }
    }
}

#[test]
fn a_damaged_unit_is_not_believed() {
    let unit = |letter: u8| npy("'<U2'", "False", "()", &[letter, 0, 0, 0, b's', 0, 0, 0]);
    let events = npy(TXYP, "False", "(1,)", &txyp(&[(5, 1, 2, 1)]));
    let whole = npz(&[("events", events), (table::TIME_UNIT, unit(b'u'))]);
    check("", "", &whole, "?, 5 1 2 1");
    let at = whole.windows(8).position(|bytes| bytes == b"u\0\0\0s\0\0\0").unwrap();
    let mut changed = whole;
    changed[at] = b'm';
    refused("", "", &changed, &["--time-unit"]);
}

/// Columns behind the first 4 GiB of an archive, and columns longer than that, in a file of holes.
#[test]
fn archives_of_more_than_4_gib() {
    use std::io::{Seek, SeekFrom, Write};
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("large.npz");
    let (rows, far) = (600_000_000u64, 4u64 << 30);
    let mut file = std::fs::File::create(&path).unwrap();
    let mut contents = Vec::new();
    for (name, descr, width) in
        [("frames", "'|u1'", 1), ("t", "'<i8'", 8), ("x", "'<u2'", 2), ("y", "'<u2'", 2), ("p", "'|u1'", 1)]
    {
        let count = if name == "frames" { far } else { rows };
        let header = npy(descr, "False", &format!("({count},)"), &[]);
        let bytes = header.len() as u64 + count * width;
        let at = file.stream_position().unwrap();
        let fixed = |stored: [u32; 3], extra: &[u8]| {
            let fixed = [45u16, 0, 0, 0, 33].map(u16::to_le_bytes);
            let lens = [name.len() as u16 + 4, extra.len() as u16].map(u16::to_le_bytes);
            [fixed.as_flattened(), stored.map(u32::to_le_bytes).as_flattened(), lens.as_flattened()].concat()
        };
        // As CPython's zipfile has it: wide fields in the contents only for what needs them.
        let long = [&[1, 0, 16, 0][..], &bytes.to_le_bytes(), &bytes.to_le_bytes()].concat();
        let local = fixed([0, u32::MAX, u32::MAX], &long);
        file.write_all(&[b"PK\x03\x04", &local[..], name.as_bytes(), b".npy", &long, &header].concat())
            .unwrap();
        let rows_at = file.stream_position().unwrap();
        if name == "t" {
            file.seek(SeekFrom::Start(rows_at + (rows - 1) * 8)).unwrap();
            file.write_all(&7u64.to_le_bytes()).unwrap();
        }
        file.seek(SeekFrom::Start(rows_at + count * width)).unwrap();
        let mut wide = Vec::new();
        let is_long = bytes > u64::from(u32::MAX >> 1);
        wide.extend([bytes, bytes].into_iter().filter(|_| is_long).flat_map(u64::to_le_bytes));
        let is_far = at > u64::from(u32::MAX >> 1);
        wide.extend(Some(at).filter(|_| is_far).into_iter().flat_map(u64::to_le_bytes));
        let short = |number: u64, elsewhere: bool| if elsewhere { u32::MAX } else { number as u32 };
        let extra = if wide.is_empty() { wide } else { [&[1, 0, wide.len() as u8, 0][..], &wide].concat() };
        let sizes = [0, short(bytes, is_long), short(bytes, is_long)];
        let entry =
            [&[0; 10][..], &short(at, is_far).to_le_bytes(), name.as_bytes(), b".npy", &extra].concat();
        contents.push([&b"PK\x01\x02\x2D\0"[..], &fixed(sizes, &extra), &entry].concat());
    }
    let at = file.stream_position().unwrap();
    let contents = contents.concat();
    let mut end = contents.clone();
    end.extend([&b"PK\x06\x06"[..], &44u64.to_le_bytes(), &[45, 0, 45, 0], &[0; 8]].concat());
    end.extend([5, 5, contents.len() as u64, at].map(u64::to_le_bytes).as_flattened());
    end.extend(
        [&b"PK\x06\x07\0\0\0\0"[..], &(at + contents.len() as u64).to_le_bytes(), &[1, 0, 0, 0]].concat(),
    );
    end.extend(
        [&b"PK\x05\x06\0\0\0\0\x05\0\x05\0"[..], &(contents.len() as u32).to_le_bytes(), &[0xFF; 4], &[0; 2]]
            .concat(),
    );
    file.write_all(&end).unwrap();
    drop(file);
    let recording = open_with(&path, &options("us", "")).unwrap();
    assert_eq!(recording.streams()[1].name, "frames");
    let first = recording.blocks().next_block().unwrap().unwrap().span().events.len();
    assert!(first > 1000, "{first}");
    // The last of many pieces, since to read all of it takes long.
    let mut piece = recording.container().pieces(100_000).unwrap().pop().unwrap();
    let mut events = vec![lobula_core::Event::default(); 8192];
    let mut sink = lobula_core::Sink::new(&mut events);
    assert_eq!(piece.cursor.fill(&mut sink).unwrap(), crate::container::Stop::End);
    let block = sink.block(recording.block_geometry());
    let times: Vec<_> = block.span().events.iter().rev().take(2).map(|event| event.t()).collect();
    assert_eq!((times, piece.cursor.counters().bytes_faulty), (vec![7, 0], 0));
}
