//! What physics says must come of each cause.
#![allow(clippy::unwrap_used, reason = "tests")]

use super::{Cause, Role};
use crate::dynamics::restraint::multiply;
use crate::fluid::added_mass;
use crate::math::{Quat, Vec3};
use crate::model::{Integrator, Model, State};
use crate::rollout::{RolloutOptions, rollout};
use crate::simulator::{Engine, Simulator};
use crate::space::{Planar, Plane, Space, Spatial};
use crate::{Command, Rollout};

/// Rounding of a few thousand steps.
const ROUNDING: f64 = 1e-10;
/// The error of MuJoCo's quadrature for added mass.
const QUADRATURE: f64 = 1e-5;

fn chain(name: &str) -> Model {
    let text = match name {
        "passive" => include_str!("../../tests/data/chain_passive.xml"),
        _ => include_str!("../../tests/data/chain_active.xml"),
    };
    Model::from_mjcf(text).unwrap()
}

fn mjcf(option: &str, world: &str) -> Model {
    Model::from_mjcf(&format!(
        r#"<mujoco><compiler angle="radian"/><option {option}/><worldbody>{world}</worldbody>
        <actuator/></mujoco>"#
    ))
    .unwrap()
}

fn with(model: &Model, values: &[(&str, f64)]) -> Model {
    let mut model = model.clone();
    for (name, value) in values {
        model.add_effect(name.split('/').next().unwrap()).unwrap();
        model.set_parameter(name, *value).unwrap();
    }
    model
}

fn rk4(timestep_s: f64) -> RolloutOptions {
    RolloutOptions { integrator: Some(Integrator::Rk4), timestep_s: Some(timestep_s), ..Default::default() }
}

fn grid(duration_s: f64, every_s: f64) -> Vec<f64> {
    (0..=(duration_s / every_s).round() as u32).map(|k| f64::from(k) * every_s).collect()
}

fn run(model: &Model, qpos: &[f64], times: &[f64], options: &RolloutOptions) -> Rollout<f64> {
    let state = State { qpos: qpos.to_vec(), qvel: vec![0.0; model.nv()] };
    rollout(model, &state, &Command::default(), times, options).unwrap()
}

/// Parameters' names and values.
type Values = &'static [(&'static str, f64)];

/// One link as in the chain, hanging from a hinge.
fn link() -> Model {
    mjcf(
        r#"gravity="0 0 -9.81" density="1000""#,
        r#"<body name="link" gravcomp="0.8"><joint name="q" axis="0 -1 0"/>
           <geom name="g" type="box" size="0.005 0.0025 0.015" pos="0 0 -0.0125" density="1240"
             fluidshape="ellipsoid" fluidcoef="0.6 0.2 1.6 0.9 0.8"/>
           <site name="P1" pos="0 0 -0.0275"/></body>"#,
    )
}

const LINK_KG: f64 = 1240.0 * 8.0 * 0.005 * 0.0025 * 0.015;
const LEVER_M: f64 = 0.0125;
const TIP_M: f64 = 0.0275;
const G: f64 = 9.81;

/// The torque \[N m\] that the causes in `values` exert on the link at the angle `q` and rate `w`.
fn torque(values: &[(&str, f64)], q: f64, w: f64) -> f64 {
    let state = State { qpos: vec![q], qvel: vec![w] };
    let of = |model: &Model| {
        let forces = Simulator::new(model, &RolloutOptions::default()).unwrap().forces(&state, &[]);
        let sum = |parts: [&Vec<f64>; 5]| parts.into_iter().map(|part| part[0]).sum::<f64>();
        sum([&forces.spring, &forces.damper, &forces.gravity_compensation, &forces.fluid, &forces.effect])
            - forces.bias[0]
    };
    of(&with(&link(), values)) - of(&link())
}

fn assert_close(ours: f64, expected: f64, share: f64, what: &str) {
    assert!((ours - expected).abs() <= share * expected.abs(), "{what}: {ours:e}, expected {expected:e}");
}

#[test]
fn causes_have_the_contract_s_names() {
    let names = "added_mass current slosh buoyancy link_mass cob_offset linear_drag drag_exponent wall basset \
         coulomb_friction joint_damping stiffness one_sided_stiffness end_stop backlash servo_delay servo_lag servo_gain \
         servo_rate_limit tether camera_delay camera_scale camera_rotation camera_tilt rolling_shutter lens \
         keypoint_slip";
    let mut expected: Vec<&str> = names.split_whitespace().collect();
    let mut ours: Vec<&str> = Cause::ALL.iter().map(|cause| cause.name()).collect();
    expected.sort_unstable();
    ours.sort_unstable();
    assert_eq!(ours, expected);
    for cause in Cause::ALL {
        let info = cause.info();
        assert!(info.aliases.iter().all(|alias| ours.contains(&alias.name)), "{}", info.name);
        for parameter in info.parameters {
            let [low, high] = parameter.bounds;
            assert!((low..=high).contains(&parameter.neutral) && parameter.typical > 0.0, "{}", info.name);
        }
    }
    assert!("slush".parse::<Cause>().unwrap_err().to_string().contains("slosh"));
}

#[test]
fn sphere_let_go_in_water_speeds_up_with_half_the_displaced_mass() {
    let (density, water): (f64, f64) = (2600.0, 1000.0);
    let sphere = mjcf(
        r#"gravity="0 0 -9.81" density="1000""#,
        &format!(
            r#"<body name="ball" gravcomp="{}"><freejoint/><geom name="g" type="sphere" size="0.01" density="{density}"
               fluidshape="ellipsoid"/></body>"#,
            water / density
        ),
    );
    let falls = |model: &Model| {
        let mut simulator = Simulator::new(model, &RolloutOptions::default()).unwrap();
        simulator.forces(&model.rest_state(), &[]).acceleration[2]
    };
    assert_close(falls(&sphere), -G * (density - water) / density, ROUNDING, "without added mass");
    let whole = with(&sphere, &[("added_mass/scale", 1.0)]);
    let expected = -G * (density - water) / (density + water / 2.0);
    assert_close(falls(&whole), expected, QUADRATURE, "with added mass");
    // by one geom alone
    let own = with(&sphere, &[("added_mass/g", 1.0)]);
    assert_eq!(falls(&own), falls(&whole));
}

#[test]
fn free_ellipsoid_in_still_water_keeps_energy_and_impulse() {
    let r = [0.01, 0.02, 0.035];
    let model = mjcf(
        r#"gravity="0 0 0" density="1000""#,
        r#"<body><freejoint/><geom type="ellipsoid" size="0.01 0.02 0.035" density="1500" fluidshape="ellipsoid"
           fluidcoef="0 0 0 0 0"/></body>"#,
    );
    let body = &model.bodies[1];
    let added = added_mass(r);
    let mass = Vec3(added.mass.map(|m| 1000.0 * m + body.mass));
    let inertia = Vec3(std::array::from_fn(|i| 1000.0 * added.inertia[i] + body.inertia[i]));
    // the body's principal axes are those of the ellipsoid
    assert!((body.principal.0[0].abs() - 1.0).abs() < ROUNDING);
    let start = State { qpos: model.rest_state().qpos, qvel: vec![0.1, -0.2, 0.15, 3.0, 5.0, -2.0] };
    let invariants = |model: &Model, step_s: f64| -> Vec<(f64, Vec3<f64>, Vec3<f64>)> {
        let moved = rollout(model, &start, &Command::default(), &grid(5.0, 0.5), &rk4(step_s)).unwrap();
        let states = moved.qpos.chunks(7).zip(moved.qvel.chunks(6));
        let of = |(q, v): (&[f64], &[f64])| {
            let rot = Quat([q[3], q[4], q[5], q[6]]).matrix();
            let (w, v) = (Vec3([v[3], v[4], v[5]]), rot.apply_transposed(Vec3([v[0], v[1], v[2]])));
            let impulse = rot.apply(mass.times(v));
            let turning = rot.apply(inertia.times(w)) + Vec3([q[0], q[1], q[2]]).cross(impulse);
            (v.dot(mass.times(v)) + w.dot(inertia.times(w)), impulse, turning)
        };
        states.map(of).collect()
    };
    let drifts = |model: &Model, step_s: f64| {
        let all = invariants(model, step_s);
        let (energy, impulse, turning) = all[0];
        all.iter().fold(0.0_f64, |worst, (e, p, l)| {
            let parts = [
                (e / energy - 1.0).abs(),
                (*p - impulse).norm() / impulse.norm(),
                (*l - turning).norm() / turning.norm(),
            ];
            parts.into_iter().fold(worst, f64::max)
        })
    };
    let whole = with(&model, &[("added_mass/scale", 1.0)]);
    let [coarse, fine] = [0.001, 0.0005].map(|step_s| drifts(&whole, step_s));
    let half = drifts(&model, 0.001);
    // what is lost is the integrator's, of fourth order; without the acceleration's part nothing is kept
    assert!(fine < 1e-8 && coarse > 12.0 * fine && half > 0.01, "{coarse:e} {fine:e} {half:e}");
}

#[test]
fn chain_in_water_without_drag_keeps_its_energy_with_added_mass() {
    let mut model = chain("passive");
    model.settings.viscosity = 0.0;
    for geom in &mut model.geoms {
        let none = crate::model::FluidCoefficients {
            blunt: 0.0,
            slender: 0.0,
            angular: 0.0,
            kutta: 0.0,
            magnus: 0.0,
        };
        geom.fluid = geom.fluid.map(|_| none);
    }
    for joint in &mut model.joints {
        joint.damping = [0.0; 3];
    }
    let options = rk4(0.0005);
    let drift = |model: &Model| {
        let moved = run(model, &[1.4, -0.3, 0.2], &grid(2.0, 0.1), &options);
        let mut engine = Engine::<Spatial<f64>>::new(model, (), &options).unwrap();
        let mut momentum = vec![0.0; 3];
        let energies: Vec<f64> = moved
            .qpos
            .chunks(3)
            .zip(moved.qvel.chunks(3))
            .map(|(q, v)| {
                engine.position_stage(q);
                multiply(&engine.plant, &engine.work.mass, v, &mut momentum);
                let kinetic: f64 = 0.5 * v.iter().zip(&momentum).map(|(v, p)| v * p).sum::<f64>();
                let weight = |body: usize| {
                    let body = &model.bodies[body];
                    body.mass * (1.0 - body.gravity_compensation) * G
                };
                let heights =
                    (1..4).map(|body| weight(body) * (engine.work.com[body][2] + engine.work.pos[1][2]));
                kinetic + heights.sum::<f64>()
            })
            .collect();
        let most = energies.iter().fold(0.0_f64, |most, e| most.max((e - energies[0]).abs()));
        most / energies[0].abs()
    };
    // fourth order over half a millisecond
    let whole = drift(&with(&model, &[("added_mass/scale", 1.0)]));
    assert!(whole < 1e-8, "{whole:e}");
}

#[test]
fn each_cause_exerts_its_closed_form_on_one_link() {
    let (q, w) = (0.7_f64, 3.0_f64);
    let held = 0.8 * LINK_KG;
    let cases: [(&str, Values, f64); 10] = [
        ("buoyancy", &[("buoyancy/scale", 0.1)], 0.1 * held * G * LEVER_M * q.sin()),
        ("link_mass", &[("link_mass/scale", 0.1)], -0.1 * LINK_KG * G * LEVER_M * q.sin()),
        ("joint_damping", &[("joint_damping/damping", 1e-6)], -1e-6 * w),
        ("stiffness", &[("stiffness/stiffness", 1e-4)], -1e-4 * q),
        ("one-sided stiffness", &[("one_sided_stiffness/stiffness", 1e-4)], -1e-4 * q),
        ("end stop", &[("end_stop/stiffness", 1e-3), ("end_stop/angle", 0.5)], -1e-3 * (q - 0.5)),
        (
            "coulomb_friction",
            &[("coulomb_friction/torque", 2e-6), ("coulomb_friction/rate", 0.4)],
            -2e-6 * w / w.hypot(0.4),
        ),
        (
            "cob_offset",
            &[("cob_offset/along", 1e-3), ("cob_offset/across", 5e-4)],
            held * G * (1e-3 * q.sin() + 5e-4 * q.cos()),
        ),
        ("linear_drag", &[("linear_drag/drag", 1e-3)], -1e-3 * LEVER_M * LEVER_M * w),
        (
            "tether",
            &[("tether/stiffness", 0.01), ("tether/x", 0.05), ("tether/z", 0.02)],
            0.01 * TIP_M * (0.05 * q.cos() + 0.02 * q.sin()),
        ),
    ];
    for (what, values, expected) in cases {
        assert_close(torque(values, q, w), expected, 1e-9, what);
    }
    assert_eq!(torque(&[("one_sided_stiffness/stiffness", 1e-4)], -q, w), 0.0);
    assert_eq!(torque(&[("end_stop/stiffness", 1e-4), ("end_stop/angle", 0.8)], q, w), 0.0);
}

#[test]
fn drag_grows_near_a_wall_and_with_another_power_of_speed() {
    let mut still = link();
    still.settings.gravity = Vec3::ZERO;
    let (q, w) = (0.4_f64, 3.0_f64);
    let state = State { qpos: vec![q], qvel: vec![w] };
    let fluid = |model: &Model| {
        let forces = Simulator::new(model, &RolloutOptions::default()).unwrap().forces(&state, &[]);
        (forces.fluid[0], forces.effect[0])
    };
    let wall = with(&still, &[("wall/scale", 0.8), ("wall/x", 0.03), ("wall/reach", 0.01)]);
    let (drag, more) = fluid(&wall);
    assert_close(more, drag * 0.8 * (-(0.03 - LEVER_M * q.sin()) / 0.01).exp(), 1e-9, "wall");
    // the link turns about its end: only its drag on moving changes, with its speed
    let mut spinless = still.clone();
    spinless.geoms[0].fluid.as_mut().unwrap().angular = 0.0;
    spinless.geoms[0].fluid.as_mut().unwrap().slender = 0.0;
    let powered = with(&spinless, &[("drag_exponent/exponent", -0.4), ("drag_exponent/speed", 0.05)]);
    let (drag, more) = fluid(&powered);
    let factor = ((LEVER_M * w / 0.05).powi(2) + 1e-6).powf(-0.2);
    assert_close(more, drag * (factor - 1.0), 1e-9, "drag exponent");
}

#[test]
fn moving_water_is_felt_as_moving_backwards() {
    let slide = mjcf(
        r#"gravity="0 0 0" density="1000""#,
        r#"<body><joint type="slide" axis="1 0 0"/><geom type="sphere" size="0.01" fluidshape="ellipsoid"
           fluidcoef="0.5 0 0 0 0"/></body>"#,
    );
    let force = |values: &[(&str, f64)], v: f64| {
        let state = State { qpos: vec![0.0], qvel: vec![v] };
        let mut simulator = Simulator::new(&with(&slide, values), &RolloutOptions::default()).unwrap();
        simulator.forces(&state, &[]).fluid[0]
    };
    assert_eq!(force(&[("current/x", 0.05)], 0.0), force(&[], -0.05));
    assert_eq!(force(&[("slosh/cos", 0.05)], 0.0), force(&[], -0.05));
    assert_eq!(force(&[("slosh/sin", 0.05)], 0.0), 0.0);
    // heavy drag: the sphere swings with the water
    let swung = with(&slide, &[("slosh/sin", 0.05), ("slosh/frequency", 1.0), ("linear_drag/drag", 10.0)]);
    let carried = run(&swung, &[0.0], &[1.25], &rk4(0.0005));
    assert_close(carried.qvel[0], 0.05, 0.01, "slosh");
}

#[test]
fn history_of_steady_acceleration_grows_with_the_root_of_time() {
    let ball = mjcf(
        r#"gravity="0 0 -2" density="1e-9""#,
        r#"<body><joint type="slide" axis="0 0 -1"/><geom type="sphere" size="0.1" fluidshape="ellipsoid"
           fluidcoef="0 0 0 0 0"/></body>"#,
    );
    let (c, m, t) = (1e-2, ball.bodies[1].mass, 0.8_f64);
    for timestep_s in [0.001, 0.01] {
        let fallen = run(&with(&ball, &[("basset/history", c)]), &[0.0], &[t], &rk4(timestep_s));
        // m dv/dt = m g - 2 c g sqrt(t)
        let lost = 2.0 * t - fallen.qvel[0];
        assert_close(lost, c / m * 2.0 * 4.0 / 3.0 * t.powf(1.5), 0.02, "history");
    }
}

/// Every cause at once, each at its typical size.
fn all_causes(model: &Model) -> Model {
    let mut model = model.clone();
    for cause in Cause::ALL {
        model.add_effect(cause.name()).unwrap();
    }
    for (effect, place) in (0..model.effects.len()).flat_map(|i| (0..40).map(move |k| (i, k))) {
        let effect = &mut model.effects[effect];
        let Some(parameter) = effect.parameters().nth(place) else { continue };
        if matches!(parameter.role, Role::Size | Role::Switch) {
            effect.values[place] = 0.3 * parameter.typical;
        }
    }
    model
}

fn moved_in<S: Space<T = f64>>(model: &Model, layout: S::Layout, options: &RolloutOptions) -> State {
    let altered = model.altered();
    let model = altered.as_ref().unwrap_or(model);
    let mut engine = Engine::<S>::new(model, layout, options).unwrap();
    let mut state = State { qpos: vec![0.9, -0.4, 0.3], qvel: vec![0.5, -1.0, 2.0] };
    for step in 0..250 {
        assert!(engine.step_with(&mut state, f64::from(step) * 0.002, 0.002, &|_, t| 0.5 * (6.0 * t).sin()));
    }
    state
}

#[test]
fn plane_and_space_move_alike_with_every_cause() {
    for (name, integrator) in
        [("passive", Integrator::Rk4), ("active", Integrator::Rk4), ("active", Integrator::Euler)]
    {
        let options = RolloutOptions { integrator: Some(integrator), ..rk4(0.002) };
        let model = all_causes(&chain(name));
        let plane = Plane::of(&model.altered().unwrap()).unwrap();
        let flat = moved_in::<Planar<f64>>(&model, plane, &options);
        let full = moved_in::<Spatial<f64>>(&model, (), &options);
        for (a, b) in flat.qpos.iter().chain(&flat.qvel).zip(full.qpos.iter().chain(&full.qvel)) {
            assert!((a - b).abs() < 1e-11, "{name} {integrator:?}: {a} {b}");
        }
    }
}

#[test]
fn mechanism_in_another_plane_feels_the_picture_s_causes_in_space() {
    let turned = mjcf(
        r#"gravity="0 0 -9.81" density="1000""#,
        r#"<body><joint axis="1 0 0"/><geom type="box" size="0.005 0.0025 0.015" pos="0 0 -0.0125"
           fluidshape="ellipsoid"/></body>"#,
    );
    assert!(Plane::of(&turned).is_some() && Plane::of(&with(&turned, &[("current/x", 0.0)])).is_none());
}

#[test]
fn neutral_causes_change_nothing_and_absent_ones_not_a_bit() {
    let times = grid(1.0, 0.05);
    for name in ["passive", "active"] {
        let model = chain(name);
        let plain = run(&model, &[1.2, 0.1, -0.2], &times, &rk4(0.005));
        let mut neutral = model.clone();
        for cause in Cause::ALL {
            neutral.add_effect(cause.name()).unwrap();
        }
        let same = run(&neutral, &[1.2, 0.1, -0.2], &times, &rk4(0.005));
        for (a, b) in plain.position_m.iter().flatten().zip(same.position_m.iter().flatten()) {
            assert!((a - b).abs() < 1e-12, "{name} {a} {b}");
        }
        for cause in Cause::ALL {
            assert!(neutral.remove_effect(*cause));
        }
        assert_eq!(run(&neutral, &[1.2, 0.1, -0.2], &times, &rk4(0.005)), plain);
    }
}

#[test]
fn folded_causes_move_the_same_way_without_any() {
    let times = grid(1.0, 0.05);
    let model = with(
        &chain("active"),
        &[
            ("current/x", 0.02),
            ("buoyancy/scale", 0.05),
            ("link_mass/link2", 0.1),
            ("joint_damping/damping", 1e-6),
            ("stiffness/q3", 1e-5),
            ("servo_gain/scale", 0.1),
            ("keypoint_slip/P2", 0.001),
        ],
    );
    let folded = model.folded();
    assert!(folded.lost.is_empty() && folded.altered.is_empty() && folded.model.effects().is_empty());
    let command =
        Command { actuators: vec!["servo".into()], time_s: vec![0.0, 1.0], angle_rad: vec![0.0, 0.8] };
    let moved = |model: &Model| {
        rollout(model, &model.rest_state(), &command, &times, &rk4(0.0005)).unwrap().position_m
    };
    for (a, b) in moved(&model).iter().flatten().zip(moved(&folded.model).iter().flatten()) {
        assert!((a - b).abs() < 1e-9, "{a} {b}");
    }
    let lost = with(&model, &[("added_mass/scale", 1.0), ("coulomb_friction/torque", 1e-6)]).folded();
    assert_eq!((lost.lost, lost.altered), (vec![Cause::AddedMass], vec![Cause::CoulombFriction]));
}

#[test]
fn causes_survive_the_way_through_mjcf() {
    let model = all_causes(&chain("active"));
    let text = model.to_mjcf("test");
    let back = Model::from_mjcf(&text).unwrap();
    assert_eq!(back.effects(), model.effects());
    assert!(text.contains("Except for the causes") && !chain("active").to_mjcf("").contains("custom"));
    let misspelt = text.replace("added_mass/scale", "added_mass/skale");
    assert!(Model::from_mjcf(&misspelt).unwrap_err().to_string().contains("added_mass/scale"));
    let foreign = text.replace("added_mass/scale", "my/number");
    assert!(Model::from_mjcf(&foreign).is_ok());
}

/// The list of docs/causes.md.
fn listed() -> String {
    let mut page = String::new();
    for cause in Cause::ALL {
        let info = cause.info();
        page += &format!("### `{}`\n\n{}. {}.\n\n", info.name, capital(info.sentence), info.formula);
        page += &format!("Source: {}.\n\n", info.source);
        page += "| parameter | unit | bounds | neutral | part | meaning |\n| --- | --- | --- | --- | --- | --- |\n";
        for parameter in info.parameters {
            let own = match parameter.per {
                super::Per::Model => parameter.name.to_owned(),
                per => format!("<{}>", format!("{per:?}").to_lowercase()),
            };
            let part = match parameter.role {
                Role::Size if parameter.per_run => "size, each run its own",
                Role::Size => "size",
                Role::Switch => "switch",
                Role::Hidden(_) => "hidden, tried on a grid",
                Role::Choice(_) => "choice",
                Role::Detail => "detail",
            };
            let [low, high] = parameter.bounds;
            page += &format!(
                "| `{}/{own}` | {} | {low}..{high} | {} | {part} | {} |\n",
                info.name, parameter.unit, parameter.neutral, parameter.meaning
            );
        }
        for alias in info.aliases {
            let when = match alias.when {
                super::AliasWhen::UnlessWeighed => "unless both weights carry a prior",
                super::AliasWhen::EveryRunDriven => "where every run is driven",
            };
            page += &format!("\nNo video tells it from `{}` {when}.\n", alias.name);
        }
        let held = match info.mjcf {
            Some(mjcf) if mjcf.exact => format!("MJCF holds it: {}.", mjcf.how),
            Some(mjcf) => format!("MJCF holds it in a slightly other form: {}.", mjcf.how),
            None => "MJCF cannot hold it.".into(),
        };
        page += &format!("\n{held}\n\n");
    }
    page
}

fn capital(sentence: &str) -> String {
    let (first, rest) = sentence.split_at(1);
    first.to_uppercase() + rest
}

#[test]
fn the_page_of_causes_lists_what_the_causes_say() {
    let page = std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/causes.md")).unwrap();
    let (_, list) = page.split_once("## The causes\n\n").unwrap();
    let ours = listed();
    // the page is made by copying this
    assert!(list.trim() == ours.trim(), "{ours}");
}

/// What the servo of the driven chain gets, by `law` in tiny steps from the state at rest.
fn stepped(command: &Command, end_s: f64, mut law: impl FnMut(f64, f64, f64) -> f64) -> f64 {
    const STEPS: u32 = 400_000;
    let h = end_s / f64::from(STEPS);
    (1..=STEPS).fold(command.at(0, 0.0), |y, step| law(y, command.at(0, f64::from(step) * h), h))
}

#[test]
fn drives_obey_their_laws_on_any_command() {
    let command = Command {
        actuators: vec!["servo".into()],
        time_s: vec![0.05, 0.2, 0.31, 0.5, 0.52, 0.9],
        angle_rad: vec![0.1, 0.5, -0.3, 0.4, 0.4, 0.0],
    };
    let model = chain("active");
    let path = |values: &[(&str, f64)]| super::CommandPath::new(&with(&model, values), &command);
    let limited = path(&[("servo_rate_limit/share", 1.0), ("servo_rate_limit/rate", 3.0)]);
    let lagging = path(&[("servo_lag/time", 0.03)]);
    let loose = path(&[("backlash/half_width", 0.05)]);
    let all = path(&[
        ("servo_rate_limit/share", 1.0),
        ("servo_rate_limit/rate", 3.0),
        ("servo_lag/time", 0.03),
        ("servo_gain/scale", 0.1),
        ("servo_delay/delay", 0.04),
    ]);
    let limit = |y: f64, u: f64, h: f64| y + (u - y).clamp(-3.0 * h, 3.0 * h);
    let lag = |y: f64, u: f64, h: f64| y + (u - y) * h / 0.03;
    for time_s in [0.02, 0.13, 0.22, 0.3, 0.37, 0.48, 0.51, 0.7, 1.2] {
        let cases = [
            ("rate", limited.at(0, time_s), stepped(&command, time_s, limit)),
            ("lag", lagging.at(0, time_s), stepped(&command, time_s, lag)),
            ("play", loose.at(0, time_s), stepped(&command, time_s, |y, u, _| y.clamp(u - 0.05, u + 0.05))),
        ];
        for (what, ours, expected) in cases {
            // first order in steps of some microseconds
            assert!((ours - expected).abs() < 1e-4, "{what} at {time_s} s: {ours} {expected}");
        }
        let mut limited = 1.1 * command.at(0, 0.0);
        let expected = if time_s < 0.04 {
            limited
        } else {
            let scaled =
                Command { angle_rad: command.angle_rad.iter().map(|a| 1.1 * a).collect(), ..command.clone() };
            stepped(&scaled, time_s - 0.04, |y, u, h| {
                limited = limit(limited, u, h);
                lag(y, limited, h)
            })
        };
        assert!((all.at(0, time_s) - expected).abs() < 1e-4, "all at {time_s} s");
    }
    // rows that come in one by one make the same path
    let first = Command { time_s: vec![0.05], angle_rad: vec![0.1], ..command.clone() };
    let mut growing = super::CommandPath::new(&with(&model, &[("servo_lag/time", 0.03)]), &first);
    for (&time_s, &angle) in command.time_s.iter().zip(&command.angle_rad).skip(1) {
        growing.push(time_s, &[angle]);
    }
    assert_eq!(growing.at(0, 0.7), lagging.at(0, 0.7));
}

#[test]
fn camera_sees_points_where_they_are_when_it_looks() {
    let model = chain("passive");
    let start = [1.3, 0.2, -0.4];
    let times = grid(0.8, 0.05);
    let seen = |values: &[(&str, f64)], times: &[f64]| {
        run(&with(&model, values), &start, times, &rk4(0.005)).position_m
    };
    let delay = 0.0123;
    let later: Vec<f64> = times.iter().map(|t| t + delay).collect();
    // both are cubics between steps, one in angles, one in positions
    const BETWEEN_M: f64 = 1e-8;
    let worst = |a: &[[f64; 3]], b: &[[f64; 3]]| {
        let apart = a.iter().flatten().zip(b.iter().flatten()).map(|(a, b)| (a - b).abs());
        apart.fold(0.0, f64::max)
    };
    assert!(worst(&seen(&[("camera_delay/delay", delay)], &times), &seen(&[], &later)) < BETWEEN_M);
    // nothing moved before the start
    let still = seen(&[("camera_delay/delay", -0.06)], &[0.0, 0.05]);
    assert_eq!(still[..3], still[3..]);

    let slowness = 0.2;
    let rolled = seen(&[("rolling_shutter/slowness", slowness)], &times);
    let plain = seen(&[], &times);
    for (row, &time_s) in times.iter().enumerate().skip(4) {
        for point in 0..3 {
            let when = time_s + slowness * plain[3 * row + point][2];
            let expected = seen(&[], &[when])[point];
            assert!(worst(&[rolled[3 * row + point]], &[expected]) < BETWEEN_M, "{time_s} {point}");
        }
    }
    let turned = seen(
        &[
            ("camera_scale/scale", 0.02),
            ("camera_rotation/angle", 0.1),
            ("camera_tilt/x", 0.5),
            ("lens/radial", 3.0),
        ],
        &times,
    );
    for (ours, [x, y, z]) in turned.iter().zip(&plain) {
        let radial = 1.0 + 3.0 * (x * x + z * z);
        let (x, z) = (x * radial, z * radial);
        let tilt = (1.0 + 0.5 * x) * 1.02;
        let (x, z) = (x * tilt, z * tilt);
        let (sin, cos) = 0.1_f64.sin_cos();
        assert!(worst(&[*ours], &[[cos * x - sin * z, *y, sin * x + cos * z]]) < 1e-14);
    }
    let slipped = seen(&[("keypoint_slip/P3", 0.002)], &times);
    for (ours, plain) in slipped.chunks(3).zip(plain.chunks(3)) {
        let [a, b] = [ours[2], plain[2]].map(|p| (Vec3(p) - Vec3(plain[1])).norm());
        assert!((a - b - 0.002).abs() < 1e-12 && ours[..2] == plain[..2]);
    }
}
