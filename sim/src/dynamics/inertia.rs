//! Stage 2: the mass matrix by composite rigid bodies, and its sparse factorisation.
//!
//! Row `i` holds the dof itself and the dofs it rides on, nearest first: nothing else is nonzero. The
//! factorisation L^T D L, leaves first, keeps that pattern (Featherstone, Rigid Body Dynamics
//! Algorithms, 2008, sections 6.2 and 6.5).

use super::Work;
use super::plant::Plant;
use crate::scalar::Scalar;
use crate::space::{Inertia, Space};

/// Fills `work.inertia`: each body about its tree's root, world axes.
#[inline(always)]
pub(crate) fn body_inertias<S: Space>(plant: &Plant<S>, work: &mut Work<S>) {
    for index in 1..plant.links.len() {
        body_inertia(plant, index, work);
    }
}

/// The same for the body `index` alone.
#[inline(always)]
pub(crate) fn body_inertia<S: Space>(plant: &Plant<S>, index: usize, work: &mut Work<S>) {
    let link = &plant.links[index];
    let com = work.pos[index] + S::apply(&work.rot[index], link.com) - work.pos[link.root];
    work.com[index] = com;
    work.inertia[index] = Inertia {
        mass: link.mass,
        moment: com * link.mass,
        rotational: S::rotated(&link.inertia, &work.rot[index]) + S::of_point(link.mass, com),
    };
}

/// Fills `work.mass` from `work.inertia` and `work.axes`.
#[inline(always)]
pub(crate) fn mass_matrix<S: Space>(plant: &Plant<S>, work: &mut Work<S>) {
    work.composite.copy_from_slice(&work.inertia);
    for index in (1..plant.links.len()).rev() {
        let parent = plant.links[index].parent;
        if parent != 0 {
            let own = work.composite[index];
            work.composite[parent] += own;
        }
    }
    for dof in 0..plant.nv {
        let momentum = work.composite[plant.dof_body[dof]].apply(work.axes[dof]);
        let row = plant.row[dof]..plant.row[dof + 1];
        for (entry, &other) in work.mass[row.clone()].iter_mut().zip(&plant.chain[row.clone()]) {
            *entry = work.axes[other].power(momentum);
        }
        work.mass[row.start] += plant.armature[dof];
    }
}

/// Makes the accelerations of the `held` dofs come out as 0: no coupling, unit inertia.
#[inline(always)]
pub(crate) fn hold<S: Space>(plant: &Plant<S>, held: &[bool], matrix: &mut [S::T]) {
    if !held.contains(&true) {
        return;
    }
    for dof in 0..plant.nv {
        let row = plant.row[dof]..plant.row[dof + 1];
        for (entry, &other) in matrix[row.clone()].iter_mut().zip(&plant.chain[row]) {
            if held[dof] || held[other] {
                *entry = if dof == other { S::T::ONE } else { S::T::ZERO };
            }
        }
    }
}

/// Replaces the matrix by its factors: the unit triangle's entries, and the reciprocal of the diagonal.
#[inline(always)]
pub(crate) fn factor<S: Space>(plant: &Plant<S>, matrix: &mut [S::T]) {
    for dof in (0..plant.nv).rev() {
        let (start, end) = (plant.row[dof], plant.row[dof + 1]);
        let (lower, row) = matrix[..end].split_at_mut(start);
        let inverse = S::T::ONE / row[0];
        for k in 1..row.len() {
            let share = row[k] * inverse;
            let target = plant.row[plant.chain[start + k]];
            for (entry, &x) in lower[target..].iter_mut().zip(&row[k..]) {
                *entry -= share * x;
            }
        }
        row[0] = inverse;
        for entry in &mut row[1..] {
            *entry *= inverse;
        }
    }
}

/// Solves for the right-hand side in `x`, in place, with a matrix that went through [`factor`].
#[inline(always)]
pub(crate) fn solve<S: Space>(plant: &Plant<S>, factors: &[S::T], x: &mut [S::T]) {
    for dof in (0..plant.nv).rev() {
        let row = plant.row[dof] + 1..plant.row[dof + 1];
        let value = x[dof];
        for (&entry, &other) in factors[row.clone()].iter().zip(&plant.chain[row]) {
            x[other] -= entry * value;
        }
    }
    for dof in 0..plant.nv {
        let start = plant.row[dof];
        let row = start + 1..plant.row[dof + 1];
        let mut value = x[dof] * factors[start];
        for (&entry, &other) in factors[row.clone()].iter().zip(&plant.chain[row]) {
            value -= entry * x[other];
        }
        x[dof] = value;
    }
}
