//! A mechanism on a base that moves.

use std::sync::Arc;

use crate::common::{self, Table, model};
use sim::batch::{self, Candidate};
use sim::math::Vec3;
use sim::sensitivities::{self, Direction};
use sim::{
    BasePath, Command, Integrator, Isa, Method, Model, RolloutError, RolloutOptions, State, Steps, plan,
    rollout,
};

fn times(every_s: f64, until_s: f64) -> Vec<f64> {
    (0..=(until_s / every_s).round() as u32).map(|k| f64::from(k) * every_s).collect()
}

/// A path through `pose` every 10 ms for 2 s.
fn path(pose: impl Fn(f64) -> [f64; 3]) -> Arc<BasePath> {
    let rows = times(0.01, 2.0);
    Arc::new(BasePath::new(rows.clone(), rows.into_iter().map(pose).collect()).unwrap())
}

fn on(base: &Arc<BasePath>, timestep_s: f64) -> RolloutOptions {
    RolloutOptions {
        integrator: Some(Integrator::Rk4),
        timestep_s: Some(timestep_s),
        base: Some(Arc::clone(base)),
        ..RolloutOptions::default()
    }
}

fn worst(a: &[[f64; 3]], b: &[[f64; 3]]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| (Vec3(*a) - Vec3(*b)).norm()).fold(0.0, f64::max)
}

/// Shaken along both axes and turned, all at once.
fn shaken(t: f64) -> [f64; 3] {
    [0.03 * (6.0 * t).sin(), 0.02 * (5.0 * t).cos(), 0.5 * (4.0 * t).sin()]
}

#[test]
fn a_pendulum_feels_the_frame_that_it_hangs_in() {
    let (arm, r, g): (f64, f64, f64) = (0.1, 0.01, 9.81);
    let [hinge_x, hinge_z] = [0.05, -0.02];
    let text = format!(
        r#"<mujoco><compiler angle="radian"/><worldbody><body pos="{hinge_x} 0 {hinge_z}"><joint axis="0 -1 0"/>
        <geom type="sphere" size="{r}" pos="0 0 -{arm}" mass="0.1"/><site name="P1" pos="0 0 -{arm}"/></body></worldbody></mujoco>"#
    );
    let pendulum = Model::from_mjcf(&text).unwrap();
    // the hinge's acceleration, by the laws of a turning frame
    let hinge = |t: f64| {
        let [ax, az] = [-0.03 * 36.0 * (6.0 * t).sin(), -0.02 * 25.0 * (5.0 * t).cos()];
        let (angle, rate, gain) = (0.5 * (4.0 * t).sin(), 2.0 * (4.0 * t).cos(), -8.0 * (4.0 * t).sin());
        let (sin, cos) = angle.sin_cos();
        let (x, z) = (cos * hinge_x - sin * hinge_z, sin * hinge_x + cos * hinge_z);
        [ax - gain * z - rate * rate * x, az + gain * x - rate * rate * z]
    };
    // of the angle against the vertical
    let length = arm + 0.4 * r * r / arm;
    let acceleration = |t: f64, angle: f64| {
        let [x, z] = hinge(t);
        -((g + z) * angle.sin() + x * angle.cos()) / length
    };
    let (h, mut state) = (1e-4, [0.3, 0.0 + 2.0]);
    let mut exact = vec![state];
    for step in 0..10_000 {
        let t = f64::from(step) * h;
        let slope = |ahead: f64, by: [f64; 2]| {
            let [q, v] = [state[0] + ahead * by[0], state[1] + ahead * by[1]];
            [v, acceleration(t + ahead, q)]
        };
        let a = slope(0.0, [0.0; 2]);
        let b = slope(0.5 * h, a);
        let c = slope(0.5 * h, b);
        let d = slope(h, c);
        for k in 0..2 {
            state[k] += h / 6.0 * (a[k] + 2.0 * (b[k] + c[k]) + d[k]);
        }
        exact.push(state);
    }
    let instants = times(0.05, 1.0);
    // the base turns at 2 rad/s when it begins, the pendulum not against it
    let start = State { qpos: vec![0.3], qvel: vec![0.0] };
    let swung =
        rollout(&pendulum, &start, &Command::default(), &instants, &on(&path(shaken), 0.001)).unwrap();
    let mut off: f64 = 0.0;
    for (row, (&t, q)) in instants.iter().zip(&swung.qpos).enumerate() {
        off = off.max((q + shaken(t)[2] - exact[row * 500][0]).abs());
        // and its point is where the picture shows it
        let [base_x, base_z, angle] = shaken(t);
        let (sin, cos) = angle.sin_cos();
        let all = angle + q;
        let at = [
            base_x + cos * hinge_x - sin * hinge_z + arm * all.sin(),
            0.0,
            base_z + sin * hinge_x + cos * hinge_z - arm * all.cos(),
        ];
        assert!(worst(&[at], &swung.position_m[row..=row]) < 1e-8, "{t}");
    }
    println!("pendulum in a shaken and turned frame: {off:.1e} rad off");
    // what the spline through rows 10 ms apart leaves of the accelerations
    assert!(off < 2e-6, "{off:e}");
}

#[test]
fn a_chain_in_water_moves_as_from_mujocos_heavy_carriage() {
    let golden = Table::read("moving_base.csv");
    let along = |t: f64| [0.15 * t - 0.15 * t * t, -0.1 * t + 0.2 * t * t, 1.5 * t - t * t];
    let text = common::text("chain_passive.xml").replacen("pos=\"0 0 0\"", "pos=\"0.03 0 0.01\"", 1);
    let chain = Model::from_mjcf(&text).unwrap();
    let start = State { qpos: vec![0.8, -0.4, 0.2], qvel: vec![0.0; 3] };
    let moved =
        rollout(&chain, &start, &Command::default(), &golden.times(), &on(&path(along), 0.0005)).unwrap();
    let theirs: Vec<[f64; 3]> =
        golden.rows.iter().flat_map(|row| row[4..].chunks(3).map(|at| [at[0], at[1], at[2]])).collect();
    let off = worst(&moved.position_m, &theirs);
    println!("chain on a moving base: {off:.1e} m from MuJoCo's");
    // the carriage is a million times heavier than the chain, not infinitely
    assert!(off < 1e-8, "{off:e}");
}

#[test]
fn towing_through_still_water_is_a_current_against_a_still_rig() {
    let [x, z] = [0.12, -0.05];
    let still = model("chain_passive");
    let mut flowing = still.clone();
    flowing.settings.wind = Vec3([-x, 0.0, -z]);
    let start = State { qpos: vec![0.8, -0.4, 0.2], qvel: vec![0.0; 3] };
    let instants = times(0.1, 1.5);
    let towed = path(|t| [x * t, z * t, 0.0]);
    let unmoved = RolloutOptions { base: None, ..on(&towed, 0.002) };
    let run = |model: &Model, options: &RolloutOptions| {
        rollout(model, &start, &Command::default(), &instants, options).unwrap()
    };
    let (a, b) = (run(&still, &on(&towed, 0.002)), run(&flowing, &unmoved));
    for (a, b) in a.qpos.iter().zip(&b.qpos) {
        assert!((a - b).abs() < 1e-10, "{a} {b}");
    }
    // also for the water's memory and its mass
    let mut heavier = still.clone();
    heavier.add_cause("added_mass").unwrap();
    heavier.set_parameter("added_mass/scale", 1.0).unwrap();
    let mut carried = heavier.clone();
    carried.settings.wind = flowing.settings.wind;
    let (a, b) = (run(&heavier, &on(&towed, 0.002)), run(&carried, &unmoved));
    assert!(a.qpos.iter().zip(&b.qpos).all(|(a, b)| (a - b).abs() < 1e-10));
}

/// The same chain behind a carriage whose three joints follow their commands exactly.
#[test]
fn a_base_is_a_carriage_whose_joints_are_prescribed() {
    let links = common::text("chain_passive.xml");
    let (head, links) = links.split_once("<worldbody>").unwrap();
    let (links, _) = links.split_once("</worldbody>").unwrap();
    let carried = format!(
        r#"{head}<worldbody><body><joint name="x" type="slide" axis="1 0 0"/><joint name="z" type="slide" axis="0 0 1"/>
        <joint name="turn" axis="0 -1 0"/><geom type="sphere" size="0.001" fluidcoef="0 0 0 0 0"/>{links}</body></worldbody>
        <actuator><position joint="x" name="x"/><position joint="z" name="z"/><position joint="turn" name="turn"/></actuator></mujoco>"#
    );
    let carriage = Model::from_mjcf(&carried).unwrap();
    let chain = model("chain_passive");
    let base = path(shaken);
    let rows = times(0.0002, 1.0);
    let command = Command {
        actuators: ["x", "z", "turn"].map(str::to_owned).to_vec(),
        angle_rad: rows.iter().flat_map(|&t| base.at(t).pose).collect(),
        time_s: rows,
    };
    let instants = times(0.05, 1.0);
    let pose = [0.5, 0.2, -0.3];
    let start = State { qpos: pose.to_vec(), qvel: vec![0.0; 3] };
    let moved = rollout(&chain, &start, &Command::default(), &instants, &on(&base, 0.001)).unwrap();
    let velocity = base.at(0.0).velocity;
    let start = State { qpos: [base.at(0.0).pose, pose].concat(), qvel: [velocity, [0.0; 3]].concat() };
    let prescribed = RolloutOptions { prescribed: true, base: None, ..on(&base, 0.0002) };
    let followed = rollout(&carriage, &start, &command, &instants, &prescribed).unwrap();
    let off = worst(&moved.position_m, &followed.position_m);
    println!("base against prescribed carriage: {off:.1e} m");
    // the carriage goes straight for 0.2 ms at a time
    assert!(off < 5e-6, "{off:e}");
}

#[test]
fn plane_and_space_agree_on_a_moving_base() {
    let planar = model("chain_passive");
    let text = common::text("chain_passive.xml").replacen(
        "</worldbody>",
        r#"<body pos="1 0 0"><joint type="ball"/><geom type="sphere" size="0.01" pos="0 0 -0.05"/></body></worldbody>"#,
        1,
    );
    let spatial = Model::from_mjcf(&text).unwrap();
    let base = path(shaken);
    let instants = times(0.05, 1.0);
    let run = |model: &Model| {
        let mut start = model.rest_state();
        start.qpos[..3].copy_from_slice(&[0.8, -0.4, 0.2]);
        rollout(model, &start, &Command::default(), &instants, &on(&base, 0.002)).unwrap().position_m
    };
    let off = worst(&run(&planar), &run(&spatial));
    assert!(off < 1e-12, "{off:e}");
}

#[test]
fn candidates_side_by_side_and_derivatives_go_with_the_base() {
    let chain = model("chain_passive");
    let base = path(shaken);
    let blunt = chain.find_parameter("g3/blunt").unwrap();
    let options = RolloutOptions { start_s: 0.2, ..on(&base, 0.004) };
    let instants = times(0.05, 0.8);
    let candidate = |k: u32| Candidate {
        values: vec![0.3 + 0.05 * f64::from(k)],
        state: State { qpos: vec![0.8, -0.4, 0.02 * f64::from(k)], qvel: vec![0.0, 0.3, 0.0] },
        start_s: 0.2 + 0.013 * f64::from(k),
    };
    let candidates: Vec<Candidate> = (0..11).map(candidate).collect();
    let alone = |candidate: &Candidate| {
        let mut model = chain.clone();
        model.set(blunt, candidate.values[0]);
        let options = RolloutOptions { start_s: candidate.start_s, ..options.clone() };
        rollout(&model, &candidate.state, &Command::default(), &instants, &options).unwrap().position_m
    };
    for isa in Isa::available() {
        let all =
            batch::positions(&chain, &[blunt], &candidates, &Command::default(), &instants, &options, isa);
        for (candidate, positions) in candidates.iter().zip(all.unwrap()) {
            assert!(worst(&positions.unwrap(), &alone(candidate)) < 1e-12, "{isa:?}");
        }
    }
    // by the coefficient, and by when the joints are let go while the base goes on
    let none = || Direction { values: vec![0.0], qpos: vec![0.0; 3], qvel: vec![0.0; 3], start_s: 0.0 };
    let directions = [Direction { values: vec![1.0], ..none() }, Direction { start_s: 1.0, ..none() }];
    let seen = sensitivities::sensitivities(
        &chain,
        &[blunt],
        &candidates[3],
        &directions,
        &Command::default(),
        &instants,
        &options,
        Isa::best(),
    );
    let slopes = seen.unwrap().slopes;
    let varied = |by: [f64; 2]| {
        let mut other = candidates[3].clone();
        other.values[0] += by[0];
        other.start_s += by[1];
        alone(&other)
    };
    for (slopes, (by, after)) in slopes.iter().zip([([1e-5, 0.0], 0.0), ([0.0, 1e-6], 0.25)]) {
        let (up, down) = (varied(by), varied(by.map(|x| -x)));
        let step = 2.0 * (by[0] + by[1]);
        for (row, ((up, down), slope)) in up.iter().zip(&down).zip(slopes).enumerate() {
            // before the start nothing depends on when it is
            if instants[row / 3] > after {
                for axis in [0, 2] {
                    let difference = (up[axis] - down[axis]) / step;
                    assert!((difference - slope[axis]).abs() < 1e-6, "{row} {difference} {}", slope[axis]);
                }
            }
        }
    }
}

#[test]
fn our_own_steps_keep_their_accuracy_on_a_moving_base() {
    let chain = model("chain_passive");
    let base = path(shaken);
    let start = State { qpos: vec![0.8, -0.4, 0.2], qvel: vec![0.0; 3] };
    let instants = times(0.05, 1.5);
    let exact = rollout(&chain, &start, &Command::default(), &instants, &on(&base, 1e-4)).unwrap().position_m;
    let planned = plan(&chain, &start, &Command::default(), &instants, &on(&base, 0.001), 1e-5).unwrap();
    let even = Steps::even(Method::Rosenbrock, 0.002);
    for (steps, wanted_m) in [(planned.steps, 1e-5), (even, 2e-6)] {
        let options = RolloutOptions { steps: Some(steps.clone()), ..on(&base, 0.001) };
        let run = rollout(&chain, &start, &Command::default(), &instants, &options).unwrap();
        let off = worst(&run.position_m, &exact);
        println!("{:?}, {} planned steps: {off:.1e} m", steps.method, steps.ends_s.len());
        assert!(off < 1.5 * wanted_m, "{off:e}");
    }
}

#[test]
fn a_late_camera_sees_where_the_base_has_come_to() {
    let mut chain = model("chain_passive");
    let base = path(shaken);
    let start = State { qpos: vec![0.8, -0.4, 0.2], qvel: vec![0.0; 3] };
    let instants = times(0.05, 1.0);
    let later: Vec<f64> = instants.iter().map(|t| t + 0.02).collect();
    let run = |model: &Model, times: &[f64]| {
        rollout(model, &start, &Command::default(), times, &on(&base, 0.001)).unwrap().position_m
    };
    let wanted = run(&chain, &later);
    chain.add_cause("camera_delay").unwrap();
    chain.set_parameter("camera_delay/delay", 0.02).unwrap();
    let off = worst(&run(&chain, &instants), &wanted);
    assert!(off < 1e-7, "{off:e}");
}

#[test]
fn what_floats_freely_has_no_base() {
    let octopus = model("octopus8");
    let refused =
        rollout(&octopus, &octopus.rest_state(), &Command::default(), &[0.1], &on(&path(shaken), 0.001));
    let Err(RolloutError::Unsupported { what, instead }) = refused else { panic!("{refused:?}") };
    assert!(what.contains("floats freely") && instead.contains("leave out the base"), "{what}; {instead}");
}
