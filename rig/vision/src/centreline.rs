//! The middle between the silhouette's two sub-pixel edges, from one end to the other.
//!
//! A thinned path lies on whole pixels, and its ends run into a corner of a square end or stop a half width
//! short. So both ends are trimmed, each remaining point is moved to the middle between the two places along
//! its normal where half the contrast is passed, the line is smoothed, and it is led on, still between the
//! edges, until the silhouette ends.

use super::Mask;
use super::background::Contrast;
use super::rejection::Rejection;
use super::spline::{arc_lengths, distance, moved, resampled, smoothed, tangents, unit};
use camera::calibration::Px;
use ground::statistics::{MEDIAN_TO_SIGMA, median};

/// The mechanism's middle line in one image.
#[derive(Debug, Clone, PartialEq)]
pub struct Centreline {
    /// From base to tip, evenly spaced by about a pixel.
    pub points: Vec<Px>,
    /// Half the distance of the two edges at each point \[px\].
    pub half_width: Vec<f64>,
    /// Arc length, end to end \[px\].
    pub length_px: f64,
    /// Scatter of the single midpoints about the line, 1 sigma \[px\].
    pub scatter_px: f64,
    /// The thinned path it came from, in the same direction: pixel centres.
    pub medial: Vec<Px>,
}

/// Weight of the smoothed core beside single midpoints, and the smoothing length of the whole [px] at most.
const CORE_WEIGHT: f64 = 10.0;
const END_SMOOTHING: f64 = 2.0;
/// Midpoints are found, smoothed and found again this many times.
const MIDPOINT_ROUNDS: usize = 3;
/// An edge is looked for as far as this many half widths of the thinned path, and `REACH_PX` more.
const REACH_HALF_WIDTHS: f64 = 2.0;
const REACH_PX: f64 = 3.0;
/// A half width this many times the thinned path's, and `WIDEST_PX` more, has met something else.
const WIDEST_RATIO: f64 = 1.5;
const WIDEST_PX: f64 = 1.5;
/// Step of looking for an edge \[px\]; below half the blur of any lens.
const STEP_PX: f64 = 0.25;
/// Least share of the line that needs both edges.
const LEAST_SEEN: f64 = 0.5;

impl Centreline {
    /// Follows `medial`, the thinned path of a silhouette of largest half widths `radius` (shape as `medial`),
    /// between the edges of `contrast`. `smoothing` is in half widths.
    ///
    /// # Errors
    /// [`Rejection::NotLong`] for a blob, [`Rejection::NoEdges`] when too little of it has two edges.
    pub fn follow(
        contrast: &Contrast,
        medial: Vec<Px>,
        radius: &[f64],
        smoothing: f64,
    ) -> Result<Self, Rejection> {
        let lengths = arc_lengths(&medial);
        let total = lengths.last().copied().unwrap_or(0.0);
        let typical = median(&mut radius.to_vec(), f64::total_cmp).unwrap_or(0.0);
        if medial.len() < 2 {
            return Err(Rejection::NotLong { length_px: total, half_width_px: typical });
        }
        let at = |s: f64| radius[lengths.partition_point(|&l| l < s).min(radius.len() - 1)];
        let from = bent_part(typical, total, at);
        let to = total - bent_part(typical, total, |s| at(total - s));
        if to - from < 2.0 * typical {
            return Err(Rejection::NotLong { length_px: total, half_width_px: typical });
        }
        let scale = (smoothing * typical).max(1.0);
        let mut points = evenly(&medial, from, to);
        let expected: Vec<f64> = (0..points.len())
            .map(|i| from + (to - from) * i as f64 / (points.len() - 1) as f64)
            .map(at)
            .collect();
        points = smoothed(&points, &vec![1.0; points.len()], scale);
        let mut between = Between::default();
        for _ in 0..MIDPOINT_ROUNDS {
            between = Between::edges(contrast, &points, &stretched(&expected, 0, points.len(), 0));
            let seen = between.weights.iter().filter(|&&w| w > 0.0).count();
            if (seen as f64) < LEAST_SEEN * points.len() as f64 {
                return Err(Rejection::NoEdges { share: seen as f64 / points.len() as f64 });
            }
            let line = smoothed(&between.middles, &between.weights, scale);
            points = evenly(&line, 0.0, arc_lengths(&line)[line.len() - 1]);
        }
        let scatter_px = between.scatter(scale);
        let lead = |i: usize| (expected[i].round() as usize).clamp(2, points.len() - 1);
        let n = points.len();
        let (first, last) = (expected[0], expected[expected.len() - 1]);
        let back = unit(points[lead(0)], points[0]);
        let forth = unit(points[n - 1 - lead(expected.len() - 1)], points[n - 1]);
        let mut line = led_on(contrast, points[0], back, first);
        let before = line.len();
        line.reverse();
        line.extend(&points);
        line.extend(led_on(contrast, points[n - 1], forth, last));
        let after = line.len() - before - n;
        // The core is smooth already; the ends are single midpoints, all but the very last ones.
        let mut weights = vec![1.0; line.len()];
        weights[before..before + n].fill(CORE_WEIGHT);
        let ends = [line[0], line[line.len() - 1]];
        let mut line = smoothed(&line, &weights, scale.min(END_SMOOTHING));
        let n = line.len();
        [line[0], line[n - 1]] = ends;
        let length_px = arc_lengths(&line)[n - 1];
        let points = evenly(&line, 0.0, length_px);
        let expected = stretched(&expected, before, points.len(), after);
        let half_width = Between::edges(contrast, &points, &expected).half_widths();
        Ok(Self { points, half_width, length_px, scatter_px, medial })
    }

    /// Mean half width \[px\].
    pub fn mean_half_width(&self) -> f64 {
        self.half_width.iter().sum::<f64>() / self.half_width.len() as f64
    }

    /// The same line without its first and last `inset` mean half widths.
    pub fn inset(mut self, inset: f64) -> Self {
        let cut = (inset * self.mean_half_width()).min(self.length_px / 4.0);
        if cut > 0.0 {
            let first = self.points.len() as f64 * cut / self.length_px;
            let keep = first.round() as usize..self.points.len() - first.round() as usize;
            self.points = evenly(&self.points, cut, self.length_px - cut);
            self.half_width = self.half_width[keep].to_vec();
            self.half_width.resize(self.points.len(), self.half_width[self.half_width.len() - 1]);
            self.length_px -= 2.0 * cut;
        }
        self
    }

    /// The same line from tip to base.
    pub fn reversed(mut self) -> Self {
        self.points.reverse();
        self.half_width.reverse();
        self.medial.reverse();
        self
    }

    /// The silhouette that line and widths describe, in the rectangle of `like`.
    pub fn drawn(&self, like: &Mask) -> Mask {
        let mut mask = Mask::empty(like.left, like.top, like.width, like.height);
        let lengths = arc_lengths(&self.points);
        for ((point, half), s) in self.points.iter().zip(&self.half_width).zip(&lengths) {
            // A disc must not reach past the ends it stands near.
            let to_end = s.min(self.length_px - s);
            mask.draw_disc(*point, half.min(to_end + 0.5));
        }
        mask
    }
}

/// How much of a thinned path's end runs into a corner of the silhouette's end, and a margin: there its
/// distance from the edge (`radius` by arc length from the end) grows nearly as fast as it goes on. Paths that
/// end in a round or pointed end are hardly cut.
fn bent_part(typical: f64, total: f64, radius: impl Fn(f64) -> f64) -> f64 {
    /// Growth per pixel: 0.7 on the way out of a right angle; 0.1 along a sharply pointed arm.
    const STEEP_GROWTH: f64 = 0.35;
    /// Cut beyond that, in half widths: the path is still turning.
    const CUT_HALF_WIDTHS: f64 = 0.4;
    let window = (0.4 * typical).max(2.0);
    let mut s = 0.0;
    while s < total / 4.0 && radius(s + window) - radius(s) > STEEP_GROWTH * window {
        s += 0.5;
    }
    s + CUT_HALF_WIDTHS * radius(s)
}

/// Both edges beside each point of a line.
#[derive(Default)]
struct Between {
    middles: Vec<Px>,
    half: Vec<Option<f64>>,
    weights: Vec<f64>,
}

impl Between {
    /// Looks for them where half widths of about `expected` (shape as `points`) are.
    fn edges(contrast: &Contrast, points: &[Px], expected: &[f64]) -> Self {
        let mut out = Self::default();
        for ((point, [tx, ty]), expected) in points.iter().zip(tangents(points)).zip(expected) {
            let normal = [-ty, tx];
            let sides =
                both_edges(contrast, *point, normal, expected / 2.0, REACH_HALF_WIDTHS * expected + REACH_PX)
                    .filter(|[left, right]| (left + right) / 2.0 <= WIDEST_RATIO * expected + WIDEST_PX);
            // Where an edge is missing the line bridges.
            let shift = sides.map_or(0.0, |[left, right]| (left - right) / 2.0);
            out.middles.push(moved(*point, normal, shift));
            out.half.push(sides.map(|[left, right]| (left + right) / 2.0));
            out.weights.push(f64::from(sides.is_some()));
        }
        out
    }

    /// Half width at each point, carried over from the nearest point before (or after) where it is missing.
    fn half_widths(&self) -> Vec<f64> {
        let mut last = self.half.iter().flatten().next().copied().unwrap_or(0.0);
        let carry = |half: &Option<f64>| {
            last = half.unwrap_or(last);
            last
        };
        self.half.iter().map(carry).collect()
    }

    /// Robust sigma of the middles about their smoothed line \[px\].
    fn scatter(&self, scale: f64) -> f64 {
        let line = smoothed(&self.middles, &self.weights, scale);
        let mut off: Vec<f64> = self.middles.iter().zip(&line).map(|(a, b)| distance(*a, *b)).collect();
        MEDIAN_TO_SIGMA * median(&mut off, f64::total_cmp).unwrap_or(0.0)
    }
}

/// Distances from `point` to the edges along `normal` and against it \[px\]; `likely` and `reach` as for [`edge`].
fn both_edges(contrast: &Contrast, point: Px, normal: Px, likely: f64, reach: f64) -> Option<[f64; 2]> {
    let one = edge(contrast, point, normal, likely, reach)?;
    let other = edge(contrast, point, [-normal[0], -normal[1]], likely, reach)?;
    Some([one, other])
}

/// Distance from `point` outward along `direction` to the edge \[px\]: where half of the contrast just inside
/// it is left, so that a side in the light and one in the shade are found alike. Up to `likely` [px] the silhouette
/// is not expected to end, beyond `reach` nothing is looked for.
fn edge(contrast: &Contrast, point: Px, direction: Px, likely: f64, reach: f64) -> Option<f64> {
    /// What is left of the contrast outside, as a share; noise permitting.
    const OUTSIDE_CONTRAST_SHARE: f64 = 0.15;
    /// The contrast inside is looked for this far behind the edge's foot [px]: more than any lens blurs.
    const INSIDE_PX: f64 = 2.5;
    /// As long as this share of the contrast is reached from pixel to pixel, no edge is near.
    const WELL_INSIDE: f32 = 0.6;
    const INSIDE_STEPS: usize = (INSIDE_PX / STEP_PX) as usize;
    const STEPS_PER_PX: usize = (1.0 / STEP_PX) as usize;
    let low = (OUTSIDE_CONTRAST_SHARE * f64::from(contrast.level)).max(3.0 * f64::from(contrast.noise));
    let steps = (reach / STEP_PX) as usize;
    let at = |i: usize| contrast.at(moved(point, direction, i as f64 * STEP_PX));
    let well_inside = WELL_INSIDE * contrast.level;
    let pixel = |k: usize| contrast.nearest(moved(point, direction, k as f64)) < well_inside;
    let skipped = if pixel(likely as usize) { 0 } else { likely as usize };
    let near = (skipped..=steps / STEPS_PER_PX).find(|&k| pixel(k)).map_or(steps, |k| k * STEPS_PER_PX);
    let start = near.saturating_sub(STEPS_PER_PX + INSIDE_STEPS);
    let mut values = Vec::with_capacity(2 * (STEPS_PER_PX + INSIDE_STEPS));
    for i in start..=steps {
        let value = at(i);
        values.push(value);
        if value < low {
            break;
        }
    }
    // Beside something else the contrast never falls so low: its lowest place is the foot.
    let foot = (0..values.len()).rev().min_by(|&a, &b| values[a].total_cmp(&values[b]))?;
    let behind = foot.saturating_sub(INSIDE_STEPS);
    let half = values[behind..=foot].iter().copied().fold(0.0, f64::max) / 2.0;
    let last_inside = (0..foot).rev().find(|&i| values[i] > half)?;
    let (inside, outside) = (values[last_inside], values[last_inside + 1]);
    (half >= low / 2.0 && outside <= half)
        .then(|| STEP_PX * ((start + last_inside) as f64 + (inside - half) / (inside - outside)))
}

/// Goes on from `start` along `direction`, in the middle between the edges, until the silhouette ends: the
/// points passed, the end last.
fn led_on(contrast: &Contrast, start: Px, direction: Px, half_width: f64) -> Vec<Px> {
    /// Farther than this many half widths is not the end of the same thing.
    const FARTHEST_HALF_WIDTHS: f64 = 6.0;
    /// Share of the last step's direction in the next one's: the end of a bent tail bends on.
    const KEPT_TURN_SHARE: f64 = 0.3;
    /// Largest move sideways per pixel forward.
    const MOST_SIDEWAYS_SHARE: f64 = 0.5;
    let mut level = contrast.at(start);
    let mut points = Vec::new();
    let (mut at, mut along, mut half_width) = (start, direction, half_width);
    while (points.len() as f64) < FARTHEST_HALF_WIDTHS * half_width.max(2.0) {
        let half = level.max(f64::from(contrast.level) / 2.0) / 2.0;
        let (here, ahead) = (contrast.at(at), contrast.at(moved(at, along, 1.0)));
        if here <= half {
            break;
        }
        if ahead <= half {
            points.push(moved(at, along, (here - half) / (here - ahead)));
            break;
        }
        let mut next = moved(at, along, 1.0);
        let normal = [-along[1], along[0]];
        if let Some([left, right]) = both_edges(contrast, next, normal, 0.0, 1.5 * half_width + 1.0) {
            let shift = ((left - right) / 2.0).clamp(-MOST_SIDEWAYS_SHARE, MOST_SIDEWAYS_SHARE);
            next = moved(next, normal, shift);
            half_width = half_width.min((left + right) / 2.0).max(1.0);
        }
        let step = unit(at, next);
        along = unit(
            [0.0, 0.0],
            [
                along[0] + KEPT_TURN_SHARE * (step[0] - along[0]),
                along[1] + KEPT_TURN_SHARE * (step[1] - along[1]),
            ],
        );
        level = 0.7 * level + 0.3 * contrast.at(next);
        at = next;
        points.push(at);
    }
    points
}

/// `values` along a line in `count` even steps, of which it covers all but the first `before` and last `after`;
/// there its own first and last hold.
fn stretched(values: &[f64], before: usize, count: usize, after: usize) -> Vec<f64> {
    let covered = count.saturating_sub(before + after).max(2);
    let place = |i: usize| i.saturating_sub(before).min(covered - 1) * (values.len() - 1) / (covered - 1);
    (0..count).map(|i| values[place(i)]).collect()
}

/// Points about a pixel apart from arc length `from` to `to`.
fn evenly(points: &[Px], from: f64, to: f64) -> Vec<Px> {
    resampled(points, from, to, (to - from).round().max(2.0) as usize + 1)
}
