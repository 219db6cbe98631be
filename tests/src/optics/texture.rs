//! Patterns of surfaces: factors by which a material's colour is multiplied, about one on the whole.

use crate::optics::vec::{V3, scramble, smoothstep, v3};

/// A pattern.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Texture {
    Plain,
    /// Irregular brightness of this size and share.
    Mottled {
        size_m: f64,
        share: f64,
    },
    /// Glazed tiles with darker or brighter joints between them.
    Tiles {
        size_m: f64,
        joint_m: f64,
        joint_level: f64,
        spread: f64,
        shift_m: (f64, f64),
    },
    /// Green-brown growth in blotches over a ground.
    Algae {
        size_m: f64,
        cover: f64,
    },
    /// Stripes along, as on a fish.
    Scales {
        size_m: f64,
    },
}

impl Texture {
    /// The factor at a point of a surface [m].
    pub(crate) fn at(&self, (u, v, w): (f64, f64, f64)) -> V3 {
        match *self {
            Texture::Plain => V3::all(1.0),
            Texture::Mottled { size_m, share } => {
                let n = cloud(v3(u, v, w) * (1.0 / size_m), 3, 11);
                V3::all(1.0 + share * 2.0 * (n - 0.5))
            }
            Texture::Tiles { size_m, joint_m, joint_level, spread, shift_m } => {
                let (a, b) = ((u + shift_m.0) / size_m, (v + shift_m.1) / size_m);
                let (ia, ib) = (a.floor(), b.floor());
                let edge = |f: f64| f.min(1.0 - f) * size_m;
                let d = edge(a - ia).min(edge(b - ib));
                let tile = 1.0 + spread * 2.0 * (lattice(ia as i64, ib as i64, 0, 5) - 0.5);
                let cool = 0.5 * spread * (lattice(ia as i64, ib as i64, 1, 6) - 0.5);
                let grain = 1.0 + 0.08 * (cloud(v3(u, v, 0.0) * 400.0, 3, 7) - 0.5);
                let bevel = 1.0 + 0.10 * smoothstep(joint_m * 1.6, joint_m * 0.8, d);
                let glaze = v3(tile * (1.0 - cool), tile, tile * (1.0 + cool)) * (grain * bevel);
                let rough = joint_level * (0.8 + 0.4 * cloud(v3(u, v, 0.0) * 1500.0, 2, 9));
                let s = smoothstep(joint_m * 0.4, joint_m * 0.6, d);
                glaze * s + V3::all(rough) * (1.0 - s)
            }
            Texture::Algae { size_m, cover } => {
                let n = cloud(v3(u, v, 0.0) * (1.0 / size_m), 5, 21);
                let fine = cloud(v3(u, v, 0.3) * (9.0 / size_m), 3, 22);
                let growth = smoothstep(0.60 - cover * 0.4, 0.78 - cover * 0.2, n * 0.85 + fine * 0.15);
                let ground = V3::all(0.97 + 0.10 * (fine - 0.5));
                let green = v3(0.42, 0.50, 0.27) * (0.6 + 0.8 * fine);
                ground * (1.0 - growth * 0.75) + green * (growth * 0.75)
            }
            Texture::Scales { size_m } => {
                let back = smoothstep(-0.006, 0.006, v);
                let scales = 1.0 + 0.12 * ((u / size_m).sin() * (v / size_m + u / size_m * 0.5).sin());
                v3(0.95, 1.0, 1.0) * (scales * (1.25 - 0.75 * back))
            }
        }
    }
}

/// A number in 0..1 of a lattice point.
fn lattice(x: i64, y: i64, z: i64, seed: u32) -> f64 {
    let k = (x as u32).wrapping_mul(0x9E37_79B1)
        ^ (y as u32).wrapping_mul(0x85EB_CA77)
        ^ (z as u32).wrapping_mul(0xC2B2_AE3D);
    scramble(k ^ seed.wrapping_mul(0x27D4_EB2F)) as f64 / 4_294_967_296.0
}

/// Smooth noise in 0..1 with a lattice of one unit.
pub(crate) fn noise(p: V3, seed: u32) -> f64 {
    let (fx, fy, fz) = (p.x.floor(), p.y.floor(), p.z.floor());
    let s = |t: f64| t * t * (3.0 - 2.0 * t);
    let (u, v, w) = (s(p.x - fx), s(p.y - fy), s(p.z - fz));
    let (x, y, z) = (fx as i64, fy as i64, fz as i64);
    let mix = |a: f64, b: f64, t: f64| a + (b - a) * t;
    let plane = |z: i64| {
        let low = mix(lattice(x, y, z, seed), lattice(x + 1, y, z, seed), u);
        let high = mix(lattice(x, y + 1, z, seed), lattice(x + 1, y + 1, z, seed), u);
        mix(low, high, v)
    };
    mix(plane(z), plane(z + 1), w)
}

/// Octaves of noise, in 0..1.
pub(crate) fn cloud(p: V3, octaves: u32, seed: u32) -> f64 {
    let (mut sum, mut weight, mut total) = (0.0, 1.0, 0.0);
    for i in 0..octaves {
        let f = (1u32 << i) as f64;
        sum += weight * noise(p * f + V3::all(i as f64 * 17.3), seed + i);
        total += weight;
        weight *= 0.5;
    }
    sum / total
}
