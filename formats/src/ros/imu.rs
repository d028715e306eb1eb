//! `sensor_msgs/Imu`.
//!
//! Spec: <https://docs.ros.org/en/api/sensor_msgs/html/msg/Imu.html>
//!
//! ```text
//! header, f64[4] orientation, f64[9] covariance, f64[3] rotation (rad/s), f64[9], f64[3] acceleration (m/s²), f64[9]
//! ```

use super::fields::{Fields, Wire};
use crate::ImuSample;

/// The sample in a message; `None` where it is damaged. `time` makes its time of µs. `more` is called where it tells what
/// no sample of ours has: an orientation or a covariance.
pub(crate) fn sample(
    message: &[u8],
    wire: Wire,
    time: impl Fn(i64) -> Option<u64>,
    more: impl FnOnce(),
) -> Option<ImuSample> {
    let mut fields = Fields::new(message, wire)?;
    let t = time(fields.header()?.us())?;
    let orientation: [f64; 4] = fields.f64s()?;
    let of_orientation: [f64; 9] = fields.f64s()?;
    let rotation = fields.f64s()?;
    let of_rotation: [f64; 9] = fields.f64s()?;
    let acceleration = fields.f64s()?;
    let of_acceleration: [f64; 9] = fields.f64s()?;
    // Of a quantity that is not told the first covariance is -1; of an unknown covariance all are 0.
    let is_told =
        |covariance: [f64; 9]| covariance[0] != -1.0 && covariance.iter().any(|number| *number != 0.0);
    let is_oriented = of_orientation[0] != -1.0 && !NOT_TURNED.contains(&orientation);
    if is_oriented || [of_orientation, of_rotation, of_acceleration].into_iter().any(is_told) {
        more();
    }
    Some(ImuSample { t, acceleration, rotation, magnetic_field: None, temperature: None })
}

/// Orientations that say nothing, x, y, z, w: what drivers that know none leave there.
const NOT_TURNED: [[f64; 4]; 2] = [[0.0; 4], [0.0, 0.0, 0.0, 1.0]];

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ros::serial;
    use std::cell::Cell;

    /// Whether a message with these of its numbers changed tells more than is read.
    fn tells_more(changes: &[(usize, f64)]) -> bool {
        let told = ImuSample {
            t: 5,
            rotation: [1.0, 2.0, 3.0],
            acceleration: [4.0, 5.0, 6.0],
            ..ImuSample::default()
        };
        let more = Cell::new(false);
        for wire in [Wire::Ros1, Wire::Cdr] {
            let mut message = serial::imu(&told, 0, wire);
            let numbers = message.len() - 37 * 8;
            for (number, value) in changes {
                message[numbers + 8 * number..][..8].copy_from_slice(&value.to_le_bytes());
            }
            let found = sample(&message, wire, |t| u64::try_from(t).ok(), || more.set(true)).unwrap();
            assert_eq!((found.rotation, found.acceleration), (told.rotation, told.acceleration), "{wire:?}");
        }
        more.get()
    }

    #[test]
    fn what_is_not_read_of_a_sample_is_noticed() {
        let (orientation, first, of_orientation, of_rotation, of_acceleration) = (0, 3, 4, 16, 28);
        assert!(!tells_more(&[]));
        assert!(!tells_more(&[(of_orientation, 0.0), (first, 1.0)]));
        assert!(!tells_more(&[(of_orientation, -1.0), (orientation, 0.6), (first, 0.8)]));
        assert!(tells_more(&[(of_orientation, 0.0), (orientation, 0.6), (first, 0.8)]));
        for covariance in [of_orientation, of_rotation, of_acceleration] {
            assert!(tells_more(&[(covariance, 0.25)]));
            assert!(!tells_more(&[(covariance, -1.0)]));
        }
    }
}
