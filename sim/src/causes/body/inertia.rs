//! `inertia`: the bodies resist turning more or less than the model says.

use crate::model::Model;
use crate::model::cause::{CauseInfo, CauseValues, Kind, Mjcf, ParameterInfo, Per, Role};
use crate::scalar::Scalar;

pub(crate) const INFO: CauseInfo = CauseInfo {
    name: "inertia",
    kind: Kind::Physics,
    parameters: &[
        ParameterInfo::size(
            "scale",
            "1",
            [-0.9, 3.0],
            0.1,
            "error of the moments of inertia, as a share of them",
        ),
        ParameterInfo::size("", "1", [-0.9, 3.0], 0.1, "the same for one body alone, added to it")
            .each(Per::Body)
            .role(Role::Detail, 0.0),
    ],
    aliases: &[],
    sentence: "the links' mass lies further out, or further in, than the model says",
    check: "hang each link alone by its pivot in air and time ten swings",
    formula: "I -> I (1 + scale) about the centre of mass, which stays with the mass",
    source: "definition; all principal moments alike, so that they stay those of some body",
    mjcf: Some(Mjcf { how: "inertial diaginertia", exact: |_| true, fold: alter }),
    in_picture_plane: false,
};

/// The moments of inertia.
pub(crate) fn alter<T: Scalar>(values: &CauseValues<T>, model: &mut Model<T>) {
    let bodies: Vec<usize> = model.bodies_with_mass().collect();
    for (body, &own) in bodies.into_iter().zip(values.each(1)) {
        let body = &mut model.bodies[body];
        body.inertia = body.inertia * (T::ONE + values.one(0) + own);
    }
}
