//! `load_friction`: the hinges rub the more, the more they bear.

use crate::causes::hooks::{Moment, Step};
use crate::dynamics::Work;
use crate::dynamics::plant::Plant;
use crate::math::Vector;
use crate::model::cause::{CauseInfo, CauseValues, Kind, ParameterInfo, Per, Role};
use crate::model::{JointKind, Model};
use crate::scalar::Scalar;
use crate::space::{Space, Wrench};

pub(crate) const INFO: CauseInfo = CauseInfo {
    name: "load_friction",
    kind: Kind::Joint,
    parameters: &[
        ParameterInfo::size(
            "arm",
            "m",
            [0.0, 0.02],
            3e-4,
            "friction torque of every hinge over the force it bears",
        ),
        ParameterInfo::size("", "m", [0.0, 0.02], 3e-4, "the same for one joint alone, added to it")
            .each(Per::Joint)
            .role(Role::Detail, 0.0),
        ParameterInfo::size("rate", "rad/s", [1e-3, 1.0], 0.05, "rate over which friction turns round")
            .role(Role::Hidden(&[0.02]), 0.05),
    ],
    aliases: &[],
    sentence: "the hinges rub with a torque that grows with the force they bear",
    check: "turn a hinge slowly with one and with two weights hung below it and note the torque that starts it",
    formula: "tau = -a |F| w / sqrt(w^2 + rate^2), F the force that the hinge bears while no joint's rate changes",
    source: "dry journal bearing: friction coefficient times radius times load; what the joints' accelerations add to the load is left out",
    mjcf: None,
    in_picture_plane: false,
};

/// A bearing.
#[derive(Debug, Clone)]
struct Bearing<T> {
    body: usize,
    dof: usize,
    /// The body and all that it carries.
    carried: Vec<usize>,
    arm: T,
    /// What it bears at rest \[N\], for implicit steps.
    at_rest: T,
}

/// The bearings, the outermost first.
#[derive(Debug, Clone)]
pub(crate) struct Term<S: Space> {
    bearings: Vec<Bearing<S::T>>,
    rate: S::T,
}

impl<S: Space> Step<S> for Term<S> {
    fn new(values: &CauseValues<S::T>, model: &Model<S::T>, plant: &Plant<S>) -> Self {
        let hangs_from = |mut body: usize, from: usize| {
            while body > from {
                body = plant.links[body].parent;
            }
            body == from
        };
        let bearing = |(joint, &own): (&crate::model::Joint<S::T>, &S::T)| {
            let carried: Vec<usize> =
                (joint.body..plant.links.len()).filter(|&body| hangs_from(body, joint.body)).collect();
            let weights = carried.iter().map(|&body| {
                let link = &plant.links[body];
                plant.gravity * (link.mass - link.held_mass.unwrap_or(S::T::ZERO))
            });
            let weight = weights.fold(S::Vec::ZERO, |sum, weight| sum + weight);
            Bearing {
                body: joint.body,
                dof: joint.dof_address,
                carried,
                arm: values.one(0) + own,
                at_rest: weight.norm(),
            }
        };
        let hinges = model.axles().map(|(_, joint)| joint).zip(values.each(1));
        let hinges = hinges.filter(|(joint, _)| joint.kind == JointKind::Hinge);
        let mut bearings: Vec<Bearing<S::T>> = hinges.map(bearing).collect();
        bearings.reverse();
        Self { bearings, rate: values.one(2) }
    }

    #[inline(always)]
    fn wrenches(&self, _: Moment, plant: &Plant<S>, work: &mut Work<S>, _: &mut [S::Vec]) {
        for bearing in &self.bearings {
            let mut load = S::Vec::ZERO;
            for &body in &bearing.carried {
                load += work.wrench[body].force;
            }
            let parent = plant.links[bearing.body].parent;
            let axis = work.axes[bearing.dof].ang;
            let w = axis.dot(work.velocity[bearing.body].ang - work.velocity[parent].ang);
            let torque = axis * (self.per_rate(bearing, load.norm(), w) * w);
            // a couple, which leaves the loads as they are
            let couple = Wrench { torque, force: S::Vec::ZERO };
            work.wrench[bearing.body] -= couple;
            if parent != 0 {
                work.wrench[parent] += couple;
            }
        }
    }

    /// As dry friction's, under the load at rest.
    #[inline(always)]
    fn slopes(&self, _: &[S::T], qvel: &[S::T], damping: &mut [S::T], _: &mut [S::T]) {
        for bearing in &self.bearings {
            damping[bearing.dof] += self.per_rate(bearing, bearing.at_rest, qvel[bearing.dof]);
        }
    }
}

impl<S: Space> Term<S> {
    /// Torque over rate at the rate `w`, under `load`.
    #[inline(always)]
    fn per_rate(&self, bearing: &Bearing<S::T>, load: S::T, w: S::T) -> S::T {
        bearing.arm * load / (w * w + self.rate * self.rate).sqrt()
    }
}
