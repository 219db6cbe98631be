//! From coordinates and velocities to accelerations, body by body: tips last, tips first, tips last (Featherstone, Rigid Body
//! Dynamics Algorithms, 2008, section 7.3).

use super::Limbs;
use super::articulated::{Across, Flat, ROW, added, yielding};
use super::layout::{Base, Law, Segment, Shape};
use crate::dynamics::plant::Plant;
use crate::dynamics::{Work, bias, fluid, inertia, kinematics, passive};
use crate::math::{Mat3, Vec1, Vec2, Vec3};
use crate::scalar::Scalar;
use crate::space::{Inertia, Motion, Planar, Space, Spatial, Turn, Wrench};

/// A motion across a plane: turn about the axes in it, velocity along the one across.
#[derive(Debug, Clone, Copy)]
struct MotionAcross<T> {
    ang: Vec2<T>,
    lin: T,
}

/// A wrench across a plane: torque about the axes in it, force along the one across.
#[derive(Debug, Clone, Copy)]
struct WrenchAcross<T> {
    torque: Vec2<T>,
    force: T,
}

/// Where a body of a limb is and how it moves, on the limb's axes.
#[derive(Debug, Clone, Copy)]
pub(super) struct Riding<T: Scalar> {
    /// Origin from the limb's.
    at: Vec2<T>,
    /// `limb_from_segment`.
    rot: Turn<T>,
    velocity: Motion<Planar<T>>,
    /// Acceleration with all joint accelerations 0, less gravity: in the plane and across it.
    drift: Motion<Planar<T>>,
    drift_across: MotionAcross<T>,
}

impl<T: Scalar> Riding<T> {
    pub(super) const STILL: Self = Self {
        at: Vec2([T::ZERO; 2]),
        rot: Planar::IDENTITY,
        velocity: Motion::ZERO,
        drift: Motion::ZERO,
        drift_across: MotionAcross { ang: Vec2([T::ZERO; 2]), lin: T::ZERO },
    };
}

/// What all bodies of a limb share, on the limb's axes.
#[derive(Debug, Clone, Copy)]
struct Surroundings<T> {
    velocity: MotionAcross<T>,
    gravity: Vec3<T>,
    water: Vec3<T>,
    density: T,
    viscosity: T,
}

/// The components in the plane.
#[inline(always)]
fn flat<T: Scalar>(Vec3([x, y, _]): Vec3<T>) -> Vec2<T> {
    Vec2([x, y])
}

/// The vector product of `a` in the plane and the vector across it of length `b`.
#[inline(always)]
fn lever<T: Scalar>(Vec2([x, y]): Vec2<T>, b: T) -> Vec2<T> {
    Vec2([y * b, -(x * b)])
}

/// The symmetric matrix `xx yy xy` times a vector.
#[inline(always)]
fn turned<T: Scalar>([xx, yy, xy]: [T; 3], Vec2([x, y]): Vec2<T>) -> Vec2<T> {
    Vec2([xx * x + xy * y, xy * x + yy * y])
}

/// A motion in the plane and across it.
#[inline(always)]
fn split<T: Scalar>(Motion { ang, lin }: Motion<Spatial<T>>) -> (Motion<Planar<T>>, MotionAcross<T>) {
    (Motion { ang: Vec1([ang[2]]), lin: flat(lin) }, MotionAcross { ang: flat(ang), lin: lin[2] })
}

/// A motion on rotated axes.
#[inline(always)]
fn back<T: Scalar>(rot: &Mat3<T>, motion: Motion<Spatial<T>>) -> Motion<Spatial<T>> {
    Motion { ang: rot.apply_transposed(motion.ang), lin: rot.apply_transposed(motion.lin) }
}

/// The velocity of the point `at`, in the plane and across it.
#[inline(always)]
fn at_point<T: Scalar>(velocity: &Motion<Planar<T>>, across: &MotionAcross<T>, at: Vec2<T>) -> (Vec2<T>, T) {
    let Vec1([turned]) = Planar::moment(across.ang, at);
    (velocity.lin + Planar::cross(velocity.ang, at), across.lin + turned)
}

impl<T: Scalar> Limbs<T> {
    /// See [`LimbStage::accelerate`](crate::space::LimbStage::accelerate).
    #[expect(clippy::too_many_arguments, reason = "one stage's inputs")]
    #[inline(always)]
    pub(super) fn articulate(
        &mut self,
        plant: &Plant<Spatial<T>>,
        qpos: &[T],
        qvel: &[T],
        work: &mut Work<Spatial<T>>,
        shift: Option<&[T]>,
        rows: &mut [[T; ROW]],
        force: &mut [T],
    ) {
        let Self { layout, axes, inertias, riding, wrenches, motion } = self;
        bias::ground(plant, work);
        for base in &layout.bases {
            move_base(plant, base, qpos, qvel, work);
            let rot = work.rot[base.link];
            let (velocity, drift) = (back(&rot, work.velocity[base.link]), back(&rot, work.drift[base.link]));
            let (gravity, water) = (rot.apply_transposed(plant.gravity), rot.apply_transposed(work.water));
            let mut felt = base.inertia;
            let mut total = Wrench::ZERO;
            for limb in &layout.limbs[base.limbs.clone()] {
                let (velocity, velocity_across) = split(limb.carried(velocity));
                let (drift, drift_across) = split(limb.carried(drift));
                let around = Surroundings {
                    velocity: velocity_across,
                    gravity: limb.axes.apply(gravity),
                    water: limb.axes.apply(water),
                    density: plant.density,
                    viscosity: plant.viscosity,
                };
                let root = Riding { velocity, drift, drift_across, ..Riding::STILL };

                // tips last: motions, and what the bodies exert
                let mut resists = Across::ZERO;
                let mut pushed_across = WrenchAcross { torque: Vec2([T::ZERO; 2]), force: T::ZERO };
                let segments = &layout.segments[limb.segments.clone()];
                for (k, segment) in segments.iter().enumerate() {
                    let parent = match segment.parent {
                        Some(parent) => &riding[parent],
                        None => &root,
                    };
                    let own = segment.swing(parent, &around, qpos, qvel, &mut axes[k]);
                    let com = own.at + Planar::apply(&own.rot, Vec2::constant(segment.com));
                    let tilting = segment.tilting_at(&own.rot);
                    let moment = com * segment.mass;
                    let rotational = segment.inertia + moment.dot(com);
                    inertias[k] = Flat::of(&Inertia { mass: segment.mass, moment, rotational });
                    resists.carry(moment, com, tilting);

                    let velocity = at_point(&own.velocity, &around.velocity, com);
                    let (mut push, mut push_across) = segment.inertial(&own, &around, com, velocity, tilting);
                    for shape in &layout.shapes[segment.shapes.clone()] {
                        let (more, more_across) = shape.wet(&own, &around, com, velocity);
                        push += more;
                        push_across.torque += more_across.torque;
                        push_across.force += more_across.force;
                    }
                    pushed_across.torque += push_across.torque;
                    pushed_across.force += push_across.force;
                    wrenches[k] = push;
                    riding[k] = own;
                }

                // tips first: what reaches the base
                let mut inertia = Flat::ZERO;
                let mut pushed = Wrench::<Planar<T>>::ZERO;
                for (k, segment) in segments.iter().enumerate().rev() {
                    let (mut own, mut push) = (inertias[k], wrenches[k]);
                    if let Some(hinge) = &segment.hinge {
                        let axis = Motion { ang: Vec1::constant([hinge.axis]), lin: axes[k] };
                        let added = added(plant, shift, hinge.dof);
                        let yielded = yielding(axis, added, force[hinge.dof], own, push);
                        force[hinge.dof] = yielded.rest;
                        rows[hinge.dof] = yielded.row;
                        (own, push) = (yielded.inertia, yielded.wrench);
                    }
                    match segment.parent {
                        Some(parent) => {
                            inertias[parent].add(&own);
                            wrenches[parent] += push;
                        }
                        None => {
                            inertia.add(&own);
                            pushed += push;
                        }
                    }
                }
                felt.add(limb, &inertia, &resists);
                let (Vec2([x, y]), Vec1([z])) = (pushed_across.torque, pushed.torque);
                let Vec2([fx, fy]) = pushed.force;
                total +=
                    limb.felt(Wrench { torque: Vec3([x, y, z]), force: Vec3([fx, fy, pushed_across.force]) });
            }
            let own = &mut work.wrench[base.link];
            *own += Wrench { torque: rot.apply(total.torque), force: rot.apply(total.force) };
            for dof in base.dofs.clone() {
                force[dof] += work.axes[dof].power(*own);
            }
            *own = Wrench::ZERO;
            base.factor(plant, work, shift, &felt, rows);
            let moved = base.solve(rows, force);
            for limb in &layout.limbs[base.limbs.clone()] {
                Self::follow(layout, motion, limb, moved, rows, force);
            }
        }
    }
}

/// Moves a base and adds to its wrench what acts on it alone.
#[inline(always)]
fn move_base<T: Scalar>(
    plant: &Plant<Spatial<T>>,
    base: &Base<T>,
    qpos: &[T],
    qvel: &[T],
    work: &mut Work<Spatial<T>>,
) {
    kinematics::place(plant, base.link, qpos, work);
    inertia::body_inertia(plant, base.link, work);
    bias::velocity(plant, base.link, qvel, work);
    bias::resist(base.link, work);
    passive::hold_up(plant, base.link, work);
    for &geom in &base.geoms {
        fluid::on_geom(plant, &plant.fluid_geoms[geom], work);
    }
    for &body in &base.bodies {
        fluid::on_body(plant, &plant.fluid_bodies[body], work);
    }
}

impl<T: Scalar> Segment<T> {
    /// Swings along with its parent and about its hinge, whose axis goes to `axis`.
    #[inline(always)]
    fn swing(
        &self,
        parent: &Riding<T>,
        around: &Surroundings<T>,
        qpos: &[T],
        qvel: &[T],
        axis: &mut Vec2<T>,
    ) -> Riding<T> {
        let mut own = *parent;
        own.at = parent.at + Planar::apply(&parent.rot, Vec2::constant(self.pos));
        let Some(hinge) = &self.hinge else { return own };
        let angle = qpos[hinge.q] - T::from_f64(hinge.reference);
        let along = Vec1::constant([hinge.axis]);
        own.rot = Planar::swung(&parent.rot, along, None, angle.sin_cos());
        let mut anchor = own.at;
        if let Some(pos) = hinge.pos {
            let pos = Vec2::constant(pos);
            anchor += Planar::apply(&parent.rot, pos);
            own.at = anchor - Planar::apply(&own.rot, pos);
        }
        *axis = Planar::cross(along, -anchor);
        let rate = qvel[hinge.dof];
        let swing = Motion::<Planar<T>> { ang: along * rate, lin: *axis * rate };
        own.drift = parent.drift.and(parent.velocity.cross(swing));
        // the base's turn tilts the hinge
        let tilt = around.velocity.ang;
        own.drift_across.ang += lever(tilt, swing.ang.0[0]);
        own.drift_across.lin += Planar::moment(tilt, swing.lin).0[0];
        own.velocity = parent.velocity.and(swing);
        own
    }

    /// Inertia about the centre of mass, for turns about the limb's axes in the plane: `xx yy xy`.
    #[inline(always)]
    fn tilting_at(&self, rot: &Turn<T>) -> [T; 3] {
        let [mean, difference, product] = self.tilting;
        let double = rot.sin + rot.sin;
        let (cos, sin) = (T::ONE - double * rot.sin, double * rot.cos);
        let along = difference * cos - product * sin;
        [mean + along, mean - along, difference * sin + product * cos]
    }

    /// The wrench that drift and weight call for, reversed (Newton and Euler about the centre of mass at `com`, which moves at
    /// `v`, `v_across`).
    #[inline(always)]
    fn inertial(
        &self,
        own: &Riding<T>,
        around: &Surroundings<T>,
        com: Vec2<T>,
        (v, v_across): (Vec2<T>, T),
        tilting: [T; 3],
    ) -> (Wrench<Planar<T>>, WrenchAcross<T>) {
        let Riding { velocity, drift, drift_across, .. } = own;
        let tilt = around.velocity.ang;
        let (a, a_across) = at_point(drift, drift_across, com);
        let a = a + Planar::cross(velocity.ang, v) + lever(tilt, v_across);
        let a_across = a_across + Planar::moment(tilt, v).0[0];
        let mut force = a * -self.mass;
        let mut force_across = -(a_across * self.mass);
        if let Some(held) = self.held_mass {
            force -= flat(around.gravity) * held;
            force_across -= around.gravity[2] * held;
        }

        let spin = turned(tilting, tilt);
        let torque = drift.ang * self.inertia + Planar::moment(tilt, spin);
        let torque_across = turned(tilting, drift_across.ang)
            + Planar::cross(velocity.ang, spin)
            + lever(tilt, velocity.ang.0[0] * self.inertia);
        (
            Wrench { torque: Planar::moment(com, force) - torque, force },
            WrenchAcross { torque: lever(com, force_across) - torque_across, force: force_across },
        )
    }
}

impl<T: Scalar> Shape<T> {
    /// The water's wrench; the centre of mass is at `com` and moves at `velocity`.
    #[inline(always)]
    fn wet(
        &self,
        own: &Riding<T>,
        around: &Surroundings<T>,
        com: Vec2<T>,
        velocity: (Vec2<T>, T),
    ) -> (Wrench<Planar<T>>, WrenchAcross<T>) {
        let (at, (v, v_across)) = match self.pos {
            Some(pos) => {
                let at = own.at + Planar::apply(&own.rot, Vec2::constant(pos));
                (at, at_point(&own.velocity, &around.velocity, at))
            }
            None => (com, velocity),
        };
        let rot = match self.rot {
            Some([cos, sin]) => {
                Planar::product(&own.rot, &Turn { cos: T::from_f64(cos), sin: T::from_f64(sin) })
            }
            None => own.rot,
        };
        let Vec2([wx, wy]) = Planar::back(&rot, around.velocity.ang);
        let Vec2([vx, vy]) = Planar::back(&rot, v - flat(around.water));
        let w = Vec3([wx, wy, own.velocity.ang.0[0]]);
        let v = Vec3([vx, vy, v_across - around.water[2]]);
        let (torque, force) = match &self.law {
            Law::Ellipsoid(shape) => shape.wrench(around.density, around.viscosity, w, v),
            Law::InertiaBox(shape) => shape.wrench(around.density, around.viscosity, w, v),
        };
        let push = Planar::apply(&rot, flat(force));
        (
            Wrench { torque: Vec1([torque[2]]) + Planar::moment(at, push), force: push },
            WrenchAcross { torque: Planar::apply(&rot, flat(torque)) + lever(at, force[2]), force: force[2] },
        )
    }
}
