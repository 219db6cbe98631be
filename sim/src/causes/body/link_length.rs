//! `link_length`: a link is longer than the model says.

use crate::math::Vec3;
use crate::model::Model;
use crate::model::cause::{CauseInfo, CauseValues, Kind, Mjcf, ParameterInfo, Per};
use crate::scalar::{Mask, Scalar};

pub(crate) const INFO: CauseInfo = CauseInfo {
    name: "link_length",
    kind: Kind::Physics,
    parameters: &[ParameterInfo::size(
        "",
        "m",
        [-0.05, 0.05],
        5e-4,
        "by which the link is longer from its hinge to the next",
    )
    .each(Per::Link)],
    aliases: &[],
    sentence: "a link is longer from hinge to hinge than the model says",
    check: "measure each link from pivot to pivot, to 0.1 mm",
    formula: "the next hinge d further out; keypoints on the link in proportion; mass and shape stay",
    source: "definition; of the last link, which carries none, see keypoint_slip",
    mjcf: Some(Mjcf { how: "body pos, site pos", exact: |_| true, fold: alter }),
    in_picture_plane: false,
};

/// The hinges on the links, and the keypoints.
pub(crate) fn alter<T: Scalar>(values: &CauseValues<T>, model: &mut Model<T>) {
    let links: Vec<usize> = model.carriers().collect();
    for (link, &longer) in links.into_iter().zip(values.each(0)) {
        let hinge =
            model.joints.iter().find(|joint| joint.body == link).map_or(Vec3::ZERO, |joint| joint.pos);
        for next in model.carried_by(link) {
            let arm = model.bodies[next].pos - hinge;
            let length = arm.norm();
            if !T::from_f64(1e-6).less(length).all() {
                continue;
            }
            let along = arm * (T::ONE / length);
            model.bodies[next].pos += along * longer;
            // what sits on a link with several others counts towards the first
            if model.carried_by(link).first() == Some(&next) {
                for site in model.sites.iter_mut().filter(|site| site.body == link) {
                    let share = along.dot(site.pos - hinge) / length;
                    site.pos += along * (longer * share);
                }
            }
        }
    }
}
