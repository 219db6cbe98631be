//! Hinges and slides, as the causes in joints take them.

use crate::model::Model;
use crate::model::cause::CauseValues;
use crate::scalar::Scalar;

/// A hinge or slide, and how strong a cause is there.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Axle<T> {
    /// Its place in `model.joints`.
    pub(crate) joint: usize,
    pub(crate) q: usize,
    pub(crate) dof: usize,
    /// Where its spring is slack.
    pub(crate) slack: T,
    pub(crate) size: T,
}

/// Every hinge and slide with the size that the parameter at `common` has, plus its own at `own`.
///
/// With `inner`, the common size counts only between moving bodies, where there are such joints: the joint on the
/// tank's frame is the servo's or the release's.
pub(crate) fn sizes<T: Scalar>(
    values: &CauseValues<T>,
    model: &Model<T>,
    [common, own]: [usize; 2],
    inner: bool,
) -> Vec<Axle<T>> {
    let moves = |body: usize| {
        let mut body = body;
        while body != 0 {
            if model.joints.iter().any(|joint| joint.body == body) {
                return true;
            }
            body = model.bodies[body].parent;
        }
        false
    };
    let between = |body: usize| moves(model.bodies[body].parent);
    let some_inner = model.axles().any(|(_, joint)| between(joint.body));
    model
        .axles()
        .zip(values.each(own))
        .map(|((place, joint), &own)| {
            let shared = !inner || !some_inner || between(joint.body);
            Axle {
                joint: place,
                q: joint.qpos_address,
                dof: joint.dof_address,
                slack: joint.spring_reference,
                size: own + if shared { values.one(common) } else { T::ZERO },
            }
        })
        .collect()
}
