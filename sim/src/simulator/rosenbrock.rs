//! A Rosenbrock method: linearly implicit, for stiff joints and drives.

use super::Engine;
use crate::causes::Moment;
use crate::dynamics::plant::Plant;
use crate::dynamics::stages::Stages;
use crate::dynamics::{actuation, inertia, integrate, passive, tendon};
use crate::model::State;
use crate::scalar::{Mask, Scalar, tuned};

/// Stages of a step.
const STAGES: usize = 4;
/// ROS34PW2 of Rang and Angermann (New Rosenbrock W-methods of order 3 for partial differential algebraic equations of
/// index 1, 2005): third order whatever stands for the slopes, stiffly accurate. What each stage's state takes from
/// the stages before it,
const ALPHA: [[f64; STAGES]; STAGES] = [
    [0.0; STAGES],
    [0.871_733_043_016_918, 0.0, 0.0, 0.0],
    [0.844_570_600_153_694_2, -0.112_990_642_364_841_85, 0.0, 0.0],
    [0.0, 0.0, 1.0, 0.0],
];
/// what the slopes act on besides the stage itself,
const GAMMA: [[f64; STAGES]; STAGES] = [
    [0.0; STAGES],
    [-0.871_733_043_016_918, 0.0, 0.0, 0.0],
    [-0.903_380_570_130_440_8, 0.054_180_672_388_095_326, 0.0, 0.0],
    [0.242_123_807_060_953_46, -1.223_250_583_904_514_7, 0.545_260_255_335_102_1, 0.0],
];
/// what they act on the stage itself (the diagonal of the second table),
const GAMMA_DIAGONAL: f64 = 0.435_866_521_508_459;
/// and the weights in the sum.
const WEIGHTS: [f64; STAGES] =
    [0.242_123_807_060_953_46, -1.223_250_583_904_514_7, 1.545_260_255_335_102, GAMMA_DIAGONAL];

/// Working memory of a step.
#[derive(Debug, Clone)]
pub(super) struct Rosenbrock<T> {
    /// The factors of M + g h B + (g h)^2 K, and what is there besides the mass matrix, dof by dof.
    factors: Vec<T>,
    shift: Vec<T>,
    /// Slopes of joints, drives and causes there, dof by dof: damping and stiffness, neither below 0.
    damping: Vec<T>,
    stiffness: Vec<T>,
    /// How fast the drives' forces rise because their commands do, dof by dof.
    rise: Vec<T>,
    /// The commands at the end of the step.
    ahead: Vec<T>,
    /// Each stage's share of the way and of the change of velocity.
    way: [Vec<T>; STAGES],
    gain: [Vec<T>; STAGES],
    right: Vec<T>,
}

impl<T: Scalar> Rosenbrock<T> {
    pub(super) fn new<S: Stages<T = T>>(plant: &Plant<S>) -> Self {
        let zeros = |n: usize| vec![T::ZERO; n];
        let stages = || std::array::from_fn(|_| zeros(plant.nv));
        Self {
            factors: zeros(plant.chain.len()),
            shift: zeros(plant.nv),
            damping: zeros(plant.nv),
            stiffness: zeros(plant.nv),
            rise: zeros(plant.nv),
            ahead: zeros(plant.drives.len()),
            way: stages(),
            gain: stages(),
            right: zeros(plant.nv),
        }
    }
}

/// The sum of the stages before `stage`, weighted by its row of `table`, at one dof.
#[inline(always)]
fn before<T: Scalar>(table: &[[f64; STAGES]; STAGES], stage: usize, of: &[Vec<T>; STAGES], dof: usize) -> T {
    let mut sum = T::ZERO;
    for (&share, part) in table[stage][..stage].iter().zip(of) {
        if share != 0.0 {
            sum += T::from_f64(share) * part[dof];
        }
    }
    sum
}

impl<S: Stages> Engine<S> {
    /// One step in four stages, each (M + D) k = h M a + what the slopes make of the stages before, D = g h B + (g h)^2 K; a is
    /// the acceleration at the stage's own state, M, B and K are the mass matrix and the diagonal slopes of joints, drives and
    /// causes at the start of the step. After the first stage (M + D) (k - h a) = -h D a + ... spares the product with M.
    /// Coordinates follow along rotation vectors, as in Runge-Kutta.
    pub(super) fn rosenbrock(
        &mut self,
        state: &mut State<S::T>,
        time_s: f64,
        h: f64,
        command: &dyn Fn(usize, f64) -> S::T,
    ) {
        let Some(mut scratch) = self.rosenbrock.take() else { return };
        let mut stage = std::mem::replace(&mut self.stage, State { qpos: Vec::new(), qvel: Vec::new() });
        for (drive, ahead) in scratch.ahead.iter_mut().enumerate() {
            let told = command(drive, time_s + h);
            // one that is idle from then on goes nowhere until then
            let goes_on = told.abs().less(S::T::from_f64(f64::INFINITY)).any();
            *ahead = if goes_on { told } else { self.command[drive] };
        }
        for k in 0..STAGES {
            if k == 0 {
                self.force_stage(&state.qpos, &state.qvel);
                self.linearise(state, h, &mut scratch);
            } else {
                tuned!(S::T, {
                    for dof in 0..self.plant.nv {
                        self.turned[dof] = before(&ALPHA, k, &scratch.way, dof);
                        stage.qvel[dof] = state.qvel[dof] + before(&ALPHA, k, &scratch.gain, dof);
                    }
                    let (plant, turned) = (&self.plant, &self.turned);
                    integrate::advance(plant, &state.qpos, turned, S::T::ONE, &mut stage.qpos);
                });
                let elapsed_s = ALPHA[k].iter().sum::<f64>() * h;
                self.moment = Moment { time_s: time_s + elapsed_s, elapsed_s, arrived_s: None };
                self.sample(time_s + elapsed_s, command);
                self.position_stage(&stage.qpos);
                self.force_stage(&stage.qpos, &stage.qvel);
                self.accelerate();
            }
            tuned!(S::T, {
                if k == 0 {
                    self.rate.copy_from_slice(&state.qvel);
                } else {
                    self.rate.copy_from_slice(&stage.qvel);
                    integrate::follow_turn(&self.plant, &self.turned, &mut self.rate);
                }
                let share = S::T::from_f64(GAMMA[k].iter().sum::<f64>() + GAMMA_DIAGONAL);
                let (gamma, h) = (S::T::from_f64(GAMMA_DIAGONAL), S::T::from_f64(h));
                for dof in 0..self.plant.nv {
                    let way = before(&GAMMA, k, &scratch.way, dof);
                    let gain = before(&GAMMA, k, &scratch.gain, dof);
                    let ahead = h * (self.rate[dof] + gain);
                    let pull = scratch.damping[dof] * gain + scratch.stiffness[dof] * (way + gamma * ahead);
                    let rise = share * h * scratch.rise[dof];
                    // the force at the first stage, later the acceleration
                    let given = self.force[dof];
                    scratch.right[dof] =
                        rise - pull + if k == 0 { given } else { -(scratch.shift[dof] * given) };
                    scratch.way[k][dof] = ahead;
                }
                for (right, &held) in scratch.right.iter_mut().zip(&self.held) {
                    if held {
                        *right = S::T::ZERO;
                    }
                }
                inertia::solve(&self.plant, &scratch.factors, &mut scratch.right);
                let gamma_h = gamma * h;
                for (dof, &solved) in scratch.right.iter().enumerate() {
                    let gain = h * if k == 0 { solved } else { solved + self.force[dof] };
                    scratch.gain[k][dof] = gain;
                    scratch.way[k][dof] += gamma_h * gain;
                }
            });
        }
        tuned!(S::T, {
            for dof in 0..self.plant.nv {
                let sum = |of: &[Vec<S::T>; STAGES]| {
                    let mut sum = S::T::ZERO;
                    for (part, weight) in of.iter().zip(WEIGHTS) {
                        sum += S::T::from_f64(weight) * part[dof];
                    }
                    sum
                };
                self.turned[dof] = sum(&scratch.way);
                state.qvel[dof] += sum(&scratch.gain);
            }
            let (plant, turned) = (&self.plant, &self.turned);
            integrate::advance(plant, &state.qpos, turned, S::T::ONE, &mut self.next_qpos);
        });
        state.qpos.copy_from_slice(&self.next_qpos);
        self.stage = stage;
        self.rosenbrock = Some(scratch);
    }

    /// Fills `scratch` with the matrices of the step of `h` \[s\] that starts at `state`.
    fn linearise(&mut self, state: &State<S::T>, h: f64, scratch: &mut Rosenbrock<S::T>) {
        tuned!(S::T, {
            for slope in [&mut scratch.damping, &mut scratch.stiffness, &mut scratch.rise] {
                slope.fill(S::T::ZERO);
            }
            let (qpos, qvel, command, off) = (&state.qpos, &state.qvel, &self.command, &self.off);
            let (damping, stiffness) = (&mut scratch.damping, &mut scratch.stiffness);
            passive::slopes(&self.plant, qpos, qvel, damping, stiffness);
            tendon::slopes(&self.plant, qpos, qvel, damping, stiffness);
            actuation::slopes(&self.plant, qpos, qvel, command, off, damping, stiffness);
            self.terms.slopes(qpos, qvel, damping, stiffness);
            if let Some(own) = &self.terms.own {
                own.slopes((self.moment, self.clock), (qpos, qvel), command, damping, stiffness);
            }
            let per_s = S::T::from_f64(1.0 / h);
            actuation::rises(
                &self.plant,
                qpos,
                qvel,
                (command, &scratch.ahead),
                per_s,
                off,
                &mut scratch.rise,
            );
            let gamma_h = S::T::from_f64(GAMMA_DIAGONAL * h);
            for dof in 0..self.plant.nv {
                let (damping, stiffness) = (&mut scratch.damping[dof], &mut scratch.stiffness[dof]);
                *damping = damping.max(S::T::ZERO);
                *stiffness = stiffness.max(S::T::ZERO);
                scratch.shift[dof] = gamma_h * (*damping + gamma_h * *stiffness);
            }
            std::mem::swap(&mut scratch.factors, &mut self.work.mass);
            for (&start, &shift) in self.plant.row.iter().zip(&scratch.shift) {
                scratch.factors[start] += shift;
            }
            inertia::hold(&self.plant, &self.held, &mut scratch.factors);
            inertia::factor(&self.plant, &mut scratch.factors);
        });
    }
}
