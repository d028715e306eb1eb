use super::*;
use crate::{Recording, TimeUnit, open_with};

/// An array file as NumPy writes it.
fn npy(descr: &str, order: &str, shape: &str, data: &[u8]) -> Vec<u8> {
    let text = format!("{{'descr': {descr}, 'fortran_order': {order}, 'shape': {shape}, }}\n");
    let len = (text.len() as u16).to_le_bytes();
    [header::MAGIC, &[1, 0], &len, text.as_bytes(), data].concat()
}

fn file(bytes: &[u8], options: &OpenOptions) -> Result<Recording, Error> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a");
    std::fs::write(&path, bytes).unwrap();
    open_with(&path, options)
}

/// Size, then every event as `t x y p`, then the number of faults.
fn said(recording: &Recording) -> String {
    let mut blocks = recording.blocks();
    let mut said = recording.geometry().map_or("?".into(), |size| size.to_string());
    while let Some(chunk) = blocks.next_block().unwrap() {
        let span = chunk.span();
        for event in span.events {
            let (t, x, y, p) = (span.time(*event), event.x(), event.y(), u8::from(event.is_on()));
            said += &format!(", {t} {x} {y} {p}");
        }
    }
    match blocks.counters().faults.total() {
        0 => said,
        faults => format!("{said}, {faults} faults"),
    }
}

fn options(unit: &str, columns: &str) -> OpenOptions {
    OpenOptions { time_unit: unit.parse().ok(), columns: columns.parse().ok(), ..OpenOptions::default() }
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
