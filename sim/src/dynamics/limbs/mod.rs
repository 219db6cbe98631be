//! Limbs: branches on a moving base that each bend in a plane of their own, which rides on the base.
//!
//! All hinges of a limb are parallel and its bodies are symmetric about its plane. Seen on the plane's own axes every motion
//! and wrench falls into two parts that do not mix but for turning velocities: one in the plane (a turn and two
//! components), which the hinges add to, and one across it (a turn about two axes and one component), which all bodies
//! of the limb share with the base. Inertias fall into two 3 x 3 blocks alike. The base moves in space, as any body.
//!
//! Spatial quantities of a limb stand about the foot of the base's origin on its plane.

mod articulated;
mod inertia;
mod layout;
mod motion;

use articulated::{Flat, ROW};
use layout::Layout;
use motion::Riding;

use super::Work;
use super::plant::Plant;
use super::stages::LimbStage;
use crate::math::Vec2;
use crate::model::Model;
use crate::scalar::{Scalar, tuned};
use crate::space::{Motion, Planar, Spatial, Wrench};

/// The dynamics of a model whose bases carry limbs. Room for one limb at a time, shape (segments of the longest) each, so
/// that its numbers stay near.
#[derive(Debug, Clone)]
pub(crate) struct Limbs<T: Scalar> {
    layout: Layout<T>,
    /// Velocity of the limb's origin, were it carried by the hinge, per unit rate.
    axes: Vec<Vec2<T>>,
    /// In the plane: of each segment; with all it carries, tips first.
    inertias: Vec<Flat<T>>,
    wrenches: Vec<Wrench<Planar<T>>>,
    riding: Vec<Riding<T>>,
    /// Accelerations.
    motion: Vec<Motion<Planar<T>>>,
}

impl<T: Scalar> LimbStage<Spatial<T>> for Limbs<T> {
    /// Restraints and causes want the mass matrix, and bodies one by one in space.
    fn new(model: &Model<T>, plant: &Plant<Spatial<T>>) -> Option<Self> {
        if !plant.restraints.is_empty() {
            return None;
        }
        let layout = Layout::of(model, plant)?;
        let longest = layout.limbs.iter().map(|limb| limb.segments.len()).max()?;
        Some(Self {
            layout,
            axes: vec![Vec2::ZERO; longest],
            inertias: vec![Flat::ZERO; longest],
            wrenches: vec![Wrench::ZERO; longest],
            riding: vec![Riding::STILL; longest],
            motion: vec![Motion::ZERO; longest],
        })
    }

    fn factors(&self) -> usize {
        self.layout.rows * ROW
    }

    /// A function of its own: inlined into every stage of a step, it would take a compiler minutes for each kind of number.
    #[inline(never)]
    fn accelerate(
        &mut self,
        plant: &Plant<Spatial<T>>,
        qpos: &[T],
        qvel: &[T],
        work: &mut Work<Spatial<T>>,
        shift: Option<&[T]>,
        factors: &mut [T],
        force: &mut [T],
    ) {
        let (rows, _) = factors.as_chunks_mut::<ROW>();
        tuned!(T, self.articulate(plant, qpos, qvel, work, shift, rows, force));
    }

    #[inline(never)]
    fn solve(&mut self, factors: &[T], x: &mut [T]) {
        tuned!(T, self.solve_rows(factors, x));
    }
}

#[cfg(test)]
mod tests;
