//! `keypoint_slip`: what is taken for a keypoint sits further along its link.

use crate::math::Vec3;
use crate::model::Model;
use crate::model::cause::{CauseInfo, CauseValues, Kind, Mjcf, ParameterInfo, Per};
use crate::scalar::{Mask, Scalar};

pub(crate) const INFO: CauseInfo = CauseInfo {
    name: "keypoint_slip",
    kind: Kind::Camera,
    parameters: &[ParameterInfo::size(
        "",
        "m",
        [-0.02, 0.02],
        5e-4,
        "how far along its link the keypoint is off",
    )
    .each(Per::Keypoint)],
    aliases: &[],
    sentence: "what is taken for a keypoint sits further along its link than the model's",
    check: "measure where the pivots are on the links, or what the tracker clings to",
    formula: "P_i + s_i t_i, t_i from the link's joint towards P_i",
    source: "definition; fixed to the link, so there at rest too",
    mjcf: Some(Mjcf { how: "site pos", exact: |_| true, fold: alter }),
    in_picture_plane: false,
};

/// The keypoints' sites.
pub(crate) fn alter<T: Scalar>(values: &CauseValues<T>, model: &mut Model<T>) {
    for (site, &slip) in model.keypoint_sites().into_iter().zip(values.each(0)) {
        let body = model.sites[site].body;
        let anchor =
            model.joints.iter().find(|joint| joint.body == body).map_or(Vec3::ZERO, |joint| joint.pos);
        let long = |arm: Vec3<T>| T::from_f64(1e-6).less(arm.norm()).all();
        // a keypoint on its link's own joint: along to where the link's mass is
        let arms = [model.sites[site].pos - anchor, model.bodies[body].com - anchor];
        if let Some(arm) = arms.into_iter().find(|arm| long(*arm)) {
            let along = arm * (T::ONE / arm.norm());
            model.sites[site].pos += along * slip;
        }
    }
}
