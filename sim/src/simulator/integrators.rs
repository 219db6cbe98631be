//! One step in time, by each of the integrators.

use super::Engine;
use super::engine::Stepper;
use crate::causes::Moment;
use crate::dynamics::stages::{SlopeStage, Stages};
use crate::dynamics::{actuation, integrate, passive};
use crate::model::State;
use crate::scalar::{Scalar, tuned};

impl<S: Stages> Engine<S> {
    /// One step of `h` \[s\] from `time_s`, by the integrator in use.
    pub(super) fn whole(
        &mut self,
        state: &mut State<S::T>,
        time_s: f64,
        h: f64,
        command: &dyn Fn(usize, f64) -> S::T,
    ) {
        match self.stepper {
            Stepper::Euler | Stepper::ImplicitFast => self.euler(state, h),
            Stepper::RungeKutta => self.runge_kutta(state, time_s, h, command),
            Stepper::Rosenbrock => self.rosenbrock(state, time_s, h, command),
        }
    }

    /// Semi-implicit Euler: v += h (M + h B)^-1 f, then q along the new v. B is the slope of the joints' dampers
    /// and, for implicitfast, of the water and the drives too.
    pub(super) fn euler(&mut self, state: &mut State<S::T>, h: f64) {
        self.force_stage(&state.qpos, &state.qvel);
        let h = S::T::from_f64(h);
        self.take_mass();
        if self.plant.damped || self.slope.is_some() {
            // the sums of Runge-Kutta are not in use here
            let (damping, unused) = (&mut self.sum_v, &mut self.sum_a);
            tuned!(S::T, {
                damping.fill(S::T::ZERO);
                passive::slopes(&self.plant, &state.qpos, &state.qvel, damping, unused);
                if self.slope.is_some() {
                    let (qpos, qvel, off) = (&state.qpos, &state.qvel, &self.off);
                    actuation::slopes(&self.plant, qpos, qvel, &self.command, off, damping, unused);
                }
                for (dof, &damping) in damping.iter().enumerate() {
                    self.matrix[self.plant.row[dof]] += h * damping;
                }
            });
        }
        let mut alone = Vec::new();
        // a constant: lanes, which are never stepped so, are spared the program
        if S::T::LANES == 1
            && let Some(slope) = &mut self.slope
        {
            slope.add(&self.plant, &self.work, h, &mut self.matrix);
            alone = slope.alone((&self.plant, &self.work), &state.qvel, h, &self.matrix, &self.force);
        }
        self.solve_matrix();
        for (first, accelerations) in alone {
            self.force[first..first + accelerations.len()].copy_from_slice(&accelerations);
        }
        tuned!(S::T, {
            for (v, &a) in state.qvel.iter_mut().zip(&self.force) {
                *v += h * a;
            }
            integrate::advance(&self.plant, &state.qpos, &state.qvel, h, &mut self.next_qpos);
        });
        state.qpos.copy_from_slice(&self.next_qpos);
    }

    /// The classical fourth order, everything explicit.
    pub(super) fn runge_kutta(
        &mut self,
        state: &mut State<S::T>,
        time_s: f64,
        h: f64,
        command: &dyn Fn(usize, f64) -> S::T,
    ) {
        // shares of the step at which the next stage stands, and weights in the sum
        const STAGES: [(f64, f64); 4] =
            [(0.5, 1.0 / 6.0), (0.5, 1.0 / 3.0), (1.0, 1.0 / 3.0), (0.0, 1.0 / 6.0)];
        let mut stage = std::mem::replace(&mut self.stage, State { qpos: Vec::new(), qvel: Vec::new() });
        stage.qpos.copy_from_slice(&state.qpos);
        stage.qvel.copy_from_slice(&state.qvel);
        self.sum_v.fill(S::T::ZERO);
        self.sum_a.fill(S::T::ZERO);
        for (k, (ahead, weight)) in STAGES.into_iter().enumerate() {
            if k > 0 {
                self.position_stage(&stage.qpos);
            }
            self.force_stage(&stage.qpos, &stage.qvel);
            self.accelerate();
            tuned!(S::T, {
                self.rate.copy_from_slice(&stage.qvel);
                if k > 0 {
                    integrate::follow_turn(&self.plant, &self.turned, &mut self.rate);
                }
                let weight = S::T::from_f64(weight);
                for dof in 0..self.plant.nv {
                    self.sum_v[dof] += weight * self.rate[dof];
                    self.sum_a[dof] += weight * self.force[dof];
                }
                if k < 3 {
                    let forward = S::T::from_f64(ahead * h);
                    integrate::advance(&self.plant, &state.qpos, &self.rate, forward, &mut stage.qpos);
                    for dof in 0..self.plant.nv {
                        self.turned[dof] = forward * self.rate[dof];
                        stage.qvel[dof] = state.qvel[dof] + forward * self.force[dof];
                    }
                }
            });
            if k < 3 {
                let elapsed_s = ahead * h;
                self.moment = Moment { time_s: time_s + elapsed_s, elapsed_s, arrived_s: None };
            }
            if k < 3 && !self.hold_command {
                self.sample(time_s + ahead * h, command);
            }
        }
        tuned!(S::T, {
            let h = S::T::from_f64(h);
            integrate::advance(&self.plant, &state.qpos, &self.sum_v, h, &mut self.next_qpos);
            for (v, &a) in state.qvel.iter_mut().zip(&self.sum_a) {
                *v += h * a;
            }
        });
        state.qpos.copy_from_slice(&self.next_qpos);
        self.stage = stage;
    }
}
