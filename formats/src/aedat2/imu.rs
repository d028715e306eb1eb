//! Samples of the inertial sensor: seven words, one for each quantity, each with its number.
//!
//! The scale is that of the MPU-6150 as jAER sets it up: 4 g and 500 °/s full scale.

use super::{Records, Word};
use crate::write::Parts;
use crate::{Error, ImuSample};

/// Standard gravity in m/s².
const GRAVITY: f64 = 9.80665;
/// Steps of a g.
const PER_G: f64 = 8192.0;
/// Steps of a °/s.
const PER_DEGREE_A_SECOND: f64 = 65.5;
/// Steps of a °C, from 35 °C on.
const PER_DEGREE: f64 = 340.0;
const TEMPERATURE_AT_0: f64 = 35.0;

/// Quantities of a sample: acceleration x, y, z, temperature, rotation x, y, z.
pub(super) const WORDS: usize = 7;

/// Samples in file order. One whose words do not follow each other is left out, as in jAER.
#[derive(Debug)]
pub(super) struct Samples {
    records: Records,
    words: [i16; WORDS],
    /// How many of the words are there.
    len: usize,
    t: u64,
}

impl Samples {
    pub fn new(records: Records) -> Self {
        Self { records, words: [0; WORDS], len: 0, t: 0 }
    }

    /// Adds a word; the sample, if it was its last.
    fn add(&mut self, which: usize, value: i16, t: u64) -> Option<ImuSample> {
        if which != self.len {
            self.len = 0;
        }
        if which != self.len {
            return None;
        }
        if which == 0 {
            self.t = t;
        }
        *self.words.get_mut(which)? = value;
        self.len += 1;
        if self.len < WORDS {
            return None;
        }
        self.len = 0;
        Some(sample(self.t, self.words))
    }
}

impl Iterator for Samples {
    type Item = Result<ImuSample, Error>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            match self.records.next()? {
                Ok((Word::Imu { which, value }, t)) => {
                    if let Some(sample) = self.add(which.into(), value, t) {
                        return Some(Ok(sample));
                    }
                }
                Ok(_) => {}
                Err(error) => return Some(Err(error)),
            }
        }
    }
}

fn sample(t: u64, [ax, ay, az, temperature, gx, gy, gz]: [i16; WORDS]) -> ImuSample {
    ImuSample {
        t,
        acceleration: [ax, ay, az].map(|value| f64::from(value) / PER_G * GRAVITY),
        rotation: [gx, gy, gz].map(|value| (f64::from(value) / PER_DEGREE_A_SECOND).to_radians()),
        magnetic_field: None,
        temperature: Some(f64::from(temperature) / PER_DEGREE + TEMPERATURE_AT_0),
    }
}

/// The words of a sample, to the nearest step; `None` where one is beyond the range. An unknown temperature is 35 °C.
pub(super) fn words(sample: &ImuSample) -> Option<[i16; WORDS]> {
    let [ax, ay, az] = sample.acceleration.map(|value| step(value / GRAVITY * PER_G));
    let [gx, gy, gz] = sample.rotation.map(|value| step(value.to_degrees() * PER_DEGREE_A_SECOND));
    let temperature = sample.temperature.map_or(Some(0), |t| step((t - TEMPERATURE_AT_0) * PER_DEGREE));
    Some([ax?, ay?, az?, temperature?, gx?, gy?, gz?])
}

/// What the words do not tell of a sample.
pub(super) fn left_out(sample: &ImuSample) -> Parts {
    let (magnetic_field, temperature_unknown) =
        (sample.magnetic_field.is_some(), sample.temperature.is_none());
    Parts { magnetic_field, temperature_unknown, ..Parts::default() }
}

fn step(value: f64) -> Option<i16> {
    let value = value.round();
    (value >= f64::from(i16::MIN) && value <= f64::from(i16::MAX)).then_some(value as i16)
}
