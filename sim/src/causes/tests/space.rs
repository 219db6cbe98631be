//! Causes in a plane and in space.

use super::*;
use crate::dynamics::stages::Stages;
use crate::simulator::Engine;
use crate::space::{Planar, Plane, Spatial};

fn moved_in<S: Stages<T = f64>>(model: &Model, layout: S::Layout, options: &RolloutOptions) -> State {
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
