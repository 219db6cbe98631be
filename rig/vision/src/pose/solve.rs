//! The pose of least cost in one picture: damped Newton steps on the lines' tables of costs.

use nalgebra::{DMatrix, DVector};

use super::colours::{Colour, adapt_tank, difference, inside, medians, smoothed};
use super::lines::{Costs, PLACES_PER_LINE, Reading, SAMPLES_PER_LINE, light_of, outward, place_px};
use super::mechanism::Mechanism;
use super::rims::{DIRECTIONS, Profile, Rim};
use super::shared::Shared;
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
    /// What its rims look like.
    pub(super) rims: &'a [Rim; DIRECTIONS],
}

/// Where a pose is expected: its angles, and one sigma of each \[rad\].
pub(super) type Expected<'a> = (&'a [f64], f64);

/// Readings of the picture one after the other: samples so far apart \[px\], so many times.
pub(super) type Readings<'a> = &'a [(f64, usize)];

/// What one line across the outline says of a pose.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Line {
    /// From the outline to the edge nearby \[px\], outward.
    pub(super) residual_px: f64,
    /// From the outline to the best place on the whole line \[px\].
    pub(super) best_px: f64,
    /// How sharply it tells \[1/px2\].
    pub(super) information: f64,
    /// It should show an edge.
    pub(super) is_visible: bool,
    /// It tells one place from another.
    pub(super) tells: bool,
}

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
/// The chance that a line says nothing is `exp` of minus this.
const STRAY: f64 = 4.0;
/// A line whose best place costs so much a sample counts half.
const POOR_FIT: f64 = 2.5;
/// A line tells where its places differ by so much.
pub(super) const TELLING: f64 = 1.5;
/// An edge this far off belongs to something else \[px\].
pub(super) const OWN_EDGE_PX: f64 = 1.5;
const NEWTON_STEPS: usize = 12;

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
        let costs = Costs::of(&lines.reading, &colours, &precision, self.rims);
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
            .map(|i| Line { is_visible: lines.visible[i], ..tables.line(&costs, i, moved[i]) })
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

/// Costs of lines that may be wrong, and their slopes and curvatures.
struct Tables {
    step_px: f64,
    weights: Vec<f64>,
    /// Each shape (lines, PLACES_PER_LINE).
    cost: Vec<f64>,
    slope: Vec<f64>,
    curvature: Vec<f64>,
    /// How much each line's places differ.
    depth: Vec<f64>,
}

impl Tables {
    fn of(costs: &Costs, visible: &[bool]) -> Self {
        let lines = visible.len();
        let mut tables = Self {
            step_px: costs.step_px,
            weights: Vec::with_capacity(lines),
            cost: Vec::with_capacity(lines * PLACES_PER_LINE),
            slope: Vec::with_capacity(lines * PLACES_PER_LINE),
            curvature: Vec::with_capacity(lines * PLACES_PER_LINE),
            depth: Vec::with_capacity(lines),
        };
        let stray = (-STRAY).exp();
        for (i, &is_visible) in visible.iter().enumerate() {
            let of_line = costs.of_line(i);
            let best = of_line.iter().copied().fold(f32::INFINITY, f32::min);
            let robust: Vec<f64> = of_line
                .iter()
                .map(|cost| -((-f64::from((cost - best).min(60.0))).exp() + stray).ln())
                .collect();
            let least = robust.iter().copied().fold(f64::INFINITY, f64::min);
            let robust: Vec<f64> = robust.into_iter().map(|cost| cost - least).collect();
            let slope = gradient(&robust, costs.step_px);
            tables.curvature.extend(gradient(&slope, costs.step_px));
            tables.slope.extend(slope);
            tables.depth.push(robust.iter().copied().fold(0.0, f64::max));
            tables.cost.extend(robust);
            let open = is_visible && 2 * costs.open[i] as usize > SAMPLES_PER_LINE;
            let poor = costs.best_per_sample(i) / POOR_FIT;
            tables.weights.push(if open { 1.0 / (1.0 + poor * poor) } else { 0.0 });
        }
        tables
    }

    /// Entry of `table` on line `i` for an edge at `at_px`, and between places.
    fn look(&self, table: &[f64], i: usize, at_px: f64) -> f64 {
        let at =
            (at_px / self.step_px + (PLACES_PER_LINE / 2) as f64).clamp(0.0, PLACES_PER_LINE as f64 - 1.001);
        let k = at as usize;
        let share = at - k as f64;
        let row = &table[i * PLACES_PER_LINE..(i + 1) * PLACES_PER_LINE];
        row[k] * (1.0 - share) + row[k + 1] * share
    }

    /// The step of the numbers that makes lines and prior cost least, and what remains.
    fn descend(
        &self,
        slopes: &DMatrix<f64>,
        rows: &DMatrix<f64>,
        targets: &DVector<f64>,
    ) -> (DVector<f64>, f64) {
        let n = slopes.ncols();
        let cost = |step: &DVector<f64>| {
            let moved = slopes * step;
            let lines: f64 =
                (0..moved.len()).map(|i| self.weights[i] * self.look(&self.cost, i, moved[i])).sum();
            lines + 0.5 * (rows * step - targets).norm_squared()
        };
        let (mut step, mut damping) = (DVector::zeros(n), 1e-3);
        let mut current = cost(&step);
        for _ in 0..NEWTON_STEPS {
            let moved = slopes * &step;
            let mut gradient = rows.transpose() * (rows * &step - targets);
            let mut hessian = rows.transpose() * rows;
            for i in 0..moved.len() {
                if self.weights[i] == 0.0 {
                    continue;
                }
                let slope = self.look(&self.slope, i, moved[i]);
                // A slope without curvature still pulls: as a parabola with the same slope, half a window away.
                let curvature =
                    self.look(&self.curvature, i, moved[i]).max(0.0).max(slope.abs() / (6.0 * self.step_px));
                let row = slopes.row(i).transpose();
                gradient.axpy(self.weights[i] * slope, &row, 1.0);
                hessian.ger(self.weights[i] * curvature, &row, &row, 1.0);
            }
            let mut change = None;
            for _ in 0..5 {
                let damped = &hessian + DMatrix::from_diagonal(&(hessian.diagonal() * damping));
                let Some(solved) = damped.cholesky().map(|factors| -factors.solve(&gradient)) else { break };
                let tried = &step + &solved;
                let costs = cost(&tried);
                if costs < current - 1e-6 {
                    (step, current) = (tried, costs);
                    damping = f64::max(damping / 4.0, 1e-5);
                    change = Some(solved);
                    break;
                }
                damping *= 6.0;
            }
            let Some(change) = change else { break };
            if (slopes * change).amax() < 0.01 {
                break;
            }
        }
        (step, current)
    }

    /// What line `i` says where the outline has moved by `moved_px`.
    fn line(&self, costs: &Costs, i: usize, moved_px: f64) -> Line {
        /// Places on either side among which a line's own edge is.
        const WINDOW: usize = 6;
        let here = (moved_px / self.step_px).round() as isize + (PLACES_PER_LINE / 2) as isize;
        let here = here.clamp(WINDOW as isize + 1, (PLACES_PER_LINE - 2 - WINDOW) as isize) as usize;
        let row = &self.cost[i * PLACES_PER_LINE..(i + 1) * PLACES_PER_LINE];
        let least = |from: usize, to: usize, of: &dyn Fn(usize) -> f64| {
            (from..to).min_by(|&a, &b| of(a).total_cmp(&of(b))).unwrap_or(here)
        };
        let near = least(here - WINDOW, here + WINDOW + 1, &|j| row[j]);
        let all = costs.of_line(i);
        let best = least(0, PLACES_PER_LINE, &|j| f64::from(all[j]));
        let weight = self.weights[i];
        // between places as a parabola through three of them has it
        let [before, at, after] = [row[near - 1], row[near], row[near + 1]];
        let bend = before - 2.0 * at + after;
        let between = if bend > 0.0 { (0.5 * (before - after) / bend).clamp(-0.5, 0.5) } else { 0.0 };
        Line {
            residual_px: place_px(near, self.step_px) + between * self.step_px - moved_px,
            best_px: place_px(best, self.step_px) - moved_px,
            information: weight * self.curvature[i * PLACES_PER_LINE + near].max(0.0),
            is_visible: true,
            tells: weight > 0.1 && self.depth[i] > TELLING,
        }
    }
}

/// Differences of `values`, `step` apart: central ones, one-sided at both ends.
fn gradient(values: &[f64], step: f64) -> Vec<f64> {
    let last = values.len() - 1;
    (0..=last)
        .map(|i| {
            let (a, b) = (i.saturating_sub(1), (i + 1).min(last));
            (values[b] - values[a]) / ((b - a) as f64 * step)
        })
        .collect()
}
