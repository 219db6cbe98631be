//! Linearly implicit Euler, extrapolated.

use super::Engine;
use crate::dynamics::plant::Plant;
use crate::dynamics::{actuation, integrate, passive};
use crate::effects::Moment;
use crate::model::State;
use crate::scalar::{Scalar, tuned};
use crate::space::Space;

/// Parts that a step is taken in, one way after the other.
const PARTS: [usize; 3] = [1, 2, 3];
/// How the outcomes are added up: the errors of first and second order in the step cancel.
const WEIGHTS: [f64; 3] = [0.5, -4.0, 4.5];

/// What an extrapolated step remembers.
#[derive(Debug, Clone)]
pub(super) struct Extrapolation<T> {
    /// Mass matrix and forces at the start of the step.
    mass: Vec<T>,
    force: Vec<T>,
    /// Slopes of joints and drives there, dof by dof: damping and stiffness, neither below 0.
    damping: Vec<T>,
    stiffness: Vec<T>,
    sum: State<T>,
}

impl<T: Scalar> Extrapolation<T> {
    pub(super) fn new<S: Space<T = T>>(plant: &Plant<S>, nq: usize) -> Self {
        let zeros = |n: usize| vec![T::ZERO; n];
        Self {
            mass: zeros(plant.chain.len()),
            force: zeros(plant.nv),
            damping: zeros(plant.nv),
            stiffness: zeros(plant.nv),
            sum: State { qpos: zeros(nq), qvel: zeros(plant.nv) },
        }
    }
}

impl<S: Space> Engine<S> {
    /// One step by the parts of [`PARTS`], each v += h (M + h B + h^2 K)^-1 (f - h K v), q along the new v; B and K are the
    /// diagonal slopes of joints and drives at the start of the step. The weighted sum is of third order.
    pub(super) fn extrapolate(
        &mut self,
        state: &mut State<S::T>,
        time_s: f64,
        h: f64,
        command: &dyn Fn(usize, f64) -> S::T,
    ) {
        let Some(mut kept) = self.extrapolation.take() else { return };
        let mut part = std::mem::replace(&mut self.stage, State { qpos: Vec::new(), qvel: Vec::new() });
        self.force_stage(&state.qpos, &state.qvel);
        kept.mass.copy_from_slice(&self.work.mass);
        kept.force.copy_from_slice(&self.force);
        tuned!(S::T, self.slopes(state, &mut kept));
        for (parts, weight) in PARTS.into_iter().zip(WEIGHTS) {
            let shorter = h / parts as f64;
            part.qpos.copy_from_slice(&state.qpos);
            part.qvel.copy_from_slice(&state.qvel);
            for done in 0..parts {
                if done == 0 {
                    self.matrix.copy_from_slice(&kept.mass);
                    self.force.copy_from_slice(&kept.force);
                } else {
                    let elapsed_s = done as f64 * shorter;
                    self.moment = Moment { time_s: time_s + elapsed_s, elapsed_s, arrived_s: None };
                    self.sample(time_s + elapsed_s, command);
                    self.position_stage(&part.qpos);
                    self.force_stage(&part.qpos, &part.qvel);
                    self.matrix.copy_from_slice(&self.work.mass);
                }
                let shorter = S::T::from_f64(shorter);
                tuned!(S::T, {
                    for dof in 0..self.plant.nv {
                        let pull = shorter * kept.stiffness[dof];
                        self.matrix[self.plant.row[dof]] += shorter * (kept.damping[dof] + pull);
                        self.force[dof] -= pull * part.qvel[dof];
                    }
                });
                self.accelerate();
                tuned!(S::T, {
                    for (v, &a) in part.qvel.iter_mut().zip(&self.force) {
                        *v += shorter * a;
                    }
                    integrate::advance(&self.plant, &part.qpos, &part.qvel, shorter, &mut self.next_qpos);
                });
                part.qpos.copy_from_slice(&self.next_qpos);
            }
            tuned!(S::T, {
                let weight = S::T::from_f64(weight);
                for (sum, &x) in kept.sum.qpos.iter_mut().zip(&part.qpos) {
                    *sum = if parts == 1 { weight * x } else { *sum + weight * x };
                }
                for (sum, &x) in kept.sum.qvel.iter_mut().zip(&part.qvel) {
                    *sum = if parts == 1 { weight * x } else { *sum + weight * x };
                }
            });
        }
        state.qpos.copy_from_slice(&kept.sum.qpos);
        state.qvel.copy_from_slice(&kept.sum.qvel);
        integrate::normalise(&self.plant, &mut state.qpos);
        self.stage = part;
        self.extrapolation = Some(kept);
    }

    /// Fills `kept.damping` and `kept.stiffness` at `state`.
    #[inline(always)]
    fn slopes(&self, state: &State<S::T>, kept: &mut Extrapolation<S::T>) {
        kept.damping.fill(S::T::ZERO);
        kept.stiffness.fill(S::T::ZERO);
        passive::slopes(&self.plant, &state.qpos, &state.qvel, &mut kept.damping, &mut kept.stiffness);
        let (qpos, qvel, command) = (&state.qpos, &state.qvel, &self.command);
        actuation::slopes(
            &self.plant,
            qpos,
            qvel,
            command,
            &self.off,
            &mut kept.damping,
            &mut kept.stiffness,
        );
        for slope in kept.damping.iter_mut().chain(&mut kept.stiffness) {
            *slope = slope.max(S::T::ZERO);
        }
    }
}
