//! `drag_exponent`: drag grows with another power of speed than the square.
//!
//! An exponent of -1 would be viscous drag, which is `linear_drag`: it stays away from that.

use crate::causes::hooks::{Moment, Step};
use crate::causes::water::shapes::wet;
use crate::dynamics::Work;
use crate::dynamics::fluid::about_root;
use crate::dynamics::plant::Plant;
use crate::math::Vector;
use crate::model::Model;
use crate::model::cause::{CauseInfo, CauseValues, Kind, ParameterInfo, Role};
use crate::scalar::Scalar;
use crate::space::Space;

/// Speeds are smoothed below this share of the reference speed (chosen), which keeps the power finite at rest.
const SPEED_SMOOTHING_SHARE: f64 = 1e-3;

pub(crate) const INFO: CauseInfo = CauseInfo {
    name: "drag_exponent",
    kind: Kind::Physics,
    parameters: &[
        ParameterInfo::size("exponent", "1", [-0.95, 1.0], 0.2, "power of speed in the drag coefficient"),
        ParameterInfo::size("speed", "m/s", [1e-3, 10.0], 0.08, "speed at which the coefficients hold")
            .role(Role::Detail, 0.08),
    ],
    aliases: &[],
    sentence: "the drag coefficients fall or rise with speed (Reynolds number)",
    check: "let it drop from a small and from a large angle and compare",
    formula: "C(v) = C0 ((v/v0)^2 + 1e-6)^(p/2) in the quadratic drag force",
    source: "power law over a decade of Reynolds numbers; p = -0.2..-0.5 at 100..1000. Drag on turning keeps its square",
    mjcf: None,
    in_picture_plane: false,
};

/// The power law.
#[derive(Debug, Clone)]
pub(crate) struct Term<S: Space> {
    half: S::T,
    per_speed: S::T,
}

impl<S: Space> Step<S> for Term<S> {
    fn new(values: &CauseValues<S::T>, _: &Model<S::T>, _: &Plant<S>) -> Self {
        Self { half: values.one(0) * S::T::from_f64(0.5), per_speed: S::T::ONE / values.one(1) }
    }

    /// The drag's excess over what the coefficients already give.
    #[inline(always)]
    fn wrenches(&self, _: Moment, plant: &Plant<S>, work: &mut Work<S>, _: &mut [S::Vec]) {
        for geom in &plant.fluid_geoms {
            let at = wet(geom, plant, work);
            let (w, v) = at.moving;
            let speeds = v * self.per_speed;
            let squared = speeds.dot(speeds) + S::T::from_f64(SPEED_SMOOTHING_SHARE * SPEED_SMOOTHING_SHARE);
            let excess = (self.half * squared.ln()).exp() - S::T::ONE;
            let drag = geom.shape.resistance(plant.density, plant.viscosity, w, v).quadratic;
            let force = v * -(drag * excess);
            work.wrench[geom.body] += about_root((w * S::T::ZERO, force), at.at, &at.rot);
        }
    }
}
