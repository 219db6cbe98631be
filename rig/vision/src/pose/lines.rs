//! Lines across the outline: what the picture and the tank show along each, and what each place of the edge would cost there.

use std::sync::LazyLock;

use super::rims::{DIRECTIONS, NO_RIM, Rim, direction};
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
    /// What is known of the tank; none outside the picture.
    pub(super) state: Vec<Option<State>>,
    /// Where the outline faces, by line.
    pub(super) direction: Vec<usize>,
}

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

/// Blur of edges in brightness and colour, 1 sigma \[px\]: a sharp lens, and colour at half the resolution. Chosen.
pub(super) const BLUR_PX: f64 = 0.9;
const COLOUR_BLUR_PX: f64 = 1.6;
/// Neighbouring samples are not independent of each other: so many count as one. Chosen for demosaicing and compression.
const SAMPLES_IN_ONE: f32 = 3.0;
/// No sample costs more, in half squared sigmas; chosen.
const MOST_OF_A_SAMPLE: f32 = 6.0;
/// The exponent from grey levels to light, that of sRGB about (IEC 61966-2-1), and entries of its table.
const CAMERA_GAMMA: f32 = 2.2;
const TABLE: usize = 4096;

static LIGHT_OF_GREY: LazyLock<Vec<f32>> =
    LazyLock::new(|| (0..TABLE).map(|i| (i as f32 / (TABLE - 1) as f32).powf(CAMERA_GAMMA)).collect());
static GREY_OF_LIGHT: LazyLock<Vec<f32>> = LazyLock::new(|| {
    (0..=TABLE).map(|i| 255.0 * (i as f32 / TABLE as f32).powf(1.0 / CAMERA_GAMMA)).collect()
});

pub(super) fn light_of(grey: f32) -> f32 {
    LIGHT_OF_GREY[(grey.clamp(0.0, 255.0) * ((TABLE - 1) as f32 / 255.0)) as usize]
}

/// The share of the normal distribution below `x`.
pub(super) fn normal_share(x: f64) -> f64 {
    0.5 * (1.0 + libm::erf(x / std::f64::consts::SQRT_2))
}

/// The tank's share at each sample for each place of the edge; shape (SAMPLES_PER_LINE, PLACES_PER_LINE).
fn mixing(step_px: f64, rim: &Rim, blur_px: f64) -> Vec<f32> {
    let mut shares = Vec::with_capacity(SAMPLES_PER_LINE * PLACES_PER_LINE);
    for k in 0..SAMPLES_PER_LINE {
        for j in 0..PLACES_PER_LINE {
            let outside = outward(k) * step_px - place_px(j, step_px / 2.0);
            shares.push(rim.tank_share(outside, blur_px) as f32);
        }
    }
    shares
}

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
        rims: &[Rim; DIRECTIONS],
    ) -> Self {
        let bright = rims.map(|rim| mixing(reading.step_px, &rim, BLUR_PX));
        let coloured = mixing(reading.step_px, &NO_RIM, COLOUR_BLUR_PX);
        let lines = reading.lines();
        let weight = reading.step_px as f32 / SAMPLES_IN_ONE;
        let mut cost = vec![0.0f32; lines * PLACES_PER_LINE];
        let mut open = Vec::with_capacity(lines);
        for (line, cost) in cost.chunks_exact_mut(PLACES_PER_LINE).enumerate() {
            let (inside, precision) = (colour[line], precision[line]);
            let bright = &bright[reading.direction[line]];
            let light_inside = light_of(inside[0]);
            let mut count = 0;
            for (k, at) in reading.samples(line).enumerate() {
                if !reading.is_open(at) {
                    continue;
                }
                count += 1;
                let (seen, behind) = (reading.picture[at], reading.tank[at]);
                let way = light_of(behind[0]) - light_inside;
                let shares = &bright[k * PLACES_PER_LINE..(k + 1) * PLACES_PER_LINE];
                let mut misfit = [0.0f32; PLACES_PER_LINE];
                for (misfit, share) in misfit.iter_mut().zip(shares) {
                    let light = (light_inside + way * share).clamp(0.0, 1.0);
                    let grey = GREY_OF_LIGHT[(light * TABLE as f32) as usize];
                    let off = (seen[0] - grey) * precision[0];
                    *misfit = off * off;
                }
                if reading.planes == PLANES {
                    let shares = &coloured[k * PLACES_PER_LINE..(k + 1) * PLACES_PER_LINE];
                    for (misfit, share) in misfit.iter_mut().zip(shares) {
                        for plane in 1..PLANES {
                            let mixed = inside[plane] + (behind[plane] - inside[plane]) * share;
                            let off = (seen[plane] - mixed) * precision[plane];
                            *misfit += off * off;
                        }
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
