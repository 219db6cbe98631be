//! A run that does not belong to the others: of another mechanism, whose poses the model does not have; or one that is like the
//! others up to an image from which on the camera has moved, or images are missing.
//!
//! That a run is merely farther off than the others is no sign: so is the one in which a hidden force does most.

use nalgebra::{Matrix3, Vector3};

use super::trial::{self, Trial};
use super::{Suspect, pose_misfit};
use crate::experiment::{Experiment, Run, Use};
use crate::fit::FittedRun;
use crate::fit::counts::Counts;
use crate::initial::run_noise;
use crate::noise::floor::interval_s;

/// The poses of another mechanism are off by this many times the noise or more, those of the others by less than this (chosen).
const OTHER_MECHANISM_MIN: f64 = 6.0;
const SAME_MECHANISM_MAX: f64 = 2.5;
/// Of so many runs, those farthest off, it is asked whether the others are repeated without them (chosen): a run that does not belong spoils the
/// fit of all others a little, and itself most.
const ASKED_RUNS: usize = 2;
/// The others are repeated where none is off by more than this many times its noise (chosen).
const OTHERS_OVER_NOISE_MAX: f64 = 2.0;
/// Fewest runs of which one can be told from the others (chosen): two would only differ.
const RUNS_MIN: usize = 3;
/// Fewest images on either side of what happened (chosen).
const IMAGES_MIN: usize = 20;
/// What happened is named where it leaves at most this share of the squares beyond noise, from this many noise variances on (chosen).
const LEFT_SHARE_MAX: f64 = 0.2;
const SQUARES_MIN: f64 = 150.0;
/// Missing images are whole ones to this share of an interval (chosen).
const WHOLE_IMAGES_TOLERANCE: f64 = 0.25;

/// The run that does not belong, if there is one, and the experiment without it; `trial` is what all runs together come to.
pub(super) fn stranger(
    experiment: &Experiment,
    trial: Option<&Trial>,
    counts: &mut Counts,
) -> Option<(Suspect, Experiment)> {
    if experiment.runs.len() < RUNS_MIN {
        return None;
    }
    let (place, how) = other_mechanism(experiment).or_else(|| from_an_image_on(experiment, trial, counts))?;
    let mut others = experiment.clone();
    let left_out = others.runs.remove(place);
    if others.runs.iter().all(|run| run.usage == Use::Holdout) {
        others.runs[0].usage = Use::Fit;
    }
    let id = &left_out.id;
    let suspect = Suspect {
        name: "run".into(),
        sentence: format!("{id} does not belong to the others: {how}"),
        check: format!("look at {id} first, then leave it out or record it anew"),
        runs: vec![id.clone()],
        probability: super::STATED_PROBABILITY_MAX,
    };
    Some((suspect, others))
}

/// The one run whose images are like no pose of the model.
fn other_mechanism(experiment: &Experiment) -> Option<(usize, String)> {
    let alone = |run: &Run| pose_misfit(&experiment.model, std::slice::from_ref(run));
    let misfits: Vec<f64> = experiment.runs.iter().map(alone).collect();
    let off: Vec<usize> = (0..misfits.len()).filter(|&run| misfits[run] > SAME_MECHANISM_MAX).collect();
    let [place] = off[..] else { return None };
    let how = format!(
        "no pose of the model is like its images, which are off by {:.0} times the noise: another mechanism, or other links?",
        misfits[place]
    );
    (misfits[place] > OTHER_MECHANISM_MIN).then_some((place, how))
}

/// The one run that the fit of all others repeats up to an image, and what then happened to it.
fn from_an_image_on(
    experiment: &Experiment,
    trial: Option<&Trial>,
    counts: &mut Counts,
) -> Option<(usize, String)> {
    let mut asked: Vec<usize> = (0..experiment.runs.len()).collect();
    if let Some(trial) = trial {
        let error = |run: usize| trial.errors[run].over_noise;
        asked.sort_by(|&a, &b| error(b).total_cmp(&error(a)));
        asked.truncate(ASKED_RUNS);
    }
    let found = counts.of_each(asked, |place, counts| {
        let mut others = experiment.clone();
        for (other, run) in others.runs.iter_mut().enumerate() {
            run.usage = if other == place { Use::Holdout } else { Use::Fit };
        }
        let Trial { errors, runs, .. } = trial::fitted(&others, counts)?;
        let is_repeated = |(other, error): (usize, &trial::RunError)| {
            other == place || error.over_noise < OTHERS_OVER_NOISE_MAX
        };
        let all = errors.iter().enumerate().all(is_repeated);
        let change = Change::of(&runs[place], run_noise(&experiment.runs[place]).std_m)?;
        all.then(|| (place, change.gain, change.sentence(&runs[place])))
    });
    let best = found.into_iter().flatten().max_by(|a, b| a.1.total_cmp(&b.1));
    best.map(|(place, _, sentence)| (place, sentence))
}

/// What is different in a run from an image on.
struct Change {
    first: usize,
    what: What,
    /// Noise variances that it accounts for.
    gain: f64,
}

enum What {
    /// The camera has moved by so much along both axes of the picture \[m\], and turned by so much about the origin \[rad\].
    Moved([f64; 3]),
    /// So many images are missing.
    Missing(f64),
}

/// One coordinate of a keypoint in an image.
struct Cell {
    /// Measured - simulated \[m\].
    off_m: f64,
    /// What it would change by along both axes, and by a turn: shape (3).
    moved: Vector3<f64>,
    /// Its velocity \[m/s\].
    velocity_m_s: f64,
}

impl Change {
    /// The change that accounts for what the simulation leaves of `run` beside noise of `noise_m` \[m\], if one does.
    fn of(run: &FittedRun, noise_m: f64) -> Option<Self> {
        let images: Vec<Vec<Cell>> =
            (0..run.measured.time_s.len()).map(|instant| cells(run, instant)).collect();
        let all: Vec<f64> =
            images.iter().map(|cells| cells.iter().map(|cell| cell.off_m.powi(2)).sum()).collect();
        let count: usize = images.iter().map(Vec::len).sum();
        // before the motion nothing shows that the run is like the others
        let moving = images.iter().position(|cells| !cells.is_empty())?;
        let total: f64 = all.iter().sum();
        let interval_s = interval_s(&run.measured.time_s);
        let mut best: Option<(f64, usize, What)> = None;
        // sums over the images from the end on
        let (mut squares, mut gram, mut products) = (0.0, Matrix3::zeros(), Vector3::zeros());
        let (mut speeds, mut lag) = (0.0, 0.0);
        // what a camera that stands elsewhere from the beginning leaves
        let mut left_throughout = f64::INFINITY;
        for first in (moving..images.len()).rev() {
            for cell in &images[first] {
                squares += cell.off_m.powi(2);
                gram += cell.moved * cell.moved.transpose();
                products += cell.moved * cell.off_m;
                speeds += cell.velocity_m_s.powi(2);
                lag += cell.velocity_m_s * cell.off_m;
            }
            if first + IMAGES_MIN > images.len() {
                continue;
            }
            let before = total - squares;
            let moved = gram.cholesky().map(|gram| gram.solve(&products));
            if first < moving + IMAGES_MIN {
                left_throughout = squares - moved.map_or(0.0, |moved| products.dot(&moved));
                continue;
            }
            if let Some(moved) = moved {
                let left = before + squares - products.dot(&moved);
                if best.as_ref().is_none_or(|best| left < best.0) {
                    best = Some((left, first, What::Moved([moved[0], moved[1], moved[2]])));
                }
            }
            let (late_s, missing) = (lag / speeds, (lag / speeds / interval_s).round());
            let is_whole = (late_s / interval_s - missing).abs() < WHOLE_IMAGES_TOLERANCE;
            let left = before + squares - lag * late_s;
            if missing >= 1.0 && is_whole && best.as_ref().is_none_or(|best| left < best.0) {
                best = Some((left, first, What::Missing(missing)));
            }
        }
        let (left, first, what) = best?;
        let variance = noise_m.powi(2);
        let beyond = |squares: f64| (squares / variance - count as f64).max(0.0);
        let gain = (total - left) / variance;
        let most = LEFT_SHARE_MAX * beyond(total);
        let has_happened = beyond(left) < most && beyond(left_throughout) > most;
        (gain > SQUARES_MIN && has_happened).then_some(Self { first, what, gain })
    }

    fn sentence(&self, run: &FittedRun) -> String {
        let from_s = run.measured.time_s[self.first];
        match self.what {
            What::Moved([x_m, z_m, turn_rad]) => format!(
                "from {from_s:.3} s on all keypoints are off by {:.1} mm and turned by {:.2} degrees: was the camera knocked?",
                1e3 * x_m.hypot(z_m),
                turn_rad.abs().to_degrees()
            ),
            What::Missing(images) => format!(
                "from {from_s:.3} s on its images show what is {images:.0} image intervals later: so many images are missing there"
            ),
        }
    }
}

/// What image `instant` of `run` shows beside the simulation, along the two axes that the picture has.
fn cells(run: &FittedRun, instant: usize) -> Vec<Cell> {
    let times = &run.measured.time_s;
    let neighbours = [instant.saturating_sub(1), (instant + 1).min(times.len() - 1)];
    let mut cells = Vec::new();
    if times[instant] < run.start_s {
        return cells;
    }
    for keypoint in 0..run.measured.keypoints.len() {
        let (there, here) = (run.measured.at(instant, keypoint), run.simulated.at(instant, keypoint));
        let seen: Vec<usize> = (0..3).filter(|&axis| there[axis].is_finite()).collect();
        let [across, up] = seen[..] else { continue };
        let [from, to] = neighbours.map(|instant| run.simulated.at(instant, keypoint));
        let passed_s = times[neighbours[1]] - times[neighbours[0]];
        let turns = [(across, Vector3::new(1.0, 0.0, -here[up])), (up, Vector3::new(0.0, 1.0, here[across]))];
        cells.extend(turns.map(|(axis, moved)| Cell {
            off_m: there[axis] - here[axis],
            moved,
            velocity_m_s: (to[axis] - from[axis]) / passed_s,
        }));
    }
    cells
}
