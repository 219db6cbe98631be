//! What moves in the tank beside the mechanism.

use crate::optics::mechanism::Mechanism;
use crate::optics::motion::Motion;
use crate::optics::solids::{Shape, Solid};
use crate::optics::vec::{V3, smoothstep, v3};
use crate::optics::world::FOREIGN;
use std::f64::consts::TAU;

/// Something that moves.
#[derive(Clone, Debug)]
pub(crate) enum Actor {
    /// A second mechanism of the same sizes.
    Twin { motion: Motion, material: usize },
    /// Air bubbles that rise: start, radius, speed, and phase of their swerving.
    Bubbles { each: Vec<(V3, f64, f64, f64)>, material: usize, from_z_m: f64, to_z_m: f64 },
    /// A hand on its forearm that comes in from a side: visits as (from, to) in time.
    Hand { tip: V3, angle_rad: f64, size: f64, visits_s: Vec<(f64, f64)>, material: usize },
    /// A fish that passes: (start time, start, velocity) for each passage.
    Fish { passages: Vec<(f64, V3, f64)>, lasts_s: f64, half_length_m: f64, material: usize, fin: usize },
}

/// Where things wait that are not there: far behind the camera.
const AWAY: V3 = v3(0.0, -5.0, 3.0);

impl Actor {
    /// The name of the trouble this makes at a time, if it is there.
    pub(crate) fn trouble(&self, t_s: f64) -> Option<&'static str> {
        match self {
            Actor::Twin { .. } => Some("twin"),
            Actor::Bubbles { .. } => Some("bubbles"),
            Actor::Hand { visits_s, .. } => {
                visits_s.iter().any(|v| presence(*v, t_s) > 0.05).then_some("hand")
            }
            Actor::Fish { passages, lasts_s, .. } => passages
                .iter()
                .find(|p| (0.0..*lasts_s).contains(&(t_s - p.0)))
                .map(|p| if p.1.y > 0.0 { "fish-behind" } else { "fish-before" }),
        }
    }

    /// Adds its solids at a time, always as many.
    pub(crate) fn solids(&self, t_s: f64, mechanism: &Mechanism, to: &mut Vec<Solid>) {
        match self {
            Actor::Twin { motion, material } => {
                to.extend(mechanism.solids(&motion.at(t_s), *material, FOREIGN))
            }
            Actor::Bubbles { each, material, from_z_m, to_z_m } => {
                let range = to_z_m - from_z_m;
                for &(start, r, speed, phase) in each {
                    let z = from_z_m + (start.z - from_z_m + speed * t_s).rem_euclid(range);
                    let swerve = 0.0025 * (TAU * 3.0 * t_s + phase).sin();
                    let centre = v3(start.x + swerve, start.y + 0.4 * swerve, z);
                    to.push(Solid::new(
                        Shape::Ellipsoid { centre, half_m: V3::all(r), turn_rad: 0.0 },
                        *material,
                        FOREIGN,
                    ));
                }
            }
            Actor::Hand { tip, angle_rad, size, visits_s, material } => {
                let p = visits_s.iter().map(|v| presence(*v, t_s)).fold(0.0, f64::max);
                let back = v3(-(1.0 - p) * 0.35, 0.0, 0.0).turned(*angle_rad);
                let sway = v3(0.0, 0.0, 0.004 * (TAU * 0.9 * t_s).sin());
                let origin = if p > 0.0 { *tip + back + sway } else { AWAY };
                hand(origin, *angle_rad, *size, *material, to);
            }
            Actor::Fish { passages, lasts_s, half_length_m, material, fin } => {
                let now = passages.iter().find(|p| (0.0..*lasts_s).contains(&(t_s - p.0)));
                let (at, speed) = now.map_or((AWAY, 1.0), |p| {
                    let s = t_s - p.0;
                    (p.1 + v3(p.2 * s, 0.0, 0.006 * (TAU * 0.8 * s).sin()), p.2)
                });
                fish(at, speed.signum(), t_s, *half_length_m, *material, *fin, to);
            }
        }
    }
}

/// How far in something is that comes and goes within a visit: 0 away, 1 all in.
fn presence((from_s, to_s): (f64, f64), t_s: f64) -> f64 {
    smoothstep(from_s, from_s + 0.35, t_s) * smoothstep(to_s, to_s - 0.35, t_s)
}

/// A hand whose middle finger's tip is at the origin, and which comes from the side that the angle leads from.
fn hand(origin: V3, angle_rad: f64, size: f64, material: usize, to: &mut Vec<Solid>) {
    let mut part = |a: V3, b: V3, ra: f64, rb: f64| {
        let place = |p: V3| origin + (p * size).turned(angle_rad);
        let shape =
            Shape::RoundCone { a: place(a), b: place(b), ra_m: ra * size, rb_m: rb * size, cut: None };
        to.push(Solid::new(shape, material, FOREIGN));
    };
    // Palm of two thick parts, wrist and forearm, four fingers of two bones, and the thumb.
    part(v3(-0.085, 0.0, 0.016), v3(-0.14, 0.0, 0.010), 0.019, 0.021);
    part(v3(-0.085, 0.0, -0.016), v3(-0.14, 0.0, -0.008), 0.018, 0.021);
    part(v3(-0.14, 0.0, 0.0), v3(-0.19, 0.0, 0.0), 0.026, 0.022);
    part(v3(-0.18, 0.0, 0.0), v3(-0.5, 0.0, 0.02), 0.022, 0.042);
    let fingers =
        [(0.027, -0.012, 0.0085), (0.010, 0.0, 0.009), (-0.008, -0.006, 0.0085), (-0.026, -0.024, 0.0075)];
    for (z, reach, r) in fingers {
        let (root, knuckle, end) =
            (v3(-0.085, 0.0, z), v3(-0.04 + reach * 0.5, -0.008, z * 1.15), v3(reach, 0.004, z * 1.1));
        part(root, knuckle, r * 1.15, r);
        part(knuckle, end, r, r * 0.8);
    }
    part(v3(-0.135, -0.004, 0.02), v3(-0.095, -0.012, 0.05), 0.014, 0.011);
    part(v3(-0.095, -0.012, 0.05), v3(-0.062, -0.010, 0.058), 0.011, 0.008);
}

/// A fish that swims along x with a beating tail.
fn fish(at: V3, ahead: f64, t_s: f64, half_m: f64, material: usize, fin: usize, to: &mut Vec<Solid>) {
    let beat = (TAU * 3.0 * t_s).sin();
    let flip = |x: f64, y: f64, z: f64| at + v3(x * ahead, y, z) * half_m;
    let body = Shape::Ellipsoid { centre: at, half_m: v3(1.0, 0.22, 0.36) * half_m, turn_rad: 0.0 };
    to.push(Solid::new(body, material, FOREIGN));
    let mut part = |a: V3, b: V3, ra: f64, rb: f64, m: usize| {
        let shape = Shape::RoundCone { a, b, ra_m: ra * half_m, rb_m: rb * half_m, cut: None };
        to.push(Solid::new(shape, m, FOREIGN));
    };
    let root = flip(-1.15, 0.1 * beat, 0.0);
    part(flip(-0.7, 0.0, 0.0), root, 0.2, 0.08, material);
    part(root, flip(-1.55, 0.3 * beat, 0.36), 0.06, 0.03, fin);
    part(root, flip(-1.55, 0.3 * beat, -0.36), 0.06, 0.03, fin);
    part(flip(-1.45, 0.27 * beat, 0.24), flip(-1.45, 0.27 * beat, -0.24), 0.06, 0.06, fin);
    part(flip(0.25, 0.0, 0.32), flip(-0.35, 0.0, 0.46), 0.05, 0.03, fin);
    part(flip(-0.35, 0.0, 0.46), flip(-0.5, 0.0, 0.26), 0.04, 0.03, fin);
    part(flip(0.78, -0.14, 0.08), flip(0.781, -0.141, 0.08), 0.055, 0.055, fin);
}
