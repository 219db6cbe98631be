//! What lines across the outline cost where its edge may be, and the step of a pose that makes that least: damped Newton steps.

use nalgebra::{DMatrix, DVector};

use super::lines::{Costs, PLACES_PER_LINE, SAMPLES_PER_LINE, place_px};

/// The chance that a line says nothing is `exp` of minus this.
const STRAY_NATS: f64 = 4.0;
/// A line whose best place costs so much a sample counts half.
const POOR_FIT: f64 = 2.5;
/// A line tells where its places differ by so much.
const TELLING_NATS: f64 = 1.5;
/// Steps of a pose at most; chosen.
const NEWTON_STEPS: usize = 12;
/// A line counts where more than one in so many of its samples are open; chosen.
const LEAST_OPEN: usize = 3;

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

/// Costs of lines that may be wrong: between places the cubic that has their costs and slopes. Straight lines between places would have their
/// least costs at places, and hold an outline where it was read.
pub(super) struct Tables {
    step_px: f64,
    weights: Vec<f64>,
    /// Over the least of the line, each shape (lines, PLACES_PER_LINE), and how it changes from place to place.
    cost: Vec<f64>,
    slope: Vec<f64>,
    /// How much each line's places differ.
    depth: Vec<f64>,
}

/// What a line that may be wrong costs, for `cost` over that of its best place, between which it may be a little less; and how much of a slope of that counts.
fn robust(cost: f64) -> (f64, f64) {
    let (told, stray) = ((-cost).exp(), (-STRAY_NATS).exp());
    (-((told + stray) / (1.0 + stray)).ln(), told / (told + stray))
}

/// What an edge at a place costs, and the slope and bend of that by the place.
#[derive(Debug, Clone, Copy)]
struct At {
    cost: f64,
    slope: f64,
    bend: f64,
}

impl Tables {
    pub(super) fn of(costs: &Costs, visible: &[bool]) -> Self {
        let lines = visible.len();
        let mut tables = Self {
            step_px: costs.step_px,
            weights: Vec::with_capacity(lines),
            cost: Vec::with_capacity(lines * PLACES_PER_LINE),
            slope: Vec::with_capacity(lines * PLACES_PER_LINE),
            depth: Vec::with_capacity(lines),
        };
        for (i, &is_visible) in visible.iter().enumerate() {
            let of_line = costs.of_line(i);
            let best = of_line.iter().copied().fold(f32::INFINITY, f32::min);
            let over: Vec<f64> = of_line.iter().map(|cost| f64::from(cost - best)).collect();
            tables.depth.push(robust(over.iter().copied().fold(0.0, f64::max)).0);
            tables.slope.extend(gradient(&over, 1.0));
            tables.cost.extend(over);
            let open = is_visible && LEAST_OPEN * costs.open[i] as usize > SAMPLES_PER_LINE;
            let poor = costs.best_per_sample(i) / POOR_FIT;
            tables.weights.push(if open { 1.0 / (1.0 + poor * poor) } else { 0.0 });
        }
        tables
    }

    /// Of an edge of line `i` at `at_px`.
    fn at(&self, i: usize, at_px: f64) -> At {
        let at =
            (at_px / self.step_px + (PLACES_PER_LINE / 2) as f64).clamp(0.0, PLACES_PER_LINE as f64 - 1.001);
        let (k, share) = (i * PLACES_PER_LINE + at as usize, at.fract());
        let [from, to] = [self.cost[k], self.cost[k + 1]];
        let [begin, end] = [self.slope[k], self.slope[k + 1]];
        let (square, cube) = (3.0 * (to - from) - 2.0 * begin - end, begin + end - 2.0 * (to - from));
        let (cost, counts) = robust(from + share * (begin + share * (square + share * cube)));
        At {
            cost,
            slope: counts * (begin + share * (2.0 * square + 3.0 * share * cube)) / self.step_px,
            bend: counts * (2.0 * square + 6.0 * share * cube).max(0.0) / self.step_px.powi(2),
        }
    }

    /// The step of the numbers that makes lines and prior cost least, and what remains.
    pub(super) fn descend(
        &self,
        slopes: &DMatrix<f64>,
        rows: &DMatrix<f64>,
        targets: &DVector<f64>,
    ) -> (DVector<f64>, f64) {
        let n = slopes.ncols();
        let cost = |step: &DVector<f64>| {
            let moved = slopes * step;
            let lines: f64 = (0..moved.len()).map(|i| self.weights[i] * self.at(i, moved[i]).cost).sum();
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
                let At { slope, bend, .. } = self.at(i, moved[i]);
                // A slope without curvature still pulls: as a parabola with the same slope, half a window away.
                let curvature = bend.max(slope.abs() / (6.0 * self.step_px));
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
    pub(super) fn line(&self, i: usize, moved_px: f64) -> Line {
        /// Places on either side among which a line's own edge is.
        const WINDOW_PLACES: usize = 6;
        let here = (moved_px / self.step_px).round() as isize + (PLACES_PER_LINE / 2) as isize;
        let here =
            here.clamp(WINDOW_PLACES as isize + 1, (PLACES_PER_LINE - 2 - WINDOW_PLACES) as isize) as usize;
        let row = &self.cost[i * PLACES_PER_LINE..(i + 1) * PLACES_PER_LINE];
        let least =
            |from: usize, to: usize| (from..to).min_by(|&a, &b| row[a].total_cmp(&row[b])).unwrap_or(here);
        let near = least(here - WINDOW_PLACES, here + WINDOW_PLACES + 1);
        let best = least(0, PLACES_PER_LINE);
        let weight = self.weights[i];
        // between places as a parabola through three of them has it
        let [before, at, after] = [row[near - 1], row[near], row[near + 1]];
        let bend = before - 2.0 * at + after;
        let between = if bend > 0.0 { (0.5 * (before - after) / bend).clamp(-0.5, 0.5) } else { 0.0 };
        Line {
            residual_px: place_px(near, self.step_px) + between * self.step_px - moved_px,
            best_px: place_px(best, self.step_px) - moved_px,
            information: weight * robust(at).1 * bend.max(0.0) / self.step_px.powi(2),
            is_visible: true,
            tells: weight > 0.1 && self.depth[i] > TELLING_NATS,
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Lines whose edge is at `edge_px`, as sharp as `information` \[1/px2\] says.
    fn lines(edges_px: &[f64], information: f64) -> Costs {
        let step_px = 0.5;
        let of = |edge: &f64| {
            let edge = *edge;
            (0..PLACES_PER_LINE)
                .map(move |j| (0.5 * information * (place_px(j, step_px) - edge).powi(2)).min(40.0) as f32)
        };
        Costs { step_px, cost: edges_px.iter().flat_map(of).collect(), open: vec![25; edges_px.len()] }
    }

    #[test]
    fn an_outline_comes_to_rest_where_its_edges_are_and_not_where_it_was_read() {
        for edge_px in [0.0, 0.04, 0.12, 0.25, 0.4, 1.3] {
            for information in [0.5, 7.0, 20.0] {
                let costs = lines(&[edge_px; 6], information);
                let tables = Tables::of(&costs, &[true; 6]);
                let slopes = DMatrix::from_element(6, 1, 10.0);
                let (step, _) = tables.descend(&slopes, &DMatrix::zeros(0, 1), &DVector::zeros(0));
                let moved = 10.0 * step[0];
                assert!((moved - edge_px).abs() < 0.02, "{edge_px} {information}: {moved}");
                assert!(tables.line(0, moved).residual_px.abs() < 0.02);
            }
        }
    }
}
