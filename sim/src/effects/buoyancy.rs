//! `buoyancy`: the water carries more or less than the model says.

use super::{Alias, AliasWhen, Effect, Info, Kind, Mjcf, ParameterInfo, Per, Role, weighty};
use crate::model::{Model, shape};
use crate::scalar::Scalar;

pub(crate) const INFO: Info = Info {
    name: "buoyancy",
    kind: Kind::Physics,
    parameters: &[
        ParameterInfo::size("scale", "1", [-0.5, 0.5], 0.01, "error of the displaced mass, as a share of it"),
        ParameterInfo::size("", "1", [-0.5, 0.5], 0.01, "the same for one body alone, added to it")
            .each(Per::Body)
            .role(Role::Detail, 0.0),
        ParameterInfo::size(
            "displaced",
            "1",
            [0.0, 1.0],
            1.0,
            "share of the water that the shapes displace which carries them, for models without gravcomp",
        )
        .role(Role::Detail, 0.0),
    ],
    aliases: &[Alias { name: "link_mass", when: AliasWhen::UnlessWeighed }],
    sentence: "the water carries another weight than the model says: density, bubbles, or volume",
    formula: "m_b -> m_b (1 + scale) + displaced rho V, m_b = mass gravcomp",
    source: "Archimedes; acts at the centre of mass, see cob_offset",
    mjcf: Some(Mjcf { how: "body gravcomp", exact: true, fold: alter }),
    in_picture_plane: false,
};

/// The bodies' gravity compensation.
pub(crate) fn alter<T: Scalar>(effect: &Effect<T>, model: &mut Model<T>) {
    let bodies: Vec<usize> = weighty(model).collect();
    for (body, &own) in bodies.into_iter().zip(effect.each(1)) {
        let shapes = model.geoms.iter().filter(|geom| geom.body == body);
        let volume: f64 = shapes.map(|geom| shape::volume(geom.kind, geom.size)).sum();
        let density = model.settings.density;
        let body = &mut model.bodies[body];
        body.gravity_compensation = body.gravity_compensation * (T::ONE + effect.one(0) + own)
            + effect.one(2) * density * T::from_f64(volume) / body.mass;
    }
}
