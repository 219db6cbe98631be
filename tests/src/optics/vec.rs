//! Vectors of three numbers, which serve as points, directions and linear RGB colours.

use std::ops::{Add, AddAssign, Mul, Neg, Sub};

/// A point or direction [m], or a linear colour.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct V3 {
    pub(crate) x: f64,
    pub(crate) y: f64,
    pub(crate) z: f64,
}

/// Makes a vector.
pub(crate) const fn v3(x: f64, y: f64, z: f64) -> V3 {
    V3 { x, y, z }
}

impl V3 {
    pub(crate) const ZERO: V3 = v3(0.0, 0.0, 0.0);

    /// A vector with three equal parts.
    pub(crate) const fn all(a: f64) -> V3 {
        v3(a, a, a)
    }

    pub(crate) fn dot(self, o: V3) -> f64 {
        self.x * o.x + self.y * o.y + self.z * o.z
    }

    pub(crate) fn norm(self) -> f64 {
        self.dot(self).sqrt()
    }

    pub(crate) fn unit(self) -> V3 {
        self * (1.0 / self.norm().max(1e-300))
    }

    /// The product part by part, as of a colour and an albedo.
    pub(crate) fn times(self, o: V3) -> V3 {
        v3(self.x * o.x, self.y * o.y, self.z * o.z)
    }

    pub(crate) fn map(self, f: impl Fn(f64) -> f64) -> V3 {
        v3(f(self.x), f(self.y), f(self.z))
    }

    /// The vector without its part along y: what lies in the plane of motion.
    pub(crate) fn in_plane(self) -> V3 {
        v3(self.x, 0.0, self.z)
    }

    /// The vector turned counter-clockwise as the camera sees it, about the axis -y.
    pub(crate) fn turned(self, angle_rad: f64) -> V3 {
        let (s, c) = angle_rad.sin_cos();
        v3(c * self.x - s * self.z, self.y, s * self.x + c * self.z)
    }

    /// The mirror image of a direction at a surface of unit normal `n`.
    pub(crate) fn mirrored(self, n: V3) -> V3 {
        self - n * (2.0 * self.dot(n))
    }
}

impl Add for V3 {
    type Output = V3;
    fn add(self, o: V3) -> V3 {
        v3(self.x + o.x, self.y + o.y, self.z + o.z)
    }
}
impl AddAssign for V3 {
    fn add_assign(&mut self, o: V3) {
        *self = *self + o;
    }
}
impl Sub for V3 {
    type Output = V3;
    fn sub(self, o: V3) -> V3 {
        v3(self.x - o.x, self.y - o.y, self.z - o.z)
    }
}
impl Mul<f64> for V3 {
    type Output = V3;
    fn mul(self, a: f64) -> V3 {
        v3(self.x * a, self.y * a, self.z * a)
    }
}
impl Neg for V3 {
    type Output = V3;
    fn neg(self) -> V3 {
        v3(-self.x, -self.y, -self.z)
    }
}

/// The direction of light that enters a medium `ratio` = n_from / n_to at unit normal `n` facing it; none where it is totally
/// reflected.
pub(crate) fn refracted(d: V3, n: V3, ratio: f64) -> Option<V3> {
    let c = -d.dot(n);
    let under = 1.0 - ratio * ratio * (1.0 - c * c);
    (under > 0.0).then(|| d * ratio + n * (ratio * c - under.sqrt()))
}

/// A scrambled number in 0..1 of an integer key.
pub(crate) fn hash01(key: u32) -> f64 {
    scramble(key) as f64 / 4_294_967_296.0
}

/// The PCG hash of an integer.
pub(crate) fn scramble(key: u32) -> u32 {
    let s = key.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
    let w = ((s >> ((s >> 28) + 4)) ^ s).wrapping_mul(277_803_737);
    (w >> 22) ^ w
}

/// Zero below `a`, one above `b`, smooth between.
pub(crate) fn smoothstep(a: f64, b: f64, x: f64) -> f64 {
    let t = ((x - a) / (b - a)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}
