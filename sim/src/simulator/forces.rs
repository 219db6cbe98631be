//! Every force of one state, apart.

use super::Engine;
use crate::causes::Moment;
use crate::dynamics::plant::Plant;
use crate::dynamics::stages::Stages;
use crate::dynamics::{Work, actuation, bias, fluid, passive, tendon};
use crate::model::State;
use crate::scalar::Scalar;

/// The generalized forces at one state, shape (nv) each, with MuJoCo's signs.
#[derive(Debug, Clone, PartialEq)]
pub struct Forces<T> {
    /// Bias: gravity, Coriolis and centrifugal terms; the other forces count with the opposite sign.
    pub bias: Vec<T>,
    /// Forces of the joints' springs, and of tendons.
    pub spring: Vec<T>,
    /// Forces of the joints' dampers.
    pub damper: Vec<T>,
    /// Forces of gravity compensation, which stands for buoyancy.
    pub gravity_compensation: Vec<T>,
    /// Forces of the water.
    pub fluid: Vec<T>,
    /// Forces of the drives.
    pub actuator: Vec<T>,
    /// Causes beyond MuJoCo ([`crate::causes`]) that act as forces.
    pub effect: Vec<T>,
    /// Friction loss, end stops and contacts.
    pub restraint: Vec<T>,
    /// The resulting acceleration \[rad/s2\] or \[m/s2\].
    pub acceleration: Vec<T>,
}

impl<S: Stages> Engine<S> {
    /// See [`super::Simulator::forces`].
    pub(super) fn forces(&mut self, state: &State<S::T>, command: &[f64]) -> Forces<S::T> {
        let (qpos, qvel) = (&state.qpos, &state.qvel);
        self.moment = Moment::default();
        self.sample(0.0, &|drive, _| S::T::from_f64(command[drive]));
        self.position_stage(qpos);
        let (plant, terms, work) = (&self.plant, &self.terms, &mut self.work);
        bias::velocities(plant, qvel, work);
        work.water = terms.water(self.moment, self.clock, plant);
        let zeros = || vec![S::T::ZERO; plant.nv];
        let mut of_wrenches = |add: &dyn Fn(&Plant<S>, &mut Work<S>)| {
            let mut force = zeros();
            add(plant, work);
            bias::project(plant, work, &mut force);
            force
        };
        let bias: Vec<S::T> = of_wrenches(&bias::bias).into_iter().map(|force| -force).collect();
        let gravity_compensation = of_wrenches(&passive::gravity_compensation);
        let fluid = of_wrenches(&fluid::fluid);
        // what memories hold does not depend on who asks
        let memory = std::cell::RefCell::new(self.memory.clone());
        let mut effect = of_wrenches(&|plant: &Plant<S>, work: &mut Work<S>| {
            terms.wrenches(Moment::default(), plant, work, &mut memory.borrow_mut());
            if let Some(own) = &terms.own {
                own.wrenches(Moment::default(), S::T::ZERO, plant, work);
            }
        });
        terms.forces(qpos, qvel, &mut effect);
        if let Some(own) = &terms.own {
            let now = (Moment::default(), S::T::ZERO);
            own.forces(now, (qpos, qvel), &self.command, &mut effect);
        }
        let (mut spring, mut damper, mut actuator) = (zeros(), zeros(), zeros());
        passive::springs(plant, qpos, &mut spring);
        passive::dampers(plant, qvel, &mut damper);
        tendon::tendons(plant, qpos, qvel, &mut spring);
        actuation::actuation(plant, qpos, qvel, &self.command, &self.off, &mut actuator);

        self.force_stage(qpos, qvel);
        let total = self.force.clone();
        let restraint = (0..total.len())
            .map(|i| {
                total[i]
                    - (spring[i] + damper[i] + gravity_compensation[i] + fluid[i] + effect[i] + actuator[i]
                        - bias[i])
            })
            .collect();
        self.matrix.copy_from_slice(&self.work.mass);
        self.solve_matrix();
        let acceleration = self.force.clone();
        Forces {
            bias,
            spring,
            damper,
            gravity_compensation,
            fluid,
            actuator,
            effect,
            restraint,
            acceleration,
        }
    }
}
