//! The number type everything is generic over: plain `f64`, numbers that carry derivatives, SIMD lanes.
//!
//! Hot mathematics never branches on a number: it compares into a [`Scalar::Mask`] and [`Scalar::select`]s,
//! so that several candidates can share one pass.

use std::fmt::Debug;
use std::ops::{Add, AddAssign, BitAnd, BitOr, Div, Mul, MulAssign, Neg, Not, Sub, SubAssign};

/// The outcome of comparing scalars: one truth value per lane.
pub trait Mask: Copy + Debug + BitAnd<Output = Self> + BitOr<Output = Self> + Not<Output = Self> {
    /// Whether it holds in every lane.
    fn all(self) -> bool;

    /// Whether it holds in some lane.
    fn any(self) -> bool;
}

impl Mask for bool {
    fn all(self) -> bool {
        self
    }

    fn any(self) -> bool {
        self
    }
}

/// A number the simulation can be carried out in.
pub trait Scalar:
    Copy
    + Debug
    + PartialEq
    + Send
    + Sync
    + 'static
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + AddAssign
    + SubAssign
    + MulAssign
{
    /// What a comparison yields.
    type Mask: Mask;
    /// How many numbers it carries side by side, derivatives not counted.
    const LANES: usize;
    /// 0.
    const ZERO: Self;
    /// 1.
    const ONE: Self;

    /// The constant `x`, the same in every lane, with no derivative.
    fn from_f64(x: f64) -> Self;

    /// Square root. Its derivative at 0 counts as 0, which keeps the derivative of |v| v finite at rest.
    fn sqrt(self) -> Self;

    /// Sine and cosine.
    fn sin_cos(self) -> (Self, Self);

    /// The angle of the point (`x`, `self`), between -pi and pi.
    fn atan2(self, x: Self) -> Self;

    /// Absolute value. Its derivative at 0 counts as 0.
    fn abs(self) -> Self;

    /// Where `self < other`. False where either is NaN.
    fn less(self, other: Self) -> Self::Mask;

    /// `yes` where `mask` holds, else `no`.
    fn select(mask: Self::Mask, yes: Self, no: Self) -> Self;

    /// The smaller one.
    fn min(self, other: Self) -> Self {
        Self::select(other.less(self), other, self)
    }

    /// The larger one.
    fn max(self, other: Self) -> Self {
        Self::select(self.less(other), other, self)
    }

    /// `self` kept between `low` and `high`.
    fn clamp(self, low: Self, high: Self) -> Self {
        self.max(low).min(high)
    }
}

impl Scalar for f64 {
    type Mask = bool;
    const LANES: usize = 1;
    const ZERO: Self = 0.0;
    const ONE: Self = 1.0;

    #[inline(always)]
    fn from_f64(x: f64) -> Self {
        x
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        f64::sqrt(self)
    }

    #[inline(always)]
    fn sin_cos(self) -> (Self, Self) {
        f64::sin_cos(self)
    }

    #[inline(always)]
    fn atan2(self, x: Self) -> Self {
        f64::atan2(self, x)
    }

    #[inline(always)]
    fn abs(self) -> Self {
        f64::abs(self)
    }

    #[inline(always)]
    fn less(self, other: Self) -> bool {
        self < other
    }

    #[inline(always)]
    fn select(mask: bool, yes: Self, no: Self) -> Self {
        if mask { yes } else { no }
    }
}
