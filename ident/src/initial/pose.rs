//! Joint coordinates that put the keypoints where an image shows them.

use std::f64::consts::TAU;

use ground::levenberg_marquardt::{LevenbergMarquardt, NormalEquations, Scaling};
use nalgebra::DVector;
use sim::model::{Joint, POINTER_M};
use sim::{JointKind, Model};

use crate::geometry::moved;

/// A quantity that the trajectory observes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Mark {
    /// One of the model's sites.
    Site(usize),
    /// The coordinate at this place, by an encoder's pointer.
    Angle(usize),
}

/// One observed coordinate of a mark.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Target {
    /// What was observed.
    pub(super) mark: Mark,
    /// 0, 1, 2 for x, y, z.
    pub(super) axis: usize,
    /// Mean of its observed values \[m\].
    pub(super) mean_m: f64,
}

/// Angles tried per hinge before the descent, evenly over the circle (chosen).
const HINGE_ANGLES_TRIED: usize = 24;
/// A pose beyond this many standard deviations of the noise, root mean square, is sought from another start (chosen).
const GOOD_POSE_RMS_Z: f64 = 3.0;
/// Step of the finite differences \[rad\] or \[m\] (chosen).
const DIFFERENCE_STEP: f64 = 1e-6;
/// Settings of a descent (chosen), which keep directions that change no target where they are.
const DESCENT: LevenbergMarquardt =
    LevenbergMarquardt { iterations_max: 60, relative_tolerance: 1e-8, scaling: Scaling::Levenberg };

/// The coordinates, shape (nq), nearest to `targets`: by descent from `guess`, and where that ends far off, from
/// a search hinge by hinge; of the angles that look the same, whole turns apart, those next to the reference. `frozen`, shape
/// (nv), marks what must stay. Directions that change no target stay at the guess.
pub(super) fn pose(
    model: &Model,
    targets: &[Target],
    guess: &[f64],
    frozen: &[bool],
    noise_m: f64,
) -> Vec<f64> {
    let near = descend(model, targets, guess, frozen);
    let limit = (GOOD_POSE_RMS_Z * noise_m).powi(2) * targets.len() as f64;
    let mut best = near;
    if cost(model, targets, &best) > limit {
        let far = descend(model, targets, &sweep(model, targets, guess, frozen), frozen);
        if cost(model, targets, &far) < cost(model, targets, &best) {
            best = far;
        }
    }
    let stays = |joint: &Joint<f64>| {
        let read = targets.iter().any(|target| target.mark == Mark::Angle(joint.qpos_address));
        read || frozen[joint.dof_address]
    };
    unwind(model, &mut best, stays);
    best
}

/// Takes whole turns out of hinges, but of those that stay: a descent over a folded chain winds some up, and a spring or a stop would
/// feel them. An encoder counts turns.
fn unwind(model: &Model, qpos: &mut [f64], stays: impl Fn(&Joint<f64>) -> bool) {
    let hinges = model.joints.iter().filter(|joint| joint.kind == JointKind::Hinge);
    for joint in hinges.filter(|joint| !stays(joint)) {
        let middle = joint.limit.map_or(joint.reference, |[lower, upper]| 0.5 * (lower + upper));
        let angle = &mut qpos[joint.qpos_address];
        *angle -= TAU * ((*angle - middle) / TAU).round();
    }
}

fn residuals(model: &Model, targets: &[Target], qpos: &[f64]) -> DVector<f64> {
    let poses = model.poses(qpos);
    let off = |target: &Target| match target.mark {
        Mark::Site(site) => target.mean_m - poses.site_pos[site].0[target.axis],
        Mark::Angle(angle) => target.mean_m - POINTER_M * qpos[angle],
    };
    DVector::from_iterator(targets.len(), targets.iter().map(off))
}

fn cost(model: &Model, targets: &[Target], qpos: &[f64]) -> f64 {
    residuals(model, targets, qpos).norm_squared()
}

/// How far a coordinate is off `targets`, root mean square \[m\].
pub(super) fn off_m(model: &Model, targets: &[Target], qpos: &[f64]) -> f64 {
    (cost(model, targets, qpos) / targets.len() as f64).sqrt()
}

/// Turns one hinge after the other, base to tip, to the best of some angles.
fn sweep(model: &Model, targets: &[Target], guess: &[f64], frozen: &[bool]) -> Vec<f64> {
    let mut qpos = guess.to_vec();
    for joint in &model.joints {
        if joint.kind != JointKind::Hinge || frozen[joint.dof_address] {
            continue;
        }
        let tried = (0..HINGE_ANGLES_TRIED).map(|k| {
            let mut trial = qpos.clone();
            trial[joint.qpos_address] = joint.reference + TAU * k as f64 / HINGE_ANGLES_TRIED as f64;
            (cost(model, targets, &trial), trial)
        });
        if let Some((_, best)) = tried.min_by(|a, b| a.0.total_cmp(&b.0)) {
            qpos = best;
        }
    }
    qpos
}

/// The descent of a fit is another one: it has bounds, priors and dampings tried side by side.
fn descend(model: &Model, targets: &[Target], guess: &[f64], frozen: &[bool]) -> Vec<f64> {
    let stepped = |qpos: &Vec<f64>, step: &DVector<f64>| {
        let free = step.iter().zip(frozen).map(|(by, frozen)| if *frozen { 0.0 } else { *by });
        moved(model, qpos, &free.collect::<Vec<f64>>())
    };
    let off = |qpos: &Vec<f64>| residuals(model, targets, qpos);
    let differences = vec![DIFFERENCE_STEP; model.nv()];
    let linearise = |qpos: &Vec<f64>, here: &DVector<f64>| {
        NormalEquations::by_differences(here, &differences, |step| off(&stepped(qpos, step)))
    };
    DESCENT.minimise(guess.to_vec(), off, linearise, stepped).point
}
