//! From coordinates and velocities to forces, one body after the other, tips last; then back.

use super::Limbs;
use super::articulated::{Across, Flat};
use super::layout::{Base, Law, Limb, Segment, Shape};
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
    /// Moves every body and adds what they exert to `force`; keeps what [`Self::factor_rows`] needs.
    #[inline(always)]
    pub(super) fn move_and_push(
        &mut self,
        plant: &Plant<Spatial<T>>,
        qpos: &[T],
        qvel: &[T],
        work: &mut Work<Spatial<T>>,
        force: &mut [T],
    ) {
        bias::ground(plant, work);
        for index in 0..self.layout.bases.len() {
            let base = &self.layout.bases[index];
            let (link, dofs, limbs) = (base.link, base.dofs.clone(), base.limbs.clone());
            move_base(plant, base, qpos, qvel, work);
            let rot = work.rot[link];
            let (velocity, drift) = (back(&rot, work.velocity[link]), back(&rot, work.drift[link]));
            let (gravity, water) = (rot.apply_transposed(plant.gravity), rot.apply_transposed(work.water));
            let mut total = Wrench::ZERO;
            for limb in limbs {
                let axes = &self.layout.limbs[limb].axes;
                let (gravity, water) = (axes.apply(gravity), axes.apply(water));
                let pushed = self.push(plant, limb, (velocity, drift), (gravity, water), qpos, qvel, force);
                total += self.layout.limbs[limb].felt(pushed);
            }
            work.wrench[link] += Wrench { torque: rot.apply(total.torque), force: rot.apply(total.force) };
            for dof in dofs {
                force[dof] += work.axes[dof].power(work.wrench[link]);
            }
            work.wrench[link] = Wrench::ZERO;
        }
    }

    /// Moves the limb `index` along with its base; yields the wrench on its root, about its origin.
    #[expect(clippy::too_many_arguments, reason = "one stage's inputs")]
    #[inline(always)]
    fn push(
        &mut self,
        plant: &Plant<Spatial<T>>,
        index: usize,
        (velocity, drift): (Motion<Spatial<T>>, Motion<Spatial<T>>),
        (gravity, water): (Vec3<T>, Vec3<T>),
        qpos: &[T],
        qvel: &[T],
        force: &mut [T],
    ) -> Wrench<Spatial<T>> {
        let Self { layout, axes, flat: inertias, across, riding, wrench, .. } = self;
        let limb: &Limb<T> = &layout.limbs[index];
        let segments = &layout.segments[limb.segments.clone()];
        let axes = &mut axes[limb.segments.clone()];
        let inertias = &mut inertias[limb.segments.clone()];
        let (velocity, drift) = (limb.carried(velocity), limb.carried(drift));
        let ((velocity, velocity_across), (drift, drift_across)) = (split(velocity), split(drift));
        let (density, viscosity) = (plant.density, plant.viscosity);
        let around = Surroundings { velocity: velocity_across, gravity, water, density, viscosity };
        let root = Riding { velocity, drift, drift_across, ..Riding::STILL };

        let mut resists = Across::ZERO;
        let mut pushed_across = WrenchAcross { torque: Vec2([T::ZERO; 2]), force: T::ZERO };
        for (k, segment) in segments.iter().enumerate() {
            let parent = match segment.parent {
                Some(parent) => &riding[parent],
                None => &root,
            };
            let own = segment.swing(parent, &around, qpos, qvel, &mut axes[k]);
            let com = own.at + Planar::apply(&own.rot, segment.com);
            let tilting = segment.tilting_at(&own.rot);
            let moment = com * segment.mass;
            inertias[k] = Flat::of(&Inertia {
                mass: segment.mass,
                moment,
                rotational: segment.inertia + moment.dot(com),
            });
            let [xx, yy, xy] = tilting;
            resists.moment += moment;
            resists.inertia[0] += xx + moment[1] * com[1];
            resists.inertia[1] += yy + moment[0] * com[0];
            resists.inertia[2] += xy - moment[0] * com[1];

            let (mut push, mut push_across) = segment.inertial(&own, &around, com, tilting);
            for shape in &layout.shapes[segment.shapes.clone()] {
                let (more, more_across) = shape.wet(&own, &around);
                push += more;
                push_across.torque += more_across.torque;
                push_across.force += more_across.force;
            }
            pushed_across.torque += push_across.torque;
            pushed_across.force += push_across.force;
            wrench[k] = push;
            riding[k] = own;
        }
        across[index] = resists;

        let mut pushed = Wrench::<Planar<T>>::ZERO;
        for (k, segment) in segments.iter().enumerate().rev() {
            let push = wrench[k];
            if let Some(hinge) = &segment.hinge {
                force[hinge.dof] += Motion { ang: hinge.axis, lin: axes[k] }.power(push);
            }
            match segment.parent {
                Some(parent) => wrench[parent] += push,
                None => pushed += push,
            }
        }
        let (Vec2([x, y]), Vec1([z])) = (pushed_across.torque, pushed.torque);
        let Vec2([fx, fy]) = pushed.force;
        Wrench { torque: Vec3([x, y, z]), force: Vec3([fx, fy, pushed_across.force]) }
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
        own.at = parent.at + Planar::apply(&parent.rot, self.pos);
        let Some(hinge) = &self.hinge else { return own };
        let angle = qpos[hinge.q] - hinge.reference;
        own.rot = Planar::swung(&parent.rot, hinge.axis, None, angle.sin_cos());
        let mut anchor = own.at;
        if let Some(pos) = hinge.pos {
            anchor += Planar::apply(&parent.rot, pos);
            own.at = anchor - Planar::apply(&own.rot, pos);
        }
        *axis = Planar::cross(hinge.axis, -anchor);
        let rate = qvel[hinge.dof];
        let swing = Motion::<Planar<T>> { ang: hinge.axis * rate, lin: *axis * rate };
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

    /// The wrench that drift and weight call for, reversed (Newton and Euler about the centre of mass at `com`).
    #[inline(always)]
    fn inertial(
        &self,
        own: &Riding<T>,
        around: &Surroundings<T>,
        com: Vec2<T>,
        tilting: [T; 3],
    ) -> (Wrench<Planar<T>>, WrenchAcross<T>) {
        let Riding { velocity, drift, drift_across, .. } = own;
        let tilt = around.velocity.ang;
        let (v, v_across) = at_point(velocity, &around.velocity, com);
        let (a, a_across) = at_point(drift, drift_across, com);
        let a = a + Planar::cross(velocity.ang, v) + lever(tilt, v_across);
        let a_across = a_across + Planar::moment(tilt, v).0[0];
        let mut force = a * -self.mass;
        let mut force_across = -(a_across * self.mass);
        if let Some(held) = self.held_mass {
            force = force - flat(around.gravity) * held;
            force_across = force_across - around.gravity[2] * held;
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
    /// The water's wrench.
    #[inline(always)]
    fn wet(&self, own: &Riding<T>, around: &Surroundings<T>) -> (Wrench<Planar<T>>, WrenchAcross<T>) {
        let at = own.at + Planar::apply(&own.rot, self.pos);
        let rot = match &self.rot {
            Some(rot) => Planar::product(&own.rot, rot),
            None => own.rot,
        };
        let (v, v_across) = at_point(&own.velocity, &around.velocity, at);
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
