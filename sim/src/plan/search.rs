//! Attempts at the cheapest steps of one method.

use super::{Nominal, Plan};
use crate::dynamics::restraint;
use crate::error::RolloutError;
use crate::steps::{Method, Steps};

/// Longest step tried \[s\].
const LONGEST_S: f64 = 0.1;
/// The first attempt allows each step this share of the wanted accuracy. Errors add up where nothing damps them, but steps too
/// long are sooner tried than steps too short.
const FIRST_SHARE: f64 = 1.0;
/// Attempts at meeting the wanted accuracy from below, once it is met.
const MOST_REFINEMENTS: usize = 4;
/// What an attempt aims at, as a share of the wanted accuracy, and the share that is close enough.
pub(super) const AIMED_ERROR_SHARE: f64 = 0.85;
const CLOSE_ERROR_SHARE: f64 = 0.7;
/// Even steps are many, each attempt follows the whole motion some five times, and the next one would save less than a fifth.
const CLOSE_IF_EVEN: f64 = 0.4;

/// Attempts at the cheapest steps of one method.
pub(super) struct Search {
    pub(super) method: Method,
    order: i32,
    /// What a step costs, in evaluations of all forces.
    evaluations: f64,
    /// What the next attempt is made with.
    longest_s: f64,
    tolerance_m: f64,
    /// What exact steps will cost, going by the last attempt; 0 before the first.
    pub(super) promised: f64,
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
            longest_s: if run.even() { restraint::LONGEST_STEP_S } else { LONGEST_S },
            tolerance_m: FIRST_SHARE * accuracy_m,
            promised: 0.0,
            best: None,
            left: MOST_REFINEMENTS,
            diverged: None,
            over: false,
        }
    }

    /// What the best steps cost.
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
            self.promised = self.evaluations * count / 0.8;
            return Ok(());
        }
        // what the error of the whole leaves to be gained, or asks for
        let ratio = (AIMED_ERROR_SHARE * accuracy_m / error_m.max(1e-12)).clamp(1e-3, 1e3);
        self.promised = self.evaluations * count / ratio.powf(1.0 / f64::from(order));
        if exact {
            self.best = Some((Plan { steps, error_m }, count));
            self.left -= 1;
            let (close, longest) = match run.even() {
                true => (CLOSE_IF_EVEN, longest_s >= restraint::LONGEST_STEP_S),
                false => (CLOSE_ERROR_SHARE, false),
            };
            self.over = self.left == 0 || error_m > close * accuracy_m || longest;
        }
        if run.even() {
            let longer = longest_s * ratio.powf(1.0 / f64::from(order)).clamp(0.3, 2.0);
            self.longest_s = longer.min(restraint::LONGEST_STEP_S);
        } else {
            self.tolerance_m *= ratio.powf(f64::from(order + 1) / f64::from(order)).clamp(1e-2, 1e2);
        }
        Ok(())
    }
}
