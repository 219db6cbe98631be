//! Draws of a bootstrap: an experiment as it might have come out.
//!
//! # Sources
//! B. Efron, R. J. Tibshirani, "An Introduction to the Bootstrap" (1993): whole runs, with replacement. H. R. Künsch, Annals of Statistics 17
//! (1989) 1217, and A. C. Davison, D. V. Hinkley, "Bootstrap Methods and their Application" (1997), 8.2: blocks of a fit's residuals, each of
//! which begins anywhere, put after one another onto what the fit says.

use anyhow::anyhow;
use app::Failure;
use ident::experiment::{Experiment, Method, Use};
use ident::fit::{Fitted, FittedRun};
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

use crate::task::Resample;

/// The random numbers of a draw: its own stream of those of all draws.
fn random(resample: &Resample) -> ChaCha8Rng {
    let mut random = ChaCha8Rng::seed_from_u64(resample.seed);
    random.set_stream(u64::from(resample.number));
    random
}

/// Draws as many fitted runs as there are: one that is drawn twice counts twice, one that is not drawn is left out.
///
/// # Errors
/// [`Failure::Input`] where there is only one.
pub(crate) fn draw_runs(experiment: &mut Experiment, resample: &Resample) -> Result<(), Failure> {
    let fitted: Vec<usize> =
        (0..experiment.runs.len()).filter(|&index| experiment.runs[index].usage == Use::Fit).collect();
    if fitted.len() < 2 {
        return Err(Failure::Input(anyhow!(
            "resample by \"run\" draws among fitted runs, and this experiment has {}: name an experiment's file with several runs, as \
             `rig experiment` makes one of run folders, or resample by \"block\"",
            fitted.len()
        )));
    }
    let mut random = random(resample);
    let mut times = vec![0_u32; experiment.runs.len()];
    for _ in &fitted {
        times[fitted[random.random_range(0..fitted.len())]] += 1;
    }
    for (run, times) in experiment.runs.iter_mut().zip(&times) {
        run.weight *= f64::from((*times).max(1));
    }
    let mut index = 0;
    experiment.runs.retain(|run| {
        index += 1;
        run.usage == Use::Holdout || times[index - 1] > 0
    });
    Ok(())
}

/// What `fitted`, a fit of `experiment`, says of its runs, with its residuals drawn again in blocks: to be fitted from where that fit ended.
///
/// # Errors
/// [`Failure::Internal`] where the fit has other keypoints than the experiment.
pub(crate) fn draw_blocks(
    mut experiment: Experiment,
    fitted: &Fitted,
    resample: &Resample,
) -> Result<Experiment, Failure> {
    let mut random = random(resample);
    for run in experiment.runs.iter_mut().filter(|run| run.usage == Use::Fit) {
        let of_run = fitted.runs.iter().find(|fitted| fitted.id == run.id);
        let same = |fitted: &&FittedRun| {
            let (here, there) = (&run.trajectory, &fitted.simulated);
            here.keypoints == there.keypoints && here.time_s == there.time_s
        };
        let Some(of_run) = of_run.filter(same) else {
            return Err(Failure::Internal(anyhow!(
                "the fit's run {} is another than the experiment's",
                run.id
            )));
        };
        put_blocks(&mut run.trajectory, of_run, resample.block_s, &mut random);
    }
    experiment.model = fitted.model.clone();
    experiment.fit.method = Method::LeastSquares;
    Ok(experiment)
}

fn put_blocks(trajectory: &mut sim::Trajectory, fitted: &FittedRun, block_s: f64, random: &mut ChaCha8Rng) {
    let width = trajectory.keypoints.len();
    let Some(first) = trajectory.time_s.iter().position(|&time_s| time_s >= fitted.scored_from_s) else {
        return;
    };
    let count = trajectory.time_s.len() - first;
    let last_s = trajectory.time_s.last().copied().unwrap_or_default();
    let interval_s = (last_s - trajectory.time_s[first]) / (count.max(2) - 1) as f64;
    let length = ((block_s / interval_s).round().max(1.0) as usize).min(count);
    let simulated = |place: usize| fitted.simulated.position_m[place];
    let residuals: Vec<[f64; 3]> = (first * width..(first + count) * width)
        .map(|place| {
            let (measured, said) = (trajectory.position_m[place], simulated(place));
            [0, 1, 2].map(|axis| measured[axis] - said[axis])
        })
        .collect();
    let means = means(&residuals, width);
    let mut image = 0;
    while image < count {
        let from = random.random_range(0..=count - length);
        for offset in 0..length.min(count - image) {
            for keypoint in 0..width {
                let place = (first + image + offset) * width + keypoint;
                let residual = residuals[(from + offset) * width + keypoint];
                for axis in 0..3 {
                    let position_m = &mut trajectory.position_m[place][axis];
                    // a gap stays one; where a gap was drawn, what was seen there stays
                    if position_m.is_finite() && residual[axis].is_finite() {
                        *position_m = simulated(place)[axis] + residual[axis] - means[keypoint][axis];
                    }
                }
            }
        }
        image += length;
    }
}

/// The mean residual of each keypoint: draws are about what the fit says, not beside it.
fn means(residuals: &[[f64; 3]], width: usize) -> Vec<[f64; 3]> {
    let of = |keypoint: usize| {
        [0, 1, 2].map(|axis| {
            let seen = residuals.iter().skip(keypoint).step_by(width).map(|residual| residual[axis]);
            let (count, sum) = seen
                .filter(|residual| residual.is_finite())
                .fold((0_u32, 0.0), |(count, sum), residual| (count + 1, sum + residual));
            sum / f64::from(count.max(1))
        })
    };
    (0..width).map(of).collect()
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::task::By;
    use ident::experiment::{FitConfig, Run, RunKind};

    pub(crate) fn draw(number: u32) -> Resample {
        Resample { by: By::Run, number, seed: 1, block_s: 0.03 }
    }

    fn trajectory(offset_m: f64) -> sim::Trajectory {
        let at = |instant: i32| [f64::from(instant) * 1e-3 + offset_m, f64::NAN, 0.0];
        sim::Trajectory {
            time_s: (0..40).map(|instant| f64::from(instant) * 0.01).collect(),
            keypoints: vec!["P1".into()],
            position_m: (0..40).map(at).collect(),
            std_m: None,
            pose_std_m: None,
        }
    }

    fn model() -> sim::Model {
        sim::Model::from_mjcf(include_str!("../../../configs/models/chain-passive.xml")).unwrap()
    }

    #[test]
    fn runs_are_drawn_with_replacement_and_the_same_draw_is_the_same() {
        let runs = (0..6).map(|number| Run::new(format!("run-{number}"), RunKind::Free, trajectory(0.0)));
        let whole = Experiment::new(model(), FitConfig::default(), runs.collect());
        let drawn = |number: u32| {
            let mut experiment = whole.clone();
            draw_runs(&mut experiment, &draw(number)).unwrap();
            experiment.runs.iter().map(|run| (run.id.clone(), run.weight)).collect::<Vec<_>>()
        };
        assert_eq!(drawn(1), drawn(1));
        assert!((1..9).any(|number| drawn(number) != drawn(number + 1)));
        for number in 1..20 {
            assert_eq!(drawn(number).iter().map(|(_, weight)| weight).sum::<f64>(), 6.0);
        }
        let mut alone = Experiment::new(model(), FitConfig::default(), whole.runs[..1].to_vec());
        let refused = draw_runs(&mut alone, &draw(1)).unwrap_err();
        assert!(refused.error().to_string().contains("resample by \"block\""));
    }

    #[test]
    fn blocks_are_the_fit_s_residuals_in_pieces_about_what_it_says() {
        let (said, mut measured) = (trajectory(0.0), trajectory(0.0));
        let residual = |instant: usize| (instant as f64 * 0.7).sin() * 1e-4;
        measured.position_m.iter_mut().enumerate().for_each(|(instant, at)| at[0] += residual(instant));
        measured.position_m[20][2] = f64::NAN;
        let fitted = FittedRun {
            id: "run".into(),
            usage: Use::Fit,
            initial: model().rest_state(),
            start_s: 0.0,
            scored_from_s: 0.1,
            simulated: said.clone(),
            qpos: Vec::new(),
            base: None,
            measured: measured.clone(),
            touch: None,
        };
        let mut drawn = measured.clone();
        put_blocks(&mut drawn, &fitted, 0.03, &mut random(&draw(1)));
        let mean = (10..40).map(residual).sum::<f64>() / 30.0;
        let residuals: Vec<f64> = (10..40)
            .map(|instant| drawn.position_m[instant][0] - said.position_m[instant][0] + mean)
            .collect();
        for block in residuals.chunks(3) {
            let known =
                |from: usize| (0..3).all(|offset| (block[offset] - residual(from + offset)).abs() < 1e-12);
            assert!((10..=37).any(known), "{block:?} is no piece of the residuals");
        }
        assert_eq!(
            drawn.position_m[..10].iter().map(|at| at[0]).collect::<Vec<_>>(),
            measured.position_m[..10].iter().map(|at| at[0]).collect::<Vec<_>>()
        );
        assert!(drawn.position_m[20][2].is_nan() && drawn.position_m[5][1].is_nan(), "gaps stay");
    }
}
