//! Small fixed-size algebra over any [`Scalar`]: vectors, rotations, spatial motions and inertias.

use std::ops::{Add, AddAssign, Index, IndexMut, Mul, Neg, Sub, SubAssign};

use crate::scalar::Scalar;

/// A vector of three.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Vec3<T>(pub [T; 3]);

impl<T: Scalar> Vec3<T> {
    /// The zero vector.
    pub const ZERO: Self = Self([T::ZERO; 3]);

    /// A vector of constants.
    pub fn constant(v: [f64; 3]) -> Self {
        Self(v.map(T::from_f64))
    }

    /// Scalar product.
    #[inline(always)]
    pub fn dot(self, other: Self) -> T {
        let ([a, b, c], [x, y, z]) = (self.0, other.0);
        a * x + b * y + c * z
    }

    /// Vector product `self` x `other`.
    #[inline(always)]
    pub fn cross(self, other: Self) -> Self {
        let ([a, b, c], [x, y, z]) = (self.0, other.0);
        Self([b * z - c * y, c * x - a * z, a * y - b * x])
    }

    /// Product component by component.
    #[inline(always)]
    pub fn times(self, other: Self) -> Self {
        let ([a, b, c], [x, y, z]) = (self.0, other.0);
        Self([a * x, b * y, c * z])
    }

    /// Length; its derivative at the zero vector counts as 0.
    #[inline(always)]
    pub fn norm(self) -> T {
        self.dot(self).sqrt()
    }
}

impl<T: Scalar> Add for Vec3<T> {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        let ([a, b, c], [x, y, z]) = (self.0, other.0);
        Self([a + x, b + y, c + z])
    }
}

impl<T: Scalar> Sub for Vec3<T> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        let ([a, b, c], [x, y, z]) = (self.0, other.0);
        Self([a - x, b - y, c - z])
    }
}

impl<T: Scalar> Mul<T> for Vec3<T> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, k: T) -> Self {
        Self(self.0.map(|x| x * k))
    }
}

impl<T: Scalar> Neg for Vec3<T> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self(self.0.map(|x| -x))
    }
}

impl<T: Scalar> AddAssign for Vec3<T> {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl<T: Scalar> SubAssign for Vec3<T> {
    #[inline(always)]
    fn sub_assign(&mut self, other: Self) {
        *self = *self - other;
    }
}

impl<T> Index<usize> for Vec3<T> {
    type Output = T;
    #[inline(always)]
    fn index(&self, i: usize) -> &T {
        &self.0[i]
    }
}

impl<T> IndexMut<usize> for Vec3<T> {
    #[inline(always)]
    fn index_mut(&mut self, i: usize) -> &mut T {
        &mut self.0[i]
    }
}

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
        Vec3(self.0.map(|row| Vec3(row).dot(v)))
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
        Self(self.0.map(|row| other.apply_transposed(Vec3(row)).0))
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
    pub fn conjugate(self) -> Self {
        let [w, x, y, z] = self.0;
        Self([w, -x, -y, -z])
    }

    /// Scaled to unit length.
    pub fn normalized(self) -> Self {
        let [w, x, y, z] = self.0;
        let scale = T::ONE / (w * w + x * x + y * y + z * z).sqrt();
        Self(self.0.map(|c| c * scale))
    }

    /// The rotation by the vector `r`: about its direction, by its length \[rad\].
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

/// A spatial motion: angular velocity and the velocity of the point at the origin, in world axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motion<T> {
    /// Angular part \[rad/s\].
    pub ang: Vec3<T>,
    /// Linear part \[m/s\].
    pub lin: Vec3<T>,
}

impl<T: Scalar> Motion<T> {
    /// No motion.
    pub const ZERO: Self = Self { ang: Vec3::ZERO, lin: Vec3::ZERO };

    /// The sum with `other` times `k`.
    #[inline(always)]
    pub fn plus(self, other: Self, k: T) -> Self {
        Self { ang: self.ang + other.ang * k, lin: self.lin + other.lin * k }
    }

    /// How `other`, riding on `self`, changes: the spatial cross product of motions.
    #[inline(always)]
    pub fn cross(self, other: Self) -> Self {
        Self { ang: self.ang.cross(other.ang), lin: self.ang.cross(other.lin) + self.lin.cross(other.ang) }
    }

    /// How `force`, riding on `self`, changes: the spatial cross product of motion and force.
    #[inline(always)]
    pub fn cross_force(self, force: Wrench<T>) -> Wrench<T> {
        Wrench {
            torque: self.ang.cross(force.torque) + self.lin.cross(force.force),
            force: self.ang.cross(force.force),
        }
    }

    /// The power of `wrench` under this motion.
    #[inline(always)]
    pub fn power(self, wrench: Wrench<T>) -> T {
        self.ang.dot(wrench.torque) + self.lin.dot(wrench.force)
    }
}

/// A torque about the origin and a force, in world axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wrench<T> {
    /// Torque \[N m\].
    pub torque: Vec3<T>,
    /// Force \[N\].
    pub force: Vec3<T>,
}

impl<T: Scalar> Wrench<T> {
    /// None.
    pub const ZERO: Self = Self { torque: Vec3::ZERO, force: Vec3::ZERO };
}

impl<T: Scalar> AddAssign for Wrench<T> {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        self.torque += other.torque;
        self.force += other.force;
    }
}

impl<T: Scalar> SubAssign for Wrench<T> {
    #[inline(always)]
    fn sub_assign(&mut self, other: Self) {
        self.torque -= other.torque;
        self.force -= other.force;
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
        let [a, b, c] = rotation.0.map(Vec3);
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

/// Inertia of a rigid body about the origin, in world axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Inertia<T> {
    /// Mass \[kg\].
    pub mass: T,
    /// Mass times centre of mass \[kg m\].
    pub moment: Vec3<T>,
    /// Rotational inertia about the origin \[kg m2\].
    pub rotational: Sym3<T>,
}

impl<T: Scalar> Inertia<T> {
    /// Of nothing.
    pub const ZERO: Self = Self { mass: T::ZERO, moment: Vec3::ZERO, rotational: Sym3::ZERO };

    /// Momentum under `motion`.
    #[inline(always)]
    pub fn apply(&self, motion: Motion<T>) -> Wrench<T> {
        Wrench {
            torque: self.rotational.apply(motion.ang) + self.moment.cross(motion.lin),
            force: motion.lin * self.mass - self.moment.cross(motion.ang),
        }
    }
}

impl<T: Scalar> AddAssign for Inertia<T> {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        self.mass += other.mass;
        self.moment += other.moment;
        self.rotational = self.rotational + other.rotational;
    }
}
