//! Steps over corners of the motion, taken again in halves.

use super::Engine;
use crate::causes::Moment;
use crate::dynamics::stages::{ContactStage, Stages};
use crate::model::State;
use crate::scalar::{Mask, Scalar, tuned};

/// Most halvings of a step over a corner (chosen).
pub(super) const HALVINGS_MAX: usize = 5;

/// A step's start, and its end if taken whole.
#[derive(Debug, Clone)]
pub(super) struct Halving<T> {
    start: State<T>,
    end: State<T>,
}

impl<T: Scalar> Halving<T> {
    pub(super) fn new(state: &State<T>) -> Self {
        Self { start: state.clone(), end: state.clone() }
    }
}

impl<S: Stages> Engine<S> {
    /// One step of `h` \[s\] from `time_s`. Where friction loss, an end stop or a contact changes sides on the way, accelerations have
    /// a corner that leaves little of a method's order: those lanes take the step again as two, `level` halvings
    /// having been made. So a lane's steps are its own, whoever its neighbours are. The steps' lengths depend on the
    /// motion only where they make no difference beyond the smooth error: a corner that a change of parameters moves to a
    /// step's end is as good as none.
    pub(super) fn halving(
        &mut self,
        state: &mut State<S::T>,
        time_s: f64,
        h: f64,
        command: &dyn Fn(usize, f64) -> S::T,
        level: usize,
    ) {
        if level >= self.halvings.len() {
            self.whole(state, time_s, h, command);
            return;
        }
        copy(&mut self.halvings[level].start, state);
        self.whole(state, time_s, h, command);
        let mut changed = S::T::ZERO.less(S::T::ZERO);
        if let Some(solver) = &self.solver {
            changed = changed | solver.changed();
        }
        if self.contacts.as_ref().is_some_and(|contacts| contacts.changed()) {
            changed = S::T::ZERO.less(S::T::ONE);
        }
        if !changed.any() {
            return;
        }
        let saved = &mut self.halvings[level];
        copy(&mut saved.end, state);
        copy(state, &saved.start);
        for from_s in [time_s, time_s + 0.5 * h] {
            self.moment = Moment { time_s: from_s, elapsed_s: 0.0, arrived_s: None };
            self.sample(from_s, command);
            self.position_stage(&state.qpos);
            self.halving(state, from_s, 0.5 * h, command, level + 1);
        }
        let end = &self.halvings[level].end;
        tuned!(S::T, {
            for (q, &whole) in state.qpos.iter_mut().zip(&end.qpos) {
                *q = S::T::select(changed, *q, whole);
            }
            for (v, &whole) in state.qvel.iter_mut().zip(&end.qvel) {
                *v = S::T::select(changed, *v, whole);
            }
        });
    }
}

fn copy<T: Copy>(to: &mut State<T>, from: &State<T>) {
    to.qpos.copy_from_slice(&from.qpos);
    to.qvel.copy_from_slice(&from.qvel);
}
