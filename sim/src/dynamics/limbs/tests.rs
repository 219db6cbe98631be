//! Limbs move as the same bodies computed one by one in space.

use super::*;
use crate::dynamics::{bias, fluid, inertia, kinematics, passive};

const OCTOPUS: &str = include_str!("../../../tests/data/octopus8.xml");

/// Two bases; limbs beside their origins, forked, with bodies that do not move on their own, anchors off the bodies, hinges
/// of either sense, shapes turned on their bodies and one without a shape.
const CRAFTED: &str = r#"<mujoco model="crafted">
  <compiler angle="radian" autolimits="true"/>
  <option gravity="0.3 -0.2 -9.81" density="1000" viscosity="0.001" wind="0.1 0.2 -0.1"/>
  <worldbody>
    <body name="hub" pos="0.1 0.2 0.3" quat="0.8 0.1 -0.5 0.2" gravcomp="0.7">
      <joint type="ball"/>
      <geom type="ellipsoid" size="0.04 0.03 0.02" pos="0.01 0 0.005" fluidshape="ellipsoid"/>
      <body name="a1" pos="0.05 0.013 0.01" quat="0.9 0.1 0.3 -0.2" gravcomp="0.9">
        <joint type="hinge" axis="0 1 0" pos="0.002 0.3 -0.001" armature="1e-5" ref="0.1"/>
        <geom type="box" size="0.005 0.004 0.02" pos="0.003 0 0.01" quat="0.95 0 0.3 0" fluidshape="ellipsoid"/>
        <body name="a2" pos="0 0.01 0.03" quat="0.9 0 -0.2 0">
          <joint type="hinge" axis="0 -1 0"/>
          <geom type="ellipsoid" size="0.005 0.01 0.02" pos="0 -0.01 0.01" fluidshape="ellipsoid"/>
        </body>
        <body name="a3" pos="0.02 0 0.02">
          <geom type="box" size="0.003 0.002 0.01" fluidshape="ellipsoid"/>
          <body name="a4" pos="0 0 0.02" quat="0.7 0 0.7 0">
            <joint type="hinge" axis="0 1 0" pos="0 0 -0.01"/>
            <inertial pos="0 0 0.01" mass="0.01" diaginertia="2e-6 3e-6 1e-6"/>
          </body>
        </body>
      </body>
      <body name="b1" pos="-0.05 0 0">
        <joint type="hinge" axis="0 0 1"/>
        <geom type="capsule" size="0.01 0.03" quat="0.7 0 0.7 0" fluidshape="ellipsoid"/>
      </body>
    </body>
    <body name="post" pos="1 0 0" quat="0.9 0 0.1 0.3">
      <joint type="slide" axis="0 1 0" armature="1e-3"/>
      <joint type="hinge" axis="1 0 0"/>
      <geom type="box" size="0.02 0.03 0.01"/>
      <body name="c1" pos="0.01 0.02 0.03">
        <joint type="hinge" axis="0 1 0"/>
        <geom type="box" size="0.005 0.01 0.02" pos="0 0 0.02" fluidshape="ellipsoid"/>
      </body>
    </body>
  </worldbody>
</mujoco>"#;

/// A few hundred roundings.
const ROUNDING: f64 = 1e-11;

/// The largest difference over the largest value: of accelerations, the mass matrix shifted, and of what the factors make of
/// other forces.
fn differences(text: &str) -> [f64; 2] {
    let model = Model::<f64>::from_mjcf(text).unwrap();
    let plant = Plant::<Spatial<f64>>::new(&model, ());
    let mut work = Work::new(&plant);
    let mut state = model.rest_state();
    for (k, q) in state.qpos.iter_mut().enumerate() {
        *q += 0.4 * (1.7 * k as f64).sin();
    }
    for (k, v) in state.qvel.iter_mut().enumerate() {
        *v = (2.3 * k as f64 + 1.0).cos();
    }
    let shift: Vec<f64> = (0..plant.nv).map(|k| 1e-6 * k as f64).collect();

    let given: Vec<f64> = (0..plant.nv).map(|k| 1e-4 * (0.9 * k as f64).cos()).collect();

    let mut limbs = Limbs::new(&model, &plant).unwrap();
    let mut factors = vec![0.0; limbs.factors()];
    let mut accelerations = given.clone();
    let (qpos, qvel) = (&state.qpos, &state.qvel);
    limbs.accelerate(&plant, qpos, qvel, &mut work, Some(&shift), &mut factors, &mut accelerations);
    let mut solved = given.clone();
    limbs.solve(&factors, &mut solved);

    let mut expected = given.clone();
    kinematics::kinematics(&plant, &state.qpos, &mut work);
    inertia::body_inertias(&plant, &mut work);
    inertia::mass_matrix(&plant, &mut work);
    bias::velocities(&plant, &state.qvel, &mut work);
    bias::bias(&plant, &mut work);
    passive::gravity_compensation(&plant, &mut work);
    fluid::fluid(&plant, &mut work);
    bias::project(&plant, &mut work, &mut expected);
    let mut matrix = work.mass.clone();
    for (dof, shift) in shift.iter().enumerate() {
        matrix[plant.row[dof]] += shift;
    }
    inertia::factor(&plant, &mut matrix);
    let mut alone = given;
    inertia::solve(&plant, &matrix, &mut expected);
    inertia::solve(&plant, &matrix, &mut alone);

    let off = |a: &[f64], b: &[f64]| {
        let largest = b.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
        a.iter().zip(b).fold(0.0_f64, |most, (a, b)| most.max((a - b).abs())) / largest
    };
    [off(&accelerations, &expected), off(&solved, &alone)]
}

#[test]
fn limbs_move_as_bodies_in_space_do() {
    for text in [OCTOPUS, CRAFTED] {
        let worst = differences(text);
        assert!(worst.iter().all(|&off| off < ROUNDING), "{worst:?}");
    }
}

#[test]
fn branches_that_do_not_keep_to_a_plane_are_left_to_the_general_stages() {
    let limbs = |text: &str| {
        let model = Model::<f64>::from_mjcf(text).unwrap();
        let plant = Plant::<Spatial<f64>>::new(&model, ());
        Limbs::new(&model, &plant).is_some()
    };
    assert!(limbs(CRAFTED));
    let changes = [
        // a hinge out of parallel, a body beside the plane, a shape across it, a slide, an end stop
        (r#"<joint type="hinge" axis="0 -1 0"/>"#, r#"<joint type="hinge" axis="0 -1 0.001"/>"#),
        (r#"pos="0 -0.01 0.01""#, r#"pos="0 -0.0101 0.01""#),
        (r#"size="0.003 0.002 0.01""#, r#"size="0.003 0.002 0.01" quat="0.9 0.1 0 0""#),
        (r#"<joint type="hinge" axis="0 0 1"/>"#, r#"<joint type="slide" axis="0 0 1"/>"#),
        (r#"<joint type="hinge" axis="0 0 1"/>"#, r#"<joint type="hinge" axis="0 0 1" range="-1 1"/>"#),
    ];
    for (from, to) in changes {
        assert!(CRAFTED.contains(from) && !limbs(&CRAFTED.replacen(from, to, 1)), "{to}");
    }
}
