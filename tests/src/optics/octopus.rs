//! The octopus: eight arms round a hub that nothing holds, in pairs before and behind the plane of motion.

use crate::optics::mechanism::{Keypoint, Mechanism, Pose};
use crate::optics::solids::{Shape, Solid};
use crate::optics::vec::{V3, v3};
use std::f64::consts::FRAC_PI_4;

/// Half axes of the hub, as `octopus8.xml` has them.
pub(crate) const HUB_HALF_M: V3 = v3(0.04, 0.04, 0.02);
/// How far the arms' roots are tilted outward.
pub(crate) const ROOT_TILT_RAD: f64 = 0.6;

/// The hinges and the tip of an arm. Every arm bends in its own upright plane through the hub's axis.
pub(crate) fn arm_nodes(m: &Mechanism, pose: &Pose, arm: usize) -> Vec<V3> {
    let azimuth = arm as f64 * FRAC_PI_4;
    let (s, c) = azimuth.sin_cos();
    let n = m.links.len();
    // Within the arm's plane: `out` away from the axis, and down.
    let (mut out_m, mut down_m, mut bend) = (HUB_HALF_M.x, 0.0, ROOT_TILT_RAD);
    let mut nodes = Vec::with_capacity(n + 1);
    let place = |out_m: f64, down_m: f64| pose.root + v3(out_m * c, out_m * s, -down_m).turned(pose.turn_rad);
    nodes.push(place(out_m, down_m));
    for (i, link) in m.links.iter().enumerate() {
        bend += pose.angles_rad[arm * n + i];
        out_m += link.pitch_m * bend.sin();
        down_m += link.pitch_m * bend.cos();
        nodes.push(place(out_m, down_m));
    }
    nodes
}

/// P0 in the hub, and three sites an arm.
pub(crate) fn keypoints(m: &Mechanism, pose: &Pose) -> Vec<Keypoint> {
    let mut all = vec![Keypoint { name: "P0".into(), at: pose.root, owner: 0 }];
    for arm in 0..8 {
        let nodes = arm_nodes(m, pose, arm);
        for (i, n) in [0, 4, 8].into_iter().enumerate() {
            all.push(Keypoint { name: format!("a{}P{i}", arm + 1), at: nodes[n], owner: arm as u16 + 1 });
        }
    }
    all
}

/// The hub and the arms; each is its own owner, so that what one covers of another counts as hidden.
pub(crate) fn solids(m: &Mechanism, pose: &Pose, material: usize) -> Vec<Solid> {
    let hub = Shape::Ellipsoid { centre: pose.root, half_m: HUB_HALF_M, turn_rad: pose.turn_rad };
    let mut all = vec![Solid::new(hub, material, 0)];
    for arm in 0..8 {
        all.extend(m.soft(&arm_nodes(m, pose, arm), material, arm as u16 + 1));
    }
    all
}
