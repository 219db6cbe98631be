//! What the camera makes of the keypoints.
//!
//! Causes on the measuring side, one file each, of the same shape as those in the water ([`crate::effects`]). A rollout's
//! keypoint positions are what is seen: at the time that each point is seen, then through the optics. A picture's
//! coordinates are the world's x and z; y, the depth, stays.

pub(crate) mod camera_delay;
pub(crate) mod camera_rotation;
pub(crate) mod camera_scale;
pub(crate) mod camera_tilt;
pub(crate) mod film;
pub(crate) mod keypoint_slip;
pub(crate) mod lens;
pub(crate) mod rolling_shutter;

use crate::effects::Effect;
use crate::scalar::Scalar;

pub(crate) use film::Film;

/// What a cause does to a picture. Each hook does nothing unless the cause has it.
pub(crate) trait Look<T: Scalar>: Sized {
    /// The cause with these values.
    fn new(effect: &Effect<T>) -> Self;

    /// Whether it sees points at another time than the image's.
    fn shifts(&self) -> bool {
        false
    }

    /// By how much later \[s\] than the image's time everything is seen.
    #[inline(always)]
    fn late(&self) -> T {
        T::ZERO
    }

    /// By how much later \[s\] the point at `at` \[m\] is seen than the image's other points.
    #[inline(always)]
    fn late_at(&self, _at: [T; 3]) -> T {
        T::ZERO
    }

    /// Where the point at `at` \[m\] seems to be \[m\].
    #[inline(always)]
    fn see(&self, at: [T; 3]) -> [T; 3] {
        at
    }
}
