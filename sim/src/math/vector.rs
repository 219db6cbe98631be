//! Vectors of one, two and three components.

use std::fmt::Debug;
use std::ops::{Add, AddAssign, Index, IndexMut, Mul, Neg, Sub, SubAssign};

use crate::scalar::Scalar;

/// What vectors of any length can do.
pub trait Vector<T>:
    Copy
    + Debug
    + PartialEq
    + Send
    + Sync
    + 'static
    + Add<Output = Self>
    + Sub<Output = Self>
    + Neg<Output = Self>
    + Mul<T, Output = Self>
    + AddAssign
    + SubAssign
{
    /// The zero vector.
    const ZERO: Self;

    /// Scalar product.
    fn dot(self, other: Self) -> T;

    /// Product component by component.
    fn times(self, other: Self) -> Self;

    /// Length; its derivative at the zero vector counts as 0.
    fn norm(self) -> T;

    /// The same where the vector can only grow from zero: its derivatives there are how fast it does.
    fn growing_norm(self) -> T;

    /// The absolute value of each component.
    fn magnitudes(self) -> Self;
}

macro_rules! vector {
    ($(#[$doc:meta])* $name:ident, $n:literal, $v:ident => $norm:expr, $($a:ident $b:ident),+) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq)]
        pub struct $name<T>(pub [T; $n]);

        impl<T: Scalar> $name<T> {
            /// The zero vector.
            pub const ZERO: Self = Self([T::ZERO; $n]);

            /// A vector of constants.
            #[inline(always)]
            pub fn constant([$($a),+]: [f64; $n]) -> Self {
                Self([$(T::from_f64($a)),+])
            }

            /// Scalar product.
            #[inline(always)]
            pub fn dot(self, other: Self) -> T {
                Vector::dot(self, other)
            }

            /// Product component by component.
            #[inline(always)]
            pub fn times(self, other: Self) -> Self {
                Vector::times(self, other)
            }

            /// Length; its derivative at the zero vector counts as 0.
            #[inline(always)]
            pub fn norm(self) -> T {
                Vector::norm(self)
            }
        }

        impl<T: Scalar> Vector<T> for $name<T> {
            const ZERO: Self = Self([T::ZERO; $n]);

            #[inline(always)]
            fn dot(self, other: Self) -> T {
                let ([$($a),+], [$($b),+]) = (self.0, other.0);
                vector!(@sum $($a * $b),+)
            }

            #[inline(always)]
            fn times(self, other: Self) -> Self {
                let ([$($a),+], [$($b),+]) = (self.0, other.0);
                Self([$($a * $b),+])
            }

            #[inline(always)]
            fn magnitudes(self) -> Self {
                let [$($a),+] = self.0;
                Self([$($a.abs()),+])
            }

            #[inline(always)]
            fn norm(self) -> T {
                let $v = self;
                $norm
            }

            #[inline(always)]
            fn growing_norm(self) -> T {
                T::growing_length(self.0)
            }
        }

        impl<T: Scalar> Add for $name<T> {
            type Output = Self;
            #[inline(always)]
            fn add(self, other: Self) -> Self {
                let ([$($a),+], [$($b),+]) = (self.0, other.0);
                Self([$($a + $b),+])
            }
        }

        impl<T: Scalar> Sub for $name<T> {
            type Output = Self;
            #[inline(always)]
            fn sub(self, other: Self) -> Self {
                let ([$($a),+], [$($b),+]) = (self.0, other.0);
                Self([$($a - $b),+])
            }
        }

        impl<T: Scalar> Mul<T> for $name<T> {
            type Output = Self;
            #[inline(always)]
            fn mul(self, k: T) -> Self {
                let [$($a),+] = self.0;
                Self([$($a * k),+])
            }
        }

        impl<T: Scalar> Neg for $name<T> {
            type Output = Self;
            #[inline(always)]
            fn neg(self) -> Self {
                let [$($a),+] = self.0;
                Self([$(-$a),+])
            }
        }

        impl<T: Scalar> AddAssign for $name<T> {
            #[inline(always)]
            fn add_assign(&mut self, other: Self) {
                *self = *self + other;
            }
        }

        impl<T: Scalar> SubAssign for $name<T> {
            #[inline(always)]
            fn sub_assign(&mut self, other: Self) {
                *self = *self - other;
            }
        }

        impl<T> Index<usize> for $name<T> {
            type Output = T;
            #[inline(always)]
            fn index(&self, i: usize) -> &T {
                &self.0[i]
            }
        }

        impl<T> IndexMut<usize> for $name<T> {
            #[inline(always)]
            fn index_mut(&mut self, i: usize) -> &mut T {
                &mut self.0[i]
            }
        }
    };
    (@sum $first:expr $(, $rest:expr)*) => { $first $(+ $rest)* };
}

vector!(
    /// A vector of one: a turn in a plane.
    Vec1, 1, v => v.0[0].abs(), a x
);
vector!(
    /// A vector of two.
    Vec2, 2, v => v.dot(v).sqrt(), a x, b y
);
vector!(
    /// A vector of three.
    Vec3, 3, v => v.dot(v).sqrt(), a x, b y, c z
);

impl<T: Scalar> Vec3<T> {
    #[inline(always)]
    pub(crate) fn map<U>(self, f: impl Fn(T) -> U) -> Vec3<U> {
        let [a, b, c] = self.0;
        Vec3([f(a), f(b), f(c)])
    }

    /// Vector product `self` x `other`.
    #[inline(always)]
    pub fn cross(self, other: Self) -> Self {
        let ([a, b, c], [x, y, z]) = (self.0, other.0);
        Self([b * z - c * y, c * x - a * z, a * y - b * x])
    }
}
