//! The evidence of sets of causes on runs made by another integrator: what is hidden is named, and what nobody knows names nothing.

use crate::common::{self, chain, filmed_exactly, guess, still};
use ident::evidence::{Evidence, Standing, evidence};
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
fn said(truths: [&Model; 3]) -> Evidence {
    let runs = truths.iter().enumerate().map(|(place, model)| dropped(place, model)).collect();
    let fit = FitConfig { parameters: vec!["fluidcoef".into(), "damping".into()], ..FitConfig::default() };
    let found = evidence(&Experiment::new(guess(chain()), fit, runs), &mut ()).unwrap();
    println!("{} unnamed {:.1} unknown {:?}", found.best, found.unnamed, found.unknown);
    for cause in &found.causes {
        println!("  {} {:?} {:.3} {:.1}", cause.label, cause.standing, cause.probability, cause.gain);
    }
    found
}

fn with(mut model: Model, hidden: &[(&str, f64)]) -> Model {
    for &(name, value) in hidden {
        model.add_cause(name.split('/').next().unwrap()).unwrap();
        model.set_parameter(name, value).unwrap();
    }
    model
}

fn named(found: &Evidence) -> Vec<&str> {
    let mut list: Vec<&str> = found
        .causes
        .iter()
        .filter(|cause| cause.standing == Standing::Named)
        .map(|cause| &*cause.label)
        .collect();
    list.sort_unstable();
    list
}

#[test]
fn three_small_faults_at_once_are_named_with_their_sizes() {
    let hidden = [("stiffness/q3", 4e-5), ("camera_delay/delay", 0.012), ("camera_rotation/angle", 0.01)];
    let truth = with(chain(), &hidden);
    let found = said([&truth; 3]);
    assert_eq!(named(&found), ["camera_delay", "camera_rotation", "stiffness/q3"]);
    assert_eq!(found.unnamed, 0.0);
    assert!(found.complete);
    for (name, value) in hidden {
        let size = found.causes.iter().flat_map(|cause| &cause.sizes).find(|size| size.name == name).unwrap();
        // three standard deviations of three numbers: a chance of one in a hundred
        let std = (size.ci95[1] - size.ci95[0]) / 3.92;
        assert!((size.value - value).abs() < 3.0 * std, "{size:?}, hidden {value}");
    }
}

#[test]
fn where_nothing_is_hidden_nothing_is_named() {
    let found = said([&chain(); 3]);
    assert!(named(&found).is_empty());
    assert_eq!((found.unnamed, &*found.best), (0.0, "nothing"));
}

#[test]
fn a_clock_that_is_off_in_one_run_is_called_that() {
    let late = with(chain(), &[("camera_delay/delay", 0.03)]);
    let found = said([&chain(), &late, &chain()]);
    assert_eq!(named(&found), ["camera_delay (run 2 only)"]);
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
    assert!(found.unnamed > 0.0 || found.unknown.iter().any(|scale| *scale > 0.0));
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
