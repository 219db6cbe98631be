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

    /// Whether it holds in `lane`.
    fn test(self, lane: usize) -> bool;
}

impl Mask for bool {
    #[inline(always)]
    fn all(self) -> bool {
        self
    }

    #[inline(always)]
    fn any(self) -> bool {
        self
    }

    fn test(self, _: usize) -> bool {
        self
    }
}

/// Does the work with the instructions that suit the number: `tuned!(T, work)`, see [`Scalar::tuned`].
///
/// A closure that could be called twice is called once through a function made for that, which need not be inlined. So
/// this one gives something away, which can be done once only.
macro_rules! tuned {
    ($T:ty, $work:expr) => {{
        let once = $crate::scalar::Once;
        <$T as $crate::scalar::Scalar>::tuned(
            #[inline(always)]
            || {
                let _given_away = once;
                $work
            },
        )
    }};
}
pub(crate) use tuned;

/// What can be given away once only.
pub(crate) struct Once;

/// 1.5 · 2^52: adding and subtracting it rounds to the nearest whole number.
const ROUNDING_CONSTANT: f64 = 6_755_399_441_055_744.0;

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
    /// The number 0.
    const ZERO: Self;
    /// The number 1.
    const ONE: Self;

    /// Does `work` with the instructions that suit this number. What `work` calls must be `#[inline(always)]` down to the
    /// arithmetic, or tuned itself: only what ends up in one function is compiled for those instructions. Called as
    /// `tuned!`, which sees to it that `work` itself is inlined.
    #[inline(always)]
    fn tuned<R>(work: impl FnOnce() -> R) -> R {
        work()
    }

    /// The constant `x`, the same in every lane, with no derivative.
    fn from_f64(x: f64) -> Self;

    /// The constant that it is: the same in every lane, with no derivative.
    fn as_constant(self) -> Option<f64>;

    /// Square root. Its derivative at 0 counts as 0, which keeps the derivative of |v| v finite at rest.
    fn sqrt(self) -> Self;

    /// Sine and cosine.
    fn sin_cos(self) -> (Self, Self);

    /// The angle of the point (`x`, `self`), between -pi and pi.
    fn atan2(self, x: Self) -> Self;

    /// Absolute value. Its derivative at 0 counts as 0.
    fn abs(self) -> Self;

    /// Length of the vector `x` of one component or more. Where it is 0 its derivatives are how fast it grows, for what can only
    /// grow from there: a coefficient that rests on 0 must see that it may leave it.
    #[inline(always)]
    fn growing_length<const K: usize>(x: [Self; K]) -> Self {
        if K == 1 {
            return x[0].abs();
        }
        let mut squares = x[0] * x[0];
        let mut k = 1;
        while k < K {
            squares += x[k] * x[k];
            k += 1;
        }
        squares.sqrt()
    }

    /// Where `self < other`. False where either is NaN.
    fn less(self, other: Self) -> Self::Mask;

    /// `yes` where `mask` holds, else `no`.
    fn select(mask: Self::Mask, yes: Self, no: Self) -> Self;

    /// The greatest whole number that is no greater, up to 1e15; it has no derivative.
    #[inline(always)]
    fn floor(self) -> Self {
        let round = Self::from_f64(ROUNDING_CONSTANT);
        let nearest = self + round - round;
        Self::select(self.less(nearest), nearest - Self::ONE, nearest)
    }

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
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        Self::select(other.less(self), other, self)
    }

    /// The larger one.
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        Self::select(self.less(other), other, self)
    }

    /// `self` kept between `low` and `high`.
    #[inline(always)]
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

    fn as_constant(self) -> Option<f64> {
        Some(self)
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        f64::sqrt(self)
    }

    #[inline(always)]
    fn sin_cos(self) -> (Self, Self) {
        sin_cos(self)
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

/// Sine and cosine by arithmetic alone, the same bits whatever carries the number; to one unit in the last place for
/// angles up to a million turns, less exact beyond.
///
/// The angle less the nearest multiple of pi/2 (in three parts, Cody and Waite), then minimax polynomials on
/// -pi/4..pi/4 (coefficients of Sun's fdlibm, 1993).
#[expect(clippy::excessive_precision, reason = "the digits that were published")]
#[inline(always)]
pub(crate) fn sin_cos<T: Scalar>(x: T) -> (T, T) {
    const TWO_OVER_PI: f64 = std::f64::consts::FRAC_2_PI;
    const HALF_PI: [f64; 3] =
        [1.570_796_326_734_125_614_17, 6.077_100_506_303_965_976_60e-11, 2.022_266_248_795_950_631_54e-21];
    const SIN: [f64; 6] = [
        -1.666_666_666_666_663_243_48e-1,
        8.333_333_333_322_489_461_24e-3,
        -1.984_126_982_985_794_931_34e-4,
        2.755_731_370_707_006_767_89e-6,
        -2.505_076_025_340_686_341_95e-8,
        1.589_690_995_211_550_102_21e-10,
    ];
    const COS: [f64; 6] = [
        4.166_666_666_666_660_190_37e-2,
        -1.388_888_888_887_410_957_49e-3,
        2.480_158_728_947_672_941_78e-5,
        -2.755_731_435_139_066_330_35e-7,
        2.087_572_321_298_174_827_90e-9,
        -1.135_964_755_778_819_482_65e-11,
    ];
    let of = T::from_f64;
    let quarters = x * of(TWO_OVER_PI) + of(ROUNDING_CONSTANT) - of(ROUNDING_CONSTANT);
    let [high, middle, low] = HALF_PI;
    let y = x - quarters * of(high) - quarters * of(middle) - quarters * of(low);
    let z = y * y;
    let [a, b, c, d, e, f] = SIN;
    let sin = y + y * z * (of(a) + z * (of(b) + z * (of(c) + z * (of(d) + z * (of(e) + z * of(f))))));
    let [a, b, c, d, e, f] = COS;
    let tail = z * z * (of(a) + z * (of(b) + z * (of(c) + z * (of(d) + z * (of(e) + z * of(f))))));
    let half = z * of(0.5);
    let most = T::ONE - half;
    let cos = most + ((T::ONE - most - half) + tail);
    // quarters modulo 4: 0, 1, 2 or 3
    let whole = quarters * of(0.25) - of(0.375) + of(ROUNDING_CONSTANT) - of(ROUNDING_CONSTANT);
    let turn = quarters - of(4.0) * whole;
    let (above_0, above_1, above_2) = (of(0.5).less(turn), of(1.5).less(turn), of(2.5).less(turn));
    let odd = (above_0 & !above_1) | above_2;
    let (sin, cos) = (T::select(odd, cos, sin), T::select(odd, sin, cos));
    (T::select(above_1, -sin, sin), T::select(above_0 & !above_2, -cos, cos))
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

    #[test]
    fn floor_goes_down() {
        for (x, expected) in [(2.5, 2.0), (-2.5, -3.0), (3.0, 3.0), (-1.0, -1.0), (0.49, 0.0), (-1e-9, -1.0)]
        {
            assert_eq!(Scalar::floor(x), expected, "{x}");
        }
    }

    #[test]
    fn sine_and_cosine_are_those_of_the_library_to_one_unit_in_the_last_place() {
        for i in -200_000..200_000 {
            let x = f64::from(i) * 1.2345e-3 * (1.0 + f64::from(i % 7) * 13.0);
            let ((sin, cos), (s, c)) = (sin_cos(x), x.sin_cos());
            assert!((sin - s).abs() <= 1.2e-16 && (cos - c).abs() <= 1.2e-16, "{x}: {sin} {s} {cos} {c}");
        }
        assert_eq!(sin_cos(0.0), (0.0, 1.0));
    }
}
