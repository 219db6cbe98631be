//! When a search is over, and why.

use serde::{Deserialize, Serialize};

use ground::statistics::median;

/// How a search is run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Options {
    /// Initial step size, in the units of the candidates.
    pub sigma: f64,
    /// Candidates per generation; `None`: 4 + 3 ln n.
    pub population: Option<usize>,
    /// Whether candidates stay within 0 and 1.
    pub unit_box: bool,
    /// Seed of the random numbers.
    pub seed: u64,
    /// Most candidates judged; the search stops before the generation that would exceed it.
    pub max_evaluations: u64,
    /// A loss this low ends the search.
    pub target: Option<f64>,
    /// Losses closer than this, over the recent generations, end the search.
    pub tol_loss: f64,
    /// The same as a share of the best loss.
    pub tol_loss_share: f64,
    /// Steps shorter than this in every coordinate end the search.
    pub tol_step: f64,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            sigma: 0.3,
            population: None,
            unit_box: false,
            seed: 1,
            max_evaluations: u64::MAX,
            target: None,
            tol_loss: 1e-11,
            tol_loss_share: 0.0,
            tol_step: 1e-11,
        }
    }
}

impl Options {
    pub(super) fn population_for(&self, n: usize) -> usize {
        self.population.unwrap_or(4 + (3.0 * (n as f64).ln()).floor() as usize).max(4)
    }

    /// Generations over which flatness and stagnation are judged.
    pub(super) fn history_for(&self, n: usize) -> usize {
        120 + (30.0 * n as f64 / self.population_for(n) as f64).ceil() as usize
    }
}

/// Why a search ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Stop {
    /// A loss at or below [`Options::target`].
    Target,
    /// [`Options::max_evaluations`].
    MaxEvaluations,
    /// Losses no longer differ.
    TolLoss,
    /// Steps no longer change the candidates by more than [`Options::tol_step`].
    TolStep,
    /// Steps have become too small for floating point numbers.
    NoEffect,
    /// The covariance is as good as singular.
    Condition,
    /// Losses have not become better for long.
    Stagnation,
    /// The step size has exploded: the start is far off, or the loss falls without end.
    Diverged,
}

impl Stop {
    /// The name as `fit.json` spells it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Target => "target",
            Self::MaxEvaluations => "max-evaluations",
            Self::TolLoss => "tol-loss",
            Self::TolStep => "tol-step",
            Self::NoEffect => "no-effect",
            Self::Condition => "condition",
            Self::Stagnation => "stagnation",
            Self::Diverged => "diverged",
        }
    }
}

/// Best and median losses of the recent generations, oldest first.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub(super) struct History {
    best: Vec<Loss>,
    median: Vec<Loss>,
}

/// JSON knows no infinity: a generation without any finite loss is `None`.
type Loss = Option<f64>;

impl History {
    pub(super) fn push(&mut self, ranked: &[f64], keep: usize) {
        for (list, loss) in [(&mut self.best, ranked[0]), (&mut self.median, ranked[ranked.len() / 2])] {
            list.push(Some(loss).filter(|loss| loss.is_finite()));
            if list.len() > keep {
                list.remove(0);
            }
        }
    }

    /// Whether the losses of the last `window` generations, and those `ranked` in this one, differ by no more than `tolerance`.
    pub(super) fn is_flat(&self, window: usize, ranked: &[f64], tolerance: f64) -> bool {
        if self.best.len() < window {
            return false;
        }
        let recent: Option<Vec<f64>> = self.best[self.best.len() - window..].iter().copied().collect();
        let Some(recent) = recent else { return false };
        let all = || recent.iter().chain(ranked).copied();
        let (low, high) = (all().fold(f64::INFINITY, f64::min), all().fold(f64::NEG_INFINITY, f64::max));
        high - low <= tolerance
    }

    /// Whether the recent 30 % of a history `full` as long are no better than its first 30 %, in best and in median loss.
    pub(super) fn is_stagnant(&self, full: usize) -> bool {
        let worse = |list: &[Loss]| {
            let share = full * 3 / 10;
            let middle = |part: &[Loss]| {
                let mut part: Vec<f64> = part.iter().map(|loss| loss.unwrap_or(f64::INFINITY)).collect();
                median(&mut part, f64::total_cmp)
            };
            list.len() >= full && middle(&list[list.len() - share..]) >= middle(&list[..share])
        };
        worse(&self.best) && worse(&self.median)
    }
}
