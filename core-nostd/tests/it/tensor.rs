//! The tensor ends against oracles in double precision, and against other programs.

use lobula_core::tensor::{BadTensor, Element, Method, Quantise, Resize, Size, maximum, percentile};
use lobula_core::{Shape, f16};
use proptest::prelude::*;

const METHODS: [Method; 3] = [Method::Nearest, Method::Bilinear, Method::Area];

fn resized<I: Element, O: Element>(method: Method, from: Shape, to: Size, input: &[I]) -> Vec<O> {
    let resize = Resize::try_new(from, to, method).unwrap();
    assert_eq!(resize.shape(), Shape { channels: from.channels, height: to.height, width: to.width });
    let mut out = vec![O::zeroed(); resize.shape().len()];
    resize.apply(input, &mut out).unwrap();
    out
}

/// The weight of each input pixel of a row in output pixel `o`, by the definitions.
fn weights(method: Method, from: usize, to: usize, o: usize) -> Vec<f64> {
    let (scale, o) = (from as f64 / to as f64, o as f64);
    let centre = (o + 0.5) * scale;
    (0..from)
        .map(|i| {
            let i = i as f64;
            match method {
                Method::Nearest => f64::from(u8::from(i <= centre + 1e-9 && centre + 1e-9 < i + 1.0)),
                Method::Bilinear => {
                    let at = (centre - 0.5).clamp(0.0, from as f64 - 1.0);
                    (1.0 - (at - i).abs()).max(0.0)
                }
                Method::Area => {
                    let covered = ((o + 1.0) * scale).min(i + 1.0) - (o * scale).max(i);
                    covered.max(0.0) / scale
                }
            }
        })
        .collect()
}

fn naive(method: Method, from: Shape, to: Size, input: &[f64]) -> Vec<f64> {
    let mut out = vec![];
    for (c, oy) in (0..from.channels).flat_map(|c| (0..to.height).map(move |oy| (c, oy))) {
        let rows = weights(method, from.height, to.height, oy);
        for ox in 0..to.width {
            let columns = weights(method, from.width, to.width, ox);
            let pixel = |y: usize, x: usize| input[(c * from.height + y) * from.width + x];
            let row = |y: usize| columns.iter().enumerate().map(|(x, w)| w * pixel(y, x)).sum::<f64>();
            out.push(rows.iter().enumerate().map(|(y, w)| w * row(y)).sum());
        }
    }
    out
}

fn check_resize(method: Method, from: Shape, to: Size, input: &[f32]) {
    let found: Vec<f32> = resized(method, from, to, input);
    let exact: Vec<f64> = input.iter().map(|value| f64::from(*value)).collect();
    let expected = naive(method, from, to, &exact);
    assert_eq!(found.len(), expected.len());
    for (i, (found, expected)) in found.iter().zip(expected).enumerate() {
        let error = (f64::from(*found) - expected).abs();
        assert!(error < 2e-4, "{method:?} {from:?} to {to:?}, element {i}: {found} {expected}");
    }
}

fn shapes() -> impl Strategy<Value = (Shape, Size)> {
    (1usize..4, 1usize..24, 1usize..150, 1usize..24, 1usize..150).prop_map(
        |(channels, h, w, height, width)| (Shape { channels, height: h, width: w }, Size { height, width }),
    )
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, cases: 64, ..Default::default() })]

    #[test]
    fn resizes_as_the_oracle((from, to) in shapes(), seed in any::<u32>()) {
        let random = |i: u32| (i.wrapping_mul(0x9E37_79B1) ^ seed).wrapping_mul(0x85EB_CA6B) >> 24;
        let input: Vec<f32> = (0..from.len() as u32).map(|i| random(i) as f32 - 100.0).collect();
        for method in METHODS {
            check_resize(method, from, to, &input);
        }
    }

    /// Blocks of whole pixels: wider than one tile of sums.
    #[test]
    fn means_of_blocks_as_the_oracle(factor in 1usize..6, down in 1usize..4, width in 1usize..200) {
        let from = Shape { channels: 2, height: 3 * down, width: width * factor };
        let input: Vec<f32> = (0..from.len()).map(|i| (i * 7919 % 255) as f32).collect();
        check_resize(Method::Area, from, Size { height: 3, width }, &input);
    }

    #[test]
    fn quantises_as_the_oracle(
        input in prop::collection::vec(-300.0f32..300.0, 0..5000),
        range in prop_oneof![Just(255.0f32), 0.01f32..400.0, Just(0.0f32), Just(-1.0f32)],
        zero in prop_oneof![Just(0u8), Just(128u8), any::<u8>()],
    ) {
        let mut found = vec![7; input.len()];
        let clipped = Quantise { range, zero }.apply(&input, &mut found).unwrap();
        let mut beyond = 0;
        for (found, input) in found.iter().zip(&input) {
            let scale = if range > 0.0 { (255.0 - f64::from(zero)) / f64::from(range) } else { 0.0 };
            let value = f64::from(*input) * scale + f64::from(zero);
            beyond += u64::from(!(-0.5..=255.5).contains(&value));
            let error = (value.clamp(0.0, 255.0) - f64::from(*found)).abs();
            prop_assert!(error <= 0.5 + 1e-3, "{input}: {found}, {value}");
        }
        prop_assert!(clipped.abs_diff(beyond) <= 2); // two values at an edge may round to either side
    }

    #[test]
    fn percentiles_as_a_sort(
        input in prop::collection::vec(prop_oneof![
            3 => Just(0.0f32), 5 => -20.0f32..20.0, 2 => (0u8..4).prop_map(f32::from), 1 => -1e30f32..1e30,
            1 => prop::sample::select(vec![f32::NAN, f32::INFINITY, f32::MIN_POSITIVE / 8.0, -f32::MAX]),
        ], 0..600),
        percent in prop_oneof![Just(0.0f32), Just(100.0), Just(50.0), 0.0f32..100.0],
    ) {
        let mut sorted: Vec<f64> =
            input.iter().filter(|v| **v != 0.0 && v.is_finite()).map(|v| f64::from(v.abs())).collect();
        sorted.sort_by(f64::total_cmp);
        let found = percentile(&input, percent, &mut [0xAAAA_AAAA; 2048]);
        let Some(last) = sorted.len().checked_sub(1) else {
            prop_assert_eq!(found, 0.0);
            prop_assert_eq!(maximum(&input), 0.0);
            return Ok(());
        };
        prop_assert_eq!(f64::from(maximum(&input)), sorted[last]);
        let rank = f64::from(percent) / 100.0 * last as f64;
        let (low, high) = (sorted[rank.floor() as usize], sorted[rank.ceil() as usize]);
        let expected = low + (high - low) * (rank - rank.floor());
        prop_assert!((f64::from(found) - expected).abs() <= 1e-6 * high, "{found} {expected}");
    }
}

/// OpenCV 5.0.0 (`INTER_AREA`, `INTER_LINEAR`) and Pillow 13.0.0 (`NEAREST`) on the same numbers.
#[test]
fn resizes_as_other_programs() {
    let input: Vec<f32> = (0..35).map(|i| (i * 37 % 23) as f32).collect();
    let from = Shape { channels: 1, height: 5, width: 7 };
    let of = |method, height, width| -> Vec<f32> { resized(method, from, Size { height, width }, &input) };
    let near = |found: Vec<f32>, expected: &[f32]| {
        assert_eq!(found.len(), expected.len());
        for (found, expected) in found.iter().zip(expected) {
            assert!((found - expected).abs() < 2e-5 * expected.max(1.0), "{found} {expected}");
        }
    };
    near(
        of(Method::Area, 3, 4),
        &[
            8.4, 10.057143, 11.057144, 11.400002, 10.114286, 10.457144, 14.085715, 10.485716, 9.857143,
            8.885715, 11.200001, 11.542858,
        ],
    );
    near(
        of(Method::Bilinear, 3, 10),
        &[
            2.0, 9.7, 13.75, 7.45, 11.116667, 12.866667, 11.55, 5.25, 9.3, 17.0, 12.0, 7.05, 6.5, 16.3,
            11.15, 12.9, 21.55, 15.25, 8.95, 4.0, 6.6666665, 10.15, 10.75, 4.45, 13.1, 14.85, 8.933333, 8.0,
            10.516666, 14.0,
        ],
    );
    near(of(Method::Nearest, 3, 4), &[0.0, 5.0, 10.0, 15.0, 12.0, 17.0, 22.0, 4.0, 1.0, 6.0, 11.0, 16.0]);
    near(
        of(Method::Nearest, 3, 10),
        &[
            0.0, 14.0, 14.0, 5.0, 19.0, 19.0, 10.0, 1.0, 1.0, 15.0, 12.0, 3.0, 3.0, 17.0, 8.0, 8.0, 22.0,
            13.0, 13.0, 4.0, 1.0, 15.0, 15.0, 6.0, 20.0, 20.0, 11.0, 2.0, 2.0, 16.0,
        ],
    );
}

/// numpy 2.4 on the same numbers.
#[test]
fn percentiles_as_numpy() {
    let input: Vec<f32> = (1..40).map(|i| (i * 7919 % 101) as f32 / 8.0).collect();
    for (percent, expected) in [
        (0.0, 0.25),
        (1.0, 0.2975),
        (25.0, 3.3125),
        (50.0, 6.25),
        (90.0, 11.075),
        (99.0, 12.3575),
        (100.0, 12.5),
    ] {
        let found = percentile(&input, percent, &mut [0; 2048]);
        assert!((found - expected).abs() < 1e-5, "{percent}: {found}");
    }
}

#[test]
fn every_type_rounds_to_the_nearest() {
    let from = Shape { channels: 1, height: 1, width: 2 };
    let half = |a: u8, b: u8| resized::<u8, u8>(Method::Area, from, Size { height: 1, width: 1 }, &[a, b]);
    assert_eq!([half(0, 1), half(1, 2), half(2, 3), half(255, 255)], [[0], [2], [2], [255]]);
    let wide: Vec<u16> = resized(Method::Area, from, Size { height: 1, width: 1 }, &[65_535u16, 65_534]);
    assert_eq!(wide, [65_534]);
    let clipped: Vec<u8> = resized(Method::Nearest, from, Size { height: 1, width: 2 }, &[-3.0f32, 1e9]);
    assert_eq!(clipped, [0, 255]);
    let nan: Vec<u16> = resized(Method::Nearest, from, Size { height: 1, width: 2 }, &[f32::NAN, 70_000.0]);
    assert_eq!(nan, [0, 65_535]);
    let halves: Vec<f16> = resized(Method::Bilinear, from, Size { height: 1, width: 3 }, &[1.0f32, 2.0]);
    assert_eq!(halves, [1.0, 1.5, 2.0].map(f16::from_f32));
    let same: Vec<f32> = resized(Method::Nearest, from, Size { height: 1, width: 2 }, &halves[..2]);
    assert_eq!(same, [1.0, 1.5]);
}

#[test]
fn ends_refuse_what_makes_no_sense() {
    let from = Shape { channels: 2, height: 3, width: 4 };
    let size = |height, width| Resize::try_new(from, Size { height, width }, Method::Area);
    assert_eq!(size(0, 1), Err(BadTensor::Side { found: 0 }));
    assert_eq!(size(1, Resize::SIDE_MAX + 1), Err(BadTensor::Side { found: 65_537 }));
    assert!(size(Resize::SIDE_MAX, Resize::SIDE_MAX).is_ok());
    let empty = Shape { channels: 1, height: 0, width: 4 };
    assert!(Resize::try_new(empty, Size { height: 1, width: 1 }, Method::Area).is_err());
    let resize = size(1, 2).unwrap();
    let wrong = |expected, found| Err(BadTensor::Len { expected, found });
    assert_eq!(resize.apply(&[0u8; 23], &mut [0u8; 4]), wrong(24, 23));
    assert_eq!(resize.apply(&[0u8; 24], &mut [0u8; 5]), wrong(4, 5));
    assert_eq!(
        Quantise::to(1.0).apply(&[0u8; 3], &mut [0; 2]),
        Err(BadTensor::Len { expected: 3, found: 2 })
    );
}

/// The law "same bits everywhere": the numbers are from the same steps in numpy, each rounded to binary32.
#[test]
fn ends_have_these_bits_on_every_machine() {
    let input: Vec<f32> = (0..3 * 50 * 70).map(|i| (i * 7919 % 1009) as f32 / 7.0).collect();
    let from = Shape { channels: 3, height: 50, width: 70 };
    let digest = |method, height, width| {
        let out: Vec<f32> = resized(method, from, Size { height, width }, &input);
        out.iter().fold(0u32, |digest, v| digest.rotate_left(5).wrapping_mul(0x9E37_79B1) ^ v.to_bits())
    };
    for (method, height, width, expected) in [
        (Method::Nearest, 33, 41, 2_317_754_656),
        (Method::Bilinear, 33, 41, 3_830_483_537),
        (Method::Area, 33, 41, 1_949_978_911),
        (Method::Area, 25, 35, 4_284_827_548),
    ] {
        assert_eq!(digest(method, height, width), expected, "{method:?}");
    }
}
