//! Forward dynamics of a tree of bodies, one stage per file, in the order of a step.
//!
//! Spatial quantities stand in world axes about the origin of each tree's first body.

pub(crate) mod actuation;
pub(crate) mod bias;
pub(crate) mod fluid;
pub(crate) mod implicit;
pub(crate) mod inertia;
pub(crate) mod integrate;
pub(crate) mod kinematics;
pub(crate) mod limbs;
pub(crate) mod passive;
pub(crate) mod plane;
pub(crate) mod plant;
pub(crate) mod restraint;
pub(crate) mod stages;

use crate::math::{Quat, Vec3, Vector};
use crate::model::{Model, Poses};
use crate::scalar::Scalar;
use crate::space::{Inertia, Motion, Space, Spatial, Wrench};
use plant::Plant;

/// Everything the stages compute, allocated once.
#[derive(Debug, Clone)]
pub(crate) struct Work<S: Space> {
    /// Origin of each body \[m\].
    pub(crate) pos: Vec<S::Vec>,
    /// `world_from_body`.
    pub(crate) rot: Vec<S::Rot>,
    /// Centre of mass from the tree's root \[m\].
    pub(crate) com: Vec<S::Vec>,
    /// Motion per unit rate of each dof.
    pub(crate) axes: Vec<Motion<S>>,
    pub(crate) inertia: Vec<Inertia<S>>,
    /// Inertia of each body with all it carries.
    pub(crate) composite: Vec<Inertia<S>>,
    pub(crate) velocity: Vec<Motion<S>>,
    /// Acceleration of each body with all joint accelerations 0, less gravity.
    pub(crate) drift: Vec<Motion<S>>,
    /// External and inertial wrench on each body; 0 between uses.
    pub(crate) wrench: Vec<Wrench<S>>,
    /// Velocity of the water, world axes \[m/s\].
    pub(crate) water: S::Vec,
    /// The mass matrix, rows as in [`Plant::chain`].
    pub(crate) mass: Vec<S::T>,
}

impl<S: Space> Work<S> {
    pub(crate) fn new(plant: &Plant<S>) -> Self {
        let bodies = plant.links.len();
        Self {
            pos: vec![S::Vec::ZERO; bodies],
            rot: vec![S::IDENTITY; bodies],
            com: vec![S::Vec::ZERO; bodies],
            axes: vec![Motion::ZERO; plant.nv],
            inertia: vec![Inertia::ZERO; bodies],
            composite: vec![Inertia::ZERO; bodies],
            velocity: vec![Motion::ZERO; bodies],
            drift: vec![Motion::ZERO; bodies],
            wrench: vec![Wrench::ZERO; bodies],
            water: plant.wind,
            mass: vec![S::T::ZERO; plant.chain.len()],
        }
    }
}

/// World poses of bodies, geoms and sites at `qpos`.
pub(crate) fn poses<T: Scalar>(model: &Model<T>, qpos: &[T]) -> Poses<T> {
    let plant = Plant::<Spatial<T>>::new(model, ());
    let mut work = Work::new(&plant);
    kinematics::kinematics(&plant, qpos, &mut work);
    let place = |body: usize, at: Vec3<T>| work.pos[body] + work.rot[body].apply(at);
    let turn = |body: usize, quat: Quat<T>| work.rot[body].product(&quat.matrix());
    Poses {
        geom_pos: model.geoms.iter().map(|geom| place(geom.body, geom.pos)).collect(),
        geom_rot: model.geoms.iter().map(|geom| turn(geom.body, geom.quat)).collect(),
        site_pos: model.sites.iter().map(|site| place(site.body, site.pos)).collect(),
        body_pos: work.pos,
        body_rot: work.rot,
    }
}
