//! `linear_drag`: resistance in proportion to speed, as slow water gives.

use crate::causes::hooks::{Moment, Step};
use crate::causes::water::shapes::{drift, force_at};
use crate::dynamics::Work;
use crate::dynamics::plant::Plant;
use crate::model::Model;
use crate::model::cause::{CauseInfo, CauseValues, Kind, ParameterInfo};
use crate::space::Space;

pub(crate) const INFO: CauseInfo = CauseInfo {
    name: "linear_drag",
    kind: Kind::Physics,
    parameters: &[ParameterInfo::size(
        "drag",
        "N s/m",
        [0.0, 10.0],
        1e-3,
        "added resistance of each wet shape",
    )],
    aliases: &[],
    sentence: "the water resists in proportion to speed, besides its square",
    check: "let it drop slowly and fast: what slow motion feels more of is linear drag",
    formula: "F = -c v at the centre of each ellipsoid, v against the water",
    source: "Stokes; one value for all shapes, whatever their size",
    mjcf: None,
    in_picture_plane: false,
};

/// The resistance.
#[derive(Debug, Clone)]
pub(crate) struct Term<S: Space> {
    drag: S::T,
}

impl<S: Space> Step<S> for Term<S> {
    fn new(values: &CauseValues<S::T>, _: &Model<S::T>, _: &Plant<S>) -> Self {
        Self { drag: values.one(0) }
    }

    #[inline(always)]
    fn wrenches(&self, _: Moment, plant: &Plant<S>, work: &mut Work<S>, _: &mut [S::Vec]) {
        for geom in &plant.fluid_geoms {
            let (v, at) = drift(geom, plant, work);
            work.wrench[geom.body] += force_at(v * -self.drag, at);
        }
    }
}
