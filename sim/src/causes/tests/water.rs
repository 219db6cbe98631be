//! Added mass, currents, walls and memory.

use super::*;
use crate::dynamics::friction_and_limits::multiply;
use crate::fluid::added_mass;
use crate::math::Quat;
use crate::simulator::Engine;
use crate::space::Spatial;

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
    for timestep_s in [0.001, 0.01, 0.05] {
        let fallen = run(&with(&ball, &[("basset/history", c)]), &[0.0], &[t], &rk4(timestep_s));
        // m dv/dt = m g - 2 c g sqrt(t)
        let lost = 2.0 * t - fallen.qvel[0];
        assert_close(lost, c / m * 2.0 * 4.0 / 3.0 * t.powf(1.5), 0.005, "history");
    }
}
