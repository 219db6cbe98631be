//! The mechanism moving in space, for the page's script: what it needs as compact JSON.
//!
//! Poses are the fitted model's, at most [`POSE_RATE_MAX_HZ`] a second. Places are whole tenths of a millimetre, rotations whole ten-thousandths of a radian,
//! both as base64 of 16-bit integers, little end first.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use ident::fit::FittedRun;
use maud::{Markup, html};
use nalgebra::{Matrix3, Rotation3, UnitQuaternion};
use serde_json::{Value, json};
use sim::math::Mat3;
use sim::model::{Geom, GeomKind, encoded_joint};
use sim::{Model, Poses};

use super::data::ReportData;
use camera::calibration::View;

/// Poses a second at most: the rate of a usual screen. Chosen.
const POSE_RATE_MAX_HZ: f64 = 60.0;
/// Poses of a run at most. Chosen.
const POSES_MAX: usize = 1200;
/// One unit of a place \[m\],
const PLACE_UNIT_M: f64 = 1e-4;
/// of a rotation \[rad\],
const TURN_UNIT_RAD: f64 = 1e-4;
/// and of a time \[s\].
const TIME_UNIT_S: f64 = 1e-3;
/// The value for a missing number.
const GAP: i16 = i16::MIN;

/// One run's motion in space.
#[derive(Debug, Clone)]
pub struct Motion {
    /// Run id as in the experiment.
    id: String,
    view: View,
    shapes: Vec<Value>,
    bodies: usize,
    start_s: f64,
    time_s: Vec<f64>,
    /// Place \[m\] and rotation vector \[rad\] of each body, shape (instants, bodies).
    poses: Vec<[f64; 6]>,
    /// Names of the measured keypoints, shape (K).
    keypoints: Vec<String>,
    /// Their places \[m\], shape (instants, K), with the simulation's depth; NaN where one was not observed.
    measured_m: Vec<[f64; 3]>,
}

impl Motion {
    /// How `model`, the calibrated one, moves in `run`.
    pub fn of(model: &Model, run: &FittedRun) -> Self {
        let view = View::of(&run.measured);
        let kept = kept(&run.simulated.time_s);
        let all = run.poses(model);
        let points: Vec<usize> = (0..run.measured.keypoints.len())
            .filter(|&k| encoded_joint(&run.measured.keypoints[k]).is_none())
            .collect();
        let measured = |instant: usize, k: usize| {
            let place = run.measured.at(instant, k);
            let [right, up] = view.seen(place);
            let mut world = view.world([right, up]);
            // the picture tells no depth: the plane of motion is taken
            world[view.depth_axis()] =
                Some(place[view.depth_axis()]).filter(|m| m.is_finite()).unwrap_or(0.0);
            world
        };
        Self {
            id: run.id.clone(),
            view,
            shapes: model.geoms.iter().filter_map(shape).collect(),
            bodies: model.bodies.len(),
            start_s: run.start_s,
            time_s: kept.iter().map(|&i| run.simulated.time_s[i]).collect(),
            poses: kept.iter().filter_map(|&i| all.get(i)).flat_map(bodies).collect(),
            keypoints: points.iter().map(|&k| run.measured.keypoints[k].clone()).collect(),
            measured_m: kept.iter().flat_map(|&i| points.iter().map(move |&k| measured(i, k))).collect(),
        }
    }

    fn json(&self) -> Value {
        let [(right, _), (up, _)] = self.view.seen_axes();
        json!({
            "id": self.id,
            "axes": [right, up],
            "shapes": self.shapes,
            "bodies": self.bodies,
            "start": whole(self.start_s, TIME_UNIT_S),
            "times": self.time_s.iter().map(|&time_s| whole(time_s, TIME_UNIT_S)).collect::<Vec<_>>(),
            "poses": packed(self.poses.iter().flat_map(|[x, y, z, a, b, c]| {
                [x, y, z].map(|m| (m, PLACE_UNIT_M)).into_iter().chain([a, b, c].map(|rad| (rad, TURN_UNIT_RAD)))
            })),
            "keypoints": self.keypoints,
            "joined": joined(&self.keypoints),
            "measured": packed(self.measured_m.iter().flatten().map(|m| (m, PLACE_UNIT_M))),
        })
    }
}

/// Indices of the instants that are shown: thinned evenly to the rate of a screen and the size of a page.
fn kept(time_s: &[f64]) -> Vec<usize> {
    let (Some(first), Some(last)) = (time_s.first(), time_s.last()) else { return Vec::new() };
    /// Intervals down to this share of the least one are accepted: the image rate of a camera varies a little. Chosen.
    const INTERVAL_TOLERANCE_SHARE: f64 = 0.9;
    let least_s = INTERVAL_TOLERANCE_SHARE * (1.0 / POSE_RATE_MAX_HZ).max((last - first) / POSES_MAX as f64);
    let mut kept: Vec<usize> = Vec::new();
    for (i, time) in time_s.iter().enumerate() {
        if kept.last().is_none_or(|&before| time - time_s[before] >= least_s) {
            kept.push(i);
        }
    }
    kept
}

fn bodies(poses: &Poses) -> impl Iterator<Item = [f64; 6]> {
    poses.body_pos.iter().zip(&poses.body_rot).map(|(place, Mat3(rows))| {
        let rotation = Rotation3::from_matrix_unchecked(Matrix3::from_fn(|i, j| rows[i][j]));
        let turn = UnitQuaternion::from_rotation_matrix(&rotation).scaled_axis();
        let [x, y, z] = place.0;
        [x, y, z, turn.x, turn.y, turn.z]
    })
}

fn shape(geom: &Geom<f64>) -> Option<Value> {
    let kind = match geom.kind {
        GeomKind::Sphere => "sphere",
        GeomKind::Capsule => "capsule",
        GeomKind::Cylinder => "cylinder",
        GeomKind::Ellipsoid => "ellipsoid",
        GeomKind::Box => "box",
        GeomKind::Plane => return None,
    };
    let rounded = |value: f64| (value * 1e6).round() / 1e6;
    let [w, x, y, z] = geom.quat.0.map(rounded);
    Some(json!({
        "body": geom.body, "kind": kind, "size": geom.size.map(rounded), "at": geom.pos.0.map(rounded), "turn": [x, y, z, w],
    }))
}

/// Pairs of keypoints between which there is a line: neighbours along the mechanism or along one arm.
fn joined(names: &[String]) -> Vec<[usize; 2]> {
    let parts = |name: &str| {
        let (arm, number) = name.rsplit_once('P')?;
        Some((arm.to_owned(), number.parse::<usize>().ok()?))
    };
    let known: Vec<_> = names.iter().map(|name| parts(name)).collect();
    let next = |(i, part): (usize, &Option<(String, usize)>)| {
        let (arm, number) = part.as_ref()?;
        let next = Some((arm.clone(), number + 1));
        Some([i, known.iter().position(|other| *other == next)?])
    };
    known.iter().enumerate().filter_map(next).collect()
}

fn whole(value: f64, unit: f64) -> i64 {
    (value / unit).round() as i64
}

/// Numbers, each in its unit; beyond what 16 bits hold they stay at the end.
fn packed<'a>(values: impl Iterator<Item = (&'a f64, f64)>) -> String {
    let limit = i64::from(i16::MAX);
    let small = |(value, unit): (&f64, f64)| match value.is_finite() {
        true => whole(*value, unit).clamp(-limit, limit) as i16,
        false => GAP,
    };
    STANDARD.encode(values.flat_map(|value| small(value).to_le_bytes()).collect::<Vec<u8>>())
}

/// What makes the view move.
pub(super) const SCRIPT: &str = include_str!("motion.js");

/// The motion in space, to be turned and played.
pub(super) fn section(data: &ReportData) -> Markup {
    if data.motions.is_empty() {
        return html! {};
    }
    // As an attribute it is text like any other, whatever a run is called.
    let motions = Value::Array(data.motions.iter().map(Motion::json).collect()).to_string();
    html! {
        section #motion data-motion=(motions) {
            h2 { "Motion in space" }
            p.legend {
                span.key.simulated {} "simulated, with the model's shapes"
                span.key.measured {} "measured keypoints; their distance from the camera is taken from the simulation"
            }
            p.fallback { "This view needs WebGL and scripts; runs have figures of the same motion." }
            div.view hidden {
                canvas tabindex="0" role="img" aria-label="The mechanism in space; arrow keys turn it, plus and minus zoom, space plays" {}
                div.controls {
                    @if data.motions.len() > 1 {
                        label { "run " select.run { @for motion in &data.motions { option { (motion.id) } } } }
                    }
                    button.play type="button" { "play" }
                    label.time { span.unseen { "time" } input type="range" min="0" value="0"; output {} }
                    label { "speed " select.speed {
                        @for speed in ["0.1", "0.25", "0.5", "1", "2"] {
                            option value=(speed) selected[speed == "1"] { (speed) "×" }
                        }
                    } }
                    button.front type="button" { "as filmed" }
                    button.reset type="button" { "reset" }
                }
                p.lead {
                    "Drag or use the arrow keys to turn it; pinch, use the wheel (once clicked) or + and − to zoom; space plays. "
                    "The grid in the plane of motion has cells of " span.net {} "."
                }
            }
        }
    }
}

#[cfg(test)]
pub(super) mod tests {
    use ident::experiment::Use;
    use sim::Trajectory;

    use super::*;

    const ARM: &str = r#"<mujoco><worldbody><body name="a"><joint name="q1" axis="0 -1 0"/>
        <geom type="capsule" size="0.005 0.02" pos="0 0 -0.02" mass="0.01"/><site name="P0"/>
        <body name="b" pos="0 0 -0.04"><joint name="q2" axis="0 -1 0"/>
        <geom type="ellipsoid" size="0.004 0.003 0.02" pos="0 0 -0.02" mass="0.01"/><site name="P1"/><site name="P2" pos="0 0 -0.04"/>
        </body></body></worldbody></mujoco>"#;

    /// Two links that swing.
    pub(crate) fn sample(id: &str) -> Motion {
        let model = Model::from_mjcf(ARM).unwrap();
        Motion { id: id.into(), ..Motion::of(&model, &moved(&model)) }
    }

    fn unpacked(text: &str) -> Vec<i16> {
        STANDARD.decode(text).unwrap().chunks(2).map(|two| i16::from_le_bytes([two[0], two[1]])).collect()
    }

    /// Two hundred images a second for a second.
    fn moved(model: &Model) -> FittedRun {
        let time_s: Vec<f64> = (0..200).map(|i| f64::from(i) * 0.005).collect();
        let qpos: Vec<f64> = time_s.iter().flat_map(|t| [(6.0 * t).sin(), 3.0 * t]).collect();
        let mut measured = Trajectory {
            time_s: time_s.clone(),
            keypoints: vec!["P1".into(), "P2".into()],
            ..Trajectory::default()
        };
        let mut simulated = measured.clone();
        for q in qpos.chunks(2) {
            let sites = model.poses(q).site_pos;
            simulated.position_m.extend(sites[1..].iter().map(|site| site.0));
            measured.position_m.extend(sites[1..].iter().map(|site| [site.0[0], f64::NAN, site.0[2]]));
        }
        measured.position_m[1] = [f64::NAN; 3];
        FittedRun {
            id: "run".into(),
            usage: Use::Fit,
            initial: model.rest_state(),
            start_s: 0.1,
            scored_from_s: 0.1,
            simulated,
            qpos,
            base: None,
            measured,
            touch: None,
        }
    }

    #[test]
    fn poses_on_the_page_are_the_models_and_carry_the_shapes_to_the_keypoints() {
        let model = Model::from_mjcf(ARM).unwrap();
        let run = moved(&model);
        let json = Motion::of(&model, &run).json();
        let times: Vec<f64> =
            json["times"].as_array().unwrap().iter().map(|ms| ms.as_f64().unwrap() * TIME_UNIT_S).collect();
        assert!((55..=67).contains(&times.len()), "{} poses of a second", times.len());
        let poses = unpacked(json["poses"].as_str().unwrap());
        let measured = unpacked(json["measured"].as_str().unwrap());
        assert_eq!(poses.len(), times.len() * 3 * 6);
        assert_eq!(&measured[3..6], [GAP, 0, GAP], "a gap");
        for (frame, time_s) in times.iter().enumerate().skip(1) {
            let q = [(6.0 * time_s).sin(), 3.0 * time_s];
            let wanted = model.poses(&q);
            for body in 0..3 {
                let pose = &poses[(frame * 3 + body) * 6..][..6];
                let turn = UnitQuaternion::from_scaled_axis(nalgebra::Vector3::from_fn(|i, _| {
                    f64::from(pose[3 + i]) * TURN_UNIT_RAD
                }));
                // the tip in the second link's frame, by the page's numbers
                let tip = turn * nalgebra::Vector3::new(0.0, 0.0, -0.04);
                for axis in 0..3 {
                    let place = f64::from(pose[axis]) * PLACE_UNIT_M;
                    assert!((place - wanted.body_pos[body].0[axis]).abs() < 0.51 * PLACE_UNIT_M);
                    if body == 2 {
                        let seen = f64::from(measured[(frame * 2 + 1) * 3 + axis]) * PLACE_UNIT_M;
                        assert!((place + tip[axis] - seen).abs() < 1.1 * PLACE_UNIT_M, "{frame} {axis}");
                    }
                }
            }
        }
        assert_eq!(json["joined"], json!([[0, 1]]));
        let shapes = json["shapes"].as_array().unwrap();
        assert_eq!((&shapes[0]["kind"], &shapes[1]["kind"]), (&json!("capsule"), &json!("ellipsoid")));
    }

    #[test]
    fn arms_are_joined_each_by_itself() {
        let names = ["a1P0", "a1P1", "a2P0", "a2P1", "body"].map(String::from);
        assert_eq!(joined(&names), [[0, 1], [2, 3]]);
    }

    #[test]
    fn long_runs_are_thinned_to_what_a_page_bears() {
        let time_s: Vec<f64> = (0..60_000).map(|i| f64::from(i) * 0.01).collect();
        let kept = kept(&time_s);
        assert!(kept.len() <= POSES_MAX * 6 / 5, "{}", kept.len());
    }
}
