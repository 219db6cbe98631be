//! The shipped octopus as a camera sees it that looks along y: each box as the outline of its corners, the body as an ellipse.

use std::f64::consts::TAU;

use rand_chacha::ChaCha8Rng;
use sim::Model;
use sim::model::GeomKind;

use super::picture::between;
use super::shape::{Px, Shape};
use crate::repository;

/// How it moves.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Swimming {
    /// As the simulation swims with the shipped stroke.
    Stroke,
    /// Along a made-up course, turning, arms that the camera sees one before the other moving alike.
    Course,
    /// So too, but each arm by itself.
    Apart,
}

/// The shipped model.
pub fn model() -> Model {
    let path = repository().join("configs/models/octopus8.xml");
    let text = std::fs::read_to_string(path).unwrap_or_default();
    Model::from_mjcf(&text).unwrap_or_else(|error| unreachable!("the shipped octopus: {error}"))
}

/// Its coordinates at each of `times_s`.
pub fn motion(model: &Model, swimming: Swimming, times_s: &[f64], random: &mut ChaCha8Rng) -> Vec<Vec<f64>> {
    if swimming == Swimming::Stroke {
        return stroke(model, times_s);
    }
    let mut sine = |size: f64, hertz: f64| {
        [size * between(random, 0.5, 1.0), hertz * between(random, 0.6, 1.4), between(random, 0.0, TAU)]
    };
    let path = [sine(0.03, 0.5), sine(0.02, 0.5), sine(0.4, 0.6)];
    let arms: Vec<[[f64; 3]; 3]> =
        (0..8).map(|_| [sine(0.35, 0.6), sine(0.09, 0.6), sine(0.09, 0.6)]).collect();
    let at = |[size, hertz, phase]: &[f64; 3], time_s: f64| size * (TAU * hertz * time_s + phase).sin();
    let state = model.rest_state();
    times_s
        .iter()
        .map(|&time_s| {
            let mut qpos = state.qpos.clone();
            let [x, z, turn] = [0, 1, 2].map(|k| at(&path[k], time_s));
            // Counter-clockwise as the camera sees it is about -y.
            qpos[..7].copy_from_slice(&[x, 0.0, z, (turn / 2.0).cos(), 0.0, -(turn / 2.0).sin(), 0.0]);
            for joint in &model.joints {
                let Some((arm, number)) = joint.name.strip_prefix('a').and_then(|name| name.split_once('q'))
                else {
                    continue;
                };
                let (arm, number): (usize, usize) = (arm.parse().unwrap_or(1), number.parse().unwrap_or(1));
                // The camera sees 2 and 8, 3 and 7, 4 and 6 one before the other.
                let arm = if swimming == Swimming::Course && arm > 5 { 10 - arm } else { arm };
                let [first, bend, twist] = &arms[arm - 1];
                let share = (number as f64 - 4.5) / 3.5;
                let turn = match number {
                    1 => 0.25 + at(first, time_s),
                    _ => at(bend, time_s) + share * at(twist, time_s),
                };
                qpos[joint.qpos_address] += turn;
            }
            qpos
        })
        .collect()
}

fn stroke(model: &Model, times_s: &[f64]) -> Vec<Vec<f64>> {
    let path = repository().join("configs/models/octopus8-stroke.csv");
    let command =
        ident::table::read_command(&path).unwrap_or_else(|error| unreachable!("the shipped stroke: {error}"));
    let options = sim::RolloutOptions { timestep_s: Some(0.00025), ..Default::default() };
    let swim = sim::rollout(model, &model.rest_state(), &command, times_s, &options)
        .unwrap_or_else(|error| unreachable!("the shipped stroke: {error}"));
    swim.qpos.chunks(model.nq()).map(<[f64]>::to_vec).collect()
}

/// Its outline and keypoints at the coordinates `qpos`; `origin` is where the world's origin is seen, `scale` \[m/px\].
pub fn seen(model: &Model, qpos: &[f64], origin: Px, scale: f64) -> (Vec<Shape>, Vec<Px>) {
    let poses = model.poses(qpos);
    let px = |x: f64, z: f64| [origin[0] + x / scale, origin[1] - z / scale];
    let shapes = model.geoms.iter().enumerate().map(|(i, geom)| {
        let (at, rot) = (poses.geom_pos[i], &poses.geom_rot[i]);
        let columns = [0, 1, 2].map(|k| rot.column(k));
        let [a, b, c] = geom.size;
        if geom.kind == GeomKind::Ellipsoid {
            // Round about its own axis, which lies in the picture's plane.
            let [_, _, axis] = columns;
            let turn = axis[0].atan2(axis[2]);
            return Shape::Ellipse { centre: px(at[0], at[2]), axes: [a / scale, c / scale], turn };
        }
        let corner = |i: usize| {
            let sign = |k: usize| if i >> k & 1 == 1 { 1.0 } else { -1.0 };
            let place =
                at + columns[0] * (sign(0) * a) + columns[1] * (sign(1) * b) + columns[2] * (sign(2) * c);
            px(place[0], place[2])
        };
        Shape::polygon((0..8).map(corner).collect())
    });
    let points = model.keypoint_sites().into_iter().map(|site| {
        let at = poses.site_pos[site];
        px(at[0], at[2])
    });
    (shapes.collect(), points.collect())
}
