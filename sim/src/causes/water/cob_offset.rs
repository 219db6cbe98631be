//! `cob_offset`: the water carries a link elsewhere than at its centre of mass.

use crate::causes::hooks::{Moment, Step};
use crate::dynamics::Work;
use crate::dynamics::plant::Plant;
use crate::math::{Vec3, Vector};
use crate::model::cause::{CauseInfo, CauseValues, Kind, ParameterInfo, Role};
use crate::model::{GeomKind, JointKind, Model, shape};
use crate::scalar::{Mask, Scalar};
use crate::space::{Space, Wrench};

pub(crate) const INFO: CauseInfo = CauseInfo {
    name: "cob_offset",
    kind: Kind::Physics,
    parameters: &[
        ParameterInfo::size(
            "along",
            "m",
            [-0.02, 0.02],
            5e-4,
            "offset along the link, from its hinge outwards",
        ),
        ParameterInfo::size(
            "across",
            "m",
            [-0.02, 0.02],
            5e-4,
            "offset across the link, counter-clockwise of it",
        ),
        ParameterInfo::size(
            "at_volume",
            "1",
            [0.0, 1.0],
            1.0,
            "share of the way from the centre of mass to the centre of volume of the body's shapes",
        )
        .role(Role::Detail, 0.0),
    ],
    aliases: &[],
    sentence: "the centre of buoyancy is not the centre of mass: air, ballast, uneven print",
    check: "let each link hang freely in water by its middle and see which way it turns",
    formula: "tau = m_b g (o_t sin q + o_n cos q), m_b = mass gravcomp",
    source: "hydrostatics; a link without a hinge counts its own -z as along and x as across",
    mjcf: None,
    in_picture_plane: false,
};

/// Lever arms of the buoyancy.
#[derive(Debug, Clone)]
pub(crate) struct Term<S: Space> {
    /// Body, held mass \[kg\], offset from the centre of mass in the body's axes \[m\].
    held: Vec<(usize, S::T, S::Vec)>,
}

impl<S: Space> Step<S> for Term<S> {
    fn new(values: &CauseValues<S::T>, model: &Model<S::T>, plant: &Plant<S>) -> Self {
        let held = plant.links.iter().enumerate().filter_map(|(index, link)| {
            let (along, across) = axes(model, index);
            let volume = centre_of_volume(model, index) - model.bodies[index].com;
            let offset = along * values.one(0) + across * values.one(1) + volume * values.one(2);
            Some((index, link.held_mass?, S::vector(&plant.layout, index, offset)))
        });
        Self { held: held.collect() }
    }

    #[inline(always)]
    fn wrenches(&self, _: Moment, plant: &Plant<S>, work: &mut Work<S>, _: &mut [S::Vec]) {
        for (body, mass, offset) in &self.held {
            let force = plant.gravity * -*mass;
            let torque = S::moment(S::apply(&work.rot[*body], *offset), force);
            work.wrench[*body] += Wrench { torque, force: S::Vec::ZERO };
        }
    }
}

/// Along a body, from its hinge to its centre of mass, and across it, a quarter turn on about the hinge's axis.
fn axes<T: Scalar>(model: &Model<T>, body: usize) -> (Vec3<T>, Vec3<T>) {
    let own = (Vec3::constant([0.0, 0.0, -1.0]), Vec3::constant([1.0, 0.0, 0.0]));
    let hinge = model.joints.iter().find(|joint| joint.body == body && joint.kind == JointKind::Hinge);
    let Some(hinge) = hinge else { return own };
    let arm = model.bodies[body].com - hinge.pos;
    let arm = arm - hinge.axis * hinge.axis.dot(arm);
    let length = arm.norm();
    if !T::from_f64(1e-9).less(length).all() {
        return own;
    }
    let along = arm * (T::ONE / length);
    (along, hinge.axis.cross(along))
}

/// Centre of volume of a body's shapes; its centre of mass where it has none.
fn centre_of_volume<T: Scalar>(model: &Model<T>, body: usize) -> Vec3<T> {
    let shapes = || model.geoms.iter().filter(|geom| geom.body == body && geom.kind != GeomKind::Plane);
    let total: f64 = shapes().map(|geom| shape::volume(geom.kind, geom.size)).sum();
    if total == 0.0 {
        return model.bodies[body].com;
    }
    shapes().fold(Vec3::ZERO, |sum, geom| {
        sum + geom.pos * T::from_f64(shape::volume(geom.kind, geom.size) / total)
    })
}
