//! Convex solids and where rays meet them.

use crate::optics::camera::Ray;
use crate::optics::vec::{V3, smoothstep, v3};

/// Over this much the edges of flat faces are shaded as broken.
const BROKEN_EDGE_M: f64 = 0.0006;

/// The form of a solid.
#[derive(Clone, Debug)]
pub(crate) enum Shape {
    /// The hull of two balls; `cut` keeps what lies on the side of the point that the direction shows to.
    RoundCone { a: V3, b: V3, ra_m: f64, rb_m: f64, cut: Option<(V3, V3)> },
    /// The hull of two circles in the plane of motion, from one y to another.
    Slab { a: V3, b: V3, ra_m: f64, rb_m: f64, y0_m: f64, y1_m: f64, cut: Option<(V3, V3)> },
    /// An ellipsoid turned in the plane of motion.
    Ellipsoid { centre: V3, half_m: V3, turn_rad: f64 },
    /// A box turned in the plane of motion.
    Box { centre: V3, half_m: V3, turn_rad: f64 },
}

/// A solid of a material. Keypoints are not hidden by solids of their own owner.
#[derive(Clone, Debug)]
pub(crate) struct Solid {
    pub(crate) shape: Shape,
    pub(crate) material: usize,
    pub(crate) owner: u16,
    /// Where its texture begins, so that texture runs on from one solid to the next.
    pub(crate) along_m: f64,
    bound: (V3, V3, f64),
}

/// Where a ray enters a solid.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Hit {
    pub(crate) t: f64,
    pub(crate) normal: V3,
}

impl Solid {
    pub(crate) fn new(shape: Shape, material: usize, owner: u16) -> Solid {
        let bound = bound(&shape);
        Solid { shape, material, owner, along_m: 0.0, bound }
    }

    /// A capsule that holds the solid: two points and a radius.
    pub(crate) fn capsule(&self) -> (V3, V3, f64) {
        self.bound
    }

    /// Whether a ray of unit direction can meet the solid at all.
    fn near(&self, ray: &Ray) -> bool {
        let (a, b, r) = self.bound;
        let c = (a + b) * 0.5 - ray.from;
        let reach = r + (b - a).norm() * 0.5;
        let t = c.dot(ray.along);
        c.dot(c) - t * t <= reach * reach
    }

    /// Where the ray, of unit direction, enters the solid from outside.
    pub(crate) fn hit(&self, ray: &Ray) -> Option<Hit> {
        if !self.near(ray) {
            return None;
        }
        let (o, d) = (ray.from, ray.along);
        match &self.shape {
            Shape::RoundCone { a, b, ra_m, rb_m, cut } => {
                let (t0, t1) = hull(o, d, *a, *b, *ra_m, *rb_m)?;
                cut_entry(ray, t0, t1, None, cut, |p| hull_normal(p, *a, *b, *ra_m, *rb_m))
            }
            Shape::Slab { a, b, ra_m, rb_m, y0_m, y1_m, cut } => {
                let (t0, t1) = hull(o.in_plane(), d.in_plane(), *a, *b, *ra_m, *rb_m)?;
                let (f0, f1) = slab(o.y, d.y, *y0_m, *y1_m)?;
                let face = (f0 > t0).then(|| v3(0.0, -d.y.signum(), 0.0));
                let face = face.map(|f| {
                    // The edges of hard links are a little broken, and catch light; what tapers is soft.
                    if ra_m != rb_m {
                        return f;
                    }
                    let p = ray.at(f0).in_plane();
                    let edge = smoothstep(BROKEN_EDGE_M, 0.0, hull_depth(p, *a, *b, *ra_m, *rb_m));
                    (f + hull_normal(p, *a, *b, *ra_m, *rb_m) * edge).unit()
                });
                cut_entry(ray, t0.max(f0), t1.min(f1), face, cut, |p| {
                    hull_normal(p.in_plane(), *a, *b, *ra_m, *rb_m)
                })
            }
            Shape::Ellipsoid { centre, half_m, turn_rad } => {
                let (o, d) = ((o - *centre).turned(-turn_rad), d.turned(-turn_rad));
                let inv = half_m.map(|h| 1.0 / h);
                let (t0, _) = ball(o.times(inv), d.times(inv), V3::ZERO, 1.0)?;
                let p = o + d * t0;
                (t0 > 1e-9).then(|| Hit { t: t0, normal: p.times(inv).times(inv).unit().turned(*turn_rad) })
            }
            Shape::Box { centre, half_m, turn_rad } => {
                let (o, d) = ((o - *centre).turned(-turn_rad), d.turned(-turn_rad));
                let (mut t0, mut t1, mut n) = (f64::MIN, f64::MAX, V3::ZERO);
                let axes = [
                    (o.x, d.x, half_m.x, v3(1.0, 0.0, 0.0)),
                    (o.y, d.y, half_m.y, v3(0.0, 1.0, 0.0)),
                    (o.z, d.z, half_m.z, v3(0.0, 0.0, 1.0)),
                ];
                for (o, d, h, axis) in axes {
                    let (a, b) = slab(o, d, -h, h)?;
                    if a > t0 {
                        (t0, n) = (a, axis * -d.signum());
                    }
                    t1 = t1.min(b);
                }
                (t0 < t1 && t0 > 1e-9).then(|| Hit { t: t0, normal: n.turned(*turn_rad) })
            }
        }
    }

    /// Where a point of the surface lies in the solid's texture: along it and across it [m].
    pub(crate) fn texture_at(&self, p: V3) -> (f64, f64, f64) {
        match &self.shape {
            Shape::RoundCone { a, b, .. } | Shape::Slab { a, b, .. } => {
                let w = (*b - *a).unit();
                let s = (p - *a).dot(w);
                (s + self.along_m, (p - *a).dot(v3(-w.z, 0.0, w.x)), p.y)
            }
            Shape::Ellipsoid { centre, turn_rad, .. } | Shape::Box { centre, turn_rad, .. } => {
                let q = (p - *centre).turned(-turn_rad);
                (q.x + self.along_m, q.z, q.y)
            }
        }
    }
}

/// Applies the cut to an interval and makes the hit; `face` is the normal where the entry is not on the hull.
fn cut_entry(
    ray: &Ray,
    mut t0: f64,
    mut t1: f64,
    face: Option<V3>,
    cut: &Option<(V3, V3)>,
    normal: impl Fn(V3) -> V3,
) -> Option<Hit> {
    let mut face = face;
    if let Some((at, towards)) = cut {
        let (above, rate) = ((ray.from - *at).dot(*towards), ray.along.dot(*towards));
        let t = -above / rate;
        if rate > 0.0 && t > t0 {
            (t0, face) = (t, Some(-*towards));
        } else if rate < 0.0 {
            t1 = t1.min(t);
        } else if rate == 0.0 && above < 0.0 {
            return None;
        }
    }
    (t0 < t1 && t0 > 1e-9).then(|| Hit { t: t0, normal: face.unwrap_or_else(|| normal(ray.at(t0))) })
}

/// Where a line is between two parallel planes.
fn slab(o: f64, d: f64, low: f64, high: f64) -> Option<(f64, f64)> {
    if d.abs() < 1e-15 {
        return (low < o && o < high).then_some((f64::MIN, f64::MAX));
    }
    let (a, b) = ((low - o) / d, (high - o) / d);
    Some((a.min(b), a.max(b)))
}

/// Where a line is inside a ball.
fn ball(o: V3, d: V3, centre: V3, r_m: f64) -> Option<(f64, f64)> {
    let q = o - centre;
    let (a, b, c) = (d.dot(d), q.dot(d), q.dot(q) - r_m * r_m);
    let under = b * b - a * c;
    if under <= 0.0 || a < 1e-20 {
        return None;
    }
    let root = under.sqrt();
    Some(((-b - root) / a, (-b + root) / a))
}

/// Where a line is inside the hull of two balls: each part of the hull lies in it, so the outermost crossings count.
fn hull(o: V3, d: V3, a: V3, b: V3, ra_m: f64, rb_m: f64) -> Option<(f64, f64)> {
    let (mut t0, mut t1) = (f64::MAX, f64::MIN);
    let mut take = |s: f64, e: f64| {
        t0 = t0.min(s);
        t1 = t1.max(e);
    };
    for (c, r) in [(a, ra_m), (b, rb_m)] {
        if let Some((s, e)) = ball(o, d, c, r) {
            take(s, e);
        }
    }
    let length = (b - a).norm();
    if length > (ra_m - rb_m).abs() {
        let w = (b - a) * (1.0 / length);
        let k = (ra_m - rb_m) / length;
        let c = (1.0 - k * k).sqrt();
        let q = o - a;
        let (oh, dh) = (q.dot(w), d.dot(w));
        let (r0, rate) = ((ra_m - k * oh) / c, k * dh / c);
        let qa = d.dot(d) - dh * dh - rate * rate;
        let qb = q.dot(d) - oh * dh + r0 * rate;
        let qc = q.dot(q) - oh * oh - r0 * r0;
        let under = qb * qb - qa * qc;
        if under > 0.0 && qa.abs() > 1e-20 {
            let root = under.sqrt();
            for t in [(-qb - root) / qa, (-qb + root) / qa] {
                let h = oh + t * dh;
                if h >= ra_m * k && h <= length + rb_m * k {
                    take(t, t);
                }
            }
        }
    }
    (t0 < t1).then_some((t0, t1))
}

/// The outward normal of the hull of two balls at a point of its surface.
fn hull_normal(p: V3, a: V3, b: V3, ra_m: f64, rb_m: f64) -> V3 {
    let length = (b - a).norm();
    let w = (b - a) * (1.0 / length.max(1e-12));
    let k = ((ra_m - rb_m) / length.max(1e-12)).clamp(-1.0, 1.0);
    let h = (p - a).dot(w);
    if h <= ra_m * k {
        (p - a).unit()
    } else if h >= length + rb_m * k {
        (p - b).unit()
    } else {
        (p - a - w * h).unit() * (1.0 - k * k).sqrt() + w * k
    }
}

/// How deep a point lies inside the hull of two balls.
fn hull_depth(p: V3, a: V3, b: V3, ra_m: f64, rb_m: f64) -> f64 {
    let length = (b - a).norm();
    let w = (b - a) * (1.0 / length.max(1e-12));
    let k = ((ra_m - rb_m) / length.max(1e-12)).clamp(-1.0, 1.0);
    let h = (p - a).dot(w);
    if h <= ra_m * k {
        ra_m - (p - a).norm()
    } else if h >= length + rb_m * k {
        rb_m - (p - b).norm()
    } else {
        ra_m - k * h - (p - a - w * h).norm() * (1.0 - k * k).sqrt()
    }
}

/// A capsule that holds the shape.
fn bound(shape: &Shape) -> (V3, V3, f64) {
    match shape {
        Shape::RoundCone { a, b, ra_m, rb_m, .. } => (*a, *b, ra_m.max(*rb_m)),
        Shape::Slab { a, b, ra_m, rb_m, y0_m, y1_m, .. } => {
            let y = v3(0.0, (y0_m + y1_m) * 0.5, 0.0);
            (*a + y, *b + y, ra_m.max(*rb_m).hypot((y1_m - y0_m) * 0.5))
        }
        Shape::Ellipsoid { centre, half_m, .. } => (*centre, *centre, half_m.x.max(half_m.y).max(half_m.z)),
        Shape::Box { centre, half_m, turn_rad } => {
            let long = half_m.x >= half_m.z;
            let axis = if long { v3(half_m.x, 0.0, 0.0) } else { v3(0.0, 0.0, half_m.z) }.turned(*turn_rad);
            let across = if long { half_m.z } else { half_m.x };
            (*centre - axis, *centre + axis, across.hypot(half_m.y))
        }
    }
}
