//! Equal input gives equal bytes: for any number of threads, and across an interruption.

use crate::common::*;
use ident::experiment::{Experiment, Method};
use ident::fit::{
    Checkpoint, FitError, Flow, Observer, Origin, Progress, WarmStart, first_answer, fit, resume,
};

fn problem(method: Method) -> Experiment {
    lasting(method, 1.0)
}

fn lasting(method: Method, duration_s: f64) -> Experiment {
    let truth = chain();
    let runs = vec![
        drop_run("a", &truth, [1.2, 0.3, -0.4], 0.1, duration_s, 1),
        drop_run("b", &truth, [1.5, -1.5, 1.0], 0.1, duration_s, 2),
    ];
    let mut experiment = experiment(guess(chain()), runs, &["angular", "kutta", "damping"]);
    // Less than there is: `hybrid` then searches on after its first descent.
    experiment.noise_m = Some(0.5 * NOISE_M);
    experiment.runs[1].release_s = None;
    experiment.fit.method = method;
    experiment.fit.max_evaluations = 240;
    experiment
}

fn bytes(experiment: &Experiment) -> String {
    fit(experiment, &mut ()).unwrap().fit.to_json().unwrap()
}

#[test]
fn one_thread_and_two_write_the_same_bytes() {
    for method in [Method::Paper, Method::Hybrid] {
        let experiment = problem(method);
        let with = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| bytes(&experiment))
        };
        assert_eq!(with(1), with(2));
    }
}

/// Stops a fit after so many calls in its `stage`-th phase and keeps its state, through a file.
struct Interrupt {
    stage: usize,
    after: usize,
    phase: Option<&'static str>,
    state: Option<Checkpoint>,
}

impl Interrupt {
    fn new(stage: usize, after: usize) -> Self {
        Self { stage, after, phase: None, state: None }
    }
}

impl Observer for Interrupt {
    fn progress(&mut self, progress: &Progress<'_>) -> Flow {
        if self.phase.is_some_and(|phase| phase != progress.phase) {
            self.stage = self.stage.saturating_sub(1);
        }
        self.phase = Some(progress.phase);
        if self.stage == 0 && self.after == 0 {
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("fit-state.json");
            std::fs::write(&path, progress.checkpoint.to_json().unwrap()).unwrap();
            self.state = Some(Checkpoint::read(&path).unwrap());
            return Flow::Stop;
        }
        if self.stage == 0 {
            self.after -= 1;
        }
        Flow::Continue
    }
}

#[test]
fn a_resumed_fit_writes_the_bytes_of_an_uninterrupted_one() {
    let cases = [
        (Method::Paper, [(0, 12)].as_slice()),
        (Method::Hybrid, &[(0, 1), (1, 0), (2, 1)]),
        (Method::LeastSquares, &[(0, 1)]),
    ];
    for (method, interruptions) in cases {
        let experiment = problem(method);
        let whole = bytes(&experiment);
        for &(stage, after) in interruptions {
            a_fit_broken_off_ends_as(&whole, &experiment, Interrupt::new(stage, after));
        }
    }
}

fn a_fit_broken_off_ends_as(whole: &str, experiment: &Experiment, mut interrupt: Interrupt) {
    let broken = fit(experiment, &mut interrupt).unwrap();
    assert_eq!(broken.fit.stop_reason, "interrupted");
    let resumed = resume(experiment, interrupt.state.unwrap(), &mut ()).unwrap();
    assert_eq!(resumed.fit.to_json().unwrap(), whole, "{:?}", experiment.fit.method);
}

/// A problem whose fit does not end with its first answer.
fn with_friction(duration_s: f64) -> Experiment {
    let mut experiment = lasting(Method::Hybrid, duration_s);
    experiment.fit.parameters.push("frictionloss".into());
    experiment.fit.max_evaluations = 2000;
    for joint in ["q2", "q3"] {
        experiment.model.set_parameter(&format!("{joint}/frictionloss"), 1e-6).unwrap();
    }
    experiment
}

#[test]
fn the_first_answer_is_whole_and_leads_to_the_bytes_of_the_last() {
    let mut experiment = with_friction(1.0);
    let (first, left) = first_answer(&experiment, None, &mut ()).unwrap();
    assert!(first.fit.parameters.iter().any(|p| p.determined) && first.fit.loss_m2.is_finite());
    let last = resume(&experiment, left.expect("more than the noise is left"), &mut ()).unwrap();
    // what is least is the loss and what is known of the runs' starts, together
    assert!(last.fit.loss_m2 <= first.fit.loss_m2 * (1.0 + 1e-3));
    let starts: Vec<Origin> = last.fit.starts.iter().map(|start| start.from).collect();
    assert_eq!(starts[..2], [Origin::Loose, Origin::Model]);
    assert_eq!(last.fit.to_json().unwrap(), bytes(&experiment));
    // At the noise there is nothing to go on to.
    experiment.noise_m = Some(NOISE_M);
    let (first, left) = first_answer(&experiment, None, &mut ()).unwrap();
    assert!(left.is_none() && first.fit.to_json().unwrap() == bytes(&experiment));
}

#[test]
fn a_fit_begun_with_the_first_part_of_its_runs_ends_where_it_would_have_sooner() {
    let experiment = with_friction(1.0);
    let warm = WarmStart::of(&first_answer(&with_friction(0.75), None, &mut ()).unwrap().0);
    let read: WarmStart = serde_json::from_str(&serde_json::to_string(&warm).unwrap()).unwrap();
    assert_eq!(read, warm);

    let (cold, _) = first_answer(&experiment, None, &mut ()).unwrap();
    let (first, left) = first_answer(&experiment, Some(&warm), &mut ()).unwrap();
    assert!(first.fit.rollouts * 2 < cold.fit.rollouts, "{} {}", first.fit.rollouts, cold.fit.rollouts);
    for (a, b) in first.fit.parameters.iter().zip(&cold.fit.parameters).filter(|(_, b)| b.determined) {
        assert!((a.value - b.value).abs() < b.std, "{}: {} {} +- {}", a.name, a.value, b.value, b.std);
    }
    let last = resume(&experiment, left.expect("more than the noise is left"), &mut ()).unwrap();
    let whole = fit(&experiment, &mut ()).unwrap();
    assert_eq!(last.fit.starts[0].from, Origin::Warm);
    assert!((last.fit.loss_m2 / whole.fit.loss_m2 - 1.0).abs() < 1e-3);

    // not all parameters are known to it
    let mut other = experiment;
    other.fit.parameters.push("slender".into());
    let json = |warm| first_answer(&other, warm, &mut ()).unwrap().0.fit.to_json().unwrap();
    assert!(json(Some(&warm)) == json(None));
}

#[test]
fn a_state_of_another_experiment_is_refused() {
    let experiment = problem(Method::LeastSquares);
    let mut interrupt = Interrupt::new(0, 0);
    fit(&experiment, &mut interrupt).unwrap();
    let mut other = experiment;
    other.fit.seed = 2;
    let error = resume(&other, interrupt.state.unwrap(), &mut ()).unwrap_err();
    assert!(matches!(error, FitError::Checkpoint(_)));
    assert!(error.to_string().contains("belongs to another experiment"), "{error}");
}

#[test]
fn budget_is_kept_and_named() {
    for (method, budget) in [(Method::Paper, 30), (Method::LeastSquares, 6)] {
        let mut experiment = problem(method);
        experiment.fit.max_evaluations = budget;
        let unhurried = fit(&experiment, &mut ()).unwrap().fit;
        assert_eq!(unhurried.stop_reason, "max-evaluations", "{method:?}");
        // The error bars come on top: one evaluation, with its derivatives.
        assert!(unhurried.evaluations <= budget + 1, "{}", unhurried.evaluations);
    }
}
