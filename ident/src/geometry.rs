//! Sizes and poses of a mechanism, as far as a fit needs them.

use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use sim::Model;
use sim::model::{Coordinates, Joint};

/// Length of the mechanism \[m\]: the greatest distance between the ends of its moving shapes' axes, its marked
/// points and its bodies' origins, all joints at their reference. Errors are stated as shares of it (80 mm for
/// the published three-link chain).
pub fn characteristic_length_m(model: &Model) -> f64 {
    let poses = model.poses(&model.rest_state().qpos);
    let mut ends: Vec<[f64; 3]> = poses.body_pos.iter().skip(1).map(|pos| pos.0).collect();
    let sites = model.sites.iter().zip(&poses.site_pos).filter(|(site, _)| site.body != 0);
    ends.extend(sites.map(|(_, pos)| pos.0));
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
            let squares: f64 = a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum();
            longest = longest.max(squares.sqrt());
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

/// Coordinates `qpos`, shape (nq), after a small motion `delta`, shape (nv): a ball turns about its own axes, a
/// free joint shifts along the world's and turns about its own.
pub(crate) fn moved(model: &Model, qpos: &[f64], delta: &[f64]) -> Vec<f64> {
    let mut moved = qpos.to_vec();
    for (coordinates, q, v) in model.joints.iter().flat_map(Joint::coordinates) {
        match coordinates {
            Coordinates::Rotation => turn(&mut moved[q..q + 4], &delta[v..v + 3]),
            Coordinates::Axis | Coordinates::Position => {
                for k in 0..coordinates.nv() {
                    moved[q + k] += delta[v + k];
                }
            }
        }
    }
    moved
}

/// The motion, shape (nv), that [`moved`] takes `from` by to come to `to`.
pub(crate) fn motion(model: &Model, from: &[f64], to: &[f64]) -> Vec<f64> {
    let mut motion = vec![0.0; model.nv()];
    for (coordinates, q, v) in model.joints.iter().flat_map(Joint::coordinates) {
        match coordinates {
            Coordinates::Rotation => {
                let turned = rotation(&from[q..q + 4]).inverse() * rotation(&to[q..q + 4]);
                motion[v..v + 3].copy_from_slice(turned.scaled_axis().as_slice());
            }
            Coordinates::Axis | Coordinates::Position => {
                for k in 0..coordinates.nv() {
                    motion[v + k] = to[q + k] - from[q + k];
                }
            }
        }
    }
    motion
}

fn rotation(quaternion: &[f64]) -> UnitQuaternion<f64> {
    let [w, x, y, z] = [quaternion[0], quaternion[1], quaternion[2], quaternion[3]];
    UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z))
}

fn turn(quaternion: &mut [f64], by: &[f64]) {
    let after = rotation(quaternion) * UnitQuaternion::from_scaled_axis(Vector3::new(by[0], by[1], by[2]));
    quaternion.copy_from_slice(&[after.w, after.i, after.j, after.k]);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn published_chain_is_80_mm_long() {
        let model = Model::from_mjcf(include_str!("../tests/data/chain.xml")).unwrap();
        assert!((characteristic_length_m(&model) - 0.08).abs() < 1e-12);
    }

    #[test]
    fn mechanism_without_shapes_is_as_long_as_its_marked_points_say() {
        let model = Model::from_mjcf(include_str!("../tests/data/pendulum.xml")).unwrap();
        assert!((characteristic_length_m(&model) - 0.372719204).abs() < 1e-12);
    }

    #[test]
    fn a_free_body_shifts_along_the_world_and_turns_about_its_own_axes() {
        let text = "<mujoco><worldbody><body><freejoint/><geom type=\"box\" size=\"1 1 1\"/></body></worldbody></mujoco>";
        let model = Model::from_mjcf(text).unwrap();
        let half = std::f64::consts::FRAC_1_SQRT_2;
        // Turned by a quarter about z; then a quarter about its own x.
        let turned = moved(
            &model,
            &[1.0, 2.0, 3.0, half, 0.0, 0.0, half],
            &[0.5, 0.0, 0.0, std::f64::consts::FRAC_PI_2, 0.0, 0.0],
        );
        for (found, wanted) in turned.iter().zip([1.5, 2.0, 3.0, 0.5, 0.5, 0.5, 0.5]) {
            assert!((found - wanted).abs() < 1e-12, "{turned:?}");
        }
    }

    #[test]
    fn the_motion_between_two_poses_leads_from_one_to_the_other() {
        let text = "<mujoco><worldbody><body><freejoint/><geom type=\"box\" size=\"1 1 1\"/>\
                    <body><joint type=\"ball\"/><geom type=\"box\" size=\"1 1 1\"/>\
                    <body><joint type=\"hinge\"/><geom type=\"box\" size=\"1 1 1\"/></body></body></body></worldbody></mujoco>";
        let model = Model::from_mjcf(text).unwrap();
        let from =
            moved(&model, &model.rest_state().qpos, &[1.0, -2.0, 0.5, 0.3, -0.4, 2.0, 1.5, 0.2, -0.7, 4.0]);
        let wanted = [0.1, 0.2, 0.3, -0.5, 0.6, 0.4, 1.1, -1.2, 0.3, -5.0];
        let found = motion(&model, &from, &moved(&model, &from, &wanted));
        for (found, wanted) in found.iter().zip(wanted) {
            assert!((found - wanted).abs() < 1e-12, "{found} {wanted}");
        }
    }
}
