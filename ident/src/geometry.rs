//! Sizes and poses of a mechanism, as far as a fit needs them.

use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use sim::{JointKind, Model};

/// Length of the mechanism \[m\]: the greatest distance between the ends of its moving shapes' axes, all joints
/// at their reference. Errors are stated as shares of it (80 mm for the published three-link chain).
pub fn characteristic_length_m(model: &Model) -> f64 {
    let poses = model.poses(&model.rest_state().qpos);
    let mut ends: Vec<[f64; 3]> = Vec::new();
    for (index, geom) in model.geoms.iter().enumerate().filter(|(_, geom)| geom.body != 0) {
        let half = half_extents(geom);
        let (centre, rotation) = (poses.geom_pos[index].0, poses.geom_rot[index].0);
        for axis in 0..3 {
            for sign in [-1.0, 1.0] {
                ends.push(std::array::from_fn(|row| centre[row] + sign * half[axis] * rotation[row][axis]));
            }
        }
    }
    let mut longest: f64 = 0.0;
    for (i, a) in ends.iter().enumerate() {
        for b in &ends[..i] {
            longest = longest.max(distance_m(a, b));
        }
    }
    longest
}

fn half_extents(geom: &sim::model::Geom<f64>) -> [f64; 3] {
    let [a, b, c] = geom.size;
    match geom.kind {
        sim::model::GeomKind::Sphere => [a; 3],
        sim::model::GeomKind::Capsule => [a, a, a + b],
        sim::model::GeomKind::Cylinder => [a, a, b],
        sim::model::GeomKind::Ellipsoid | sim::model::GeomKind::Box => [a, b, c],
        sim::model::GeomKind::Plane => [0.0; 3],
    }
}

/// Distance of two points \[m\].
pub(crate) fn distance_m(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
}

/// Coordinates `qpos`, shape (nq), after a small motion `delta`, shape (nv): a ball turns about its own axes, a
/// free joint shifts along the world's and turns about its own.
pub(crate) fn moved(model: &Model, qpos: &[f64], delta: &[f64]) -> Vec<f64> {
    let mut moved = qpos.to_vec();
    for joint in &model.joints {
        let (q, v) = (joint.qpos_address, joint.dof_address);
        match joint.kind {
            JointKind::Hinge | JointKind::Slide => moved[q] += delta[v],
            JointKind::Ball => turn(&mut moved[q..q + 4], &delta[v..v + 3]),
            JointKind::Free => {
                for axis in 0..3 {
                    moved[q + axis] += delta[v + axis];
                }
                turn(&mut moved[q + 3..q + 7], &delta[v + 3..v + 6]);
            }
        }
    }
    moved
}

fn turn(quaternion: &mut [f64], by: &[f64]) {
    let [w, x, y, z] = [quaternion[0], quaternion[1], quaternion[2], quaternion[3]];
    let before = UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z));
    let after = before * UnitQuaternion::from_scaled_axis(Vector3::new(by[0], by[1], by[2]));
    quaternion.copy_from_slice(&[after.w, after.i, after.j, after.k]);
}
