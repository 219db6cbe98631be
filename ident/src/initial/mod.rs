//! How a run starts: when the motion begins, and where the mechanism is then.
//!
//! What is found here are start values, from the images alone and without any dynamics. A fit moves them
//! together with its parameters, as nuisances of their run.

mod noise;
mod pose;
mod release;

use sim::model::{ActuatorKind, Coordinates, encoded_joint};
use sim::{Model, State};

pub use noise::{RunNoise, run_noise};
pub use release::{Release, release};

use crate::experiment::{
    DRIFT_LEAD_S, Experiment, Run, RunKind, Use, in_the_mean, not_estimated, resting, unknown_rates,
};
use crate::parameters::{ParameterError, Parameters};
use pose::{Mark, Target, off_m, pose};

/// State at the start of the motion.
#[derive(Debug, Clone, PartialEq)]
pub struct Start {
    /// State, held until the motion starts.
    pub state: State,
    /// When the motion starts \[s\].
    pub start_s: f64,
}

/// Start values of a run, and how sure they are.
#[derive(Debug, Clone, PartialEq)]
pub struct Estimate {
    /// Estimated state and time at the start of the motion.
    pub start: Start,
    /// For a drop whose release nobody stated: the images between which it lies.
    pub release: Option<Release>,
}

/// No start can be found.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("run `{run}`: {reason}")]
pub struct StartError {
    /// Id of the run.
    pub run: String,
    /// What is missing, and what to do.
    pub reason: String,
}

/// Time step of the difference that gives a command's rate \[s\] (chosen): rows are further apart.
const COMMAND_RATE_STEP_S: f64 = 1e-5;
/// Fewest images for the regression of the initial rates, where [`Run::init_s`] covers fewer (chosen).
const RATE_IMAGES_MIN: usize = 5;

/// Estimates the start of `run` from its images; `noise_m` is their standard deviation per coordinate.
///
/// # Errors
/// [`StartError`] where a drop never moves, or no image shows the start.
pub fn estimate(model: &Model, run: &Run, noise_m: f64) -> Result<Estimate, StartError> {
    let refuse = |reason: &str| StartError { run: run.id.clone(), reason: reason.to_owned() };
    let observed = observed_instants(run);
    let first = *observed.first().ok_or_else(|| refuse("no image shows a keypoint; check the extraction"))?;
    let first_s = run.trajectory.time_s[first];
    let found = match (run.kind, run.release_s) {
        (RunKind::Drop, None) => Some(release(&run.trajectory, noise_m).ok_or_else(|| {
            refuse("nothing ever moves in this drop; state `release_s`, or leave the run out")
        })?),
        _ => None,
    };
    let start_s = match run.kind {
        RunKind::Drop => found.map_or(run.release_s.unwrap_or(first_s), |found| found.start_s),
        RunKind::Driven if run.adrift => first_s - DRIFT_LEAD_S,
        RunKind::Driven => {
            let motion = run.first_motion_s();
            motion.ok_or_else(|| {
                refuse("nothing ever moves the mechanism in this driven run; check its servo table")
            })?
        }
        RunKind::Free => first_s,
    };
    let state = match &run.initial {
        Some(state) => state.clone(),
        None if run.kind == RunKind::Free || run.adrift => moving_state(model, run, &observed, noise_m),
        None => {
            // Without a still image the first one has to do; the fit then finds the pose from the motion.
            let mut still: Vec<usize> = observed
                .iter()
                .copied()
                .filter(|&instant| run.trajectory.time_s[instant] <= start_s)
                .collect();
            if still.is_empty() {
                still.push(first);
            }
            let mut rest = model.rest_state();
            prescribe(model, run, start_s, &mut rest.qpos);
            let frozen = prescribed_dofs(model, run);
            let qpos = pose(model, &targets(model, run, &still), &rest.qpos, &frozen, noise_m);
            State { qpos, qvel: rest.qvel }
        }
    };
    Ok(Estimate { start: Start { state, start_s }, release: found })
}

/// Rows of the trajectory in which any keypoint is observed.
fn observed_instants(run: &Run) -> Vec<usize> {
    let shows = |instant: &usize| {
        (0..run.trajectory.keypoints.len())
            .any(|k| run.trajectory.at(*instant, k).iter().any(|x| x.is_finite()))
    };
    (0..run.trajectory.time_s.len()).filter(shows).collect()
}

/// Whether each velocity belongs to a joint that follows the command exactly in this run, shape (nv).
pub(crate) fn prescribed_dofs(model: &Model, run: &Run) -> Vec<bool> {
    let mut frozen = vec![false; model.nv()];
    if run.follows() {
        for (_, actuator) in followed(model, run) {
            frozen[model.joints[actuator.joint].dof_address] = true;
        }
    }
    frozen
}

/// What a fit of `experiment` frees of `model`: the kind `damping` means those joints of a drive as well that turn freely in a fitted run, as
/// where a servo is off in drops.
///
/// # Errors
/// [`ParameterError`].
pub(crate) fn free_parameters(model: &Model, experiment: &Experiment) -> Result<Parameters, ParameterError> {
    let fitted = experiment.runs.iter().filter(|run| run.usage == Use::Fit);
    let mut loose = vec![false; model.joints.len()];
    for run in fitted.filter(|run| run.prescribed) {
        let frozen = prescribed_dofs(model, run);
        for (loose, joint) in loose.iter_mut().zip(&model.joints) {
            *loose |= joint.kind.is_axle() && !frozen[joint.dof_address];
        }
    }
    Parameters::select_with(model, &experiment.fit, &loose)
}

/// The columns of the command with the actuators whose joints follow it exactly: only a position drive's command is a position.
fn followed<'a>(
    model: &'a Model,
    run: &'a Run,
) -> impl Iterator<Item = (usize, &'a sim::model::Actuator<f64>)> {
    let names = run.command.iter().flat_map(|command| command.actuators.iter().enumerate());
    names
        .filter_map(|(column, name)| Some((column, model.actuators.iter().find(|a| &a.name == name)?)))
        .filter(|(_, actuator)| actuator.kind == ActuatorKind::Position)
}

fn prescribe(model: &Model, run: &Run, time_s: f64, qpos: &mut [f64]) {
    if !run.follows() {
        return;
    }
    if let Some(command) = &run.command {
        // steps have no rate, their mean has
        let command = in_the_mean(command);
        for (column, actuator) in followed(model, run) {
            qpos[model.joints[actuator.joint].qpos_address] = command.at(column, time_s) / actuator.gear;
        }
    }
}

/// Mean position of each coordinate of each keypoint over `instants`, with the base at its origin.
fn targets(model: &Model, run: &Run, instants: &[usize]) -> Vec<Target> {
    targets_from(model, run, instants, |column| column)
}

/// The same of keypoints whose places stand in the columns that `from` says.
fn targets_from(model: &Model, run: &Run, instants: &[usize], from: impl Fn(usize) -> usize) -> Vec<Target> {
    let sites = model.keypoint_sites();
    let mark = |name: &String| match encoded_joint(name) {
        Some(joint) => {
            model.joints.iter().find(|known| known.name == joint).map(|known| Mark::Angle(known.qpos_address))
        }
        None => sites.iter().copied().find(|&site| &model.sites[site].name == name).map(Mark::Site),
    };
    let mut list = Vec::new();
    for (column, name) in run.trajectory.keypoints.iter().enumerate() {
        let Some(mark) = mark(name) else { continue };
        let place = |instant: usize| match (&run.base, mark) {
            // where only x or z was observed, both are lost to NaN
            (Some(base), Mark::Site(_)) => {
                base.at(run.trajectory.time_s[instant]).back(run.trajectory.at(instant, from(column)))
            }
            _ => run.trajectory.at(instant, from(column)),
        };
        for axis in 0..3 {
            let values = instants.iter().map(|&instant| place(instant)[axis]);
            let values: Vec<f64> = values.filter(|x| x.is_finite()).collect();
            if !values.is_empty() {
                let mean_m = values.iter().sum::<f64>() / values.len() as f64;
                list.push(Target { mark, axis, mean_m });
            }
        }
    }
    list
}

/// The coordinates, shape (nq), nearest to what the image `instant` of `run` shows, sought from `guess`, and how far its keypoints are
/// off there, root mean square by coordinate \[m\], `noise_m` \[m\] being noise; with the labels of two keypoints `exchanged`, if wanted. `None` where it shows nothing.
pub(crate) fn nearest_pose(
    model: &Model,
    run: &Run,
    (instant, noise_m): (usize, f64),
    exchanged: Option<[usize; 2]>,
    guess: &[f64],
) -> Option<(Vec<f64>, f64)> {
    let from = |column: usize| match exchanged {
        Some([a, b]) if column == a => b,
        Some([a, b]) if column == b => a,
        _ => column,
    };
    let targets = targets_from(model, run, &[instant], from);
    (!targets.is_empty()).then(|| {
        let qpos = pose(model, &targets, guess, &vec![false; model.nv()], noise_m);
        let off_m = off_m(model, &targets, &qpos);
        (qpos, off_m)
    })
}

/// Pose of each of the first images, and a parabola through each coordinate whose rate is unknown; the others rest at their mean.
fn moving_state(model: &Model, run: &Run, observed: &[usize], noise_m: f64) -> State {
    let times = &run.trajectory.time_s;
    let start_s = times[observed[0]];
    let within = observed.iter().take_while(|&&instant| times[instant] <= start_s + run.init_s).count();
    let used = &observed[..within.max(RATE_IMAGES_MIN).min(observed.len())];
    let frozen = prescribed_dofs(model, run);
    let unknown = unknown_rates(model, run, &frozen);
    let still: Vec<bool> = frozen.iter().zip(not_estimated(model, run)).map(|(a, b)| *a || b).collect();
    let mut guess = resting(model, run);
    let mut poses: Vec<Vec<f64>> = Vec::new();
    for &instant in used {
        prescribe(model, run, times[instant], &mut guess);
        guess = pose(model, &targets(model, run, &[instant]), &guess, &still, noise_m);
        poses.push(guess.clone());
    }
    // a drifting body is simulated from a while before the first image
    let lead_s = if run.adrift { DRIFT_LEAD_S } else { 0.0 };
    let mut state = State { qpos: poses[0].clone(), qvel: vec![0.0; model.nv()] };
    let since: Vec<f64> = used.iter().map(|&instant| times[instant] - start_s).collect();
    // The rates of rotations start at nothing: the fit finds them.
    let numbers = model.joints.iter().flat_map(sim::model::Joint::coordinates);
    for (coordinates, q, dof) in numbers.filter(|(coordinates, ..)| *coordinates != Coordinates::Rotation) {
        for k in 0..coordinates.nq() {
            let values: Vec<f64> = poses.iter().map(|pose| pose[q + k]).collect();
            if !unknown[dof + k] {
                state.qpos[q + k] = values.iter().sum::<f64>() / values.len() as f64;
            } else if let Some([value, rate]) = parabola(&since, &values) {
                state.qpos[q + k] = value - rate * lead_s;
                state.qvel[dof + k] = rate;
            }
        }
    }
    // what follows a command sets off at the command's own rate
    let mut ahead = state.qpos.clone();
    prescribe(model, run, start_s, &mut state.qpos);
    prescribe(model, run, start_s + COMMAND_RATE_STEP_S, &mut ahead);
    let numbers = model.joints.iter().flat_map(sim::model::Joint::coordinates);
    for (_, q, dof) in numbers.filter(|&(.., dof)| frozen[dof]) {
        state.qvel[dof] = (ahead[q] - state.qpos[q]) / COMMAND_RATE_STEP_S;
    }
    state
}

/// Value and slope at 0 of the least-squares parabola.
fn parabola(x: &[f64], y: &[f64]) -> Option<[f64; 2]> {
    // Powers of x / span keep the small system well conditioned.
    let span = x.last().copied().filter(|span| *span > 0.0)?;
    let rows = nalgebra::DMatrix::from_fn(x.len(), 3, |row, power| (x[row] / span).powi(power as i32));
    let values = nalgebra::DVector::from_column_slice(y);
    let solution = (rows.transpose() * &rows).cholesky()?.solve(&(rows.transpose() * values));
    Some([solution[0], solution[1] / span])
}

#[cfg(test)]
mod tests;
