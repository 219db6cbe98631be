//! Candidates side by side move as they do alone, and our own steps keep to the accuracy asked for.

use sim::batch::{self, Candidate};
use sim::{Command, Integrator, Isa, Method, Model, RolloutError, RolloutOptions, Steps, plan, rollout};

const CHAIN: &str = include_str!("../data/chain_friction.xml");
const DRIVEN: &str = include_str!("../data/chain_active.xml");
const ARM: &str = include_str!("../data/arm8.xml");
const OCTOPUS: &str = include_str!("../data/octopus8.xml");

/// More than the lanes of any instruction set, and no multiple of them.
const CANDIDATES: usize = 19;

fn stroke(model: &Model) -> Command {
    let names: Vec<String> = model.actuators.iter().map(|actuator| actuator.name.clone()).collect();
    let angle_rad = [0.0, 0.5, -0.5, 0.0].iter().flat_map(|&a| names.iter().map(move |_| a)).collect();
    Command { actuators: names, time_s: vec![0.0, 0.1, 0.3, 0.4], angle_rad }
}

fn candidates(model: &Model, names: &[&str], start_s: f64) -> (Vec<sim::model::Parameter>, Vec<Candidate>) {
    let parameters: Vec<_> = names.iter().map(|name| model.find_parameter(name).unwrap()).collect();
    let one = |k: usize| {
        let mut state = model.rest_state();
        let last = state.qpos.len() - 1;
        state.qpos[last] += 0.3 + 0.01 * k as f64;
        let values = parameters.iter().map(|&p| model.get(p) * (1.0 + 0.02 * k as f64)).collect();
        // starts that fall into different steps
        Candidate { values, state, start_s: start_s + 0.0017 * k as f64 }
    };
    (parameters.clone(), (0..CANDIDATES).map(one).collect())
}

fn alone(
    model: &Model,
    parameters: &[sim::model::Parameter],
    candidate: &Candidate,
    command: &Command,
    times: &[f64],
    options: &RolloutOptions,
) -> Result<Vec<[f64; 3]>, RolloutError> {
    let mut model = model.clone();
    for (&parameter, &value) in parameters.iter().zip(&candidate.values) {
        model.set(parameter, value);
    }
    let options = RolloutOptions { start_s: candidate.start_s, ..options.clone() };
    rollout(&model, &candidate.state, command, times, &options).map(|run| run.position_m)
}

/// Candidates of both kinds, and one that cannot be: all come back in their places.
#[test]
fn whole_runs_of_candidates_are_those_of_each_alone() {
    let times: Vec<f64> = (0..25).map(|k| 0.02 * f64::from(k)).collect();
    let model = Model::from_mjcf(DRIVEN).unwrap();
    let command = stroke(&model);
    let (parameters, mut candidates) = candidates(&model, &["g2/blunt", "q2/frictionloss"], 0.0);
    for (k, candidate) in candidates.iter_mut().enumerate() {
        (candidate.start_s, candidate.values[1]) = (0.0, [0.0, 1e-5][k % 2]);
    }
    candidates[4].values[0] = f64::NAN;
    let options = RolloutOptions::default();
    for isa in Isa::available() {
        let runs =
            batch::rollouts(&model, &parameters, &candidates, &command, &times, &options, isa).unwrap();
        assert_eq!(runs.len(), CANDIDATES);
        for (k, (candidate, run)) in candidates.iter().zip(runs).enumerate() {
            if k == 4 {
                assert!(matches!(run, Err(RolloutError::BadParameter { name, .. }) if name == "g2/blunt"));
                continue;
            }
            let mut model = model.clone();
            for (&parameter, &value) in parameters.iter().zip(&candidate.values) {
                model.set(parameter, value);
            }
            assert_eq!(run, rollout(&model, &candidate.state, &command, &times, &options), "{}", isa.name());
        }
    }
}

/// Where joints rub, steps are shorter and taken in halves.
#[test]
fn candidates_without_friction_move_as_they_do_alone_beside_others_with_it() {
    let times: Vec<f64> = (0..10).map(|k| 0.01 * f64::from(k)).collect();
    let options =
        RolloutOptions { steps: Some(Steps::even(Method::Rosenbrock, 0.004)), ..Default::default() };
    let model = Model::from_mjcf(OCTOPUS).unwrap();
    let command = stroke(&model);
    let (parameters, mut candidates) = candidates(&model, &["a1q3/frictionloss"], 0.0);
    for (k, candidate) in candidates.iter_mut().enumerate() {
        candidate.start_s = 0.0;
        candidate.values[0] = [0.0, 1e-4, 0.0][k % 3];
    }
    for isa in Isa::available() {
        let together =
            batch::positions(&model, &parameters, &candidates, &command, &times, &options, isa).unwrap();
        for (candidate, positions) in candidates.iter().zip(together) {
            let expected = alone(&model, &parameters, candidate, &command, &times, &options).unwrap();
            assert_eq!(positions.unwrap(), expected, "{}", isa.name());
        }
    }
}

#[test]
fn a_candidate_moves_the_same_to_the_bit_in_any_lane_of_any_instruction_set_and_alone() {
    let times: Vec<f64> = (0..40).map(|k| 0.013 * f64::from(k)).collect();
    let ours = |method| RolloutOptions { steps: Some(Steps::even(method, 0.004)), ..Default::default() };
    let cases = [
        (CHAIN, vec!["g2/blunt", "q1/frictionloss", "link3/mass"], RolloutOptions::default()),
        (CHAIN, vec!["g3/kutta", "q2/frictionloss"], ours(Method::RungeKutta)),
        (DRIVEN, vec!["g1/angular", "servo/gain"], ours(Method::Rosenbrock)),
        (ARM, vec!["q3/damping", "q4/stiffness2"], RolloutOptions::default()),
        (
            DRIVEN,
            vec!["g2/blunt"],
            RolloutOptions { integrator: Some(Integrator::ImplicitFast), ..RolloutOptions::default() },
        ),
        (OCTOPUS, vec!["a1q3/damping"], ours(Method::Rosenbrock)),
    ];
    for (text, names, options) in cases {
        let model = Model::from_mjcf(text).unwrap();
        let command = stroke(&model);
        // commands are on one clock for all candidates, so driven ones start together
        let (parameters, mut candidates) = candidates(&model, &names, 0.05);
        if !command.actuators.is_empty() {
            candidates.iter_mut().for_each(|candidate| candidate.start_s = 0.0);
        }
        let options = RolloutOptions { start_s: candidates[0].start_s, ..options };
        for isa in Isa::available() {
            let together =
                batch::positions(&model, &parameters, &candidates, &command, &times, &options, isa).unwrap();
            for (candidate, positions) in candidates.iter().zip(together) {
                let expected = alone(&model, &parameters, candidate, &command, &times, &options).unwrap();
                assert_eq!(positions.unwrap(), expected, "{} {names:?}", isa.name());
            }
        }
    }
}

#[test]
fn a_candidate_that_diverges_has_its_own_error_and_disturbs_nobody() {
    let model = Model::from_mjcf(CHAIN).unwrap();
    let times = [0.1, 0.2];
    let (parameters, mut candidates) = candidates(&model, &["q2/damping"], 0.0);
    let options = RolloutOptions { steps: Some(Steps::even(Method::RungeKutta, 0.01)), ..Default::default() };
    candidates.iter_mut().for_each(|candidate| candidate.start_s = 0.0);
    // so much damping is far beyond what an explicit step can bear
    candidates[3].values[0] = 1.0;
    // and this is no number at all
    candidates[6].values[0] = f64::NAN;
    for isa in Isa::available() {
        let command = Command::default();
        let together =
            batch::positions(&model, &parameters, &candidates, &command, &times, &options, isa).unwrap();
        for (k, positions) in together.into_iter().enumerate() {
            let expected = alone(&model, &parameters, &candidates[k], &command, &times, &options);
            assert_eq!(positions, expected, "{} {k}", isa.name());
            assert_eq!(matches!(positions, Err(RolloutError::Diverged { .. })), k == 3);
            assert_eq!(matches!(positions, Err(RolloutError::BadParameter { .. })), k == 6);
        }
    }
}

#[test]
fn planned_steps_are_as_exact_as_asked_for() {
    for (text, expected) in
        [(CHAIN, Method::RungeKutta), (DRIVEN, Method::Rosenbrock), (ARM, Method::Rosenbrock)]
    {
        let model = Model::from_mjcf(text).unwrap();
        let mut state = model.rest_state();
        if model.actuators.is_empty() {
            state.qpos[0] = 1.0;
        }
        let command = stroke(&model);
        let times: Vec<f64> = (0..=50).map(|k| 0.02 * f64::from(k)).collect();
        let options = RolloutOptions::default();
        let plan = plan(&model, &state, &command, &times, &options, 1e-5).unwrap();
        let run = |steps| {
            let options = RolloutOptions { steps: Some(steps), ..options.clone() };
            rollout(&model, &state, &command, &times, &options).unwrap().position_m
        };
        // the other method, at steps so short that it has no error to speak of
        let finest = Steps::even(Method::Rosenbrock, 1e-4);
        let (planned, truth) = (run(plan.steps.clone()), run(finest));
        let worst = planned
            .iter()
            .flatten()
            .zip(truth.iter().flatten())
            .map(|(a, b)| (a - b).abs())
            .fold(0.0, f64::max);
        let (count, estimate_m) = (plan.steps.ends_s.len(), plan.error_m);
        println!("{}: {count} steps, estimated {estimate_m:.1e} m, true {worst:.1e} m", model.name);
        assert_eq!(plan.steps.method, expected);
        assert!(worst < 2e-5, "{worst}");
        // steps that do for the motion stay, others do not
        let again = |accuracy_m| {
            let options = RolloutOptions { steps: Some(plan.steps.clone()), ..options.clone() };
            sim::plan(&model, &state, &command, &times, &options, accuracy_m).map(|plan| plan.steps)
        };
        assert_eq!(again(1e-5).unwrap().ends_s.len(), count);
        assert!(again(1e-8).unwrap().ends_s.len() > count && again(1e-4).unwrap().ends_s.len() <= count);
        // made shorter all alike they are as exact as others would be
        let shorter = again(3e-6).unwrap();
        assert_eq!(shorter.method, expected);
        let shorter = run(shorter);
        let apart = shorter.iter().flatten().zip(truth.iter().flatten()).map(|(a, b)| (a - b).abs());
        assert!(apart.fold(0.0, f64::max) < 6e-6);
        // more than twenty times as many explicit steps would do, thousands of the others
        assert!(matches!(again(1e-12), Err(RolloutError::Inexact { .. })));
    }
}

/// Joints that turn, stand and break loose all the time: a step over such a corner would otherwise leave an error
/// of second order.
#[test]
fn steps_over_the_corners_of_friction_keep_their_order() {
    /// A fourth order leaves 1/256 at a quarter of the step; what the last halving does not resolve takes some.
    const LEFT: f64 = 1.0 / 40.0;
    let model = Model::from_mjcf(CHAIN).unwrap();
    let mut state = model.rest_state();
    state.qpos[0] = 1.0;
    let times: Vec<f64> = (0..=250).map(|k| 0.02 * f64::from(k)).collect();
    let run = |longest_s| {
        let steps = Some(Steps::even(Method::RungeKutta, longest_s));
        let options = RolloutOptions { steps, ..RolloutOptions::default() };
        rollout(&model, &state, &Command::default(), &times, &options).unwrap().position_m
    };
    let truth = run(2e-4);
    let error = |longest_s| {
        let apart =
            run(longest_s).into_iter().flatten().zip(truth.iter().flatten()).map(|(a, b)| (a - b).abs());
        apart.fold(0.0, f64::max)
    };
    let (coarse, fine) = (error(0.016), error(0.004));
    println!("16 ms: {coarse:.1e} m, 4 ms: {fine:.1e} m");
    assert!(fine < LEFT * coarse && fine < 1e-6, "{coarse} {fine}");
}
