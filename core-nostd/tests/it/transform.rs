//! Every transform against the formula it states, in wide integers and the standard library's floats.

use crate::chunk_invariance::{self, GEOMETRY, LEN_MAX, Splits};
use crate::streams::{self, Timed};
use lobula_core::transform::*;
use lobula_core::{Block, Event, Geometry, Polarity, SPAN_MAX_US, Transform, Unfit, WrongGeometry};
use proptest::prelude::*;

/// An event anywhere: not yet on a sensor, nor in the time that events can tell.
#[derive(Clone, Copy)]
struct Free {
    x: f64,
    y: f64,
    t: i128,
    on: bool,
}

impl Free {
    fn of(timed: &Timed) -> Self {
        let event = timed.event;
        Self { x: event.x().into(), y: event.y().into(), t: timed.t.into(), on: event.is_on() }
    }

    /// The event, if it has a place.
    fn timed(self, geometry: Geometry) -> Option<Timed> {
        let place = |value: f64, len: u16| {
            let place = value.round();
            (place >= 0.0 && place < f64::from(len)).then_some(place as u16)
        };
        let (x, y) = (place(self.x, geometry.width)?, place(self.y, geometry.height)?);
        let t = u64::try_from(self.t).ok()?;
        Some(Timed::new(t, x, y, Polarity::from_bit(self.on.into())))
    }
}

const W: f64 = GEOMETRY.width as f64;
const H: f64 = GEOMETRY.height as f64;

/// A transform, and what it must do.
struct Case {
    name: &'static str,
    make: Box<dyn Fn() -> Box<dyn Transform>>,
    /// The sensor after it.
    to: Geometry,
    /// What becomes of an event, given the time of the first.
    formula: fn(i128, &mut Free),
}

impl Case {
    fn made(&self) -> Boxed {
        Boxed((self.make)())
    }
}

/// One type for all transforms, so that the tests of all are compiled once.
pub struct Boxed(pub Box<dyn Transform>);

impl Transform for Boxed {
    fn output_geometry(&self) -> Geometry {
        self.0.output_geometry()
    }

    fn reach_max(&self, after: u64) -> u64 {
        self.0.reach_max(after)
    }

    fn apply(&mut self, block: &mut Block<'_>) -> Result<usize, Unfit> {
        self.0.apply(block)
    }
}

macro_rules! cases {
    ($($name:ident: $make:expr, $to:expr, |$first:ident, $e:ident| $formula:expr;)*) => {
        fn cases() -> Vec<Case> {
            vec![$({
                let make = $make;
                #[allow(unused_variables)]
                fn formula($first: i128, $e: &mut Free) {
                    $formula;
                }
                Case { name: stringify!($name), make: Box::new(move || Box::new(make(GEOMETRY))), to: $to, formula }
            },)*]
        }
    };
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..Default::default() })]

    #[test]
    fn each_does_as_its_formula_says(events in streams::stream(GEOMETRY, LEN_MAX), seed: u64) {
        for case in cases() {
            let stage = case.made();
            prop_assert_eq!(stage.output_geometry(), case.to, "{}", case.name);
            let found = chunk_invariance::transform(stage, &events, &mut Splits::random(seed));
            let first = events.first().map_or(0, |timed| i128::from(timed.t));
            let formula = |timed: &Timed| {
                let mut free = Free::of(timed);
                (case.formula)(first, &mut free);
                free.timed(case.to)
            };
            let expected: Vec<Timed> = events.iter().filter_map(formula).collect();
            prop_assert_eq!(found, expected, "{}", case.name);
        }
    }
}

chunk_invariance!(events every_transform, |events, splits: &mut Splits| {
    let run = |case: super::Case| crate::chunk_invariance::transform(case.made(), events, &mut splits.clone());
    super::cases().into_iter().map(run).collect::<Vec<_>>()
});

#[test]
fn each_refuses_another_sensor_and_leaves_its_events() {
    for case in cases() {
        let found = Geometry::new(45, 123);
        let mut events = [Event::new(5, 1, 2, Polarity::On)];
        let mut block = Block::new(5, 5, found, &mut events);
        let refusal = Unfit::Geometry(WrongGeometry { expected: GEOMETRY, found });
        assert_eq!(case.made().apply(&mut block), Err(refusal), "{}", case.name);
        assert_eq!((block.geometry, block.t_first), (found, 5));
        assert_eq!(events, [Event::new(5, 1, 2, Polarity::On)]);
    }
}

const MATRIX: [[f64; 3]; 3] = [[0.9, -0.25, 3.5], [0.125, 1.1, -2.0], [0.002, -0.001, 1.0]];

fn affine(geometry: Geometry) -> Affine {
    Affine::try_new(geometry, AffineParams { matrix: [MATRIX[0], MATRIX[1]] }).unwrap()
}

fn perspective(matrix: [[f64; 3]; 3]) -> impl Fn(Geometry) -> Perspective {
    move |geometry| Perspective::try_new(geometry, PerspectiveParams { matrix }).unwrap()
}

fn row(row: [f64; 3], e: Free) -> f64 {
    row[0] * e.x + row[1] * e.y + row[2]
}

const LENS: BrownConrady = BrownConrady {
    fx: 100.0,
    fy: 90.0,
    cx: 60.5,
    cy: 22.0,
    k1: -0.37,
    k2: 0.13,
    p1: 0.000_26,
    p2: 0.000_19,
    k3: 0.0,
};

const FISHEYE: Fisheye =
    Fisheye { fx: 60.0, fy: 60.0, cx: 61.0, cy: 22.0, k1: 0.05, k2: -0.01, k3: 0.003, k4: -0.0005 };

fn undistort(camera: CameraModel) -> impl Fn(Geometry) -> Undistort<Vec<u32>> {
    move |geometry| {
        Undistort::try_new(geometry, camera, vec![7; Undistort::<()>::required_len(geometry)]).unwrap()
    }
}

/// Where a camera sees the ray through (a, b, 1).
fn seen(lens: &BrownConrady, (a, b): (f64, f64)) -> (f64, f64) {
    let r2 = a.powi(2) + b.powi(2);
    let radial = 1.0 + lens.k1 * r2 + lens.k2 * r2.powi(2) + lens.k3 * r2.powi(3);
    let x = a * radial + 2.0 * lens.p1 * a * b + lens.p2 * (r2 + 2.0 * a.powi(2));
    let y = b * radial + lens.p1 * (r2 + 2.0 * b.powi(2)) + 2.0 * lens.p2 * a * b;
    (lens.fx * x + lens.cx, lens.fy * y + lens.cy)
}

fn seen_by_fisheye(lens: &Fisheye, (a, b): (f64, f64)) -> (f64, f64) {
    let r = a.hypot(b);
    let angle = r.atan();
    let bent = angle
        * (1.0
            + lens.k1 * angle.powi(2)
            + lens.k2 * angle.powi(4)
            + lens.k3 * angle.powi(6)
            + lens.k4 * angle.powi(8));
    let stretch = if r > 0.0 { bent / r } else { 1.0 };
    (lens.fx * a * stretch + lens.cx, lens.fy * b * stretch + lens.cy)
}

fn rotate90(k: i32) -> impl Fn(Geometry) -> Rotate90 {
    move |geometry| Rotate90::try_new(geometry, Rotate90Params { k }).unwrap()
}

fn resize(width: u16, height: u16) -> impl Fn(Geometry) -> Resize {
    move |geometry| Resize::try_new(geometry, ResizeParams { width, height }).unwrap()
}

fn crop(x: i32, y: i32, width: u16, height: u16) -> impl Fn(Geometry) -> Crop {
    move |geometry| Crop::try_new(geometry, CropParams { x, y, width, height }).unwrap()
}

fn time_scale(factor: f64) -> impl Fn(Geometry) -> TimeScale {
    move |geometry| TimeScale::try_new(geometry, TimeScaleParams { factor }).unwrap()
}

fn time_shift(dt_us: i64) -> impl Fn(Geometry) -> TimeShift {
    move |geometry| TimeShift::new(geometry, TimeShiftParams { dt_us })
}

fn turned() -> Geometry {
    Geometry::new(GEOMETRY.height, GEOMETRY.width)
}

cases! {
    crop_inside: crop(3, 1, 20, 2), Geometry::new(20, 2), |first, e| { e.x -= 3.0; e.y -= 1.0 };
    crop_beyond: crop(-5, -2, 300, 50), Geometry::new(300, 50), |first, e| { e.x += 5.0; e.y += 2.0 };
    flip_x: FlipX::new, GEOMETRY, |first, e| e.x = W - 1.0 - e.x;
    flip_y: FlipY::new, GEOMETRY, |first, e| e.y = H - 1.0 - e.y;
    rotate_0: rotate90(-4), GEOMETRY, |first, e| {};
    rotate_1: rotate90(1), turned(), |first, e| (e.x, e.y) = (H - 1.0 - e.y, e.x);
    rotate_2: rotate90(6), GEOMETRY, |first, e| (e.x, e.y) = (W - 1.0 - e.x, H - 1.0 - e.y);
    rotate_3: rotate90(-1), turned(), |first, e| (e.x, e.y) = (e.y, W - 1.0 - e.x);
    transpose: |geometry| Transpose::try_new(geometry).unwrap(), turned(), |first, e| (e.x, e.y) = (e.y, e.x);
    translate: |geometry| Translate::new(geometry, TranslateParams { dx: -7, dy: 2 }), GEOMETRY,
        |first, e| { e.x -= 7.0; e.y += 2.0 };
    translate_far: |geometry| Translate::new(geometry, TranslateParams { dx: i32::MIN, dy: i32::MAX }), GEOMETRY,
        |first, e| { e.x += f64::from(i32::MIN); e.y += f64::from(i32::MAX) };
    resize_down: resize(50, 9), Geometry::new(50, 9),
        |first, e| { e.x = (e.x * 50.0 / W).floor(); e.y = (e.y * 9.0 / H).floor() };
    resize_up: resize(1000, 32_768), Geometry::new(1000, 32_768),
        |first, e| { e.x = (e.x * 1000.0 / W).floor(); e.y = (e.y * 32_768.0 / H).floor() };
    scale: |geometry| Scale::try_new(geometry, ScaleParams { sx: 0.5, sy: 0.1 }).unwrap(), Geometry::new(62, 5),
        |first, e| { e.x = (e.x * 62.0 / W).floor(); e.y = (e.y * 5.0 / H).floor() };
    warp_affine: affine, GEOMETRY, |first, e| (e.x, e.y) = (row(MATRIX[0], *e), row(MATRIX[1], *e));
    warp_perspective: perspective(MATRIX), GEOMETRY, |first, e| {
        let w = row(MATRIX[2], *e);
        (e.x, e.y) = (row(MATRIX[0], *e) / w, row(MATRIX[1], *e) / w)
    };
    warp_with_a_horizon: perspective([MATRIX[0], MATRIX[1], [0.5, 0.0, -4.0]]), GEOMETRY, |first, e| {
        let w = 0.5 * e.x - 4.0;
        (e.x, e.y) = if w == 0.0 { (-9.0, -9.0) } else { (row(MATRIX[0], *e) / w, row(MATRIX[1], *e) / w) }
    };
    undistort_plain: undistort(CameraModel::BrownConrady(LENS)), GEOMETRY, |first, e| {
        (e.x, e.y) = LENS.undistorted(e.x, e.y)
    };
    undistort_fisheye: undistort(CameraModel::Fisheye(FISHEYE)), GEOMETRY, |first, e| {
        (e.x, e.y) = FISHEYE.undistorted(e.x, e.y)
    };
    invert_polarity: InvertPolarity::new, GEOMETRY, |first, e| e.on = !e.on;
    time_shift_later: time_shift(12_345_678_901), GEOMETRY, |first, e| e.t += 12_345_678_901;
    time_shift_earlier: time_shift(-5_000), GEOMETRY, |first, e| e.t -= 5_000;
    time_shift_hours_earlier: time_shift(-(1 << 35)), GEOMETRY, |first, e| e.t -= 1 << 35;
    time_scale_slow: time_scale(2.5), GEOMETRY, |first, e| e.t = (e.t as f64 * 2.5).round() as i128;
    time_scale_slow_as_never: time_scale(1e4), GEOMETRY, |first, e| e.t = (e.t as f64 * 1e4).round() as i128;
    time_scale_quick: time_scale(0.3), GEOMETRY, |first, e| e.t = (e.t as f64 * 0.3).round() as i128;
    time_window: |geometry| {
        TimeWindow::try_new(geometry, TimeWindowParams { t0_us: 100, t1_us: 1 << 35 }).unwrap()
    }, GEOMETRY, |first, e| if !(100..1 << 35).contains(&e.t) { e.t = -1 };
    normalize_time: NormalizeTime::new, GEOMETRY, |first, e| e.t -= first;
}

#[test]
fn undistortion_inverts_the_lens() {
    for (a, b) in [(0.0, 0.0), (0.2, -0.15), (-0.4, 0.1), (0.5, 0.2), (0.3, 0.3)] {
        let (u, v) = seen(&LENS, (a, b));
        let (x, y) = LENS.undistorted(u, v);
        assert!(
            (x - (LENS.fx * a + LENS.cx)).abs() < 1e-3 && (y - (LENS.fy * b + LENS.cy)).abs() < 1e-3,
            "{a} {b}"
        );
        for scale in [1.0, 4.0, 30.0] {
            let ray = (a * scale, b * scale);
            let (u, v) = seen_by_fisheye(&FISHEYE, ray);
            let (x, y) = FISHEYE.undistorted(u, v);
            let (x, y) = ((x - FISHEYE.cx) / FISHEYE.fx, (y - FISHEYE.cy) / FISHEYE.fy);
            assert!((x - ray.0).abs() < 1e-9 * scale && (y - ray.1).abs() < 1e-9 * scale, "{ray:?}: {x} {y}");
        }
    }
    // 100° from the axis.
    let plain = Fisheye { k1: 0.0, k2: 0.0, k3: 0.0, k4: 0.0, ..FISHEYE };
    assert!(plain.undistorted(61.0 + 60.0 * 1.75, 22.0).0.is_nan());
    let ideal = BrownConrady { k1: 0.0, k2: 0.0, p1: 0.0, p2: 0.0, ..LENS };
    assert_eq!(undistort(CameraModel::BrownConrady(ideal))(GEOMETRY).apply(&mut all(&mut [])).unwrap(), 0);
}

/// An event at each pixel, in no particular order.
fn everywhere() -> Vec<Event> {
    let at = |i: u32| {
        let place = i * 7919 % GEOMETRY.pixels() as u32;
        let (x, y) = (place % u32::from(GEOMETRY.width), place / u32::from(GEOMETRY.width));
        Event::new(1000 + i, x as u16, y as u16, Polarity::from_bit((i / 3) as u16))
    };
    (0..GEOMETRY.pixels() as u32).map(at).collect()
}

fn all(events: &mut [Event]) -> Block<'_> {
    Block::new(1000, 7000, GEOMETRY, events)
}

/// Applies both in turn so often; every event must be back where it was.
fn comes_back(times: usize, mut make: impl FnMut(Geometry) -> Box<dyn Transform>) {
    let mut events = everywhere();
    let len = events.len();
    let mut block = all(&mut events);
    for turn in 0..times {
        let mut stage = make(block.geometry);
        assert_eq!(stage.apply(&mut block), Ok(len));
        let moved = block.span().events != everywhere() || block.geometry != GEOMETRY;
        assert_eq!(moved, turn + 1 < times, "after {turn}");
    }
}

#[test]
fn round_trips_are_identities() {
    comes_back(2, |geometry| Box::new(FlipX::new(geometry)));
    comes_back(2, |geometry| Box::new(FlipY::new(geometry)));
    comes_back(2, |geometry| Box::new(InvertPolarity::new(geometry)));
    comes_back(2, |geometry| Box::new(Transpose::try_new(geometry).unwrap()));
    comes_back(2, |geometry| Box::new(rotate90(2)(geometry)));
    comes_back(4, |geometry| Box::new(rotate90(1)(geometry)));
    comes_back(4, |geometry| Box::new(rotate90(3)(geometry)));
    let mut turns = [1, 3].into_iter();
    comes_back(2, |geometry| Box::new(rotate90(turns.next().unwrap())(geometry)));
    let mut shifts = [12_345_678_901, -12_345_678_901].into_iter();
    comes_back(2, |geometry| Box::new(time_shift(shifts.next().unwrap())(geometry)));
    let identity = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    comes_back(1, |geometry| Box::new(perspective(identity)(geometry)));
    comes_back(1, |geometry| Box::new(resize(geometry.width, geometry.height)(geometry)));
    let ideal = BrownConrady { k1: 0.0, k2: 0.0, p1: 0.0, p2: 0.0, ..LENS };
    comes_back(1, |geometry| Box::new(undistort(CameraModel::BrownConrady(ideal))(geometry)));
}

#[test]
fn an_event_off_the_sensor_comes_never_onto_it() {
    let off = [(123, 0), (0, 45), (65_535, 32_767), (40_000, 3), (33_000, 40), (200, 32_767), (32_768, 0)];
    let stages: Vec<Box<dyn Transform>> = vec![
        Box::new(FlipX::new(GEOMETRY)),
        Box::new(FlipY::new(GEOMETRY)),
        Box::new(rotate90(1)(GEOMETRY)),
        Box::new(rotate90(2)(GEOMETRY)),
        Box::new(rotate90(3)(GEOMETRY)),
        Box::new(Transpose::try_new(GEOMETRY).unwrap()),
        Box::new(resize(61, 22)(GEOMETRY)),
        Box::new(resize(65_535, 32_767)(GEOMETRY)),
        Box::new(crop(0, 0, 123, 45)(GEOMETRY)),
        Box::new(undistort(CameraModel::BrownConrady(LENS))(GEOMETRY)),
    ];
    for (i, mut stage) in stages.into_iter().enumerate() {
        let mut events: Vec<Event> = off.iter().map(|(x, y)| Event::new(0, *x, *y, Polarity::On)).collect();
        let mut block = Block::new(0, 0, GEOMETRY, &mut events);
        stage.apply(&mut block).unwrap();
        let to = block.geometry;
        for event in block.span().events {
            assert!(!to.contains(event.x(), event.y()), "{i}: {event:?} on {to}");
        }
    }
}

#[test]
fn a_block_that_would_grow_beyond_is_refused_whole() {
    let times = [0u64, 900_000_000, 1_000_000];
    let mut events = times.map(|t| Event::new(t as u32, 1, 2, Polarity::On));
    let mut block = Block::new(0, 1_000_000, GEOMETRY, &mut events);
    let mut slow = time_scale(10.0)(GEOMETRY);
    let reach_max = slow.reach_max(SPAN_MAX_US - 1);
    assert_eq!(slow.apply(&mut block), Err(Unfit::Reach { reach_max }));
    assert_eq!(block.span().events.iter().map(|event| u64::from(event.t())).collect::<Vec<_>>(), times);
    assert_eq!((block.span().reach(), block.span().fitting(reach_max)), (900_000_000, 1));
    // At its longest a block does not grow beyond.
    let mut events = [0, reach_max].map(|t| Event::new(t as u32, 1, 2, Polarity::On));
    let mut block = Block::new(0, reach_max, GEOMETRY, &mut events);
    assert_eq!(slow.apply(&mut block), Ok(2));
    assert_eq!(block.span().time(block.span().events[1]), reach_max * 10);
}

#[test]
fn refuses_what_makes_no_transform() {
    let finite = TransformError::NotFinite { key: "matrix" };
    let nan = AffineParams { matrix: [[f64::NAN, 0.0, 0.0], [0.0; 3]] };
    assert_eq!(Affine::try_new(GEOMETRY, nan).err(), Some(finite));
    let empty = CropParams { x: 0, y: 0, width: 0, height: 5 };
    assert_eq!(Crop::try_new(GEOMETRY, empty).err(), Some(TransformError::NoPixel));
    let tall = ResizeParams { width: 5, height: 32_769 };
    assert_eq!(Resize::try_new(GEOMETRY, tall).err(), Some(TransformError::SensorTooLarge));
    let wide = Geometry::new(40_000, 5);
    assert_eq!(Transpose::try_new(wide).err(), Some(TransformError::SensorTooLarge));
    assert_eq!(Rotate90::try_new(wide, Rotate90Params { k: 1 }).err(), Some(TransformError::SensorTooLarge));
    assert!(Rotate90::try_new(wide, Rotate90Params { k: 2 }).is_ok());
    for (sx, error) in [
        (1e9, TransformError::SensorTooLarge),
        (-1.0, TransformError::NoPixel),
        (f64::NAN, TransformError::NotFinite { key: "sx" }),
    ] {
        assert_eq!(Scale::try_new(GEOMETRY, ScaleParams { sx, sy: 1.0 }).err(), Some(error));
    }
    for factor in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(TimeScale::try_new(GEOMETRY, TimeScaleParams { factor }).is_err(), "{factor}");
    }
    assert!(TimeWindow::try_new(GEOMETRY, TimeWindowParams { t0_us: 2, t1_us: 1 }).is_err());
    let camera = |fx, k1| CameraModel::BrownConrady(BrownConrady { fx, k1, ..LENS });
    let make = |camera, len| Undistort::try_new(GEOMETRY, camera, vec![0; len]).err();
    let needed = GEOMETRY.pixels();
    assert!(make(camera(0.0, 0.0), needed).is_some() && make(camera(1.0, f64::NAN), needed).is_some());
    let short = TransformError::MemoryTooShort { needed, found: needed - 1 };
    assert_eq!(make(camera(1.0, 0.0), needed - 1), Some(short));
}

#[test]
fn a_time_window_is_one_of_full_times() {
    const ANCHORS: [u64; 4] = [SPAN_MAX_US, (1 << 32) - 3, 1 << 40, u64::MAX - SPAN_MAX_US];
    const BORDERS: [i128; 9] = [-(1 << 33), -(1 << 31), 1 - (1 << 31), -1, 0, 1, 5, (1 << 31) - 1, 1 << 33];
    for anchor in ANCHORS {
        let near = |distance: i128| (i128::from(anchor) + distance).clamp(0, u64::MAX.into()) as u64;
        let all: Vec<u64> = BORDERS[1..8].iter().map(|distance| near(*distance)).collect();
        let windows = BORDERS.iter().flat_map(|low| BORDERS.iter().map(|high| (near(*low), near(*high))));
        for (t0, t1) in windows.filter(|(t0, t1)| t0 <= t1) {
            // All of them, and each part that may lie on one side of the borders.
            for times in (0..all.len()).flat_map(|from| [&all[from..], &all[..=from], &all[from..=from]]) {
                let mut events: Vec<Event> =
                    times.iter().map(|t| Event::new(*t as u32, 3, 4, Polarity::On)).collect();
                let mut block = Block::new(anchor, anchor, GEOMETRY, &mut events);
                let mut window =
                    TimeWindow::try_new(GEOMETRY, TimeWindowParams { t0_us: t0, t1_us: t1 }).unwrap();
                let kept = window.apply(&mut block).unwrap();
                let expected: Vec<u64> = times.iter().copied().filter(|t| (t0..t1).contains(t)).collect();
                let left: Vec<u64> =
                    block.span().events.iter().map(|event| block.span().time(*event)).collect();
                assert_eq!((kept, left), (expected.len(), expected), "{anchor}: {t0}..{t1} of {times:?}");
            }
        }
    }
}
