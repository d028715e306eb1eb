//! What the kernels for x86-64 CPUs with AVX-512 (Ice Lake, Zen 4 and later) share: 16 lanes of 32 bits.

use super::evt2::Limits;
use super::steady::Steady;
use super::time_high::LOW_BITS;
use crate::Event;
use bytemuck::cast;
use core::arch::x86_64::*;

/// Words of a block.
pub(super) const LANES: usize = 16;

/// For each lane a bit for every lane up to it.
const UP_TO: [u32; LANES] = bits_to_lane(1);
/// For each lane a bit for every lane before it.
pub(super) const BEFORE: [u32; LANES] = bits_to_lane(0);

const fn bits_to_lane(own: u32) -> [u32; LANES] {
    let mut lanes = [0; LANES];
    let mut i = 0;
    while i < LANES {
        lanes[i] = (1 << (i as u32 + own)) - 1;
        i += 1;
    }
    lanes
}

/// Lanes of two tables in turn, in two halves: 0 of the first, 0 of the second (which counts as 16), 1, 1, ...
const IN_TURN: [[u32; LANES]; 2] = {
    let mut halves = [[0; LANES]; 2];
    let mut i = 0;
    while i < 2 * LANES {
        halves[i / LANES][i % LANES] = (i % 2 * LANES + i / 2) as u32;
        i += 1;
    }
    halves
};

/// Events that a block stores when no word makes more than two.
pub(super) const FEW: usize = 2 * LANES;

/// The same order of lanes in one list of bytes.
const IN_TURN_BYTES: [u8; FEW] = {
    let mut lanes = [0; FEW];
    let mut i = 0;
    while i < FEW {
        lanes[i] = IN_TURN[i / LANES][i % LANES] as u8;
        i += 1;
    }
    lanes
};

/// A CPU that has what the kernels are compiled for: there is no other way to get one than to look.
#[derive(Clone, Copy, Debug)]
pub struct Cpu(());

impl Cpu {
    /// Looks at the CPU that this runs on.
    #[cfg(any(test, feature = "std"))]
    pub fn detect() -> Option<Self> {
        use std::arch::is_x86_feature_detected as has;
        let all = has!("avx512f")
            && has!("avx512bw")
            && has!("avx512cd")
            && has!("avx512vl")
            && has!("avx512vbmi2")
            && has!("avx512vpopcntdq")
            && has!("bmi1")
            && has!("bmi2")
            && has!("popcnt");
        all.then_some(Self(()))
    }

    /// Looks at what this is compiled for.
    #[cfg(not(any(test, feature = "std")))]
    pub fn detect() -> Option<Self> {
        let all = cfg!(all(
            target_feature = "avx512f",
            target_feature = "avx512bw",
            target_feature = "avx512cd",
            target_feature = "avx512vl",
            target_feature = "avx512vbmi2",
            target_feature = "avx512vpopcntdq",
            target_feature = "bmi1",
            target_feature = "bmi2",
            target_feature = "popcnt"
        ));
        all.then_some(Self(()))
    }
}

#[inline]
#[target_feature(enable = "avx512f")]
pub(super) fn splat(value: u32) -> __m512i {
    _mm512_set1_epi32(value as i32)
}

/// For each lane what `table` holds in the last lane of `lanes` up to it; where there is none, what `before` holds in
/// its last lane: without ones the leading zeros are 32, of which the complement names that lane.
#[inline]
#[target_feature(enable = "avx512f,avx512cd")]
pub(super) fn fill(table: __m512i, lanes: u16, before: __m512i) -> __m512i {
    let up_to = _mm512_and_si512(_mm512_broadcastmw_epi32(lanes), cast(UP_TO));
    let index = _mm512_xor_si512(_mm512_lzcnt_epi32(up_to), splat(u32::MAX));
    _mm512_permutex2var_epi32(table, index, before)
}

/// Events of their times and upper halves.
#[inline]
#[target_feature(enable = "avx512f")]
pub(super) fn interleave(time: __m512i, upper: __m512i) -> [Event; LANES] {
    let half = |lanes: [u32; LANES]| _mm512_permutex2var_epi32(time, cast(lanes), upper);
    cast(IN_TURN.map(half))
}

/// Writes the events of a block none of whose words makes more than two, and returns how many: of the lanes named by
/// `makes`, which make one and which a second. Upper halves are of the first and of the last event of each lane.
#[inline]
#[target_feature(enable = "avx512f,avx512bw,avx512vl,avx512vbmi2,bmi2,popcnt")]
pub(super) fn store_few(
    time: __m512i,
    [first, last]: [__m512i; 2],
    makes: [u16; 2],
    out: &mut [Event; FEW],
) -> usize {
    let [one, two] = makes.map(u32::from);
    let list = _pdep_u32(one, 0x5555_5555) | _pdep_u32(two, 0xAAAA_AAAA);
    let events = list.count_ones() as usize;
    let list: [__m128i; 2] = cast(_mm256_maskz_compress_epi8(list, cast(IN_TURN_BYTES)));
    let (halves, _) = out.as_chunks_mut::<LANES>();
    for ((half, lanes), before) in halves.iter_mut().zip(list).zip([0, LANES]) {
        if events > before {
            let lanes = _mm512_cvtepu8_epi32(lanes);
            let upper = _mm512_permutex2var_epi32(first, lanes, last);
            *half = interleave(_mm512_permutexvar_epi32(lanes, time), upper);
        }
    }
    events
}

/// A block of EVT 2.0 words, or of the upper halves of EVT 2.1, understood.
pub(super) struct Heads {
    /// Number of lanes before the first that is not steady.
    pub steady: usize,
    /// Those of them that are events.
    pub events: u16,
    /// For each lane the time of low bits 0; of the last, what holds after the block.
    pub base: __m512i,
    /// For each lane the upper half of its event, for EVT 2.1 that of bit 0.
    pub pixel: __m512i,
    /// The time's low bits.
    low: __m512i,
}

impl Heads {
    /// Of the words of a block, of which `events_may` names the lanes that can be events; the last lane of `before` holds
    /// the base before it.
    #[inline]
    #[target_feature(enable = "avx512f,avx512bw,avx512cd")]
    pub fn new(words: __m512i, events_may: u16, before: __m512i, steady: &Steady) -> Self {
        let x = _mm512_and_si512(_mm512_srli_epi32::<11>(words), splat(0x7FF));
        let y = _mm512_and_si512(_mm512_slli_epi32::<16>(words), splat(0x7FF_0000));
        let coordinates = _mm512_or_si512(x, y);
        let on = _mm512_and_si512(_mm512_slli_epi32::<3>(words), splat(1 << 31));
        let guards =
            _mm512_and_si512(_mm512_sub_epi32(splat(steady.limits.0), coordinates), splat(Limits::GUARDS));
        let on_sensor = _mm512_cmpeq_epi32_mask(guards, splat(Limits::GUARDS));
        let events = _mm512_cmplt_epu32_mask(words, splat(2 << 28)) & on_sensor & events_may;
        let told = _mm512_sub_epi32(words, splat(steady.reach.first));
        let times = _mm512_cmplt_epu32_mask(told, splat(steady.reach.count));
        let count = (events | times).trailing_ones();
        let taken = ((1u32 << count) - 1) as u16;
        let times = times & taken;
        let base = if times == 0 {
            // The same for all lanes but after a block with TIME_HIGH words.
            _mm512_permutexvar_epi32(splat(LANES as u32 - 1), before)
        } else {
            fill(_mm512_slli_epi32::<LOW_BITS>(words), times, before)
        };
        let low = _mm512_and_si512(_mm512_srli_epi32::<22>(words), splat(0x3F));
        Self {
            steady: count as usize,
            events: events & taken,
            base,
            pixel: _mm512_or_si512(coordinates, on),
            low,
        }
    }

    /// For each lane the time of its event.
    #[inline]
    #[target_feature(enable = "avx512f")]
    pub fn time(&self) -> __m512i {
        _mm512_or_si512(self.base, self.low)
    }
}
