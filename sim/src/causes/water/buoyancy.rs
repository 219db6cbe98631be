//! `buoyancy`: the water carries more or less than the model says.

use crate::model::cause::{Alias, AliasWhen, CauseInfo, CauseValues, Kind, Mjcf, ParameterInfo, Per, Role};
use crate::model::{Model, shape};
use crate::scalar::Scalar;

pub(crate) const INFO: CauseInfo = CauseInfo {
    name: "buoyancy",
    kind: Kind::Physics,
    parameters: &[
        ParameterInfo::size("scale", "1", [-0.5, 1.5], 0.01, "error of the displaced mass, as a share of it")
            .may_differ(),
        ParameterInfo::size("", "1", [-0.5, 1.5], 0.01, "the same for one body alone, added to it")
            .each(Per::Body)
            .role(Role::Detail, 0.0)
            .may_differ(),
    ],
    aliases: &[Alias { name: "link_mass", when: AliasWhen::UnlessWeighed }],
    sentence: "the water carries another weight than the model says: density, bubbles, or volume",
    check: "weigh each link in water, look for bubbles on it, and measure the water's density",
    formula: "m_b -> m_b + scale m_w, m_b = mass gravcomp, m_w the same or, in a model without any gravcomp, rho V of the shapes",
    source: "Archimedes; acts at the centre of mass, see cob_offset",
    mjcf: Some(Mjcf { how: "body gravcomp", exact: |_| true, fold: alter }),
    in_picture_plane: false,
};

/// The bodies' gravity compensation. A model without any has forgotten the water's share: that of its shapes then.
pub(crate) fn alter<T: Scalar>(values: &CauseValues<T>, model: &mut Model<T>) {
    let bodies: Vec<usize> = model.bodies_with_mass().collect();
    let forgotten = bodies.iter().all(|&body| model.bodies[body].gravity_compensation == T::ZERO);
    for (body, &own) in bodies.into_iter().zip(values.each(1)) {
        let share = if forgotten { water(model, body) } else { model.bodies[body].gravity_compensation };
        let own = values.one(0) + own;
        model.bodies[body].gravity_compensation += own * share;
    }
}

/// Mass of the water that the shapes of `body` displace, over its own.
fn water<T: Scalar>(model: &Model<T>, body: usize) -> T {
    let shapes = model.geoms.iter().filter(|geom| geom.body == body);
    let volume: f64 = shapes.map(|geom| shape::volume(geom.kind, geom.size)).sum();
    model.settings.density * T::from_f64(volume) / model.bodies[body].mass
}
