//! Lanes in the registers of x86-64.
//!
//! Values of the AVX types are only made by work that [`super::dispatch`] hands over once it has found the instruction
//! set; that is what every `unsafe` block here relies on.

use std::arch::x86_64::*;
use std::mem::transmute;

use super::registers::{Lanes, Register};

// Widths measured on the passive chain: two registers hide the latency of divisions and roots; numbers that carry
// derivatives do so by themselves.
pub(crate) type OneOfAvx2 = Lanes<__m256d, 1>;
pub(crate) type TwoOfAvx2 = Lanes<__m256d, 2>;
pub(crate) type OneOfAvx512 = Lanes<__m512d, 1>;
pub(crate) type TwoOfAvx512 = Lanes<__m512d, 2>;

#[target_feature(enable = "avx2")]
fn with_avx2<O>(work: impl FnOnce() -> O) -> O {
    work()
}

#[target_feature(enable = "avx512f,avx512dq")]
fn with_avx512<O>(work: impl FnOnce() -> O) -> O {
    work()
}

const SIGN: f64 = -0.0;

macro_rules! register {
    ($type:ty, $width:literal, $splat:ident, $add:ident, $sub:ident, $mul:ident, $div:ident, $sqrt:ident, $xor:ident, $andnot:ident) => {
        const WIDTH: usize = $width;
        // SAFETY: a register is its numbers side by side
        const ZERO: Self = unsafe { transmute::<[f64; $width], $type>([0.0; $width]) };
        // SAFETY: as above
        const ONE: Self = unsafe { transmute::<[f64; $width], $type>([1.0; $width]) };

        #[inline(always)]
        fn splat(x: f64) -> Self {
            unsafe { $splat(x) }
        }

        #[inline(always)]
        fn add(self, other: Self) -> Self {
            unsafe { $add(self, other) }
        }

        #[inline(always)]
        fn sub(self, other: Self) -> Self {
            unsafe { $sub(self, other) }
        }

        #[inline(always)]
        fn mul(self, other: Self) -> Self {
            unsafe { $mul(self, other) }
        }

        #[inline(always)]
        fn div(self, other: Self) -> Self {
            unsafe { $div(self, other) }
        }

        #[inline(always)]
        fn neg(self) -> Self {
            unsafe { $xor(self, $splat(SIGN)) }
        }

        #[inline(always)]
        fn sqrt(self) -> Self {
            unsafe { $sqrt(self) }
        }

        #[inline(always)]
        fn abs(self) -> Self {
            unsafe { $andnot($splat(SIGN), self) }
        }

        #[inline(always)]
        fn get(self, lane: usize) -> f64 {
            // SAFETY: a register is its numbers side by side
            let numbers = unsafe { transmute::<$type, [f64; $width]>(self) };
            numbers[lane]
        }

        #[inline(always)]
        fn store(self, values: &mut [f64]) {
            // SAFETY: as above
            values.copy_from_slice(&unsafe { transmute::<$type, [f64; $width]>(self) });
        }

        #[inline(always)]
        fn set(self, lane: usize, x: f64) -> Self {
            // SAFETY: as above
            let mut numbers = unsafe { transmute::<$type, [f64; $width]>(self) };
            numbers[lane] = x;
            unsafe { transmute::<[f64; $width], $type>(numbers) }
        }
    };
}

impl Register for __m256d {
    #[inline(always)]
    fn tuned<O>(work: impl FnOnce() -> O) -> O {
        // SAFETY: a value of this type means that the instruction set has been found
        unsafe { with_avx2(work) }
    }

    register!(
        __m256d,
        4,
        _mm256_set1_pd,
        _mm256_add_pd,
        _mm256_sub_pd,
        _mm256_mul_pd,
        _mm256_div_pd,
        _mm256_sqrt_pd,
        _mm256_xor_pd,
        _mm256_andnot_pd
    );
    type Mask = Self;

    #[inline(always)]
    fn and(a: Self, b: Self) -> Self {
        unsafe { _mm256_and_pd(a, b) }
    }

    #[inline(always)]
    fn or(a: Self, b: Self) -> Self {
        unsafe { _mm256_or_pd(a, b) }
    }

    #[inline(always)]
    fn not(a: Self) -> Self {
        unsafe { _mm256_xor_pd(a, _mm256_set1_pd(f64::from_bits(u64::MAX))) }
    }

    #[inline(always)]
    fn all(a: Self) -> bool {
        unsafe { _mm256_movemask_pd(a) == 0b1111 }
    }

    #[inline(always)]
    fn any(a: Self) -> bool {
        unsafe { _mm256_movemask_pd(a) != 0 }
    }

    #[inline(always)]
    fn test(a: Self, lane: usize) -> bool {
        unsafe { _mm256_movemask_pd(a) >> lane & 1 == 1 }
    }

    #[inline(always)]
    fn less(self, other: Self) -> Self::Mask {
        unsafe { _mm256_cmp_pd::<_CMP_LT_OQ>(self, other) }
    }

    #[inline(always)]
    fn equal(self, other: Self) -> Self::Mask {
        unsafe { _mm256_cmp_pd::<_CMP_EQ_OQ>(self, other) }
    }

    #[inline(always)]
    fn select(mask: Self::Mask, yes: Self, no: Self) -> Self {
        unsafe { _mm256_blendv_pd(no, yes, mask) }
    }
}

impl Register for __m512d {
    #[inline(always)]
    fn tuned<O>(work: impl FnOnce() -> O) -> O {
        // SAFETY: a value of this type means that the instruction set has been found
        unsafe { with_avx512(work) }
    }

    type Mask = __mmask8;

    register!(
        __m512d,
        8,
        _mm512_set1_pd,
        _mm512_add_pd,
        _mm512_sub_pd,
        _mm512_mul_pd,
        _mm512_div_pd,
        _mm512_sqrt_pd,
        _mm512_xor_pd,
        _mm512_andnot_pd
    );

    #[inline(always)]
    fn less(self, other: Self) -> Self::Mask {
        unsafe { _mm512_cmp_pd_mask::<_CMP_LT_OQ>(self, other) }
    }

    #[inline(always)]
    fn equal(self, other: Self) -> Self::Mask {
        unsafe { _mm512_cmp_pd_mask::<_CMP_EQ_OQ>(self, other) }
    }

    #[inline(always)]
    fn test(mask: Self::Mask, lane: usize) -> bool {
        mask >> lane & 1 == 1
    }

    #[inline(always)]
    fn select(mask: Self::Mask, yes: Self, no: Self) -> Self {
        unsafe { _mm512_mask_blend_pd(mask, no, yes) }
    }

    #[inline(always)]
    fn and(a: Self::Mask, b: Self::Mask) -> Self::Mask {
        a & b
    }

    #[inline(always)]
    fn or(a: Self::Mask, b: Self::Mask) -> Self::Mask {
        a | b
    }

    #[inline(always)]
    fn not(a: Self::Mask) -> Self::Mask {
        !a
    }

    #[inline(always)]
    fn all(a: Self::Mask) -> bool {
        a == 0xff
    }

    #[inline(always)]
    fn any(a: Self::Mask) -> bool {
        a != 0
    }
}
