//! Numbers that cannot be what their columns say: metres, seconds or radians by a factor of a thousand off.

use std::f64::consts::TAU;

use sim::model::{ActuatorKind, encoded_joint};
use sim::{Command, JointKind, Model, RolloutOptions, rollout};

use super::{ExperimentError, Run, RunKind};
use crate::geometry::characteristic_length_m;
use crate::noise::floor::interval_s;
use ground::statistics::median;

/// Keypoints this many times as far apart as the model can have them are no metres (chosen): no camera is that far off.
const TOO_FAR_RATIO: f64 = 3.0;
/// And these that are never as far apart as this share of what they are on the model at rest (chosen).
const TOO_NEAR_SHARE: f64 = 0.02;
/// Units that tables hold instead of metres, and how many are in one.
const UNITS: [(&str, f64); 3] = [("millimetres", 1000.0), ("centimetres", 100.0), ("inches", 39.37)];
/// A ratio is that of a unit from this share of it on (chosen): keypoints are nearer than they can be.
const UNIT_SHARES: [f64; 2] = [0.5, 1.1];
/// Commands beyond this are no angles of a servo \[rad\] (chosen): sixteen turns, fewer than the shortest pulse has microseconds.
const COMMAND_MAX_RAD: f64 = 100.0;
/// Whoever films slower than this does so for a reason, or has other numbers under `time_s` \[s\] (chosen): images are asked about.
const INTERVAL_ASKED_ABOUT_S: f64 = 0.5;
/// A mechanism that has come this far within one image interval cannot be followed (chosen): most of its motion is between two images.
const SETTLED_SHARE_MAX: f64 = 0.5;
/// From where it is let go for that \[rad\] (chosen).
const LET_GO_RAD: f64 = 0.5;

/// What of `run` cannot be in the units that its columns state.
pub(super) fn check(model: &Model, run: &Run) -> Result<(), ExperimentError> {
    let refuse = |reason: String| Err(ExperimentError::Run { run: run.id.clone(), reason });
    if let Some(reason) = lengths(model, run).or_else(|| angles(model, run)).or_else(|| times(model, run)) {
        return refuse(reason);
    }
    Ok(())
}

/// Two keypoints of `run`, how far apart they are in the middle of all images and at most, and the distance of their sites in the model: at
/// rest, and the farthest that its joints allow \[m\].
struct Pair<'a> {
    names: [&'a str; 2],
    usual_m: f64,
    most_m: f64,
    rest_m: f64,
    reach_m: f64,
}

fn lengths(model: &Model, run: &Run) -> Option<String> {
    let pairs = pairs(model, run);
    let ratio = |pair: &Pair<'_>| pair.usual_m / pair.reach_m;
    if let Some(far) =
        pairs.iter().filter(|pair| pair.reach_m > 0.0).max_by(|a, b| ratio(a).total_cmp(&ratio(b)))
        && ratio(far) > TOO_FAR_RATIO
    {
        let [low, high] = UNIT_SHARES;
        let unit = UNITS.iter().find(|(_, count)| (low * count..high * count).contains(&ratio(far)));
        let guess = match unit {
            Some((name, count)) => format!("are these {name}? Divide all coordinates by {count}"),
            None => "are these pixels? Convert them by the camera's scale and origin".to_owned(),
        };
        return Some(format!(
            "`{}` and `{}` are {:.4} m apart, and the model has them at most {:.4} m apart; {guess}, or put the model's lengths right",
            far.names[0], far.names[1], far.usual_m, far.reach_m
        ));
    }
    let near = pairs.iter().find(|pair| pair.rest_m > 0.0)?;
    let all_near = pairs.iter().all(|pair| pair.most_m < TOO_NEAR_SHARE * pair.rest_m);
    all_near.then(|| {
        format!(
            "`{}` and `{}` are never more than {:.6} m apart, and {:.4} m in the model; is the model in millimetres? Its lengths, like all others, are metres",
            near.names[0], near.names[1], near.most_m, near.rest_m
        )
    })
}

fn pairs<'a>(model: &Model, run: &'a Run) -> Vec<Pair<'a>> {
    let rest = model.poses(&model.rest_state().qpos);
    let site = |name: &str| {
        let is_named = |site: &usize| model.sites[*site].name == *name;
        (encoded_joint(name).is_none()).then(|| model.keypoint_sites().into_iter().find(is_named)).flatten()
    };
    let names = &run.trajectory.keypoints;
    let sites: Vec<(usize, usize)> =
        names.iter().enumerate().filter_map(|(column, name)| Some((column, site(name)?))).collect();
    let mut pairs = Vec::new();
    for (place, &(b, of_b)) in sites.iter().enumerate() {
        for &(a, of_a) in &sites[..place] {
            let apart =
                |instant: usize| distance_m(run.trajectory.at(instant, a), run.trajectory.at(instant, b));
            let mut seen: Vec<f64> = (0..run.trajectory.time_s.len()).filter_map(apart).collect();
            let most_m = seen.iter().copied().fold(0.0, f64::max);
            let (Some(usual_m), Some(reach_m)) =
                (median(&mut seen, f64::total_cmp), reach_m(model, [of_a, of_b]))
            else {
                continue;
            };
            let rest_m = distance_m(rest.site_pos[of_a].0, rest.site_pos[of_b].0).unwrap_or(0.0);
            pairs.push(Pair { names: [&names[a], &names[b]], usual_m, most_m, rest_m, reach_m });
        }
    }
    pairs
}

/// Distance along the axes that both are observed along; `None` where there is none.
fn distance_m(a: [f64; 3], b: [f64; 3]) -> Option<f64> {
    let squares: Vec<f64> =
        (0..3).map(|axis| (a[axis] - b[axis]).powi(2)).filter(|square| square.is_finite()).collect();
    (!squares.is_empty()).then(|| squares.iter().sum::<f64>().sqrt())
}

/// The farthest that two sites can be apart \[m\]: the length of the way between them from joint to joint. `None` where something on the way
/// slides or floats.
fn reach_m(model: &Model, sites: [usize; 2]) -> Option<f64> {
    let chain = |site: usize| {
        let mut bodies = vec![model.sites[site].body];
        while let Some(&body) = bodies.last().filter(|body| **body != 0) {
            bodies.push(model.bodies[body].parent);
        }
        bodies
    };
    let poses = model.poses(&model.rest_state().qpos);
    let [of_a, of_b] = sites.map(chain);
    let shared = of_a.iter().find(|body| of_b.contains(body))?;
    // from each site to its body's origin, from there to its parent's, up to the body that both hang from
    let way = |site: usize, bodies: &[usize]| {
        let up: Vec<usize> = bodies.iter().copied().take_while(|body| body != shared).collect();
        let slides = |body: &usize| {
            model
                .joints
                .iter()
                .any(|joint| joint.body == *body && matches!(joint.kind, JointKind::Slide | JointKind::Free))
        };
        if up.iter().any(slides) {
            return None;
        }
        // a joint that is not at its body's origin lets that origin wander about it
        let anchors = |body: &usize| {
            model
                .joints
                .iter()
                .filter(|joint| joint.body == *body)
                .map(|joint| 2.0 * length_m(joint.pos.0))
                .sum::<f64>()
        };
        let mut places = vec![poses.site_pos[site].0];
        places.extend(up.iter().map(|&body| poses.body_pos[body].0));
        let straight: f64 = places.windows(2).filter_map(|pair| distance_m(pair[0], pair[1])).sum();
        Some((straight + up.iter().map(anchors).sum::<f64>(), places[places.len() - 1]))
    };
    let ((a_m, from), (b_m, to)) = (way(sites[0], &of_a)?, way(sites[1], &of_b)?);
    Some(a_m + b_m + distance_m(from, to)?)
}

fn length_m(of: [f64; 3]) -> f64 {
    of.iter().map(|x| x * x).sum::<f64>().sqrt()
}

fn angles(model: &Model, run: &Run) -> Option<String> {
    let command = run.command.as_ref()?;
    let width = command.actuators.len();
    let is_angle = |column: usize| {
        let mut named = model.actuators.iter().filter(|known| known.name == command.actuators[column]);
        named.any(|known| known.kind != ActuatorKind::Motor)
    };
    let angles =
        command.angle_rad.iter().enumerate().filter(|(at, angle)| is_angle(at % width) && !angle.is_nan());
    let most = angles.map(|(_, angle)| *angle).max_by(|a, b| a.abs().total_cmp(&b.abs()))?;
    (most.abs() > COMMAND_MAX_RAD).then(|| {
        format!(
            "the servo table commands {most} rad, which is {:.0} turns; are these pulse widths in microseconds, or degrees? Convert them to radians",
            most.abs() / TAU
        )
    })
}

/// Images so far apart that the model does most of its motion between two of them.
fn times(model: &Model, run: &Run) -> Option<String> {
    let times_s = &run.trajectory.time_s;
    let interval_s = interval_s(times_s);
    let gravity = length_m(model.settings.gravity.0);
    let swing_s = TAU * (characteristic_length_m(model) / gravity).sqrt();
    if interval_s < INTERVAL_ASKED_ABOUT_S
        || interval_s <= swing_s
        || run.kind == RunKind::Free
        || !settles(model, interval_s)
    {
        return None;
    }
    let are_numbers = times_s.windows(2).all(|pair| pair[1] - pair[0] == 1.0);
    let guess = match are_numbers {
        true => "are these numbers of images? Divide them by the images a second",
        false => "are these milliseconds? Divide them by 1000",
    };
    Some(format!(
        "its images are {interval_s:.3} s apart, and the model does most of a motion within one such interval, so that they cannot show how it moves; under `time_s`, {guess}"
    ))
}

/// Whether the model, let go with its hinges turned, has left that pose by most of the way after `time_s` \[s\].
fn settles(model: &Model, time_s: f64) -> bool {
    let mut state = model.rest_state();
    let hinges: Vec<usize> = model
        .joints
        .iter()
        .filter(|joint| joint.kind == JointKind::Hinge)
        .map(|joint| joint.qpos_address)
        .collect();
    let rest = state.qpos.clone();
    hinges.iter().for_each(|&hinge| state.qpos[hinge] += LET_GO_RAD);
    let Ok(end) = rollout(model, &state, &Command::default(), &[time_s], &RolloutOptions::default()) else {
        return true;
    };
    let moved = hinges.iter().filter(|&&hinge| {
        (end.qpos[hinge] - rest[hinge] - LET_GO_RAD).abs() > SETTLED_SHARE_MAX * LET_GO_RAD
    });
    2 * moved.count() > hinges.len()
}
