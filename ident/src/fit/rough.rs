//! A rough form of a fit's objective: fewer images, of the first part of the motion, and coarser steps. A descent goes most of
//! its way there, for a fraction of what the whole costs, and the rest on the whole.

use sim::{Model, Trajectory};

use super::objective::Objective;
use super::problem::{Problem, Term};
use crate::experiment::Run;
use crate::initial::Estimate;
use crate::loss::{Weighting, observations};
use crate::simulate::Rehearsal;

/// Fewest images of a run on the rough objective, and the first share of the motion that they cover (chosen).
const ROUGH_IMAGES_MIN: usize = 100;
const ROUGH_MOTION_SHARE: f64 = 0.6;
/// Simulation errors on the rough objective may be this many times those on the whole one (chosen).
const ROUGH_ERROR_RATIO: f64 = 30.0;

/// A run with fewer images: one of each `stride`, as long as they show the first part of its motion.
#[derive(Debug)]
pub(super) struct Thinned {
    run: Run,
    stride: usize,
}

impl Thinned {
    /// Of a run whose motion starts at `start_s`.
    pub(super) fn new(run: &Run, start_s: f64) -> Self {
        let whole = &run.trajectory;
        let (times, width) = (&whole.time_s, whole.keypoints.len());
        let until_s =
            times.last().map_or(start_s, |last_s| start_s + ROUGH_MOTION_SHARE * (last_s - start_s));
        let shown = times.partition_point(|&time_s| time_s <= until_s).max(ROUGH_IMAGES_MIN.min(times.len()));
        let stride = (shown / ROUGH_IMAGES_MIN).max(1);
        let rows = || (0..shown).step_by(stride);
        let cells = || rows().flat_map(|row| row * width..(row + 1) * width);
        let trajectory = Trajectory {
            time_s: rows().map(|row| times[row]).collect(),
            keypoints: whole.keypoints.clone(),
            position_m: cells().map(|cell| whole.position_m[cell]).collect(),
            std_m: whole.std_m.as_ref().map(|std_m| cells().map(|cell| std_m[cell]).collect()),
            // its weights are for a start alone
            pose_std_m: None,
        };
        Self { run: Run { trajectory, ..run.clone() }, stride }
    }

    /// The rough form of the run that was thinned, with its own `estimate`. Each image counts for those that were left out.
    pub(super) fn term(&self, model: &Model, estimate: Estimate, weighting: Weighting) -> Term<'_> {
        let run_weight = weighting.run_weight * self.stride as f64;
        Term::new(
            Rehearsal::rougher(model, &self.run, estimate, weighting.noise_m, ROUGH_ERROR_RATIO),
            observations(&self.run.trajectory, Weighting { run_weight, ..weighting }, |_| true),
        )
    }
}

/// `whole` with `terms` instead of its own.
pub(super) fn rough<'a>(whole: &Objective<'a>, terms: Vec<Term<'a>>) -> Objective<'a> {
    let problem = Problem { terms, ..whole.problem };
    Objective { problem, loss: whole.loss, belief: whole.belief.clone() }
}
