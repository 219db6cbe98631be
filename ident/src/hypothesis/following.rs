//! How driven joints followed their commands, and where hidden numbers of a cause between command and drive begin to explain it.

use std::borrow::Cow;

use sim::causes::Following;
use sim::math::Vec3;
use sim::{JointKind, Model};

use super::candidates::Term as CauseTerm;
use super::state::State;
use crate::experiment::RunKind;
use crate::fit::problem::Term;

/// Keypoints nearer to the joint than this say nothing about its angle \[m\].
const LEAST_LEVER_M: f64 = 1e-3;

/// A number is off what is known of it beyond so many standard deviations.
const KNOWN_SIGMAS: f64 = 5.0;

impl State<'_> {
    /// Puts hidden numbers of `cause`, which was just added to `before`, where it begins to explain what is left there.
    pub(crate) fn begin(&mut self, cause: &CauseTerm, before: &State<'_>) {
        if cause.info().kind != sim::causes::Kind::Drive {
            return;
        }
        let model = before.calibrated();
        let runs = before.terms.iter().zip(&before.point.offsets);
        let followings: Vec<Following<'_>> =
            runs.flat_map(|(term, offsets)| followings(&model, term, offsets)).collect();
        let found = cause.cause.start(&followings);
        // what goes with another number than the known one says nothing
        let is_known = |(name, value): &(&str, f64)| {
            let own = |known: &str| known.split_once('/').is_some_and(|(_, known)| known == *name);
            let prior = cause.known.iter().find(|(known, _)| own(known));
            prior.is_none_or(|(_, prior)| (value - prior.mean.get()).abs() <= KNOWN_SIGMAS * prior.std.get())
        };
        if !found.iter().all(is_known) {
            return;
        }
        for (name, value) in found {
            let name = format!("{}/{name}", cause.cause.name());
            let place = self.parameters.free.iter().position(|parameter| parameter.name() == name);
            if let Some(place) = place {
                self.point.values[place] = self.parameters.free[place].scale.clamp(value);
            }
        }
    }
}

/// How each drive whose joint turns a body on the world about a fixed axle followed its command in the run of `term`, by the keypoints
/// on that body.
fn followings<'a>(model: &Model, term: &Term<'a>, offsets: &[f64]) -> Vec<Following<'a>> {
    let run = term.rehearsal.run;
    let Some(command) = run.command.as_ref().filter(|_| run.kind == RunKind::Driven) else {
        return Vec::new();
    };
    let Ok(simulated) = term.rehearsal.simulate(model, offsets, term.instants) else { return Vec::new() };
    let names = &run.trajectory.keypoints;
    let of_drive = |drive: &sim::model::Actuator<f64>| {
        let column = command.actuators.iter().position(|name| *name == drive.name)?;
        let joint = &model.joints[drive.joint];
        let body = &model.bodies[joint.body];
        if joint.kind != JointKind::Hinge || body.parent != 0 {
            return None;
        }
        let anchor = body.pos + body.quat.matrix().apply(joint.pos);
        let axis = body.quat.matrix().apply(joint.axis);
        let own: Vec<bool> = names
            .iter()
            .map(|name| model.sites.iter().any(|site| site.name == *name && site.body == joint.body))
            .collect();
        let mut following = Following { command: Cow::Borrowed(command), column, ..Following::default() };
        for same in term.observations.chunk_by(|a, b| a.instant == b.instant) {
            let (mut along, mut squares) = (0.0, 0.0);
            for observation in same.iter().filter(|observation| own[observation.keypoint]) {
                let at = simulated[observation.instant * names.len() + observation.keypoint];
                let turning = axis.cross(Vec3(at) - anchor).0[observation.axis];
                along += turning * (observation.measured_m - at[observation.axis]);
                squares += turning * turning;
            }
            if squares > LEAST_LEVER_M.powi(2) {
                following.time_s.push(run.trajectory.time_s[same[0].instant]);
                following.ahead_rad.push(along / squares);
            }
        }
        (!following.time_s.is_empty()).then_some(following)
    };
    model.actuators.iter().filter_map(of_drive).collect()
}
