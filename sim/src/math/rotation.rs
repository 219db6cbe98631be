//! Rotations of space, and symmetric matrices that turn with them.

use std::ops::Add;

use super::Vec3;
use crate::scalar::Scalar;

/// A 3 x 3 matrix as three rows; mostly a rotation `parent_from_child`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mat3<T>(pub [[T; 3]; 3]);

impl<T: Scalar> Mat3<T> {
    /// The identity.
    pub const IDENTITY: Self =
        Self([[T::ONE, T::ZERO, T::ZERO], [T::ZERO, T::ONE, T::ZERO], [T::ZERO, T::ZERO, T::ONE]]);

    /// The matrix times `v`.
    #[inline(always)]
    pub fn apply(&self, v: Vec3<T>) -> Vec3<T> {
        let [a, b, c] = self.0;
        Vec3([Vec3(a).dot(v), Vec3(b).dot(v), Vec3(c).dot(v)])
    }

    /// The transposed matrix times `v`: for a rotation, the way back.
    #[inline(always)]
    pub fn apply_transposed(&self, v: Vec3<T>) -> Vec3<T> {
        let [a, b, c] = self.0;
        Vec3(a) * v[0] + Vec3(b) * v[1] + Vec3(c) * v[2]
    }

    /// The product `self` times `other`.
    #[inline(always)]
    pub fn product(&self, other: &Self) -> Self {
        let [a, b, c] = self.0;
        let (a, b, c) = (Vec3(a), Vec3(b), Vec3(c));
        Self([other.apply_transposed(a).0, other.apply_transposed(b).0, other.apply_transposed(c).0])
    }

    /// The product with a rotation in the plane of the axes `I` and `J`, from `I` towards `J`.
    #[inline(always)]
    pub(crate) fn turned_in<const I: usize, const J: usize>(&self, sin: T, cos: T) -> Self {
        let mut out = *self;
        for (row, from) in out.0.iter_mut().zip(&self.0) {
            row[I] = from[I] * cos + from[J] * sin;
            row[J] = from[J] * cos - from[I] * sin;
        }
        out
    }

    /// Column `i`.
    #[inline(always)]
    pub fn column(&self, i: usize) -> Vec3<T> {
        Vec3([self.0[0][i], self.0[1][i], self.0[2][i]])
    }

    /// Rotation about the unit vector `axis` by the angle with this sine and cosine (Rodrigues).
    #[inline(always)]
    pub fn about(axis: Vec3<T>, (sin, cos): (T, T)) -> Self {
        let [x, y, z] = axis.0;
        let [sx, sy, sz] = (axis * sin).0;
        let [kx, ky, kz] = (axis * (T::ONE - cos)).0;
        Self([
            [cos + kx * x, kx * y - sz, kx * z + sy],
            [ky * x + sz, cos + ky * y, ky * z - sx],
            [kz * x - sy, kz * y + sx, cos + kz * z],
        ])
    }
}

/// A unit quaternion `w x y z`, a rotation `parent_from_child`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Quat<T>(pub [T; 4]);

impl<T: Scalar> Quat<T> {
    /// No rotation.
    pub const IDENTITY: Self = Self([T::ONE, T::ZERO, T::ZERO, T::ZERO]);

    /// The product: first `other`, then `self`.
    #[inline(always)]
    pub fn product(self, other: Self) -> Self {
        let ([a, b, c, d], [w, x, y, z]) = (self.0, other.0);
        Self([
            a * w - b * x - c * y - d * z,
            a * x + b * w + c * z - d * y,
            a * y - b * z + c * w + d * x,
            a * z + b * y - c * x + d * w,
        ])
    }

    /// The rotation back.
    #[inline(always)]
    pub fn conjugate(self) -> Self {
        let [w, x, y, z] = self.0;
        Self([w, -x, -y, -z])
    }

    /// Scaled to unit length.
    #[inline(always)]
    pub fn normalized(self) -> Self {
        let [w, x, y, z] = self.0;
        let scale = T::ONE / (w * w + x * x + y * y + z * z).sqrt();
        Self([w * scale, x * scale, y * scale, z * scale])
    }

    /// The rotation by the vector `r`: about its direction, by its length \[rad\].
    #[inline(always)]
    pub fn from_rotation_vector(r: Vec3<T>) -> Self {
        let half_squared = r.dot(r) * T::from_f64(0.25);
        let half = half_squared.sqrt();
        let (sin, cos) = half.sin_cos();
        // sin(x)/x by its series near 0, where the quotient and its derivative are lost; error below 3e-16
        let small = half_squared.less(T::from_f64(1e-5));
        let series =
            T::ONE - half_squared * T::from_f64(1.0 / 6.0) * (T::ONE - half_squared * T::from_f64(0.05));
        let sinc = T::select(small, series, sin / T::select(small, T::ONE, half));
        let cosine = T::select(
            small,
            T::ONE - half_squared * T::from_f64(0.5) * (T::ONE - half_squared * T::from_f64(1.0 / 12.0)),
            cos,
        );
        let v = r * (sinc * T::from_f64(0.5));
        Self([cosine, v[0], v[1], v[2]])
    }

    /// The inverse of [`Quat::from_rotation_vector`], the shorter way round.
    #[inline(always)]
    pub fn rotation_vector(self) -> Vec3<T> {
        let [w, x, y, z] = self.0;
        let sign = T::select(w.less(T::ZERO), -T::ONE, T::ONE);
        let v = Vec3([x, y, z]) * sign;
        let sin_squared = v.dot(v);
        let small = sin_squared.less(T::from_f64(1e-16));
        let sin = T::select(small, T::ONE, sin_squared).sqrt();
        let factor =
            T::select(small, T::from_f64(2.0), T::from_f64(2.0) * sin.atan2((w * sign).max(T::ZERO)) / sin);
        v * factor
    }

    /// As a matrix.
    #[inline(always)]
    pub fn matrix(self) -> Mat3<T> {
        let [w, x, y, z] = self.0;
        let two = T::from_f64(2.0);
        Mat3([
            [w * w + x * x - y * y - z * z, two * (x * y - w * z), two * (x * z + w * y)],
            [two * (x * y + w * z), w * w - x * x + y * y - z * z, two * (y * z - w * x)],
            [two * (x * z - w * y), two * (y * z + w * x), w * w - x * x - y * y + z * z],
        ])
    }
}

/// A symmetric 3 x 3 matrix: `xx yy zz xy xz yz`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sym3<T>(pub [T; 6]);

impl<T: Scalar> Sym3<T> {
    /// All zero.
    pub const ZERO: Self = Self([T::ZERO; 6]);

    /// `rotation` times diag(`diagonal`) times its transpose.
    pub fn rotated_diagonal(rotation: &Mat3<T>, diagonal: Vec3<T>) -> Self {
        let entry = |i: usize, j: usize| Vec3(rotation.0[i]).times(diagonal).dot(Vec3(rotation.0[j]));
        Self([entry(0, 0), entry(1, 1), entry(2, 2), entry(0, 1), entry(0, 2), entry(1, 2)])
    }

    /// `rotation` times `self` times its transpose.
    #[inline(always)]
    pub fn rotated(&self, rotation: &Mat3<T>) -> Self {
        let [a, b, c] = rotation.0;
        let (a, b, c) = (Vec3(a), Vec3(b), Vec3(c));
        let (p, q, r) = (self.apply(a), self.apply(b), self.apply(c));
        Self([a.dot(p), b.dot(q), c.dot(r), a.dot(q), a.dot(r), b.dot(r)])
    }

    /// The matrix times `v`.
    #[inline(always)]
    pub fn apply(&self, v: Vec3<T>) -> Vec3<T> {
        let [xx, yy, zz, xy, xz, yz] = self.0;
        let [x, y, z] = v.0;
        Vec3([xx * x + xy * y + xz * z, xy * x + yy * y + yz * z, xz * x + yz * y + zz * z])
    }

    /// Inertia of the point mass `mass` at `at`, about the origin.
    #[inline(always)]
    pub fn of_point(mass: T, at: Vec3<T>) -> Self {
        let [x, y, z] = at.0;
        let [mx, my, mz] = (at * mass).0;
        let (xx, yy, zz) = (mx * x, my * y, mz * z);
        Self([yy + zz, xx + zz, xx + yy, -(mx * y), -(mx * z), -(my * z)])
    }
}

impl<T: Scalar> Add for Sym3<T> {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        let ([a, b, c, d, e, f], [u, v, w, x, y, z]) = (self.0, other.0);
        Self([a + u, b + v, c + w, d + x, e + y, f + z])
    }
}
