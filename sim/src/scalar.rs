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

    /// The exponential function, good to 1e-13; kept between exp(-60) and exp(60).
    ///
    /// The same operations in every lane and on every machine, so that results agree to the bit.
    #[inline(always)]
    fn exp(self) -> Self {
        // exp(x) = exp(x / 128)^128, the inner one by its series
        const TERMS: usize = 13;
        let x = self.clamp(Self::from_f64(-60.0), Self::from_f64(60.0)) * Self::from_f64(1.0 / 128.0);
        let mut sum = Self::ONE;
        for k in (1..=TERMS).rev() {
            sum = Self::ONE + x * sum * Self::from_f64(1.0 / k as f64);
        }
        for _ in 0..7 {
            sum = sum * sum;
        }
        sum
    }

    /// The natural logarithm of a number between 1e-8 and 1e8, good to 1e-13.
    ///
    /// The same operations in every lane and on every machine, so that results agree to the bit.
    #[inline(always)]
    fn ln(self) -> Self {
        // ln(x) = 64 ln(y), y the 64th root; ln(y) = 2 artanh((y - 1) / (y + 1)), by its series
        const TERMS: usize = 8;
        let mut y = self;
        for _ in 0..6 {
            y = y.sqrt();
        }
        let z = (y - Self::ONE) / (y + Self::ONE);
        let squared = z * z;
        let mut sum = Self::ZERO;
        for k in (0..TERMS).rev() {
            sum = sum * squared + Self::from_f64(1.0 / (2 * k + 1) as f64);
        }
        z * sum * Self::from_f64(128.0)
    }

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

#[cfg(test)]
mod tests {
    use super::*;

    /// A hundred roundings, from the seventh squaring.
    const ROUNDING: f64 = 1e-13;

    #[test]
    fn exponential_and_logarithm_agree_with_the_library() {
        for k in -300..=300 {
            let x = f64::from(k) * 0.1;
            assert!((Scalar::exp(x) / f64::exp(x) - 1.0).abs() < ROUNDING, "exp {x}");
            let y = f64::exp(x * 0.6);
            assert!((Scalar::ln(y) - f64::ln(y)).abs() < ROUNDING, "ln {y}");
        }
        assert!(Scalar::exp(-1e6_f64) < 1e-26 && Scalar::exp(0.0_f64) == 1.0);
    }
}
