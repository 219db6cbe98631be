//! Stage 7: friction loss and end stops, as MuJoCo has them.
//!
//! Each is a force on one dof, f = clip(-(s a - a_ref) / R, low, high), solved jointly with M a = smooth + s f.
//! A small R > 0 makes the force unique and lets stiction creep.

use super::Work;
use super::inertia::{factor, hold, solve};
use super::plant::{Plant, Restraint};
use crate::scalar::{Mask, Scalar};
use crate::space::Space;

/// The fastest rate of a restraint of MuJoCo's default softness \[1/s\].
const USUAL_RATE_PER_S: f64 = 2.0 / (0.95 * 0.02);
/// Longest step of our own that restraints of that softness bear \[s\]. What friction holds comes to rest at up to
/// [`USUAL_RATE_PER_S`] = 105 1/s, and both methods take that explicitly: along a real decay the explicit part
/// of ROS34PW2 is stable up to 1.99 / 105 s = 18.9 ms, Runge-Kutta up to 2.79 / 105 s = 26.5 ms. In longer steps the joint stays
/// where it is, because the force has bounds, but its derivatives grow from step to step.
pub(crate) const LONGEST_STEP_S: f64 = 0.016;
/// Full Newton steps before the first search along a step (chosen): they converge at once in all but rare cases.
const FULL_NEWTON_STEPS: usize = 6;
/// Most Newton steps (chosen); the exact search makes them end after finitely many.
const NEWTON_STEPS_MAX: usize = 60;

/// Longest step of our own that constraints bear \[s\] whose rates are `rates_per_s`.
pub(crate) fn longest_step_s(rates_per_s: impl Iterator<Item = f64>) -> f64 {
    LONGEST_STEP_S * USUAL_RATE_PER_S / rates_per_s.fold(USUAL_RATE_PER_S, f64::max)
}

/// One force on one dof.
#[derive(Debug, Clone)]
struct Row<T> {
    dof: usize,
    /// Its place among the zones that are watched.
    place: usize,
    /// +1 or -1.
    sign: T,
    /// 1 / R.
    weight: T,
    reference: T,
    low: T,
    high: T,
}

impl<T: Scalar> Row<T> {
    /// The force at the acceleration `a` of its dof.
    #[inline(always)]
    fn force(&self, a: T) -> T {
        ((self.reference - self.sign * a) * self.weight).clamp(self.low, self.high)
    }

    /// The zone the row is in at the acceleration `a`, by its line: force = first - sign second a.
    #[inline(always)]
    fn zone(&self, a: T) -> [T; 2] {
        let free = (self.reference - self.sign * a) * self.weight;
        let slack = self.low.less(free) & free.less(self.high);
        let bound = free.clamp(self.low, self.high);
        [T::select(slack, self.reference * self.weight, bound), T::select(slack, self.weight, T::ZERO)]
    }

    /// -1 where the force is at its lower bound, 1 at the upper one, 0 between.
    #[inline(always)]
    fn side(&self, a: T) -> T {
        let free = (self.reference - self.sign * a) * self.weight;
        let above = T::select(free.less(self.high), T::ZERO, T::ONE);
        T::select(self.low.less(free), above, -T::ONE)
    }
}

/// Solves for the forces of all restraints of a model.
#[derive(Debug, Clone)]
pub(crate) struct Solver<T: Scalar> {
    /// Diagonal of the inverse mass matrix at the reference, averaged over a joint's like axes.
    inverse_weight: Vec<T>,
    rows: Vec<Row<T>>,
    zones: Vec<[T; 2]>,
    matrix: Vec<T>,
    acceleration: Vec<T>,
    step: Vec<T>,
    /// M a - smooth, and M step.
    residual: [Vec<T>; 2],
    /// Which side of its bounds each force is on, two places for each restraint: now, and when a step began.
    sides: [Vec<T>; 2],
    /// The lanes where some force has changed sides since.
    changed: T::Mask,
}

impl<T: Scalar> Solver<T> {
    /// `inverse_weight`: shape (nv).
    pub(crate) fn new<S: Space<T = T>>(plant: &Plant<S>, inverse_weight: Vec<T>) -> Self {
        let most = 2 * plant.restraints.len();
        let zeros = || vec![T::ZERO; plant.nv];
        Self {
            inverse_weight,
            rows: Vec::with_capacity(most),
            zones: vec![[T::ZERO; 2]; most],
            matrix: vec![T::ZERO; plant.chain.len()],
            acceleration: zeros(),
            step: zeros(),
            residual: [zeros(), zeros()],
            sides: [vec![-T::ONE; most], vec![-T::ONE; most]],
            changed: T::ZERO.less(T::ZERO),
        }
    }

    /// Longest step of our own that the restraints of `plant` bear \[s\].
    pub(crate) fn longest_step_s<S: Space<T = T>>(plant: &Plant<S>) -> f64 {
        longest_step_s(plant.restraints.iter().map(|restraint| match restraint {
            Restraint::Friction { softness, .. } | Restraint::Limit { softness, .. } => softness.rate_per_s(),
        }))
    }

    /// Notes which side of its bounds each force is on, as [`Self::resolve`] found it; `first` in a step.
    #[inline(always)]
    pub(crate) fn watch(&mut self, first: bool) {
        let [now, before] = &mut self.sides;
        // an end stop that no lane touches has no row
        now.fill(-T::ONE);
        for row in &self.rows {
            now[row.place] = row.side(self.acceleration[row.dof]);
        }
        if first {
            before.copy_from_slice(now);
            self.changed = T::ZERO.less(T::ZERO);
        } else {
            for (&now, &before) in now.iter().zip(before.iter()) {
                self.changed = self.changed | now.less(before) | before.less(now);
            }
        }
    }

    /// The lanes where a joint has come to stand, broken loose, turned, or touched or left an end stop since the step began:
    /// accelerations have a corner there.
    pub(crate) fn changed(&self) -> T::Mask {
        self.changed
    }

    #[inline(always)]
    pub(super) fn add_rows<S: Space<T = T>>(
        &mut self,
        plant: &Plant<S>,
        qpos: &[T],
        qvel: &[T],
        held: &[bool],
        h: f64,
    ) {
        self.rows.clear();
        for (index, restraint) in plant.restraints.iter().enumerate() {
            match *restraint {
                Restraint::Friction { dof, .. } | Restraint::Limit { dof, .. } if held[dof] => {}
                Restraint::Friction { dof, loss, softness } => {
                    let impedance: f64 = softness.impedance(0.0);
                    self.rows.push(Row {
                        dof,
                        place: 2 * index,
                        sign: T::ONE,
                        weight: T::from_f64(impedance / (1.0 - impedance)) / self.inverse_weight[dof],
                        reference: -T::from_f64(softness.spring(h)[1]) * qvel[dof],
                        low: -loss,
                        high: loss,
                    });
                }
                Restraint::Limit { q, dof, range, margin, softness } => {
                    let [stiffness, damping] = softness.spring(h).map(T::from_f64);
                    let margin = T::from_f64(margin);
                    let ends = [(T::ONE, qpos[q] - range[0]), (-T::ONE, range[1] - qpos[q])];
                    for (end, (sign, distance)) in ends.into_iter().enumerate() {
                        let distance = distance - margin;
                        let beyond = distance.less(T::ZERO);
                        if !beyond.any() {
                            continue;
                        }
                        let impedance = softness.impedance(distance);
                        let weight = impedance / ((T::ONE - impedance) * self.inverse_weight[dof]);
                        self.rows.push(Row {
                            dof,
                            place: 2 * index + end,
                            sign,
                            weight: T::select(beyond, weight, T::ZERO),
                            reference: -(damping * sign * qvel[dof] + stiffness * impedance * distance),
                            low: T::ZERO,
                            high: T::from_f64(f64::MAX),
                        });
                    }
                }
            }
        }
    }

    /// What [`Self::add_rows`] made, for whoever solves for more than restraints: dof, sign, reference acceleration, 1 / R and
    /// bounds of the force.
    pub(super) fn bounded(&self) -> impl Iterator<Item = (usize, T, T, T, [T; 2])> {
        self.rows.iter().map(|row| (row.dof, row.sign, row.reference, row.weight, [row.low, row.high]))
    }

    /// Takes the accelerations that they found, shape (nv).
    pub(super) fn settle(&mut self, acceleration: &[T]) {
        self.acceleration.copy_from_slice(acceleration);
    }

    /// Adds the restraints' forces to `force`, which comes in as the sum of all others.
    #[expect(clippy::too_many_arguments, reason = "one stage's inputs")]
    #[inline(always)]
    pub(crate) fn resolve<S: Space<T = T>>(
        &mut self,
        plant: &Plant<S>,
        work: &Work<S>,
        held: &[bool],
        h: f64,
        qpos: &[T],
        qvel: &[T],
        force: &mut [T],
    ) {
        self.add_rows(plant, qpos, qvel, held, h);
        if self.rows.is_empty() {
            return;
        }
        // starts from the last solution: the zones seldom change from one step to the next, and where the
        // search ends does not depend on where it starts
        for round in 0..NEWTON_STEPS_MAX {
            // the zone each row is in, and the step to the optimum if all stay in theirs
            self.matrix.copy_from_slice(&work.mass);
            self.step.copy_from_slice(force);
            let mut moved = round == 0;
            for (row, stored) in self.rows.iter().zip(&mut self.zones) {
                let zone = row.zone(self.acceleration[row.dof]);
                moved |= zone[0] != stored[0] || zone[1] != stored[1];
                *stored = zone;
                self.matrix[plant.row[row.dof]] += zone[1];
                self.step[row.dof] += row.sign * zone[0];
            }
            if !moved {
                break;
            }
            hold(plant, held, &mut self.matrix);
            factor(plant, &mut self.matrix);
            solve(plant, &self.matrix, &mut self.step);
            if round < FULL_NEWTON_STEPS {
                self.acceleration.copy_from_slice(&self.step);
            } else {
                self.search(plant, work, force);
            }
        }
        for row in &self.rows {
            force[row.dof] += row.sign * row.force(self.acceleration[row.dof]);
        }
    }

    /// Goes from `acceleration` towards `step` to where the cost is least along the way.
    #[inline(always)]
    fn search<S: Space<T = T>>(&mut self, plant: &Plant<S>, work: &Work<S>, force: &[T]) {
        for (step, a) in self.step.iter_mut().zip(&self.acceleration) {
            *step -= *a;
        }
        let [at_start, change] = &mut self.residual;
        multiply(plant, &work.mass, &self.acceleration, at_start);
        multiply(plant, &work.mass, &self.step, change);
        let (mut constant, mut slope) = (T::ZERO, T::ZERO);
        for dof in 0..self.step.len() {
            constant += (at_start[dof] - force[dof]) * self.step[dof];
            slope += change[dof] * self.step[dof];
        }
        let (mut low, mut high) = (T::ZERO, T::ONE);
        for _ in 0..52 {
            let middle = (low + high) * T::from_f64(0.5);
            let mut pushes = T::ZERO;
            for row in &self.rows {
                let p = self.step[row.dof];
                pushes += row.sign * p * row.force(self.acceleration[row.dof] + middle * p);
            }
            let falling = (constant + middle * slope).less(pushes);
            low = T::select(falling, middle, low);
            high = T::select(falling, high, middle);
        }
        for (a, &p) in self.acceleration.iter_mut().zip(&self.step) {
            *a += high * p;
        }
    }
}

/// `out` = the symmetric matrix, stored by rows of [`Plant::chain`], times `x`.
#[inline(always)]
pub(crate) fn multiply<S: Space>(plant: &Plant<S>, matrix: &[S::T], x: &[S::T], out: &mut [S::T]) {
    out.fill(S::T::ZERO);
    for dof in 0..plant.nv {
        let start = plant.row[dof];
        out[dof] += matrix[start] * x[dof];
        let row = start + 1..plant.row[dof + 1];
        for (&entry, &other) in matrix[row.clone()].iter().zip(&plant.chain[row]) {
            out[dof] += entry * x[other];
            out[other] += entry * x[dof];
        }
    }
}
