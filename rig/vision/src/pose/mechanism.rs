//! A serial mechanism in its plane: where its solids, keypoints and outline are for a pose.

use sim::math::Vec3;
use sim::model::GeomKind;
use sim::{JointKind, Model};

use camera::calibration::View;

use super::place::{Place, across, dot, lerp, minus, norm, plus, scaled, turned, unit};
use super::shared::Shared;

/// A solid of one body, in the plane: a strip along a straight axis with rounded ends.
#[derive(Debug, Clone, PartialEq)]
struct Solid {
    /// Which link carries it, from the base.
    link: usize,
    /// Where its axis begins and ends, from the link's pivot at rest \[m\].
    axis: [Place; 2],
    /// Half widths at both ends of the axis, by the model \[m\].
    half_width: [f64; 2],
    /// Half of its depth along the camera's view \[m\].
    half_depth: f64,
    /// Whether the axis' beginning and end are ends of the mechanism's outline.
    capped: [bool; 2],
    /// How far along the mechanism both ends of the axis are, from 0 to 1.
    shares: [f64; 2],
}

/// Where on a solid a point of the outline is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Spot {
    /// On the side to the right (-1) or left (+1) of the axis, at this share of its length.
    Side(f64, f64),
    /// On the end beyond the axis' beginning (0) or end (1), at this share of the half width beside the axis.
    Cap(usize, f64),
}

/// A point of the outline for a pose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct OutlinePoint {
    /// Where \[m\].
    pub(super) at: Place,
    /// Outward, unit length.
    pub(super) normal: Place,
    /// The link that carries it.
    pub(super) link: usize,
    /// Half depth of its solid by the model \[m\].
    pub(super) half_depth: f64,
    /// How far it moves along its normal with the width factors at root and tip \[m\].
    pub(super) by_width: [f64; 2],
    /// How far it moves along its normal for each metre that it is seen beyond the model's, as [`Shared::beyond_m`] says.
    pub(super) by_beyond: f64,
    /// Nothing of the mechanism lies before or behind it.
    pub(super) is_rim: bool,
}

/// A row of points along the outline, neighbours one after the other.
pub(super) type Run = std::ops::Range<usize>;

/// A serial mechanism that turns in the plane.
#[derive(Debug, Clone, PartialEq)]
pub struct Mechanism {
    /// From each link's pivot to the next one's, the last one's to its tip, at rest \[m\].
    ways: Vec<Place>,
    solids: Vec<Solid>,
    spots: Vec<(usize, Spot)>,
    runs: Vec<Run>,
    /// Link and place from its pivot at rest \[m\].
    keypoints: Vec<(usize, Place)>,
    /// Whether it bends smoothly: a soft arm.
    is_soft: bool,
    /// Radius of its ends' corners as a share of the half width: 0 square, 1 round.
    rounding: f64,
}

/// Points on a side of a link at least, chosen.
const MIN_SPOTS_PER_SIDE: usize = 3;
/// Points of an end, as shares of the half width beside the axis, clear of a square one's corners; chosen.
const CAP_SHARES: [f64; 7] = [-0.9, -0.6, -0.3, 0.0, 0.3, 0.6, 0.9];
/// A hinge turns in the plane when its axis has at least this component along the view.
const MIN_AXIS_COMPONENT: f64 = 0.99;
/// A place so far within another solid is covered by it \[m\].
const COVERED_M: f64 = 2e-5;

impl Mechanism {
    /// Of `model` as `view` shows it; none where it is not one row of hinges in the plane that is held at its first one. `is_soft`: its links
    /// are the pieces of something that bends.
    pub fn of(model: &Model, view: View, is_soft: bool) -> Option<Self> {
        let rest = model.poses(&model.rest_state().qpos);
        let seen = |place: Vec3<f64>| view.seen(place.0);
        let depth = view.depth_axis();
        let moved: Vec<usize> = model.joints.iter().map(|joint| joint.body).collect();
        let in_plane = |joint: &sim::model::Joint<f64>| {
            joint.kind == JointKind::Hinge
                && rest.body_rot[joint.body].apply(joint.axis).0[depth].abs() > MIN_AXIS_COMPONENT
        };
        let serial = moved.windows(2).all(|pair| carrier(model, pair[1], &moved) == Some(pair[0]));
        if moved.is_empty() || !serial || !model.joints.iter().all(in_plane) {
            return None;
        }
        if carrier(model, moved[0], &moved).is_some() {
            return None;
        }
        let pivots: Vec<Place> = model
            .joints
            .iter()
            .map(|joint| seen(rest.body_pos[joint.body] + rest.body_rot[joint.body].apply(joint.pos)))
            .collect();
        let link = |body: usize| {
            let on = if moved.contains(&body) { Some(body) } else { carrier(model, body, &moved) };
            on.and_then(|on| moved.iter().position(|moved| *moved == on))
        };
        let keypoints: Vec<(usize, Place)> = model
            .keypoint_sites()
            .into_iter()
            .map(|site| {
                let link = link(model.sites[site].body)?;
                Some((link, minus(seen(rest.site_pos[site]), pivots[link])))
            })
            .collect::<Option<_>>()?;
        let first = keypoints.first()?;
        // P0 is what is held
        if first.0 != 0 || norm(first.1) > COVERED_M {
            return None;
        }
        let tip = keypoints.last()?;
        let mut solids = Vec::new();
        for (i, geom) in model.geoms.iter().enumerate() {
            let Some(link) = link(geom.body) else { continue };
            let axes = [0, 1, 2].map(|k| rest.geom_rot[i].column(k));
            let Some(strip) = Strip::of(geom.kind, geom.size, axes, view) else { continue };
            let centre = minus(seen(rest.geom_pos[i]), pivots[link]);
            let reach = strip.half_length - strip.half_width;
            // away from the pivot
            let along = if dot(centre, strip.along) < 0.0 { scaled(strip.along, -1.0) } else { strip.along };
            solids.push(Solid {
                link,
                axis: [-1.0, 1.0].map(|sign| plus(centre, scaled(along, sign * reach.max(0.0)))),
                half_width: [strip.half_width; 2],
                half_depth: strip.half_depth,
                capped: [true, true],
                shares: [0.0; 2],
            });
        }
        if solids.is_empty() {
            return None;
        }
        let mut ways: Vec<Place> = pivots.windows(2).map(|pair| minus(pair[1], pair[0])).collect();
        ways.push(tip.1);
        if is_soft {
            solids = tapered(&ways, &solids)?;
        }
        let total: f64 = ways.iter().map(|way| norm(*way)).sum();
        for solid in &mut solids {
            let before: f64 = ways[..solid.link].iter().map(|way| norm(*way)).sum();
            solid.shares = solid.axis.map(|end| ((before + norm(end)) / total).clamp(0.0, 1.0));
        }
        Some(Self { ways, solids, spots: Vec::new(), runs: Vec::new(), keypoints, is_soft, rounding: 1.0 })
    }

    /// The same, its outline read at points about `spacing_m` apart.
    pub(super) fn laid_out(mut self, spacing_m: f64) -> Self {
        let mut sides: [Vec<(usize, Spot)>; 2] = [Vec::new(), Vec::new()];
        let mut caps = Vec::new();
        let mut runs = Vec::new();
        for (k, solid) in self.solids.iter().enumerate() {
            let length = norm(minus(solid.axis[1], solid.axis[0]));
            let count = ((length / spacing_m).round() as usize).max(MIN_SPOTS_PER_SIDE);
            for (side, sign) in [-1.0, 1.0].into_iter().enumerate() {
                for i in 0..count {
                    sides[side].push((k, Spot::Side(sign, (i as f64 + 0.5) / count as f64)));
                }
            }
            if !self.is_soft {
                // each link's sides are runs of their own
                for side in &mut sides {
                    let begin = self.spots.len();
                    self.spots.append(side);
                    runs.push(begin..self.spots.len());
                }
            }
            for end in (0..2).filter(|&end| solid.capped[end]) {
                caps.push(CAP_SHARES.map(|share| (k, Spot::Cap(end, share))));
            }
        }
        for mut run in sides.into_iter().filter(|side| !side.is_empty()) {
            let begin = self.spots.len();
            self.spots.append(&mut run);
            runs.push(begin..self.spots.len());
        }
        for cap in caps {
            let begin = self.spots.len();
            self.spots.extend(cap);
            runs.push(begin..self.spots.len());
        }
        self.runs = runs;
        self
    }

    /// The same with ends whose corners have this radius, as a share of the half width.
    pub(super) fn rounded(&self, rounding: f64) -> Self {
        Self { rounding, ..self.clone() }
    }

    /// Number of its keypoints.
    pub fn keypoints_count(&self) -> usize {
        self.keypoints.len()
    }

    /// Half depth of each link along the camera's view \[m\].
    pub(super) fn half_depths_m(&self) -> Vec<f64> {
        let of = |link: usize| {
            self.solids.iter().filter(move |solid| solid.link == link).map(|solid| solid.half_depth)
        };
        (0..self.links()).map(|link| of(link).fold(0.0, f64::max)).collect()
    }

    /// Half width of its tip, by the model \[m\].
    pub(super) fn tip_half_width_m(&self) -> f64 {
        self.solids.last().map_or(0.0, |solid| solid.half_width[1])
    }

    /// Number of links, each with an angle in a pose.
    pub(super) fn links(&self) -> usize {
        self.ways.len()
    }

    pub(super) fn is_soft(&self) -> bool {
        self.is_soft
    }

    /// Rows of points along the outline, in the order of [`Self::outline`].
    pub(super) fn runs(&self) -> &[Run] {
        &self.runs
    }

    /// Number of points of the outline.
    pub(super) fn points(&self) -> usize {
        self.spots.len()
    }

    /// Where the pivots and the tip are; shape (links + 1); and how far each link is turned from rest \[rad\].
    ///
    /// A pose is how far each link is turned against the one before it \[rad\], shape (links).
    pub(super) fn pivots(&self, pose: &[f64], base: Place) -> (Vec<Place>, Vec<[f64; 2]>) {
        let (mut at, mut turn) = (vec![base], 0.0);
        let mut turns = Vec::with_capacity(pose.len());
        for (way, angle) in self.ways.iter().zip(pose) {
            turn += angle;
            let (sin, cos) = f64::sin_cos(turn);
            turns.push([cos, sin]);
            at.push(plus(at[at.len() - 1], turned(*way, [cos, sin])));
        }
        (at, turns)
    }

    /// Where the keypoints are.
    pub(super) fn keypoints(&self, pose: &[f64], base: Place) -> Vec<Place> {
        let (pivots, turns) = self.pivots(pose, base);
        self.keypoints.iter().map(|(link, at)| plus(pivots[*link], turned(*at, turns[*link]))).collect()
    }

    /// How the keypoints move with the pose \[m/rad\]: for each, by each angle.
    pub(super) fn keypoint_slopes(&self, pose: &[f64], base: Place) -> Vec<Vec<Place>> {
        let (pivots, _) = self.pivots(pose, base);
        let places = self.keypoints(pose, base);
        let slope = |link: usize, at: Place, joint: usize| {
            if joint <= link { across(minus(at, pivots[joint])) } else { [0.0; 2] }
        };
        let of = |((link, _), at): (&(usize, Place), Place)| {
            (0..self.links()).map(|joint| slope(*link, at, joint)).collect()
        };
        self.keypoints.iter().zip(places).map(of).collect()
    }

    fn half_widths(&self, solid: &Solid, width: [f64; 2]) -> [f64; 2] {
        [0, 1].map(|end| solid.half_width[end] * (width[0] + (width[1] - width[0]) * solid.shares[end]))
    }

    /// The outline for a pose.
    pub(super) fn outline(&self, pose: &[f64], shared: &Shared) -> Vec<OutlinePoint> {
        let (pivots, turns) = self.pivots(pose, shared.base);
        let placed: Vec<Strips> =
            self.solids.iter().map(|solid| self.placed(solid, &pivots, &turns, shared)).collect();
        let mut points: Vec<OutlinePoint> = self
            .spots
            .iter()
            .map(|&(k, spot)| {
                let (solid, strip) = (&self.solids[k], &placed[k]);
                let shares = solid.shares;
                let (along, [left, right]) = (strip.along, strip.half_width);
                let side = across(along);
                let (at, normal, by, by_beyond) = match spot {
                    Spot::Side(sign, share) => {
                        let middle = lerp(strip.axis[0], strip.axis[1], share);
                        let half = left + (right - left) * share;
                        let normal = scaled(side, sign);
                        let by = solid.half_width[0] + (solid.half_width[1] - solid.half_width[0]) * share;
                        let at = shares[0] + (shares[1] - shares[0]) * share;
                        let by_beyond = if self.is_soft { 0.0 } else { 1.0 };
                        (plus(middle, scaled(normal, half)), normal, [by * (1.0 - at), by * at], by_beyond)
                    }
                    Spot::Cap(end, beside) => {
                        let outward = if end == 1 { along } else { scaled(along, -1.0) };
                        let (rounding, half) = (self.rounding, strip.half_width[end]);
                        let on_corner = (beside.abs() - (1.0 - rounding)).max(0.0);
                        let sin = if on_corner > 0.0 { (on_corner / rounding).copysign(beside) } else { 0.0 };
                        let cos = (1.0 - sin * sin).max(0.0).sqrt();
                        let normal = plus(scaled(outward, cos), scaled(side, sin));
                        let beyond = half * (1.0 - rounding * (1.0 - cos));
                        let place = plus(scaled(outward, beyond), scaled(side, half * beside));
                        // the end stays where the model has it, however wide the strip is
                        let by = rounding * (1.0 - cos) + (1.0 - rounding) * sin.abs();
                        let by = solid.half_width[end] * by;
                        let share = shares[end];
                        let by_beyond = match self.is_soft {
                            true if end == 1 => cos,
                            true => 0.0,
                            false => 1.0,
                        };
                        (plus(strip.axis[end], place), normal, [by * (1.0 - share), by * share], by_beyond)
                    }
                };
                OutlinePoint {
                    at,
                    normal,
                    link: solid.link,
                    half_depth: solid.half_depth,
                    by_width: by,
                    by_beyond,
                    is_rim: true,
                }
            })
            .collect();
        for (point, (k, spot)) in points.iter_mut().zip(&self.spots) {
            point.is_rim = !placed.iter().enumerate().any(|(other, strip)| {
                let neighbours = self.is_soft && matches!(spot, Spot::Side(..)) && other.abs_diff(*k) <= 1;
                other != *k && !neighbours && strip.distance(point.at) < -COVERED_M
            });
        }
        points
    }

    fn placed(&self, solid: &Solid, pivots: &[Place], turns: &[[f64; 2]], shared: &Shared) -> Strips {
        let mut half_width = self.half_widths(solid, shared.width);
        let mut axis = solid.axis.map(|end| plus(pivots[solid.link], turned(end, turns[solid.link])));
        let along = unit(minus(axis[1], axis[0]));
        // an end stays where the model has it, however wide it is
        if solid.capped[0] {
            axis[0] = plus(axis[0], scaled(along, half_width[0] - solid.half_width[0]));
        }
        if solid.capped[1] {
            let seen_m = if self.is_soft { shared.beyond_m } else { 0.0 };
            axis[1] = plus(axis[1], scaled(along, solid.half_width[1] - half_width[1] + seen_m));
        }
        if !self.is_soft {
            half_width = half_width.map(|half| half + shared.beyond_m);
        }
        Strips::about(axis, half_width, self.rounding)
    }

    /// The solids for a pose.
    pub(super) fn strips(&self, pose: &[f64], shared: &Shared) -> Vec<Strips> {
        let (pivots, turns) = self.pivots(pose, shared.base);
        self.solids.iter().map(|solid| self.placed(solid, &pivots, &turns, shared)).collect()
    }

    /// Half width of link `link` at this share of its way \[m\].
    pub(super) fn half_width_at(&self, link: usize, share: f64, width: [f64; 2]) -> f64 {
        let solid = self.solids.iter().find(|solid| solid.link == link);
        solid.map_or(0.0, |solid| {
            let [a, b] = self.half_widths(solid, width);
            a + (b - a) * share
        })
    }
}

/// A solid in the plane \[m\], or as it is seen \[px\]: a strip that reaches its half width beyond both ends of its axis, with corners that may be round.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Strips {
    /// Both ends of the axis.
    pub(super) axis: [Place; 2],
    /// The axis' direction, unit length.
    along: Place,
    length: f64,
    /// Half widths at both ends.
    pub(super) half_width: [f64; 2],
    /// Radius of its corners as a share of the half width.
    pub(super) rounding: f64,
}

impl Strips {
    /// About the axis from `axis[0]` to `axis[1]`.
    pub(super) fn about(axis: [Place; 2], half_width: [f64; 2], rounding: f64) -> Self {
        let way = minus(axis[1], axis[0]);
        Self { axis, along: unit(way), length: norm(way), half_width, rounding }
    }

    /// How far `at` is outside; negative inside.
    pub(super) fn distance(&self, at: Place) -> f64 {
        let from = minus(at, self.axis[0]);
        let (ahead, beside) = (dot(from, self.along), dot(from, across(self.along)));
        let share = (ahead / self.length.max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
        let half = self.half_width[0] + (self.half_width[1] - self.half_width[0]) * share;
        // a rectangle about the axis, grown by the corners' radius
        let radius = self.rounding * half;
        let reach = [(-ahead).max(ahead - self.length) - (half - radius), beside.abs() - (half - radius)];
        (reach[0].max(0.0).powi(2) + reach[1].max(0.0).powi(2)).sqrt() + reach[0].max(reach[1]).min(0.0)
            - radius
    }
}

/// The moving body that carries `body`, itself left out.
fn carrier(model: &Model, body: usize, moved: &[usize]) -> Option<usize> {
    let mut at = body;
    while at != 0 {
        at = model.bodies[at].parent;
        if moved.contains(&at) {
            return Some(at);
        }
    }
    None
}

/// A geom as the view shows it.
struct Strip {
    along: Place,
    half_length: f64,
    half_width: f64,
    half_depth: f64,
}

impl Strip {
    fn of(kind: GeomKind, size: [f64; 3], axes: [Vec3<f64>; 3], view: View) -> Option<Self> {
        let half = match kind {
            GeomKind::Sphere => [size[0]; 3],
            GeomKind::Capsule => [size[0], size[0], size[0] + size[1]],
            GeomKind::Cylinder => [size[0], size[0], size[1]],
            GeomKind::Ellipsoid | GeomKind::Box => size,
            GeomKind::Plane => return None,
        };
        let depth = view.depth_axis();
        // the axis that is closest to the camera's view is its depth
        let away = (0..3).max_by(|&a, &b| axes[a].0[depth].abs().total_cmp(&axes[b].0[depth].abs()))?;
        let [a, b] = [(away + 1) % 3, (away + 2) % 3];
        let (long, short) = if half[a] >= half[b] { (a, b) } else { (b, a) };
        Some(Self {
            along: unit(view.seen(axes[long].0)),
            half_length: half[long],
            half_width: half[short],
            half_depth: half[away],
        })
    }
}

/// Solids of an arm: one from pivot to pivot for each link, of half widths that taper evenly; the last one's round end ends at the tip.
fn tapered(ways: &[Place], solids: &[Solid]) -> Option<Vec<Solid>> {
    let lengths: Vec<f64> = ways.iter().map(|way| norm(*way)).collect();
    let ends: Vec<f64> = std::iter::once(0.0)
        .chain(lengths.iter().scan(0.0, |sum, length| {
            *sum += length;
            Some(*sum)
        }))
        .collect();
    let of_link = |link: usize| solids.iter().find(|solid| solid.link == link);
    let known: Vec<(f64, f64)> = (0..ways.len())
        .map(|link| Some(((ends[link] + ends[link + 1]) / 2.0, of_link(link)?.half_width[0])))
        .collect::<Option<_>>()?;
    let (slope, at_root) = line_through(&known);
    let half = |along: f64| at_root + slope * along;
    let last = ways.len() - 1;
    let built = |link: usize| {
        let solid = of_link(link)?;
        let half_width = [half(ends[link]), half(ends[link + 1])];
        let mut end = ways[link];
        if link == last {
            end = scaled(end, ((lengths[link] - half_width[1]) / lengths[link]).max(0.0));
        }
        Some(Solid { axis: [[0.0; 2], end], half_width, capped: [false, link == last], ..solid.clone() })
    };
    (0..ways.len()).map(built).collect()
}

/// Slope and value at 0 of the line of least squares.
fn line_through(points: &[(f64, f64)]) -> (f64, f64) {
    let count = points.len() as f64;
    let mean = |value: &dyn Fn(&(f64, f64)) -> f64| points.iter().map(value).sum::<f64>() / count;
    let (x, y) = (mean(&|point| point.0), mean(&|point| point.1));
    let spread: f64 = points.iter().map(|point| (point.0 - x).powi(2)).sum();
    let slope = if spread > 0.0 {
        points.iter().map(|point| (point.0 - x) * (point.1 - y)).sum::<f64>() / spread
    } else {
        0.0
    };
    (slope, y - slope * x)
}
