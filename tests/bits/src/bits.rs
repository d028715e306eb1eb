//! Digests of what every filter and representation makes of a fixed stream: the law "same bits everywhere".
//!
//! Three programs include this file and are compared: the test on this machine (`tests/it/bits.rs`), `tests/bits` on
//! aarch64, and the firmware. No constant is kept: what a stage should give is the matter of its own tests.

use lobula_core::filter::{
    BackgroundActivity, BackgroundActivityParams, Denoise, DenoiseParams, DoubleWindow, DoubleWindowParams,
    Neighbours, Refractory, RefractoryParams, Refresh,
};
use lobula_core::representation::{Build, Parameters};
use lobula_core::{Block, Event, Filter, Geometry, Polarity, Span, Window, for_each_representation};

const GEOMETRY: Geometry = Geometry::new(48, 32);
/// Events of a window, from one to the next in µs on average, and windows.
const EVENTS: usize = 512;
const STEP_US: u32 = 16;
const WINDOWS: usize = 4;
const WINDOW_US: u64 = EVENTS as u64 * STEP_US as u64;

/// Memory for any stage.
pub struct Memory {
    state: [u64; 16 << 10],
    out: [u64; 10 << 10],
    events: [Event; EVENTS],
}

impl Memory {
    /// In const, so that firmware can have it in a static.
    pub const fn new() -> Self {
        Self {
            state: [0; 16 << 10],
            out: [0; 10 << 10],
            events: [Event::new(0, 0, 0, Polarity::Off); EVENTS],
        }
    }
}

/// The events of a window: bursts of neighbours among noise, with steps back in time.
fn stream(window: usize, events: &mut [Event; EVENTS]) -> Window {
    let mut random = 0x9E37_79B9u32.wrapping_mul(window as u32 + 1);
    let t0 = WINDOW_US * window as u64;
    for (i, event) in events.iter_mut().enumerate() {
        random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        let [a, b, c, d] = random.to_le_bytes();
        let burst = (i / 32).is_multiple_of(2);
        let x = if burst { i as u16 / 7 % 9 + u16::from(d) % 3 } else { u16::from(d) % GEOMETRY.width };
        let y = if burst { u16::from(c) % 4 } else { u16::from(c) % GEOMETRY.height };
        let jitter = u32::from(b) % 24;
        let t = (t0 as u32 + i as u32 * STEP_US + 24 - jitter).min((t0 + WINDOW_US) as u32 - 1);
        *event = Event::new(t, x, y, Polarity::from_bit(u16::from(a) >> 7));
    }
    Window { t0, t1: t0 + WINDOW_US }
}

/// FNV-1a of 64 bits.
struct Digest(u64);

impl Digest {
    fn new() -> Self {
        Self(0xCBF2_9CE4_8422_2325)
    }

    fn extend(&mut self, bytes: &[u8]) {
        for byte in bytes {
            self.0 = (self.0 ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01B3);
        }
    }
}

/// 0 for a stage that these parameters, or this memory, make none of.
fn represent<'m, R: Build<&'m mut [u32]>>(
    state: &'m mut [u64],
    out: &mut [u64],
    events: &mut [Event; EVENTS],
) -> u64 {
    let parameters = Parameters::default();
    let state: &mut [u32] = bytemuck::cast_slice_mut(state);
    let Some(state) = state.get_mut(..R::state_len(&parameters, GEOMETRY)) else { return 0 };
    let Ok(mut stage) = R::build(&parameters, GEOMETRY, state) else { return 0 };
    let out: &mut [R::Pixel] = bytemuck::try_cast_slice_mut(out).unwrap_or_default();
    let Some(out) = out.get_mut(..stage.shape().len()) else { return 0 };
    let mut digest = Digest::new();
    for i in 0..WINDOWS {
        let window = stream(i, events);
        stage.begin(window, out);
        let (t_first, t_last) = (window.t0, window.t1 - 1);
        let span = Span { t_first, t_last, geometry: GEOMETRY, events: &events[..] };
        if stage.accumulate(span, out).is_err() {
            return 0;
        }
        stage.finish(out);
        digest.extend(bytemuck::cast_slice(out));
    }
    digest.0
}

fn thin<F: Filter, E>(made: Result<F, E>, events: &mut [Event; EVENTS]) -> u64 {
    let Ok(mut filter) = made else { return 0 };
    let mut digest = Digest::new();
    for i in 0..WINDOWS {
        let window = stream(i, events);
        let mut block = Block::new(window.t0, window.t1 - 1, GEOMETRY, &mut events[..]);
        if filter.retain(&mut block).is_err() {
            return 0;
        }
        digest.extend(bytemuck::cast_slice(block.span().events));
    }
    digest.0
}

/// Calls `tell` with the name and the digest of every representation, and of the filters that firmware is made of
/// (filters know whole numbers only).
pub fn each(memory: &mut Memory, mut tell: impl FnMut(&str, u64)) {
    macro_rules! representations {
        ($($variant:ident $kind:ident $type:ty;)*) => {$({
            let Memory { state, out, events } = &mut *memory;
            tell(stringify!($variant), represent::<$type>(state, out, events));
        })*};
    }
    for_each_representation!(representations, &mut [u32]);

    let Memory { state, events, .. } = memory;
    macro_rules! filters {
        ($($type:ident<$word:ty>, $params:expr;)*) => {$({
            let memory: &mut [$word] = bytemuck::cast_slice_mut(&mut state[..]);
            let name = concat!(stringify!($type), "<", stringify!($word), ">");
            tell(name, thin($type::try_new(GEOMETRY, $params, memory), events));
        })*};
    }
    let (support_us, shift) = (2_000, 4);
    filters! {
        Refractory<u32>, RefractoryParams { dt_us: 300, refresh: Refresh::Kept, shift: 0 };
        Refractory<u16>, RefractoryParams { dt_us: 300, refresh: Refresh::All, shift };
        BackgroundActivity<u32>, BackgroundActivityParams { dt_us: 500, neighbours: Neighbours::Eight, shift: 0 };
        BackgroundActivity<u16>, BackgroundActivityParams { dt_us: 500, neighbours: Neighbours::Four, shift };
        Denoise<u32>, DenoiseParams { support_us, trail_us: 900, ..DenoiseParams::default() };
        Denoise<u16>, DenoiseParams { support_us, shift, ..DenoiseParams::default() };
        DoubleWindow<u32>, DoubleWindowParams::default();
    }
}
