//! What a cause may do to a picture.

use crate::model::cause::CauseValues;
use crate::scalar::Scalar;

/// What a cause does to a picture. Each hook does nothing unless the cause has it.
pub(crate) trait Look<T: Scalar>: Sized {
    /// The cause with these values.
    fn new(values: &CauseValues<T>) -> Self;

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
