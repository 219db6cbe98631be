//! Attempts at the cheapest steps of one method.

use super::{Nominal, Plan};
use crate::dynamics::friction_and_limits::LONGEST_STEP_S;
use crate::error::RolloutError;
use crate::steps::{Method, Steps};

/// Longest step that is tried \[s\] (chosen).
const STEP_MAX_S: f64 = 0.1;
/// Error that the first attempt allows each step, as a share of the wanted accuracy (chosen). Errors add up where nothing damps them, but steps too
/// long are sooner tried than steps too short.
const FIRST_STEP_ERROR_SHARE: f64 = 1.0;
/// Most further attempts once the wanted accuracy is met (chosen).
const REFINEMENTS_MAX: usize = 4;
/// Error that an attempt aims at, and error that is close enough to the wanted accuracy, as shares of it (chosen).
pub(super) const AIMED_ERROR_SHARE: f64 = 0.85;
const CLOSE_ERROR_SHARE: f64 = 0.7;
/// The share that is close enough for even steps (chosen): an attempt costs some five simulations of the whole motion, and the next one would
/// save less than a fifth.
const EVEN_CLOSE_ERROR_SHARE: f64 = 0.4;

/// Attempts at the cheapest steps of one method.
pub(super) struct Search {
    pub(super) method: Method,
    order: i32,
    /// What a step costs, in evaluations of all forces.
    evaluations: f64,
    /// Longest step \[s\] and error per step \[m\] of the next attempt.
    longest_s: f64,
    tolerance_m: f64,
    /// Expected cost of accurate steps, by the last attempt; 0 before the first.
    pub(super) expected_cost: f64,
    /// The cheapest exact steps so far, and how many they are.
    pub(super) best: Option<(Plan, f64)>,
    /// Attempts left once they are exact.
    left: usize,
    pub(super) diverged: Option<RolloutError>,
    pub(super) over: bool,
}

impl Search {
    pub(super) fn new(
        run: &Nominal<'_>,
        method: Method,
        order: i32,
        evaluations: f64,
        accuracy_m: f64,
    ) -> Self {
        Self {
            method,
            order,
            evaluations,
            longest_s: if run.even() { LONGEST_STEP_S } else { STEP_MAX_S },
            tolerance_m: FIRST_STEP_ERROR_SHARE * accuracy_m,
            expected_cost: 0.0,
            best: None,
            left: REFINEMENTS_MAX,
            diverged: None,
            over: false,
        }
    }

    /// Cost of the best steps, in evaluations of all forces.
    pub(super) fn cost(&self) -> Option<f64> {
        self.best.as_ref().map(|(_, count)| self.evaluations * count)
    }

    /// One attempt, which is the last unless its steps cost less than is `affordable`.
    pub(super) fn attempt(
        &mut self,
        run: &Nominal<'_>,
        accuracy_m: f64,
        affordable: f64,
    ) -> Result<(), RolloutError> {
        let (longest_s, order) = (self.longest_s, self.order);
        let most = run.most().min(affordable / self.evaluations);
        let ends_s = match run.ends(self.method, order, self.tolerance_m, longest_s, most) {
            Ok(Some(ends_s)) => ends_s,
            // what is left to try costs more
            Ok(None) => {
                self.over = true;
                return Ok(());
            }
            Err(error @ RolloutError::Diverged { .. }) => {
                (self.diverged, self.over) = (Some(error), true);
                return Ok(());
            }
            Err(error) => return Err(error),
        };
        let count = ends_s.len() as f64;
        let steps = Steps { method: self.method, longest_s, ends_s: ends_s.into() };
        let (error_m, positions) = match run.error(&steps, order) {
            Ok(found) => found,
            Err(error @ RolloutError::Diverged { .. }) => {
                self.diverged = Some(error);
                self.longest_s *= 0.6;
                self.tolerance_m *= 0.5;
                return Ok(());
            }
            Err(error) => return Err(error),
        };
        let exact = error_m <= accuracy_m;
        if exact && !run.robust(&steps, &positions, error_m.max(0.1 * accuracy_m))? {
            self.longest_s *= 0.8;
            self.expected_cost = self.evaluations * count / 0.8;
            return Ok(());
        }
        // what the error of the whole leaves to be gained, or asks for
        let ratio = (AIMED_ERROR_SHARE * accuracy_m / error_m.max(1e-12)).clamp(1e-3, 1e3);
        self.expected_cost = self.evaluations * count / ratio.powf(1.0 / f64::from(order));
        if exact {
            self.best = Some((Plan { steps, error_m }, count));
            self.left -= 1;
            let (close, longest) = match run.even() {
                true => (EVEN_CLOSE_ERROR_SHARE, longest_s >= LONGEST_STEP_S),
                false => (CLOSE_ERROR_SHARE, false),
            };
            self.over = self.left == 0 || error_m > close * accuracy_m || longest;
        }
        if run.even() {
            let longer = longest_s * ratio.powf(1.0 / f64::from(order)).clamp(0.3, 2.0);
            self.longest_s = longer.min(LONGEST_STEP_S);
        } else {
            self.tolerance_m *= ratio.powf(f64::from(order + 1) / f64::from(order)).clamp(1e-2, 1e2);
        }
        Ok(())
    }
}
