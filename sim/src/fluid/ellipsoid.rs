//! MuJoCo's ellipsoid fluid model.

use std::f64::consts::PI;

use super::added_mass;
use crate::math::{Vec3, Vector};
use crate::model::{FluidCoefficients, KuttaLift};
use crate::scalar::Scalar;
use crate::space::{ShapeAxes, Space, Spatial};

/// An ellipsoid with its coefficients, ready to be moved through water.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ellipsoid<T> {
    /// Added mass over density \[m3\].
    added_mass: [f64; 3],
    /// Added inertia over density \[m5\].
    added_inertia: [f64; 3],
    /// Squares of r_j r_k \[m4\].
    section_squared: [f64; 3],
    /// Area seen from the thinnest axis \[m2\].
    largest_area: f64,
    /// 6 pi rbar \[m\] and 8 pi rbar^3 \[m3\]: Stokes' sphere of the mean radius.
    stokes: [f64; 2],
    /// c2 I + c1 (Imax - I) \[m5\].
    angular_drag: Vec3<T>,
    /// c4 V \[m3\].
    magnus: T,
    /// pi c3.
    kutta: T,
    blunt: T,
    slender: T,
    /// What older engines divided by at least.
    floor: f64,
}

impl<T: Scalar> Ellipsoid<T> {
    /// The ellipsoid with semi-axes `r` \[m\], each above 0.
    pub fn new(r: [f64; 3], coefficients: FluidCoefficients<T>) -> Self {
        let added = added_mass(r);
        let mut sorted = r;
        sorted.sort_by(f64::total_cmp);
        let [_, mid, high] = sorted;
        let mean = (r[0] + r[1] + r[2]) / 3.0;
        let section: [f64; 3] = std::array::from_fn(|i| r[(i + 1) % 3] * r[(i + 2) % 3]);
        let moment: [f64; 3] =
            std::array::from_fn(|i| 8.0 / 15.0 * PI * r[i] * r[(i + 1) % 3].max(r[(i + 2) % 3]).powi(4));
        let largest = 8.0 / 15.0 * PI * mid * high.powi(4);
        let FluidCoefficients { blunt, slender, angular, kutta, magnus } = coefficients;
        Self {
            added_mass: added.mass,
            added_inertia: added.inertia,
            section_squared: section.map(|s| s * s),
            largest_area: PI * mid * high,
            stokes: [6.0 * PI * mean, 8.0 * PI * mean * mean * mean],
            angular_drag: Vec3(moment.map(|i| angular * T::from_f64(i) + slender * T::from_f64(largest - i))),
            magnus: magnus * T::from_f64(4.0 / 3.0 * PI * r[0] * r[1] * r[2]),
            kutta: kutta * T::from_f64(PI),
            blunt,
            slender,
            floor: 0.0,
        }
    }

    /// The same with the lift of these engines. Before 3.14, num and |v| den of [`Self::wrench`] were at least 1e-15, in SI.
    #[must_use]
    pub fn with_lift(self, lift: KuttaLift) -> Self {
        let floor = match lift {
            KuttaLift::Whole => 0.0,
            KuttaLift::Clamped => 1e-15,
        };
        Self { floor, ..self }
    }

    /// Torque \[N m\] and force \[N\] of water of `density` \[kg/m3\] and dynamic `viscosity` \[Pa s\].
    ///
    /// * `w`, `v`: angular velocity \[rad/s\] and velocity of the centre relative to the water \[m/s\]
    /// * all vectors in the ellipsoid's axes; the force acts at its centre
    ///
    /// F = rho (mA v) x w + c4 rho V w x v + c3 rho A cos(a) (n x v) x v
    ///     - (6 pi mu rbar + rho |v| (c0 A + c1 (Amax - A))) v
    ///
    /// T = rho (mA v) x v + rho (IA w) x w - (8 pi mu rbar^3 + rho |(c2 I + c1 (Imax - I)) w|) w
    ///
    /// with the projected area A = pi sqrt(den / num), num = sum (s v)^2, den = sum s^4 v^2, s_i = r_j r_k, its
    /// normal n = s^2 v / sqrt(den), cos(a) = n.v / |v|. Smooth enough at rest: every derivative is finite.
    ///
    /// # Source
    /// MuJoCo, "Fluid forces", ellipsoid model (3.14 and later, where the lift holds at any size).
    pub fn wrench(&self, density: T, viscosity: T, w: Vec3<T>, v: Vec3<T>) -> (Vec3<T>, Vec3<T>) {
        Immersed::<Spatial<T>>::new(self, [0, 1, 2]).wrench(density, viscosity, w, v)
    }
}

/// The shape as the water meets it: what the formulas of [`Ellipsoid::wrench`] have in common.
struct Projection<S: Space> {
    /// |v| \[m/s\].
    speed: S::T,
    /// The normal of the projected area, not of length 1: s^2 v.
    normal: S::Vec,
    /// num, which is normal.v.
    num: S::T,
    /// |v| den, den being normal.normal.
    speed_den: S::T,
    /// Projected area A over pi \[m2\].
    area_over_pi: S::T,
}

/// What resists a shape's motion, per unit of velocity.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Resistance<T> {
    /// Viscous part against moving \[N s/m\].
    pub(crate) slow: T,
    /// Quadratic part against moving \[N s/m\].
    pub(crate) quadratic: T,
    /// Viscous part against turning \[N m s\].
    pub(crate) slow_turning: T,
    /// Quadratic part against turning \[N m s\].
    pub(crate) turning: T,
}

/// The ellipsoid on the axes of the space it moves in; its geometry, the same in every lane, in their order.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Immersed<S: Space> {
    added_mass: [f64; 3],
    added_inertia: [f64; 3],
    section_squared: [f64; 3],
    largest_area: f64,
    stokes: [f64; 2],
    angular_drag: S::Spin,
    magnus: S::T,
    kutta: S::T,
    blunt: S::T,
    slender: S::T,
    floor: f64,
}

impl<S: Space> Immersed<S> {
    pub(crate) fn new(shape: &Ellipsoid<S::T>, axes: ShapeAxes) -> Self {
        Self {
            added_mass: axes.map(|k| shape.added_mass[k]),
            added_inertia: axes.map(|k| shape.added_inertia[k]),
            section_squared: axes.map(|k| shape.section_squared[k]),
            largest_area: shape.largest_area,
            stokes: shape.stokes,
            angular_drag: S::shape_spin(axes, shape.angular_drag),
            magnus: shape.magnus,
            kutta: shape.kutta,
            blunt: shape.blunt,
            slender: shape.slender,
            floor: shape.floor,
        }
    }

    /// See [`Ellipsoid::wrench`].
    #[inline(always)]
    pub(crate) fn wrench(&self, density: S::T, viscosity: S::T, w: S::Spin, v: S::Vec) -> (S::Spin, S::Vec) {
        let momentum = S::constant(self.added_mass).times(v) * density;
        let spin = S::constant_spin(self.added_inertia).times(w) * density;

        let projection = self.projection(v);
        let Projection { normal, num, speed_den, area_over_pi, .. } = projection;
        let moving = S::T::ZERO.less(speed_den);
        let lift = self.kutta * area_over_pi * num / S::T::select(moving, speed_den, S::T::ONE);
        let drag = self.resisted(density, viscosity, w, &projection);

        let force = S::cross(S::moment(normal, v), v) * (density * lift)
            - S::cross(w, momentum - v * (density * self.magnus))
            - v * (drag.slow + drag.quadratic);
        let torque = S::moment(momentum, v) + S::twist(spin, w) - w * (drag.slow_turning + drag.turning);
        (torque, force)
    }

    #[inline(always)]
    fn projection(&self, v: S::Vec) -> Projection<S> {
        let speed = v.norm();
        let normal = S::constant(self.section_squared).times(v);
        let num = normal.dot(v);
        let den = normal.dot(normal);
        // at rest both quotients are 0 / 0 and what they multiply is 0
        let (mut speed_den, mut area_num) = (den * speed, num);
        let moving = S::T::ZERO.less(speed_den);
        if self.floor > 0.0 {
            let floor = S::T::from_f64(self.floor);
            (speed_den, area_num) = (speed_den.max(floor), area_num.max(floor));
        }
        let area_over_pi = (den / S::T::select(moving, area_num, S::T::ONE)).sqrt();
        Projection { speed, normal, num, speed_den, area_over_pi }
    }

    /// What resists moving and turning: force = -(slow + quadratic) v, torque = -(slow_turning + turning) w.
    #[inline(always)]
    pub(crate) fn resistance(
        &self,
        density: S::T,
        viscosity: S::T,
        w: S::Spin,
        v: S::Vec,
    ) -> Resistance<S::T> {
        self.resisted(density, viscosity, w, &self.projection(v))
    }

    #[inline(always)]
    fn resisted(
        &self,
        density: S::T,
        viscosity: S::T,
        w: S::Spin,
        &Projection { speed, area_over_pi, .. }: &Projection<S>,
    ) -> Resistance<S::T> {
        let area = area_over_pi * S::T::from_f64(PI);
        let [slow, slow_turning] = self.stokes;
        let (slow, slow_turning) = (S::T::from_f64(slow), S::T::from_f64(slow_turning));
        let largest = S::T::from_f64(self.largest_area);
        Resistance {
            slow: viscosity * slow,
            quadratic: density * speed * (self.blunt * area + self.slender * (largest - area)),
            slow_turning: viscosity * slow_turning,
            // no coefficient is negative
            turning: density * self.angular_drag.times(w).growing_norm(),
        }
    }

    /// Added mass \[m3\] and inertia \[m5\] over density, on the shape's axes.
    pub(crate) fn added(&self) -> (S::Vec, S::Spin) {
        (S::constant(self.added_mass), S::constant_spin(self.added_inertia))
    }
}

impl<T: Scalar> Immersed<Spatial<T>> {
    pub(crate) fn map<U: Scalar>(&self, f: impl Fn(T) -> U + Copy) -> Immersed<Spatial<U>> {
        Immersed {
            added_mass: self.added_mass,
            added_inertia: self.added_inertia,
            section_squared: self.section_squared,
            largest_area: self.largest_area,
            stokes: self.stokes,
            angular_drag: self.angular_drag.map(f),
            magnus: f(self.magnus),
            kutta: f(self.kutta),
            blunt: f(self.blunt),
            slender: f(self.slender),
            floor: self.floor,
        }
    }
}
