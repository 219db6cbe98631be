//! Geoms that MuJoCo would let collide are watched: the first touch comes when MuJoCo finds it.
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "tests")]

mod common;

use common::{model, text};
use sim::{Command, ContactWatch, Model, RolloutOptions, State, rollout};

/// MuJoCo is asked each 0.1 ms; its own search for smooth shapes stops at a micrometre, at a tenth of a metre a second.
const BEFORE_S: f64 = 1e-4 + 2e-5;
const AFTER_S: f64 = 2e-5;
/// How long the cases last \[s\].
const SPAN_S: f64 = 0.6;

fn list(value: &serde_json::Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect()
}

#[test]
fn shapes_touch_when_mujoco_says_so() {
    let cases: serde_json::Value = serde_json::from_str(&text("first_touch.json")).unwrap();
    let times: Vec<f64> = (0..=30).map(|k| f64::from(k) * SPAN_S / 30.0).collect();
    let (mut touches, mut latest) = (0, 0.0_f64);
    for case in cases.as_array().unwrap() {
        let model = Model::from_mjcf(case["xml"].as_str().unwrap()).unwrap();
        let state = State { qpos: list(&case["qpos"]), qvel: list(&case["qvel"]) };
        let options = RolloutOptions { timestep_s: Some(1e-4), ..RolloutOptions::default() };
        let run = rollout(&model, &state, &Command::default(), &times, &options).unwrap();
        let touch = ContactWatch::new(&model).unwrap().first_touch(&run);
        let shapes = &case["shapes"];
        match (touch, case["time_s"].as_f64()) {
            (Some(touch), Some(time_s)) => {
                let late_s = touch.time_s - time_s;
                assert!(-BEFORE_S < late_s && late_s < AFTER_S, "{shapes}: {touch:?}, MuJoCo {time_s} s");
                assert_eq!(touch.geoms.geoms, ["first", "second"]);
                (touches, latest) = (touches + 1, latest.max(late_s.abs()));
            }
            (None, None) => {}
            (ours, theirs) => panic!("{shapes}: {ours:?}, MuJoCo {theirs:?}"),
        }
    }
    println!("{touches} touches, at most {latest:.1e} s from MuJoCo's");
    assert!(touches > 30);
}

#[test]
fn models_whose_geoms_never_collide_are_not_watched() {
    for name in ["chain_passive", "arm8", "octopus8"] {
        assert!(ContactWatch::new(&model(name)).is_none());
    }
}

/// A hinged link falls onto a floor; its margin makes it touch earlier, a pair that is excluded never.
#[test]
fn a_falling_link_touches_the_floor_by_name_and_time() {
    let text = |margin: &str| {
        format!(
            r#"<mujoco><worldbody><geom name="floor" type="plane" size="1 1 1" pos="0 0 -0.05"/>
            <body name="link"><joint name="q" axis="0 1 0" pos="0 0 0"/>
              <geom name="leg" type="capsule" size="0.01" fromto="0 0 0 0.08 0 0" {margin}/></body></worldbody></mujoco>"#
        )
    };
    let times: Vec<f64> = (0..=20).map(|k| 0.01 * f64::from(k)).collect();
    let first = |text: &str| {
        let model = Model::from_mjcf(text).unwrap();
        let options = RolloutOptions { timestep_s: Some(1e-4), ..RolloutOptions::default() };
        let run = rollout(&model, &model.rest_state(), &Command::default(), &times, &options).unwrap();
        let touch = ContactWatch::new(&model).unwrap().first_touch(&run).unwrap();
        let row = times.partition_point(|&t| t < touch.time_s);
        (touch, run.qpos[row - 1], run.qpos[row])
    };
    let (touch, before, after) = first(&text(""));
    assert_eq!(touch.geoms.geoms, ["floor", "leg"]);
    // the end of the leg is 10 mm above the floor
    let angle = f64::asin(0.04 / 0.08);
    assert!(before < angle && angle < after, "{before} {angle} {after}");
    let (earlier, ..) = first(&text(r#"margin="0.005""#));
    assert!(earlier.time_s < touch.time_s);
    let again = Model::from_mjcf(&text(r#"margin="0.005""#)).unwrap().to_mjcf("");
    assert_eq!(first(&again).0, earlier);
}
