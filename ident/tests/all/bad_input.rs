//! What cannot be fitted is refused with its name and the remedy.

use crate::common::*;
use ident::experiment::{Experiment, Run, RunKind, Use};
use ident::fit::{FitError, fit};

fn problem() -> Experiment {
    experiment(chain(), vec![drop_run("a", &chain(), [1.2, 0.3, -0.4], 0.1, 0.5, 1)], &["g3/angular"])
}

fn refusal(change: impl FnOnce(&mut Experiment)) -> FitError {
    let mut experiment = problem();
    change(&mut experiment);
    fit(&experiment, &mut ()).map(|_| ()).unwrap_err()
}

#[test]
fn wrong_input_is_told_from_lack_of_data_and_both_name_the_remedy() {
    type Change = Box<dyn FnOnce(&mut Experiment)>;
    let cases: Vec<(Change, bool, &str)> = vec![
        (Box::new(|e| e.runs.clear()), false, "the experiment has no runs; add a `[[run]]`"),
        (Box::new(|e| e.runs[0].usage = Use::Holdout), false, "mark at least one `use = \"fit\"`"),
        (Box::new(|e| e.fit.parameters = vec!["g3/anglar".into()]), false, "did you mean `g3/angular`?"),
        (
            Box::new(|e| e.runs[0].kind = RunKind::Driven),
            false,
            "run `a`: a driven run needs its `servo` table",
        ),
        (
            Box::new(|e| e.runs[0].trajectory.position_m.fill([f64::NAN; 3])),
            true,
            "run `a`: 0 of 50 images show a keypoint, 3 are the least",
        ),
        (
            Box::new(|e| {
                e.runs[0].release_s = None;
                let still = e.runs[0].trajectory.position_m[..3].to_vec();
                for (cell, position) in e.runs[0].trajectory.position_m.iter_mut().enumerate() {
                    *position = still[cell % 3];
                }
            }),
            true,
            "run `a`: nothing ever moves in this drop; state `release_s`",
        ),
        (
            Box::new(|e| e.runs[0].trajectory.time_s[7] = 0.01),
            false,
            "run `a`: image 8 is at 0.01 s, which is no time after the one before; sort the images",
        ),
        (Box::new(|e| e.runs[0].trajectory.time_s[7] = f64::NAN), false, "run `a`: image 8 is at NaN s"),
        (
            Box::new(|e| {
                e.runs[0].trajectory.position_m.iter_mut().step_by(3).for_each(|p| *p = [f64::NAN; 3])
            }),
            true,
            "run `a`: keypoint `P1` is never seen; remove its columns",
        ),
        (
            Box::new(|e| {
                e.runs[0].trajectory.time_s.truncate(2);
                e.runs[0].trajectory.position_m.truncate(6);
            }),
            true,
            "run `a`: 2 of 2 images show a keypoint, 3 are the least",
        ),
        (
            Box::new(|e| {
                let bounds = [2.0, 1.0].map(|bound| ground::strict::Finite::new(bound).unwrap());
                e.fit.bounds.insert("angular".into(), bounds);
            }),
            false,
            "bounds of `angular` are [2, 1]; the lower one must be less than the upper one",
        ),
        (
            Box::new(|e| {
                e.model = driven_chain();
                e.fit.parameters = vec!["servo/gain".into()];
            }),
            true,
            "no fitted run sees `servo/gain`: no keypoint moves however it is turned; add a run that does",
        ),
        (
            Box::new(|e| e.fit.parameters = vec!["g1/kutta".into(), "g1/magnus".into()]),
            true,
            "no fitted run sees `g1/kutta`, `g1/magnus`",
        ),
        (Box::new(|e| e.model.settings.gravity.0[0] = 1e12), true, "simulating run `a`"),
    ];
    for (change, lack_of_data, wanted) in cases {
        let error = refusal(change);
        assert!(error.to_string().contains(wanted), "{error}");
        assert_eq!(error.is_lack_of_data(), lack_of_data, "{error}");
    }
}

#[test]
fn nothing_to_fit_is_a_score() {
    let mut experiment = problem();
    experiment.fit.parameters.clear();
    let held = Run { usage: Use::Holdout, id: "b".into(), ..experiment.runs[0].clone() };
    experiment.runs.push(held);
    let fitted = fit(&experiment, &mut ()).unwrap();
    assert!(fitted.fit.parameters.is_empty());
    assert_eq!(fitted.fit.runs.len(), 2);
    assert_eq!(fitted.model, experiment.model);
}
