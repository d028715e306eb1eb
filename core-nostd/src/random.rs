//! Pseudo-random integers: SplitMix64 (Steele, Lea, Flood 2014, 10.1145/2660193.2660195).
//!
//! Its state is a counter and its output a function of that, so number n of a generator is had without those before it.

/// A generator; the same seed gives the same numbers everywhere.
#[derive(Clone, Debug)]
pub(crate) struct Random(u64);

const STEP: u64 = 0x9E37_79B9_7F4A_7C15;

#[inline(always)]
const fn mixed(z: u64) -> u64 {
    let z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

impl Random {
    /// The generator number `stream` of a seed: streams of one seed are unrelated.
    pub(crate) const fn new(seed: u64, stream: u64) -> Self {
        Self(seed ^ stream.wrapping_mul(0xD1B5_4A32_D192_ED03))
    }

    #[inline(always)]
    pub(crate) const fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(STEP);
        mixed(self.0)
    }

    /// Number `n` from here, as after `n` others.
    #[inline(always)]
    pub(crate) const fn at(&self, n: u64) -> u64 {
        mixed(self.0.wrapping_add(n.wrapping_add(1).wrapping_mul(STEP)))
    }

    /// Uniform in `0..n`; 0 for `n` = 0.
    pub(crate) const fn below(&mut self, n: u32) -> u32 {
        (((self.next() >> 32) * n as u64) >> 32) as u32
    }

    /// A generator unrelated to this one, for each number.
    pub(crate) const fn fork(&self, n: u64) -> Self {
        Self(mixed(self.at(n)))
    }

    /// Uniform in `low..=high`.
    pub(crate) const fn between(&mut self, low: i32, high: i32) -> i32 {
        low.wrapping_add(self.below((high - low + 1) as u32) as i32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Numbers 0 to 4 of seed 1234567, as in the table that accompanies the generator's reference implementations.
    #[test]
    fn is_splitmix64_and_a_function_of_the_counter() {
        let expected = [
            6457827717110365317,
            3203168211198807973,
            9817491932198370423,
            4593380528125082431,
            16408922859458223821,
        ];
        let start = Random::new(1234567, 0);
        let mut random = start.clone();
        for (n, number) in expected.into_iter().enumerate() {
            assert_eq!((random.next(), start.at(n as u64)), (number, number));
        }
    }
}
