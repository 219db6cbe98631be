//! `coulomb_friction`: the hinges rub with a torque that does not ask how fast.
//!
//! Near rest it creeps, in one of two forms: at a rate common to all hinges, or, `soft`, as MuJoCo's friction loss does, at one that
//! grows with the torque that the hinge bears and with its inverse inertia. Soft friction is solved for as friction loss is.

use crate::causes::hooks::Step;
use crate::causes::joint::axles::{Axle, sizes};
use crate::dynamics::plant::Plant;
use crate::model::Model;
use crate::model::cause::{Cause, CauseInfo, CauseValues, Kind, Mjcf, ParameterInfo, Per, Role};
use crate::scalar::Scalar;
use crate::space::Space;

pub(crate) const INFO: CauseInfo = CauseInfo {
    name: "coulomb_friction",
    kind: Kind::Joint,
    parameters: &[
        ParameterInfo::size("torque", "N m", [0.0, 1e-2], 2e-6, "friction torque of every hinge")
            .may_differ(),
        ParameterInfo::size("", "N m", [0.0, 1e-2], 2e-6, "the same for one hinge alone, added to it")
            .each(Per::Joint)
            .role(Role::Detail, 0.0)
            .may_differ(),
        ParameterInfo::size("rate", "rad/s", [1e-3, 1.0], 0.05, "rate over which friction turns round")
            .role(Role::Hidden(&[0.02]), 0.05)
            .idle_where("soft", 1.0),
        ParameterInfo::size(
            "breakaway",
            "1",
            [0.0, 5.0],
            0.5,
            "how much more it is near rest, as a share (Stribeck)",
        )
        .role(Role::Detail, 0.0)
        .idle_where("soft", 1.0),
        ParameterInfo::size(
            "stribeck_rate",
            "rad/s",
            [1e-2, 100.0],
            0.5,
            "rate over which that share is lost",
        )
        .role(Role::Detail, 0.5)
        .idle_where("soft", 1.0),
        ParameterInfo::size(
            "soft",
            "1",
            [0.0, 1.0],
            1.0,
            "1: creeps as MuJoCo's friction loss does, at a rate that grows with what the hinge bears",
        )
        .role(Role::Choice(&[0.0, 1.0]), 0.0),
    ],
    aliases: &[],
    sentence: "the hinges rub with a torque that does not depend on speed",
    check: "turn each hinge slowly in air with a hanging weight and note which one starts it",
    formula: "tau = -tau_c (1 + b exp(-(w/w_s)^2)) w / sqrt(w^2 + rate^2); soft: MuJoCo's friction loss",
    source: "Coulomb, Stribeck; smooth through rest, where it creeps instead of sticking",
    mjcf: Some(Mjcf { how: "joint frictionloss, exactly so where it is soft", exact: is_soft, fold }),
    in_picture_plane: false,
};

/// Whether `effect` is friction of the soft form.
pub(crate) fn is_soft<T: Scalar>(values: &CauseValues<T>) -> bool {
    values.cause() == Cause::new(&INFO) && values.one(5) != T::ZERO
}

/// As MuJoCo's friction loss, which creeps in another way.
fn fold<T: Scalar>(values: &CauseValues<T>, model: &mut Model<T>) {
    for axle in sizes(values, model, [0, 1], false) {
        model.joints[axle.joint].friction_loss += axle.size;
    }
}

/// Soft friction is the model's own; whether this is.
pub(crate) fn alter<T: Scalar>(values: &CauseValues<T>, model: &mut Model<T>) -> bool {
    let soft = is_soft(values);
    if soft {
        fold(values, model);
    }
    soft
}

/// The rubbing hinges.
#[derive(Debug, Clone)]
pub(crate) struct Term<S: Space> {
    axles: Vec<Axle<S::T>>,
    rate: S::T,
    breakaway: S::T,
    stribeck: S::T,
}

impl<S: Space> Step<S> for Term<S> {
    fn new(values: &CauseValues<S::T>, model: &Model<S::T>, _: &Plant<S>) -> Self {
        Self {
            axles: if is_soft(values) { Vec::new() } else { sizes(values, model, [0, 1], false) },
            rate: values.one(2),
            breakaway: values.one(3),
            stribeck: S::T::ONE / values.one(4),
        }
    }

    #[inline(always)]
    fn forces(&self, _: &[S::T], qvel: &[S::T], force: &mut [S::T]) {
        for axle in &self.axles {
            let w = qvel[axle.dof];
            force[axle.dof] -= self.per_rate(axle.size, w) * w;
        }
    }

    /// As if it went on to rest along a straight line: a step over rest ends near it and not beyond.
    #[inline(always)]
    fn slopes(&self, _: &[S::T], qvel: &[S::T], damping: &mut [S::T], _: &mut [S::T]) {
        for axle in &self.axles {
            damping[axle.dof] += self.per_rate(axle.size, qvel[axle.dof]);
        }
    }
}

impl<S: Space> Term<S> {
    /// Torque over rate at the rate `w`, where the hinge rubs with the torque `size`.
    #[inline(always)]
    fn per_rate(&self, size: S::T, w: S::T) -> S::T {
        let of = w * self.stribeck;
        let share = S::T::ONE + self.breakaway * (-(of * of)).exp();
        size * share / (w * w + self.rate * self.rate).sqrt()
    }
}
