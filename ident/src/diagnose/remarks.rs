//! What is said beside the verdict: what of the set-up may have misled it.

use sim::Cause;
use sim::model::{Actuator, ActuatorKind, JointKind};

use crate::experiment::{Experiment, RunKind, Use};
use crate::hypothesis::candidates::needs_side_view;
use crate::hypothesis::state::State;
use crate::initial::prescribed_dofs;
use crate::parameters::Parameters;

/// A joint let go further than this from where its actuator holds it [rad] was hardly held.
const LET_GO_RAD: f64 = 0.1;

/// What is said of causes that are no candidates because of where the camera was.
pub(super) fn seen_from_above(experiment: &Experiment) -> Option<String> {
    let left_out: Vec<String> = Cause::ALL
        .iter()
        .filter(|cause| needs_side_view(**cause, experiment))
        .map(|cause| format!("`{}`", cause.name()))
        .collect();
    (!left_out.is_empty()).then(|| {
        format!(
            "not tried, being known along x and z only and the runs filmed in x and y: {}",
            left_out.join(", ")
        )
    })
}

/// What is said of causes that are no candidates, being fitted, but not at every joint that turns freely in a fitted run: they
/// may be at work there.
pub(super) fn fitted_in_part(experiment: &Experiment, parameters: &Parameters) -> Option<String> {
    let model = &experiment.model;
    let runs = experiment.runs.iter().filter(|run| run.usage == Use::Fit);
    let frozen: Vec<Vec<bool>> = runs.map(|run| prescribed_dofs(model, run)).collect();
    let names: Vec<&String> = parameters.free.iter().flat_map(|parameter| &parameter.names).collect();
    let mut missing = Vec::new();
    for ending in ["/damping", "/frictionloss"] {
        if !names.iter().any(|name| name.ends_with(ending)) {
            continue;
        }
        for joint in model.joints.iter().filter(|joint| joint.kind.nv() == 1) {
            let name = format!("{}{ending}", joint.name);
            let turns = frozen.iter().any(|frozen| !frozen[joint.dof_address]);
            if turns && !names.contains(&&name) {
                missing.push(format!("`{name}`"));
            }
        }
    }
    (!missing.is_empty()).then(|| {
        let list = missing.join(", ");
        format!(
            "not fitted: {list}, although the fit has the same of other joints; add it to [fit] parameters"
        )
    })
}

/// What is said of drops whose servo was off, by the look of it: without a command a `position` actuator holds its joint at 0, as
/// MuJoCo's does.
pub(super) fn held_in_drops(baseline: &State<'_>) -> Option<String> {
    let model = &baseline.model;
    let holds = |actuator: &&Actuator<f64>| {
        actuator.kind == ActuatorKind::Position && model.joints[actuator.joint].kind == JointKind::Hinge
    };
    let mut list = Vec::new();
    for (term, offsets) in baseline.terms.iter().zip(&baseline.point.offsets) {
        let run = term.rehearsal.run;
        if run.kind != RunKind::Drop || run.prescribed || run.command.is_some() {
            continue;
        }
        let start = term.rehearsal.start_with(model, offsets);
        for actuator in model.actuators.iter().filter(holds) {
            let joint = &model.joints[actuator.joint];
            let angle_rad = start.state.qpos[joint.qpos_address];
            if angle_rad.abs() > LET_GO_RAD {
                list.push(format!("`{}` at {angle_rad:.2} rad in {}", joint.name, run.id));
            }
        }
    }
    (!list.is_empty()).then(|| {
        format!(
            "the model's servo pulls towards 0 in drops, let go with {}; if it was off, `prescribed = true` in the experiment's \
             file frees its joint in drops",
            list.join(", ")
        )
    })
}

/// That a search was ended by its limit of `limit_s` \[s\], or by a signal.
pub(super) fn ended_early(limit_s: f64) -> String {
    format!(
        "the search was ended early, by a signal or its limit of {limit_s} s (`limit_s` under [diagnose]): more may be found in more time"
    )
}
