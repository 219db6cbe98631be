//! Numbers in registers, as many registers as keep a processor busy.

use std::fmt;
use std::ops::{Add, AddAssign, BitAnd, BitOr, Div, Mul, MulAssign, Neg, Not, Sub, SubAssign};

use super::Packed;
use crate::scalar::{Mask, Scalar, sin_cos};

/// One register of numbers.
pub(super) trait Register: Copy + Send + Sync + 'static {
    /// One truth value per number.
    type Mask: Copy + Send + Sync + fmt::Debug;
    /// Numbers in it.
    const WIDTH: usize;
    const ZERO: Self;
    const ONE: Self;

    /// Does `work` with this register's instructions.
    fn tuned<O>(work: impl FnOnce() -> O) -> O;

    fn splat(x: f64) -> Self;
    fn add(self, other: Self) -> Self;
    fn sub(self, other: Self) -> Self;
    fn mul(self, other: Self) -> Self;
    fn div(self, other: Self) -> Self;
    fn neg(self) -> Self;
    fn sqrt(self) -> Self;
    fn abs(self) -> Self;
    fn less(self, other: Self) -> Self::Mask;
    fn equal(self, other: Self) -> Self::Mask;
    fn test(mask: Self::Mask, lane: usize) -> bool;
    fn select(mask: Self::Mask, yes: Self, no: Self) -> Self;
    fn get(self, lane: usize) -> f64;
    /// Writes its numbers to `values`, which has room for just these.
    fn store(self, values: &mut [f64]);
    fn set(self, lane: usize, x: f64) -> Self;

    fn and(a: Self::Mask, b: Self::Mask) -> Self::Mask;
    fn or(a: Self::Mask, b: Self::Mask) -> Self::Mask;
    fn not(a: Self::Mask) -> Self::Mask;
    fn all(a: Self::Mask) -> bool;
    fn any(a: Self::Mask) -> bool;
}

/// N registers side by side: enough independent work to keep a processor's units busy.
#[derive(Clone, Copy)]
pub(super) struct Lanes<R, const N: usize>([R; N]);

/// Which of the lanes.
#[derive(Clone, Copy)]
pub(super) struct LaneMask<R: Register, const N: usize>([R::Mask; N]);

impl<R: Register, const N: usize> Lanes<R, N> {
    #[inline(always)]
    fn each(self, f: impl Fn(R) -> R) -> Self {
        let mut out = self.0;
        let mut i = 0;
        while i < N {
            out[i] = f(self.0[i]);
            i += 1;
        }
        Self(out)
    }

    #[inline(always)]
    fn zip(self, other: Self, f: impl Fn(R, R) -> R) -> Self {
        let mut out = self.0;
        let mut i = 0;
        while i < N {
            out[i] = f(self.0[i], other.0[i]);
            i += 1;
        }
        Self(out)
    }
}

impl<R: Register, const N: usize> Packed for Lanes<R, N> {
    fn pack(mut value: impl FnMut(usize) -> f64) -> Self {
        let mut out = [R::ZERO; N];
        for (i, register) in out.iter_mut().enumerate() {
            for lane in 0..R::WIDTH {
                *register = register.set(lane, value(i * R::WIDTH + lane));
            }
        }
        Self(out)
    }

    fn lane(self, lane: usize) -> f64 {
        self.0[lane / R::WIDTH].get(lane % R::WIDTH)
    }

    #[inline(always)]
    fn unpack(self, values: &mut [f64]) {
        for (register, values) in self.0.into_iter().zip(values.chunks_exact_mut(R::WIDTH)) {
            register.store(values);
        }
    }
}

impl<R: Register, const N: usize> fmt::Debug for Lanes<R, N> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_list().entries((0..N * R::WIDTH).map(|lane| self.lane(lane))).finish()
    }
}

impl<R: Register, const N: usize> fmt::Debug for LaneMask<R, N> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_list().entries(self.0).finish()
    }
}

impl<R: Register, const N: usize> PartialEq for Lanes<R, N> {
    #[inline(always)]
    fn eq(&self, other: &Self) -> bool {
        let mut all = true;
        let mut i = 0;
        while i < N {
            all &= R::all(R::equal(self.0[i], other.0[i]));
            i += 1;
        }
        all
    }
}

impl<R: Register, const N: usize> BitAnd for LaneMask<R, N> {
    type Output = Self;
    #[inline(always)]
    fn bitand(self, other: Self) -> Self {
        let mut out = self.0;
        let mut i = 0;
        while i < N {
            out[i] = R::and(self.0[i], other.0[i]);
            i += 1;
        }
        Self(out)
    }
}

impl<R: Register, const N: usize> BitOr for LaneMask<R, N> {
    type Output = Self;
    #[inline(always)]
    fn bitor(self, other: Self) -> Self {
        let mut out = self.0;
        let mut i = 0;
        while i < N {
            out[i] = R::or(self.0[i], other.0[i]);
            i += 1;
        }
        Self(out)
    }
}

impl<R: Register, const N: usize> Not for LaneMask<R, N> {
    type Output = Self;
    #[inline(always)]
    fn not(self) -> Self {
        let mut out = self.0;
        let mut i = 0;
        while i < N {
            out[i] = R::not(self.0[i]);
            i += 1;
        }
        Self(out)
    }
}

impl<R: Register, const N: usize> Mask for LaneMask<R, N> {
    #[inline(always)]
    fn all(self) -> bool {
        let mut all = true;
        let mut i = 0;
        while i < N {
            all &= R::all(self.0[i]);
            i += 1;
        }
        all
    }

    #[inline(always)]
    fn test(self, lane: usize) -> bool {
        R::test(self.0[lane / R::WIDTH], lane % R::WIDTH)
    }

    #[inline(always)]
    fn any(self) -> bool {
        let mut any = false;
        let mut i = 0;
        while i < N {
            any |= R::any(self.0[i]);
            i += 1;
        }
        any
    }
}

impl<R: Register, const N: usize> Add for Lanes<R, N> {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.zip(other, R::add)
    }
}

impl<R: Register, const N: usize> Sub for Lanes<R, N> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self.zip(other, R::sub)
    }
}

impl<R: Register, const N: usize> Mul for Lanes<R, N> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        self.zip(other, R::mul)
    }
}

impl<R: Register, const N: usize> Div for Lanes<R, N> {
    type Output = Self;
    #[inline(always)]
    fn div(self, other: Self) -> Self {
        self.zip(other, R::div)
    }
}

impl<R: Register, const N: usize> Neg for Lanes<R, N> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        self.each(R::neg)
    }
}

impl<R: Register, const N: usize> AddAssign for Lanes<R, N> {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl<R: Register, const N: usize> SubAssign for Lanes<R, N> {
    #[inline(always)]
    fn sub_assign(&mut self, other: Self) {
        *self = *self - other;
    }
}

impl<R: Register, const N: usize> MulAssign for Lanes<R, N> {
    #[inline(always)]
    fn mul_assign(&mut self, other: Self) {
        *self = *self * other;
    }
}

impl<R: Register, const N: usize> Scalar for Lanes<R, N> {
    type Mask = LaneMask<R, N>;
    const LANES: usize = N * R::WIDTH;
    const ZERO: Self = Self([R::ZERO; N]);
    const ONE: Self = Self([R::ONE; N]);

    #[inline(always)]
    fn tuned<O>(work: impl FnOnce() -> O) -> O {
        R::tuned(work)
    }

    #[inline(always)]
    fn from_f64(x: f64) -> Self {
        Self([R::splat(x); N])
    }

    fn as_constant(self) -> Option<f64> {
        let first = self.lane(0);
        (1..Self::LANES).all(|lane| self.lane(lane) == first).then_some(first)
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        self.each(R::sqrt)
    }

    #[inline(always)]
    fn sin_cos(self) -> (Self, Self) {
        sin_cos(self)
    }

    /// One lane after the other: only ball joints' springs come here.
    fn atan2(self, x: Self) -> Self {
        Self::pack(|lane| f64::atan2(self.lane(lane), x.lane(lane)))
    }

    #[inline(always)]
    fn abs(self) -> Self {
        self.each(R::abs)
    }

    #[inline(always)]
    fn less(self, other: Self) -> Self::Mask {
        let mut out = [R::less(self.0[0], other.0[0]); N];
        let mut i = 1;
        while i < N {
            out[i] = R::less(self.0[i], other.0[i]);
            i += 1;
        }
        LaneMask(out)
    }

    #[inline(always)]
    fn select(mask: Self::Mask, yes: Self, no: Self) -> Self {
        let mut out = yes.0;
        let mut i = 0;
        while i < N {
            out[i] = R::select(mask.0[i], yes.0[i], no.0[i]);
            i += 1;
        }
        Self(out)
    }
}
