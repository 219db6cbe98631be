//! Limbs move as the same bodies computed one by one in space.
#![expect(clippy::unwrap_used, reason = "a test may")]

use super::*;
use crate::dynamics::{bias, fluid, inertia, kinematics, passive};

const OCTOPUS: &str = include_str!("../../../tests/data/octopus8.xml");

/// A few hundred roundings.
const ROUNDING: f64 = 1e-11;

/// The largest difference of forces, and of what the shifted mass matrix makes of them, over the largest value.
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

    let mut limbs = Limbs::new(&model, &plant).unwrap();
    let mut force = vec![0.0; plant.nv];
    limbs.forces(&plant, &state.qpos, &state.qvel, &mut work, &mut force);
    let mut factors = vec![0.0; limbs.factors()];
    limbs.factor(&plant, &work, Some(&shift), &mut factors);
    let mut solved = force.clone();
    limbs.solve(&factors, &mut solved);

    let mut general = vec![0.0; plant.nv];
    kinematics::kinematics(&plant, &state.qpos, &mut work);
    inertia::body_inertias(&plant, &mut work);
    inertia::mass_matrix(&plant, &mut work);
    bias::velocities(&plant, &state.qvel, &mut work);
    bias::bias(&plant, &mut work);
    passive::gravity_compensation(&plant, &mut work);
    fluid::fluid(&plant, &mut work);
    bias::project(&plant, &mut work, &mut general);
    let mut matrix = work.mass.clone();
    for (dof, shift) in shift.iter().enumerate() {
        matrix[plant.row[dof]] += shift;
    }
    inertia::factor(&plant, &mut matrix);
    let mut expected = general.clone();
    inertia::solve(&plant, &matrix, &mut expected);

    let off = |a: &[f64], b: &[f64]| {
        let largest = b.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
        a.iter().zip(b).fold(0.0_f64, |most, (a, b)| most.max((a - b).abs())) / largest
    };
    [off(&force, &general), off(&solved, &expected)]
}

#[test]
fn limbs_move_as_bodies_in_space_do() {
    let worst = differences(OCTOPUS);
    assert!(worst.iter().all(|&off| off < ROUNDING), "{worst:?}");
}
