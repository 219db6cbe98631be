//! Lines across the outline: what the picture and the tank show along each, and what each place of the edge would cost there.

use super::edge::{Edges, grey_of, light_of};
use super::mechanism::Strips;
use super::place::{plus, scaled};
use super::rims::direction;
use super::tank::{Light, PLANES, Planes, State, Tank, lit};
use super::view::Seen;

/// Samples on a line, the outline in the middle.
pub(super) const SAMPLES_PER_LINE: usize = 25;
/// Places of the edge on a line, half a sample apart, the outline in the middle.
pub(super) const PLACES_PER_LINE: usize = 41;

/// What lines show; each sample of each line.
#[derive(Debug, Clone)]
pub(super) struct Reading {
    /// Way from sample to sample \[px\].
    pub(super) step_px: f64,
    /// Number of planes.
    pub(super) planes: usize,
    /// The picture, shape (lines, SAMPLES_PER_LINE), by plane.
    pub(super) picture: Vec<[f32; PLANES]>,
    /// The tank in this image's light, likewise.
    pub(super) tank: Vec<[f32; PLANES]>,
    /// What is known of the tank; none outside the picture, and where the mechanism's other side or another part of it is.
    pub(super) state: Vec<Option<State>>,
    /// Where the outline faces, by line.
    pub(super) direction: Vec<usize>,
}

/// A sample belongs to its line's edge where any other edge is farther than this share of its own way to it, and than so much at most, beyond the
/// blur \[px\]; chosen.
const CLEAR_SHARE: f64 = 0.5;
const MOST_CLEAR_PX: f64 = 2.0;

/// How far sample `k` is outside the outline, in steps.
pub(super) fn outward(k: usize) -> f64 {
    k as f64 - (SAMPLES_PER_LINE / 2) as f64
}

impl Reading {
    /// Reads `picture` and the tank across the outline as `seen`, samples `step_px` apart.
    pub(super) fn of(picture: &Planes, tank: &Tank, light: Light, seen: &[Seen], step_px: f64) -> Self {
        let count = seen.len() * SAMPLES_PER_LINE;
        let planes = picture.planes.len().min(tank.planes.planes.len());
        let mut reading = Self {
            step_px,
            planes,
            picture: Vec::with_capacity(count),
            tank: Vec::with_capacity(count),
            state: Vec::with_capacity(count),
            direction: seen.iter().map(|line| direction(line.normal)).collect(),
        };
        let (width, height) = (picture.width, picture.height);
        for line in seen {
            for k in 0..SAMPLES_PER_LINE {
                let d = outward(k) * step_px;
                let (x, y) = (line.px[0] + line.normal[0] * d, line.px[1] + line.normal[1] * d);
                if !(x >= 0.0 && y >= 0.0 && x < (width - 1) as f64 && y < (height - 1) as f64) {
                    reading.picture.push([0.0; PLANES]);
                    reading.tank.push([0.0; PLANES]);
                    reading.state.push(None);
                    continue;
                }
                let (column, row) = (x as usize, y as usize);
                let (a, b) = ((x - column as f64) as f32, (y - row as f64) as f32);
                let at = row * width + column;
                let corners = [at, at + 1, at + width, at + width + 1];
                let weights = [(1.0 - a) * (1.0 - b), a * (1.0 - b), (1.0 - a) * b, a * b];
                let (mut shown, mut behind) = ([0.0; PLANES], [0.0; PLANES]);
                for plane in 0..planes {
                    let (of, tank) = (&picture.planes[plane], &tank.planes.planes[plane]);
                    for (corner, weight) in corners.iter().zip(weights) {
                        shown[plane] += weight * f32::from(of[*corner]);
                        behind[plane] += weight * lit(tank[*corner], plane, light);
                    }
                }
                let states = corners.map(|corner| tank.state[corner]);
                let state = if states.contains(&State::Before) {
                    State::Before
                } else if states.contains(&State::Unknown) {
                    State::Unknown
                } else {
                    State::Known
                };
                reading.picture.push(shown);
                reading.tank.push(behind);
                reading.state.push(Some(state));
            }
        }
        reading
    }

    /// Leaves out what `solids`, as the camera shows them, say of a line but its own edge: the mechanism's other side, another part of it.
    pub(super) fn leave_out(&mut self, solids: &[Strips], seen: &[Seen]) {
        let reach = outward(SAMPLES_PER_LINE - 1) * self.step_px + MOST_CLEAR_PX;
        let mut near: Vec<&Strips> = Vec::with_capacity(solids.len());
        for (line, seen) in seen.iter().enumerate() {
            near.clear();
            near.extend(solids.iter().filter(|solid| solid.distance(seen.px) < reach));
            for k in 0..SAMPLES_PER_LINE {
                let out_px = outward(k) * self.step_px;
                let at = plus(seen.px, scaled(seen.normal, out_px));
                let distance = near.iter().map(|solid| solid.distance(at)).fold(f64::INFINITY, f64::min);
                let least = (CLEAR_SHARE * out_px.abs()).min(MOST_CLEAR_PX);
                if distance * out_px.signum() < least {
                    self.state[line * SAMPLES_PER_LINE + k] = None;
                }
            }
        }
    }

    /// Number of lines.
    pub(super) fn lines(&self) -> usize {
        self.picture.len() / SAMPLES_PER_LINE
    }

    /// Samples of line `line`.
    pub(super) fn samples(&self, line: usize) -> std::ops::Range<usize> {
        line * SAMPLES_PER_LINE..(line + 1) * SAMPLES_PER_LINE
    }

    /// Whether something else than the tank or the mechanism may be seen at `sample`, or nothing.
    pub(super) fn is_open(&self, sample: usize) -> bool {
        matches!(self.state[sample], Some(State::Known | State::Unknown))
    }
}

/// What the places of the edge cost on each line.
#[derive(Debug, Clone)]
pub(super) struct Costs {
    /// Way from place to place \[px\].
    pub(super) step_px: f64,
    /// Shape (lines, PLACES_PER_LINE).
    pub(super) cost: Vec<f32>,
    /// Samples of each line that are open.
    pub(super) open: Vec<u32>,
}

/// Neighbouring samples are not independent of each other: so many count as one. Chosen for demosaicing and compression.
const SAMPLES_IN_ONE: f32 = 3.0;
/// No sample costs more, in half squared sigmas; chosen.
const MOST_OF_A_SAMPLE: f32 = 6.0;
/// How far off the edge's own shape may be, which is no blurred step to the last digit, by brightness and by colour, 1 sigma \[px\]; chosen. Where
/// mechanism and tank differ by much, this counts and not the noise.
const SHAPE_STD_PX: [f32; 2] = [0.3, 0.3];

/// How far place `j` is outside the outline \[px\], places `step_px` apart.
pub(super) fn place_px(j: usize, step_px: f64) -> f64 {
    (j as f64 - (PLACES_PER_LINE / 2) as f64) * step_px
}

impl Costs {
    /// Of an edge between the mechanism's colour, by line, and the tank; `precision`: one over sigma, by line and plane.
    pub(super) fn of(
        reading: &Reading,
        colour: &[[f32; PLANES]],
        precision: &[[f32; PLANES]],
        edges: &Edges,
    ) -> Self {
        let (bright, coloured) = edges.shares(reading.step_px);
        // from what neighbouring places differ by to what the edge's shape leaves open
        let shape = SHAPE_STD_PX.map(|std| std / reading.step_px as f32);
        let lines = reading.lines();
        let weight = reading.step_px as f32 / SAMPLES_IN_ONE;
        let mut cost = vec![0.0f32; lines * PLACES_PER_LINE];
        let mut open = Vec::with_capacity(lines);
        for (line, cost) in cost.chunks_exact_mut(PLACES_PER_LINE).enumerate() {
            let (inside, precision) = (colour[line], precision[line]);
            let bright = &bright[reading.direction[line]];
            let light_inside = light_of(inside[0]);
            let variance = precision.map(|precision| (precision * precision).recip());
            let mut count = 0;
            for (k, at) in reading.samples(line).enumerate() {
                if !reading.is_open(at) {
                    continue;
                }
                count += 1;
                let (seen, behind) = (reading.picture[at], reading.tank[at]);
                let way = light_of(behind[0]) - light_inside;
                let mut misfit = [0.0f32; PLACES_PER_LINE];
                // one place more on either side, for the slopes at the first and the last
                let mut expected = [0.0f32; PLACES_PER_LINE + 2];
                let mut add =
                    |expected: &mut [f32; PLACES_PER_LINE + 2], seen: f32, variance: f32, shape: f32| {
                        (expected[0], expected[PLACES_PER_LINE + 1]) =
                            (expected[1], expected[PLACES_PER_LINE]);
                        for (misfit, near) in misfit.iter_mut().zip(expected.windows(3)) {
                            let (open, off) = ((near[2] - near[0]) * shape, seen - near[1]);
                            *misfit += off * off / (variance + open * open);
                        }
                    };
                let shares = &bright[k * PLACES_PER_LINE..(k + 1) * PLACES_PER_LINE];
                for (expected, share) in expected[1..].iter_mut().zip(shares) {
                    *expected = grey_of(light_inside + way * share);
                }
                add(&mut expected, seen[0], variance[0], shape[0]);
                if reading.planes == PLANES {
                    let shares = &coloured[k * PLACES_PER_LINE..(k + 1) * PLACES_PER_LINE];
                    for plane in 1..PLANES {
                        for (expected, share) in expected[1..].iter_mut().zip(shares) {
                            *expected = inside[plane] + (behind[plane] - inside[plane]) * share;
                        }
                        add(&mut expected, seen[plane], variance[plane], shape[1]);
                    }
                }
                for (cost, misfit) in cost.iter_mut().zip(misfit) {
                    let half = 0.5 * misfit;
                    *cost += MOST_OF_A_SAMPLE * half / (MOST_OF_A_SAMPLE + half);
                }
            }
            cost.iter_mut().for_each(|cost| *cost *= weight);
            open.push(count);
        }
        Self { step_px: reading.step_px / 2.0, cost, open }
    }

    /// What an open sample of line `line` costs on average at the best place.
    pub(super) fn best_per_sample(&self, line: usize) -> f64 {
        let best = self.of_line(line).iter().copied().fold(f32::INFINITY, f32::min);
        let weight = (2.0 * self.step_px as f32 / SAMPLES_IN_ONE) * self.open[line] as f32;
        f64::from(best / weight.max(1.0))
    }

    /// The costs of line `line`'s places.
    pub(super) fn of_line(&self, line: usize) -> &[f32] {
        &self.cost[line * PLACES_PER_LINE..(line + 1) * PLACES_PER_LINE]
    }
}
