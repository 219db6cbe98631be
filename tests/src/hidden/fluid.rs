//! MuJoCo's ellipsoid in water, in the plane: motion along and across the long axis, turning about the depth.

use std::f64::consts::PI;

use super::chain::Plane;

/// Blunt, slender, angular, Kutta, Magnus.
pub type Coefficients = [f64; 5];

/// An ellipsoid whose long axis lies in the picture.
#[derive(Debug, Clone, Copy)]
pub struct Ellipsoid {
    /// Semi-axes along the link, across it in the picture, and in depth \[m\].
    pub axes_m: [f64; 3],
    /// Coefficients of the water's forces.
    pub coefficients: Coefficients,
    volume_m3: f64,
    added_m3: Plane,
    added_m5: f64,
}

/// What the water does without resisting.
pub(super) struct Carried {
    /// Along and across \[N\].
    pub(super) force: Plane,
    pub(super) torque: f64,
}

/// Resistance per unit of velocity or rate.
pub(super) struct Drag {
    pub(super) slow: f64,
    pub(super) quadratic: f64,
    pub(super) slow_turning: f64,
    pub(super) turning: f64,
}

impl Ellipsoid {
    /// With semi-axes `axes_m`: along, across, deep.
    pub fn new(axes_m: [f64; 3], coefficients: Coefficients) -> Self {
        let [a, b, c] = axes_m;
        let volume_m3 = 4.0 / 3.0 * PI * a * b * c;
        let [along, across] = [lamb(a, b, c), lamb(b, c, a)];
        let (difference, sum) = (a * a - b * b, a * a + b * b);
        let added_m5 = volume_m3 / 5.0 * difference * difference * (across - along)
            / (2.0 * difference + sum * (along - across));
        let added_m3 = [along, across].map(|k| volume_m3 * k / (2.0 - k));
        Self { axes_m, coefficients, volume_m3, added_m3, added_m5 }
    }

    /// The same shape with other coefficients.
    #[must_use]
    pub fn with(mut self, coefficients: Coefficients) -> Self {
        self.coefficients = coefficients;
        self
    }

    /// Water carried along and across \[kg\].
    pub fn added_kg(&self, density: f64) -> Plane {
        self.added_m3.map(|m3| m3 * density)
    }

    /// Inertia of the water carried in turning \[kg m2\].
    pub fn added_kg_m2(&self, density: f64) -> f64 {
        self.added_m5 * density
    }

    /// Munk's force and moment and the two lifts; `v` along and across.
    pub(super) fn carried(&self, density: f64, v: Plane, w: f64, facing: &Facing) -> Carried {
        let [.., kutta, magnus] = self.coefficients;
        let momentum = [self.added_m3[0] * density * v[0], self.added_m3[1] * density * v[1]];
        let spin = magnus * density * self.volume_m3 * w;
        let mut force = [w * momentum[1] - spin * v[1], -w * momentum[0] + spin * v[0]];
        let tilt = facing.normal[0] * v[1] - facing.normal[1] * v[0];
        let lift = kutta * density * facing.area * facing.cosine * tilt;
        force = [force[0] - lift * v[1], force[1] + lift * v[0]];
        Carried { force, torque: momentum[0] * v[1] - momentum[1] * v[0] }
    }

    /// Resistance at the rate `w`.
    pub(super) fn drag(&self, density: f64, viscosity: f64, w: f64, facing: &Facing) -> Drag {
        let [a, b, c] = self.axes_m;
        let [blunt, slender, angular, ..] = self.coefficients;
        let mean = (a + b + c) / 3.0;
        let high = a.max(b).max(c);
        let mid = a.min(b).max(c.min(a.max(b)));
        let Facing { speed, area, .. } = *facing;
        let about_depth = 8.0 / 15.0 * PI * c * a.max(b).powi(4);
        let largest = 8.0 / 15.0 * PI * mid * high.powi(4);
        Drag {
            slow: 6.0 * PI * viscosity * mean,
            quadratic: density * speed * (blunt * area + slender * (PI * mid * high - area)),
            slow_turning: 8.0 * PI * viscosity * mean.powi(3),
            turning: density * (angular * about_depth + slender * (largest - about_depth)).abs() * w.abs(),
        }
    }

    /// The shape as a flow along `v` meets it.
    pub(super) fn facing(&self, v: Plane) -> Facing {
        let [a, b, c] = self.axes_m;
        let (along, across) = (b * c, a * c);
        let speed = (v[0] * v[0] + v[1] * v[1]).sqrt();
        if speed == 0.0 {
            return Facing::default();
        }
        let d = [v[0] / speed, v[1] / speed];
        let flat = (along * d[0]).powi(2) + (across * d[1]).powi(2);
        let normal = [along * along * d[0], across * across * d[1]];
        let steep = (normal[0] * normal[0] + normal[1] * normal[1]).sqrt();
        let normal = normal.map(|part| part / steep);
        let cosine = normal[0] * d[0] + normal[1] * d[1];
        Facing { speed, area: PI * steep / flat.sqrt(), normal, cosine }
    }
}

/// A shape as the flow meets it; all 0 in still water.
#[derive(Default)]
pub(super) struct Facing {
    pub(super) speed: f64,
    /// Area seen along the flow \[m2\].
    area: f64,
    normal: Plane,
    /// Between the normal and the flow.
    cosine: f64,
}

/// a b c int_0^inf dl / ((a^2 + l) sqrt((a^2 + l)(b^2 + l)(c^2 + l))), by Simpson's rule with l = a^2 (e^s - 1).
fn lamb(a: f64, b: f64, c: f64) -> f64 {
    const PARTS: usize = 40_000;
    const END: f64 = 40.0;
    let term = |s: f64| {
        let grown = a * a * s.exp();
        let l = grown - a * a;
        grown / (grown * (grown * (b * b + l) * (c * c + l)).sqrt())
    };
    let h = END / PARTS as f64;
    let inner: f64 = (1..PARTS).map(|k| term(k as f64 * h) * if k % 2 == 1 { 4.0 } else { 2.0 }).sum();
    a * b * c * (term(0.0) + inner + term(END)) * h / 3.0
}
