//! The pose of least cost in one picture.

use nalgebra::{DMatrix, DVector};

use super::colours::{Colour, adapt_tank, difference, inside, medians, smoothed};
use super::edge::{Edges, grey_of, light_of, normal_share};
use super::lines::{Costs, Reading, outward};
use super::mechanism::{Mechanism, Strips};
use super::rims::{DIRECTIONS, Profile};
use super::shared::Shared;
use super::tables::{Line, Tables};
use super::tank::{Light, PLANES, Planes, Tank};
use super::view::Camera;

/// What a picture is explained with.
#[derive(Debug, Clone, Copy)]
pub(super) struct Scene<'a> {
    pub(super) mechanism: &'a Mechanism,
    pub(super) camera: &'a Camera,
    pub(super) shared: &'a Shared,
    pub(super) tank: &'a Tank,
    /// The mechanism's colour by point of the outline, in the tank's own light; empty before it is learned.
    pub(super) colours: &'a [Colour],
    /// What its edges look like.
    pub(super) edges: &'a Edges,
}

/// Where a pose is expected: its angles, and one sigma of each \[rad\].
pub(super) type Expected<'a> = (&'a [f64], f64);

/// Readings of the picture one after the other: samples so far apart \[px\], so many times.
pub(super) type Readings<'a> = &'a [(f64, usize)];

/// A pose and how it explains the picture.
#[derive(Debug, Clone)]
pub(super) struct Explained {
    pub(super) pose: Vec<f64>,
    pub(super) cost: f64,
    pub(super) lines: Vec<Line>,
    /// How each point of the outline moves along its normal \[px\] with the pose's angles and what is shared; shape (lines, numbers).
    pub(super) slopes: DMatrix<f64>,
    /// Information on the pose, its own prior included.
    pub(super) information: DMatrix<f64>,
}

/// A smooth arm's joints and the difference of neighbouring ones, 1 sigma \[rad\]; a chain's joints. Chosen.
const ARM_JOINT_STD: f64 = 0.35;
const ARM_SMOOTH_STD: f64 = 0.08;
const CHAIN_JOINT_STD: f64 = 3.0;
/// How much wider noise is taken than in the clear tank, and how much a colour varies by itself; chosen.
const NOISE_FACTOR: f32 = 1.3;
const COLOUR_SHARE: [f32; PLANES] = [0.08, 0.02, 0.02];
const LEAST_STD: [f32; PLANES] = [2.0, 1.0, 1.0];
/// Of the colour that stands for no colour.
const NEUTRAL: [f32; PLANES] = [0.0, 128.0, 128.0];
/// An image's colour departs from the film's by no more, by plane; chosen.
const MOST_CHANGE: [f32; PLANES] = [25.0, 5.0, 5.0];
const COLOUR_NEIGHBOURS: usize = 3;
/// An edge this far off belongs to something else \[px\].
pub(super) const OWN_EDGE_PX: f64 = 1.5;

/// Residual rows of what is known of a pose before it is seen: `rows * pose` should be zero.
pub(super) fn prior(mechanism: &Mechanism) -> DMatrix<f64> {
    let n = mechanism.links();
    let mut rows: Vec<DVector<f64>> = Vec::new();
    let mut row = |entries: &[(usize, f64)]| {
        let mut row = DVector::zeros(n);
        for &(i, value) in entries {
            row[i] = value;
        }
        rows.push(row);
    };
    for i in 1..n {
        let std = if mechanism.is_soft() { ARM_JOINT_STD } else { CHAIN_JOINT_STD };
        row(&[(i, 1.0 / std)]);
        if mechanism.is_soft() && i + 1 < n {
            row(&[(i, -1.0 / ARM_SMOOTH_STD), (i + 1, 1.0 / ARM_SMOOTH_STD)]);
        }
    }
    DMatrix::from_fn(rows.len(), n, |i, j| rows[i][j])
}

impl Scene<'_> {
    /// The pose that explains `picture` best near `start`.
    pub(super) fn explain(
        &self,
        picture: &Planes,
        light: Light,
        start: &[f64],
        expected: Option<Expected<'_>>,
        readings: Readings<'_>,
    ) -> Explained {
        let mut pose = start.to_vec();
        let mut last = None;
        for &(step_px, times) in readings {
            for _ in 0..times {
                let explained = self.improve(picture, light, &pose, expected, step_px);
                pose.clone_from(&explained.pose);
                last = Some(explained);
            }
        }
        last.unwrap_or_else(|| self.improve(picture, light, start, expected, 1.0))
    }

    /// What the lines across the outline of `pose` show, and the mechanism's colour on each.
    fn read(&self, picture: &Planes, light: Light, pose: &[f64], step_px: f64) -> Lines {
        let outline = self.mechanism.outline(pose, self.shared);
        let seen = self.camera.sees(&outline, self.shared);
        let mut reading = Reading::of(picture, self.tank, light, &seen, step_px);
        let shown = |solid: Strips| self.camera.shows(solid);
        let solids: Vec<Strips> = self.mechanism.strips(pose, self.shared).into_iter().map(shown).collect();
        reading.leave_out(&solids, &seen);
        adapt_tank(&mut reading, self.mechanism.runs());
        let slopes = self.camera.slopes(self.mechanism, pose, self.shared, &outline, &seen);
        let visible = outline.iter().map(|point| point.is_rim).collect();
        Lines {
            reading,
            visible,
            slopes: DMatrix::from_row_slice(outline.len(), slopes.len() / outline.len().max(1), &slopes),
        }
    }

    /// What is seen inside the outline of `pose`, in the tank's own light.
    pub(super) fn colours_inside(
        &self,
        picture: &Planes,
        light: Light,
        explained: &Explained,
    ) -> Vec<Colour> {
        let lines = self.read(picture, light, &explained.pose, 1.0);
        let counts = |i: usize| lines.visible[i] && explained.lines[i].best_px.abs() < 2.0;
        let own = |colour: [f32; PLANES]| {
            [colour[0] / light[0].max(f32::MIN_POSITIVE), colour[1] - light[1], colour[2] - light[2]]
        };
        inside(&lines.reading, counts).into_iter().map(|colour| colour.map(own)).collect()
    }

    /// The light across the edges of `explained`, by the direction that they face.
    pub(super) fn profiles(&self, picture: &Planes, light: Light, explained: &Explained) -> Vec<Profile> {
        /// Less difference between mechanism and tank tells nothing of a rim, in light.
        const LEAST_CONTRAST: f32 = 0.03;
        let lines = self.read(picture, light, &explained.pose, 1.0);
        let colours = self.colours(&lines, light);
        let reading = &lines.reading;
        let mut profiles = vec![Profile::default(); DIRECTIONS];
        for (i, line) in explained.lines.iter().enumerate() {
            if !(line.tells && line.best_px.abs() < OWN_EDGE_PX) {
                continue;
            }
            let face = light_of(colours[i][0]);
            for (k, at) in reading.samples(i).enumerate().filter(|(_, at)| reading.is_open(*at)) {
                let tank = light_of(reading.tank[at][0]);
                let contrast = face - tank;
                if contrast.abs() > LEAST_CONTRAST {
                    let shown = (light_of(reading.picture[at][0]) - tank) / contrast;
                    let outside = outward(k) - line.residual_px;
                    let weight = f64::from(contrast * contrast);
                    profiles[reading.direction[i]].add(outside, f64::from(shown), weight);
                }
            }
        }
        profiles
    }

    /// How badly edges of each of these blurs explain those of `explained`, wherever on its line each may be: the middle of the lines'
    /// mean squares \[grey levels2\].
    pub(super) fn misfits(
        &self,
        picture: &Planes,
        light: Light,
        explained: &Explained,
        blurs_px: &[f64],
    ) -> Option<Vec<f64>> {
        /// Samples so far from an edge show its shape, and how far it may be from where it was found, in steps \[px\]; chosen.
        const NEAR_PX: f64 = 4.5;
        const SHIFT_PX: f64 = 0.125;
        const SHIFT_STEPS: i32 = 6;
        let lines = self.read(picture, light, &explained.pose, 1.0);
        let colours = self.colours(&lines, light);
        let reading = &lines.reading;
        let telling = explained
            .lines
            .iter()
            .enumerate()
            .filter(|(_, line)| line.tells && line.best_px.abs() < OWN_EDGE_PX);
        let telling: Vec<(usize, &Line)> = telling.collect();
        let of_line = |blur_px: f64, (i, line): &(usize, &Line)| {
            let face = light_of(colours[*i][0]);
            let off = |shift: i32| {
                let place_px = line.residual_px + SHIFT_PX * f64::from(shift);
                let near = reading
                    .samples(*i)
                    .enumerate()
                    .filter(|(k, at)| (outward(*k) - place_px).abs() < NEAR_PX && reading.is_open(*at));
                let squares = near.map(|(k, at)| {
                    let way = light_of(reading.tank[at][0]) - face;
                    let share = normal_share((outward(k) - place_px) / blur_px) as f32;
                    f64::from(reading.picture[at][0] - grey_of(face + way * share)).powi(2)
                });
                let (sum, count) =
                    squares.fold((0.0, 0.0), |(sum, count), square| (sum + square, count + 1.0));
                sum / f64::max(count, 1.0)
            };
            (-SHIFT_STEPS..=SHIFT_STEPS).map(off).fold(f64::INFINITY, f64::min)
        };
        let middle = |blur_px: &f64| {
            let mut all: Vec<f64> = telling.iter().step_by(2).map(|line| of_line(*blur_px, line)).collect();
            ground::statistics::median(&mut all, f64::total_cmp)
        };
        blurs_px.iter().map(middle).collect()
    }

    /// The mechanism's colour on each line.
    fn colours(&self, lines: &Lines, light: Light) -> Vec<[f32; PLANES]> {
        let now = inside(&lines.reading, |i| lines.visible[i]);
        let now = smoothed(&now, self.mechanism.runs(), COLOUR_NEIGHBOURS);
        let usual = medians(now.iter().flatten().copied()).unwrap_or(NEUTRAL);
        let now_or_usual = |i: usize| now[i].unwrap_or(usual);
        (0..lines.visible.len())
            .map(|i| {
                let Some(Some(known)) = self.colours.get(i) else { return now_or_usual(i) };
                let known = [known[0] * light[0], known[1] + light[1], known[2] + light[2]];
                let change = now[i].map_or([0.0; PLANES], |now| difference(now, known));
                let limited = |plane: usize| change[plane].clamp(-MOST_CHANGE[plane], MOST_CHANGE[plane]);
                [0, 1, 2].map(|plane| known[plane] + limited(plane))
            })
            .collect()
    }

    fn improve(
        &self,
        picture: &Planes,
        light: Light,
        pose: &[f64],
        expected: Option<Expected<'_>>,
        step_px: f64,
    ) -> Explained {
        let lines = self.read(picture, light, pose, step_px);
        let colours = self.colours(&lines, light);
        let precision: Vec<[f32; PLANES]> = colours
            .iter()
            .map(|colour| {
                [0, 1, 2].map(|plane| {
                    let own = COLOUR_SHARE[plane] * (colour[plane] - NEUTRAL[plane]).abs();
                    let noise = NOISE_FACTOR * self.tank.noise[plane];
                    (noise * noise + own * own + LEAST_STD[plane] * LEAST_STD[plane]).sqrt().recip()
                })
            })
            .collect();
        let costs = Costs::of(&lines.reading, &colours, &precision, self.edges);
        let tables = Tables::of(&costs, &lines.visible);
        let n = pose.len();
        let slopes = lines.slopes.columns(0, n).into_owned();
        // both the own prior and what is expected, as rows of residuals in the step
        let own = prior(self.mechanism);
        let at = DVector::from_column_slice(pose);
        let mut rows = own.clone();
        let mut targets = -(&own * &at);
        if let Some((expected, std)) = expected {
            let count = rows.nrows();
            rows = rows.resize_vertically(count + n, 0.0);
            targets = targets.resize_vertically(count + n, 0.0);
            for i in 0..n {
                rows[(count + i, i)] = 1.0 / std;
                targets[count + i] = (expected[i] - pose[i]) / std;
            }
        }
        let (step, cost) = tables.descend(&slopes, &rows, &targets);
        let moved = &slopes * &step;
        let found: Vec<Line> = (0..lines.visible.len())
            .map(|i| Line { is_visible: lines.visible[i], ..tables.line(i, moved[i]) })
            .collect();
        let mut information = own.transpose() * &own;
        for (i, line) in found.iter().enumerate().filter(|(_, line)| line.residual_px.abs() < 2.5) {
            let row = slopes.row(i);
            information.ger(line.information, &row.transpose(), &row.transpose(), 1.0);
        }
        Explained {
            pose: (at + step).as_slice().to_vec(),
            cost,
            lines: found,
            slopes: lines.slopes,
            information,
        }
    }
}

/// Lines across an outline, before anything is explained.
struct Lines {
    reading: Reading,
    visible: Vec<bool>,
    slopes: DMatrix<f64>,
}

impl Explained {
    fn share(of: usize, all: usize) -> f64 {
        of as f64 / all.max(1) as f64
    }

    fn count(&self, is: impl Fn(&&Line) -> bool) -> usize {
        self.lines.iter().filter(is).count()
    }

    /// Share of the visible outline where the picture tells.
    pub(super) fn told(&self) -> f64 {
        Self::share(self.count(|line| line.tells), self.count(|line| line.is_visible))
    }

    /// Share of that where it agrees.
    pub(super) fn agreement(&self) -> f64 {
        let agrees = self.count(|line| line.tells && line.best_px.abs() < OWN_EDGE_PX);
        Self::share(agrees, self.count(|line| line.tells))
    }
}
