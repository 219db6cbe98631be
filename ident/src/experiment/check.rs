//! Whether the runs can be compared with the model at all.

use sim::model::{ActuatorKind, encoded_joint};
use sim::{JointKind, Model};

use super::{Experiment, ExperimentError, Run, RunKind, scale};
use crate::parameters::Parameters;
use crate::table::PUSHES;
use ground::names::{did_you_mean, glob};

/// Fewest images of a run (chosen): fewer show a pose, but no motion.
const RUN_IMAGES_MIN: usize = 3;

impl Experiment {
    /// Says whether the runs can be compared with the model at all: names meet, starts are known, there is
    /// something to see.
    ///
    /// # Errors
    /// The first contradiction found, naming the run.
    pub fn check(&self) -> Result<(), ExperimentError> {
        if self.runs.is_empty() {
            return Err(ExperimentError::NoRuns);
        }
        self.check_causes()?;
        let marks = self.model.marks();
        let actuators: Vec<String> =
            self.model.actuators.iter().map(|actuator| actuator.name.clone()).collect();
        for (place, run) in self.runs.iter().enumerate() {
            let refuse = |reason: String| Err(ExperimentError::Run { run: run.id.clone(), reason });
            if self.runs[..place].iter().any(|other| other.id == run.id) {
                return refuse("another run has the same id; give each its own".into());
            }
            for keypoint in &run.trajectory.keypoints {
                if let Some(joint) = encoded_joint(keypoint).filter(|_| !marks.contains(keypoint)) {
                    let hinges: Vec<String> = self.model.hinges().map(str::to_owned).collect();
                    let hint = did_you_mean(joint, &hinges);
                    return refuse(format!(
                        "the trajectory has angles of `{joint}`, but the model has no hinge of that name{hint}; rename or remove the column `{keypoint}`"
                    ));
                }
                if !marks.contains(keypoint) {
                    let hint = did_you_mean(keypoint, &marks);
                    return refuse(format!(
                        "the trajectory shows `{keypoint}`, but the model has no site of that name{hint}; add the site or remove the columns"
                    ));
                }
            }
            for actuator in run.command.iter().flat_map(|command| &command.actuators) {
                if !actuators.contains(actuator) {
                    let hint = did_you_mean(actuator, &actuators);
                    return refuse(format!(
                        "the servo table commands `{actuator}`, but the model has no actuator of that name{hint}"
                    ));
                }
            }
            drives(&self.model, run)?;
            factors(&self.model, run)?;
            start(run)?;
            images(run)?;
            scale::check(&self.model, run)?;
            base(&self.model, run)?;
        }
        Ok(())
    }

    /// Says whether what `[fit]` and `[diagnose]` name is there, with any runs or none.
    ///
    /// # Errors
    /// The first name that is not.
    pub fn check_names(&self) -> Result<(), ExperimentError> {
        Parameters::select(&self.model, &self.fit)?;
        self.check_causes()
    }

    /// What `[diagnose]` speaks of must be causes.
    fn check_causes(&self) -> Result<(), ExperimentError> {
        let known: Vec<String> = self.model.known_causes().map(|cause| cause.name().to_owned()).collect();
        let named = self.diagnose.exclude.iter().map(|name| ("exclude", name));
        for (key, name) in named.chain(self.diagnose.odds.keys().map(|name| ("odds", name))) {
            if !known.contains(name) {
                let hint = did_you_mean(name, &known);
                return Err(ExperimentError::NoCause { key, name: name.clone(), hint });
            }
        }
        let elements = self.elements();
        for pattern in &self.diagnose.elements {
            if !elements.iter().any(|element| glob(pattern, element)) {
                let hint = did_you_mean(pattern, &elements);
                return Err(ExperimentError::NoElement { name: pattern.clone(), hint });
            }
        }
        for name in self.diagnose.prior.keys() {
            let mut model = self.model.clone();
            let is_there = name.split_once('/').is_some_and(|(cause, _)| {
                // one that is carried already is as good
                let _ = model.add_cause(cause);
                known.iter().any(|known| known == cause) && model.find_parameter(name).is_ok()
            });
            if !is_there {
                let hint = did_you_mean(name.split('/').next().unwrap_or(name), &known);
                return Err(ExperimentError::NoCause { key: "prior", name: name.clone(), hint });
            }
        }
        Ok(())
    }
}

impl Experiment {
    /// Names of all in which a cause may sit alone.
    fn elements(&self) -> Vec<String> {
        let Model { bodies, joints, geoms, .. } = &self.model;
        let bodies = bodies.iter().skip(1).map(|body| &body.name);
        let all =
            bodies.chain(joints.iter().map(|joint| &joint.name)).chain(geoms.iter().map(|geom| &geom.name));
        all.cloned().chain(self.model.marks()).collect()
    }
}

/// Angles command what holds an angle, pushes what pushes; and a joint that follows its command has one all the time.
fn drives(model: &Model, run: &Run) -> Result<(), ExperimentError> {
    let refuse = |reason: String| Err(ExperimentError::Run { run: run.id.clone(), reason });
    let Some(command) = &run.command else { return Ok(()) };
    for (name, unit) in command.actuators.iter().zip(&run.units) {
        let kind = model.actuators.iter().find(|known| known.name == *name).map(|known| known.kind);
        let wants_push = kind == Some(ActuatorKind::Motor);
        if PUSHES.contains(unit) && !wants_push {
            return refuse(format!(
                "the servo table pushes `{name}` in {unit}, but in the model it is a drive that holds an angle or a rate; make it a <motor>, or give its angles as `{name}_rad`"
            ));
        }
    }
    if run.follows() && command.angle_rad.iter().any(|angle| angle.is_nan()) {
        return refuse("the servo is idle at times (`_on` is 0), and `prescribed` joints follow it all the time; leave `prescribed` out".into());
    }
    Ok(())
}

/// What is another number of times in this run must be there.
fn factors(model: &Model, run: &Run) -> Result<(), ExperimentError> {
    for name in run.times.keys() {
        // causes that only a fit names are carried by then
        if let Err(unknown) = model.find_parameter(name) {
            return Err(ExperimentError::Run {
                run: run.id.clone(),
                reason: format!("`times` names `{name}`: {unknown}"),
            });
        }
    }
    Ok(())
}

/// The motion must have a known kind of start.
fn start(run: &Run) -> Result<(), ExperimentError> {
    let refuse = |reason: &str| Err(ExperimentError::Run { run: run.id.clone(), reason: reason.to_owned() });
    match (run.kind, &run.command) {
        (RunKind::Driven, None) if run.base.is_none() => {
            refuse("a driven run needs its `servo` table; add it, or call the run a \"drop\"")
        }
        (RunKind::Driven, _) if run.first_motion_s().is_none() => refuse(
            "nothing ever moves the mechanism in this driven run; check the `servo` table or `base`, or call the run a \"drop\"",
        ),
        (RunKind::Drop, _) if run.base.is_some() && run.release_s.is_none() => {
            refuse("with a `base` that moves, a release cannot be seen in the images; state `release_s`")
        }
        _ => Ok(()),
    }
}

/// A base that moves must have something to move, and be known for as long as there are images.
fn base(model: &Model, run: &Run) -> Result<(), ExperimentError> {
    let Some(base) = &run.base else { return Ok(()) };
    let refuse = |reason: String| Err(ExperimentError::Run { run: run.id.clone(), reason });
    if let Some(joint) = model.joints.iter().find(|joint| joint.kind == JointKind::Free) {
        return refuse(format!(
            "`base` moves what hangs from the world, and `{}` floats freely; remove `base`, or give the body other joints than a free one",
            model.bodies[joint.body].name
        ));
    }
    let (rows, images) = (base.time_s(), &run.trajectory.time_s);
    let (Some((first_s, last_s)), Some((from_s, to_s))) =
        (rows.first().zip(rows.last()), images.first().zip(images.last()))
    else {
        return Ok(());
    };
    if first_s > from_s || last_s < to_s {
        return refuse(format!(
            "`base` says where the base was from {first_s} to {last_s} s, and the images are from {from_s} to {to_s} s; add rows, or leave images out"
        ));
    }
    Ok(())
}

/// There must be something to see, in order.
fn images(run: &Run) -> Result<(), ExperimentError> {
    let time_s = &run.trajectory.time_s;
    if let Some(row) =
        (0..time_s.len()).find(|&row| !time_s[row].is_finite() || row > 0 && time_s[row] <= time_s[row - 1])
    {
        return Err(ExperimentError::Run {
            run: run.id.clone(),
            reason: format!(
                "image {} is at {} s, which is no time after the one before; sort the images, or leave it out",
                row + 1,
                time_s[row]
            ),
        });
    }
    let lack = |reason: String| Err(ExperimentError::Data { run: run.id.clone(), reason });
    let trajectory = &run.trajectory;
    let width = trajectory.keypoints.len();
    let count = trajectory.time_s.len();
    let shows_keypoint =
        |instant: usize| (0..width).any(|k| trajectory.at(instant, k).iter().any(|x| x.is_finite()));
    let usable = (0..count).filter(|&instant| shows_keypoint(instant)).count();
    if usable < RUN_IMAGES_MIN {
        return lack(format!(
            "{usable} of {count} images show a keypoint, {RUN_IMAGES_MIN} are the least; check the extraction, or leave the run out"
        ));
    }
    for (k, keypoint) in trajectory.keypoints.iter().enumerate() {
        if !(0..count).any(|instant| trajectory.at(instant, k).iter().any(|x| x.is_finite())) {
            return lack(format!("keypoint `{keypoint}` is never seen; remove its columns"));
        }
    }
    let (first_s, last_s) = (trajectory.time_s[0], trajectory.time_s[count - 1]);
    let start_s = match run.kind {
        RunKind::Drop => run.release_s,
        RunKind::Driven => run.first_motion_s(),
        RunKind::Free => None,
    };
    if let Some(start_s) = start_s.filter(|&start_s| start_s >= last_s) {
        return lack(format!(
            "the motion starts at {start_s} s, after the last image at {last_s} s; check the clocks of both tables"
        ));
    }
    if run.kind == RunKind::Free && last_s - first_s <= run.init_s {
        return lack(format!(
            "its {:.3} s are no longer than `init_s` = {} s, which only give the initial state; record longer",
            last_s - first_s,
            run.init_s
        ));
    }
    Ok(())
}
