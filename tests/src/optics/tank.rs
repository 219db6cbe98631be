//! The tank: back wall, floor, side walls, and the water's surface from below.

use crate::optics::camera::Ray;
use crate::optics::vec::{V3, v3};
use std::f64::consts::TAU;

/// The tank's planes; what is none lies out of view.
#[derive(Clone, Debug)]
pub(crate) struct Tank {
    pub(crate) back_y_m: f64,
    pub(crate) floor_z_m: f64,
    pub(crate) half_width_m: f64,
    pub(crate) surface: Option<Surface>,
}

/// The water's surface with small waves.
#[derive(Clone, Debug)]
pub(crate) struct Surface {
    pub(crate) z_m: f64,
    /// Direction, wavelength [m], amplitude [m], rate [Hz] and phase of each wave.
    pub(crate) waves: Vec<(f64, f64, f64, f64, f64)>,
}

/// Which plane a ray meets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Plane {
    Back,
    Floor,
    Side,
    Surface,
    /// The side where the glass and the camera are, which only mirrored rays meet.
    Front,
}

impl Tank {
    /// The first plane a ray meets.
    pub(crate) fn hit(&self, ray: &Ray, t_s: f64) -> (f64, Plane, V3) {
        let (o, d) = (ray.from, ray.along);
        let mut best = (f64::MAX, Plane::Back, v3(0.0, -1.0, 0.0));
        let mut take = |t: f64, plane: Plane, n: V3| {
            if t > 1e-9 && t < best.0 {
                best = (t, plane, n);
            }
        };
        if d.y > 0.0 {
            take((self.back_y_m - o.y) / d.y, Plane::Back, v3(0.0, -1.0, 0.0));
        } else if d.y < 0.0 {
            take((-1.0 - o.y) / d.y, Plane::Front, v3(0.0, 1.0, 0.0));
        }
        if d.z < 0.0 {
            take((self.floor_z_m - o.z) / d.z, Plane::Floor, v3(0.0, 0.0, 1.0));
        } else if let Some(s) = &self.surface
            && d.z > 0.0
        {
            let mut t = (s.z_m - o.z) / d.z;
            // A wave's height moves the place a little; no more than a share of what is left to the wall.
            let p = ray.at(t);
            t += s.height(p, t_s).0 / d.z.max(0.05);
            take(t, Plane::Surface, s.height(ray.at(t), t_s).1);
        }
        if d.x != 0.0 {
            take((self.half_width_m * d.x.signum() - o.x) / d.x, Plane::Side, v3(-d.x.signum(), 0.0, 0.0));
        }
        best
    }
}

impl Surface {
    /// Height above the mean level, and the normal that faces down.
    pub(crate) fn height(&self, p: V3, t_s: f64) -> (f64, V3) {
        let (mut h, mut n) = (0.0, v3(0.0, 0.0, -1.0));
        for &(direction_rad, length_m, amplitude_m, rate_hz, phase_rad) in &self.waves {
            let (s, c) = direction_rad.sin_cos();
            let k = TAU / length_m;
            let (ws, wc) = (k * (c * p.x + s * p.y) - TAU * rate_hz * t_s + phase_rad).sin_cos();
            h += amplitude_m * ws;
            let slope = amplitude_m * k * wc;
            n += v3(c * slope, s * slope, 0.0);
        }
        (h, n.unit())
    }
}
