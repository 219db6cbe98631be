//! Light: a panel above the tank, light from all round, and a little from the side of the camera.

use crate::optics::vec::{V3, smoothstep, v3};
use std::f64::consts::TAU;

/// All that lights the tank.
#[derive(Clone, Debug)]
pub(crate) struct Light {
    /// Middle of the panel, and half its size along x and y.
    pub(crate) middle: V3,
    pub(crate) half_m: (f64, f64),
    /// Irradiance of the panel at a metre, in its own direction.
    pub(crate) colour: V3,
    /// Irradiance from all round, on what faces up.
    pub(crate) ambient: V3,
    /// Irradiance from the camera's side, on what faces it.
    pub(crate) fill: V3,
    pub(crate) caustics: Option<Caustics>,
    pub(crate) passing_shadow: Option<PassingShadow>,
}

/// A net of light that small waves throw.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Caustics {
    pub(crate) size_m: f64,
    pub(crate) strength: f64,
    pub(crate) speed_hz: f64,
}

/// A shadow's edge that passes over everything.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PassingShadow {
    pub(crate) from_s: f64,
    pub(crate) speed_m_per_s: f64,
    pub(crate) half_width_m: f64,
    pub(crate) depth: f64,
    pub(crate) start_x_m: f64,
}

impl Light {
    /// A point of the panel for two numbers in 0..1.
    pub(crate) fn sample(&self, u: f64, v: f64) -> V3 {
        self.middle + v3((2.0 * u - 1.0) * self.half_m.0, (2.0 * v - 1.0) * self.half_m.1, 0.0)
    }

    /// Irradiance that the panel's point gives a surface, nothing between them.
    pub(crate) fn direct(&self, from: V3, at: V3, normal: V3) -> V3 {
        let to = from - at;
        let d2 = to.dot(to);
        let l = to * (1.0 / d2.sqrt());
        let (falls, leaves) = (normal.dot(l), l.z);
        if falls <= 0.0 || leaves <= 0.0 { V3::ZERO } else { self.colour * (falls * leaves / d2) }
    }

    /// Irradiance that comes from elsewhere.
    pub(crate) fn indirect(&self, normal: V3) -> V3 {
        self.ambient * (0.55 + 0.45 * normal.z) + self.fill * (-normal.y).max(0.0)
    }

    /// What the water's surface and things above it make of the panel's light at a point and time.
    pub(crate) fn modulation(&self, p: V3, t_s: f64) -> f64 {
        let mut m = 1.0;
        if let Some(c) = &self.caustics {
            // Light comes down aslant: what lies deeper, or further back, sees another part of the net.
            m *= c.at(p.x + 0.25 * p.z, 0.5 * p.y - 0.85 * p.z, t_s);
        }
        if let Some(s) = &self.passing_shadow {
            let x = p.x + 0.3 * p.z - s.start_x_m - s.speed_m_per_s * (t_s - s.from_s);
            let edge = smoothstep(s.half_width_m + 0.012, s.half_width_m - 0.012, x.abs());
            m *= 1.0 - s.depth * edge;
        }
        m
    }
}

impl Caustics {
    /// The net's brightness, about one on the whole.
    fn at(&self, x_m: f64, y_m: f64, t_s: f64) -> f64 {
        let (px, py) = (x_m / self.size_m * TAU * 0.5, y_m / self.size_m * TAU * 0.5);
        let t = t_s * self.speed_hz;
        let (mut ix, mut iy, mut c) = (px, py, 0.0);
        for n in 0..4 {
            let s = t * (1.0 - 3.5 / (n as f64 + 1.0)) + n as f64 * 1.7;
            let nx = px + (s - ix).cos() + (s + iy).sin();
            let ny = py + (s - iy).sin() + (s + ix).cos();
            (ix, iy) = (nx, ny);
            let (a, b) = ((ix + s).sin(), (iy + s).cos());
            c += 1.0 / (0.12 + (a * a * 0.9 + b * b * 0.9).sqrt());
        }
        let bright = (c / 4.0 - 1.0).max(0.0);
        1.0 - 0.45 * self.strength + self.strength * (0.75 * bright).powf(1.3).min(3.0)
    }
}
