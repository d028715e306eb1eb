//! The operations measured: ours, and what makes the two sides' answers comparable. One file each.

pub mod decode;
pub mod fused;
pub mod moved;
pub mod tensor;
pub mod thinned;

use lobula_core::{Block, Event};
use lobula_formats::LargeArray;

use crate::contest::Contest;
use crate::input::{Scene, block_of, packets};
use crate::peers::Library;

/// Declares the operations, in the order of the report. Each is a file with a `NAME`, that of reports and of `--only`,
/// and `contests`.
macro_rules! ops {
    ($($variant:ident $module:ident: $what:literal;)*) => {
        $(pub mod $module;)*

        /// An operation of the report.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum Op {
            $(#[doc = $what] $variant,)*
        }

        impl Op {
            /// Every operation, in the order of the report.
            pub const ALL: &[Self] = &[$(Self::$variant,)*];

            /// The name in reports and of `--only`.
            pub const fn name(self) -> &'static str {
                match self {
                    $(Self::$variant => $module::NAME,)*
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
                    $(Self::$variant => $module::contests(scene, peer),)*
                }
            }
        }
    };
}

ops! {
    Evt3Decode evt3_decode: "EVT3 bytes to events.";
    Evt2Decode evt2_decode: "EVT 2.0 bytes to events.";
    Evt21Decode evt21_decode: "EVT 2.1 bytes to events.";
    Polarity polarity: "Events to counts per pixel and polarity.";
    Voxel5 voxel5: "Events to a voxel grid of 5 bins.";
    ReplayVoxel5 replay_voxel5: "EVT3 bytes to a voxel grid of 5 bins for each millisecond.";
    TimeSurface time_surface: "Events to a decayed time surface per polarity.";
    Count count: "Events to counts per pixel.";
    SlidingCount sliding_count: "Events to counts per pixel of windows that overlap.";
    Binary binary: "Events to which pixels had any.";
    PolarityShare polarity_share: "Events to counts per pixel and polarity, as shares of the greatest.";
    AveragedTimeSurface averaged_time_surface: "Events to the mean decay per pixel and polarity.";
    Mcts mcts: "Events to surfaces of five scales per polarity.";
    Tencode tencode: "Events to the colour of the last one per pixel.";
    Countmask countmask: "Events to an image of clipped counts.";
    RedBlue red_blue: "Events to an image of the prevailing polarity.";
    EventImage event_image: "Events to an image of the last one's colour, fading.";
    Voxel5Share voxel5_share: "Events to a voxel grid of 5 bins of mean 0 and deviation 1.";
    FilePolarity file_polarity: "EVT3 bytes to counts per pixel and polarity.";
    FileVoxel5 file_voxel5: "EVT3 bytes to a voxel grid of 5 bins.";
    FileTimeSurface file_time_surface: "EVT3 bytes to a decayed time surface per polarity.";
    Refractory refractory: "Events without those that follow too soon at their pixel.";
    BackgroundActivity background_activity: "Events without those that no neighbour supports.";
    HotPixel hot_pixel: "Events without those of pixels that fire far too often.";
    Decimate decimate: "Every n-th event.";
    Mask mask: "Events of a set of pixels.";
    Denoise denoise: "Events without those of hot pixels, that follow too soon or that too few neighbours support, in one pass.";
    Stcf stcf: "Events without those that fewer than 2 of 8 neighbours support.";
    DoubleWindow double_window: "Events without those that are far from the last ones.";
    Trail trail: "Events that are the first of their burst.";
    Inceptive inceptive: "Inceptive events.";
    LeakyHotPixel leaky_hot_pixel: "Events without those of pixels whose leaky counter is full.";
    AntiFlicker anti_flicker: "Events without those of tiles that flicker.";
    RateLimit rate_limit: "Events up to a budget a period, of all tiles.";
    Crop crop: "Events of a rectangle, which becomes the sensor.";
    FlipX flip_x: "Events mirrored left to right.";
    Rotate90 rotate90: "Events turned by a quarter.";
    Transpose transpose: "Events with x and y in exchange.";
    Translate translate: "Events moved by whole pixels.";
    Resize resize: "Events at another resolution.";
    ResizeHalf resize_half: "Events at half the resolution.";
    WarpAffine warp_affine: "Events moved by an affine map.";
    WarpPerspective warp_perspective: "Events moved by a perspective map.";
    Undistort undistort: "Events without the distortion of the lens.";
    InvertPolarity invert_polarity: "Events with ON and OFF in exchange.";
    TimeShift time_shift: "Events moved in time.";
    TimeScale time_scale: "Events in slow motion.";
    EventDrop event_drop: "Events without a random half.";
    PixelDropout pixel_dropout: "Events without those of random pixels.";
    SpatialJitter spatial_jitter: "Events moved by normal deviates.";
    SortByTime sort_by_time: "Events in order of time.";
}

/// The scene's events as `stage` leaves them, in a fresh array: each packet is worked on where it will stay.
///
/// # Errors
/// A sentence, where there is no memory or the stage refuses a packet.
fn worked_on(
    scene: &Scene,
    mut stage: impl FnMut(&mut Block<'_>) -> Result<usize, String>,
) -> Result<LargeArray<Event>, String> {
    let mut events = LargeArray::zeroed(scene.events.len()).map_err(|e| e.to_string())?;
    let mut left = 0;
    for packet in packets(scene.span(scene.events.len())) {
        left += stage(&mut block_of(packet, &mut events[left..]))?;
    }
    events.truncate(left);
    Ok(events)
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
