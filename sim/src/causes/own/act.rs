//! Causes of one's own at work: in a step, and in the picture.

use super::program::{Program, VARIABLES, Values, Variable};
use super::{Acts, Own, Place};
use crate::causes::hooks::Moment;
use crate::causes::water::shapes::force_at;
use crate::dynamics::Work;
use crate::dynamics::plant::Plant;
use crate::math::{Vec3, Vector};
use crate::model::Model;
use crate::scalar::{Scalar, tuned};
use crate::space::Space;

/// Step of the central difference that gives a joint's stiffness \[rad\] or \[m\] (chosen).
const STIFFNESS_DIFFERENCE_STEP: f64 = 1e-4;
/// At rates below this, the damping is that at this rate \[rad/s\] or \[m/s\] (chosen).
const DAMPING_RATE_MIN: f64 = 1e-3;

/// A torque on a joint.
#[derive(Debug, Clone)]
struct AtJoint<T> {
    q: usize,
    dof: usize,
    /// The actuator that drives it.
    drive: Option<usize>,
    program: &'static Program,
    parameters: Vec<T>,
}

/// Forces on a point of a body.
#[derive(Debug, Clone)]
struct AtBody<S: Space> {
    body: usize,
    /// The point in the body's axes, as the model and as its space has it \[m\].
    own: Vec3<S::T>,
    point: S::Vec,
    /// The body's x axis.
    along: S::Vec,
    /// Along which of the world's axes, and how much.
    forces: Vec<(usize, &'static Program)>,
    asked: [bool; VARIABLES],
    parameters: Vec<S::T>,
}

/// The causes of its own that a model carries and that act in a step.
#[derive(Debug, Clone)]
pub(crate) struct Acting<S: Space> {
    joints: Vec<AtJoint<S::T>>,
    bodies: Vec<AtBody<S>>,
    /// The world's axes.
    axes: [S::Vec; 3],
    /// A turn that counts as positive in the picture.
    turn: S::Spin,
}

fn carried<T: Scalar>(model: &Model<T>) -> impl Iterator<Item = (&'static Own, &[T])> {
    model.causes().iter().filter_map(|carried| Some((carried.cause().as_own()?, carried.values())))
}

impl<S: Space> Acting<S> {
    /// Those of `model`; `None` where there are none.
    pub(crate) fn new(model: &Model<S::T>, plant: &Plant<S>) -> Option<Box<Self>> {
        let unit = |k: usize| Vec3::constant(std::array::from_fn(|i| if i == k { 1.0 } else { 0.0 }));
        let mut acting = Self {
            joints: Vec::new(),
            bodies: Vec::new(),
            axes: std::array::from_fn(|k| S::vector(&plant.layout, 0, unit(k))),
            turn: S::spin(&plant.layout, 0, Vec3::constant([0.0, -1.0, 0.0])),
        };
        for (own, values) in carried(model) {
            // a model in which the element is missing has not come to know the cause
            match &own.definition.place {
                Place::Joint(name) => {
                    let found = model.joints.iter().position(|joint| joint.name == *name);
                    let Some(place) = found else { continue };
                    acting.joints.extend(own.programs.iter().map(|(_, program)| AtJoint {
                        q: model.joints[place].qpos_address,
                        dof: model.joints[place].dof_address,
                        drive: model.actuators.iter().position(|actuator| actuator.joint == place),
                        program,
                        parameters: values.to_vec(),
                    }));
                }
                Place::Body { body: name, point_m } => {
                    let Some(body) = model.bodies.iter().position(|body| body.name == *name) else {
                        continue;
                    };
                    let asks = |variable| own.programs.iter().any(|(_, program)| program.asks(variable));
                    let at = Vec3::constant(*point_m);
                    acting.bodies.push(AtBody {
                        body,
                        own: at,
                        point: S::vector(&plant.layout, body, at),
                        along: S::vector(&plant.layout, body, unit(0)),
                        forces: own
                            .programs
                            .iter()
                            .filter_map(|(acts, program)| match acts {
                                Acts::Force(axis) => Some((*axis, program)),
                                Acts::Torque | Acts::Shift(_) => None,
                            })
                            .collect(),
                        asked: Variable::ALL.map(asks),
                        parameters: values.to_vec(),
                    });
                }
                Place::Keypoint(_) => {}
            }
        }
        (!acting.joints.is_empty() || !acting.bodies.is_empty()).then(|| Box::new(acting))
    }

    /// Adds the wrenches on the bodies; velocities are known.
    #[inline(never)]
    pub(crate) fn wrenches(&self, moment: Moment, clock: S::T, plant: &Plant<S>, work: &mut Work<S>) {
        for at in &self.bodies {
            let force = tuned!(S::T, {
                let values = self.values(at, moment, clock, plant, work);
                let mut force = S::Vec::ZERO;
                for &(axis, program) in &at.forces {
                    force += self.axes[axis] * program.value(&values, &at.parameters);
                }
                force
            });
            tuned!(S::T, {
                let body = at.body;
                let root = work.pos[plant.links[body].root];
                let arm = work.pos[body] + S::apply(&work.rot[body], at.point) - root;
                work.wrench[body] += force_at(force, arm);
            });
        }
    }

    /// Where and how fast the point of `at` is, as far as somebody asks.
    #[inline(always)]
    fn values(
        &self,
        at: &AtBody<S>,
        moment: Moment,
        clock: S::T,
        plant: &Plant<S>,
        work: &Work<S>,
    ) -> Values<S::T> {
        let asks = |variable: Variable| at.asked[variable as usize];
        let body = at.body;
        let motion = work.velocity[body];
        let world = work.pos[body] + S::apply(&work.rot[body], at.point);
        let velocity = motion.lin + S::cross(motion.ang, world - work.pos[plant.links[body].root]);
        // the depth is no velocity
        let place = S::lift(&plant.layout, body, at.own, world);
        let depth = S::lift(&plant.layout, body, at.own, S::Vec::ZERO);
        let moving = S::lift(&plant.layout, body, at.own, velocity);
        let mut values = [S::T::ZERO; VARIABLES];
        for k in 0..3 {
            values[Variable::X as usize + k] = place[k];
            values[Variable::Vx as usize + k] = moving[k] - depth[k];
        }
        if asks(Variable::Angle) {
            let along = S::apply(&work.rot[body], at.along);
            values[Variable::Angle as usize] = self.axes[2].dot(along).atan2(self.axes[0].dot(along));
        }
        values[Variable::Rate as usize] = self.turn.dot(motion.ang);
        values[Variable::T as usize] = S::T::from_f64(moment.time_s) + clock;
        values
    }

    /// Adds the forces on the degrees of freedom, where the actuators have the commands `command`.
    #[inline(never)]
    pub(crate) fn forces(
        &self,
        (moment, clock): (Moment, S::T),
        (qpos, qvel): (&[S::T], &[S::T]),
        command: &[S::T],
        force: &mut [S::T],
    ) {
        for at in &self.joints {
            let values = at.values(moment, clock, qpos, qvel, command);
            let torque = at.program.value(&values, &at.parameters);
            tuned!(S::T, force[at.dof] += torque);
        }
    }

    /// Adds about how fast these fall with the rate, as if the joint went on to rest along a straight line, and with the coordinate.
    #[inline(never)]
    pub(crate) fn slopes(
        &self,
        (moment, clock): (Moment, S::T),
        (qpos, qvel): (&[S::T], &[S::T]),
        command: &[S::T],
        damping: &mut [S::T],
        stiffness: &mut [S::T],
    ) {
        let (q, v) = (Variable::Q as usize, Variable::V as usize);
        for at in &self.joints {
            let values = at.values(moment, clock, qpos, qvel, command);
            let torque = |values: &Values<S::T>| at.program.value(values, &at.parameters);
            if at.program.asks(Variable::V) {
                let [mut moving, mut still] = [values; 2];
                tuned!(S::T, {
                    let slow = S::T::from_f64(DAMPING_RATE_MIN);
                    moving[v] = S::T::select(values[v].abs().less(slow), slow, values[v]);
                    still[v] = S::T::ZERO;
                });
                let (fast, none) = (torque(&moving), torque(&still));
                tuned!(S::T, damping[at.dof] += (none - fast) / moving[v]);
            }
            if at.program.asks(Variable::Q) {
                let [mut before, mut after] = [values; 2];
                tuned!(S::T, {
                    let nudge = S::T::from_f64(0.5 * STIFFNESS_DIFFERENCE_STEP);
                    before[q] = values[q] - nudge;
                    after[q] = values[q] + nudge;
                });
                let (before, after) = (torque(&before), torque(&after));
                tuned!(
                    S::T,
                    stiffness[at.dof] += (before - after) * S::T::from_f64(1.0 / STIFFNESS_DIFFERENCE_STEP)
                );
            }
        }
    }
}

impl<T: Scalar> AtJoint<T> {
    fn values(&self, moment: Moment, clock: T, qpos: &[T], qvel: &[T], command: &[T]) -> Values<T> {
        tuned!(T, {
            let mut values = [T::ZERO; VARIABLES];
            values[Variable::Q as usize] = qpos[self.q];
            values[Variable::V as usize] = qvel[self.dof];
            values[Variable::T as usize] = T::from_f64(moment.time_s) + clock;
            if let Some(drive) = self.drive {
                values[Variable::Command as usize] = command[drive];
            }
            values
        })
    }
}

/// A keypoint that the camera takes for another place.
#[derive(Debug, Clone)]
struct Shift<T> {
    point: usize,
    along: Vec<(usize, &'static Program)>,
    parameters: Vec<T>,
}

/// The causes of its own that a model carries and that act in the picture.
#[derive(Debug, Clone)]
pub(crate) struct Shifts<T> {
    list: Vec<Shift<T>>,
}

impl<T: Scalar> Shifts<T> {
    /// Those of `model`.
    pub(crate) fn new(model: &Model<T>) -> Self {
        let keypoints = model.keypoints();
        let shift = |(own, values): (&'static Own, &[T])| {
            let Place::Keypoint(name) = &own.definition.place else { return None };
            let along = own.programs.iter().filter_map(|(acts, program)| match acts {
                Acts::Shift(axis) => Some((*axis, program)),
                Acts::Torque | Acts::Force(_) => None,
            });
            let point = keypoints.iter().position(|keypoint| keypoint == name)?;
            Some(Shift { point, along: along.collect(), parameters: values.to_vec() })
        };
        Self { list: carried(model).filter_map(shift).collect() }
    }

    /// Whether there is none.
    pub(crate) fn is_empty(&self) -> bool {
        self.list.is_empty()
    }

    /// Where `point`, at `at` \[m\], is taken to be in the image of `time_s` \[s\].
    pub(crate) fn see(&self, point: usize, time_s: f64, at: [T; 3]) -> [T; 3] {
        let mut shifted = at;
        for shift in self.list.iter().filter(|shift| shift.point == point) {
            let mut values = [T::ZERO; VARIABLES];
            values[Variable::X as usize..=Variable::Z as usize].copy_from_slice(&at);
            values[Variable::T as usize] = T::from_f64(time_s);
            for &(axis, program) in &shift.along {
                shifted[axis] += program.value(&values, &shift.parameters);
            }
        }
        shifted
    }
}
