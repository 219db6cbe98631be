//! `wall`: water between a wall and a shape cannot get away.

use crate::causes::hooks::{Moment, Step};
use crate::causes::water::shapes::wet;
use crate::dynamics::Work;
use crate::dynamics::fluid::about_root;
use crate::dynamics::plant::Plant;
use crate::math::{Vec3, Vector};
use crate::model::Model;
use crate::model::cause::{CauseInfo, CauseValues, Kind, ParameterInfo, Role};
use crate::scalar::Scalar;
use crate::space::Space;

pub(crate) const INFO: CauseInfo = CauseInfo {
    name: "wall",
    kind: Kind::Physics,
    parameters: &[
        ParameterInfo::size(
            "scale",
            "1",
            [0.0, 10.0],
            1.0,
            "how much the drag grows at the wall, as a share of it",
        ),
        ParameterInfo::size("x", "m", [-0.5, 0.5], 0.02, "where the wall stands, to the right of the origin")
            .role(Role::Hidden(&[-0.15, -0.12, -0.1, -0.08, 0.08, 0.1, 0.12, 0.15]), 0.1),
        ParameterInfo::size("reach", "m", [2e-3, 0.1], 0.005, "distance over which it falls off to 1/e")
            .role(Role::Detail, 0.015),
    ],
    aliases: &[],
    sentence: "a wall is near: the water resists more where the mechanism comes close to it",
    check: "move the mechanism twice as far from wall, floor and surface and repeat",
    formula: "drag on moving and turning x (1 + scale exp(-|x_wall - x| / reach))",
    source: "exponential fit to drag near a plane; a vertical wall square to the picture, added mass unchanged",
    mjcf: None,
    in_picture_plane: true,
};

/// The wall.
#[derive(Debug, Clone)]
pub(crate) struct Term<S: Space> {
    scale: S::T,
    wall: S::T,
    per_reach: S::T,
    right: S::Vec,
}

impl<S: Space> Step<S> for Term<S> {
    fn new(values: &CauseValues<S::T>, _: &Model<S::T>, plant: &Plant<S>) -> Self {
        Self {
            scale: values.one(0),
            wall: values.one(1),
            per_reach: S::T::ONE / values.one(2),
            right: S::vector(&plant.layout, 0, Vec3::constant([1.0, 0.0, 0.0])),
        }
    }

    #[inline(always)]
    fn wrenches(&self, _: Moment, plant: &Plant<S>, work: &mut Work<S>, _: &mut [S::Vec]) {
        for geom in &plant.fluid_geoms {
            let at = wet(geom, plant, work);
            let (w, v) = at.moving;
            let x = self.right.dot(at.at + work.pos[plant.links[geom.body].root]);
            let share = self.scale * (-((self.wall - x).abs() * self.per_reach)).exp();
            let drag = geom.shape.resistance(plant.density, plant.viscosity, w, v);
            let wrench = (
                w * -(share * (drag.slow_turning + drag.turning)),
                v * -(share * (drag.slow + drag.quadratic)),
            );
            work.wrench[geom.body] += about_root(wrench, at.at, &at.rot);
        }
    }
}
