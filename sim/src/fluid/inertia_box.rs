//! MuJoCo's fluid model for bodies without ellipsoid geoms: the box with the body's inertia.

use std::f64::consts::PI;

use crate::math::{Vec3, Vector};
use crate::scalar::Scalar;
use crate::space::{ShapeAxes, Space, Spatial};

/// The box of equal inertia, ready to be moved through water.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InertiaBox<T> {
    /// pi d^3 \[m3\] and 3 pi d \[m\], d the mean side.
    stokes: [T; 2],
    /// b_i (b_j^4 + b_k^4) / 64 \[m5\].
    turning: Vec3<T>,
    /// b_j b_k / 2 \[m2\].
    half_faces: Vec3<T>,
}

impl<T: Scalar> InertiaBox<T> {
    /// The box of a body with `mass` \[kg\] and principal moments `inertia` \[kg m2\].
    pub fn new(mass: T, inertia: Vec3<T>) -> Self {
        let [a, b, c] = inertia.0;
        // MuJoCo's least value keeps flat bodies from a root of a negative number
        let side = |sum: T| (sum.max(T::from_f64(1e-15)) / mass * T::from_f64(6.0)).sqrt();
        let sides = [side(b + c - a), side(a + c - b), side(a + b - c)];
        let mean = (sides[0] + sides[1] + sides[2]) * T::from_f64(1.0 / 3.0);
        let fourth = sides.map(|b| b * b * b * b);
        let turning = std::array::from_fn(|i| {
            sides[i] * (fourth[(i + 1) % 3] + fourth[(i + 2) % 3]) * T::from_f64(1.0 / 64.0)
        });
        let half_faces = std::array::from_fn(|i| sides[(i + 1) % 3] * sides[(i + 2) % 3] * T::from_f64(0.5));
        Self {
            stokes: [mean * mean * mean * T::from_f64(PI), mean * T::from_f64(3.0 * PI)],
            turning: Vec3(turning),
            half_faces: Vec3(half_faces),
        }
    }

    /// Torque \[N m\] and force \[N\] at the centre of mass, on the principal axes.
    ///
    /// * `w`, `v`: angular velocity \[rad/s\], velocity of the centre of mass relative to the water \[m/s\]
    ///
    /// F_i = -(3 pi d mu + rho/2 b_j b_k |v_i|) v_i; T_i = -(pi d^3 mu + rho/64 b_i (b_j^4 + b_k^4) |w_i|) w_i
    ///
    /// # Source
    /// MuJoCo, "Fluid forces", inertia model.
    pub fn wrench(&self, density: T, viscosity: T, w: Vec3<T>, v: Vec3<T>) -> (Vec3<T>, Vec3<T>) {
        ImmersedBox::<Spatial<T>>::new(self, [0, 1, 2]).wrench(density, viscosity, w, v)
    }
}

/// The box on the axes of the space it moves in.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ImmersedBox<S: Space> {
    stokes: [S::T; 2],
    turning: S::Spin,
    half_faces: S::Vec,
}

impl<S: Space> ImmersedBox<S> {
    pub(crate) fn new(shape: &InertiaBox<S::T>, axes: ShapeAxes) -> Self {
        Self {
            stokes: shape.stokes,
            turning: S::shape_spin(axes, shape.turning),
            half_faces: S::shape_vector(axes, shape.half_faces),
        }
    }

    /// See [`InertiaBox::wrench`].
    #[inline(always)]
    pub(crate) fn wrench(&self, density: S::T, viscosity: S::T, w: S::Spin, v: S::Vec) -> (S::Spin, S::Vec) {
        let [slow_turning, slow] = self.stokes;
        let torque = w * -(viscosity * slow_turning) - self.turning.times(w.magnitudes()).times(w) * density;
        let force = v * -(viscosity * slow) - self.half_faces.times(v.magnitudes()).times(v) * density;
        (torque, force)
    }
}

impl<T: Scalar> ImmersedBox<Spatial<T>> {
    pub(crate) fn map<U: Scalar>(&self, f: impl Fn(T) -> U + Copy) -> ImmersedBox<Spatial<U>> {
        ImmersedBox {
            stokes: self.stokes.map(f),
            turning: self.turning.map(f),
            half_faces: self.half_faces.map(f),
        }
    }
}
