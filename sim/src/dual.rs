//! Numbers that carry their derivatives along (forward mode).

use std::ops::{Add, AddAssign, Div, Mul, MulAssign, Neg, Sub, SubAssign};

use crate::scalar::{Mask as _, Scalar};

/// A value and its partial derivatives with respect to N variables, exact to rounding.
///
/// # Example
/// ```
/// use sim::{Scalar, dual::Dual};
/// let x: Dual<f64, 1> = Dual::variable(3.0, 0);
/// let y = x * x + Dual::from_f64(1.0);
/// assert_eq!((y.value, y.partials), (10.0, [6.0]));
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Dual<T, const N: usize> {
    /// The value.
    pub value: T,
    /// Its derivative with respect to each variable.
    pub partials: [T; N],
}

impl<T: Scalar, const N: usize> Dual<T, N> {
    /// A number that depends on no variable.
    #[inline(always)]
    pub fn constant(value: T) -> Self {
        Self { value, partials: [T::ZERO; N] }
    }

    /// The variable `index`, at `value`.
    ///
    /// # Panics
    /// When `index` is N or more.
    #[inline(always)]
    pub fn variable(value: T, index: usize) -> Self {
        let mut partials = [T::ZERO; N];
        partials[index] = T::ONE;
        Self { value, partials }
    }

    /// `value` with the derivative `slope` along this number.
    #[inline(always)]
    fn chain(self, value: T, slope: T) -> Self {
        Self {
            value,
            partials: self.each(
                #[inline(always)]
                |p| p * slope,
            ),
        }
    }

    // Loops, for the library's functions over arrays would not always be inlined: see `Scalar::tuned`. So with closures.

    #[inline(always)]
    fn each(self, f: impl Fn(T) -> T) -> [T; N] {
        let mut partials = self.partials;
        let mut i = 0;
        while i < N {
            partials[i] = f(partials[i]);
            i += 1;
        }
        partials
    }

    #[inline(always)]
    fn zip(self, other: Self, f: impl Fn(T, T) -> T) -> [T; N] {
        let mut partials = self.partials;
        let mut i = 0;
        while i < N {
            partials[i] = f(partials[i], other.partials[i]);
            i += 1;
        }
        partials
    }
}

impl<T: Scalar, const N: usize> Add for Dual<T, N> {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self {
            value: self.value + other.value,
            partials: self.zip(
                other,
                #[inline(always)]
                |a, b| a + b,
            ),
        }
    }
}

impl<T: Scalar, const N: usize> Sub for Dual<T, N> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self {
            value: self.value - other.value,
            partials: self.zip(
                other,
                #[inline(always)]
                |a, b| a - b,
            ),
        }
    }
}

impl<T: Scalar, const N: usize> Mul for Dual<T, N> {
    type Output = Self;
    #[expect(clippy::suspicious_arithmetic_impl, reason = "the product rule adds")]
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        let (x, y) = (self.value, other.value);
        Self {
            value: x * y,
            partials: self.zip(
                other,
                #[inline(always)]
                |a, b| a * y + x * b,
            ),
        }
    }
}

impl<T: Scalar, const N: usize> Div for Dual<T, N> {
    type Output = Self;
    #[inline(always)]
    fn div(self, other: Self) -> Self {
        let inverse = T::ONE / other.value;
        // the plain quotient, so that values agree with plain numbers to the bit
        let value = self.value / other.value;
        Self {
            value,
            partials: self.zip(
                other,
                #[inline(always)]
                |a, b| (a - value * b) * inverse,
            ),
        }
    }
}

impl<T: Scalar, const N: usize> Neg for Dual<T, N> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self {
            value: -self.value,
            partials: self.each(
                #[inline(always)]
                |p| -p,
            ),
        }
    }
}

impl<T: Scalar, const N: usize> AddAssign for Dual<T, N> {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl<T: Scalar, const N: usize> SubAssign for Dual<T, N> {
    #[inline(always)]
    fn sub_assign(&mut self, other: Self) {
        *self = *self - other;
    }
}

impl<T: Scalar, const N: usize> MulAssign for Dual<T, N> {
    #[inline(always)]
    fn mul_assign(&mut self, other: Self) {
        *self = *self * other;
    }
}

impl<T: Scalar, const N: usize> Scalar for Dual<T, N> {
    type Mask = T::Mask;
    const LANES: usize = T::LANES;
    const ZERO: Self = Self { value: T::ZERO, partials: [T::ZERO; N] };
    const ONE: Self = Self { value: T::ONE, partials: [T::ZERO; N] };

    #[inline(always)]
    fn tuned<R>(work: impl FnOnce() -> R) -> R {
        T::tuned(work)
    }

    #[inline(always)]
    fn from_f64(x: f64) -> Self {
        Self::constant(T::from_f64(x))
    }

    fn as_constant(self) -> Option<f64> {
        let still = self.partials.iter().all(|&rate| rate == T::ZERO);
        if still { self.value.as_constant() } else { None }
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        let root = self.value.sqrt();
        let positive = T::ZERO.less(root);
        let slope = T::select(positive, T::from_f64(0.5) / T::select(positive, root, T::ONE), T::ZERO);
        self.chain(root, slope)
    }

    #[inline(always)]
    fn sin_cos(self) -> (Self, Self) {
        let (sin, cos) = self.value.sin_cos();
        (self.chain(sin, cos), self.chain(cos, -sin))
    }

    #[inline(always)]
    fn atan2(self, x: Self) -> Self {
        let squared = self.value * self.value + x.value * x.value;
        let partials = self.zip(
            x,
            #[inline(always)]
            |dy, dx| (dy * x.value - dx * self.value) / squared,
        );
        Self { value: self.value.atan2(x.value), partials }
    }

    #[inline(always)]
    fn abs(self) -> Self {
        let (below, above) = (self.value.less(T::ZERO), T::ZERO.less(self.value));
        let sign = T::select(below, -T::ONE, T::select(above, T::ONE, T::ZERO));
        self.chain(self.value.abs(), sign)
    }

    #[inline(always)]
    fn growing_length<const K: usize>(x: [Self; K]) -> Self {
        let mut values = [T::ZERO; K];
        let mut k = 0;
        while k < K {
            values[k] = x[k].value;
            k += 1;
        }
        let value = T::growing_length(values);
        let positive = T::ZERO.less(value);
        let mut k = 0;
        while k < K {
            // the direction of the vector, where it has one
            values[k] = values[k] / T::select(positive, value, T::ONE);
            k += 1;
        }
        let mut partials = [T::ZERO; N];
        let mut i = 0;
        while i < N {
            let (mut along, mut slopes) = (T::ZERO, [T::ZERO; K]);
            let mut k = 0;
            while k < K {
                along += values[k] * x[k].partials[i];
                slopes[k] = x[k].partials[i];
                k += 1;
            }
            partials[i] = match positive.all() {
                true => along,
                false => T::select(positive, along, T::growing_length(slopes)),
            };
            i += 1;
        }
        Self { value, partials }
    }

    #[inline(always)]
    fn floor(self) -> Self {
        Self::constant(self.value.floor())
    }

    #[inline(always)]
    fn exp(self) -> Self {
        let value = self.value.exp();
        self.chain(value, value)
    }

    #[inline(always)]
    fn ln(self) -> Self {
        self.chain(self.value.ln(), T::ONE / self.value)
    }

    #[inline(always)]
    fn less(self, other: Self) -> T::Mask {
        self.value.less(other.value)
    }

    #[inline(always)]
    fn select(mask: T::Mask, yes: Self, no: Self) -> Self {
        Self {
            value: T::select(mask, yes.value, no.value),
            partials: yes.zip(
                no,
                #[inline(always)]
                |a, b| T::select(mask, a, b),
            ),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    type One = Dual<f64, 1>;

    /// Central differences at step 1e-6 are good to about this.
    const DIFFERENCE: f64 = 1e-8;

    #[test]
    fn every_operation_agrees_with_central_differences() {
        type Operation = (&'static str, fn(One) -> One);
        let operations: [Operation; 9] = [
            ("product", |x| x * x * x),
            ("quotient", |x| One::from_f64(2.0) / (x + One::ONE)),
            ("sqrt", |x| x.sqrt()),
            ("sine", |x| x.sin_cos().0),
            ("cosine", |x| x.sin_cos().1),
            ("exp", |x| Scalar::exp(-x)),
            ("ln", |x| Scalar::ln(x)),
            ("atan2", |x| x.atan2(One::from_f64(0.4) - x)),
            ("abs, min, max", |x| (-x).abs().min(One::from_f64(5.0)).max(One::from_f64(-1.0))),
        ];
        for (name, f) in operations {
            let at = 0.7;
            let exact = f(One::variable(at, 0)).partials[0];
            let step = 1e-6;
            let plain = |x: f64| f(One::constant(x)).value;
            let difference = (plain(at + step) - plain(at - step)) / (2.0 * step);
            assert!((exact - difference).abs() < DIFFERENCE, "{name}: {exact} {difference}");
        }
    }

    #[test]
    fn a_length_that_can_only_grow_does_so_from_zero() {
        type Two = Dual<f64, 2>;
        // |(a + b, 2 a)| at a = b = 0 and elsewhere
        let length = |a: f64, b: f64| {
            let (a, b) = (Two::variable(a, 0), Two::variable(b, 1));
            Two::growing_length([a + b, a + a])
        };
        assert_eq!(length(0.0, 0.0).partials, [5f64.sqrt(), 1.0]);
        let Two { value, partials } = length(1.0, 1.0);
        assert_eq!(value, 8f64.sqrt());
        let [a, b] = partials;
        assert!((a - 6.0 / value).hypot(b - 2.0 / value) < 1e-12, "{partials:?}");
        assert_eq!(Two::growing_length([Two::variable(0.0, 1) * Two::from_f64(-3.0)]).partials, [0.0, 3.0]);
        assert_eq!(Two::growing_length([-Two::variable(2.0, 1)]), Two::variable(2.0, 1));
    }

    #[test]
    fn speed_has_a_finite_derivative_at_rest() {
        let v = One::variable(0.0, 0);
        let drag = (v * v).sqrt() * v;
        assert_eq!(drag.partials, [0.0]);
    }
}
