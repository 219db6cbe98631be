//! Where the steps of a run end.

use crate::command::Command;
use crate::model::{Model, State};
use crate::rollout::{RolloutError, RolloutOptions, rollout};

/// Steps chosen for accuracy, see [`plan`](crate::plan()). They meet the corners of the commands, and stiction and end stops
/// are as stiff as at the model's own time step whatever the step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Steps {
    /// How a step is taken.
    pub method: Method,
    /// No step is longer \[s\].
    pub longest_s: f64,
}

/// Ways of taking a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Method {
    /// Classical fourth-order Runge-Kutta, explicit: soft mechanisms.
    RungeKutta,
    /// Linearly implicit Euler with one, two and three parts of the step, extrapolated to third order: stiff joints and
    /// drives (Deuflhard, Order and stepsize control in extrapolation methods, 1983).
    Extrapolation,
}

/// Steps that are as exact as wanted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plan {
    /// The steps.
    pub steps: Steps,
    /// Estimated error of the worst keypoint coordinate at the worst instant \[m\].
    pub error_m: f64,
}

/// The wanted accuracy of keypoints where nobody says another \[m\]: a fortieth of what a camera resolves.
pub const ACCURACY_M: f64 = 1e-5;
/// Longest step tried \[s\], and by how much each next one is shorter.
const LONGEST_S: f64 = 0.05;
const SHORTER: f64 = 2.0 / 3.0;
/// Shortest step worth trying \[s\].
const SHORTEST_S: f64 = 1e-5;
/// Methods with their order and their cost in evaluations of all forces.
const METHODS: [(Method, i32, f64); 2] = [(Method::RungeKutta, 4, 4.0), (Method::Extrapolation, 3, 5.5)];

/// Looks for the cheapest steps whose keypoints are within `accuracy_m` \[m\] of the motion itself at
/// `sample_times_s`. Made once for a run, with its nominal model: every candidate of a fit then takes the same
/// steps, so that the loss stays smooth.
///
/// Estimate: the difference to steps two thirds as long, over what the order of the method leaves of it.
///
/// # Errors
/// [`RolloutError`] of the last attempt where no step is stable and exact enough.
pub fn plan(
    model: &Model,
    state: &State,
    command: &Command,
    sample_times_s: &[f64],
    options: &RolloutOptions,
    accuracy_m: f64,
) -> Result<Plan, RolloutError> {
    let run = |method: Method, longest_s: f64| {
        let options = RolloutOptions { steps: Some(Steps { method, longest_s }), ..options.clone() };
        rollout(model, state, command, sample_times_s, &options).map(|run| run.position_m)
    };
    let mut best: Option<(Plan, f64)> = None;
    let mut last = RolloutError::Inexact { accuracy_m, shortest_s: SHORTEST_S };
    for (method, order, evaluations) in METHODS {
        let mut longest_s = LONGEST_S;
        let mut coarse = run(method, longest_s);
        while longest_s > SHORTEST_S && best.is_none_or(|(_, cost)| evaluations / longest_s < cost) {
            let fine = run(method, longest_s * SHORTER);
            match (&coarse, &fine) {
                (Ok(a), Ok(b)) => {
                    let apart = a.iter().flatten().zip(b.iter().flatten()).map(|(a, b)| (a - b).abs());
                    let error_m = apart.fold(0.0, f64::max) / (1.0 - SHORTER.powi(order));
                    if error_m <= accuracy_m {
                        let plan = Plan { steps: Steps { method, longest_s }, error_m };
                        best = Some((plan, evaluations / longest_s));
                        break;
                    }
                }
                (Err(error), _) | (_, Err(error)) if matches!(error, RolloutError::Diverged { .. }) => {
                    last = error.clone();
                }
                (Err(error), _) | (_, Err(error)) => return Err(error.clone()),
            }
            coarse = fine;
            longest_s *= SHORTER;
        }
    }
    best.map(|(plan, _)| plan).ok_or(last)
}

/// When steps end \[s\], counted from the start of motion.
pub(crate) struct Grid {
    /// The first ones.
    instants: Vec<f64>,
    /// Length of all others.
    timestep_s: f64,
}

/// A change of rate this small beside the largest counts as none: smooth commands have no corners.
const CORNER: f64 = 0.1;

impl Grid {
    /// Equal steps of `timestep_s`; with [`RolloutOptions::steps`] equal ones between the corners of `command`, none
    /// longer.
    pub(crate) fn new(timestep_s: f64, command: &Command, options: &RolloutOptions) -> Self {
        let mut instants = vec![0.0];
        if options.steps.is_some() {
            for corner in corners(command, timestep_s) {
                let (from, to) = (instants[instants.len() - 1], corner - options.start_s);
                let parts = ((to - from) / timestep_s - 1e-9).ceil();
                instants.extend(
                    (1..=parts.max(0.0) as usize).map(|part| from + (to - from) * part as f64 / parts),
                );
            }
        }
        Self { instants, timestep_s }
    }

    /// When step `index` ends; 0 for the start.
    pub(crate) fn instant(&self, index: usize) -> f64 {
        let last = self.instants.len() - 1;
        match self.instants.get(index) {
            Some(&instant) => instant,
            None => self.instants[last] + (index - last) as f64 * self.timestep_s,
        }
    }

    /// How long step `index` is, from 1.
    pub(crate) fn step(&self, index: usize) -> f64 {
        if index < self.instants.len() {
            self.instants[index] - self.instants[index - 1]
        } else {
            self.timestep_s
        }
    }
}

/// Times \[s\] at which the rate of some column of `command` jumps. None where jumps follow each other within steps of
/// `timestep_s`: no step could be made to fit them.
fn corners(command: &Command, timestep_s: f64) -> Vec<f64> {
    let width = command.actuators.len();
    let rows = command.time_s.len();
    let rate = |column: usize, row: usize| {
        let rise = command.angle_rad[(row + 1) * width + column] - command.angle_rad[row * width + column];
        rise / (command.time_s[row + 1] - command.time_s[row])
    };
    let mut corners = Vec::new();
    for column in 0..width {
        let jump = |row: usize| {
            let before = if row == 0 { 0.0 } else { rate(column, row - 1) };
            let after = if row + 1 == rows { 0.0 } else { rate(column, row) };
            f64::abs(after - before)
        };
        let largest = (0..rows).map(jump).fold(0.0, f64::max);
        corners.extend((0..rows).filter(|&row| jump(row) > CORNER * largest).map(|row| command.time_s[row]));
    }
    corners.sort_by(f64::total_cmp);
    corners.dedup();
    let span = rows.checked_sub(1).map_or(0.0, |last| command.time_s[last] - command.time_s[0]);
    let crowded = corners.len() as f64 * timestep_s > span;
    if crowded { Vec::new() } else { corners }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_end_at_every_corner_and_nowhere_else_than_evenly_between() {
        let command = Command {
            actuators: vec!["servo".into()],
            time_s: vec![1.0, 1.5, 2.0, 2.25],
            angle_rad: vec![0.0, 0.5, 1.0, 0.0],
        };
        let steps = Some(Steps { method: Method::RungeKutta, longest_s: 0.2 });
        let options = RolloutOptions { start_s: 0.5, steps, ..RolloutOptions::default() };
        let grid = Grid::new(0.2, &command, &options);
        // 0.5 s of rest, 1 s up (the middle row is no corner), 0.25 s down, and on in whole steps
        let ends: Vec<f64> = (0..13).map(|k| (grid.instant(k) * 1e9).round() / 1e9).collect();
        let expected = [0.0, 0.166666667, 0.333333333, 0.5, 0.7, 0.9, 1.1, 1.3, 1.5, 1.625, 1.75, 1.95, 2.15];
        assert_eq!(ends, expected);
        assert!((1..12).all(|k| (grid.step(k) - (grid.instant(k) - grid.instant(k - 1))).abs() < 1e-12));
        assert_eq!(Grid::new(0.2, &command, &RolloutOptions::default()).instant(5), 1.0);
    }
}
