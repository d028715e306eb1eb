//! Messages to bytes: the inverse of `fields`, with the same rules of both ways to serialise.

use super::event_packet;
use super::fields::{CDR_HEAD, Wire};
use super::image;
use crate::write::Parts;
use crate::{Frame, ImuSample};
use lobula_core::Geometry;

/// Name of the frame of reference in every header.
const FRAME: &str = "camera";

/// A message being serialised.
#[derive(Debug)]
pub(crate) struct Serial {
    bytes: Vec<u8>,
    wire: Wire,
}

/// Seconds and nanoseconds of a time in µs.
pub(crate) fn stamp(t_us: u64) -> (u32, u32) {
    ((t_us / 1_000_000) as u32, (t_us % 1_000_000 * 1000) as u32)
}

impl Serial {
    pub fn new(wire: Wire) -> Self {
        let bytes = if wire == Wire::Cdr { CDR_HEAD.to_vec() } else { Vec::new() };
        Self { bytes, wire }
    }

    pub fn finish(self) -> Vec<u8> {
        self.bytes
    }

    fn number<const N: usize>(&mut self, number: [u8; N]) {
        if self.wire == Wire::Cdr {
            let at = self.bytes.len() - CDR_HEAD.len();
            self.bytes.resize(CDR_HEAD.len() + at.next_multiple_of(N), 0);
        }
        self.bytes.extend(number);
    }

    pub fn u8(&mut self, value: u8) {
        self.number([value]);
    }

    pub fn u32(&mut self, value: u32) {
        self.number(value.to_le_bytes());
    }

    pub fn u64(&mut self, value: u64) {
        self.number(value.to_le_bytes());
    }

    pub fn f64s(&mut self, values: &[f64]) {
        values.iter().for_each(|value| self.number(value.to_le_bytes()));
    }

    pub fn string(&mut self, text: &str) {
        let closed = usize::from(self.wire == Wire::Cdr);
        self.u32((text.len() + closed) as u32);
        self.bytes.extend(text.as_bytes());
        self.bytes.extend(&[0][..closed]);
    }

    /// An array of bytes of any length.
    pub fn array(&mut self, bytes: &[u8]) {
        self.u32(bytes.len() as u32);
        self.bytes.extend(bytes);
    }

    /// Bytes as they are.
    pub fn raw(&mut self, bytes: &[u8]) {
        self.bytes.extend(bytes);
    }

    pub fn header(&mut self, seq: u32, t_us: u64) {
        if self.wire == Wire::Ros1 {
            self.u32(seq);
        }
        let (s, ns) = stamp(t_us);
        self.u32(s);
        self.u32(ns);
        self.string(FRAME);
    }
}

/// `sensor_msgs/Imu`. Orientation is not known, which is told by a covariance of -1.
pub(crate) fn imu(sample: &ImuSample, seq: u32, wire: Wire) -> Vec<u8> {
    let mut serial = Serial::new(wire);
    serial.header(seq, sample.t);
    serial.f64s(&[0.0, 0.0, 0.0, 1.0]);
    serial.f64s(&[-1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    serial.f64s(&sample.rotation);
    serial.f64s(&[0.0; 9]);
    serial.f64s(&sample.acceleration);
    serial.f64s(&[0.0; 9]);
    serial.finish()
}

/// What [`imu`] has no place for.
pub(crate) fn parts_of_imu(sample: &ImuSample) -> Parts {
    let (magnetic_field, temperature) = (sample.magnetic_field.is_some(), sample.temperature.is_some());
    Parts { magnetic_field, temperature, ..Parts::default() }
}

/// `sensor_msgs/Image`.
pub(crate) fn image(frame: &Frame, seq: u32, wire: Wire) -> Vec<u8> {
    let mut serial = Serial::new(wire);
    serial.header(seq, frame.t);
    serial.u32(frame.height.into());
    serial.u32(frame.width.into());
    serial.string(image::encoding(frame.format));
    serial.u8(0);
    serial.u32(u32::from(frame.width) * frame.format.bytes() as u32);
    serial.array(&frame.pixels);
    serial.finish()
}

/// What [`image`] has no place for.
pub(crate) fn parts_of_image(frame: &Frame) -> Parts {
    let (exposure, position) = (frame.exposure.is_some(), (frame.x, frame.y) != (0, 0));
    Parts { exposure, position, ..Parts::default() }
}

/// `dvs_msgs/EventArray` of ROS 1, with its events as they stand in the message.
pub(crate) fn event_array(events: &[u8], count: u32, geometry: Geometry, seq: u32, t_us: u64) -> Vec<u8> {
    let mut serial = Serial::new(Wire::Ros1);
    serial.header(seq, t_us);
    serial.u32(geometry.height.into());
    serial.u32(geometry.width.into());
    serial.u32(count);
    serial.raw(events);
    serial.finish()
}

/// `event_camera_msgs/EventPacket` of EVT3 bytes.
pub(crate) fn event_packet(events: &[u8], geometry: Geometry, seq: u64, t_us: u64, wire: Wire) -> Vec<u8> {
    let mut serial = Serial::new(wire);
    serial.header(seq as u32, t_us);
    serial.u32(geometry.height.into());
    serial.u32(geometry.width.into());
    serial.u64(seq);
    serial.u64(0); // time_base, which EVT3 does not use
    serial.string(event_packet::EVT3);
    serial.u8(0);
    serial.array(events);
    serial.finish()
}
