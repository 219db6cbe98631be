//! Keypoints whose labels are exchanged, in some images or in whole runs: no pose of the model is like what these show, and one is once
//! two labels are changed over.

use rayon::prelude::*;
use sim::Model;

use super::Suspect;
use crate::experiment::{Experiment, Run};
use crate::geometry::characteristic_length_m;
use crate::initial::{nearest_pose, run_noise};

/// An image is looked into where its nearest pose is off by more than this share of the mechanism's length, and this many times the
/// noise (chosen): a wrong link or camera is off by less.
const MISFIT_SHARE_MIN: f64 = 0.03;
const MISFIT_NOISE_RATIO_MIN: f64 = 8.0;
/// Changing two labels over must divide that by this (chosen).
const MISFIT_RATIO_MIN: f64 = 4.0;
/// Fewest images in which two labels are said to be exchanged (chosen); fewer are spikes.
const IMAGES_MIN: usize = 3;
/// In this share of a run's images or more, they are exchanged in the run (chosen).
const WHOLE_RUN_SHARE: f64 = 0.9;

/// Exchanged labels of one run: two keypoints, and the images.
struct Exchange {
    pair: [usize; 2],
    instants: Vec<usize>,
}

/// Labels that are exchanged in single runs, and the experiment with each at its place.
pub(super) fn exchanged(experiment: &Experiment) -> (Vec<Suspect>, Option<Experiment>) {
    let limit_m = MISFIT_SHARE_MIN * characteristic_length_m(&experiment.model);
    let found: Vec<Vec<Exchange>> =
        experiment.runs.par_iter().map(|run| of_run(&experiment.model, run, limit_m)).collect();
    let mut mended = experiment.clone();
    let (mut suspects, mut wholly) = (Vec::new(), Vec::new());
    for (run, exchanges) in mended.runs.iter_mut().zip(&found) {
        suspects.extend(exchanges.iter().map(|exchange| exchange.suspect(run)));
        wholly
            .extend(exchanges.iter().filter(|exchange| exchange.is_whole(run)).map(|exchange| exchange.pair));
        for Exchange { pair: [a, b], instants } in exchanges {
            let width = run.trajectory.keypoints.len();
            for instant in instants {
                run.trajectory.position_m.swap(instant * width + a, instant * width + b);
            }
        }
    }
    // what is so in all runs alike is one mistake
    let all = experiment.runs.len();
    if let Some(&[a, b]) = wholly.first().filter(|first| all > 1 && wholly == vec![**first; all])
        && suspects.len() == all
    {
        let [a, b] = [a, b].map(|keypoint| &experiment.runs[0].trajectory.keypoints[keypoint]);
        suspects = vec![Suspect {
            sentence: format!("the labels `{a}` and `{b}` are exchanged in all runs"),
            runs: experiment.runs.iter().map(|run| run.id.clone()).collect(),
            ..suspects.swap_remove(0)
        }];
    }
    let mended = (!suspects.is_empty()).then_some(mended);
    (suspects, mended)
}

fn of_run(model: &Model, run: &Run, limit_m: f64) -> Vec<Exchange> {
    let noise_m = run_noise(run).std_m;
    let limit_m = limit_m.max(MISFIT_NOISE_RATIO_MIN * noise_m);
    let mut guess = model.rest_state().qpos;
    let mut odd = Vec::new();
    for instant in 0..run.trajectory.time_s.len() {
        let Some((pose, off_m)) = nearest_pose(model, run, (instant, noise_m), None, &guess) else {
            continue;
        };
        match off_m > limit_m {
            true => odd.push((instant, off_m)),
            false => guess = pose,
        }
    }
    if odd.len() < IMAGES_MIN {
        return Vec::new();
    }
    let width = run.trajectory.keypoints.len();
    let pairs: Vec<[usize; 2]> = (0..width).flat_map(|a| (0..a).map(move |b| [b, a])).collect();
    let mut exchanges: Vec<Exchange> = Vec::new();
    for (instant, off_m) in odd {
        let mended_m = |pair: [usize; 2]| {
            let found = nearest_pose(model, run, (instant, noise_m), Some(pair), &guess);
            found.map_or(f64::INFINITY, |(_, off_m)| off_m)
        };
        let best = pairs.iter().map(|&pair| (mended_m(pair), pair)).min_by(|a, b| a.0.total_cmp(&b.0));
        let Some((_, pair)) = best.filter(|(mended_m, _)| MISFIT_RATIO_MIN * mended_m < off_m) else {
            continue;
        };
        match exchanges.iter_mut().find(|known| known.pair == pair) {
            Some(known) => known.instants.push(instant),
            None => exchanges.push(Exchange { pair, instants: vec![instant] }),
        }
    }
    exchanges.retain(|exchange| exchange.instants.len() >= IMAGES_MIN);
    exchanges
}

impl Exchange {
    fn is_whole(&self, run: &Run) -> bool {
        self.instants.len() as f64 >= WHOLE_RUN_SHARE * run.trajectory.time_s.len() as f64
    }

    fn suspect(&self, run: &Run) -> Suspect {
        let [a, b] = self.pair.map(|keypoint| &run.trajectory.keypoints[keypoint]);
        let (times, count) = (&run.trajectory.time_s, self.instants.len());
        let whereabouts = match (self.instants.first(), self.instants.last()) {
            (Some(&first), Some(&last)) if !self.is_whole(run) => {
                format!(", in {count} images from {:.3} to {:.3} s", times[first], times[last])
            }
            _ => String::new(),
        };
        Suspect {
            name: "labels".into(),
            sentence: format!("in {}, the labels `{a}` and `{b}` are exchanged{whereabouts}", run.id),
            check: format!("change the columns of `{a}` and `{b}` over there"),
            runs: vec![run.id.clone()],
            // no pose is like what these images show, and one is when they are changed over
            probability: super::STATED_PROBABILITY_MAX,
        }
    }
}
