//! Several numbers side by side, each with its own motion: SIMD lanes.
//!
//! The instruction set is chosen when the program runs ([`Isa::best`]), so a plain build is fast on any machine. No
//! operation is contracted or reordered: a number's bits are the same in any lane of any instruction set, and the same as
//! computed alone.
//!
//! A lane type's operations are compiled for its instruction set only where they are inlined into a function that
//! enables it: see [`Scalar::tuned`].

#![allow(unsafe_code, reason = "instructions beyond the compiler's baseline")]

#[cfg(not(target_arch = "x86_64"))]
mod array;
#[cfg(target_arch = "x86_64")]
mod x86;

use std::fmt;
use std::ops::{Add, AddAssign, BitAnd, BitOr, Div, Mul, MulAssign, Neg, Not, Sub, SubAssign};

use crate::scalar::{Mask, Scalar, sin_cos};

/// An instruction set that lanes can use.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Isa {
    /// Whatever the compiler makes of plain arithmetic; on x86-64 the same as SSE2.
    Baseline,
    /// Two numbers an instruction.
    Sse2,
    /// Four numbers an instruction.
    Avx2,
    /// Eight numbers an instruction.
    Avx512,
}

impl Isa {
    /// Every instruction set of this machine, the widest last.
    pub fn available() -> Vec<Self> {
        #[cfg(not(target_arch = "x86_64"))]
        let sets = vec![Self::Baseline];
        #[cfg(target_arch = "x86_64")]
        let mut sets = vec![Self::Sse2];
        #[cfg(target_arch = "x86_64")]
        {
            if is_x86_feature_detected!("avx2") {
                sets.push(Self::Avx2);
            }
            if is_x86_feature_detected!("avx512f") && is_x86_feature_detected!("avx512dq") {
                sets.push(Self::Avx512);
            }
        }
        sets
    }

    /// The widest instruction set of this machine.
    pub fn best() -> Self {
        Self::available().last().copied().unwrap_or(Self::Baseline)
    }

    /// How many candidates share one pass.
    pub fn lanes(self) -> usize {
        match self {
            #[cfg(target_arch = "x86_64")]
            Self::Sse2 | Self::Baseline => <x86::Sse2Lanes as Scalar>::LANES,
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => <x86::Avx2Lanes as Scalar>::LANES,
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => <x86::Avx512Lanes as Scalar>::LANES,
            #[cfg(not(target_arch = "x86_64"))]
            _ => <array::Plain as Scalar>::LANES,
        }
    }

    /// Its name as the world writes it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Baseline => "baseline",
            Self::Sse2 => "sse2",
            Self::Avx2 => "avx2",
            Self::Avx512 => "avx512",
        }
    }
}

/// Work that can be done in lanes of any kind.
pub(crate) trait InLanes {
    /// What it yields.
    type Output;
    /// Whether it is worth a program of its own for instructions beyond AVX2.
    const WIDEST: bool;

    /// Does it.
    fn with<L: Packed>(self) -> Self::Output;
}

/// Does `work` in the lanes of `isa`; one that this machine lacks is replaced by its best.
pub(crate) fn dispatch<W: InLanes>(isa: Isa, work: W) -> W::Output {
    let isa = if Isa::available().contains(&isa) { isa } else { Isa::best() };
    match isa {
        #[cfg(target_arch = "x86_64")]
        Isa::Sse2 | Isa::Baseline => work.with::<x86::Sse2Lanes>(),
        #[cfg(target_arch = "x86_64")]
        Isa::Avx2 => work.with::<x86::Avx2Lanes>(),
        #[cfg(target_arch = "x86_64")]
        Isa::Avx512 if W::WIDEST => work.with::<x86::Avx512Lanes>(),
        #[cfg(target_arch = "x86_64")]
        Isa::Avx512 => work.with::<x86::Avx2Lanes>(),
        #[cfg(not(target_arch = "x86_64"))]
        _ => work.with::<array::Plain>(),
    }
}

/// A scalar of several lanes that can be filled and read.
pub(crate) trait Packed: Scalar {
    /// From one value per lane.
    fn pack(value: impl FnMut(usize) -> f64) -> Self;

    /// The value in `lane`.
    fn lane(self, lane: usize) -> f64;
}

/// One register of numbers.
pub(crate) trait Register: Copy + Send + Sync + 'static {
    /// One truth value per number.
    type Mask: Copy + Send + Sync + fmt::Debug;
    /// Numbers in it.
    const WIDTH: usize;
    const ZERO: Self;
    const ONE: Self;

    /// Does `work` with this register's instructions.
    #[inline(always)]
    fn tuned<O>(work: impl FnOnce() -> O) -> O {
        work()
    }

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
    fn set(self, lane: usize, x: f64) -> Self;

    fn and(a: Self::Mask, b: Self::Mask) -> Self::Mask;
    fn or(a: Self::Mask, b: Self::Mask) -> Self::Mask;
    fn not(a: Self::Mask) -> Self::Mask;
    fn all(a: Self::Mask) -> bool;
    fn any(a: Self::Mask) -> bool;
}

/// N registers side by side: enough independent work to keep a processor's units busy.
#[derive(Clone, Copy)]
pub(crate) struct Lanes<R, const N: usize>([R; N]);

/// Which of the lanes.
#[derive(Clone, Copy)]
pub(crate) struct LaneMask<R: Register, const N: usize>([R::Mask; N]);

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
