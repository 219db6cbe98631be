//! What cannot be fitted is refused with its name and the remedy.

#![allow(clippy::unwrap_used, reason = "a test stops where it cannot go on")]

mod common;

use common::*;
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
