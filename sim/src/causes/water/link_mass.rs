//! `link_mass`: the bodies are heavier or lighter than the model says.

use crate::model::Model;
use crate::model::cause::{Alias, AliasWhen, CauseInfo, CauseValues, Kind, Mjcf, ParameterInfo, Per, Role};
use crate::scalar::Scalar;

pub(crate) const INFO: CauseInfo = CauseInfo {
    name: "link_mass",
    kind: Kind::Physics,
    parameters: &[
        ParameterInfo::size("scale", "1", [-0.5, 1.0], 0.01, "error of mass and inertia, as a share of them"),
        ParameterInfo::size("", "1", [-0.5, 1.0], 0.01, "the same for one body alone, added to it")
            .each(Per::Body)
            .role(Role::Detail, 0.0),
    ],
    aliases: &[Alias { name: "buoyancy", when: AliasWhen::UnlessWeighed }],
    sentence: "the links have another mass than the model says",
    check: "weigh each link dry, to 0.01 g",
    formula: "m -> m (1 + scale), I -> I (1 + scale); the displaced water stays",
    source: "definition",
    mjcf: Some(Mjcf { how: "inertial mass, diaginertia; body gravcomp", exact: |_| true, fold: alter }),
    in_picture_plane: false,
};

/// Mass and inertia; the compensation makes up for the share of it that is buoyancy.
pub(crate) fn alter<T: Scalar>(values: &CauseValues<T>, model: &mut Model<T>) {
    let bodies: Vec<usize> = model.bodies_with_mass().collect();
    for (body, &own) in bodies.into_iter().zip(values.each(1)) {
        let factor = T::ONE + values.one(0) + own;
        let body = &mut model.bodies[body];
        body.mass *= factor;
        body.inertia = body.inertia * factor;
        body.gravity_compensation = body.gravity_compensation / factor;
    }
}
