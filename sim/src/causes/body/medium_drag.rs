//! `medium_drag`: the medium around resists, where the model has no fluid at all.

use crate::causes::hooks::{Moment, Step};
use crate::causes::water::shapes::force_at;
use crate::dynamics::Work;
use crate::dynamics::plant::Plant;
use crate::math::{Vec3, Vector};
use crate::model::Model;
use crate::model::cause::{CauseInfo, CauseValues, Kind, ParameterInfo, Per, Role};
use crate::scalar::{Mask, Scalar};
use crate::space::Space;

pub(crate) const INFO: CauseInfo = CauseInfo {
    name: "medium_drag",
    kind: Kind::Physics,
    parameters: &[
        ParameterInfo::size(
            "drag",
            "kg/m2",
            [0.0, 100.0],
            0.01,
            "resistance of every link: half of density times drag coefficient times width",
        ),
        ParameterInfo::size("", "kg/m2", [0.0, 100.0], 0.01, "the same for one body alone, added to it")
            .each(Per::Body)
            .role(Role::Detail, 0.0),
    ],
    aliases: &[],
    sentence: "what is around resists the links, and the model has no fluid: air, most likely",
    check: "state density and viscosity of the medium in the model",
    formula: "dF = -c |v| v ds along each link, v the part of the velocity across it; only in models without a fluid",
    source: "Morison's drag by the cross-flow principle (S. F. Hoerner, Fluid-Dynamic Drag, 1965); a link reaches from its hinge to the \
             farthest of the next hinges and keypoints, or twice as far as its centre of mass",
    mjcf: None,
    in_picture_plane: false,
};

/// Gauss's points of the integral along a link, from 0 to 1, and their weights.
///
/// # Source
/// M. Abramowitz, I. A. Stegun, Handbook of Mathematical Functions, table 25.4, n = 5.
const POINTS: [(f64, f64); 5] = [
    (0.046_910_077_030_668, 0.118_463_442_528_094_5),
    (0.230_765_344_947_158_5, 0.239_314_335_249_683_2),
    (0.5, 0.284_444_444_444_444_5),
    (0.769_234_655_052_841_5, 0.239_314_335_249_683_2),
    (0.953_089_922_969_332, 0.118_463_442_528_094_5),
];
/// Speed below which drag is smoothed to 0, so that its derivative is finite \[m/s\] (chosen).
const SPEED_SMOOTHING_M_PER_S: f64 = 1e-9;

/// A link in the medium.
#[derive(Debug, Clone)]
struct Line<S: Space> {
    body: usize,
    /// Its hinge in the body's axes \[m\].
    hinge: S::Vec,
    /// From there to its end \[m\].
    reach: S::Vec,
    /// Along it.
    along: S::Vec,
    /// Resistance times length \[kg/m\].
    size: S::T,
}

/// The links.
#[derive(Debug, Clone)]
pub(crate) struct Term<S: Space> {
    lines: Vec<Line<S>>,
}

impl<S: Space> Step<S> for Term<S> {
    fn new(values: &CauseValues<S::T>, model: &Model<S::T>, plant: &Plant<S>) -> Self {
        if !plant.fluid_geoms.is_empty() || !plant.fluid_bodies.is_empty() {
            return Self { lines: Vec::new() };
        }
        let lines = model.bodies_with_mass().zip(values.each(1)).filter_map(|(body, &own)| {
            let (hinge, reach) = line(model, body)?;
            let length = reach.norm();
            let vector = |v: Vec3<S::T>| S::vector(&plant.layout, body, v);
            Some(Line {
                body,
                hinge: vector(hinge),
                reach: vector(reach),
                along: vector(reach * (S::T::ONE / length)),
                size: (values.one(0) + own) * length,
            })
        });
        Self { lines: lines.collect() }
    }

    #[inline(always)]
    fn wrenches(&self, _: Moment, plant: &Plant<S>, work: &mut Work<S>, _: &mut [S::Vec]) {
        for line in &self.lines {
            let body = line.body;
            let root = work.pos[body] - work.pos[plant.links[body].root];
            let motion = work.velocity[body];
            let [hinge, reach, along] =
                [line.hinge, line.reach, line.along].map(|v| S::apply(&work.rot[body], v));
            for (share, weight) in POINTS {
                let at = root + hinge + reach * S::T::from_f64(share);
                let velocity = motion.lin + S::cross(motion.ang, at);
                let across = velocity - along * along.dot(velocity);
                let speed = (across.dot(across)
                    + S::T::from_f64(SPEED_SMOOTHING_M_PER_S * SPEED_SMOOTHING_M_PER_S))
                .sqrt();
                let force = across * -(line.size * speed * S::T::from_f64(weight));
                work.wrench[body] += force_at(force, at);
            }
        }
    }
}

/// A body's hinge and the way from there to its end; `None` where it has no length.
fn line<T: Scalar>(model: &Model<T>, body: usize) -> Option<(Vec3<T>, Vec3<T>)> {
    let hinge = model.joints.iter().find(|joint| joint.body == body).map_or(Vec3::ZERO, |joint| joint.pos);
    let next = model.bodies.iter().enumerate().skip(1).filter(|(_, other)| other.parent == body);
    let marked = model.sites.iter().filter(|site| site.body == body).map(|site| site.pos);
    let ends = next.map(|(_, next)| next.pos).chain(marked).map(|end| end - hinge);
    let least = T::from_f64(1e-6);
    let farther = |far: Vec3<T>, arm: Vec3<T>| if far.norm().less(arm.norm()).all() { arm } else { far };
    let reach = ends.fold(Vec3::ZERO, farther);
    let twice = (model.bodies[body].com - hinge) * T::from_f64(2.0);
    [reach, twice].into_iter().find(|reach| least.less(reach.norm()).all()).map(|reach| (hinge, reach))
}
