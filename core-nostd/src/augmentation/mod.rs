//! Augmentations: random changes of a slice, for training.
//!
//! | kind | what it does |
//! |---|---|
//! | [`EventDrop`] | drops each event with probability p |
//! | [`PixelDropout`] | drops all events of each pixel with probability p |
//! | [`DropByTime`] | drops a random stretch of the slice's time |
//! | [`DropByArea`] | drops a random rectangle |
//! | [`SpatialJitter`], [`TimeJitter`] | moves each event by normal deviates |
//! | [`RandomFlipX`], [`RandomFlipY`], [`RandomPolarityFlip`] | changes the whole slice with probability p, or leaves it |
//! | [`RandomRotation`], [`RandomTranslation`] | moves the whole slice by a random angle, or by random pixels |
//! | [`RandomCrop`] | crops to a random rectangle of a given size |
//! | [`RandomTimeReversal`] | plays the whole slice backwards with probability p |
//! | [`NoiseInjection`] | adds events that no light made |
//!
//! Each is made anew for each slice, of a [`Seed`], which is a number for the run and that of the slice. What becomes of
//! an event is a function of these, of its number within the slice and of itself: the order in which slices are
//! read, the blocks they come in and the thread that reads them change nothing. Two augmentations of one seed are
//! unrelated. Numbers are of SplitMix64, counted and not drawn in turn, and the same on every machine.
//!
//! Those up to `RandomCrop` are transforms (and `p = 0` and `p = 1` do exactly nothing and all); the last two need the
//! whole slice, or room for more events.

mod area;
mod chance;
mod event_drop;
mod jitter;
mod noise;
mod normal;
mod pixel_dropout;
mod placement;
mod sometimes;
mod time_reversal;
mod time_span;

pub use area::{DropByArea, DropByAreaParams};
pub use chance::ChanceParams;
pub use event_drop::EventDrop;
pub use jitter::{SpatialJitter, SpatialJitterParams, TimeJitter, TimeJitterParams};
pub use noise::{NoiseInjection, NoiseInjectionParams};
pub use pixel_dropout::PixelDropout;
pub use placement::{
    RandomCrop, RandomCropParams, RandomRotation, RandomRotationParams, RandomTranslation,
    RandomTranslationParams,
};
pub use sometimes::{RandomFlipX, RandomFlipY, RandomPolarityFlip, Sometimes};
pub use time_reversal::RandomTimeReversal;
pub use time_span::{DropByTime, DropByTimeParams};

use crate::random::Random;

/// The registry: every augmentation that is a transform. Calls `$then!` with the list. Each line: name, name of a module,
/// type, parameters, and how to make it of geometry, parameters and [`Seed`] (a `Result` with
/// [`TransformError`](crate::transform::TransformError)).
#[macro_export]
macro_rules! augmentations {
    ($then:ident) => {
        $then! {
            EventDrop event_drop: $crate::augmentation::EventDrop, $crate::augmentation::ChanceParams,
                $crate::augmentation::EventDrop::try_new;
            PixelDropout pixel_dropout: $crate::augmentation::PixelDropout, $crate::augmentation::ChanceParams,
                $crate::augmentation::PixelDropout::try_new;
            DropByTime drop_by_time: $crate::augmentation::DropByTime, $crate::augmentation::DropByTimeParams,
                $crate::augmentation::DropByTime::try_new;
            DropByArea drop_by_area: $crate::augmentation::DropByArea, $crate::augmentation::DropByAreaParams,
                $crate::augmentation::DropByArea::try_new;
            SpatialJitter spatial_jitter:
                $crate::augmentation::SpatialJitter, $crate::augmentation::SpatialJitterParams,
                $crate::augmentation::SpatialJitter::try_new;
            TimeJitter time_jitter: $crate::augmentation::TimeJitter, $crate::augmentation::TimeJitterParams,
                $crate::augmentation::TimeJitter::try_new;
            RandomFlipX random_flip_x: $crate::augmentation::RandomFlipX, $crate::augmentation::ChanceParams,
                $crate::augmentation::RandomFlipX::try_new;
            RandomFlipY random_flip_y: $crate::augmentation::RandomFlipY, $crate::augmentation::ChanceParams,
                $crate::augmentation::RandomFlipY::try_new;
            RandomPolarityFlip random_polarity_flip:
                $crate::augmentation::RandomPolarityFlip, $crate::augmentation::ChanceParams,
                $crate::augmentation::RandomPolarityFlip::try_new;
            RandomRotation random_rotation:
                $crate::augmentation::RandomRotation, $crate::augmentation::RandomRotationParams,
                $crate::augmentation::RandomRotation::try_new;
            RandomTranslation random_translation:
                $crate::augmentation::RandomTranslation, $crate::augmentation::RandomTranslationParams,
                $crate::augmentation::RandomTranslation::try_new;
            RandomCrop random_crop: $crate::augmentation::RandomCrop, $crate::augmentation::RandomCropParams,
                $crate::augmentation::RandomCrop::try_new;
        }
    };
}

/// Where the randomness of an augmentation comes from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(deny_unknown_fields))]
pub struct Seed {
    /// The run's: another one gives other changes.
    pub seed: u64,
    /// Number of the slice within the run.
    pub slice: u64,
}

impl Seed {
    /// The generator of one kind of augmentation.
    fn random(self, kind: Kind) -> Random {
        Random::new(self.seed, 0).fork(self.slice).fork(kind as u64)
    }
}

/// A number for each kind, so that those of one seed are unrelated.
#[derive(Clone, Copy)]
enum Kind {
    EventDrop,
    PixelDropout,
    DropByTime,
    DropByArea,
    SpatialJitter,
    TimeJitter,
    FlipX,
    FlipY,
    PolarityFlip,
    Rotation,
    Translation,
    Crop,
    TimeReversal,
    Noise,
}
