//! First poses, at low resolution: what differs from the sample's middle picture, then what has the mechanism's colours.

use rand::{RngExt as _, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use rayon::prelude::*;

use camera::calibration::Px;

use super::mechanism::Mechanism;
use super::place::{across, lerp, minus, plus, scaled, unit};
use super::shared::Shared;
use super::tank::{Light, PLANES, Reduced, SAME_LIGHT, median, painted};
use super::view::Camera;

/// A pose found, and how well it is supported; the best possible is about 1.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Candidate {
    pub(super) pose: Vec<f64>,
    pub(super) score: f64,
}

/// What speaks for the mechanism at each pixel of a reduced picture, from -2 (the tank) to 2.
#[derive(Debug, Clone)]
pub(super) struct Evidence {
    width: usize,
    height: usize,
    /// Pixels of the picture for each of these.
    by: usize,
    values: Vec<f32>,
}

/// Half a pixel's shift of means of `by` pixels against the picture's.
fn reduced_at(px: f64, by: usize) -> f64 {
    (px - (by as f64 - 1.0) / 2.0) / by as f64
}

impl Evidence {
    /// At the picture's pixel `px`.
    fn at(&self, px: Px) -> f64 {
        let clip =
            |px: f64, count: usize| reduced_at(px, self.by).round().clamp(0.0, (count - 1) as f64) as usize;
        f64::from(self.values[clip(px[1], self.height) * self.width + clip(px[0], self.width)])
    }
}

/// Scores of links are bounded by station, so that none can pay for another.
const MOST_FOR: f64 = 2.0;
const MOST_AGAINST: f64 = -1.0;
/// How far beside the outline the tank is looked for, in reduced pixels.
const BESIDE: f64 = 1.6;
/// Stations along a link of a chain and of an arm, chosen.
const CHAIN_STATIONS: usize = 7;
const ARM_STATIONS: usize = 4;
/// Directions of a chain's first link, and angles of the others, that are tried \[rad\]; how many half-built chains are kept.
const FIRST_STEP: f64 = 0.15;
const NEXT_STEP: f64 = 0.2;
const MOST_NEXT: f64 = 2.0;
const BEAM: usize = 240;
/// Poses that are followed further, and how much they must differ \[rad\].
const KEPT: usize = 6;
const APART: f64 = 0.25;
/// Random steps down, 1 sigma \[rad\], and how many are tried at each.
const STEPS_DOWN: [f64; 4] = [0.12, 0.06, 0.03, 0.015];
const TRIED: usize = 60;
/// What speaks for the mechanism beyond the tip counts so much against a pose.
const BEYOND_TIP: f64 = 0.06;

/// Searches poses of a mechanism in evidence.
#[derive(Debug, Clone, Copy)]
pub(super) struct Search<'a> {
    pub(super) mechanism: &'a Mechanism,
    pub(super) camera: &'a Camera,
    pub(super) shared: &'a Shared,
}

impl Search<'_> {
    /// What speaks for link `link` between the pixels `from` and `to`; a link is short enough for one scale.
    fn link(&self, evidence: &Evidence, link: usize, from: Px, to: Px) -> f64 {
        let stations = if self.mechanism.is_soft() { ARM_STATIONS } else { CHAIN_STATIONS };
        let side = across(unit(minus(to, from)));
        let beside = BESIDE * evidence.by as f64;
        let ends = [0.0, 1.0]
            .map(|share| self.mechanism.half_width_at(link, share, self.shared.width) / self.camera.scale_m);
        let mut sum = 0.0;
        for i in 0..stations {
            let share = (i as f64 + 0.5) / stations as f64;
            let middle = lerp(from, to, share);
            let half = ends[0] + (ends[1] - ends[0]) * share;
            let at = |off: f64| evidence.at(plus(middle, scaled(side, off)));
            let within = (at(0.0) + at(half / 2.0) + at(-half / 2.0)) / 3.0;
            for off in [half + beside, -half - beside] {
                sum += (within - at(off)).clamp(MOST_AGAINST, MOST_FOR);
            }
            sum += within.clamp(-MOST_FOR, MOST_FOR);
        }
        // at best 5 a station
        sum / (5.0 * stations as f64)
    }

    /// Where the pivots and the tip of `pose` are seen.
    fn pivots_px(&self, pose: &[f64]) -> Vec<Px> {
        let (pivots, _) = self.mechanism.pivots(pose, self.shared.base);
        pivots.into_iter().map(|pivot| self.camera.plane.pixel(pivot)).collect()
    }

    fn score(&self, evidence: &Evidence, pose: &[f64]) -> f64 {
        let pivots = self.pivots_px(pose);
        let links: f64 = pivots
            .windows(2)
            .enumerate()
            .map(|(link, ends)| self.link(evidence, link, ends[0], ends[1]))
            .sum();
        let [.., before, tip] = pivots.as_slice() else { return links };
        let beyond = BESIDE * evidence.by as f64;
        let past = evidence.at(plus(*tip, scaled(unit(minus(*tip, *before)), beyond)));
        links / pose.len() as f64 - BEYOND_TIP * past.clamp(0.0, MOST_FOR)
    }

    /// Poses of an arm: a direction, a bend and how it changes along the arm.
    fn arms(&self, evidence: &Evidence) -> Vec<Candidate> {
        let n = self.mechanism.links();
        let steps = |most: f64, count: usize| {
            (0..count).map(move |i| most * (2.0 * i as f64 / (count - 1) as f64 - 1.0))
        };
        let mut all = Vec::new();
        for direction in steps(1.2, 17) {
            for bend in steps(2.1 / (n - 1) as f64, 11) {
                for change in steps(1.7 / (n - 1) as f64, 5) {
                    let joint = |i: usize| bend + change * (2.0 * i as f64 / n as f64 - 1.0);
                    let pose: Vec<f64> = std::iter::once(direction).chain((1..n).map(joint)).collect();
                    all.push(Candidate { score: self.score(evidence, &pose), pose });
                }
            }
        }
        all
    }

    /// Poses of a chain, built link by link.
    fn chains(&self, evidence: &Evidence) -> Vec<Candidate> {
        let n = self.mechanism.links();
        let steps = |most: f64, step: f64| {
            let count = (most / step).floor() as i64;
            (-count..=count).map(move |i| i as f64 * step)
        };
        let mut built = vec![Candidate { pose: Vec::new(), score: 0.0 }];
        for link in 0..n {
            let angles: Vec<f64> = match link {
                0 => steps(std::f64::consts::PI, FIRST_STEP).collect(),
                _ => steps(MOST_NEXT, NEXT_STEP).collect(),
            };
            let mut longer = Vec::with_capacity(built.len() * angles.len());
            for candidate in &built {
                for &angle in &angles {
                    let mut pose = candidate.pose.clone();
                    pose.push(angle);
                    let pivots = self.pivots_px(&pose);
                    let score = candidate.score + self.link(evidence, link, pivots[link], pivots[link + 1]);
                    longer.push(Candidate { pose, score });
                }
            }
            longer.sort_by(|a, b| b.score.total_cmp(&a.score));
            longer.truncate(BEAM);
            built = longer;
        }
        for candidate in &mut built {
            candidate.score = self.score(evidence, &candidate.pose);
        }
        built
    }

    /// The best poses that differ, the best first.
    pub(super) fn best(&self, evidence: &Evidence, seed: u64) -> Vec<Candidate> {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut all = if self.mechanism.is_soft() { self.arms(evidence) } else { self.chains(evidence) };
        all.sort_by(|a, b| b.score.total_cmp(&a.score));
        let mut kept: Vec<Candidate> = Vec::new();
        for candidate in all {
            let differs = |other: &Candidate| {
                let (mut turn, mut most) = (0.0_f64, 0.0_f64);
                for (a, b) in candidate.pose.iter().zip(&other.pose) {
                    turn += a - b;
                    most = most.max(turn.abs());
                }
                most > APART
            };
            if kept.iter().all(differs) {
                kept.push(candidate);
            }
            if kept.len() == KEPT {
                break;
            }
        }
        for candidate in &mut kept {
            for std in STEPS_DOWN {
                for _ in 0..2 {
                    let from = candidate.pose.clone();
                    for _ in 0..TRIED {
                        let step = |(i, angle): (usize, &f64)| {
                            let noise: f64 = random.sample(StandardNormal);
                            let share = if self.mechanism.is_soft() && i > 0 { 0.5 } else { 1.0 };
                            angle + share * std * noise
                        };
                        let pose: Vec<f64> = from.iter().enumerate().map(step).collect();
                        let score = self.score(evidence, &pose);
                        if score > candidate.score {
                            *candidate = Candidate { pose, score };
                        }
                    }
                }
            }
        }
        kept.sort_by(|a, b| b.score.total_cmp(&a.score));
        kept
    }
}

/// What colours are the mechanism's and what the empty tank looks like, at low resolution.
#[derive(Debug, Clone)]
pub(super) struct Looks {
    by: usize,
    /// The tank; none where the mechanism never leaves.
    tank: Vec<Option<[f32; PLANES]>>,
    /// Whether that is a picture's of the tank without the mechanism.
    is_given: bool,
    width: usize,
    height: usize,
    /// Share of the mechanism's pixels by colour, shape (BINS, BINS, BINS); empty before any are known.
    colours: Vec<f32>,
    planes: usize,
}

/// Bins of each plane.
const BINS: usize = 32;
/// How far pixels depart from the tank's middle picture, 1 sigma by plane; chosen.
const TANK_STD: [f32; PLANES] = [4.0, 2.5, 2.5];

impl Looks {
    /// With the tank as `empty` shows it.
    pub(super) fn of_empty(empty: &Reduced, by: usize) -> Self {
        let all = vec![false; empty.width * empty.height];
        Self { is_given: true, ..Self::clear(std::slice::from_ref(empty), &[SAME_LIGHT], &[all], by) }
    }

    /// From the middle of `pictures`.
    pub(super) fn middle(pictures: &[Reduced], by: usize) -> Option<Self> {
        let first = pictures.first()?;
        let free = vec![vec![false; first.width * first.height]; pictures.len()];
        let lights = vec![SAME_LIGHT; pictures.len()];
        Some(Self::clear(pictures, &lights, &free, by))
    }

    /// From what is clear in each of `pictures`.
    fn clear(pictures: &[Reduced], lights: &[Light], masks: &[Vec<bool>], by: usize) -> Self {
        let (width, height, planes) = (pictures[0].width, pictures[0].height, pictures[0].planes.len());
        let tank = (0..width * height)
            .into_par_iter()
            .map(|at| {
                let clear = (0..pictures.len()).filter(|&k| !masks[k][at]);
                let values: Vec<[f32; PLANES]> = clear.map(|k| normal(&pictures[k], at, lights[k])).collect();
                super::colours::medians(values.into_iter())
            })
            .collect();
        Self { by, tank, is_given: false, width, height, colours: Vec::new(), planes }
    }

    /// The light of `picture` against the tank's.
    pub(super) fn light(&self, picture: &Reduced) -> Light {
        let mut shifts: [Vec<f32>; PLANES] = Default::default();
        for (at, tank) in self.tank.iter().enumerate() {
            let Some(tank) = tank.filter(|tank| tank[0] > 20.0) else { continue };
            shifts[0].push(picture.planes[0][at] / tank[0]);
            for plane in 1..self.planes {
                shifts[plane].push(picture.planes[plane][at] - tank[plane]);
            }
        }
        let [grey, cb, cr] = shifts.map(|mut values| median(&mut values));
        [grey.unwrap_or(1.0), cb.unwrap_or(0.0), cr.unwrap_or(0.0)]
    }

    /// What in `picture` speaks for the mechanism.
    pub(super) fn evidence(&self, picture: &Reduced) -> Evidence {
        /// A colour that the mechanism never showed, and one that the tank never showed.
        const UNSEEN: f32 = 2e-6;
        const FOREIGN: f32 = 1e-3;
        let light = self.light(picture);
        let value = |at: usize| {
            let Some(tank) = self.tank[at] else { return 0.0 };
            let seen = normal(picture, at, light);
            let off: f32 =
                (0..self.planes).map(|plane| ((seen[plane] - tank[plane]) / TANK_STD[plane]).powi(2)).sum();
            let misfit = off / 2.0;
            if self.colours.is_empty() {
                return (misfit / 6.0 - 1.0).clamp(-1.0, 2.0);
            }
            let of_tank = FOREIGN.ln() - (misfit / 4.0).min(8.0);
            (((self.colours[bin(seen)] + UNSEEN).ln() - of_tank) / 4.0).clamp(-2.0, 2.0)
        };
        let values = (0..self.width * self.height).map(value).collect();
        Evidence { width: self.width, height: self.height, by: self.by, values }
    }

    /// Learned anew from poses that were found in `pictures`: colours from those of `trusted`, the tank where all leave it clear, unless it is
    /// given.
    pub(super) fn learned(
        &self,
        pictures: &[Reduced],
        search: &Search<'_>,
        poses: &[Candidate],
        trusted: &[usize],
    ) -> Self {
        let lights: Vec<Light> = pictures.iter().map(|picture| self.light(picture)).collect();
        let painted = |pose: &[f64], grown_px: f64| {
            let strips = search.mechanism.strips(pose, search.shared);
            painted(search.camera, &strips, grown_px)
        };
        let by = self.by;
        let [full_width, _] = search.camera.size;
        let any = |mask: &[bool], at: usize, all: bool| {
            let (row, column) = (at / self.width * by, at % self.width * by);
            let mut pixels =
                (row..row + by).flat_map(|y| (column..column + by).map(move |x| y * full_width + x));
            if all { pixels.all(|at| mask[at]) } else { pixels.any(|at| mask[at]) }
        };
        let masks: Vec<Vec<bool>> = poses
            .par_iter()
            .map(|found| {
                let mask = painted(&found.pose, 3.0 * by as f64);
                (0..self.width * self.height).map(|at| any(&mask, at, false)).collect()
            })
            .collect();
        let mut looks = match self.is_given {
            true => self.clone(),
            false => Self::clear(pictures, &lights, &masks, by),
        };
        let mut counts = vec![0.0f32; BINS * BINS * BINS];
        for &k in trusted {
            let mask = painted(&poses[k].pose, -0.15 * by as f64);
            let evidence = self.evidence(&pictures[k]);
            for at in (0..self.width * self.height).filter(|&at| any(&mask, at, true)) {
                // the middle picture's ghost is no mechanism
                if !self.colours.is_empty() || evidence.values[at] > 0.0 {
                    counts[bin(normal(&pictures[k], at, lights[k]))] += 1.0;
                }
            }
        }
        let counts = blurred(counts);
        let total: f32 = counts.iter().sum();
        looks.colours = counts.into_iter().map(|count| count / total.max(f32::MIN_POSITIVE)).collect();
        looks
    }
}

/// The colour of pixel `at` in the tank's own light.
fn normal(picture: &Reduced, at: usize, light: Light) -> [f32; PLANES] {
    let mut colour = [0.0, 128.0, 128.0];
    colour[0] = picture.planes[0][at] / light[0].max(f32::MIN_POSITIVE);
    for plane in 1..picture.planes.len() {
        colour[plane] = picture.planes[plane][at] - light[plane];
    }
    colour
}

fn bin(colour: [f32; PLANES]) -> usize {
    let [a, b, c] =
        colour.map(|value| (value * (BINS as f32 / 256.0)).clamp(0.0, (BINS - 1) as f32) as usize);
    (a * BINS + b) * BINS + c
}

/// Counts smoothed along each axis by a normal distribution of one bin.
fn blurred(mut counts: Vec<f32>) -> Vec<f32> {
    const KERNEL: [f32; 5] = [0.0545, 0.2442, 0.4026, 0.2442, 0.0545];
    for stride in [BINS * BINS, BINS, 1] {
        let before = counts.clone();
        for (at, count) in counts.iter_mut().enumerate() {
            let own = at / stride % BINS;
            *count = KERNEL
                .iter()
                .enumerate()
                .filter_map(|(k, weight)| {
                    let other = (own + k).checked_sub(2).filter(|&other| other < BINS)?;
                    Some(weight * before[at + other * stride - own * stride])
                })
                .sum();
        }
    }
    counts
}
