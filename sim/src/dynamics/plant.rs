//! The model laid out for stepping: everything that depends on the model alone, computed once.

use super::joint::JointPlan;
use super::tendon::{TendonPlan, Term, terms};
use crate::fluid::{Ellipsoid, Immersed, ImmersedBox, InertiaBox};
use crate::math::{Sym3, Vector};
use crate::model::{ActuatorKind, Body, Coordinates, Gearmotor, Joint, Model, Softness, shape};
use crate::scalar::{Mask, Scalar};
use crate::space::Space;

/// One body; index 0 is the world.
#[derive(Debug, Clone)]
pub(crate) struct Link<S: Space> {
    pub(crate) parent: usize,
    /// The child of the world it hangs from: its origin is the origin of all spatial quantities.
    pub(crate) root: usize,
    pub(crate) pos: S::Vec,
    /// `parent_from_body` at the reference; `None` for the identity.
    pub(crate) rot: Option<S::Rot>,
    pub(crate) mass: S::T,
    pub(crate) com: S::Vec,
    /// Inertia about the centre of mass, body axes.
    pub(crate) inertia: S::Sym,
    /// Mass times gravity compensation; `None` for 0.
    pub(crate) held_mass: Option<S::T>,
    pub(crate) joints: std::ops::Range<usize>,
    pub(crate) dofs: std::ops::Range<usize>,
}

#[derive(Debug, Clone)]
pub(crate) struct FluidGeom<S: Space> {
    /// Its place in the model.
    pub(crate) geom: usize,
    pub(crate) body: usize,
    pub(crate) pos: S::Vec,
    pub(crate) rot: Option<S::Rot>,
    pub(crate) shape: Immersed<S>,
}

#[derive(Debug, Clone)]
pub(crate) struct FluidBody<S: Space> {
    pub(crate) body: usize,
    /// `body_from_principal`; `None` for the identity.
    pub(crate) rot: Option<S::Rot>,
    pub(crate) shape: ImmersedBox<S>,
}

#[derive(Debug, Clone)]
pub(crate) struct Drive<T> {
    pub(crate) q: usize,
    pub(crate) dof: usize,
    pub(crate) gear: T,
    /// Further joints of its coordinate.
    pub(crate) also: Vec<Term<T>>,
    /// Force = gain * command + stiffness * length + damping * rate.
    pub(crate) gain: T,
    pub(crate) stiffness: T,
    pub(crate) damping: T,
    pub(crate) command_range: Option<[T; 2]>,
    pub(crate) force_range: Option<[T; 2]>,
    /// Motor and gear, where they are not MuJoCo's.
    pub(crate) gearmotor: Option<Gearmotor<T>>,
}

/// Where a coordinate, or the first of four, stands in `qpos`, and its velocity in `qvel`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Place {
    pub(crate) q: usize,
    pub(crate) dof: usize,
}

/// A joint's end stop, or the friction loss of one axis: a force on one degree of freedom, between bounds.
#[derive(Debug, Clone)]
pub(crate) enum Restraint<T> {
    /// Friction loss at this dof.
    Friction { dof: usize, loss: T, softness: Softness },
    /// Lower and upper end stop of the joint with this dof.
    Limit { q: usize, dof: usize, range: [T; 2], margin: f64, softness: Softness },
}

#[derive(Debug, Clone)]
pub(crate) struct Plant<S: Space> {
    pub(crate) layout: S::Layout,
    pub(crate) gravity: S::Vec,
    pub(crate) wind: S::Vec,
    pub(crate) density: S::T,
    pub(crate) viscosity: S::T,
    pub(crate) links: Vec<Link<S>>,
    pub(crate) joints: Vec<JointPlan<S>>,
    /// Coordinates that are numbers, and those that are quaternions: each with its velocity's place.
    pub(crate) numbers: Vec<Place>,
    pub(crate) rotations: Vec<Place>,
    pub(crate) dof_body: Vec<usize>,
    pub(crate) armature: Vec<S::T>,
    pub(crate) fluid_geoms: Vec<FluidGeom<S>>,
    pub(crate) fluid_bodies: Vec<FluidBody<S>>,
    pub(crate) tendons: Vec<TendonPlan<S::T>>,
    pub(crate) drives: Vec<Drive<S::T>>,
    pub(crate) restraints: Vec<Restraint<S::T>>,
    /// Where each dof's row of the mass matrix starts in `chain`; one more at the end.
    pub(crate) row: Vec<usize>,
    /// Row by row: the dof itself, then the dofs it rides on, nearest first.
    pub(crate) chain: Vec<usize>,
    pub(crate) nv: usize,
    /// Whether some joint has a damper.
    pub(crate) damped: bool,
    /// Free bodies that carry nothing that moves.
    pub(crate) lone: Vec<usize>,
}

impl<S: Space> Plant<S> {
    pub(crate) fn new(model: &Model<S::T>, layout: S::Layout) -> Self {
        let nonzero = |x: S::T| x != S::T::ZERO;
        let mut plant = Self {
            gravity: S::vector(&layout, 0, model.settings.gravity),
            wind: S::vector(&layout, 0, model.settings.wind),
            layout,
            density: model.settings.density,
            viscosity: model.settings.viscosity,
            links: Vec::with_capacity(model.bodies.len()),
            joints: Vec::with_capacity(model.joints.len()),
            numbers: Vec::new(),
            rotations: Vec::new(),
            dof_body: Vec::new(),
            armature: Vec::new(),
            fluid_geoms: Vec::new(),
            fluid_bodies: Vec::new(),
            tendons: Vec::new(),
            drives: Vec::new(),
            restraints: Vec::new(),
            row: vec![0],
            chain: Vec::new(),
            nv: model.nv(),
            damped: false,
            lone: Vec::new(),
        };
        let weighty = plant.gravity != S::Vec::ZERO;
        for (index, body) in model.bodies.iter().enumerate() {
            let first = plant.joints.len();
            let first_dof = plant.dof_body.len();
            for joint in model.joints.iter().filter(|joint| joint.body == index) {
                plant.add_joint(joint, body);
            }
            let held = body.mass * body.gravity_compensation;
            let inertia = Sym3::rotated_diagonal(&body.principal.matrix(), body.inertia);
            plant.links.push(Link {
                parent: body.parent,
                root: if body.parent == 0 { index } else { plant.links[body.parent].root },
                pos: S::vector(&plant.layout, body.parent, body.pos),
                rot: S::link_rotation(&plant.layout, body.quat),
                mass: body.mass,
                com: S::vector(&plant.layout, index, body.com),
                inertia: S::inertia(&plant.layout, index, inertia),
                held_mass: (weighty && nonzero(held)).then_some(held),
                joints: first..plant.joints.len(),
                dofs: first_dof..plant.dof_body.len(),
            });
            plant.add_rows(index);
        }
        plant.lone = plant.lone_free_bodies();
        plant.add_fluid(model);
        let pulling = model.tendons.iter().filter(|tendon| tendon.pulls());
        plant.tendons = pulling.map(|tendon| TendonPlan::new(model, tendon)).collect();
        plant.drives = model.actuators.iter().map(|actuator| drive(model, actuator)).collect();
        plant
    }

    /// The free bodies that carry nothing that moves, of which MuJoCo's implicitfast treats the rotation apart.
    fn lone_free_bodies(&self) -> Vec<usize> {
        let free = |link: &Link<S>| link.joints.len() == 1 && self.joints[link.joints.start].is_free();
        let moves = |index: usize| {
            self.links
                .iter()
                .enumerate()
                .any(|(other, link)| link.root == index && other != index && !link.dofs.is_empty())
        };
        (1..self.links.len()).filter(|&index| free(&self.links[index]) && !moves(index)).collect()
    }

    fn add_joint(&mut self, joint: &Joint<S::T>, body: &Body<S::T>) {
        let plan = JointPlan::new(joint, body, &self.layout);
        self.damped |= plan.damped;
        for dof in plan.dof..plan.dof + plan.nv {
            self.dof_body.push(joint.body);
            self.armature.push(joint.armature);
            if joint.friction_loss != S::T::ZERO {
                let softness = joint.friction_softness.in_range();
                self.restraints.push(Restraint::Friction { dof, loss: joint.friction_loss, softness });
            }
        }
        if let Some(range) = joint.limit {
            let (q, dof) = (joint.qpos_address, joint.dof_address);
            let (margin, softness) = (joint.limit_margin, joint.limit_softness.in_range());
            self.restraints.push(Restraint::Limit { q, dof, range, margin, softness });
        }
        for (coordinates, q, dof) in joint.coordinates() {
            match coordinates {
                Coordinates::Rotation => self.rotations.push(Place { q, dof }),
                Coordinates::Axis | Coordinates::Position => {
                    self.numbers.extend((0..coordinates.nq()).map(|k| Place { q: q + k, dof: dof + k }));
                }
            }
        }
        self.joints.push(plan);
    }

    /// The rows of the mass matrix of this body's dofs: each rides on the ones before it and its ancestors'.
    fn add_rows(&mut self, body: usize) {
        let mut carrier = self.links[body].parent;
        while carrier != 0 && self.links[carrier].dofs.is_empty() {
            carrier = self.links[carrier].parent;
        }
        let mut below = self.links[carrier].dofs.clone().last();
        for dof in self.links[body].dofs.clone() {
            self.chain.push(dof);
            if let Some(below) = below {
                self.chain.extend_from_within(self.row[below]..self.row[below + 1]);
            }
            self.row.push(self.chain.len());
            below = Some(dof);
        }
    }

    fn add_fluid(&mut self, model: &Model<S::T>) {
        // a vacuum exerts no force
        if self.density == S::T::ZERO && self.viscosity == S::T::ZERO {
            return;
        }
        for (index, body) in model.bodies.iter().enumerate().skip(1) {
            // MuJoCo's threshold below which a body feels no water
            if !S::T::from_f64(1e-15).less(body.mass).any() {
                continue;
            }
            let before = self.fluid_geoms.len();
            for (place, geom) in model.geoms.iter().enumerate().filter(|(_, geom)| geom.body == index) {
                if let Some(coefficients) = geom.fluid {
                    let shape = Ellipsoid::new(shape::semi_axes(geom.kind, geom.size), coefficients)
                        .with_lift(model.settings.kutta_lift);
                    let (rot, axes) = S::shape_axes(&self.layout, index, geom.quat);
                    self.fluid_geoms.push(FluidGeom {
                        geom: place,
                        body: index,
                        pos: S::vector(&self.layout, index, geom.pos),
                        rot,
                        shape: Immersed::new(&shape, axes),
                    });
                }
            }
            if self.fluid_geoms.len() == before {
                let (rot, axes) = S::shape_axes(&self.layout, index, body.principal);
                let shape = InertiaBox::new(body.mass, body.inertia);
                self.fluid_bodies.push(FluidBody { body: index, rot, shape: ImmersedBox::new(&shape, axes) });
            }
        }
    }
}

fn drive<T: Scalar>(model: &Model<T>, actuator: &crate::model::Actuator<T>) -> Drive<T> {
    let joint = &model.joints[actuator.joint];
    let (gain, stiffness) = match actuator.kind {
        ActuatorKind::Position => (actuator.kp, -actuator.kp),
        ActuatorKind::Velocity => (actuator.kv, T::ZERO),
        ActuatorKind::Motor => (T::ONE, T::ZERO),
    };
    Drive {
        q: joint.qpos_address,
        dof: joint.dof_address,
        gear: actuator.gear,
        also: terms(model, &actuator.also),
        gain,
        stiffness,
        damping: -actuator.kv,
        command_range: actuator.command_range,
        force_range: actuator.force_range,
        gearmotor: actuator.gearmotor.clone(),
    }
}
