//! Where two boxes meet.
//!
//! The direction in which they are farthest apart, or overlap least, is a face's normal or stands on two edges (separating
//! axes: Gottschalk, Lin and Manocha, OBBTree, 1996). Of a face, the points are the corners of what is left of the other box's
//! nearest face when it is cut off at the face's sides (Sutherland and Hodgman, 1974); of two edges, their nearest points.
//! Limits and preferences are MuJoCo's, so that the points are.

use super::points::{Placed, Point, less};
use crate::math::Vec3;
use crate::scalar::Scalar;

/// Separations this small, over the boxes' sizes, count as rounding.
const SEPARATION_ROUNDING_SHARE: f64 = 1e-13;
/// Edges with a smaller square of the sine between them count as parallel.
const PARALLEL_SINE_SQUARED_MAX: f64 = 1e-16;
/// Share by which edges must separate the boxes better than a face, to be used.
const EDGE_PREFERENCE_SHARE_MIN: f64 = 1e-6;
/// Edges whose direction has this cosine with the best face's normal must separate the boxes better by this share.
const EDGE_NEAR_FACE_COSINE_AND_SHARE: (f64, f64) = (0.99, 0.05);
/// A component of the direction below this does not determine which of two edges is the outer one.
const EDGE_COMPONENT_ZERO_MAX: f64 = 1e-9;
/// Corners closer than this, squared and over the square of the face's size, are one.
const POINT_MERGE_SHARE_SQUARED: f64 = 1e-14;
/// Smallest divisor, as in MuJoCo.
const DIVISOR_MIN: f64 = 1e-15;

/// A box by its three axes.
struct Block<T> {
    at: Vec3<T>,
    axes: [Vec3<T>; 3],
    size: [T; 3],
}

impl<T: Scalar> Block<T> {
    fn new(shape: &Placed<T>) -> Self {
        Self {
            at: shape.at,
            axes: std::array::from_fn(|k| shape.rot.column(k)),
            size: shape.size.map(T::from_f64),
        }
    }

    /// Half of how far it extends along `direction`.
    fn extent(&self, direction: Vec3<T>) -> T {
        let part = |k: usize| self.axes[k].dot(direction).abs() * self.size[k];
        part(0) + part(1) + part(2)
    }
}

/// A direction in which the boxes may be apart.
#[derive(Clone, Copy)]
enum Direction {
    /// Of which box, and which of its axes.
    Face(usize, usize),
    /// One edge of each.
    Edges(usize, usize),
}

/// The points of two boxes within `reach`.
pub(super) fn meet<T: Scalar>(one: &Placed<T>, two: &Placed<T>, reach: T, out: &mut Vec<Point<T>>) {
    let blocks = [Block::new(one), Block::new(two)];
    let offset = two.at - one.at;
    let sizes = one.size.iter().chain(&two.size).sum::<f64>();
    let slack = reach + T::from_f64(SEPARATION_ROUNDING_SHARE * sizes);
    let gap_along = |direction: Vec3<T>| {
        offset.dot(direction).abs() - blocks[0].extent(direction) - blocks[1].extent(direction)
    };
    let mut best = (T::from_f64(f64::NEG_INFINITY), Direction::Face(0, 0), Vec3::ZERO);
    for (owner, block) in blocks.iter().enumerate() {
        for (k, &axis) in block.axes.iter().enumerate() {
            let gap = gap_along(axis);
            if less(slack, gap) {
                return;
            }
            if less(best.0, gap) {
                best = (gap, Direction::Face(owner, k), axis);
            }
        }
    }
    let face = best;
    for i in 0..3 {
        for j in 0..3 {
            let across = blocks[0].axes[i].cross(blocks[1].axes[j]);
            let squared = across.dot(across);
            if less(squared, T::from_f64(PARALLEL_SINE_SQUARED_MAX)) {
                continue;
            }
            let across = across * (T::ONE / squared.sqrt());
            let gap = gap_along(across);
            if less(slack, gap) {
                return;
            }
            let biased = gap - gap.abs() * T::from_f64(EDGE_PREFERENCE_SHARE_MIN);
            if less(best.0, biased) && less(face.0, gap) {
                best = (gap, Direction::Edges(i, j), across);
            }
        }
    }
    let (cosine, share) = EDGE_NEAR_FACE_COSINE_AND_SHARE;
    let needed = face.0 + face.0.abs() * T::from_f64(share) + T::from_f64(DIVISOR_MIN);
    let is_near_face = less(T::from_f64(cosine), best.2.dot(face.2).abs());
    match best.1 {
        Direction::Edges(i, j) if !(is_near_face && less(best.0, needed)) => {
            edges(
                &blocks,
                [i, j],
                if less(best.2.dot(offset), T::ZERO) { -best.2 } else { best.2 },
                slack,
                out,
            );
        }
        _ => {
            if let Direction::Face(owner, axis) = face.1 {
                faces(&blocks[owner], &blocks[1 - owner], axis, owner == 0, reach, out);
            }
        }
    }
}

/// The nearest points of the outer edges along the axes `along`; `normal` goes from the first box to the second.
fn edges<T: Scalar>(
    blocks: &[Block<T>; 2],
    along: [usize; 2],
    normal: Vec3<T>,
    slack: T,
    out: &mut Vec<Point<T>>,
) {
    // middles of the outer edges of each; two where the normal does not tell
    let middles = |side: usize| {
        let block = &blocks[side];
        let mut middle = block.at;
        let mut other = None;
        for ahead in [1, 2] {
            let k = (along[side] + ahead) % 3;
            let component = block.axes[k].dot(normal);
            let arm = block.axes[k] * block.size[k];
            // by the sign of the component along the normal, for both alike
            let outer = if less(component, T::ZERO) == (side == 0) { -arm } else { arm };
            middle += outer;
            if other.is_none() && less(component.abs(), T::from_f64(EDGE_COMPONENT_ZERO_MAX)) {
                other = Some(outer * T::from_f64(-2.0));
            }
        }
        (middle, other.map(|shift| middle + shift))
    };
    let (first, second) = (middles(0), middles(1));
    let (u, w) = (blocks[0].axes[along[0]], blocks[1].axes[along[1]]);
    let (long_u, long_w) = (blocks[0].size[along[0]], blocks[1].size[along[1]]);
    let cosine = u.dot(w);
    let sine2 = T::ONE - cosine * cosine;
    let mut nearest: Option<(T, Vec3<T>, Vec3<T>)> = None;
    for a in [Some(first.0), first.1].into_iter().flatten() {
        for b in [Some(second.0), second.1].into_iter().flatten() {
            let offset = b - a;
            let (on_u, on_w) = (u.dot(offset), w.dot(offset));
            let free =
                if less(sine2, T::from_f64(DIVISOR_MIN)) { T::ZERO } else { (on_u - cosine * on_w) / sine2 };
            let s = free.clamp(-long_u, long_u);
            let t = (cosine * s - on_w).clamp(-long_w, long_w);
            let s = (on_u + cosine * t).clamp(-long_u, long_u);
            let (p, q) = (a + u * s, b + w * t);
            let squared = (q - p).dot(q - p);
            if nearest.is_none_or(|(least, ..)| less(squared, least)) {
                nearest = Some((squared, p, q));
            }
        }
    }
    if let Some((_, p, q)) = nearest {
        let distance = (q - p).dot(normal);
        if !less(slack, distance) {
            out.push(Point { at: (p + q) * T::from_f64(0.5), normal, along: None, distance });
        }
    }
}

/// Most corners of a polygon of four corners that is cut four times.
const POLYGON_CORNERS_MAX: usize = 8;

/// Corners with their two places on a face and their height above it.
struct Polygon<T> {
    corners: [[T; 3]; POLYGON_CORNERS_MAX],
    count: usize,
}

impl<T: Scalar> Polygon<T> {
    fn push(&mut self, corner: [T; 3]) {
        if self.count < POLYGON_CORNERS_MAX {
            self.corners[self.count] = corner;
            self.count += 1;
        }
    }

    /// What is left where `sign` times the place `k` is no more than `limit`.
    fn cut(&self, k: usize, sign: T, limit: T) -> Self {
        let mut left = Self { corners: [[T::ZERO; 3]; POLYGON_CORNERS_MAX], count: 0 };
        let beyond = |corner: &[T; 3]| sign * corner[k] - limit;
        for (index, corner) in self.corners[..self.count].iter().enumerate() {
            let next = &self.corners[(index + 1) % self.count];
            let (here, there) = (beyond(corner), beyond(next));
            if !less(T::ZERO, here) {
                left.push(*corner);
            }
            if (less(here, T::ZERO) && less(T::ZERO, there)) || (less(T::ZERO, here) && less(there, T::ZERO))
            {
                let share = here / (here - there);
                left.push(std::array::from_fn(|i| corner[i] + share * (next[i] - corner[i])));
            }
        }
        left
    }
}

/// The other box's face over the face of `block` across its axis `a`; `first` when `block` is the first of the pair.
fn faces<T: Scalar>(
    block: &Block<T>,
    other: &Block<T>,
    a: usize,
    first: bool,
    reach: T,
    out: &mut Vec<Point<T>>,
) {
    let offset = other.at - block.at;
    let outward = if less(offset.dot(block.axes[a]), T::ZERO) { -block.axes[a] } else { block.axes[a] };
    let facing: [T; 3] = std::array::from_fn(|k| other.axes[k].dot(outward));
    let mut b = 0;
    for k in 1..3 {
        if less(facing[b].abs(), facing[k].abs()) {
            b = k;
        }
    }
    let towards = if less(T::ZERO, facing[b]) { -other.size[b] } else { other.size[b] };
    let (x, y) = ((a + 1) % 3, (a + 2) % 3);
    let on_face = |v: Vec3<T>| [v.dot(block.axes[x]), v.dot(block.axes[y]), v.dot(outward)];
    let (bu, bv) = ((b + 1) % 3, (b + 2) % 3);
    let (u, v) = (on_face(other.axes[bu] * other.size[bu]), on_face(other.axes[bv] * other.size[bv]));
    let mut middle = on_face(offset + other.axes[b] * towards);
    middle[2] -= block.size[a];
    let mut polygon = Polygon { corners: [[T::ZERO; 3]; POLYGON_CORNERS_MAX], count: 0 };
    let (plus, minus) = (T::ONE, -T::ONE);
    for [su, sv] in [[plus, plus], [minus, plus], [minus, minus], [plus, minus]] {
        polygon.push(std::array::from_fn(|i| middle[i] + su * u[i] + sv * v[i]));
    }
    let (long_x, long_y) = (block.size[x], block.size[y]);
    for (k, limit) in [(0, long_x), (1, long_y)] {
        polygon = polygon.cut(k, plus, limit).cut(k, minus, limit);
    }
    let same = T::from_f64(POINT_MERGE_SHARE_SQUARED) * (long_x * long_x + long_y * long_y);
    for (index, corner) in polygon.corners[..polygon.count].iter().enumerate() {
        let near = |other: &[T; 3]| {
            let (dx, dy) = (other[0] - corner[0], other[1] - corner[1]);
            less(dx * dx + dy * dy, same)
        };
        let low = |other: &&[T; 3]| !less(reach, other[2]);
        if !low(&corner) || polygon.corners[..index].iter().filter(low).any(near) {
            continue;
        }
        let [px, py, height] = *corner;
        let at = block.at
            + block.axes[x] * px
            + block.axes[y] * py
            + outward * (block.size[a] + height * T::from_f64(0.5));
        let normal = if first { outward } else { -outward };
        out.push(Point { at, normal, along: None, distance: height });
    }
}
