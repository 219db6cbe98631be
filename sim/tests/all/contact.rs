//! Contact: geoms that MuJoCo would let collide are watched, and meet where MuJoCo says; then they move as there.

use crate::common::{model, text};
use sim::batch::{self, Candidate};
use sim::sensitivities::{Direction, sensitivities};
use sim::{
    Command, ContactPoint, ContactWatch, Isa, Method, Model, RolloutOptions, State, Steps, plan, rollout,
};

/// Largest difference of contact points to MuJoCo's \[m\] (chosen).
const POINT_TOLERANCE_M: f64 = 1e-12;
/// Largest difference of sites to MuJoCo's during the first contact \[m\] (chosen): rounding alone gives 2e-16; a box that is to tumble off an edge may take
/// another way for it.
const FIRST_CONTACT_SITE_TOLERANCE_M: f64 = 1e-10;
/// The same over the whole 0.6 s.
const WHOLE_RUN_SITE_TOLERANCE_M: f64 = 1e-8;
/// Smallest displacement of the sites that contact must cause \[m\] (chosen).
const CONTACT_EFFECT_MIN_M: f64 = 1e-3;

/// How much earlier and later than MuJoCo's a contact may be found \[s\]: MuJoCo is asked each 0.1 ms; its own search for smooth shapes stops at a micrometre, at a tenth of a metre a second.
const CONTACT_EARLY_MAX_S: f64 = 1e-4 + 2e-5;
const CONTACT_LATE_MAX_S: f64 = 2e-5;
/// Duration of the cases \[s\].
const CASE_DURATION_S: f64 = 0.6;

fn list(value: &serde_json::Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect()
}

#[test]
fn shapes_touch_when_mujoco_says_so() {
    let cases: serde_json::Value = serde_json::from_str(&text("first_touch.json")).unwrap();
    // what they do to each other from then on has corners, so every step is looked at
    let times: Vec<f64> = (0..=6000).map(|k| f64::from(k) * CASE_DURATION_S / 6000.0).collect();
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
                assert!(
                    -CONTACT_EARLY_MAX_S < late_s && late_s < CONTACT_LATE_MAX_S,
                    "{shapes}: {touch:?}, MuJoCo {time_s} s"
                );
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

#[test]
fn shapes_meet_where_mujoco_says() {
    let cases: serde_json::Value = serde_json::from_str(&text("contact_points.json")).unwrap();
    let (mut points, mut worst) = (0, 0.0_f64);
    for case in cases.as_array().unwrap() {
        let model = Model::from_mjcf(case["xml"].as_str().unwrap()).unwrap();
        let ours = ContactWatch::new(&model).unwrap().points(&model.rest_state().qpos);
        let theirs = case["points"].as_array().unwrap();
        assert_eq!(ours.len(), theirs.len(), "{case}: {ours:?}");
        for theirs in theirs {
            let apart = |point: [f64; 3], other: &str| {
                point.iter().zip(list(&theirs[other])).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
            };
            let off = |ours: &ContactPoint| {
                let distance = (ours.distance_m - theirs["distance_m"].as_f64().unwrap()).abs();
                apart(ours.at_m, "at_m").max(distance).max(0.01 * apart(ours.normal, "normal"))
            };
            // where two directions are as good, the points come in another order
            let off = ours.iter().map(off).fold(f64::INFINITY, f64::min);
            assert!(off < POINT_TOLERANCE_M, "{case}: {ours:?}, MuJoCo {theirs}");
            (points, worst) = (points + 1, worst.max(off));
        }
    }
    println!("{points} points, at most {worst:.1e} m from MuJoCo's");
    assert!(points > 200);
}

#[test]
fn what_touches_moves_as_in_mujoco() {
    let cases: serde_json::Value = serde_json::from_str(&text("contact_runs.json")).unwrap();
    for case in cases.as_array().unwrap() {
        let model = Model::from_mjcf(case["xml"].as_str().unwrap()).unwrap();
        let state = State { qpos: list(&case["qpos"]), qvel: list(&case["qvel"]) };
        let times = list(&case["time_s"]);
        let run = rollout(&model, &state, &Command::default(), &times, &RolloutOptions::default()).unwrap();
        let contact_s = list(&case["contact_s"]);
        let nq = model.nq();
        let mut worst = [0.0_f64; 3];
        for ((qpos, sites), &time_s) in run.qpos.chunks(nq).zip(case["sites"].as_array().unwrap()).zip(&times)
        {
            let theirs = list(sites);
            let ours = model.poses(qpos).site_pos;
            let off = ours.iter().flat_map(|at| at.0).zip(&theirs).map(|(a, b)| (a - b).abs());
            let off = off.fold(0.0, f64::max);
            let part = usize::from(time_s >= contact_s[0]) + usize::from(time_s > contact_s[1]);
            worst[part] = worst[part].max(off);
        }
        let name = case["name"].as_str().unwrap();
        println!(
            "{name}: {:.1e} m before, {:.1e} m over the first contact ({:.3} to {:.3} s), {:.1e} m after",
            worst[0], worst[1], contact_s[0], contact_s[1], worst[2]
        );
        assert!(
            worst[0].max(worst[1]) < FIRST_CONTACT_SITE_TOLERANCE_M && worst[2] < WHOLE_RUN_SITE_TOLERANCE_M,
            "{name}"
        );
        let off = r#"<option><flag contact="disable"/></option><worldbody>"#;
        let through = Model::from_mjcf(&case["xml"].as_str().unwrap().replace("<worldbody>", off)).unwrap();
        let run = rollout(&through, &state, &Command::default(), &times, &RolloutOptions::default()).unwrap();
        let theirs = list(case["sites"].as_array().unwrap().last().unwrap());
        let ours = through.poses(&run.qpos[run.qpos.len() - nq..]).site_pos;
        let elsewhere =
            ours.iter().flat_map(|at| at.0).zip(&theirs).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(elsewhere > CONTACT_EFFECT_MIN_M, "{name}: {elsewhere:e} m");
    }
}

/// A ball of 0.1 kg on a floor, its parameters as given.
fn ball(geom: &str, option: &str) -> Model {
    Model::from_mjcf(&format!(
        r#"<mujoco><option timestep="0.001" {option}/><worldbody><geom name="floor" type="plane" size="1 1 1"/>
        <body pos="0 0 0.01"><freejoint/><geom name="ball" size="0.01" mass="0.1" {geom}/><site name="P0"/></body>
        </worldbody></mujoco>"#
    ))
    .unwrap()
}

fn states(model: &Model, state: &State, times: &[f64]) -> Vec<State> {
    let run = rollout(model, state, &Command::default(), times, &RolloutOptions::default()).unwrap();
    let rows = run.qpos.chunks(model.nq()).zip(run.qvel.chunks(model.nv()));
    rows.map(|(q, v)| State { qpos: q.to_vec(), qvel: v.to_vec() }).collect()
}

/// At rest the force K d r / R holds the weight m g, with R = (1 - d) / (d m) without friction: the depth r is g (1 - d) / (K d^2),
/// K = 1 / (d tau)^2.
#[test]
fn a_resting_ball_sinks_as_deep_as_its_impedance_says() {
    let model = ball(r#"condim="1" solimp="0.9 0.9 0.001" priority="1""#, "");
    let rest = states(&model, &model.rest_state(), &[2.0]).remove(0);
    let (impedance, gravity) = (0.9_f64, 9.81);
    let stiffness = 1.0 / (impedance * 0.02).powi(2);
    let depth = gravity * (1.0 - impedance) / (stiffness * impedance * impedance);
    let sunk = 0.01 - rest.qpos[2];
    assert!((sunk / depth - 1.0).abs() < 1e-6, "{sunk:e} m, expected {depth:e} m");
}

#[test]
fn a_falling_ball_never_gains_energy() {
    let model = ball("", "");
    let mut start = model.rest_state();
    (start.qpos[2], start.qvel[0], start.qvel[4]) = (0.05, 0.3, 20.0);
    let times: Vec<f64> = (0..=1000).map(|k| 1e-3 * f64::from(k)).collect();
    let inertia = 0.4 * 0.1 * 0.01_f64.powi(2);
    let energy = |state: &State| {
        let squares = |v: &[f64]| v.iter().map(|v| v * v).sum::<f64>();
        0.05 * squares(&state.qvel[..3])
            + 0.5 * inertia * squares(&state.qvel[3..])
            + 0.1 * 9.81 * state.qpos[2]
    };
    let run = states(&model, &start, &times);
    // while it is in contact, the contact keeps some
    let free: Vec<f64> = run.iter().filter(|state| state.qpos[2] > 0.01).map(energy).collect();
    assert!(free.windows(2).all(|pair| pair[1] <= pair[0]), "{free:?}");
    let (first, last) = (energy(&run[0]), energy(&run[1000]));
    assert!(last < 0.5 * first && run.iter().any(|state| state.qpos[2] < 0.01), "{first} {last} J");
}

/// A box on a slope whose tangent is below the coefficient of friction creeps only; above it, it slides with
/// g (sin - mu cos). A soft pyramid is not quite the cone.
#[test]
fn friction_holds_a_box_on_a_slope_up_to_its_cone() {
    let speed = |tangent: f64, cone: &str| {
        let (x, z) = (9.81 * tangent / tangent.hypot(1.0), 9.81 / tangent.hypot(1.0));
        let text = format!(
            r#"<mujoco><option timestep="0.001" gravity="{x} 0 -{z}" cone="{cone}" impratio="100"/><worldbody>
            <geom name="floor" type="plane" size="1 1 1" friction="0.5"/>
            <body pos="0 0 0.005"><freejoint/><geom name="box" type="box" size="0.02 0.02 0.005" friction="0.5"/></body>
            </worldbody></mujoco>"#
        );
        let model = Model::from_mjcf(&text).unwrap();
        let run = states(&model, &model.rest_state(), &[0.5, 1.0]);
        (run[1].qvel[0], (x - (run[1].qvel[0] - run[0].qvel[0]) / 0.5) / z)
    };
    for cone in ["pyramidal", "elliptic"] {
        let (held, _) = speed(0.45, cone);
        assert!(held.abs() < 1e-2, "{cone}: {held} m/s");
        let (_, friction) = speed(0.6, cone);
        assert!((friction / 0.5 - 1.0).abs() < 5e-3, "{cone}: {friction} of the load, expected 0.5");
    }
}

/// The golden case of this name: its model and start.
fn case(name: &str) -> (Model, State) {
    let cases: serde_json::Value = serde_json::from_str(&text("contact_runs.json")).unwrap();
    let case = cases.as_array().unwrap().iter().find(|case| case["name"] == name).unwrap();
    let state = State { qpos: list(&case["qpos"]), qvel: list(&case["qvel"]) };
    (Model::from_mjcf(case["xml"].as_str().unwrap()).unwrap(), state)
}

const WALL: &str = "three links against a wall and their end stops";

/// Steps that are ours, long and planned, meet the wall too: they end where ever shorter ones of MuJoCo's method do.
#[test]
fn planned_steps_meet_the_same_contacts() {
    let (model, state) = case(WALL);
    let times: Vec<f64> = (0..=60).map(|k| 0.01 * f64::from(k)).collect();
    let positions = |options: &RolloutOptions| {
        rollout(&model, &state, &Command::default(), &times, options).unwrap().position_m
    };
    let apart = |a: &[[f64; 3]], b: &[[f64; 3]]| {
        a.iter().flatten().zip(b.iter().flatten()).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
    };
    let fine = positions(&RolloutOptions { timestep_s: Some(1e-5), ..RolloutOptions::default() });
    let planned =
        plan(&model, &state, &Command::default(), &times, &RolloutOptions::default(), 1e-4).unwrap();
    println!("{:?}, {} steps, {:.1e} m", planned.steps.method, planned.steps.ends_s.len(), planned.error_m);
    let steps = |steps: Steps| positions(&RolloutOptions { steps: Some(steps), ..RolloutOptions::default() });
    let off = apart(&steps(planned.steps), &fine);
    println!("{off:.1e} m from steps of 0.01 ms");
    assert!(off < 3e-4, "{off:e}");
    for method in [Method::Rosenbrock, Method::RungeKutta] {
        let off = apart(&steps(Steps::even(method, 1e-3)), &fine);
        println!("{method:?} at 1 ms: {off:.1e} m");
        assert!(off < 1e-4, "{method:?} {off:e}");
    }
}

/// Derivatives go through contact and end stops as differences do, and candidates side by side as one alone. Friction loss is left
/// out, whose derivatives are not contact's.
#[test]
fn derivatives_and_candidates_go_through_contact() {
    for (name, parameter) in [(WALL, "g3/blunt"), ("ellipsoid on the floor, elliptic cone", "shape/blunt")] {
        let (mut model, state) = case(name);
        model.joints.iter_mut().for_each(|joint| joint.friction_loss = 0.0);
        if model.keypoints().is_empty() {
            model.sites[1].name = "P0".into();
        }
        let place = model.find_parameter(parameter).unwrap();
        let times: Vec<f64> = (1..=10).map(|k| 0.05 * f64::from(k)).collect();
        let zeros = || Direction {
            values: vec![0.0],
            qpos: vec![0.0; model.nq()],
            qvel: vec![0.0; model.nv()],
            start_s: 0.0,
        };
        let mut directions = [zeros(), zeros()];
        (directions[0].values[0], directions[1].qvel[0]) = (1.0, 1.0);
        let value = model.parameter(parameter).unwrap();
        let at = |along: &Direction, by: f64| Candidate {
            values: vec![value + by * along.values[0]],
            state: State {
                qpos: state.qpos.clone(),
                qvel: state.qvel.iter().zip(&along.qvel).map(|(v, along)| v + by * along).collect(),
            },
            start_s: 0.0,
        };
        let (none, options) = (Command::default(), RolloutOptions::default());
        let here = at(&directions[0], 0.0);
        let found = sensitivities(&model, &[place], &here, &directions, &none, &times, &options, Isa::best())
            .unwrap();
        const STEP: f64 = 1e-6;
        for (along, slopes) in directions.iter().zip(&found.slopes) {
            let moved = [at(along, STEP), at(along, -STEP), here.clone()];
            let moved =
                batch::positions(&model, &[place], &moved, &none, &times, &options, Isa::best()).unwrap();
            let [up, down, same] = [0, 1, 2].map(|k| moved[k].clone().unwrap());
            assert_eq!(same, found.position_m);
            let largest = slopes.iter().flatten().fold(0.0_f64, |most, slope| most.max(slope.abs()));
            let mut worst = 0.0_f64;
            for ((up, down), slope) in up.iter().zip(&down).zip(slopes) {
                for k in 0..3 {
                    worst = worst.max(((up[k] - down[k]) / (2.0 * STEP) - slope[k]).abs());
                }
            }
            println!("{name}: slopes up to {largest:.1e}, {worst:.1e} from differences");
            assert!(largest > 1e-5 && worst < 1e-6 * largest, "{name}: {worst:e} of {largest:e}");
        }
        let alone = rollout(&model, &state, &none, &times, &options).unwrap();
        assert_eq!(alone.position_m, found.position_m);
    }
}

#[test]
fn contact_parameters_are_read_and_written() {
    let (model, state) = case("sphere on the floor, rolling friction, soft");
    let again = Model::from_mjcf(&model.to_mjcf("")).unwrap();
    assert_eq!(again.geoms[1].surface, model.geoms[1].surface);
    assert_ne!(model.geoms[1].surface, model.geoms[0].surface);
    let (elliptic, _) = case("cylinder on the floor, elliptic cone, spinning friction");
    let written = Model::from_mjcf(&elliptic.to_mjcf("")).unwrap();
    assert_eq!((written.settings.cone, written.settings.impratio), (sim::model::Cone::Elliptic, 4.0));
    assert_eq!(states(&again, &state, &[0.1]), states(&model, &state, &[0.1]));
    let refused = |geom: &str| {
        let text = format!(r#"<mujoco><worldbody><geom size="1" {geom}/></worldbody></mujoco>"#);
        Model::from_mjcf(&text).unwrap_err().to_string()
    };
    assert!(refused(r#"condim="2""#).contains("condim"));
    assert!(refused(r#"solref="0.02 -1""#).contains("solref"));
    assert!(refused(r#"friction="-1""#).contains("friction"));
}
