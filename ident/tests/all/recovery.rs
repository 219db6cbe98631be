//! Known coefficients, simulated runs, a fit, and the coefficients again.

use crate::common::*;
use ident::experiment::{Experiment, Method, Run, RunKind, Use};
use ident::fit::{Fit, fit};
use sim::{Command, Model};

fn value(fit: &Fit, name: &str) -> f64 {
    fit.parameters.iter().find(|parameter| parameter.name == name).unwrap().value
}

fn two_drops(truth: &Model) -> Vec<Run> {
    vec![
        drop_run("horizontal", truth, [1.5, 0.0, 0.0], 0.2, 4.0, 1),
        drop_run("bent", truth, [1.5, -1.5, 1.2], 0.3, 4.0, 2),
    ]
}

#[test]
fn drag_of_two_links_and_damping_are_recovered_from_two_drops() {
    let truth = chain();
    let names = ["g1/blunt", "g2/blunt", "g3/blunt", "g3/angular", "g3/kutta", "q2/damping"];
    let experiment = experiment(guess(chain()), two_drops(&truth), &names);
    // What is not fitted is known.
    let known = Experiment { model: truth.clone(), ..experiment };
    let fitted = fit(&known, &mut ()).unwrap();
    assert_recovered(&fitted, &truth, 4);
    // Two coordinates of three keypoints, 0.4 mm each.
    let floor = 6.0 * NOISE_M * NOISE_M;
    assert!((fitted.fit.loss_m2 / floor - 1.0).abs() < 0.1, "{}", fitted.fit.loss_m2);
}

#[test]
fn every_method_reaches_the_same_optimum() {
    let truth = chain();
    let mut losses = Vec::new();
    for method in [Method::LeastSquares, Method::Hybrid, Method::CmaEs, Method::Paper] {
        let mut experiment = experiment(
            guess(chain()),
            vec![drop_run("a", &truth, [1.5, -1.0, 0.8], 0.2, 2.5, 3)],
            &["angular"],
        );
        experiment.fit.method = method;
        experiment.fit.max_evaluations = 400;
        let fitted = fit(&experiment, &mut ()).unwrap();
        assert_eq!(fitted.fit.method, method.name());
        println!("{:13} {:e} after {}", method.name(), fitted.fit.loss_m2, fitted.fit.evaluations);
        losses.push(fitted.fit.loss_m2);
    }
    // CMA-ES with this budget stops within a thousandth of the bottom.
    for loss in &losses {
        assert!((loss / losses[0] - 1.0).abs() < 2e-3, "{losses:?}");
    }
}

#[test]
fn driven_runs_by_servo_and_by_prescribed_joint_are_recovered() {
    let truth = driven_chain();
    for prescribed in [false, true] {
        let runs = vec![
            driven_run("fast", &truth, strokes(0.8, 0.5, 3.0), 3.0, prescribed, 4),
            driven_run("slow", &truth, strokes(0.6, 1.5, 3.0), 3.0, prescribed, 5),
        ];
        let names = ["g2/blunt", "g3/blunt", "g3/kutta", "g3/angular"];
        let mut experiment = experiment(truth.clone(), runs, &names);
        for name in names {
            experiment.model.set_parameter(name, 0.4).unwrap();
        }
        experiment.fit.method = Method::LeastSquares;
        assert_recovered(&fit(&experiment, &mut ()).unwrap(), &truth, 3);
    }
}

#[test]
fn gaps_a_missing_axis_and_uneven_images_cost_only_precision() {
    let truth = chain();
    let mut runs = two_drops(&truth);
    for (index, run) in runs.iter_mut().enumerate() {
        let width = run.trajectory.keypoints.len();
        // A fifth of the keypoints lost; P1 seen only from the side in the second run.
        for (cell, position) in run.trajectory.position_m.iter_mut().enumerate() {
            if (cell * 7) % 5 == 0 {
                *position = [f64::NAN; 3];
            } else if index == 1 && cell % width == 0 {
                position[2] = f64::NAN;
            }
        }
        let keep = |row: usize| row % 3 != 1;
        let rows: Vec<usize> = (0..run.trajectory.time_s.len()).filter(|&row| keep(row)).collect();
        run.trajectory.position_m = rows
            .iter()
            .flat_map(|row| run.trajectory.position_m[row * width..(row + 1) * width].to_vec())
            .collect();
        run.trajectory.time_s = rows.iter().map(|&row| run.trajectory.time_s[row]).collect();
    }
    let mut experiment = experiment(chain(), runs, &["g2/blunt", "g3/blunt", "g3/angular"]);
    experiment.fit.method = Method::LeastSquares;
    assert_recovered(&fit(&experiment, &mut ()).unwrap(), &truth, 2);
}

#[test]
fn release_is_fitted_where_nobody_states_it() {
    let truth = chain();
    // Between two images.
    let release_s = 0.2537;
    let mut run = drop_run("late", &truth, [1.5, -0.5, 0.3], release_s, 3.0, 6);
    run.release_s = None;
    let mut experiment = experiment(chain(), vec![run], &["g3/angular"]);
    experiment.fit.method = Method::LeastSquares;
    let fitted = fit(&experiment, &mut ()).unwrap();
    // 0.4 mm of noise per coordinate over 270 images of a fall at some 0.1 m/s.
    assert!((fitted.runs[0].start_s - release_s).abs() < 1e-3, "{}", fitted.runs[0].start_s);
    assert_recovered(&fitted, &truth, 1);
}

#[test]
fn noise_is_estimated_where_nobody_states_it() {
    let truth = chain();
    let mut experiment = experiment(chain(), two_drops(&truth), &["g3/angular", "g3/blunt"]);
    experiment.noise_m = None;
    experiment.fit.method = Method::LeastSquares;
    let fitted = fit(&experiment, &mut ()).unwrap();
    // 2400 coordinates: 1.5 % of statistical scatter.
    assert!((fitted.fit.noise_m / NOISE_M - 1.0).abs() < 0.05, "{}", fitted.fit.noise_m);
}

#[test]
fn what_the_first_link_cannot_show_is_named_as_a_combination() {
    // A link that turns about a fixed pivot shows one sum of its three drags, no lift at all.
    let truth = chain();
    let mut experiment = experiment(guess(chain()), two_drops(&truth), &["g1/*", "g3/angular"]);
    experiment.fit.method = Method::LeastSquares;
    let fitted = fit(&experiment, &mut ()).unwrap();
    assert_eq!(fitted.fit.unidentifiable, [["g1/blunt", "g1/slender", "g1/angular"]]);
    let determined = |name: &str| fitted.fit.parameters.iter().find(|p| p.name == name).unwrap().determined;
    assert_eq!(
        ["g1/kutta", "g1/magnus", "g1/slender", "g3/angular"].map(determined),
        [false, false, false, true]
    );
}

#[test]
fn held_out_runs_are_scored_from_their_still_images_alone() {
    let truth = chain();
    let mut runs = two_drops(&truth);
    runs[1].usage = Use::Holdout;
    let mut experiment = experiment(chain(), runs, &["g3/angular"]);
    experiment.fit.method = Method::LeastSquares;
    let fitted = fit(&experiment, &mut ()).unwrap();
    let held = &fitted.fit.runs[1];
    assert_eq!((held.id.as_str(), held.usage), ("bent", Use::Holdout));
    for keypoint in &held.keypoints {
        // Mean length of a two-dimensional normal vector: 1.25 standard deviations, and what a few mrad of
        // uncertainty of the pose add.
        assert!((1.1..2.0).contains(&(keypoint.mean_error_m / NOISE_M)), "{keypoint:?}");
    }
    // Whatever it shows while moving has no influence on its start.
    let mut scrambled = experiment.clone();
    for position in &mut scrambled.runs[1].trajectory.position_m[40 * 3..] {
        position[0] += 0.01;
    }
    let other = fit(&scrambled, &mut ()).unwrap();
    assert_eq!(other.runs[1].initial, fitted.runs[1].initial);
    assert_eq!(other.fit.parameters, fitted.fit.parameters);
}

#[test]
fn a_free_run_starts_in_motion() {
    let truth = chain();
    let state = sim::State { qpos: vec![0.4, 0.2, -0.3], qvel: vec![3.0, -2.0, 5.0] };
    let trajectory = film(&truth, &state, &Command::default(), 0.0, 2.0, false, 9);
    let mut held = Run::new("held", RunKind::Free, trajectory.clone());
    held.usage = Use::Holdout;
    let runs = vec![Run::new("free", RunKind::Free, trajectory), held];
    let mut experiment = experiment(chain(), runs, &["g3/angular"]);
    experiment.fit.method = Method::LeastSquares;
    let fitted = fit(&experiment, &mut ()).unwrap();
    for (rate, wanted) in fitted.runs[0].initial.qvel.iter().zip(&state.qvel) {
        // A rate is known to what 0.4 mm over some 0.1 s and 25 mm give, and the whole run sharpens it.
        assert!((rate - wanted).abs() < 0.3, "{:?}", fitted.runs[0].initial);
    }
    assert!(fitted.runs[1].scored_from_s > 0.1);
    assert_eq!(fitted.runs[0].scored_from_s, 0.0);
}

#[test]
fn a_prior_fits_a_mass_the_runs_hardly_see() {
    let truth = chain();
    let mean = truth.parameter("link3/mass").unwrap() * 1.01;
    let std = mean * 0.02;
    let text = format!(
        "parameters = [\"g3/angular\"]\nmethod = \"least-squares\"\n[prior]\n\"link3/mass\" = {{ mean = {mean}, std = {std} }}"
    );
    let mut experiment = experiment(chain(), two_drops(&truth), &[]);
    experiment.fit = toml::from_str(&text).unwrap();
    let fitted = fit(&experiment, &mut ()).unwrap();
    let mass = fitted.fit.parameters.iter().find(|p| p.name == "link3/mass").unwrap();
    assert!(mass.std < std, "the runs add to the prior: {mass:?}");
    assert!((value(&fitted.fit, "link3/mass") - mean).abs() < 2.0 * std);
}
