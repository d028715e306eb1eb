//! What another library does with recordings, silently (eventcv 1.0.8; the research page's numbers, D1 to D26), and what
//! we do. Those that belong to one format or stage are tested beside it:
//!
//! ```text
//! D3  events of the middle dropped by a size guess   hdf5::no_event_is_lost_where_the_size_is_unknown
//! D8  epoch or negative times wrapped                round_trip::epoch_times_are_refused_and_rebased
//! D10 filters start again at every slice             the chunk invariance of every stage, in lobula-core
//! D11 D12 windows and their reference                the views of lobula-core's chain: a window is what its setting says
//! D15 x of 32 bits wraps                             interop, off-sensor.h5; numpy::what_is_no_event_is_counted
//! D16 D17 resized and cropped beyond 16 bits         the transforms of issue 4
//! D19 of several streams the first                   aedat4::of_several_streams_one_is_named, ros::of_several_topics_…
//! D20 a cut file gives nothing and no word           aedat4::a_file_that_is_cut_gives_what_is_there
//! D21 t_offset ignored                               truth, hdf5_dsec_blosc.h5
//! D22 samples, frames and triggers dropped           conversion, ros::samples_and_frames_come_back_with_the_events
//! D23 datagrams lost uncounted                       no source here takes datagrams
//! D24 settings that mean nothing accepted            chain::refuses_settings_that_mean_nothing, filter::refuses_a_bar_…
//! ```

use super::{events_of, everything, raw_writer};
use lobula_core::wire::{Encoding, WordOrder};
use lobula_core::{Event, Geometry, Polarity, Span};
use lobula_formats::{
    Check, Error, FORMATS, OpenOptions, Summary, TimeUnit, WithDigest, WriteOptions, Writer, open, open_with,
};
use std::path::{Path, PathBuf};

const HD: Geometry = Geometry::new(1280, 720);
/// What every format can hold.
const DAVIS: Geometry = Geometry::new(346, 260);
const MINUTE: u64 = 60_000_000;

fn event(t: u64, x: u16, y: u16) -> Event {
    Event::new(t as u32, x, y, Polarity::On)
}

fn at(times: impl IntoIterator<Item = u64>) -> Vec<(u64, Event)> {
    times.into_iter().enumerate().map(|(i, t)| (t, event(t, (i % 100) as u16, 7))).collect()
}

fn write(mut writer: Writer, geometry: Geometry, events: &[(u64, Event)]) -> Result<(), Error> {
    for &(t, event) in events {
        writer.write(Span { t_first: t, t_last: t, geometry, events: &[event] })?;
    }
    writer.finish().map(|_| ())
}

fn in_micros() -> OpenOptions {
    let mut options = OpenOptions::default();
    options.time_unit = Some(TimeUnit::Microseconds);
    options
}

fn bytes(folder: &tempfile::TempDir, name: &str, bytes: &[u8]) -> PathBuf {
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    path
}

fn told(path: &Path, options: &OpenOptions) -> Vec<(u64, u16, u16, bool)> {
    let events = events_of(&open_with(path, options).unwrap());
    events.iter().map(|(t, event)| (*t, event.x(), event.y(), event.is_on())).collect()
}

fn raw_file(folder: &tempfile::TempDir, header: &str, words: &[u16]) -> PathBuf {
    let words = words.iter().flat_map(|word| word.to_le_bytes());
    bytes(folder, "it.raw", &[header.as_bytes().to_vec(), words.collect()].concat())
}

fn evt3_times(words: &[u16]) -> Vec<u64> {
    let folder = tempfile::tempdir().unwrap();
    let path = raw_file(&folder, "% evt 3.0\n% geometry 1280x720\n% end\n", words);
    events_of(&open(&path).unwrap()).iter().map(|(t, _)| *t).collect()
}

/// D1: 300 ms become 300 s, half a millisecond 498 s, 80 minutes 4.8 s, one event at 5 µs 5 s.
#[test]
fn no_span_changes_the_unit_of_time() {
    let folder = tempfile::tempdir().unwrap();
    let spans =
        [vec![5], vec![0, 498], vec![0, 300_000], vec![0, 20 * MINUTE], vec![0, 80 * MINUTE, 120 * MINUTE]];
    for format in FORMATS.iter().filter(|format| format.writes()) {
        for (i, times) in spans.iter().enumerate() {
            let path = folder.path().join(format!("{i}.{}", format.extensions[0]));
            let writer = Writer::create(&path, Some(DAVIS), &WriteOptions::default()).unwrap();
            let events = at(times.iter().copied());
            match write(writer, DAVIS, &events) {
                Ok(()) => assert!(events_of(&open(&path).unwrap()) == events, "{} {times:?}", format.name),
                // 32 bits of µs.
                Err(error) => assert!(times[times.len() - 1] > u64::from(u32::MAX), "{error}"),
            }
        }
    }
    let path = bytes(&folder, "of-others.csv", b"t,x,y,p\n0,1,2,1\n300000,3,4,0\n");
    assert!(open(&path).unwrap_err().remedy().contains("--time-unit"));
    let options = in_micros();
    assert_eq!(told(&path, &options), [(0, 1, 2, true), (300_000, 3, 4, false)]);
}

/// D2: 5 events become 4, 2 of them of no event's making.
#[test]
fn evt21_is_not_evt2() {
    for order in [WordOrder::Little, WordOrder::Legacy] {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("it.raw");
        let events =
            [(100, 3), (100, 4), (100, 40), (105, 41), (9_000, 1279)].map(|(t, x)| (t, event(t, x, 9)));
        let writer = raw_writer(&path, Encoding::Evt21(order), HD, &WriteOptions::default()).unwrap();
        write(writer, HD, &events).unwrap();
        assert_eq!(open(&path).unwrap().encoding(), Some(Encoding::Evt21(order)));
        assert!(events_of(&open(&path).unwrap()) == events);
    }
}

/// D4: a start at 100 s is written as 16.1 s; after a gap over the wrap half of the events is at 0.72 s; of 80 minutes
/// 100 s are left.
#[test]
fn evt3_holds_late_starts_gaps_and_long_recordings() {
    let folder = tempfile::tempdir().unwrap();
    let starts =
        [100_000_000, 16_000_000].map(|start| (0..1000).map(|i| start + i * 500).collect::<Vec<u64>>());
    let gap = (0..2000).map(|i| if i < 1000 { 16_000_000 + i } else { 17_500_000 + i }).collect();
    let long = (0..20_000).map(|i| i * 80 * MINUTE / 20_000).collect();
    for (i, times) in starts.into_iter().chain([gap, long]).enumerate() {
        let path = folder.path().join(format!("{i}.raw"));
        let events = at(times);
        write(raw_writer(&path, Encoding::Evt3, HD, &WriteOptions::default()).unwrap(), HD, &events).unwrap();
        let recording = open(&path).unwrap();
        assert!(events_of(&recording) == events, "{i}");
        let span = events[0].0..events[events.len() - 1].0 + 1;
        let windows = span.clone().step_by(MINUTE as usize).map(|t| t..(t + MINUTE).min(span.end));
        let in_windows: usize =
            windows.map(|t| everything(recording.slice_time(t).unwrap()).events.len()).sum();
        assert_eq!(in_windows, events.len(), "{i}");
    }
}

/// D5: TIME_HIGH 3900 and then 50 is one time around, since the step back is beyond half the range: OpenEB's rule.
#[test]
fn a_gap_over_the_wrap_goes_forward() {
    let times = evt3_times(&[0x8000 | 3900, 0x6000, 0x0007, 0x2001, 0x8000 | 50, 0x6000, 0x2001]);
    assert_eq!(times, [3900 << 12, (4096 + 50) << 12]);
}

/// D6: 4196, 4096, 4197, since a repeated TIME_HIGH cleared the low bits.
#[test]
fn a_repeated_time_high_keeps_the_low_bits() {
    let words = [0x8001, 0x6000 | 100, 0x0007, 0x2001, 0x8001, 0x2002, 0x6000 | 101, 0x2003];
    assert_eq!(evt3_times(&words), [4196, 4196, 4197]);
}

/// D7: 9952 x and 6354 y of a sensor of 4096x3000 are written as others (3138 as 1090). D25: and time that goes back
/// makes a file that does not open.
#[test]
fn what_a_format_cannot_hold_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let wide = Geometry::new(4096, 3000);
    let mut kept = 0;
    for format in FORMATS.iter().filter(|format| format.writes()) {
        let path = folder.path().join(format!("wide.{}", format.extensions[0]));
        let events = [(5, event(5, 3138, 2999)), (4, event(4, 4095, 0))];
        let made = Writer::create(&path, Some(wide), &WriteOptions::default());
        match made.and_then(|writer| write(writer, wide, &events)) {
            Ok(()) => {
                kept += 1;
                let recording = open(&path).unwrap();
                assert!(events_of(&recording) == events, "{}", format.name);
                assert!(!Check::of(&recording, |_| {}).in_order, "{}", format.name);
            }
            Err(error) => assert!(error.to_string().contains("; ") && !path.exists(), "{error}"),
        }
    }
    assert!(kept >= 3, "HDF5, NumPy and text hold them");
}

/// D9: of 20000 unsorted events windows give 233 (bag), 3 (AEDAT 2), 5637 (AEDAT 4).
#[test]
fn windows_of_unsorted_recordings_lose_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let events = at((0..20_000).map(|i| 1_000 + i * 7919 % 20_000 * 25));
    let mut held = Vec::new();
    for format in FORMATS.iter().filter(|format| format.writes()) {
        let path = folder.path().join(format!("it.{}", format.extensions[0]));
        let writer = Writer::create(&path, Some(DAVIS), &WriteOptions::default()).unwrap();
        match write(writer, DAVIS, &events) {
            Err(error) => assert!(error.to_string().contains("; "), "{error}"),
            Ok(()) => {
                held.push(format.extensions[0]);
                let recording = open(&path).unwrap();
                let window = |t: u64| everything(recording.slice_time(t..t + 33_000).unwrap()).events.len();
                let found: usize = (0..600_000).step_by(33_000).map(window).sum();
                assert_eq!(found, events.len(), "{}", format.name);
            }
        }
    }
    assert_eq!(
        held,
        ["dat", "raw", "aedat", "aedat4", "bag", "mcap", "h5", "npy", "txt"],
        "all but Event Stream"
    );
}

/// D13: -1 becomes 18446744073709551615, and -5 ms the newest event.
#[test]
fn times_before_zero_are_refused_or_shifted() {
    let folder = tempfile::tempdir().unwrap();
    let path = bytes(&folder, "it.csv", b"t,x,y,p\n-5000,1,2,1\n10,3,4,0\n");
    let mut options = in_micros();
    let recording = open_with(&path, &options).unwrap();
    let error = Summary::of(&recording, WithDigest::No).unwrap_err();
    assert!(error.remedy().contains("--time-shift"), "{error}");
    options.time_shift_us = 5000;
    assert_eq!(told(&path, &options), [(0, 1, 2, true), (5010, 3, 4, false)]);
}

/// D14: (100, 200, 1, 1000000) is read as x 200, y 1, t 100 s.
#[test]
fn columns_without_names_are_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let path = bytes(&folder, "it.csv", b"100,200,1,1000000\n101,201,0,1000100\n");
    assert!(open(&path).unwrap_err().to_string().contains("--"), "an option is named");
    let mut options = in_micros();
    options.columns = "x,y,p,t".parse().ok();
    assert_eq!(told(&path, &options), [(1_000_000, 100, 200, true), (1_000_100, 101, 201, false)]);
}

/// D18: times go through 53 bits.
#[test]
fn times_are_exact_in_64_bits() {
    let folder = tempfile::tempdir().unwrap();
    let events = at([(1 << 53) + 1, (1 << 60) + 1]);
    for name in ["it.npy", "it.npz", "it.csv", "it.h5"] {
        let path = folder.path().join(name);
        write(Writer::create(&path, Some(HD), &WriteOptions::default()).unwrap(), HD, &events).unwrap();
        assert!(events_of(&open(&path).unwrap()) == events, "{name}");
    }
}

/// D20: one damaged time in a RAW file: all 4968 events load, windows give 2499.
#[test]
fn windows_give_what_a_full_pass_gives_where_a_time_is_damaged() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("it.raw");
    let events = at((0..5000).map(|i| i * 100));
    write(raw_writer(&path, Encoding::Evt2, HD, &WriteOptions::default()).unwrap(), HD, &events).unwrap();
    let mut damaged = std::fs::read(&path).unwrap();
    let header = damaged.windows(6).position(|bytes| bytes == b"% end\n").unwrap() + 6;
    let word = damaged[header..].chunks_exact(4).enumerate().skip(2500).find(|(_, word)| word[3] >> 4 == 8);
    let at = header + word.unwrap().0 * 4;
    damaged[at + 1] ^= 0x80;
    std::fs::write(&path, damaged).unwrap();
    let recording = open(&path).unwrap();
    let all = events_of(&recording);
    assert_eq!(all.len(), events.len());
    let end = all.iter().map(|(t, _)| t + 1).max().unwrap();
    let half = everything(recording.slice_time(0..end / 2).unwrap()).events.len();
    assert_eq!(half + everything(recording.slice_time(end / 2..end).unwrap()).events.len(), all.len());
}

/// D26: of times since 1970 nothing is told.
#[test]
fn a_summary_of_epoch_times_is_whole() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("it.h5");
    let start = 1_744_227_144_732_712;
    let events = at((0..1000).map(|i| start + i * 1000));
    write(Writer::create(&path, Some(HD), &WriteOptions::default()).unwrap(), HD, &events).unwrap();
    let summary = Summary::of(&open(&path).unwrap(), WithDigest::No).unwrap();
    assert_eq!(
        (summary.events, summary.t_first_us, summary.t_last_us),
        (1000, Some(start), Some(start + 999_000))
    );
}
