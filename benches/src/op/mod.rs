//! The operations measured: ours, and what makes the two sides' answers comparable. One file each.

pub mod background_activity;
pub mod decode;
pub mod evt21_decode;
pub mod evt2_decode;
pub mod evt3_decode;
pub mod hot_pixel;
pub mod polarity;
pub mod refractory;
pub mod tensor;
pub mod thinned;
pub mod time_surface;
pub mod voxel5;

use lobula_core::Event;

use crate::contest::Contest;
use crate::input::Scene;
use crate::peers::Library;

/// An operation of the report.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Op {
    /// EVT3 bytes to events.
    Evt3Decode,
    /// EVT 2.0 bytes to events.
    Evt2Decode,
    /// EVT 2.1 bytes to events.
    Evt21Decode,
    /// Events to counts per pixel and polarity.
    Polarity,
    /// Events to a voxel grid of 5 bins.
    Voxel5,
    /// Events to a decayed time surface per polarity.
    TimeSurface,
    /// Events without those that follow too soon at their pixel.
    Refractory,
    /// Events without those that no neighbour supports.
    BackgroundActivity,
    /// Events without those of pixels that fire far too often.
    HotPixel,
}

impl Op {
    /// Every operation, in the order of the report.
    pub const ALL: [Self; 9] = [
        Self::Evt3Decode,
        Self::Evt2Decode,
        Self::Evt21Decode,
        Self::Polarity,
        Self::Voxel5,
        Self::TimeSurface,
        Self::Refractory,
        Self::BackgroundActivity,
        Self::HotPixel,
    ];

    /// The name in reports and of `--only`.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Evt3Decode => evt3_decode::NAME,
            Self::Evt2Decode => evt2_decode::NAME,
            Self::Evt21Decode => evt21_decode::NAME,
            Self::Polarity => polarity::NAME,
            Self::Voxel5 => voxel5::NAME,
            Self::TimeSurface => time_surface::NAME,
            Self::Refractory => refractory::NAME,
            Self::BackgroundActivity => background_activity::NAME,
            Self::HotPixel => hot_pixel::NAME,
        }
    }

    /// Its contests, in both protocols and with every kernel this machine has.
    ///
    /// # Errors
    /// A sentence, where the two sides' answers differ.
    pub fn contests<'a>(
        self,
        scene: &'a Scene,
        peer: Option<&'a dyn Library>,
    ) -> Result<Vec<Contest<'a>>, String> {
        match self {
            Self::Evt3Decode => evt3_decode::contests(scene, peer),
            Self::Evt2Decode => evt2_decode::contests(scene, peer),
            Self::Evt21Decode => evt21_decode::contests(scene, peer),
            Self::Polarity => polarity::contests(scene, peer),
            Self::Voxel5 => voxel5::contests(scene, peer),
            Self::TimeSurface => time_surface::contests(scene, peer),
            Self::Refractory => refractory::contests(scene, peer),
            Self::BackgroundActivity => background_activity::contests(scene, peer),
            Self::HotPixel => hot_pixel::contests(scene, peer),
        }
    }
}

/// Whether both sides give the same events in the same order.
fn same_events(ours: &[Event], theirs: &[Event]) -> Result<(), String> {
    let differ = ours.iter().zip(theirs).position(|(a, b)| a != b);
    match differ {
        Some(i) => Err(format!("event {i} differs: ours {:?}, theirs {:?}", ours[i], theirs[i])),
        None if ours.len() != theirs.len() => {
            Err(format!("ours {} events, theirs {}", ours.len(), theirs.len()))
        }
        None => Ok(()),
    }
}
