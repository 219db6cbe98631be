//! `added_mass`: the water that a shape must accelerate with itself.

use crate::causes::hooks::{Moment, Step};
use crate::causes::water::shapes::wet;
use crate::dynamics::Work;
use crate::dynamics::fluid::about_root;
use crate::dynamics::plant::Plant;
use crate::math::Vector;
use crate::model::Model;
use crate::model::cause::{CauseInfo, CauseValues, Kind, ParameterInfo, Per, Role};
use crate::space::{Space, Wrench};

pub(crate) const INFO: CauseInfo = CauseInfo {
    name: "added_mass",
    kind: Kind::Physics,
    parameters: &[
        ParameterInfo::size("scale", "1", [0.0, 3.0], 1.0, "share of potential flow's added mass that acts"),
        ParameterInfo::size("", "1", [-3.0, 3.0], 1.0, "the same for one geom alone, added to it")
            .each(Per::Geom)
            .role(Role::Detail, 0.0),
    ],
    aliases: &[],
    sentence: "the links carry water along when they speed up",
    check: "repeat a fast and a slow stroke: what grows with acceleration alone is added mass",
    formula: "F = -scale mA (dv/dt - w x v), T = -scale IA dw/dt in each ellipsoid's axes, in the mass matrix",
    source: "Lamb, Hydrodynamics, 1932, sections 114 and 124: the part of Kirchhoff's equations that MuJoCo leaves out. \
             Unbounded water; water that itself speeds up is not counted",
    mjcf: None,
    in_picture_plane: false,
};

/// The shapes' added inertia.
#[derive(Debug, Clone)]
pub(crate) struct Term<S: Space> {
    shapes: Vec<Shape<S>>,
}

#[derive(Debug, Clone)]
struct Shape<S: Space> {
    /// Its place in `plant.fluid_geoms`.
    geom: usize,
    /// Added mass \[kg\] and inertia \[kg m2\] on the shape's axes.
    mass: S::Vec,
    inertia: S::Spin,
    /// The last dof that it rides on.
    dof: usize,
}

impl<S: Space> Step<S> for Term<S> {
    fn new(values: &CauseValues<S::T>, model: &Model<S::T>, plant: &Plant<S>) -> Self {
        // the families go by all geoms with coefficients, in the model's order
        let wet: Vec<usize> =
            (0..model.geoms.len()).filter(|&geom| model.geoms[geom].fluid.is_some()).collect();
        let shapes = plant.fluid_geoms.iter().enumerate().filter_map(|(geom, shape)| {
            let own = wet.iter().position(|&other| other == shape.geom).map(|place| values.each(1)[place])?;
            let density = plant.density * (values.one(0) + own);
            let mut body = shape.body;
            while body != 0 && plant.links[body].dofs.is_empty() {
                body = plant.links[body].parent;
            }
            let dof = plant.links[body].dofs.clone().last()?;
            let (mass, inertia) = shape.shape.added();
            Some(Shape { geom, mass: mass * density, inertia: inertia * density, dof })
        });
        Self { shapes: shapes.collect() }
    }

    /// J^T diag(mA, IA) J, each shape on the dofs that it rides on.
    #[inline(always)]
    fn inertia(&self, plant: &Plant<S>, work: &mut Work<S>) {
        for shape in &self.shapes {
            let (at, rot) = plant.fluid_geoms[shape.geom].place(plant, work);
            let chain = &plant.chain[plant.row[shape.dof]..plant.row[shape.dof + 1]];
            for (place, &dof) in chain.iter().enumerate() {
                let axis = work.axes[dof];
                let v = S::back(&rot, axis.lin + S::cross(axis.ang, at));
                let momentum = (shape.inertia.times(S::back_spin(&rot, axis.ang)), shape.mass.times(v));
                let momentum: Wrench<S> = about_root(momentum, at, &rot);
                // the dofs that this one rides on are those after it
                for (entry, &other) in work.mass[plant.row[dof]..].iter_mut().zip(&chain[place..]) {
                    *entry += work.axes[other].power(momentum);
                }
            }
        }
    }

    /// What the mass matrix leaves out: accelerations that are there with the dofs' own 0.
    #[inline(always)]
    fn wrenches(&self, _: Moment, plant: &Plant<S>, work: &mut Work<S>, _: &mut [S::Vec]) {
        for shape in &self.shapes {
            let geom = &plant.fluid_geoms[shape.geom];
            let at = wet(geom, plant, work);
            let (w, v) = at.moving;
            let (motion, rest) = (work.velocity[geom.body], work.drift[geom.body]);
            let velocity = motion.lin + S::cross(motion.ang, at.at);
            let acceleration =
                rest.lin + plant.gravity + S::cross(rest.ang, at.at) + S::cross(motion.ang, velocity);
            let force = S::cross(w, v) - S::back(&at.rot, acceleration);
            let torque = -S::back_spin(&at.rot, rest.ang);
            let wrench = (shape.inertia.times(torque), shape.mass.times(force));
            work.wrench[geom.body] += about_root(wrench, at.at, &at.rot);
        }
    }
}
