//! The operations measured: ours, and what makes the two sides' answers comparable. One file each.

pub mod decode;
pub mod fused;
pub mod moved;
pub mod statistics;
pub mod tensor;
pub mod tensor_end;
pub mod thinned;

use lobula_core::augmentation::{self as random, ChanceParams};
use lobula_core::chain::StageSpec;
use lobula_core::filter::{PolarityParams, RegionParams};
use lobula_core::representation;
use lobula_core::transform::{
    NoParams, ResizeParams, Rotate90Params, ScaleParams, TimeScaleParams, TimeShiftParams, TimeWindowParams,
    TranslateParams,
};
use lobula_core::{Block, Event, Polarity, Span};
use lobula_formats::LargeArray;

use crate::contest::Contest;
use crate::input::{Scene, block_of, packets};
use crate::peers::Library;

/// The contests of an operation in both protocols and with every kernel this machine has, or a sentence where the two
/// sides' answers differ.
type Contests = for<'a> fn(Op, &'a Scene, Option<&'a dyn Library>) -> Result<Vec<Contest<'a>>, String>;

/// Declares the operations, in the order of the report, each with its name in reports and of `--only`. An operation is a
/// file of that name with `contests`, or, where a line says all there is to say, [`Contests`] here.
macro_rules! ops {
    (@file $module:ident) => { pub mod $module; };
    (@file $module:ident $contests:expr) => {};
    (@contests $module:ident) => { |_, scene, peer| $module::contests(scene, peer) };
    (@contests $module:ident $contests:expr) => { $contests };
    ($($variant:ident $module:ident: $what:literal $(= $contests:expr)?;)*) => {
        $(ops!(@file $module $($contests)?);)*

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
                    $(Self::$variant => stringify!($module),)*
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
                let contests: Contests = match self {
                    $(Self::$variant => ops!(@contests $module $($contests)?),)*
                };
                contests(self, scene, peer)
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
    CountU16 count_u16: "Events to counts per pixel of two bytes, which many events do not fill." = count::wide;
    SlidingCount sliding_count: "Events to counts per pixel of windows that overlap.";
    Binary binary: "Events to which pixels had any.";
    PolarityShare polarity_share: "Events to counts per pixel and polarity, as shares of the greatest.";
    AveragedTimeSurface averaged_time_surface: "Events to the mean decay per pixel and polarity.";
    Mcts mcts: "Events to surfaces of five scales per polarity.";
    Tencode tencode: "Events to the colour of the last one per pixel.";
    Countmask countmask: "Events to an image of clipped counts.";
    RedBlue red_blue: "Events to an image of the prevailing polarity.";
    EventImage event_image: "Events to an image of the last one's colour, fading.";
    StackedHistogram stacked_histogram: "Events to counts per pixel, polarity and part of the window."
        = tensor::of_defaults::<representation::StackedHistogram>;
    MixedDensityStack mixed_density_stack: "Events to the last polarity per pixel in ever shorter parts of the window."
        = tensor::of_defaults::<representation::MixedDensityStack>;
    EventSpikeTensor event_spike_tensor: "Events to bins of their times."
        = tensor::of_defaults::<representation::EventSpikeTensor>;
    Tore tore: "Events to the logarithms of the last ages per pixel and polarity."
        = tensor::of_defaults::<representation::Tore<Vec<u32>>>;
    Sits sits: "Events to ranks in their neighbourhood." = tensor::of_defaults::<representation::Sits<Vec<u32>>>;
    Tos tos: "Events to their order in their neighbourhood." = tensor::of_defaults::<representation::Tos<Vec<u32>>>;
    TensorResize tensor_resize: "A tensor at half the resolution." = tensor_end::resize;
    TensorBytes tensor_bytes: "A tensor as bytes." = tensor_end::bytes;
    EventRate event_rate: "Events to their number in each millisecond." = statistics::event_rate;
    Intervals intervals: "Events to the times between two at a pixel." = statistics::intervals;
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
    KeepPolarity keep_polarity: "Events of one polarity."
        = |op, scene, peer| thinned::of_settings(op, scene, peer, StageSpec::Polarity(ON));
    RegionOfInterest region_of_interest: "Events of a rectangle."
        = |op, scene, _| thinned::of_settings(op, scene, None, StageSpec::RegionOfInterest(MIDDLE));
    Crop crop: "Events of a rectangle, which becomes the sensor.";
    FlipX flip_x: "Events mirrored left to right."
        = |op, scene, peer| moved::of_settings(op, scene, peer, StageSpec::FlipX(NoParams {}));
    FlipY flip_y: "Events mirrored top to bottom."
        = |op, scene, peer| moved::of_settings(op, scene, peer, StageSpec::FlipY(NoParams {}));
    Rotate90 rotate90: "Events turned by a quarter."
        = |op, scene, peer| moved::of_settings(op, scene, peer, StageSpec::Rotate90(Rotate90Params { k: 1 }));
    Transpose transpose: "Events with x and y in exchange.";
    Translate translate: "Events moved by whole pixels."
        = |op, scene, peer| moved::of_settings(op, scene, peer, StageSpec::Translate(TranslateParams { dx: 50, dy: -20 }));
    Resize resize: "Events at another resolution."
        = |op, scene, peer| moved::of_settings(op, scene, peer, StageSpec::Resize(ResizeParams { width: 346, height: 260 }));
    ResizeHalf resize_half: "Events at half the resolution."
        = |op, scene, peer| moved::of_settings(op, scene, peer, StageSpec::Resize(ResizeParams { width: 640, height: 360 }));
    Scale scale: "Events at half the resolution, told as a factor."
        = |op, scene, peer| moved::of_settings(op, scene, peer, StageSpec::Scale(HALF));
    WarpAffine warp_affine: "Events moved by an affine map.";
    WarpPerspective warp_perspective: "Events moved by a perspective map.";
    Undistort undistort: "Events without the distortion of the lens.";
    InvertPolarity invert_polarity: "Events with ON and OFF in exchange."
        = |op, scene, peer| moved::of_settings(op, scene, peer, StageSpec::InvertPolarity(NoParams {}));
    TimeShift time_shift: "Events moved in time."
        = |op, scene, peer| moved::of_settings(op, scene, peer, StageSpec::TimeShift(TimeShiftParams { dt_us: 12_345 }));
    TimeScale time_scale: "Events in slow motion."
        = |op, scene, peer| moved::of_settings(op, scene, peer, StageSpec::TimeScale(TimeScaleParams { factor: 2.5 }));
    TimeWindow time_window: "Events of the middle half of the time." = |op, scene, peer| {
        let all = scene.span(scene.events.len());
        let (t0_us, t1_us) = middle_half(all.t_first, all.t_last);
        moved::of_settings(op, scene, peer, StageSpec::TimeWindow(TimeWindowParams { t0_us, t1_us }))
    };
    NormalizeTime normalize_time: "Events whose time begins at 0."
        = |op, scene, peer| moved::of_settings(op, scene, peer, StageSpec::NormalizeTime(NoParams {}));
    EventDrop event_drop: "Events without a random half.";
    PixelDropout pixel_dropout: "Events without those of random pixels.";
    SpatialJitter spatial_jitter: "Events moved by normal deviates.";
    TimeJitter time_jitter: "Events moved in time by normal deviates; the peer sorts them afterwards."
        = |op, scene, peer| moved::at_random(op, scene, peer, random::TimeJitter::try_new, JITTER);
    RandomFlipX random_flip_x: "Events mirrored left to right, by chance."
        = |op, scene, peer| moved::at_random(op, scene, peer, random::RandomFlipX::try_new, ALWAYS);
    RandomFlipY random_flip_y: "Events mirrored top to bottom, by chance."
        = |op, scene, peer| moved::at_random(op, scene, peer, random::RandomFlipY::try_new, ALWAYS);
    RandomPolarityFlip random_polarity_flip: "Events with ON and OFF in exchange, by chance."
        = |op, scene, peer| moved::at_random(op, scene, peer, random::RandomPolarityFlip::try_new, ALWAYS);
    RandomCrop random_crop: "Events of a random rectangle."
        = |op, scene, peer| moved::at_random(op, scene, peer, random::RandomCrop::try_new, QUARTER);
    RandomRotation random_rotation: "Events turned by a random angle."
        = |op, scene, _| moved::at_random(op, scene, None, random::RandomRotation::try_new, ROTATION);
    RandomTranslation random_translation: "Events moved by random whole pixels."
        = |op, scene, _| moved::at_random(op, scene, None, random::RandomTranslation::try_new, TRANSLATION);
    DropByArea drop_by_area: "Events without those of a random rectangle."
        = |op, scene, _| moved::at_random(op, scene, None, random::DropByArea::try_new, AREA);
    Merge merge: "Two streams as one, in order of time.";
    SortByTime sort_by_time: "Events in order of time.";
}

/// The chance of what shall happen.
const ALWAYS: ChanceParams = ChanceParams { p: 1.0 };
const ON: PolarityParams = PolarityParams { keep: Polarity::On };
const MIDDLE: RegionParams = RegionParams { x: 160, y: 120, width: 960, height: 480 };
const HALF: ScaleParams = ScaleParams { sx: 0.5, sy: 0.5 };
const JITTER: random::TimeJitterParams = random::TimeJitterParams { sigma_us: 10.0 };
const QUARTER: random::RandomCropParams = random::RandomCropParams { width: 640, height: 360 };
const ROTATION: random::RandomRotationParams = random::RandomRotationParams { degrees_max: 30.0 };
const TRANSLATION: random::RandomTranslationParams =
    random::RandomTranslationParams { dx_max: 50, dy_max: 50 };
const AREA: random::DropByAreaParams = random::DropByAreaParams { ratio: 0.5 };

/// The middle half of a span of time.
pub fn middle_half(first: u64, last: u64) -> (u64, u64) {
    let quarter = (last - first) / 4;
    (first + quarter, last - quarter)
}

/// Bytes of an array up to which glibc, once it has freed one, gives the same memory again: what a program that works on
/// slice after slice gets, and what the peer gets inside its calls. Beyond, every array is mapped anew.
const REUSED_BYTES: usize = 32 << 20;

/// Events in a fresh array.
#[derive(Debug)]
pub enum Events {
    /// From the allocator, as far as it may reuse memory.
    Allocated(Vec<Event>),
    /// Mapped on large pages.
    Mapped(LargeArray<Event>),
}

impl std::ops::Deref for Events {
    type Target = [Event];

    fn deref(&self) -> &[Event] {
        match self {
            Self::Allocated(events) => events,
            Self::Mapped(events) => events,
        }
    }
}

/// The scene's events as `stage` leaves them, in a fresh array: each packet is worked on where it will stay.
///
/// # Errors
/// A sentence, where there is no memory or the stage refuses a packet.
fn worked_on(
    scene: &Scene,
    mut stage: impl FnMut(&mut Block<'_>) -> Result<usize, String>,
) -> Result<Events, String> {
    let packets = packets(scene.span(scene.events.len()));
    if size_of_val(&scene.events[..]) < REUSED_BYTES {
        let mut events = Vec::with_capacity(scene.events.len());
        for Span { t_first, t_last, geometry, events: packet } in packets {
            let start = events.len();
            events.extend_from_slice(packet);
            let left = stage(&mut Block::new(t_first, t_last, geometry, &mut events[start..]))?;
            events.truncate(start + left);
        }
        return Ok(Events::Allocated(events));
    }
    let mut events = LargeArray::zeroed(scene.events.len()).map_err(|e| e.to_string())?;
    let mut left = 0;
    for packet in packets {
        left += stage(&mut block_of(packet, &mut events[left..]))?;
    }
    events.truncate(left);
    Ok(Events::Mapped(events))
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
