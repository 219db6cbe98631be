//! The model laid out for stepping: everything that depends on the model alone, computed once.

use crate::fluid::{Ellipsoid, InertiaBox};
use crate::math::{Mat3, Quat, Sym3, Vec3};
use crate::model::{ActuatorKind, JointKind, Model, shape};
use crate::scalar::{Mask, Scalar};

/// One body; index 0 is the world.
#[derive(Debug, Clone)]
pub(crate) struct Link<T> {
    pub(crate) parent: usize,
    /// The child of the world it hangs from: its origin is the origin of all spatial quantities.
    pub(crate) root: usize,
    pub(crate) pos: Vec3<T>,
    /// `parent_from_body` at the reference; `None` for the identity.
    pub(crate) rot: Option<Mat3<T>>,
    pub(crate) quat: Quat<T>,
    pub(crate) mass: T,
    pub(crate) com: Vec3<T>,
    /// Inertia about the centre of mass, body axes.
    pub(crate) inertia: Sym3<T>,
    /// Mass times gravity compensation; `None` for 0.
    pub(crate) held_mass: Option<T>,
    pub(crate) joints: std::ops::Range<usize>,
    pub(crate) dofs: std::ops::Range<usize>,
}

#[derive(Debug, Clone)]
pub(crate) struct JointPlan<T> {
    pub(crate) kind: JointKind,
    pub(crate) q: usize,
    pub(crate) dof: usize,
    /// Anchor in the body's frame; `None` at its origin.
    pub(crate) pos: Option<Vec3<T>>,
    pub(crate) axis: Vec3<T>,
    pub(crate) reference: T,
    pub(crate) spring_reference: T,
    pub(crate) stiffness: [T; 3],
    pub(crate) springy: bool,
    pub(crate) damping: [T; 3],
    pub(crate) damped: bool,
}

#[derive(Debug, Clone)]
pub(crate) struct FluidGeom<T> {
    pub(crate) body: usize,
    pub(crate) pos: Vec3<T>,
    pub(crate) rot: Option<Mat3<T>>,
    pub(crate) shape: Ellipsoid<T>,
}

#[derive(Debug, Clone)]
pub(crate) struct FluidBody<T> {
    pub(crate) body: usize,
    pub(crate) principal: Mat3<T>,
    pub(crate) shape: InertiaBox<T>,
}

#[derive(Debug, Clone)]
pub(crate) struct Drive<T> {
    pub(crate) q: usize,
    pub(crate) dof: usize,
    pub(crate) gear: T,
    /// Force = gain * command + stiffness * length + damping * rate.
    pub(crate) gain: T,
    pub(crate) stiffness: T,
    pub(crate) damping: T,
    pub(crate) command_range: Option<[T; 2]>,
    pub(crate) force_range: Option<[T; 2]>,
}

/// A joint's end stop, or the friction loss of one axis: a force on one degree of freedom, between bounds.
#[derive(Debug, Clone)]
pub(crate) enum Restraint<T> {
    /// Friction loss at this dof.
    Friction { dof: usize, loss: T },
    /// Lower and upper end stop of the joint with this dof.
    Limit { q: usize, dof: usize, range: [T; 2] },
}

#[derive(Debug, Clone)]
pub(crate) struct Plant<T> {
    pub(crate) gravity: Vec3<T>,
    pub(crate) wind: Vec3<T>,
    pub(crate) density: T,
    pub(crate) viscosity: T,
    pub(crate) links: Vec<Link<T>>,
    pub(crate) joints: Vec<JointPlan<T>>,
    pub(crate) dof_body: Vec<usize>,
    pub(crate) armature: Vec<T>,
    pub(crate) fluid_geoms: Vec<FluidGeom<T>>,
    pub(crate) fluid_bodies: Vec<FluidBody<T>>,
    pub(crate) drives: Vec<Drive<T>>,
    pub(crate) restraints: Vec<Restraint<T>>,
    /// Where each dof's row of the mass matrix starts in `chain`; one more at the end.
    pub(crate) row: Vec<usize>,
    /// Row by row: the dof itself, then the dofs it rides on, nearest first.
    pub(crate) chain: Vec<usize>,
    pub(crate) nv: usize,
    /// Whether some joint has a damper.
    pub(crate) damped: bool,
}

fn rotation<T: Scalar>(quat: Quat<T>) -> Option<Mat3<T>> {
    (quat != Quat::IDENTITY).then(|| quat.matrix())
}

impl<T: Scalar> Plant<T> {
    pub(crate) fn new(model: &Model<T>) -> Self {
        let nonzero = |x: T| x != T::ZERO;
        let mut plant = Self {
            gravity: model.settings.gravity,
            wind: model.settings.wind,
            density: model.settings.density,
            viscosity: model.settings.viscosity,
            links: Vec::with_capacity(model.bodies.len()),
            joints: Vec::with_capacity(model.joints.len()),
            dof_body: Vec::new(),
            armature: Vec::new(),
            fluid_geoms: Vec::new(),
            fluid_bodies: Vec::new(),
            drives: Vec::new(),
            restraints: Vec::new(),
            row: vec![0],
            chain: Vec::new(),
            nv: model.nv(),
            damped: false,
        };
        let weighty = plant.gravity != Vec3::ZERO;
        for (index, body) in model.bodies.iter().enumerate() {
            let first = plant.joints.len();
            let first_dof = plant.dof_body.len();
            for joint in model.joints.iter().filter(|joint| joint.body == index) {
                plant.add_joint(joint);
            }
            let held = body.mass * body.gravity_compensation;
            let inertia = Sym3::rotated_diagonal(&body.principal.matrix(), body.inertia);
            plant.links.push(Link {
                parent: body.parent,
                root: if body.parent == 0 { index } else { plant.links[body.parent].root },
                pos: body.pos,
                rot: rotation(body.quat),
                quat: body.quat,
                mass: body.mass,
                com: body.com,
                inertia,
                held_mass: (weighty && nonzero(held)).then_some(held),
                joints: first..plant.joints.len(),
                dofs: first_dof..plant.dof_body.len(),
            });
            plant.add_rows(index);
        }
        plant.add_fluid(model);
        plant.drives = model.actuators.iter().map(|actuator| drive(model, actuator)).collect();
        plant
    }

    /// A free body that carries nothing that moves, of which MuJoCo's implicitfast treats the rotation apart.
    pub(crate) fn lone_free_body(&self) -> Option<usize> {
        (1..self.links.len()).find(|&index| {
            let link = &self.links[index];
            link.dofs.len() == 6
                && self.joints[link.joints.start].kind == JointKind::Free
                && self
                    .links
                    .iter()
                    .all(|other| other.root != index || other.dofs.is_empty() || other.dofs == link.dofs)
        })
    }

    fn add_joint(&mut self, joint: &crate::model::Joint<T>) {
        let nonzero = |x: T| x != T::ZERO;
        let damped = joint.damping.into_iter().any(nonzero);
        self.damped |= damped;
        for k in 0..joint.kind.nv() {
            let dof = joint.dof_address + k;
            self.dof_body.push(joint.body);
            self.armature.push(joint.armature);
            if nonzero(joint.friction_loss) {
                self.restraints.push(Restraint::Friction { dof, loss: joint.friction_loss });
            }
        }
        if let Some(range) = joint.limit {
            self.restraints.push(Restraint::Limit { q: joint.qpos_address, dof: joint.dof_address, range });
        }
        self.joints.push(JointPlan {
            kind: joint.kind,
            q: joint.qpos_address,
            dof: joint.dof_address,
            pos: (joint.pos != Vec3::ZERO).then_some(joint.pos),
            axis: joint.axis,
            reference: joint.reference,
            spring_reference: joint.spring_reference,
            stiffness: joint.stiffness,
            springy: joint.stiffness.into_iter().any(nonzero),
            damping: joint.damping,
            damped,
        });
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

    fn add_fluid(&mut self, model: &Model<T>) {
        // a vacuum exerts no force
        if self.density == T::ZERO && self.viscosity == T::ZERO {
            return;
        }
        for (index, body) in model.bodies.iter().enumerate().skip(1) {
            // MuJoCo's threshold below which a body feels no water
            if !T::from_f64(1e-15).less(body.mass).any() {
                continue;
            }
            let before = self.fluid_geoms.len();
            for geom in model.geoms.iter().filter(|geom| geom.body == index) {
                if let Some(coefficients) = geom.fluid {
                    self.fluid_geoms.push(FluidGeom {
                        body: index,
                        pos: geom.pos,
                        rot: rotation(geom.quat),
                        shape: Ellipsoid::new(shape::semi_axes(geom.kind, geom.size), coefficients),
                    });
                }
            }
            if self.fluid_geoms.len() == before {
                self.fluid_bodies.push(FluidBody {
                    body: index,
                    principal: body.principal.matrix(),
                    shape: InertiaBox::new(body.mass, body.inertia),
                });
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
        gain,
        stiffness,
        damping: -actuator.kv,
        command_range: actuator.command_range,
        force_range: actuator.force_range,
    }
}
