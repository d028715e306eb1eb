//! `sensor_msgs/Imu`.
//!
//! Spec: <https://docs.ros.org/en/api/sensor_msgs/html/msg/Imu.html>
//!
//! ```text
//! header, f64[4] orientation, f64[9] covariance, f64[3] rotation (rad/s), f64[9], f64[3] acceleration (m/s²), f64[9]
//! ```

use super::fields::{Fields, Wire};
use crate::ImuSample;

/// The sample in a message; `None` where it is damaged. `time` makes its time of µs.
pub(crate) fn sample(message: &[u8], wire: Wire, time: impl Fn(i64) -> Option<u64>) -> Option<ImuSample> {
    let mut fields = Fields::new(message, wire)?;
    let t = time(fields.header()?.us())?;
    fields.f64s::<4>()?;
    fields.f64s::<9>()?;
    let rotation = fields.f64s()?;
    fields.f64s::<9>()?;
    let acceleration = fields.f64s()?;
    fields.f64s::<9>()?;
    Some(ImuSample { t, acceleration, rotation, magnetic_field: None, temperature: None })
}
