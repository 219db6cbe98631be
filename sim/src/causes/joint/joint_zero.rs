//! `joint_zero`: a hinge stands at another angle than the drive or the spring that holds it believes, or than its encoder reads.

use crate::math::Quat;
use crate::model::Model;
use crate::model::cause::{CauseInfo, CauseValues, Kind, Mjcf, ParameterInfo, Per};
use crate::scalar::Scalar;

pub(crate) const INFO: CauseInfo = CauseInfo {
    name: "joint_zero",
    kind: Kind::Joint,
    parameters: &[ParameterInfo::size(
        "",
        "rad",
        [-1.0, 1.0],
        0.02,
        "by which the link stands further round where its drive or spring has 0, or its encoder reads more",
    )
    .each(Per::Held)
    .may_differ()],
    aliases: &[],
    sentence: "a link is mounted askew: its hinge's zero is not the drive's, the spring's or the encoder's",
    check: "lay the mechanism straight along a ruler and read its angles there",
    formula: "the link stands at q + z; where an encoder reads the hinge, q + z is what it reads",
    source: "definition; a hinge that nothing holds has no zero that a video could show",
    mjcf: Some(Mjcf { how: "body pos, quat", exact: |_| true, fold: alter }),
    in_picture_plane: false,
};

/// Turns the bodies on their hinges.
pub(crate) fn alter<T: Scalar>(values: &CauseValues<T>, model: &mut Model<T>) {
    let held: Vec<usize> = model.held_hinges().map(|(place, _)| place).collect();
    for (joint, &zero) in held.into_iter().zip(values.each(0)) {
        if let Some(encoder) = model.encoders.iter_mut().find(|encoder| encoder.joint == joint) {
            encoder.zero += zero;
            continue;
        }
        let (axis, at, body) = (model.joints[joint].axis, model.joints[joint].pos, model.joints[joint].body);
        let turn = Quat::from_rotation_vector(axis * zero);
        let body = &mut model.bodies[body];
        // the hinge itself stays where it is
        body.pos += body.quat.matrix().apply(at - turn.matrix().apply(at));
        body.quat = body.quat.product(turn);
    }
}
