//! Where the steps of a run end.

use std::sync::Arc;

use crate::command::Command;

/// Steps chosen for accuracy, see [`plan`](crate::plan()). They meet the corners of the commands, and stiction and end stops
/// are as stiff as at the model's own time step whatever the step.
#[derive(Debug, Clone, PartialEq)]
pub struct Steps {
    /// How a step is taken.
    pub method: Method,
    /// No step is longer \[s\].
    pub longest_s: f64,
    /// When steps end \[s\], counted from the start of motion, rising; beyond the last, and where there is none, steps are even
    /// between the corners of the commands.
    pub ends_s: Arc<[f64]>,
}

impl Steps {
    /// Even steps between the corners of the commands, none longer than `longest_s` \[s\].
    pub fn even(method: Method, longest_s: f64) -> Self {
        Self { method, longest_s, ends_s: Arc::default() }
    }

    /// The same with each step in `parts` equal ones, for a candidate that is stiffer than what the steps were chosen for.
    pub fn divided(&self, parts: usize) -> Self {
        let parts = parts.max(1);
        Self { longest_s: self.longest_s / parts as f64, ..self.split(|_| parts) }
    }

    /// The same with each step that is longer than `longest_s` \[s\] in equal ones that are not.
    pub fn shortened(&self, longest_s: f64) -> Self {
        let steps = self.split(|step_s| (step_s / longest_s - 1e-9).ceil().max(1.0) as usize);
        Self { longest_s: self.longest_s.min(longest_s), ..steps }
    }

    /// The same with each step in as many equal ones as `parts` says of its length \[s\].
    fn split(&self, parts: impl Fn(f64) -> usize) -> Self {
        let mut ends = Vec::with_capacity(self.ends_s.len());
        let mut from = 0.0;
        for &to in self.ends_s.iter() {
            let parts = parts(to - from);
            ends.extend((1..parts).map(|part| from + (to - from) * part as f64 / parts as f64));
            ends.push(to);
            from = to;
        }
        Self { ends_s: ends.into(), ..self.clone() }
    }
}

/// Ways of taking a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Method {
    /// Classical fourth-order Runge-Kutta, explicit: soft mechanisms.
    RungeKutta,
    /// ROS34PW2 of Rang and Angermann (2005), third order, linearly implicit in the slopes of joints and drives: stiff joints
    /// and drives.
    Rosenbrock,
}

/// When steps end \[s\], counted from the start of motion.
pub(crate) struct Grid {
    /// Ends of the first steps \[s\], from 0 on.
    instants: Vec<f64>,
    /// Length of all further steps \[s\].
    timestep_s: f64,
}

/// Steps after the planned ones are as long as the median of this many last ones (chosen): the very last may be a sliver, and the longest of all may
/// be too long where the motion is quick.
const LAST_STEPS_AVERAGED: usize = 5;
/// Changes of rate up to this share of the largest are no corners (chosen): smooth commands have none.
const CORNER_RATE_CHANGE_SHARE_MIN: f64 = 0.1;

impl Grid {
    /// Equal steps of `timestep_s`.
    pub(crate) fn equal(timestep_s: f64) -> Self {
        Self { instants: vec![0.0], timestep_s }
    }

    /// `steps`, in parts where they are longer than `most_s`, and after them equal ones between the corners of `command`, none
    /// longer than `timestep_s` or than the last of them; the motion starts at `start_s`. All times in \[s\].
    pub(crate) fn planned(
        steps: &Steps,
        [timestep_s, most_s]: [f64; 2],
        command: &Command,
        start_s: f64,
    ) -> Self {
        let mut instants = vec![0.0];
        instants.extend(steps.shortened(most_s).ends_s.iter());
        let mut last_s: Vec<f64> =
            instants.windows(2).rev().take(LAST_STEPS_AVERAGED).map(|pair| pair[1] - pair[0]).collect();
        last_s.sort_by(f64::total_cmp);
        let timestep_s = last_s.get(last_s.len() / 2).map_or(timestep_s, |&median| timestep_s.min(median));
        for corner in corners(command, timestep_s) {
            let (from, to) = (instants[instants.len() - 1], corner - start_s);
            let parts = ((to - from) / timestep_s - 1e-9).ceil();
            instants
                .extend((1..=parts.max(0.0) as usize).map(|part| from + (to - from) * part as f64 / parts));
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

/// Jumps of rate that follow each other faster than this are noise of a recording, not corners of a profile \[s\] (chosen).
const CORNER_SPACING_MIN_S: f64 = 0.02;

/// Times \[s\] at which some column of `command` or its rate jumps, or a drive turns idle. None but those of idle drives where jumps follow each other within steps of
/// `timestep_s` or faster than a profile's: steps could not be made to fit them.
pub(crate) fn corners(command: &Command, timestep_s: f64) -> Vec<f64> {
    let width = command.actuators.len();
    let rows = command.time_s.len();
    let rate = |column: usize, row: usize| {
        let rise = command.angle_rad[(row + 1) * width + column] - command.angle_rad[row * width + column];
        let lasts_s = command.time_s[row + 1] - command.time_s[row];
        if lasts_s > 0.0 && rise.is_finite() { rise / lasts_s } else { 0.0 }
    };
    let is_idle = |column: usize, row: usize| command.angle_rad[row * width + column].is_nan();
    let (mut corners, mut switches) = (Vec::new(), Vec::new());
    for column in 0..width {
        let rises = (1..rows).filter(|&row| is_idle(column, row) != is_idle(column, row - 1));
        switches.extend(rises.map(|row| command.time_s[row]));
        let leaps = (1..rows).filter(|&row| command.time_s[row] == command.time_s[row - 1]);
        corners.extend(leaps.map(|row| command.time_s[row]));
        let jump = |row: usize| {
            let before = if row == 0 { 0.0 } else { rate(column, row - 1) };
            let after = if row + 1 == rows { 0.0 } else { rate(column, row) };
            f64::abs(after - before)
        };
        let largest = (0..rows).map(jump).fold(0.0, f64::max);
        corners.extend(
            (0..rows)
                .filter(|&row| largest > 0.0 && jump(row) > CORNER_RATE_CHANGE_SHARE_MIN * largest)
                .map(|row| command.time_s[row]),
        );
    }
    corners.extend(&switches);
    for times in [&mut corners, &mut switches] {
        times.sort_by(f64::total_cmp);
        times.dedup();
    }
    let span = rows.checked_sub(1).map_or(0.0, |last| command.time_s[last] - command.time_s[0]);
    let crowded = corners.len() as f64 * timestep_s.min(CORNER_SPACING_MIN_S) > span;
    if crowded { switches } else { corners }
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
        let steps = Steps::even(Method::RungeKutta, 0.2);
        let grid = Grid::planned(&steps, [0.2, f64::INFINITY], &command, 0.5);
        // 0.5 s of rest, 1 s up (the middle row is no corner), 0.25 s down, and on in whole steps
        let ends: Vec<f64> = (0..13).map(|k| (grid.instant(k) * 1e9).round() / 1e9).collect();
        let expected = [0.0, 0.166666667, 0.333333333, 0.5, 0.7, 0.9, 1.1, 1.3, 1.5, 1.625, 1.75, 1.95, 2.15];
        assert_eq!(ends, expected);
        assert!((1..12).all(|k| (grid.step(k) - (grid.instant(k) - grid.instant(k - 1))).abs() < 1e-12));
        assert_eq!(Grid::equal(0.2).instant(5), 1.0);
    }
}
