//! The evidence of sets of causes on runs made by another integrator: what is hidden is named, and what nobody knows names nothing.

use crate::common::{self, chain, filmed_exactly, guess, still};
use ident::diagnose::{Diagnosis, NamedCause, Unknown, Verdict, diagnose};
use ident::experiment::{Experiment, FitConfig, Run, RunKind};
use sim::causes::own::{Acts, OwnCause, OwnParameter, Place};
use sim::{Command, Model};

const START_S: f64 = 0.3;
const NOISE_M: f64 = 4e-4;
const CORRELATION: f64 = 0.4;
const POSES: [[f64; 3]; 3] = [[1.5, 0.0, 0.0], [0.9, -1.2, 1.2], [-1.1, 0.3, -0.5]];

fn dropped(place: usize, model: &Model) -> Run {
    let mut trajectory = filmed_exactly(model, &still(POSES[place]), &Command::default(), START_S, 2.5, true);
    common::add_noise(&mut trajectory, NOISE_M, CORRELATION, place as u64 + 1);
    let id = format!("drop-{place}");
    Run { release_s: Some(START_S), prescribed: true, ..Run::new(id, RunKind::Drop, trajectory) }
}

/// Drops of the chain with default coefficients, those of the fluid and of the joints fitted; `truths` by run.
fn said(truths: [&Model; 3]) -> Diagnosis {
    let runs = truths.iter().enumerate().map(|(place, model)| dropped(place, model)).collect();
    let fit = FitConfig { parameters: vec!["fluidcoef".into(), "damping".into()], ..FitConfig::default() };
    let diagnosed = diagnose(&Experiment::new(guess(chain()), fit, runs), &mut ()).unwrap();
    let said = diagnosed.diagnosis;
    assert_eq!(diagnosed.model.causes().is_empty(), said.causes.is_empty() && said.established.is_empty());
    println!("{} {:?} {:?}", said.sentence, said.remarks, said.unknown);
    said
}

fn with(mut model: Model, hidden: &[(&str, f64)]) -> Model {
    for &(name, value) in hidden {
        model.add_cause(name.split('/').next().unwrap()).unwrap();
        model.set_parameter(name, value).unwrap();
    }
    model
}

fn named(said: &Diagnosis) -> Vec<String> {
    let label = |cause: &NamedCause| match &cause.form {
        Some(form) => format!("{} ({form})", cause.label()),
        None => cause.label(),
    };
    let mut list: Vec<String> = said.causes.iter().chain(&said.established).map(label).collect();
    list.sort_unstable();
    list
}

#[test]
fn three_small_faults_at_once_are_named_with_their_sizes() {
    let hidden = [("stiffness/q3", 4e-5), ("camera_delay/delay", 0.012), ("camera_rotation/angle", 0.01)];
    let truth = with(chain(), &hidden);
    let found = said([&truth; 3]);
    assert_eq!(named(&found), ["camera_delay", "camera_rotation", "stiffness/q3"]);
    assert_eq!(found.unknown, Unknown::default());
    assert!(found.complete);
    for (name, value) in hidden {
        let sizes = found.causes.iter().flat_map(|cause| &cause.parameters);
        let size = sizes.into_iter().find(|size| size.name == name).unwrap();
        // three standard deviations of three numbers: a chance of one in a hundred
        let [low, high] = size.ci95.unwrap();
        let std = (high - low) / 3.92;
        assert!((size.value - value).abs() < 3.0 * std, "{size:?}, hidden {value}");
    }
}

#[test]
fn where_nothing_is_hidden_nothing_is_named() {
    let found = said([&chain(); 3]);
    assert_eq!((found.verdict, found.unknown), (Verdict::NothingDetectable, Unknown::default()));
}

#[test]
fn a_clock_that_is_off_in_one_run_is_called_that() {
    let late = with(chain(), &[("camera_delay/delay", 0.03)]);
    let found = said([&chain(), &late, &chain()]);
    assert_eq!(named(&found), ["camera_delay (drop-1 only)"]);
}

#[test]
fn a_force_that_no_cause_has_names_no_force() {
    let mut truth = chain();
    truth
        .define_cause(&OwnCause {
            name: "notches".into(),
            sentence: None,
            place: Place::Joint("q2".into()),
            terms: vec![(Acts::Torque, "-size * sin(8 * q)".into())],
            parameters: vec![OwnParameter::size("size", "N m", [0.0, 1.0], 1e-5)],
        })
        .unwrap();
    truth.add_cause("notches").unwrap();
    truth.set_parameter("notches/size", 5e-5).unwrap();
    let found = said([&truth; 3]);
    assert_eq!(found.verdict, Verdict::Unexplained);
    assert!(named(&found).is_empty());
}

#[test]
fn threads_change_nothing() {
    let truth = with(chain(), &[("added_mass/scale", 0.7)]);
    let on = |threads: usize| {
        let pool = rayon_pool(threads);
        pool.install(|| said([&truth; 3]))
    };
    assert_eq!(on(1), on(3));
}

fn rayon_pool(threads: usize) -> rayon::ThreadPool {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap()
}
