//! What physics says must come out, whatever any other engine does.

use std::f64::consts::PI;

use crate::common::{model, stroke_command};
use sim::math::{Quat, Vec3};
use sim::{Command, Integrator, Model, Rollout, RolloutError, RolloutOptions, State, rollout};

/// Rounding of a few thousand steps.
const ROUNDING: f64 = 1e-10;

fn rk4(timestep_s: f64) -> RolloutOptions {
    RolloutOptions { integrator: Some(Integrator::Rk4), timestep_s: Some(timestep_s), ..Default::default() }
}

fn grid(duration_s: f64, every_s: f64) -> Vec<f64> {
    (0..=(duration_s / every_s).round() as u32).map(|k| f64::from(k) * every_s).collect()
}

fn run(model: &Model, state: &State, times: &[f64], options: &RolloutOptions) -> Rollout<f64> {
    rollout(model, state, &Command::default(), times, options).unwrap()
}

fn mjcf(option: &str, world: &str) -> Model {
    Model::from_mjcf(&format!(
        r#"<mujoco><compiler angle="radian"/><option {option}/><worldbody>{world}</worldbody></mujoco>"#
    ))
    .unwrap()
}

#[test]
fn small_pendulum_swings_with_the_textbook_period() {
    let (radius, arm, g): (f64, f64, f64) = (0.01, 0.2, 9.81);
    let world = format!(
        r#"<body><joint axis="0 -1 0"/><geom type="sphere" size="{radius}" pos="0 0 -{arm}"/></body>"#
    );
    let model = mjcf("", &world);
    let period = 2.0 * PI * ((arm * arm + 0.4 * radius * radius) / (g * arm)).sqrt();
    let amplitude = 1e-4;
    let state = State { qpos: vec![amplitude], qvel: vec![0.0] };
    let swung = run(&model, &state, &[period / 4.0, period / 2.0, period], &rk4(0.001)).qpos;
    // the amplitude's own share of the period is amplitude^2 / 16
    for (angle, expected) in swung.iter().zip([0.0, -amplitude, amplitude]) {
        assert!((angle - expected).abs() < 1e-7 * amplitude, "{angle} {expected}");
    }
}

#[test]
fn heavy_sphere_sinks_at_its_terminal_velocity() {
    let (r, density, water, g, blunt): (f64, f64, f64, f64, f64) = (0.01, 1200.0, 1000.0, 9.81, 0.5);
    let sphere = |viscosity: f64, water_drag: f64| {
        mjcf(
            &format!(r#"density="{water_drag}" viscosity="{viscosity}""#),
            &format!(
                r#"<body gravcomp="{}"><freejoint/><geom type="sphere" size="{r}" density="{density}"
                   fluidshape="ellipsoid" fluidcoef="{blunt} 0.25 1.5 1 1"/></body>"#,
                water / density
            ),
        )
    };
    let weight = (density - water) * g * 4.0 / 3.0 * PI * r.powi(3);
    let quadratic = (weight / (water * blunt * PI * r * r)).sqrt();
    let stokes = weight / (6.0 * PI * 100.0 * r);
    for (model, expected) in [(sphere(0.0, water), quadratic), (sphere(100.0, 0.0), stokes)] {
        let sunk = run(&model, &model.rest_state(), &[5.0], &rk4(0.0005));
        assert!((sunk.qvel[2] + expected).abs() < 1e-9, "{} {expected}", sunk.qvel[2]);
    }
}

#[test]
fn body_tumbling_freely_keeps_energy_and_angular_momentum() {
    let model = mjcf(
        r#"gravity="0 0 0""#,
        r#"<body><freejoint/><inertial pos="0 0 0" mass="1" diaginertia="0.01 0.02 0.025"/></body>"#,
    );
    let inertia = Vec3([0.01, 0.02, 0.025]);
    let mut state = model.rest_state();
    state.qvel = vec![0.1, -0.2, 0.3, 0.5, 4.0, -0.4];
    let times = grid(10.0, 0.5);
    let tumbled = run(&model, &state, &times, &rk4(0.001));
    let at = |instant: usize| {
        let (q, v) = (&tumbled.qpos[instant * 7..][..7], &tumbled.qvel[instant * 6..][..6]);
        let w = Vec3([v[3], v[4], v[5]]);
        let spin = w.times(inertia);
        (w.dot(spin), Quat([q[3], q[4], q[5], q[6]]).matrix().apply(spin), Vec3([q[0], q[1], q[2]]))
    };
    let (energy, momentum, _) = at(0);
    for (instant, time_s) in times.iter().enumerate() {
        let (e, l, x) = at(instant);
        assert!((e - energy).abs() < ROUNDING && (l - momentum).norm() < ROUNDING, "{e} {energy} {l:?}");
        assert!((x - Vec3([0.1, -0.2, 0.3]) * *time_s).norm() < ROUNDING);
    }
}

#[test]
fn double_pendulum_in_a_vacuum_keeps_its_energy() {
    let (r, arm, g) = (0.02, 0.15, 9.81);
    let link = |inner: &str| {
        format!(
            r#"<body pos="0 0 {}"><joint axis="0 -1 0"/><geom type="sphere" size="{r}" pos="0 0 -{arm}"/>{inner}</body>"#,
            if inner.is_empty() { -arm } else { 0.0 }
        )
    };
    let model = mjcf("", &link(&link("")));
    let m = 1000.0 * 4.0 / 3.0 * PI * r * r * r;
    let energy = |q: &[f64], v: &[f64]| {
        let (a, b) = (q[0], q[0] + q[1]);
        let (wa, wb) = (v[0], v[0] + v[1]);
        let kinetic = 0.5 * m * arm * arm * (2.0 * wa * wa + wb * wb + 2.0 * wa * wb * (a - b).cos())
            + 0.5 * 0.4 * m * r * r * (wa * wa + wb * wb);
        kinetic - m * g * arm * (2.0 * a.cos() + b.cos())
    };
    let state = State { qpos: vec![2.0, 1.0], qvel: vec![0.0; 2] };
    let moved = run(&model, &state, &grid(5.0, 0.1), &rk4(0.0002));
    let start = energy(&state.qpos, &state.qvel);
    for (q, v) in moved.qpos.chunks(2).zip(moved.qvel.chunks(2)) {
        assert!((energy(q, v) / start - 1.0).abs() < 1e-9, "{} {start}", energy(q, v));
    }
}

#[test]
fn mirrored_drop_moves_mirrored() {
    let model = model("chain_passive");
    let times = grid(2.0, 0.05);
    let drop = |angles: [f64; 3]| {
        let state = State { qpos: angles.to_vec(), qvel: vec![0.0; 3] };
        run(&model, &state, &times, &RolloutOptions::default()).position_m
    };
    for (right, left) in drop([1.2, -0.4, 0.3]).iter().zip(drop([-1.2, 0.4, -0.3])) {
        assert!((right[0] + left[0]).abs() < ROUNDING && (right[2] - left[2]).abs() < ROUNDING);
    }
}

#[test]
fn turned_rig_under_turned_gravity_moves_turned() {
    let turn = Quat([0.8, 0.1, -0.5, 0.3]).normalized();
    let upright = model("chain_passive");
    let mut turned = upright.clone();
    turned.settings.gravity = turn.matrix().apply(upright.settings.gravity);
    turned.bodies[1].quat = turn;
    let state = State { qpos: vec![1.0, 0.2, -0.3], qvel: vec![0.0; 3] };
    let times = grid(1.0, 0.1);
    let moved = |model: &Model| run(model, &state, &times, &RolloutOptions::default()).position_m;
    for (there, here) in moved(&turned).into_iter().zip(moved(&upright)) {
        assert!((Vec3(there) - turn.matrix().apply(Vec3(here))).norm() < ROUNDING);
    }
}

#[test]
fn friction_loss_holds_a_small_torque_and_yields_to_a_large_one() {
    let arm = |loss: f64| {
        mjcf(
            "",
            &format!(
                r#"<body><joint axis="0 -1 0" frictionloss="{loss}"/><geom type="box" size="0.01 0.01 0.05"
                   pos="0 0 -0.05"/></body>"#
            ),
        )
    };
    let torque = 1000.0 * 8.0 * 0.01 * 0.01 * 0.05 * 9.81 * 0.05;
    let after = |loss: f64| {
        let state = State { qpos: vec![PI / 2.0], qvel: vec![0.0] };
        PI / 2.0 - run(&arm(loss), &state, &[0.5], &RolloutOptions::default()).qpos[0]
    };
    // MuJoCo's friction is regularised: it creeps where B v / R, with R = (M^-1) / 9 and B = 2 / (0.95 * 0.02 s),
    // balances the torque
    let inertia =
        1000.0 * 8.0 * 0.01 * 0.01 * 0.05 * ((0.1_f64.powi(2) + 0.02_f64.powi(2)) / 12.0 + 0.05_f64.powi(2));
    let crept = torque / inertia / 9.0 * (0.95 * 0.02 / 2.0) * 0.5;
    let (held, fallen) = (after(1.2 * torque), after(0.8 * torque));
    assert!((held / crept - 1.0).abs() < 0.05 && fallen > 0.2, "{held} {crept} {fallen}");
}

#[test]
fn end_stop_catches_a_falling_arm() {
    let model = mjcf(
        "",
        r#"<body><joint axis="0 -1 0" range="0.4 3" damping="1e-4"/><geom type="box" size="0.01 0.01 0.05"
           pos="0 0 -0.05"/></body>"#,
    );
    let state = State { qpos: vec![1.5], qvel: vec![0.0] };
    let rest = run(&model, &state, &[5.0], &RolloutOptions::default());
    assert!((rest.qpos[0] - 0.4).abs() < 0.02 && rest.qvel[0].abs() < 1e-6, "{:?}", rest.qpos);
}

/// The driven chain's worst keypoint difference \[m\] between a prescribed joint and a servo of this stiffness.
fn servo_against_prescribed(kp: f64, integrator: Integrator) -> f64 {
    let mut servo = model("chain_active");
    servo.actuators[0].kp = kp;
    // critically damped on the first link's inertia of about 1e-6 kg m2, the others hanging loose
    servo.actuators[0].kv = 2.0 * (kp * 1e-6).sqrt();
    servo.actuators[0].force_range = None;
    let command = stroke_command(&servo, 0.6, 1.2);
    let times = grid(1.0, 0.05);
    let fine = rk4(5e-5);
    let prescribed = RolloutOptions { integrator: Some(integrator), prescribed: true, ..fine.clone() };
    let moved = |options: &RolloutOptions| {
        rollout(&servo, &servo.rest_state(), &command, &times, options).unwrap().position_m
    };
    let pairs = moved(&fine).into_iter().zip(moved(&prescribed));
    pairs.map(|(a, b)| (Vec3(a) - Vec3(b)).norm()).fold(0.0, f64::max)
}

#[test]
fn prescribed_joint_is_the_limit_of_a_stiff_servo() {
    for integrator in [Integrator::Euler, Integrator::ImplicitFast, Integrator::Rk4] {
        let [soft, hard] = [1.0, 25.0].map(|kp| servo_against_prescribed(kp, integrator));
        println!("{integrator:?}: servo against prescribed {soft:.1e} m at kp 1, {hard:.1e} m at kp 25");
        // the servo lags by kv / kp, five times less at 25 times the kp
        assert!(hard < 0.25 * soft && hard < 5e-4, "{soft} {hard}");
    }
}

#[test]
fn prescribed_joint_follows_its_command_exactly_and_is_free_without_one() {
    let model = model("chain_active");
    let command = stroke_command(&model, 0.6, 2.0);
    let options = RolloutOptions { prescribed: true, ..rk4(0.01) };
    let times = grid(2.0, 0.01);
    let driven = rollout(&model, &model.rest_state(), &command, &times, &options).unwrap();
    for (time_s, q) in times.iter().zip(driven.qpos.chunks(3)) {
        assert!((q[0] - command.at(0, *time_s)).abs() < 1e-12, "{time_s}");
    }
    let mut state = model.rest_state();
    state.qpos[0] = 0.5;
    let dropped = run(&model, &state, &[0.3], &options);
    assert!(dropped.qpos[0] < 0.45, "{:?}", dropped.qpos);
}

#[test]
fn motion_starts_when_told_and_sampling_does_not_change_it() {
    let model = model("chain_passive");
    let state = State { qpos: vec![1.0, 0.0, 0.0], qvel: vec![0.0; 3] };
    let late = RolloutOptions { start_s: 0.2, ..rk4(0.01) };
    let sparse = run(&model, &state, &[0.7], &late);
    let odd: Vec<f64> = grid(0.7, 0.0037).into_iter().chain([0.7]).collect();
    let dense = run(&model, &state, &odd, &late);
    assert_eq!(dense.qpos[dense.qpos.len() - 3..], sparse.qpos);
    let held = odd.iter().filter(|t| **t <= 0.2).count();
    assert!(dense.qpos[..3 * held].chunks(3).all(|q| q == state.qpos));

    let fine = run(&model, &state, &odd, &RolloutOptions { start_s: 0.2, ..rk4(0.0005) });
    let worst = dense.position_m.iter().zip(&fine.position_m).map(|(a, b)| (Vec3(*a) - Vec3(*b)).norm());
    // a cubic over 10 ms: fourth order in the step
    assert!(worst.fold(0.0, f64::max) < 2e-6);
}

#[test]
fn diverging_motion_names_joint_and_time() {
    let model = model("arm8");
    let error = rollout(&model, &model.rest_state(), &stroke_command(&model, 0.6, 1.0), &[1.0], &rk4(0.01));
    let Err(RolloutError::Diverged { joint, time_s }) = error else { panic!("{error:?}") };
    assert!(joint.starts_with('q') && (0.0..1.0).contains(&time_s), "{joint} {time_s}");
}

#[test]
fn states_and_commands_that_do_not_fit_are_refused() {
    let model = model("chain_active");
    let try_with = |state: State, command: Command, times: &[f64]| {
        rollout(&model, &state, &command, times, &RolloutOptions::default()).unwrap_err()
    };
    let short = State { qpos: vec![0.0; 2], qvel: vec![0.0; 3] };
    assert!(matches!(try_with(short, Command::default(), &[]), RolloutError::Shape { qpos: 2, nq: 3, .. }));
    let nan = State { qpos: vec![0.0, f64::NAN, 0.0], qvel: vec![0.0; 3] };
    let error = try_with(nan, Command::default(), &[]);
    assert!(matches!(&error, RolloutError::BadState { index: 1, joint, .. } if joint == "q2"), "{error}");
    for (name, value) in [("g2/blunt", f64::NAN), ("q3/damping", f64::INFINITY), ("link3/mass", -1e-3)] {
        let mut wrong = model.clone();
        wrong.set_parameter(name, value).unwrap();
        let (state, command) = (wrong.rest_state(), Command::default());
        let error = rollout(&wrong, &state, &command, &[0.1], &RolloutOptions::default()).unwrap_err();
        assert!(matches!(&error, RolloutError::BadParameter { name: at, .. } if at == name), "{error}");
    }
    let stranger = Command { actuators: vec!["motor".into()], time_s: vec![0.0], angle_rad: vec![0.0] };
    let error = try_with(model.rest_state(), stranger, &[]).to_string();
    assert!(error.contains("`motor`") && error.contains("servo"), "{error}");
    let falling = try_with(model.rest_state(), Command::default(), &[0.1, 0.0]);
    assert!(matches!(falling, RolloutError::SampleTime { index: 1, .. }));
}

#[test]
fn friction_losses_of_a_long_chain_obey_their_law_together() {
    const LINKS: usize = 12;
    let chain = |loss: f64| {
        let (mut world, mut motors) = (String::new(), String::new());
        for i in 0..LINKS {
            let loss = loss * (1.0 + i as f64);
            world += &format!(
                r#"<body pos="0 0 -0.05"><joint name="j{i}" axis="{} 1 0" frictionloss="{loss}"/>
                   <geom type="box" size="0.005 0.005 0.02" pos="0 0 -0.025"/>"#,
                i % 3
            );
            motors += &format!(r#"<motor joint="j{i}"/>"#);
        }
        let text = format!(
            r#"<mujoco><option><flag contact="disable"/></option><worldbody>{world}{}</worldbody><actuator>{motors}</actuator></mujoco>"#,
            "</body>".repeat(LINKS)
        );
        Model::from_mjcf(&text).unwrap()
    };
    // (M^-1)_ii at the reference: the acceleration that a unit torque makes
    let smooth = chain(0.0);
    let mut probe = sim::Simulator::new(&smooth, &RolloutOptions::default()).unwrap();
    let rest = smooth.rest_state();
    let mut accelerations = |motor: Option<usize>| {
        let command: Vec<f64> = (0..LINKS).map(|i| f64::from(motor == Some(i))).collect();
        probe.forces(&rest, &command).acceleration
    };
    let unforced = accelerations(None);
    let mobility: Vec<f64> = (0..LINKS).map(|i| accelerations(Some(i))[i] - unforced[i]).collect();

    let loss = 1e-4;
    let model = chain(loss);
    let mut simulator = sim::Simulator::new(&model, &RolloutOptions::default()).unwrap();
    let (mut slipping, mut sticking) = (0, 0);
    for case in 0..200 {
        let wave = |i: usize, k: f64| (k * (i as f64 + 1.3) * (f64::from(case) + 0.7)).sin();
        let speed = 10.0_f64.powf(-4.0 + f64::from(case % 20) * 0.25);
        let state = State {
            qpos: (0..LINKS).map(|i| 1.5 * wave(i, 1.7)).collect(),
            qvel: (0..LINKS).map(|i| speed * wave(i, 2.9)).collect(),
        };
        let forces = simulator.forces(&state, &[0.0; LINKS]);
        for (i, mobility) in mobility.iter().enumerate() {
            let most = loss * (1.0 + i as f64);
            let damping = 2.0 / (0.95 * 0.02);
            let free = -(forces.acceleration[i] + damping * state.qvel[i]) * 9.0 / mobility;
            let wanted = free.clamp(-most, most);
            assert!((forces.restraint[i] - wanted).abs() < 1e-7 * most, "case {case}, joint {i}");
            if free.abs() > most { slipping += 1 } else { sticking += 1 }
        }
    }
    assert!(slipping > 100 && sticking > 100, "{slipping} {sticking}");
}
